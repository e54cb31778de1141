"""The task of an arm that a figure is requested of."""

from __future__ import annotations

from skillplan.task.task import Task
from skillplan.views.figures.figure_request import FigureRequest


def requested_task(request: FigureRequest) -> Task:
    """Return the task of a request, which must be one of parts and an arm.

    Raises
    ------
    OptionError
        If it has no bodies or no arm.
    """
    task = request.problem.part(request.part)
    if not (task.scene.bodies and task.scene.robots):
        raise request.unfit(
            f"it shows parts and an arm, but the file is of kind {request.problem.kind}. Figures "
            "of any kind are rewards, learning and q-values"
        )
    return task
