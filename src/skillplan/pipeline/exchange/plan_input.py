"""A plan that the command line names: skills by name or number, or a file of another tool."""

from __future__ import annotations

import os
from functools import cache

from skillplan.domains.load import Problem
from skillplan.exporters.pddl.exporter import ActionNames
from skillplan.exporters.plan_files import read_plan
from skillplan.records.stored.result_file import start_plan
from skillplan.solvers.solution import Plan
from skillplan.task.skill import Skill
from skillplan.task.task import Task


def given_start(text: str, problem: Problem, part: str | None) -> Plan:
    """Return the plan that a search starts from.

    Parameters
    ----------
    text
        A result, or a plan as `given_plan` reads it.
    problem, part
        The task to solve.

    Raises
    ------
    OptionError
        As for `start_plan` and `given_plan`.
    """
    if text.strip().startswith("@") or ("," in text and not os.path.exists(text)):
        return Plan(tuple(skill.name for skill in given_plan(text, problem.part(part))))
    return start_plan(text, problem, part)


def given_plan(text: str, task: Task) -> tuple[Skill, ...]:
    """Return the skills of a plan.

    Parameters
    ----------
    text
        Action numbers or names of skills with commas; or ``@`` and a file.
    task
        Whose skills are meant.

    Raises
    ------
    OptionError
        If it is empty or names something unknown, or the file holds no plan.
    """
    if not text.strip().startswith("@"):
        return task.parse_sequence(text)
    names = cache(lambda: ActionNames(task))
    return read_plan(text.strip()[1:], task, lambda action: names().skill_of(action))
