"""From base policies to the timed five-step locomotion between supports.

Between two supports the head is retracted, the PKM parks, the base swings while the PKM turns
against it, the head approaches the next support and supports it (Veeramani and Muthuswamy 2022,
section 3). `base_path` gives the paths of the base.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from skillplan.task.cost import CaseCost, ConstantCost, Cost
from skillplan.task.reward import DistanceReward
from skillplan.task.scene import Scene
from skillplan.task.skill import Case, Outcome, Skill
from skillplan.task.state import Condition, Facts
from skillplan.task.task import Metric, Place, Task
from skillplan_swarmitfix.bench.bench import Bench, Timings
from skillplan_swarmitfix.bench.swings import Direction

BaseStep = tuple[int, int, int]
"""Action, position before, position after."""
BasePath = tuple[BaseStep, ...]


def along(bench: Bench, start: int, skills: Sequence[str]) -> BasePath:
    """Return the path of a plan (policy to path conversion; paper, section 4.1.3).

    Parameters
    ----------
    bench
        The lattice.
    start
        Position at the start.
    skills
        Names of skills of a base task, such as ``B2``; staying adds no step.

    Raises
    ------
    ValueError
        If a swing leads off the bench.
    """
    path: list[BaseStep] = []
    here = start
    for skill in skills:
        action = int(skill.removeprefix("B"))
        after = int(bench.successors[here, action])
        if after < 0:
            raise ValueError(f"{skill} leads off the bench from {bench.name(here)}.")
        if action:
            path.append((action, here, after))
        here = after
    return tuple(path)


class FiveStep(StrEnum):
    """The transitions between two supports, in their order; the third once a swing."""

    RETRACT = "retract"
    PARK = "park"
    SWING = "swing"
    APPROACH = "approach"
    SUPPORT = "support"


class Agent(StrEnum):
    """Moving units: the head, the PKM that carries it, the base that carries both."""

    HEAD = "head"
    PKM = "pkm"
    BASE = "base"


@dataclass(frozen=True, slots=True)
class SwingDetail:
    """One swing by names, and how the PKM turns against it.

    Parameters
    ----------
    action
        As in the paper's Table 1, such as ``B2``.
    leg
        The leg that stays docked, 1 to 3.
    pivot
        The pin it stays docked on, such as ``P17``.
    direction
        Clockwise or counter-clockwise, in the convention of the bench.
    angle_deg
        Angle of the swing [deg], > 0.
    start, end
        Positions of the base, such as ``C66``.
    counter_rotation_deg
        Turn of the PKM against the base about the base's centre [deg], counter-clockwise
        positive: the opposite of the swing, so that the head keeps its heading.
    """

    action: str
    leg: int
    pivot: str
    direction: str
    angle_deg: int
    start: str
    end: str
    counter_rotation_deg: int


@dataclass(frozen=True, slots=True)
class Phase:
    """One step of the locomotion and when it happens.

    Parameters
    ----------
    sequence
        Index of the path from one support to the next, from 0.
    step
        Kind of step.
    start_s, end_s
        From the start of the whole [s].
    base
        Name of the position in which the base stands at the end.
    support_m
        Target (x, y) of the head [m]; approach and support only.
    swing
        Of swings only.

    Raises
    ------
    ValueError
        If it ends before it starts, or has a swing or support that its step does not.
    """

    sequence: int
    step: FiveStep
    start_s: float
    end_s: float
    base: str
    support_m: tuple[float, float] | None = None
    swing: SwingDetail | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.start_s <= self.end_s:
            raise ValueError(f"A phase cannot run from {self.start_s} s to {self.end_s} s.")
        if (self.swing is not None) != (self.step is FiveStep.SWING):
            raise ValueError(f"A phase names its swing if it is one; this is: {self.step}.")
        led = self.step in (FiveStep.APPROACH, FiveStep.SUPPORT)
        if (self.support_m is not None) != led:
            raise ValueError(f"Only approach and support name a support; this is: {self.step}.")

    @property
    def agents(self) -> tuple[Agent, ...]:
        """Busy agents: base and PKM in a swing, otherwise head and PKM."""
        first = Agent.BASE if self.step is FiveStep.SWING else Agent.HEAD
        return first, Agent.PKM

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.end_s - self.start_s

    def document(self) -> dict[str, Any]:
        """Return the phase as JSON values; what its step does not have is left out."""
        values: dict[str, Any] = {
            "sequence": self.sequence,
            "step": str(self.step),
            "agents": [str(agent) for agent in self.agents],
            "start_s": self.start_s,
            "end_s": self.end_s,
            "base": self.base,
        }
        if self.support_m is not None:
            values["support_m"] = list(self.support_m)
        if self.swing is not None:
            values["swing"] = asdict(self.swing)
        return values


@dataclass(frozen=True, slots=True)
class Makespan:
    """Length of a timeline: swings, and seconds.

    Parameters
    ----------
    steps
        Swings of the base: the paper's makespan.
    duration_s
        From the start to the end of the last phase [s].
    swing_s
        Time of the swings within it [s].
    """

    steps: int
    duration_s: float
    swing_s: float


def timeline(
    bench: Bench,
    sequences: Sequence[BasePath],
    supports_m: Sequence[tuple[float, float]],
    timings: Timings | None = None,
    *,
    home: int,
) -> tuple[Phase, ...]:
    """Return the phases of every path from one support to the next, without a pause.

    If the base stays, the PKM alone repositions the head: retract, approach, support. There
    is nothing to park for, as the base does not move.

    Parameters
    ----------
    bench
        The lattice.
    sequences
        The base's path to each goal position, as from `along`; empty where the base stays.
    supports_m
        Point (x, y) at which the head supports the sheet after each path [m].
    timings
        Durations; by default the real machine's.
    home
        Position of the base at the start.

    Raises
    ------
    ValueError
        If the numbers of paths and supports differ, a path does not start where the one before
        ended, or a step is not a swing of the bench.
    """
    timings = timings or Timings()
    if len(sequences) != len(supports_m):
        raise ValueError(
            f"Each path needs the support that it leads to, but there are {len(sequences)} paths "
            f"and {len(supports_m)} supports."
        )
    phases: list[Phase] = []
    base = home

    def add(index: int, step: FiveStep, duration_s: float, **rest: Any) -> None:
        start_s = phases[-1].end_s if phases else 0.0
        name = bench.name(base)
        phases.append(Phase(index, step, start_s, start_s + duration_s, name, **rest))

    for index, (path, support_m) in enumerate(zip(sequences, supports_m, strict=True)):
        add(index, FiveStep.RETRACT, timings.retract_s)
        if path:
            add(index, FiveStep.PARK, timings.park_s)
        for action, before, after in path:
            detail = _detail(bench, base, (action, before, after))
            base = after
            add(index, FiveStep.SWING, timings.of_swing(detail.angle_deg), swing=detail)
        led = (float(support_m[0]), float(support_m[1]))
        add(index, FiveStep.APPROACH, timings.approach_s, support_m=led)
        add(index, FiveStep.SUPPORT, timings.support_s, support_m=led)
    return tuple(phases)


def _detail(bench: Bench, base: int, step: BaseStep) -> SwingDetail:
    """Return a step of a path by names, having checked that the base can take it."""
    action, before, after = step
    if before != base:
        raise ValueError(
            f"The base stands in {bench.name(base)}, but its path goes on from "
            f"{bench.name(before)}."
        )
    swing = bench.swing(before, action)
    if swing is None or swing.end != after:
        really = "is no swing" if swing is None else f"leads to {bench.name(swing.end)}"
        raise ValueError(
            f"B{action} in {bench.name(before)} {really}; in the path it leads to "
            f"{bench.name(after)}."
        )
    against = swing.angle_deg if swing.direction is Direction.CW else -swing.angle_deg
    return SwingDetail(
        action=f"B{action}",
        leg=swing.leg,
        pivot=bench.pin_name(swing.pivot),
        direction=str(swing.direction),
        angle_deg=swing.angle_deg,
        start=bench.name(before),
        end=bench.name(after),
        counter_rotation_deg=against,
    )


def makespan(phases: Iterable[Phase]) -> Makespan:
    """Return the length of a timeline, in swings and in seconds; 0 of an empty one."""
    phases = tuple(phases)
    swings = [phase.duration_s for phase in phases if phase.step is FiveStep.SWING]
    return Makespan(len(swings), phases[-1].end_s if phases else 0.0, math.fsum(swings))


STEPS = Metric("steps", "steps", 0)


def at(position: str) -> str:
    """Return the fact that the base stands at a position."""
    return f"at({position})"


class BaseGrounding:
    """Data shared by the base tasks of one bench.

    Parameters
    ----------
    bench
        The lattice.
    swing_s
        Time of a swing [s] by its angle [deg].
    step_limit
        The most swings of a plan, >= 1; None for as many as a path round the whole bench takes.
    """

    def __init__(
        self, bench: Bench, swing_s: Mapping[int, float], step_limit: int | None = None
    ) -> None:
        self.bench = bench
        self.step_limit = step_limit or max(100, 2 * (bench.rows + bench.cols))
        names = tuple(at(bench.name(i)) for i in range(bench.n_positions))
        self.facts = Facts(names, exclusive=(names,) if len(names) > 1 else ())
        self.states = tuple(self.facts.state(1 << i) for i in range(bench.n_positions))
        self.places = {
            fact: Place(bench.name(i), (float(x_m), float(y_m), 0.0))
            for i, (fact, (x_m, y_m)) in enumerate(zip(names, bench.centroids_m, strict=True))
        }
        self.skills = tuple(self._skill(action, swing_s) for action in range(bench.actions))

    def task(self, name: str, start: int, goal: int, sha256: str = "") -> Task:
        """Return the task of walking from `start` to `goal`, both positions from 0."""
        bench = self.bench
        distances_m = [math.dist(point, bench.centroids_m[goal]) for point in bench.centroids_m]
        return Task(
            name=name,
            kind="swarmitfix",
            facts=self.facts,
            skills=self.skills,
            initial=self.states[start],
            goal=Condition(self.states[goal], self.facts.none),
            metric=STEPS,
            step_limit=self.step_limit,
            scene=Scene((), ()),
            reward=DistanceReward(
                {1 << i: distance_m for i, distance_m in enumerate(distances_m)},
                complete=1.0,
                # The paper does not give the reward of a swing off the bench: as if it led
                # farther from the goal than any position.
                infeasible=-1.0 - max(distances_m),
            ),
            sha256=sha256,
            starts=self.states,
            stage="base",
            places=self.places,
        )

    def _skill(self, action: int, swing_s: Mapping[int, float]) -> Skill:
        bench, none = self.bench, self.facts.none
        cases: list[Case] = []
        times_s: dict[int, float] = {}
        for start, end in enumerate(bench.successors[:, action].tolist()):
            if end < 0:
                continue
            here, there = self.states[start], self.states[end]
            outcome = Outcome(1.0, there, here if start != end else none)
            pins = frozenset(bench.pin_name(pin) for pin in bench.swept_pins(start, action))
            cases.append(Case(here, (outcome,), none, pins))
            times_s[here.bits] = swing_s[int(bench.swing_deg[start, action])] if action else 0.0
        off_bench = self.facts.state(self.facts.all_bits & ~sum(times_s))
        duration_s: Cost = CaseCost(times_s) if times_s else ConstantCost(0.0)
        return Skill(
            name=f"B{action}",
            kind="stay" if action == 0 else "swing",
            agents=("base",),
            precondition=Condition(none, off_bench),
            outcomes=() if cases else (Outcome(1.0, none, none),),
            cost=ConstantCost(1.0),
            duration_s=duration_s,
            parameters={"action": f"B{action}"},
            cases=tuple(cases),
        )
