"""Situations on the paper's board that several tests of physics start from."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"

# The optimum of the paper's Table III.
OPTIMAL = (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15)


def state_after(task: Task, actions: Iterable[int]) -> State:
    """Return the state that is predicted after a sequence, feasible or not."""
    state = task.initial
    for action in actions:
        state = task.skills[action].prediction.apply(state)
    return state


def imagined(task: Task, skill: str, *done: str) -> tuple[Skill, State]:
    """Return a skill, and a state in which it is applicable and just these elements are done."""
    chosen = task.skill(skill)
    names = {*chosen.precondition.requires, "at(home)", *(task.operations[one] for one in done)}
    for element in task.operations:
        start = f"at_start({element})"
        if start in task.facts and element not in done and f"held({element})" not in names:
            names.add(start)
    return chosen, task.facts.of(*names)
