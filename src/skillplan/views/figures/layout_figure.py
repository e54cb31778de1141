"""The cell from above with the path of a plan."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run, requested_task
from skillplan.views.figures.figure_style import Heading
from skillplan.views.pictures.figure_canvas import picture_figure
from skillplan.views.pictures.layout_picture import layout_picture

SOLVER = "exact"


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return what has to be solved first: the task."""
    return [Run(requested_task(request))]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the cell of a solved task."""
    task, result = requested_task(request), outcomes[0].result
    skills = [step.skill for step in result.steps]
    title = f"{task.name} from above: {len(skills)} skills, {task.cost_text(result.cost)}"
    heading = Heading(title, request.details(outcomes[0].run))
    return picture_figure(layout_picture(task, skills), heading)
