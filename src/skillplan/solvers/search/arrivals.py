"""Lower bounds on the time of a plan from parts that are still to arrive."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task


class ArrivalBound:
    """The least end of a plan in which parts are still to be taken.

    A part that every plan takes arrives, is taken, and is put down. The bound is the latest such
    end over the parts that a state has not taken.
    """

    def __init__(self, model: SkillModel) -> None:
        self._ends = sorted(_list_least_ends(model), key=lambda end: -end[1])

    def __call__(self, state: State) -> float:
        """Return the least time from the begin of the plan to its end [s]; 0 without a bound."""
        bits = state.bits
        return next((end_s for bit, end_s in self._ends if bits & bit), 0.0)


def _list_least_ends(model: SkillModel) -> Iterator[tuple[int, float]]:
    """Yield the fact that a part has not been taken, and the least end of its way [s]."""
    task = model.task
    # Facts that no skill brings about: once taken, a part does not come back to its start.
    lasting = task.facts.all_bits
    for skill in task.skills:
        for outcome in skill.effects:
            lasting &= ~outcome.add.bits
    needed = _list_needed(task)
    for skill in task.skills:
        supply = skill.supply
        if supply is None or skill.parameters.get("part") not in needed:
            continue
        bits = skill.precondition.requires.bits & skill.prediction.delete.bits & lasting
        if not bits:
            continue
        held = skill.prediction.add.bits
        next_s = min(
            (_find_least_s(model, s) for s in task.skills if s.precondition.requires.bits & held),
            default=0.0,
        )
        yield bits & -bits, supply.arrives_s + _find_least_s(model, skill) + next_s


def _list_needed(task: Task) -> set[str]:
    """Return the components that every plan takes from their start."""
    goal = set(task.goal.requires)
    needed = {name for name, fact in task.operations.items() if fact in goal}
    for pool in task.pools:
        if not needed.issuperset(pool.places):
            # Another body may fill the place.
            needed.difference_update(pool.places)
    return needed


def _find_least_s(model: SkillModel, skill: Skill) -> float:
    needs = skill.precondition
    return model.least_duration_s(skill, needs.requires.bits, needs.forbids.bits)
