"""What one simulated execution of a skill left behind: what the verdicts are about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.task.scene import Pose
from skillplan.task.state import State

# Contacts are logged so many times a simulated second, as in the paper (section 4.3).
FRAMES_PER_S = 60

Pair = tuple[str, str]


@dataclass(frozen=True)
class Record:
    """One execution, sampled 60 times a simulated second.

    Parameters
    ----------
    skill
        Its name.
    present, absent
        The facts that decide what is in the simulated world, by their truth: the execution is
        the same, bit for bit, in every state that agrees on them.
    phases
        What the robot was at, and the frame at which it began, in order, such as
        ``(12, "the approach to switch_1")``.
    forces_n
        Net contact force on every body in the world [N], shape (frames, 3), as the simulator
        gives it: a part at rest shows its weight upwards.
    weights_n
        Weight of every such body [N].
    pairs_n
        Normal force of every pair that touched without being expected to [N], shape (frames,).
        Expected are: pairs that touch when the skill begins, the hand and what it handles, and
        what was released or is driven and anything.
    moved_m
        How far every body that the skill does not handle is from where it stood [m], shape
        (frames,).
    final
        Where every body came to rest.
    expected
        Where the prediction has it.
    sensed
        What the robot's sensors say in the end, as JSON values: ``tool_attached``,
        ``coupling_error_m``, ``fastening_force_n``, ``insertion_force_n``, ``jaw_width_m``,
        ``tip_error_m``, as far as the skill has to do with it, and ``stuck_on`` where the arm was
        stopped.
    unreachable
        Why the arm cannot follow the motion, in words; None where it can.
    upset
        Why the execution says nothing: the simulation blew up or took too long, or no way was
        found in time; None where it does.
    unsettled
        Why the world itself could not be, before the robot moved, such as a part without a
        support; None where it stood.
    travels
        Travels that go round something, as JSON values.
    steps
        Simulation steps.
    begin_s
        Simulated time of the first frame [s]: zero for a skill executed by itself, later for one
        of a whole plan.
    pauses
        Dwells at rest, as the number of the frame after it and its length [s].
    beside
        Pairs of ``pairs_n`` that first touched by their sides: across the way of what is handled.
    """

    skill: str
    present: State
    absent: State
    phases: tuple[tuple[int, str], ...]
    forces_n: Mapping[str, NDArray[np.float64]]
    weights_n: Mapping[str, float]
    pairs_n: Mapping[Pair, NDArray[np.float64]]
    moved_m: Mapping[str, NDArray[np.float64]]
    final: Mapping[str, Pose]
    expected: Mapping[str, Pose]
    sensed: Mapping[str, Any] = field(default_factory=dict)
    unreachable: str | None = None
    upset: str | None = None
    unsettled: str | None = None
    travels: tuple[Mapping[str, Any], ...] = ()
    steps: int = 0
    begin_s: float = 0.0
    pauses: tuple[tuple[int, float], ...] = ()
    beside: frozenset[Pair] = frozenset()

    def time_s(self, frame: int) -> float:
        """Return the simulated time of a frame [s]."""
        paused_s = sum(length_s for after, length_s in self.pauses if after <= frame)
        return self.begin_s + frame / FRAMES_PER_S + paused_s

    def phase(self, frame: int) -> str:
        """Return what the robot was at in a frame; empty before it began."""
        label = ""
        for begin, name in self.phases:
            if begin > frame:
                break
            label = name
        return label
