"""A way between two postures by RRT-Connect (Kuffner and LaValle, 2000), in OMPL's version.

The same question has the same answer, to the bit, in every process and whatever was asked before:
random numbers start anew at a fixed seed, and the end is counted in postures checked, not in time.
"""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_pinocchio.planning.moving_solids import Vector

# How far apart postures of an edge are checked, and how far a tree grows at once: in metres, by
# what a joint moves the arm's end at most.
SPACING_M: Final = 0.03
_RANGE_M: Final = 0.5


@dataclass(frozen=True)
class JointSpace:
    """In which ways are looked for.

    Parameters
    ----------
    low_rad, high_rad
        Limits of the joints, shape (joints,).
    reach_m
        How far from its axis a joint moves anything at most, > 0, shape (joints,): the weight of
        the joint in a distance.
    """

    low_rad: Vector
    high_rad: Vector
    reach_m: Vector

    def length_m(self, one_rad: Vector, other_rad: Vector) -> float:
        """Return how far apart two postures are [m]."""
        return length((other_rad - one_rad) * self.reach_m)

    def edge_is_free(
        self, is_free: Callable[[Vector], bool], one_rad: Vector, other_rad: Vector
    ) -> bool:
        """Whether no posture on a straight edge, `SPACING_M` apart, is blocked."""
        count = max(int(np.ceil(self.length_m(one_rad, other_rad) / SPACING_M)), 1)
        shares = np.arange(1, count) / count
        # From the middle outwards: what is nearer to the ends is likelier to be free.
        ordered = sorted(shares.tolist(), key=lambda share: (abs(share - 0.5), share))
        turn_rad = other_rad - one_rad
        return all(is_free(one_rad + share * turn_rad) for share in ordered)


def connection(
    space: JointSpace,
    is_free: Callable[[Vector], bool],
    ends_rad: tuple[Vector, Vector],
    seed: int,
    most_checks: int,
) -> tuple[list[Vector] | None, int]:
    """Return postures that lead from one to another along straight edges, and the checks made.

    Parameters
    ----------
    space
        The joints.
    is_free
        Says of a posture whether it is.
    ends_rad
        Two free postures.
    seed
        Of the random numbers, >= 1.
    most_checks
        After so many postures checked it gives up, and there is None.
    """
    base, geometric, util = _ompl()
    joints = len(space.reach_m)
    count = 0

    def checked(state: Any) -> bool:
        nonlocal count
        count += 1
        return is_free(np.array([state[joint] for joint in range(joints)]) / space.reach_m)

    util.RNG.setSeed(seed)
    states = base.RealVectorStateSpace(joints)
    bounds = base.RealVectorBounds(joints)
    for joint in range(joints):
        bounds.setLow(joint, float(space.low_rad[joint] * space.reach_m[joint]))
        bounds.setHigh(joint, float(space.high_rad[joint] * space.reach_m[joint]))
    states.setBounds(bounds)
    information = base.SpaceInformation(states)
    information.setStateValidityChecker(checked)
    information.setStateValidityCheckingResolution(SPACING_M / states.getMaximumExtent())
    information.setup()
    ends = []
    for end_rad in ends_rad:
        state = states.allocState()
        for joint in range(joints):
            state[joint] = float(end_rad[joint] * space.reach_m[joint])
        ends.append(state)
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setRange(_RANGE_M)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: count >= most_checks))
    if not problem.hasExactSolution():
        return None, count
    inner = problem.getSolutionPath().getStates()[1:-1]
    nodes = [np.array([state[joint] for joint in range(joints)]) / space.reach_m for state in inner]
    return [ends_rad[0], *nodes, ends_rad[1]], count


@cache
def _ompl() -> tuple[Any, Any, Any]:
    """Return OMPL's modules; only who plans needs them."""
    from ompl import base, geometric, util

    # It would print what is said better by what is returned.
    util.setLogLevel(util.LogLevel.LOG_NONE)
    atexit.register(_end_in_silence)
    return base, geometric, util


def _end_in_silence() -> None:
    """Have what OMPL's bindings print of leaks, once all else has ended, go nowhere."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.flush()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
