"""Costs of skills in whole numbers, by where the robot stands and whatever else they depend on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

from skillplan.exporters.pddl.whole_state import whole_state
from skillplan.model.skill_model import SkillModel
from skillplan.quick_dataclass import dataclass
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State

# Planners such as Fast Downward add costs up in 32 bits.
MOST_SUM = 2**31 - 1
_MICRO = 1_000_000
_UNITS = {"m": "micrometre", "s": "microsecond"}


class NoActionCosts(Exception):
    """Costs cannot be said as those of actions; says why and what to do instead, in a clause."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A skill where what it costs depends on nothing but where the robot stands.

    Parameters
    ----------
    skill
        The skill.
    label
        The facts that tell it from the other variants; empty where it is the only one.
    requires, forbids
        Facts that must hold, and must not.
    outcome
        What comes of it.
    origins
        Cost by the fact that says where the robot stands; empty where that does not matter.
    constant
        The cost where it does not matter.
    """

    skill: Skill
    label: str
    requires: State
    forbids: State
    outcome: Outcome
    origins: dict[str, float]
    constant: float = 0.0


@dataclass(frozen=True, slots=True)
class Scale:
    """How costs are written as whole numbers.

    Parameters
    ----------
    per_unit
        So many make one unit of the task's costs.
    unit
        What one of them is called.
    exact
        Whether nothing is rounded.
    """

    per_unit: int
    unit: str
    exact: bool

    def whole(self, cost: float) -> int:
        """Return a cost as a whole number, the nearest."""
        return round(cost * self.per_unit)

    def rounding(self, skills: int) -> float:
        """Return by how much the sum over so many skills is off at most, in the task's unit."""
        return 0.0 if self.exact else skills / 2 / self.per_unit


def variants(model: SkillModel, skill: Skill) -> Iterator[Variant]:
    """Yield a skill as one action or several, so that each costs by the robot's place alone.

    Raises
    ------
    NoActionCosts
        If the cost depends on a fact that is no choice among several.
    """
    condition = skill.precondition
    cases: Sequence[tuple[str, State, State, Outcome]] = [
        ("", condition.requires, condition.forbids, one) for one in skill.outcomes[:1]
    ] or [
        (
            str(*case.fact),
            condition.requires | case.fact,
            condition.forbids | case.forbids,
            case.outcomes[0],
        )
        for case in skill.cases
    ]
    for label, requires, forbids, outcome in cases:
        groups = _deciding_groups(model, skill, requires, forbids)
        where = _places(model, groups)
        others = [group for group in groups if group != where]
        for choice in product(*others):
            chosen = requires | model.task.facts.of(*choice)
            labels = [*([label] if label else []), *choice]
            yield from _variant(model, skill, " ".join(labels), chosen, forbids, outcome, where)


def scale_of(
    costs: Sequence[float], unit: str, skills: int, *, accept_rounding: bool = False
) -> Scale:
    """Return how to write costs: whole numbers as they are, others in millionths.

    Parameters
    ----------
    costs
        All of them.
    unit
        Of the task's costs.
    skills
        The most that a plan may have.
    accept_rounding
        Whether costs may be as small as what rounding comes to.

    Raises
    ------
    NoActionCosts
        If the sum over a plan may not fit, or rounding may hide what a skill costs.
    """
    if all(cost == round(cost) for cost in costs):
        scale = Scale(1, unit or "unit", exact=True)
    else:
        scale = Scale(_MICRO, _UNITS.get(unit, f"millionth of a {unit or 'unit'}"), exact=False)
    # Of two plans each is off by half of one a skill.
    if not (scale.exact or accept_rounding):
        least = min((cost for cost in costs if cost > 0), default=math.inf)
        if least * scale.per_unit <= skills:
            raise NoActionCosts(
                f"rounding to whole {scale.unit}s may shift two plans of {skills} skills by "
                f"{skills} of them against each other, and a skill costs no more than "
                f"{least * scale.per_unit:.3g}: plans could change places. Give lengths or times "
                "in the unit of the schema, or accept it by -O accept_rounding=true"
            )
    if scale.whole(max(costs, default=0.0)) * skills > MOST_SUM:
        raise NoActionCosts(
            f"a plan of {skills} skills may cost more than {MOST_SUM:,} {scale.unit}s, which "
            "planners that add up in 32 bits get wrong; lower step_limit or split the task"
        )
    return scale


def _variant(
    model: SkillModel,
    skill: Skill,
    label: str,
    requires: State,
    forbids: State,
    outcome: Outcome,
    where: tuple[str, ...],
) -> Iterator[Variant]:
    if not where:
        cost = _cost(model, skill, whole_state(requires, forbids))
        if math.isfinite(cost):
            yield Variant(skill, label, requires, forbids, outcome, {}, cost)
        return
    facts = model.task.facts
    costs = {
        fact: _cost(model, skill, whole_state(requires | facts.of(fact), forbids)) for fact in where
    }
    origins = {fact: cost for fact, cost in costs.items() if math.isfinite(cost)}
    if origins:
        yield Variant(skill, label, requires, forbids, outcome, origins)


def _cost(model: SkillModel, skill: Skill, state: State) -> float:
    try:
        return model.cost(state, skill)
    except ValueError as error:
        raise NoActionCosts(f"what {skill.name} costs depends on too much: {error}") from None


def _deciding_groups(
    model: SkillModel, skill: Skill, requires: State, forbids: State
) -> list[tuple[str, ...]]:
    """Return the choices on which the cost of a skill depends, each without what is ruled out."""
    facts = model.task.facts
    found: list[tuple[str, ...]] = []
    grouped = 0
    for group in facts.exclusive:
        members = facts.of(*group)
        grouped |= members.bits
        if members.bits & requires.bits:
            continue
        left = tuple(fact for fact in group if fact not in forbids)
        if _decides(model, skill, requires, forbids, left, members) and left not in found:
            found.append(left)
    for fact in facts.names:
        bit = facts.bit(fact)
        if bit & (grouped | requires.bits | forbids.bits):
            continue
        held = skill.cost.least(requires.bits | bit, forbids.bits)
        if held != skill.cost.least(requires.bits, forbids.bits | bit):
            raise NoActionCosts(f"what {skill.name} costs depends on {fact}, which may hold or not")
    return found


def _decides(
    model: SkillModel,
    skill: Skill,
    requires: State,
    forbids: State,
    group: tuple[str, ...],
    members: State,
) -> bool:
    """Whether a choice decides what a skill costs.

    A back end that tells times goes by where robots stand and which tools they hold.
    """
    facts = model.task.facts
    if model.asks_costs and set(group) & _known_to_back_ends(model):
        return True
    costs = set()
    for fact in group:
        bit = facts.bit(fact)
        ruled_out = forbids.bits | members.bits & ~bit
        costs.add(skill.cost.least(requires.bits | bit, ruled_out & ~requires.bits))
    return len(costs) > 1


def _known_to_back_ends(model: SkillModel) -> set[str]:
    robots = model.task.scene.robots
    places = {fact for robot in robots for fact in robot.places}
    return places | {tool.fact for robot in robots for tool in robot.tools}


def _places(model: SkillModel, groups: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the choice that is where the robot stands, which becomes the parameter."""
    kinds = [group for group in groups if len({fact.partition("(")[0] for fact in group}) == 1]
    named = [group for group in kinds if all("(" in fact for fact in group) and len(group) > 1]
    return max(named, key=len, default=())
