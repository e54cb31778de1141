"""A task: one decision problem, complete and constant."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from skillplan.errors import OptionError, name_hint
from skillplan.task.motion import Point
from skillplan.task.reward import Reward
from skillplan.task.scene import WORLD, Scene
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import Condition, Facts, State

# Rounding of a cost that must not change a count in it.
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Metric:
    """The quantity to minimise, such as ``distance`` in ``m``.

    Parameters
    ----------
    name, unit
        Name and unit for output; the unit is empty for plain numbers.
    decimals
        Number of decimals in output, >= 0.
    is_duration
        True if costs are durations [s]; then times from back ends override the task's figures.
    per_s
        Cost per second of the duration in a weighted sum, >= 0; costs of skills are then
        `WeightedCost`. Times from back ends override the task's figures if it is above 0.
    terms
        Terms of a weighted sum in words, such as ``0.5 ct/m``.
    ranks
        Names and weights of counts that come before the rest of the cost, largest first.
    """

    name: str
    unit: str
    decimals: int = 5
    is_duration: bool = False
    per_s: float = 0.0
    terms: tuple[str, ...] = ()
    ranks: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        if self.decimals < 0:
            raise ValueError(f"Metric decimals must be >= 0, not {self.decimals}.")
        if not (math.isfinite(self.per_s) and self.per_s >= 0):
            raise ValueError(f"Metric per_s must be finite and >= 0, not {self.per_s}.")
        if self.is_duration and self.per_s:
            raise ValueError("Metric per_s is for a weighted sum, and a duration is none.")

    @property
    def depends_on_time(self) -> bool:
        """True if costs are durations, or have them as a term."""
        return self.is_duration or self.per_s > 0

    @property
    def cost_per_s(self) -> float:
        """Cost of a second in which nothing is done, >= 0."""
        return 1.0 if self.is_duration else self.per_s

    @property
    def heading(self) -> str:
        """The name, and the unit if it is another word."""
        return f"{self.name} [{self.unit}]" if self.unit not in ("", self.name) else self.name

    def text(self, value: float) -> str:
        """Return a value as text, with its unit, and with the counts that come first."""
        counts = []
        for name, weight in self.ranks:
            count, value = divmod(value + _ROUNDING, weight)
            value = max(value - _ROUNDING, 0.0)
            counts.append(f"{count:.0f} {name}{'' if count == 1 else 's'}, ")
        return f"{''.join(counts)}{value:.{self.decimals}f} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Literal:
    """A fact, or its negation: one bit of an observation."""

    fact: str
    positive: bool = True

    def value(self, state: State) -> int:
        """Return 1 if the literal holds in `state`, else 0."""
        return int((self.fact in state) == self.positive)

    def __str__(self) -> str:
        return self.fact if self.positive else f"not {self.fact}"


@dataclass(frozen=True, slots=True)
class Place:
    """A place of a robot: its name and position [m]."""

    name: str
    position: Point


@dataclass(frozen=True, slots=True)
class Precedence:
    """A line of a hand-made precedence chart: one operation comes before another.

    Parameters
    ----------
    instead
        Operations of which any one serves as well as `before`.
    """

    before: str
    after: str
    instead: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Pool:
    """Interchangeable bodies, each of which may fill each of some places.

    States that differ only in which body fills which place are equally good, because the bodies
    are the same. Facts and skills still name the bodies.

    Parameters
    ----------
    places
        Components whose operation fills a place; as many as bodies.
    starts, held
        Fact of each body while it is at its start, and while it is in the hand.
    located
        Facts of each body, in rows, by the place that it fills.
    """

    places: tuple[str, ...]
    starts: tuple[str, ...]
    held: tuple[str, ...]
    located: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class BackEndChoice:
    """A back end chosen by the task file, and its options."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)


@dataclass(frozen=True)
class Task:
    """One decision problem.

    Parameters
    ----------
    name, kind
        Name of the task, and name of its domain.
    skills
        The skills; the i-th is action i.
    metric
        The quantity that costs measure.
    step_limit
        Greatest number of skills in a plan, >= 1.
    scene
        Geometry; may be empty.
    reward
        Reward scheme for learners; None if the task file gives none.
    observation
        Observation bits of learners, in order; empty for all facts.
    operations
        Fact that the operation of each component brings about, such as ``pcb``: ``placed(pcb)``.
        Precedence relations refer to components.
    chart
        The hand-made precedence relation over operations.
    physics, collision
        Back ends chosen by the task file.
    sha256
        Hexadecimal hash of the content of the task file.
    starts
        Further initial states: learners explore from them, too, and stored policies cover them.
    stage
        Level of the hierarchy in a chain of tasks, such as ``base``.
    preset
        Plan that the domain prescribes, as names of skills; None if a solver must find one.
    places
        Places of walking robots, by fact.
    dwells_from
        Key paths of the dwell times in the task file, with single bodies and tools first.
    infeasible
        Reason why no plan exists, if grounding proves it; else empty. Such a task is not searched.
    covered
        Number of parts of the task, and of its whole product; None if the task file does not state
        the latter.
    notes
        Sentences about skills that grounding left out or assumed, by name of the skill.
    pools
        Interchangeable bodies, with the places that they may fill.
    """

    name: str
    kind: str
    facts: Facts
    skills: tuple[Skill, ...]
    initial: State
    goal: Condition
    metric: Metric
    step_limit: int
    scene: Scene
    reward: Reward | None = None
    observation: tuple[Literal, ...] = ()
    operations: Mapping[str, str] = field(default_factory=dict)
    chart: tuple[Precedence, ...] = ()
    physics: BackEndChoice | None = None
    collision: tuple[BackEndChoice, ...] = ()
    sha256: str = ""
    starts: tuple[State, ...] = ()
    stage: str = ""
    preset: tuple[str, ...] | None = None
    places: Mapping[str, Place] = field(default_factory=dict)
    dwells_from: tuple[str, ...] = ()
    infeasible: str = ""
    covered: tuple[int, int] | None = None
    notes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    pools: tuple[Pool, ...] = ()
    _index: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        index = {skill.name: i for i, skill in enumerate(self.skills)}
        if len(index) != len(self.skills):
            raise ValueError(f"Task {self.name!r}: skill names must be distinct.")
        if self.step_limit < 1:
            raise ValueError(f"Task {self.name!r}: step limit must be >= 1, not {self.step_limit}.")
        for literal in self.observation:
            if literal.fact not in self.facts:
                raise ValueError(f"Task {self.name!r}: unknown fact {literal.fact!r} observed.")
        for component, fact in self.operations.items():
            if fact not in self.facts:
                raise ValueError(f"Task {self.name!r}: {component!r} has unknown fact {fact!r}.")
        for line in self.chart:
            for component in (line.before, line.after, *line.instead):
                if component not in self.operations:
                    raise ValueError(f"Task {self.name!r}: chart names unknown {component!r}.")
        for fact in self.places:
            if fact not in self.facts:
                raise ValueError(f"Task {self.name!r}: unknown fact {fact!r} is a place.")
        for name in self.preset or ():
            if name not in index:
                raise ValueError(f"Task {self.name!r}: preset names unknown skill {name!r}.")
        object.__setattr__(self, "_index", index)

    def __repr__(self) -> str:
        goals = len([*self.goal.requires, *self.goal.forbids])
        return (
            f"<Task {self.name!r}, kind {self.kind!r}: {len(self.skills)} skills, "
            f"{len(self.facts)} facts, {goals} in the goal>"
        )

    def replace(self, **changes: Any) -> Task:
        """Return a copy with some fields changed."""
        changes = {"sha256": "", **changes}
        return dataclasses.replace(self, **changes)

    @property
    def has_arrivals(self) -> bool:
        """True if parts arrive at a time."""
        return any(skill.supply is not None and skill.supply.arrives_s for skill in self.skills)

    @property
    def counts_waits(self) -> bool:
        """True if costs depend on the time since the begin, which no state has."""
        return self.metric.cost_per_s > 0 and self.has_arrivals

    @property
    def deterministic(self) -> bool:
        """True if every skill has a single outcome."""
        return all(skill.deterministic for skill in self.skills)

    def action(self, skill: Skill | str) -> int:
        """Return the action number of a skill.

        Raises
        ------
        OptionError
            If the task has no such skill.
        """
        name = skill if isinstance(skill, str) else skill.name
        try:
            return self._index[name]
        except KeyError:
            hint = name_hint(name, self._index)
            raise OptionError(f"Unknown skill {name!r}. {hint}") from None

    def skill(self, reference: str | int) -> Skill:
        """Return a skill by name or action number.

        Raises
        ------
        OptionError
            If the task has no such skill.
        """
        if isinstance(reference, str):
            text = reference.strip()
            if not text.isascii() or not text.isdigit():
                return self.skills[self.action(text)]
            # Longer numbers than any action number are not worth converting.
            reference = int(text) if len(text) <= 9 else 10**9
        if not 0 <= reference < len(self.skills):
            raise OptionError(
                f"No action {reference}; the task has actions 0 to {len(self.skills) - 1}."
            )
        return self.skills[reference]

    def observe(self, state: State) -> tuple[int, ...]:
        """Return the observation bits of a state."""
        if not self.observation:
            return tuple(state.bits >> i & 1 for i in range(len(self.facts)))
        return tuple(literal.value(state) for literal in self.observation)

    def parse_sequence(self, text: str) -> tuple[Skill, ...]:
        """Return the skills of a list of action numbers or names.

        They are separated by commas, or else by blanks, with or without brackets around.

        Raises
        ------
        OptionError
            If the list is empty or names something unknown; the message gives the entry.
        """
        text = text.strip().removeprefix("[").removesuffix("]").strip()
        entries = [entry.strip() for entry in (text.split(",") if "," in text else text.split())]
        if not entries:
            raise OptionError("The sequence is empty. Give action numbers or names: 0,1,4.")
        skills = []
        for position, entry in enumerate(entries, start=1):
            if not entry:
                raise OptionError(f"Entry {position} of the sequence is empty.")
            try:
                skills.append(self.skill(entry))
            except OptionError as error:
                raise OptionError(f"Entry {position} of the sequence: {error}") from None
        return tuple(skills)

    def find_finished_state(self, skills: Sequence[str] = ()) -> State:
        """Return the facts of the goal, with a place for every body that has several.

        That is the place in the last state of a plan, or else the first one.
        """
        last = self.initial
        for name in skills:
            last = self.skills[self.action(name)].prediction_in(last).apply(last)
        finished = self.goal.requires
        for body in self.scene.bodies:
            goal = self.operations.get(body.name)
            if goal is None or body.placement(finished) is not None:
                continue
            places = [p.fact for p in body.placements if p.frame == WORLD]
            held = [fact for fact in places if fact in last and fact not in self.initial]
            if body.part_of and not held:
                # It went into a sub-assembly.
                continue
            free = [fact for fact in places if fact not in self.initial]
            if held or (goal in finished and free):
                finished |= self.facts.of((held or free)[0])
        return finished

    def places_in(self, state: State) -> list[Place]:
        """Return the places of robots in a state."""
        return [self.places[fact] for fact in state if fact in self.places]

    def cost_text(self, cost: float | None) -> str:
        """Return a cost as text, with its unit."""
        if cost is None or not math.isfinite(cost):
            return "-"
        return self.metric.text(cost)


def find_unreachable_facts(task: Task) -> dict[str, str]:
    """Return the goal facts that no sequence of skills can reach, each with a reason.

    This is the usual delete relaxation: facts, once true, stay true.
    """
    reached = _reached(task)
    lost = {}
    for fact in task.goal.requires:
        bit = task.facts.bit(fact)
        if bit & reached:
            continue
        makers = [s for s in task.skills if any(o.add.bits & bit for o in s.effects)]
        if not makers:
            lost[fact] = "no action brings it about. Add one, or change the goal."
        else:
            needed = makers[0].precondition.requires.bits
            for case in makers[0].cases:
                if any(outcome.add.bits & bit for outcome in case.outcomes):
                    needed |= case.fact.bits
            missing = task.facts.names_of(needed & ~reached)
            lost[fact] = f"{makers[0].name} needs {', '.join(missing)}, which nothing brings about."
    return lost


def _reached(task: Task) -> int:
    """Return the facts that may become true; linear time in skills and cases."""
    reached = task.initial.bits
    effects = [effect for skill in task.skills for effect in _effects(skill)]
    # Effects by a fact that they need and that is not reached yet.
    waiting: dict[int, list[tuple[int, int]]] = {}
    while effects:
        needed, added = effects.pop()
        missing = needed & ~reached
        if missing:
            waiting.setdefault(missing & -missing, []).append((needed, added))
            continue
        new = added & ~reached
        reached |= new
        while new:
            bit = new & -new
            effects += waiting.pop(bit, ())
            new ^= bit
    return reached


def _effects(skill: Skill) -> Iterator[tuple[int, int]]:
    """Yield the needed and the added facts of a skill, or of each of its cases."""
    needed = skill.precondition.requires.bits
    if not skill.cases:
        yield needed, _added(skill.outcomes)
    for case in skill.cases:
        yield needed | case.fact.bits, _added(case.outcomes)


def _added(outcomes: Sequence[Outcome]) -> int:
    bits = 0
    for outcome in outcomes:
        bits |= outcome.add.bits
    return bits


def read_start_state(task: Task, start: str | Iterable[str]) -> State:
    """Return the state of a place or of facts, by name.

    Parameters
    ----------
    start
        Text with names of places or facts, separated by commas; facts that exclude each other, such
        as places of another robot, default to the initial state. Or a list of all facts.

    Raises
    ------
    OptionError
        If a name is neither a fact nor a place, or two of them exclude each other.
    """
    by_place: dict[str, list[str]] = {}
    for fact, place in task.places.items():
        by_place.setdefault(place.name, []).append(fact)
    is_text = isinstance(start, str)
    listed = start.split(",") if isinstance(start, str) else start
    names = [name.strip() for name in listed if name.strip()]
    if is_text and not names:
        raise OptionError("names no fact and no place.")
    facts = []
    for name in names:
        meant = by_place.get(name, [name])
        if len(meant) > 1:
            raise OptionError(f"{name} may be {' or '.join(meant[:3])}. Name the fact.")
        if meant[0] not in task.facts and by_place:
            raise OptionError(f"no place {name!r}. {name_hint(name, by_place)}")
        facts += meant
    state = task.facts.of(*facts)
    for group in task.facts.exclusive:
        together = [fact for fact in group if fact in state]
        if len(together) > 1:
            raise OptionError(f"{' and '.join(together[:2])} cannot both hold. Keep one.")
        if is_text and not together:
            # The other robots stay in their places.
            state |= task.facts.of(*group) & task.initial
    return state
