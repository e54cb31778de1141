"""The precedence relation as a graph in layers, from left to right."""

from __future__ import annotations

import math
from collections.abc import Iterator

from skillplan.views.pictures.drawing import (
    SMALL_PX,
    Disc,
    Drawing,
    Item,
    Label,
    Look,
    Point,
    Shape,
    arrow,
    rectangle,
    shortened,
    text_width_px,
)
from skillplan.views.pictures.graph_layers import Bend
from skillplan.views.pictures.precedence_graph import Edge, PrecedenceGraph

_NODE_PX, _GAP_PX, _LAYER_PX, _PAD_PX = 26.0, 14.0, 78.0, 14.0
_MOST_NAME_PX, _NOTE_PX, _CHOICE_PX = 170.0, 17.0, 9.0
_LEAST_WIDTH_PX, _PASSED_PX = 420.0, 16.0


def precedence_picture(graph: PrecedenceGraph, title: str) -> Drawing:
    """Return a graph in layers; of what holds by derivation alone the arrows are blue.

    Parameters
    ----------
    graph
        With at least one component.
    title
        What it shows.

    Raises
    ------
    ValueError
        If there is no component.
    """
    if not graph.components:
        raise ValueError("There is nothing to order.")
    return _Graph(graph).drawing(title)


class _Graph:
    """Where the nodes of one picture are."""

    def __init__(self, graph: PrecedenceGraph) -> None:
        self.graph = graph
        placed = graph.placed
        self.bends = placed.bends
        self.names = {one: shortened(one, _MOST_NAME_PX) for one in graph.components}
        heights = [sum(map(_height_px, layer)) for layer in placed.layers]
        self.tall = max(heights)
        self.boxes: dict[str | Bend, tuple[float, float, float]] = {}
        left = _PAD_PX
        for layer, height in zip(placed.layers, heights, strict=True):
            wide = max(text_width_px(self.names[one]) + 18 for one in layer if isinstance(one, str))
            spare = (self.tall - height) / len(layer)
            top = _PAD_PX
            for one in layer:
                room = _height_px(one) + spare
                self.boxes[one] = (left, left + wide, top + room / 2)
                top += room
            left += wide + _LAYER_PX
        self.width = max(_LEAST_WIDTH_PX, left - _LAYER_PX + _PAD_PX)

    def drawing(self, title: str) -> Drawing:
        """Return the picture."""
        choices = 34.0 * len(self.graph.choices)
        items: list[Item] = []
        for edge in self.graph.edges:
            items += self._closing(edge) if edge.closing else self._edge(edge)
        for one in self.graph.components:
            items += self._node(one)
        top = _PAD_PX + self.tall + 8
        for number, _ in enumerate(self.graph.choices):
            items += self._choice(number, top + 34.0 * number + 17)
        words = list(self._words())
        for number, word in enumerate(words):
            place = (_PAD_PX, top + choices + 10 + _NOTE_PX * number)
            items.append(Label(place, word, "muted", SMALL_PX, "start"))
        height = top + choices + _NOTE_PX * len(words) + _PAD_PX
        wide = max([self.width, *(text_width_px(w, SMALL_PX) + 2 * _PAD_PX for w in words)])
        return Drawing(wide, height, title, tuple(items))

    def _node(self, one: str) -> Iterator[Item]:
        left, right, middle = self.boxes[one]
        box = rectangle(left, middle - _NODE_PX / 2, right, middle + _NODE_PX / 2)
        yield Shape(box, Look("paper", "ink", 1.2), title=one)
        yield Label(((left + right) / 2, middle), self.names[one])

    def _edge(self, edge: Edge) -> Iterator[Item]:
        """Yield a curve from the right side of a node to the left side of another.

        It runs level past the layers between them, beside their nodes.
        """
        start = (self.boxes[edge.before][1], self.boxes[edge.before][2])
        end = (self.boxes[edge.after][0], self.boxes[edge.after][2])
        role = "ink" if edge.derived and edge.drawn else "blue" if edge.derived else "orange"
        look = Look(stroke=role, width_px=1.5, dashed=edge.drawn and not edge.derived)
        stops = [start]
        for bend in self.bends.get((edge.before, edge.after), ()):
            left, right, middle = self.boxes[bend]
            stops += [(left, middle), (right, middle)]
        points: list[Point] = []
        for one, other in zip(stops[::2], [*stops[1::2], end], strict=True):
            slack = max(30.0, 0.45 * abs(other[0] - one[0]))
            points += [_bezier(one, other, slack, k / 20) for k in range(21)]
        yield Shape(tuple(points[:-2]), look, closed=False, title=edge.why)
        yield from arrow(points[-4], end, Look(stroke=role, width_px=1.5), head_px=8)

    def _closing(self, edge: Edge) -> Iterator[Item]:
        """Yield a curve below the nodes, from one back to another."""
        (left, right, middle), (to_left, to_right, to_middle) = (
            self.boxes[one] for one in (edge.before, edge.after)
        )
        start = ((left + right) / 2, middle + _NODE_PX / 2)
        end = ((to_left + to_right) / 2, to_middle + _NODE_PX / 2)
        low = max(start[1], end[1]) + _GAP_PX
        points = [
            (
                _cubic(start[0], start[0], end[0], end[0], k / 20),
                _cubic(start[1], low, low, end[1], k / 20),
            )
            for k in range(21)
        ]
        yield Shape(
            tuple(points[:-2]), Look(stroke="red", width_px=1.8), closed=False, title=edge.why
        )
        yield from arrow(points[-4], end, Look(stroke="red", width_px=1.8), head_px=8)

    def _choice(self, number: int, middle: float) -> Iterator[Item]:
        """Yield what has to hold in one way or another, as a row below the graph."""
        choice = self.graph.choices[number]
        words = " or ".join(
            " and ".join(f"{one} before {other}" for one, other in group) for group in choice.groups
        )
        centre = (_PAD_PX + _CHOICE_PX + 2, middle)
        title = f"{choice.skill}: {words}"
        yield Disc(centre, _CHOICE_PX + 2, Look("paper", "purple", 1.6), title)
        yield Label(centre, "or", "purple", SMALL_PX, bold=True)
        for end in sorted({e for group in choice.groups for pair in group for e in pair}):
            near = self.boxes[end]
            place = ((near[0] + near[1]) / 2, near[2] + _NODE_PX / 2)
            line = ((centre[0], middle - _CHOICE_PX - 2), place)
            yield Shape(line, Look(stroke="purple", dashed=True), closed=False, title=title)
        room = max(self.width, _LEAST_WIDTH_PX) - centre[0] - 30
        yield Label(
            (centre[0] + 20, middle), shortened(title, room, SMALL_PX), "ink", SMALL_PX, "start"
        )

    def _words(self) -> Iterator[str]:
        if self.graph.origin:
            yield f"{self.graph.origin}; {self.graph.followers} more pairs follow from these"
        if any(one.derived != one.drawn for one in self.graph.edges if not one.closing):
            yield "black: derived and hand-made; blue: derived only; orange, dashed: hand-made only"
        if any(edge.closing for edge in self.graph.edges):
            yield "red: closes a cycle, so that no order exists"
        yield from (shortened(note, 900, SMALL_PX) for note in self.graph.notes)


def _height_px(one: str | Bend) -> float:
    """Return how much room a node takes in its layer, or an edge that passes it."""
    return _NODE_PX + _GAP_PX if isinstance(one, str) else _PASSED_PX


def _bezier(start: Point, end: Point, bend: float, at: float) -> Point:
    """Return a point of a cubic curve that leaves and arrives level."""
    x = _cubic(start[0], start[0] + bend, end[0] - bend, end[0], at)
    return (x, _cubic(start[1], start[1], end[1], end[1], at))


def _cubic(start: float, one: float, other: float, end: float, at: float) -> float:
    """Return one coordinate of a cubic Bezier curve, `at` from 0 to 1."""
    controls = (start, one, other, end)
    return sum(
        math.comb(3, k) * at**k * (1 - at) ** (3 - k) * value for k, value in enumerate(controls)
    )
