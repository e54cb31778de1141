"""Robot skills, after the standard robot skill model.

Bogh et al., "Does your robot have skills?" (2012), and Moller et al., section 3.3: a skill has
parameters, a precondition, an execution, a prediction, and a postcondition that decides its
success.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

from skillplan.task.cost import Cost
from skillplan.task.motion import Motion
from skillplan.task.state import Condition, State

_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Outcome:
    """A possible outcome of a skill.

    Parameters
    ----------
    probability
        In (0, 1].
    add, delete
        Facts that become true and false.
    """

    probability: float
    add: State
    delete: State

    def __post_init__(self) -> None:
        if not 0 < self.probability <= 1:
            raise ValueError(f"Outcome probability must be in (0, 1], not {self.probability}.")
        if self.add.bits & self.delete.bits:
            both = self.add & self.delete
            raise ValueError(f"Outcome adds and deletes the same facts: {both}.")

    def apply(self, state: State) -> State:
        """Return the state after this outcome."""
        return State(state.bits & ~self.delete.bits | self.add.bits, state.facts)


@dataclass(frozen=True, slots=True)
class Case:
    """The effect of a skill if a certain fact holds: a conditional effect, as in PDDL.

    Parameters
    ----------
    fact
        The fact that selects the case, such as the place of a walking base.
    outcomes
        Possible outcomes; probabilities sum to 1, the nominal outcome first.
    forbids
        Further facts that must not hold.
    occupies
        Resources that other agents must not use meanwhile, such as the pins under a swing.
    """

    fact: State
    outcomes: tuple[Outcome, ...]
    forbids: State
    occupies: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        if len(self.fact) != 1:
            raise ValueError(f"A case is selected by one fact, not {self.fact}.")
        _check_probabilities(f"Case {self.fact}", self.outcomes)


@dataclass(frozen=True, slots=True)
class Way:
    """One of several alternative motions of a skill.

    Parameters
    ----------
    label
        Describes the motion, such as ``along -x, by the side``; unique in its skill.
    """

    label: str
    motion: Motion


@dataclass(frozen=True, slots=True)
class Supply:
    """When the part of a pick is there.

    Parameters
    ----------
    place
        Place that the part is taken from; parts of one feeder share it.
    arrives_s
        Earliest begin of the pick after the begin of the plan [s], >= 0.
    cycle_s
        Least time between the ends of two picks from the place [s], >= 0.
    """

    place: str
    arrives_s: float = 0.0
    cycle_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("arrives_s", "cycle_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"Supply {name} must be finite and >= 0, not {value}.")


@dataclass(frozen=True)
class Skill:
    """A grounded robot skill: an action of the transition model.

    Parameters
    ----------
    name
        ``kind(argument)``, such as ``pick(pcb)``; unique in its task.
    kind
        Name of the skill in the portfolio, such as ``pick``.
    agents
        Robots that the skill occupies, at least one.
    precondition
        Condition under which the skill is *applicable*; symbolic, needs no back end.
    outcomes
        The *prediction*: probabilities sum to 1, the nominal outcome first. Empty if `cases` are
        given.
    cost
        Cost in the task's metric, >= 0; may depend on the state.
    duration_s
        Duration [s]; may depend on the state.
    motion
        The *execution*; None for a skill without motion.
    parameters
        Arguments of the grounding, such as ``{"part": "pcb", "tool": "gripper"}``.
    cases
        Predictions that depend on the state: at most one of their facts holds at a time, and the
        skill is applicable only if one does.
    ways
        Alternative motions, the preferred first; `motion` is that of the first. Back ends check
        them one by one.
    supply
        When the part that it takes is there; None if it is there from the start.
    """

    name: str
    kind: str
    agents: tuple[str, ...]
    precondition: Condition
    outcomes: tuple[Outcome, ...]
    cost: Cost
    duration_s: Cost
    motion: Motion | None = None
    parameters: Mapping[str, str] = field(default_factory=dict, hash=False)
    cases: tuple[Case, ...] = field(default=(), hash=False)
    ways: tuple[Way, ...] = field(default=(), hash=False)
    supply: Supply | None = None
    _cases: Mapping[int, Case] = field(init=False, repr=False, compare=False)
    _conditions: dict[int, Condition] = field(init=False, repr=False, compare=False)
    _selectors: int = field(init=False, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"<Skill {self.name}>"

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("Skill name must not be empty.")
        if not self.agents:
            raise ValueError(f"Skill {self.name!r} needs at least one agent.")
        if self.cases and self.outcomes:
            raise ValueError(f"Skill {self.name!r} has outcomes of its own beside its cases.")
        if not self.cases:
            _check_probabilities(f"Skill {self.name!r}", self.outcomes)
        cases = {case.fact.bits: case for case in self.cases}
        if len(cases) != len(self.cases):
            raise ValueError(f"Skill {self.name!r} has two cases for one fact.")
        if self.ways and self.motion != self.ways[0].motion:
            raise ValueError(f"Skill {self.name!r} has another motion than its first way.")
        if len({way.label for way in self.ways}) != len(self.ways):
            raise ValueError(f"Skill {self.name!r} has two ways of one label.")
        # Keyed by the number of the bit: powers of two hash badly, see `State.__hash__`.
        by_number = {bits.bit_length(): case for bits, case in cases.items()}
        object.__setattr__(self, "_cases", by_number)
        object.__setattr__(self, "_conditions", {})
        object.__setattr__(self, "_selectors", sum(cases))
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def __reduce__(self) -> tuple[type[Skill], tuple[Any, ...]]:
        # A mapping proxy cannot be pickled, but its content can.
        values = {item.name: getattr(self, item.name) for item in fields(self) if item.init}
        return Skill, tuple({**values, "parameters": dict(self.parameters)}.values())

    def by(self, way: Way) -> Skill:
        """Return the skill with one of its motions, under a name of its own."""
        return replace(self, name=f"{self.name} {way.label}", motion=way.motion, ways=())

    def compute_wait_s(self, elapsed_s: float) -> float:
        """Return how long the arm waits for a part to arrive, so long after the begin [s]."""
        return 0.0 if self.supply is None else max(0.0, self.supply.arrives_s - elapsed_s)

    def case(self, state: State) -> Case | None:
        """Return the case that `state` selects, or None."""
        return self._case(state.bits) if self.cases else None

    def applicable(self, state: State) -> bool:
        """Return whether the precondition and, if there are cases, one of them hold in `state`."""
        return self.precondition.holds(state) and self.has_case(state.bits)

    def has_case(self, bits: int) -> bool:
        """Return whether a state selects a case; always true for a skill without cases."""
        if not self.cases:
            return True
        case = self._case(bits)
        return case is not None and not bits & case.forbids.bits

    def _case(self, bits: int) -> Case | None:
        selected = bits & self._selectors
        case = self._cases.get(selected.bit_length())
        return case if case is not None and case.fact.bits == selected else None

    def condition(self, state: State) -> Condition:
        """Return the condition for the skill to be applicable in `state`, its case included."""
        case = self.case(state)
        if case is None:
            return self.precondition
        condition = self._conditions.get(case.fact.bits.bit_length())
        if condition is None:
            requires = self.precondition.requires | case.fact
            condition = Condition(requires, self.precondition.forbids | case.forbids)
            self._conditions[case.fact.bits.bit_length()] = condition
        return condition

    def why_not(self, state: State) -> Condition:
        """Return the facts that prevent the skill from being applicable in `state`.

        Required facts are missing, forbidden facts hold. If no case is selected, the facts of all
        cases are missing.
        """
        condition = self.condition(state)
        missing = condition.requires - state
        if self.cases and self.case(state) is None and not condition.forbids & state:
            missing |= state.facts.state(self._selectors) - state
        return Condition(missing, condition.forbids & state)

    def outcomes_in(self, state: State) -> tuple[Outcome, ...]:
        """Return the possible outcomes in `state`, the nominal outcome first.

        Raises
        ------
        ValueError
            If no case is selected.
        """
        if not self.cases:
            return self.outcomes
        case = self.case(state)
        if case is None:
            raise ValueError(f"Skill {self.name!r} has no case for the state {state}.")
        return case.outcomes

    def prediction_in(self, state: State) -> Outcome:
        """Return the nominal outcome in `state`; raises as `outcomes_in`."""
        return self.outcomes_in(state)[0]

    @property
    def effects(self) -> tuple[Outcome, ...]:
        """All possible outcomes, in any state."""
        return self.outcomes or tuple(o for case in self.cases for o in case.outcomes)

    @property
    def prediction(self) -> Outcome:
        """The nominal outcome; for a skill with cases, the common part of theirs."""
        if not self.cases:
            return self.outcomes[0]
        nominal = [case.outcomes[0] for case in self.cases]
        add, delete = nominal[0].add, nominal[0].delete
        for outcome in nominal[1:]:
            add, delete = add & outcome.add, delete & outcome.delete
        return Outcome(1.0, add, delete)

    @property
    def postcondition(self) -> Condition:
        """The condition that holds after every successful execution."""
        return Condition(self.prediction.add, self.prediction.delete)

    @property
    def deterministic(self) -> bool:
        """True if every state has a single outcome."""
        cases = (case.outcomes for case in self.cases)
        return all(len(outcomes) == 1 for outcomes in (cases if self.cases else (self.outcomes,)))

    def __str__(self) -> str:
        return self.name


def _check_probabilities(owner: str, outcomes: tuple[Outcome, ...]) -> None:
    if not outcomes:
        raise ValueError(f"{owner} needs at least one outcome.")
    total = math.fsum(outcome.probability for outcome in outcomes)
    if abs(total - 1) > _TOLERANCE:
        raise ValueError(f"{owner}: outcome probabilities sum to {total}, not 1.")


class FeederClock:
    """The times at which feeders have presented their last part."""

    def __init__(self) -> None:
        self._last_s: dict[str, float] = {}

    def present(self, skill: Skill, now_s: float) -> float:
        """Return the time until a feeder presents the part of a skill, whose hand is above it [s].

        A cycle passes between two parts. As equal parts are taken alike, it also passes between the
        ends of two picks.
        """
        supply = skill.supply
        if supply is None or not supply.cycle_s:
            return 0.0
        last_s = self._last_s.get(supply.place, -math.inf)
        wait_s = max(0.0, last_s + supply.cycle_s - now_s)
        self._last_s[supply.place] = now_s + wait_s
        return wait_s
