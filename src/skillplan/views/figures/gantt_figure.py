"""The plan of an assembly over time, by arm and tool."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from skillplan.task.task import Task
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.figure_style import Heading
from skillplan.views.pictures.figure_canvas import picture_figure
from skillplan.views.pictures.gantt_picture import gantt_picture
from skillplan.views.pictures.plan_bars import plan_bars

SOLVER = "exact"


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the task."""
    return [Run(_task_of_arm(request))]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the timeline of a solved task."""
    task, result = _task_of_arm(request), outcomes[0].result
    skills = [step.skill for step in result.steps]
    bars = plan_bars(task, skills, [step.duration_s for step in result.steps])
    title = f"Plan of {task.name}: {len(skills)} skills, {bars[-1].end_s:.1f} s"
    heading = Heading(title, request.details(outcomes[0].run))
    return picture_figure(gantt_picture(bars, title), heading)


def _task_of_arm(request: FigureRequest) -> Task:
    task = request.problem.part(request.part)
    if not task.scene.robots:
        raise request.unfit(
            f"it shows an arm, but the file is of kind {request.problem.kind}. Figures of any kind "
            "are rewards, learning and q-values"
        )
    return task
