"""From base policies to the timed five-step locomotion between supports.

Between two supports the head is retracted, the PKM parks, the base swings while the PKM turns
against it, the head approaches the next support and supports it (Veeramani and Muthuswamy 2022,
section 3). The paths of the base are those of `base_path`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from skillplan_swarmitfix.base.path import BasePath, BaseStep
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.bench.step_timings import Timings
from skillplan_swarmitfix.bench.swings import Direction


class FiveStep(StrEnum):
    """The transitions between two supports, in their order; the third once a swing."""

    RETRACT = "retract"
    PARK = "park"
    SWING = "swing"
    APPROACH = "approach"
    SUPPORT = "support"


class Agent(StrEnum):
    """What moves: the head, the PKM that carries it, the base that carries both."""

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
        Clockwise or counter-clockwise, as the bench says it.
    angle_deg
        Of the swing [deg], > 0.
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
        Which of the five.
    start_s, end_s
        From the start of the whole [s].
    base
        Name of the position in which the base stands at the end.
    support_m
        Where the head is led to (x, y) [m]: of approach and support only.
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
        """Who is busy: base and PKM in a swing, else head and PKM."""
        first = Agent.BASE if self.step is FiveStep.SWING else Agent.HEAD
        return first, Agent.PKM

    @property
    def duration_s(self) -> float:
        """How long it takes [s]."""
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
        What the swings take of that [s].
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

    Where the base stays, the PKM alone repositions the head: retract, approach, support. There
    is nothing to park for, as the base does not move.

    Parameters
    ----------
    bench
        The lattice.
    sequences
        The base's path to each goal position, as from `along`; empty where the base stays.
    supports_m
        Where the head supports the sheet after each of them (x, y) [m].
    timings
        Durations; those of the real machine by default.
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
            f"B{action} in {bench.name(before)} {really}; the path says it leads to "
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
