"""What comes before what, as a graph; also as text for Graphviz."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.figure_style import Heading
from skillplan.views.pictures.figure_canvas import picture_figure
from skillplan.views.pictures.precedence_graph import PrecedenceGraph, precedence_graph
from skillplan.views.pictures.precedence_picture import precedence_picture

SOLVER = "exact"


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return that nothing has to be solved.

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
    graph = _graph(request)
    title = f"Precedence relation of {request.problem.name}: {len(graph.edges)} pairs"
    drawing = precedence_picture(graph, title)
    return picture_figure(drawing, Heading(title, f"task {request.problem.name}"))


def dot(request: FigureRequest) -> str:
    """Return the relation of a task in the language of Graphviz."""
    return _graph(request).dot(request.problem.name)


def _graph(request: FigureRequest) -> PrecedenceGraph:
    task = request.problem.part(request.part)
    chart, names = (None, ()) if request.chart is None else request.chart(task)
    return precedence_graph(task, chart, names)
