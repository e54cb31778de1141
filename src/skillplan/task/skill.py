"""Robot skills, after the standard robot skill model.

Bogh et al., "Does your robot have skills?" (2012), and Moller et al., section 3.3: a skill has
parameters, a precondition, an execution, a prediction of what it will bring about, and a
postcondition by which its success is judged.
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
    """One thing that may come of a skill.

    Parameters
    ----------
    probability
        In (0, 1].
    add, delete
        Facts that become true and false.

    Raises
    ------
    ValueError
        If the probability is out of range or a fact is both added and deleted.
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
    """What a skill does where one particular fact holds: a conditional effect, as in PDDL.

    Parameters
    ----------
    fact
        The one fact that selects the case, such as where a walking base stands.
    outcomes
        What may come of the skill there; probabilities sum to 1, the nominal outcome first.
    forbids
        Facts that must not hold besides.
    occupies
        What nobody else may use while the skill runs, such as the pins that a swing sweeps.

    Raises
    ------
    ValueError
        If it is not selected by exactly one fact, or the probabilities do not sum to 1.
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
    """One of several motions by which a skill may be executed.

    Parameters
    ----------
    label
        What tells it from the others, in words: ``along -x, by the side``.
    motion
        The motion.
    """

    label: str
    motion: Motion


@dataclass(frozen=True)
class Skill:
    """A grounded robot skill: one arrow label of the transition model.

    Parameters
    ----------
    name
        ``kind(argument)``, such as ``pick(pcb)``; unique in its task.
    kind
        The skill of the portfolio it is an instance of, such as ``pick``.
    agents
        The robots it occupies, at least one.
    precondition
        Where it is *applicable*: symbolic, free to query.
    outcomes
        The *prediction*; probabilities sum to 1, the nominal outcome first. Empty where
        `cases` are given.
    cost
        Value in the task's metric, >= 0, possibly depending on the state.
    duration_s
        Time it takes [s].
    motion
        The *execution*; None for a skill without motion.
    parameters
        What it was grounded with, such as ``{"part": "pcb", "tool": "gripper"}``.
    cases
        For a skill whose prediction depends on the state: at most one of their facts holds at a
        time, and the skill is applicable only where one does.
    ways
        Where there are several motions to choose from, all of them, the preferred first; its
        motion is then that of the first. Back ends are queried about one of them at a time.

    Raises
    ------
    ValueError
        If the name is empty, no agent is given, there are neither or both of outcomes and cases,
        two cases have one fact, the probabilities do not sum to 1, two ways have one label, or the
        motion is not that of the first way.
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
        # By number of the fact: powers of two make poor keys, see `State.__hash__`.
        by_number = {bits.bit_length(): case for bits, case in cases.items()}
        object.__setattr__(self, "_cases", by_number)
        object.__setattr__(self, "_conditions", {})
        object.__setattr__(self, "_selectors", sum(cases))
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def __reduce__(self) -> tuple[type[Skill], tuple[Any, ...]]:
        # A mapping proxy cannot be pickled; its content can.
        values = {item.name: getattr(self, item.name) for item in fields(self) if item.init}
        return Skill, tuple({**values, "parameters": dict(self.parameters)}.values())

    def by(self, way: Way) -> Skill:
        """Return the skill as it is executed in one of its ways, under a name of its own."""
        return replace(self, name=f"{self.name} {way.label}", motion=way.motion, ways=())

    def case(self, state: State) -> Case | None:
        """Return the case that `state` selects; None for a skill without, or where none fits."""
        return self._case(state.bits) if self.cases else None

    def applicable(self, state: State) -> bool:
        """Whether the precondition holds in `state`, and one of the cases where there are any."""
        return self.precondition.holds(state) and self.has_case(state.bits)

    def has_case(self, bits: int) -> bool:
        """Whether the state with these bits selects a case; true of a skill without cases."""
        if not self.cases:
            return True
        case = self._case(bits)
        return case is not None and not bits & case.forbids.bits

    def _case(self, bits: int) -> Case | None:
        selected = bits & self._selectors
        case = self._cases.get(selected.bit_length())
        return case if case is not None and case.fact.bits == selected else None

    def condition(self, state: State) -> Condition:
        """Return what its being applicable in `state` rests on."""
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
        """Return what would have to hold otherwise in `state` for it to be applicable.

        Required are missing facts, forbidden those that hold but must not; both are empty where it
        is applicable. Where no case fits, the facts that would select one are all missing.
        """
        condition = self.condition(state)
        missing = condition.requires - state
        if self.cases and self.case(state) is None and not condition.forbids & state:
            missing |= state.facts.state(self._selectors) - state
        return Condition(missing, condition.forbids & state)

    def outcomes_in(self, state: State) -> tuple[Outcome, ...]:
        """Return what may come of it in `state`, the nominal outcome first.

        Raises
        ------
        ValueError
            If it has cases and none of them fits.
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
        """All that may come of it, in whatever state."""
        return self.outcomes or tuple(o for case in self.cases for o in case.outcomes)

    @property
    def prediction(self) -> Outcome:
        """The nominal outcome; of a skill with cases what they have in common."""
        if not self.cases:
            return self.outcomes[0]
        nominal = [case.outcomes[0] for case in self.cases]
        add, delete = nominal[0].add, nominal[0].delete
        for outcome in nominal[1:]:
            add, delete = add & outcome.add, delete & outcome.delete
        return Outcome(1.0, add, delete)

    @property
    def postcondition(self) -> Condition:
        """What must hold after a successful execution, wherever it was started."""
        return Condition(self.prediction.add, self.prediction.delete)

    @property
    def deterministic(self) -> bool:
        """Whether only one thing can come of it in any state."""
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
