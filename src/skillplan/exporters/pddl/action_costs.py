"""PDDL actions with one cost for each place of the robot.

The facts that affect a cost can be read off it (`CostBasis`). A skill is split by all of them, so
all states of an action have the same cost.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from skillplan.exporters.pddl.conditions import (
    Case,
    ConsistentStates,
    Cover,
    FeasibleRegion,
    Region,
    collect_named_bits,
    simplify,
)
from skillplan.model.fact_analysis import CostBasis
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State

# Fast Downward and other planners add costs up in 32 bits.
MOST_SUM = 2**31 - 1
_MICRO = 1_000_000
_UNITS = {"m": "micrometre", "s": "microsecond"}
# Greatest number of actions for one skill.
_MOST_ACTIONS = 10_000


class NoActionCosts(Exception):
    """PDDL cannot represent the costs; the message is a clause with reason and remedy."""


@dataclass(frozen=True, slots=True)
class Variant:
    """An action: a skill in states in which its cost depends on the robot's place alone.

    Parameters
    ----------
    label
        Facts that distinguish it from other actions of the skill; may be empty.
    origins
        Cost by the place of the robot; empty if the place does not matter.
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
    """Conversion of costs to whole numbers.

    Parameters
    ----------
    per_unit
        Number of steps in one unit of the task's costs.
    """

    per_unit: int
    unit: str
    exact: bool

    def whole(self, cost: float) -> int:
        """Return a cost rounded to the nearest whole number."""
        return round(cost * self.per_unit)

    def rounding(self, skills: int) -> float:
        """Return the greatest rounding error of a sum over skills, in the task's unit."""
        return 0.0 if self.exact else skills / 2 / self.per_unit


class Variants:
    """Splits the skills of a task into actions."""

    def __init__(self, model: SkillModel, states: ConsistentStates) -> None:
        self._model = model
        self._states = states
        self._basis = CostBasis()

    def of(self, case: Case, cover: Cover) -> list[Variant]:
        """Return the actions of a case of a skill.

        Raises
        ------
        NoActionCosts
            If the cost depends on unknown facts, or needs too many actions.
        """
        basis = self._cost_bits(case.skill)
        region = (case.requires.bits, case.forbids.bits)
        where = self._places(region, basis | collect_named_bits(cover))
        groups = [group for group in self._states.groups(basis) if group != where]
        variants: list[Variant] = []
        for way in cover.feasible:
            for feasible in simplify(self._states, case, cover, way, where):
                for part in self._split(case, feasible, groups, where):
                    variant = self._priced(case, part, where, matters=bool(basis & where))
                    variants += [] if variant is None else [variant]
                    if len(variants) > _MOST_ACTIONS:
                        raise NoActionCosts(
                            f"{case.skill.name} comes to more than {_MOST_ACTIONS:,} actions"
                        )
        return _number_labels(variants)

    def _cost_bits(self, skill: Skill) -> int:
        """Return the bits of the facts that affect a skill's cost."""
        model = self._model
        is_duration = model.asks_costs and model.task.metric.is_duration
        bits = self._basis.bits(skill.duration_s if is_duration else skill.cost)
        if bits is None:
            raise NoActionCosts(f"it is not known which facts the cost of {skill.name} depends on")
        return bits | model.feasibility.times.basis if model.asks_costs else bits

    def _places(self, region: Region, bits: int) -> int:
        """Return the group of facts for the robot's place, which becomes the parameter."""
        # An empty region has no actions, so any parameter will do.
        _, ruled_out = self._states.close(region) or region
        largest, most = 0, 1
        for group in self._states.groups(bits & ~region[0]):
            left = (group & ~ruled_out).bit_count()
            if left > most and self._states.is_exact(group) and self._is_of_one_kind(group):
                largest, most = group, left
        return largest

    def _is_of_one_kind(self, group: int) -> bool:
        """Return True if all facts of a group have the same predicate with an argument."""
        names = self._model.task.facts.names_of(group)
        kinds = {name.partition("(")[0] for name in names}
        return len(kinds) == 1 and all("(" in name for name in names)

    def _split(
        self, case: Case, feasible: FeasibleRegion, groups: Sequence[int], where: int
    ) -> Iterator[_Part]:
        """Yield parts of a region in which the cost depends on the place alone."""
        true = case.requires.bits | feasible.true
        false = case.forbids.bits | feasible.false
        closed = false | where & ~feasible.places
        parts = [_Part("", true, false, (true, closed), feasible.places)]
        for group in groups:
            parts = [smaller for part in parts for smaller in self._divided(part, group)]
        yield from parts

    def _divided(self, part: _Part, group: int) -> list[_Part]:
        """Return a part split by the open facts of a group."""
        choices = self._states.choices(group, part.region)
        if len(choices) == 1:
            return [replace(part, region=choices[0])]
        divided = []
        for region in choices:
            held = region[0] & group
            words = self._model.task.facts.names_of(held or group)
            label = " ".join([part.label, *([] if held else ["no"]), *words]).strip()
            requires, forbids = part.requires | held, part.forbids | (0 if held else group)
            divided.append(_Part(label, requires, forbids, region, part.places))
        return divided

    def _priced(self, case: Case, part: _Part, where: int, *, matters: bool) -> Variant | None:
        """Return the action for a part of a region; None if no state has a finite cost."""
        facts = self._model.task.facts
        label = " ".join(filter(None, [case.label, part.label]))
        requires, forbids = facts.state(part.requires), facts.state(part.forbids)
        if not matters and not self._excludes_places(part, where):
            cost = self._cost(case.skill, part.region)
            action = Variant(case.skill, label, requires, forbids, case.outcome, {}, cost)
            return action if math.isfinite(cost) else None
        origins = {
            facts.names_of(region[0] & where)[0]: self._cost(case.skill, region)
            for region in self._states.choices(where, part.region)
        }
        origins = {place: cost for place, cost in origins.items() if math.isfinite(cost)}
        action = Variant(case.skill, label, requires, forbids, case.outcome, origins)
        return action if origins else None

    def _excludes_places(self, part: _Part, where: int) -> bool:
        """Return True if the robot is excluded from places that a part's facts allow."""
        facts = (part.requires, part.forbids)
        choices = self._states.choices(where, facts) if where else []
        return not all(true & where & part.places for true, _ in choices)

    def _cost(self, skill: Skill, region: Region) -> float:
        """Return the cost in a region; infinite if the skill has none there."""
        state = self._states.member(region)
        if state is None:
            return math.inf
        try:
            return self._model.cost(state, skill)
        except ValueError:
            # The state has no place of the robot, so no plan reaches it.
            return math.inf


@dataclass(frozen=True, slots=True)
class _Part:
    """Part of a feasible region.

    Parameters
    ----------
    requires, forbids
        Bits of the facts that its action requires and forbids.
    places
        Bits of the possible places of the robot; 0 if they do not matter.
    """

    label: str
    requires: int
    forbids: int
    region: Region
    places: int


def _number_labels(variants: Sequence[Variant]) -> list[Variant]:
    """Return actions of one skill with distinct labels."""
    count: dict[str, int] = {}
    for variant in variants:
        count[variant.label] = count.get(variant.label, 0) + 1
    numbers = dict.fromkeys(count, 0)
    numbered = []
    for variant in variants:
        numbers[variant.label] += 1
        number = f"case {numbers[variant.label]}" if count[variant.label] > 1 else ""
        numbered.append(replace(variant, label=f"{variant.label} {number}".strip()))
    return numbered


def choose_scale(
    costs: Sequence[float], unit: str, skills: int, *, accept_rounding: bool = False
) -> Scale:
    """Return the scale of costs: whole numbers stay, other costs become millionths.

    Parameters
    ----------
    accept_rounding
        True to accept costs as small as the rounding error of a plan.

    Raises
    ------
    NoActionCosts
        If the sum over a plan may overflow, or rounding may hide the cost of a skill.
    """
    if all(cost == round(cost) for cost in costs):
        scale = Scale(1, unit or "unit", exact=True)
    else:
        scale = Scale(_MICRO, _UNITS.get(unit, f"millionth of a {unit or 'unit'}"), exact=False)
    # Each of two plans is off by half a step for each skill.
    if not (scale.exact or accept_rounding):
        lowest = min((cost for cost in costs if cost > 0), default=math.inf)
        if lowest * scale.per_unit <= skills:
            raise NoActionCosts(
                f"rounding to whole {scale.unit}s may shift two plans of {skills} skills by "
                f"{skills} of them against each other, and a skill costs no more than "
                f"{lowest * scale.per_unit:.3g}: plans could change places. Give lengths or times "
                "in the unit of the schema, or accept it by -O accept_rounding=true"
            )
    if scale.whole(max(costs, default=0.0)) * skills > MOST_SUM:
        raise NoActionCosts(
            f"a plan of {skills} skills may cost more than {MOST_SUM:,} {scale.unit}s, which "
            "planners that add up in 32 bits get wrong; lower step_limit or split the task"
        )
    return scale
