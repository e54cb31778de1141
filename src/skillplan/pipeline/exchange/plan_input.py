"""A plan that the command line names: skills by name or number, or a file of another tool."""

from __future__ import annotations

import os
from contextlib import closing
from functools import cache

from skillplan.domains.load import Problem
from skillplan.exporters.handover import Handover
from skillplan.exporters.pddl.planning_task import PlanningTask
from skillplan.exporters.plan_files import read_plan
from skillplan.pipeline.run import make_model
from skillplan.pipeline.setup import Setup
from skillplan.records.stored.result_file import start_plan
from skillplan.solvers.solution import Plan
from skillplan.task.skill import Skill
from skillplan.task.task import Task


def given_start(text: str, problem: Problem, part: str | None, setup: Setup) -> Plan:
    """Return the plan that a search starts from.

    Parameters
    ----------
    text
        A result, or a plan as `given_plan` reads it.
    problem, part
        The task to solve.
    setup
        Back ends, as in `given_plan`.

    Raises
    ------
    OptionError
        As for `start_plan` and `given_plan`.
    """
    if text.strip().startswith("@") or ("," in text and not os.path.exists(text)):
        return Plan(tuple(skill.name for skill in given_plan(text, problem.part(part), setup)))
    return start_plan(text, problem, part)


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
