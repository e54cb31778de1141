"""Choice of the goal position among the positions that serve a support.

The paper leaves open which candidate of Eqs 3 and 4 is the goal. Two rules look no further than
the next goal; the default minimises the swings of the whole trajectory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.base.goals import GoalSet
from skillplan_swarmitfix.bench.bench import Bench

# Above the time of any path round a bench [us]: 12 days.
_STEP = 1 << 40


class GoalRule(StrEnum):
    """Rule for choosing goals; ties go to the position with the lowest number."""

    WHOLE_TRAJECTORY = "whole-trajectory"
    """Fewest swings in all; then least swing time; then nearest to the quadrilaterals' centres."""
    FEWEST_STEPS = "fewest-steps"
    """Fewest swings from where the base stands; then nearest to the quadrilateral's centre."""
    NEAREST_CENTROID = "nearest-centroid"
    """Nearest as the crow flies; then fewest swings; then nearest to the quadrilateral's centre."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The goals of a base.

    Parameters
    ----------
    goals
        Positions, one for each goal set.
    steps
        Fewest swings to each from the one before.
    duration_s
        Least time of that many swings, for all goals together [s].
    rule
        Rule of the choice.
    """

    goals: tuple[int, ...]
    steps: tuple[int, ...]
    duration_s: float
    rule: GoalRule

    @property
    def total_steps(self) -> int:
        """Swings for all goals together."""
        return sum(self.steps)


class LeastSwings:
    """Fewest swings to a goal, and the least time of that many swings.

    Parameters
    ----------
    bench
        The lattice.
    swing_s
        Time of a swing [s], >= 0, by its angle [deg].

    Raises
    ------
    ValueError
        If the time of a swing of the bench is not given.
    """

    def __init__(self, bench: Bench, swing_s: Mapping[int, float]) -> None:
        self._bench = bench
        self._times_us = np.zeros(bench.swing_deg.shape, dtype=np.int64)
        for angle_deg in np.unique(bench.swing_deg[bench.swing_deg > 0]).tolist():
            if angle_deg not in swing_s:
                raise ValueError(f"No time is given for a swing of {angle_deg} degrees.")
            self._times_us[bench.swing_deg == angle_deg] = round(swing_s[angle_deg] * 1e6)
        self._known: dict[int, tuple[NDArray[np.int64], NDArray[np.int64]]] = {}

    def to(self, goal: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the swings and their time [us] from every position, shape (positions,) each."""
        if goal not in self._known:
            steps = self._bench.distances(goal).astype(np.int64)
            self._known[goal] = steps, self._least_times(steps)
        return self._known[goal]

    def _least_times(self, steps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the least times of the shortest paths, ring by ring around the goal."""
        times_us = np.zeros_like(steps)
        rings = np.argsort(steps, kind="stable")
        bounds = np.cumsum(np.bincount(steps))
        for near, far in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            ring = rings[near:far]
            after = self._bench.successors[ring]
            nearer = (after >= 0) & (steps[after] == steps[ring][:, None] - 1)
            ways_us = self._times_us[ring] + times_us[after]
            times_us[ring] = np.where(nearer, ways_us, np.iinfo(np.int64).max).min(axis=1)
        return times_us


def choose(
    bench: Bench,
    home: int,
    sets: Sequence[GoalSet],
    rule: GoalRule | str,
    swing_s: Mapping[int, float],
) -> Choice:
    """Choose a goal from every set.

    Parameters
    ----------
    bench
        The lattice.
    home
        Position at the start.
    sets
        In the order in which they are served.
    rule
        Rule of the choice.
    swing_s
        Time of a swing [s] by its angle [deg].

    Raises
    ------
    ValueError
        If there is no such rule, or the time of a swing is not given.
    """
    rule = GoalRule(rule)
    least_swings = LeastSwings(bench, swing_s)
    if rule is GoalRule.WHOLE_TRAJECTORY:
        goals = _over_all(bench, home, sets, least_swings)
    else:
        goals, here = [], home
        for goal_set in sets:
            here = _next_goal(bench, here, goal_set, least_swings, rule)
            goals.append(here)
    steps, time_us, here = [], 0, home
    for goal in goals:
        all_steps, all_times_us = least_swings.to(goal)
        steps.append(int(all_steps[here]))
        time_us += int(all_times_us[here])
        here = goal
    return Choice(tuple(goals), tuple(steps), time_us / 1e6, rule)


def _next_goal(
    bench: Bench, here: int, goal_set: GoalSet, least_swings: LeastSwings, rule: GoalRule
) -> int:
    """Return the goal of a rule that looks no further than the next."""
    ranked = []
    for position, offset_nm in zip(
        goal_set.positions, _offsets_nm(bench, goal_set).tolist(), strict=True
    ):
        swings = int(least_swings.to(position)[0][here])
        flight_m = 0.0
        if rule is GoalRule.NEAREST_CENTROID:
            flight_m = math.dist(bench.centroids_m[here], bench.centroids_m[position])
        ranked.append((round(flight_m * 1e9), swings, offset_nm, position))
    return min(ranked)[-1]


def _over_all(
    bench: Bench, home: int, sets: Sequence[GoalSet], least_swings: LeastSwings
) -> list[int]:
    """Return the goals that are best over all sets, by dynamic programming from the home."""
    before = np.array([home])
    weights = np.zeros(1, dtype=np.int64)
    offsets = np.zeros(1, dtype=np.int64)
    came_from: list[NDArray[np.intp]] = []
    for goal_set in sets:
        arrows = np.empty((len(before), len(goal_set.positions)), dtype=np.int64)
        for i, position in enumerate(goal_set.positions):
            steps, times_us = least_swings.to(position)
            arrows[:, i] = steps[before] * _STEP + times_us[before]
        # Shape (before, here); of equal weights the least offset, then the first.
        through = weights[:, None] + arrows
        weights = through.min(axis=0)
        ties = np.where(through == weights, offsets[:, None], np.iinfo(np.int64).max)
        came_from.append(ties.argmin(axis=0))
        offsets = ties.min(axis=0) + _offsets_nm(bench, goal_set)
        before = np.array(goal_set.positions)
    at = int(np.lexsort((offsets, weights))[0])
    goals = []
    for goal_set, origins in zip(reversed(sets), reversed(came_from), strict=True):
        goals.append(goal_set.positions[at])
        at = int(origins[at])
    return goals[::-1]


def _offsets_nm(bench: Bench, goal_set: GoalSet) -> NDArray[np.int64]:
    """Compute each position's distance from the quadrilateral's centre, in whole nanometres."""
    offsets = bench.centroids_m[list(goal_set.positions)] - np.array(goal_set.centre)
    away_nm: NDArray[np.float64] = 1e9 * np.hypot(offsets[:, 0], offsets[:, 1])
    return np.rint(away_nm).astype(np.int64)
