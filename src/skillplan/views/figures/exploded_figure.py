"""The product taken apart, its parts numbered in the order of a plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.figure import Figure

from skillplan.physics.performance import Image
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run, requested_task
from skillplan.views.figures.figure_style import Heading
from skillplan.views.pictures.assembly_film import FRAMES_PER_S, assembly_film
from skillplan.views.pictures.exploded_picture import exploded_picture
from skillplan.views.pictures.figure_canvas import picture_figure

SOLVER = "exact"
FILM_FRAMES_PER_S = FRAMES_PER_S


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return what has to be solved first: the task."""
    return [Run(requested_task(request))]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the product of a solved task."""
    task, result = requested_task(request), outcomes[0].result
    skills = [step.skill for step in result.steps]
    try:
        drawing = exploded_picture(task, skills)
    except ValueError as error:
        raise request.unfit(str(error).rstrip(".")) from None
    heading = Heading(drawing.title, request.details(outcomes[0].run))
    return picture_figure(drawing, heading)


def film(request: FigureRequest, outcomes: Sequence[Outcome]) -> Iterator[Image]:
    """Yield pictures of the product as the plan puts it together, `FRAMES_PER_S` a second."""
    task, result = requested_task(request), outcomes[0].result
    try:
        return assembly_film(task, [step.skill for step in result.steps])
    except ValueError as error:
        raise request.unfit(str(error).rstrip(".")) from None
