"""The record of one simulated execution of a skill, from which verdicts follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.task.scene import Pose
from skillplan.task.state import State

# Frames of the contact log per simulated second, as in the paper (section 4.3).
FRAMES_PER_S = 60

Pair = tuple[str, str]


@dataclass(frozen=True)
class Record:
    """One execution, sampled 60 times a simulated second.

    Parameters
    ----------
    present, absent
        Facts that decide the bodies in the simulated world, by their truth: the execution is the
        same, bit for bit, in every state that agrees on them.
    phases
        Start frame and label of every phase in order, such as ``(12, "the approach to switch_1")``.
    forces_n
        Net contact force on every body in the world [N], shape (frames, 3), as the simulator
        returns it: a part at rest shows its weight upwards.
    weights_n
        Weights of these bodies [N].
    pairs_n
        Normal force of every pair that touched unexpectedly [N], shape (frames,). Expected are
        pairs that touch when the skill begins, the hand with its part, and any contact of released
        or driven parts.
    moved_m
        Displacement of every body that the skill does not handle [m], shape (frames,).
    final
        Final pose of every body; without the spin of a body of revolution about its axis since its
        expected pose.
    sensed
        Final sensor values as JSON values: ``tool_attached``, ``coupling_error_m``,
        ``fastening_force_n``, ``insertion_force_n``, ``jaw_width_m``, ``tip_error_m``, as far as
        the skill involves them; ``stuck_on`` if the arm was stopped; ``in_zone``, a clause, and
        ``in_zone_frame`` if something entered a keep-out zone.
    unreachable
        Reason why the arm cannot follow the motion, or None.
    upset
        Reason why the execution is inconclusive: the simulation blew up or took too long, or no
        path was found in time; or None.
    unsettled
        Reason why the world was not at rest before the robot moved, such as a part without a
        support; or None.
    travels
        Travels around obstacles, as JSON values.
    begin_s
        Simulated time of the first frame [s]: zero for a single skill, later within a plan.
    pauses
        Dwells at rest, as the number of the next frame and the duration [s].
    beside
        Pairs of ``pairs_n`` whose first contact was sideways to the motion of the handled part.
    carried
        Goals of a placed part on each body that it touches, as that body stands.
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
    carried: tuple[Pose, ...] = ()

    def time_s(self, frame: int) -> float:
        """Return the simulated time of a frame [s]."""
        paused_s = sum(length_s for after, length_s in self.pauses if after <= frame)
        return self.begin_s + frame / FRAMES_PER_S + paused_s

    def phase(self, frame: int) -> str:
        """Return the phase in a frame; empty before the first."""
        label = ""
        for begin, name in self.phases:
            if begin > frame:
                break
            label = name
        return label
