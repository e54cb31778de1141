"""A plan that the command line names: skills by name or number, or a file of another tool."""

from __future__ import annotations

from contextlib import closing
from functools import cache

from skillplan.exporters.handover import Handover
from skillplan.exporters.pddl.planning_task import PlanningTask
from skillplan.exporters.plan_files import read_plan
from skillplan.pipeline.run import make_model
from skillplan.pipeline.setup import Setup
from skillplan.task.skill import Skill
from skillplan.task.task import Task


def given_plan(text: str, task: Task, setup: Setup) -> tuple[Skill, ...]:
    """Return the skills of a plan.

    Parameters
    ----------
    text
        Action numbers or names of skills with commas; or ``@`` and a file.
    task
        Whose skills are meant.
    setup
        Back ends, which an action of PDDL may depend on where they tell times.

    Raises
    ------
    OptionError
        If it is empty or names something unknown, or the file holds no plan.
    """
    if not text.strip().startswith("@"):
        return task.parse_sequence(text)

    @cache
    def planning_task() -> PlanningTask:
        model = make_model(task, setup)
        with closing(model.feasibility):
            made = PlanningTask(Handover(model, derived=True))
            made.skill_of("")  # all that is asked of back ends is asked here
        return made

    return read_plan(text.strip()[1:], task, lambda action: planning_task().skill_of(action))
