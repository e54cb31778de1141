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
    picks_of = dict[str, list[Skill]]()
    for skill in task.skills:
        if skill.supply is not None:
            picks_of.setdefault(skill.parameters["part"], []).append(skill)
    for name, picks in picks_of.items():
        bits = lasting if _is_needed(task, name) else 0
        for pick in picks:
            bits &= pick.precondition.requires.bits & pick.prediction.delete.bits
        if bits:
            # The plan chooses one of several tools, so only the soonest end is certain.
            yield bits & -bits, min(_find_least_end_s(model, pick) for pick in picks)


def _is_needed(task: Task, name: str) -> bool:
    """Return True if every plan takes a part, as no other one serves for its operation."""
    fact = task.operations.get(name)
    return fact in set(task.goal.requires) and all(
        skill.parameters.get("part") == name
        for skill in task.skills
        if any(fact in outcome.add for outcome in skill.effects)
    )


def _find_least_end_s(model: SkillModel, pick: Skill) -> float:
    """Return the least time at which a part that a skill takes is put down [s]."""
    held = pick.prediction.add.bits
    arrives_s = 0.0 if pick.supply is None else pick.supply.arrives_s
    next_s = min(
        (_find_least_s(model, s) for s in model.task.skills if s.precondition.requires.bits & held),
        default=0.0,
    )
    return arrives_s + _find_least_s(model, pick) + next_s


def _find_least_s(model: SkillModel, skill: Skill) -> float:
    needs = skill.precondition
    return model.least_duration_s(skill, needs.requires.bits, needs.forbids.bits)
