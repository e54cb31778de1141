"""When who does what: of an assembly by arm and tool, of the bench the five steps."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.figure_style import Heading
from skillplan.views.figures.swarmitfix import gantt_figure as bench
from skillplan.views.pictures.figure_canvas import picture_figure
from skillplan.views.pictures.gantt_picture import gantt_picture
from skillplan.views.pictures.plan_bars import plan_bars

SOLVER = "exact"


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return what has to be solved first: the task, or the whole chain of a bench."""
    if _is_of_arm(request):
        return [Run(request.problem.part(request.part))]
    return bench.runs(request)


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the timeline of a solved task or chain."""
    if not _is_of_arm(request):
        return bench.draw(request, outcomes)
    task, result = request.problem.part(request.part), outcomes[0].result
    skills = [step.skill for step in result.steps]
    bars = plan_bars(task, skills, [step.duration_s for step in result.steps])
    title = f"Plan of {task.name}: {len(skills)} skills, {bars[-1].end_s:.1f} s"
    heading = Heading(title, request.details(outcomes[0].run))
    return picture_figure(gantt_picture(bars, title), heading)


def _is_of_arm(request: FigureRequest) -> bool:
    return not request.problem.is_chain and bool(request.problem.tasks[0].scene.robots)
