"""The precedence relation as a graph from left to right, or as text for Graphviz."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.figure_style import Heading
from skillplan.views.figures.picture import (
    SMALL_PX,
    Note,
    Picture,
    make_rectangle,
    measure_text_px,
    shorten,
)
from skillplan.views.figures.precedence_graph import (
    Choice,
    Edge,
    Node,
    PrecedenceGraph,
    build_precedence_graph,
)
from skillplan.views.figures.solids import Point

SOLVER = "exact"

_NODE_PX, _GAP_PX, _LAYER_PX, _PAD_PX = 26.0, 14.0, 78.0, 14.0
_MOST_NAME_PX, _NOTE_PX, _CHOICE_PX, _CHOICE_ROW_PX = 170.0, 17.0, 9.0, 34.0
_LEAST_WIDTH_PX, _PASSED_PX = 420.0, 16.0


def draw_precedence(graph: PrecedenceGraph, title: str) -> Picture:
    """Return a graph in layers.

    Parameters
    ----------
    graph
        Graph with at least one component.

    Raises
    ------
    ValueError
        If the graph is empty.
    """
    if not graph.components:
        raise ValueError("There is nothing to order.")
    return _GraphPicture(graph, title).draw()


class _GraphPicture:
    """A picture with the places of the nodes: left, right and middle [px]."""

    def __init__(self, graph: PrecedenceGraph, title: str) -> None:
        self.graph = graph
        placed = graph.placed
        self.bends = placed.bends
        self.names = {name: shorten(name, _MOST_NAME_PX) for name in graph.components}
        heights = [sum(map(_get_room_px, layer)) for layer in placed.layers]
        self.bottom = _PAD_PX + max(heights)
        self.boxes: dict[Node, tuple[float, float, float]] = {}
        left = _PAD_PX
        for layer, height in zip(placed.layers, heights, strict=True):
            names = [self.names[node] for node in layer if isinstance(node, str)]
            wide = max(map(measure_text_px, names)) + 18
            spare = (max(heights) - height) / len(layer)
            top = _PAD_PX
            for node in layer:
                room = _get_room_px(node) + spare
                self.boxes[node] = (left, left + wide, top + room / 2)
                top += room
            left += wide + _LAYER_PX
        self.width = max(_LEAST_WIDTH_PX, left - _LAYER_PX + _PAD_PX)
        self.legend = list(self._legend())
        choices_px = _CHOICE_ROW_PX * len(graph.choices)
        self.legend_top = self.bottom + 8 + choices_px
        height_px = self.legend_top + _NOTE_PX * len(self.legend) + _PAD_PX
        widths = (measure_text_px(words, SMALL_PX) + 2 * _PAD_PX for words in self.legend)
        self.picture = Picture(max([self.width, *widths]), height_px, title)

    def draw(self) -> Picture:
        """Return the picture."""
        for edge in self.graph.edges:
            if edge.closing:
                self._draw_closing(edge)
            else:
                self._draw_edge(edge)
        for name in self.graph.components:
            left, right, middle = self.boxes[name]
            box = make_rectangle(left, middle - _NODE_PX / 2, right, middle + _NODE_PX / 2)
            self.picture.polygon(box, "paper", "ink", 1.2, note=Note(name))
            self.picture.label(((left + right) / 2, middle), self.names[name])
        for number, choice in enumerate(self.graph.choices):
            self._draw_choice(choice, self.bottom + 8 + _CHOICE_ROW_PX * (number + 0.5))
        for number, words in enumerate(self.legend):
            at = (_PAD_PX, self.legend_top + 10 + _NOTE_PX * number)
            self.picture.label(at, words, "muted", SMALL_PX, "start")
        return self.picture

    def _draw_edge(self, edge: Edge) -> None:
        """Draw a curve from the right side of a node to the left side of another.

        It passes the layers between them horizontally, between their nodes.
        """
        start = (self.boxes[edge.before][1], self.boxes[edge.before][2])
        end = (self.boxes[edge.after][0], self.boxes[edge.after][2])
        role = "ink" if edge.derived and edge.drawn else "blue" if edge.derived else "orange"
        stops = [start]
        for bend in self.bends.get((edge.before, edge.after), ()):
            left, right, middle = self.boxes[bend]
            stops += [(left, middle), (right, middle)]
        points: list[Point] = []
        for a, b in zip(stops[::2], [*stops[1::2], end], strict=True):
            slack = max(30.0, 0.45 * abs(b[0] - a[0]))
            points += _trace_bezier(a, (a[0] + slack, a[1]), (b[0] - slack, b[1]), b)
        self._draw_curve(points, role, 1.5, edge, dashed=edge.drawn and not edge.derived)

    def _draw_closing(self, edge: Edge) -> None:
        """Draw a curve below the nodes, back from one to another."""
        ends = []
        for name in (edge.before, edge.after):
            left, right, middle = self.boxes[name]
            ends.append(((left + right) / 2, middle + _NODE_PX / 2))
        (x, _), (to_x, _) = ends
        low = max(y for _, y in ends) + _GAP_PX
        points = _trace_bezier(ends[0], (x, low), (to_x, low), ends[1])
        self._draw_curve(points, "red", 1.8, edge)

    def _draw_curve(
        self, points: list[Point], role: str, width_px: float, edge: Edge, *, dashed: bool = False
    ) -> None:
        self.picture.line(points[:-2], role, width_px, dashed=dashed, note=Note(edge.why))
        self.picture.arrow(points[-4], points[-1], role, 1.5, head_px=8)

    def _draw_choice(self, choice: Choice, middle: float) -> None:
        """Draw alternatives as a row below the graph."""
        centre = (_PAD_PX + _CHOICE_PX + 2, middle)
        note = Note(f"{choice.skill}: {choice.words}")
        self.picture.disc(centre, _CHOICE_PX + 2, "paper", "purple", 1.6, note=note)
        self.picture.label(centre, "or", "purple", SMALL_PX, bold=True)
        for name in choice.components:
            left, right, y = self.boxes[name]
            ends = ((centre[0], middle - _CHOICE_PX - 2), ((left + right) / 2, y + _NODE_PX / 2))
            self.picture.line(ends, "purple", dashed=True, note=note)
        words = shorten(note.title, self.width - centre[0] - 30, SMALL_PX)
        self.picture.label((centre[0] + 20, middle), words, "ink", SMALL_PX, "start")

    def _legend(self) -> Iterator[str]:
        edges = self.graph.edges
        if self.graph.origin:
            yield f"{self.graph.origin}; {self.graph.followers} more pairs follow from these"
        if any(edge.derived != edge.drawn for edge in edges if not edge.closing):
            yield "black: derived and hand-made; blue: derived only; orange, dashed: hand-made only"
        if any(edge.closing for edge in edges):
            yield "red: closes a cycle, so that no order exists"
        yield from (shorten(note, 900, SMALL_PX) for note in self.graph.notes)


def _get_room_px(node: Node) -> float:
    """Return the height that a node, or an edge that passes, takes in its layer."""
    return _NODE_PX + _GAP_PX if isinstance(node, str) else _PASSED_PX


def _trace_bezier(*controls: Point) -> list[Point]:
    """Return points of a cubic Bezier curve with four control points."""
    t = np.linspace(0.0, 1.0, 21)[:, None]
    a, b, c, d = np.array(controls)
    curve = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d
    return [(x, y) for x, y in curve.tolist()]


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return no runs: nothing has to be solved.

    Raises
    ------
    OptionError
        If the task has no components to order.
    """
    if not request.problem.part(request.part).operations:
        raise request.unfit("its task has no parts that are put in order")
    return []


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the relation of a task."""
    graph = _derive_graph(request)
    title = f"Precedence relation of {request.problem.name}: {len(graph.edges)} pairs"
    heading = Heading(title, f"task {request.problem.name}")
    return draw_precedence(graph, title).with_heading(heading)


def dot(request: FigureRequest) -> str:
    """Return the relation of a task in the language of Graphviz."""
    return _derive_graph(request).dot(request.problem.name)


def _derive_graph(request: FigureRequest) -> PrecedenceGraph:
    task = request.problem.part(request.part)
    chart, names = (None, ()) if request.chart is None else request.chart(task)
    return build_precedence_graph(task, chart, names)
