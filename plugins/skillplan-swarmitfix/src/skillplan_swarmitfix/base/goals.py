"""Positions that serve the path between two supports: Eqs 1 to 4, and the arm's true reach.

Veeramani and Muthuswamy 2022, section 4.1.2, Fig. 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.pkm.reach import ReachableCentres
from skillplan_swarmitfix.trajectory.path_elements import Point2, shown

# Of Eq. 3, relative to the quadrilateral: areas are sums of products, and a centroid on its
# border must not depend on how they round.
_AREA_TOLERANCE = 1e-9
_DISTANCE_TOLERANCE_M = 1e-9


@dataclass(frozen=True, slots=True)
class ReachRules:
    """Rules for the position of a base.

    Parameters
    ----------
    arm_length_m
        l_arm of Eqs 1 and 2, > 0 [m].
    safe_distance_m
        s_d of Eq. 4, least distance of a base and a support, >= 0 [m].
    reach_m
        Least and greatest horizontal distance of base and head that the arm allows [m].
    side
        The side of the trajectory on which bases stand: +1 left of the direction of travel, -1
        right of it.

    Raises
    ------
    ValueError
        If a figure is out of its range or not finite.
    """

    arm_length_m: float
    safe_distance_m: float
    reach_m: tuple[float, float]
    side: int

    def __post_init__(self) -> None:
        if not 0 < self.arm_length_m < math.inf:
            raise ValueError(
                f"ReachRules arm_length_m must be finite and > 0, not {self.arm_length_m}."
            )
        if not 0 <= self.safe_distance_m < math.inf:
            raise ValueError(
                f"ReachRules safe_distance_m must be finite and >= 0, not {self.safe_distance_m}."
            )
        least_m, most_m = self.reach_m
        if not 0 <= least_m < most_m < math.inf:
            raise ValueError(
                f"ReachRules reach_m must be finite and rise from 0, not {least_m, most_m}."
            )
        if self.side not in (1, -1):
            raise ValueError(f"ReachRules side must be 1 or -1, not {self.side}.")


def inward_side(clockwise: bool) -> int:
    """Return the side on which the inside of a closed trajectory is: -1, right, if clockwise."""
    return -1 if clockwise else 1


def quadrilateral(e1: Point2, e2: Point2, arm_length_m: float, side: int) -> NDArray[np.float64]:
    """Return the corners e1, e2, e3, e4 of Eqs 1 and 2, shape (4, 2) [m].

    The paper's beta is taken to be the direction from e1 to e2, turned a right angle to the side
    of the bases: for a closed trajectory the inward normal.

    Raises
    ------
    ValueError
        If e1 and e2 are one point.
    """
    if e1 == e2:
        raise ValueError(f"No direction leads from {shown(e1)} to itself.")
    beta = math.atan2(e2[1] - e1[1], e2[0] - e1[0]) + side * math.pi / 2
    out = (arm_length_m * math.cos(beta), arm_length_m * math.sin(beta))
    e3 = (e2[0] + out[0], e2[1] + out[1])
    e4 = (e1[0] + out[0], e1[1] + out[1])
    return np.array([e1, e2, e3, e4])


def candidates(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> tuple[int, ...]:
    """Return the positions that Eqs 3 and 4 allow, rising.

    The areas of the triangles that a centroid makes with the four sides sum to the area of the
    quadrilateral if it lies inside or on the border, and to more elsewhere.

    Raises
    ------
    ValueError
        If e1 and e2 are one point.
    """
    safe = _safe_from(bench, e1, rules) & _safe_from(bench, e2, rules)
    return _positions(_inside(bench, e1, e2, rules) & safe)


def _inside(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    """Return the positions that Eq. 3 allows, shape (positions,)."""
    corners = quadrilateral(e1, e2, rules.arm_length_m, rules.side)
    points = bench.centroids_m
    sides = np.roll(corners, -1, axis=0) - corners
    from_corners = points[:, None] - corners
    triangles: NDArray[np.float64] = np.abs(_cross(sides, from_corners)).sum(axis=1) / 2
    area = abs(float(_cross(sides[0], sides[1])))
    inside: NDArray[np.bool_] = triangles <= area * (1 + _AREA_TOLERANCE)
    return inside


def _safe_from(bench: Bench, support: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    """Return the positions that Eq. 4 allows for one support, shape (positions,)."""
    safe: NDArray[np.bool_] = (
        distances_m(bench, support) >= rules.safe_distance_m - _DISTANCE_TOLERANCE_M
    )
    return safe


EQ3, SIDE, EQ4_NEXT = "Eq. 3", "side", "Eq. 4 of the next support"
"""Rules that a position within the machine's reach may break."""


def broken_rules(
    bench: Bench, e1: Point2, e2: Point2, rules: ReachRules, *, last: bool = False
) -> dict[str, NDArray[np.bool_]]:
    """Return the positions that break each rule, shape (positions,) each.

    Parameters
    ----------
    bench
        The lattice.
    e1, e2
        The support that is held and the next one [m]. If `last`, the one before and the last
        support, which is held and has no next one.
    rules
        Rules of the file.
    last
        True to require `e2`.
    """
    everywhere = np.ones(bench.n_positions, dtype=np.bool_)
    return {
        EQ3: everywhere if e1 == e2 else ~_inside(bench, e1, e2, rules),
        SIDE: ~_on_side(bench, e1, e2, rules),
        EQ4_NEXT: ~everywhere if last else ~_safe_from(bench, e2, rules),
    }


def within_reach(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> tuple[int, ...]:
    """Return the positions from which the arm truly reaches both supports, rising.

    The base turns the arm to any side, so that only the distance counts. Positions on the side of
    the bases are preferred: others are returned only where there are none of those.
    """
    reachable = _reaching(bench, e1, e2, rules)
    preferred = reachable & _on_side(bench, e1, e2, rules)
    return _positions(preferred if preferred.any() else reachable)


def on_the_other_side(
    bench: Bench, e1: Point2, e2: Point2, rules: ReachRules, positions: Sequence[int]
) -> bool:
    """Return whether all given positions lie beyond the trajectory, on the forbidden side.

    Parameters
    ----------
    bench
        The lattice.
    e1, e2
        Two consecutive supports [m].
    rules
        With the side of the trajectory on which bases stand.
    positions
        Their numbers.
    """
    return not _on_side(bench, e1, e2, rules)[list(positions)].any()


def _reaching(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    reached = np.ones(bench.n_positions, dtype=np.bool_)
    for point in (e1, e2):
        reached &= in_reach(distances_m(bench, point), rules)
    return reached


def _on_side(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    normal = (-(e2[1] - e1[1]) * rules.side, (e2[0] - e1[0]) * rules.side)
    side: NDArray[np.bool_] = (bench.centroids_m - np.array(e1)) @ np.array(normal) >= 0
    return side


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    product: NDArray[np.float64] = a[..., 0] * b[..., 1]
    product -= a[..., 1] * b[..., 0]
    return product


def distances_m(bench: Bench, point: Point2) -> NDArray[np.float64]:
    """Compute the distance of every position's centroid from a point, shape (positions,) [m]."""
    offsets = bench.centroids_m - np.array(point)
    away_m: NDArray[np.float64] = np.hypot(offsets[:, 0], offsets[:, 1])
    return away_m


def in_reach(away_m: NDArray[np.float64], rules: ReachRules) -> NDArray[np.bool_]:
    """Return a mask of the distances [m] within the arm's true reach, shape as given."""
    least_m, most_m = rules.reach_m
    near = away_m <= most_m + _DISTANCE_TOLERANCE_M
    return near & (away_m >= least_m - _DISTANCE_TOLERANCE_M)


def _positions(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(np.flatnonzero(mask).tolist())


__all__ = [
    "MOST_SPLITS",
    "GoalSet",
    "How",
    "MachineReach",
    "PathBetween",
    "ReachRules",
    "UnreachableSupport",
    "candidates",
    "goal_sets",
    "inward_side",
    "last_goal_set",
    "preferring",
    "quadrilateral",
    "unreachable",
    "within_reach",
]

MOST_SPLITS = 6
"""The path between two supports is halved at most so often in a row."""

PathBetween = Callable[[int, float], Point2]

# Rules that may be broken within the machine's reach, one list after the other until a position is
# left.
_DROPPED: tuple[tuple[str, ...], ...] = ((), (EQ3,), (EQ3, SIDE))
_ALL_DROPPED = (EQ3, SIDE, EQ4_NEXT)


class How(StrEnum):
    """By which rule the positions of a goal set were found."""

    EQ34 = "eq34"
    """Eqs 3 and 4 of the paper."""
    RELAXED = "relaxed"
    """Eqs 3 and 4 leave none; these are within the arm's true reach of both supports. If the
    machine must reach every support: these are within its reach and break a rule."""
    SPLIT = "split"
    """Neither gives any for the whole path; it was halved, and this is a part of it."""


@dataclass(frozen=True, slots=True)
class GoalSet:
    """The positions from which a base serves the path between two supports.

    Parameters
    ----------
    index
        The pair of supports, from 0: support `index` and the next. Parts of a split pair have
        the same.
    e1, e2
        Start and end of the path, or of the part of it [m].
    positions
        At least one, rising.
    how
        By which rule they were found.
    note
        Relaxation or split in words; empty for Eqs 3 and 4.
    centre
        Centre of the quadrilateral e1, e2, e3, e4 [m].
    broken
        Rules that a position breaks, by its number; of sets that are limited to the machine's
        reach only.

    Raises
    ------
    ValueError
        If no position is given.
    """

    index: int
    e1: Point2
    e2: Point2
    positions: tuple[int, ...]
    how: How
    note: str
    centre: Point2
    broken: Mapping[int, tuple[str, ...]] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.positions:
            raise ValueError(f"GoalSet {self.index} needs at least one position.")

    def how_of(self, position: int) -> How:
        """Return the rule by which one of the positions belongs to the set."""
        return How.RELAXED if self.how is How.EQ34 and self.broken.get(position) else self.how

    def note_of(self, position: int) -> str:
        """Return the note, and the rules that one of the positions breaks."""
        broken = self.broken.get(position, ())
        words = f"{', '.join(broken)} dropped" if broken else ""
        return "; ".join(filter(None, (self.note, words)))


@dataclass(frozen=True, slots=True)
class MachineReach:
    """The machine must reach every support from the position that serves it.

    Parameters
    ----------
    centres
        Reach of every position.
    relax_always
        True if every support may drop Eq. 3, the side, and Eq. 4 of the next support. Otherwise
        only supports without a position may.
    """

    centres: ReachableCentres
    relax_always: bool = False


class UnreachableSupport(ValueError):
    """No position of the bench serves the path between two supports.

    Attributes
    ----------
    index
        The pair, from 0.
    """

    def __init__(self, index: int, message: str) -> None:
        super().__init__(message)
        self.index = index

    def __reduce__(self) -> tuple[type[UnreachableSupport], tuple[int, str]]:
        return UnreachableSupport, (self.index, str(self))


def goal_sets(
    bench: Bench,
    supports: Sequence[Point2],
    rules: ReachRules,
    closed: bool,
    path: PathBetween | None = None,
    machine: MachineReach | None = None,
) -> tuple[GoalSet, ...]:
    """Return the positions for every two consecutive supports, in order along the trajectory.

    If Eqs 3 and 4 leave none, the positions within the arm's true reach of both supports
    are used. If there are none either, the path is halved with a support in its middle, and
    each half is served like any other, as often as `MOST_SPLITS`.

    Parameters
    ----------
    bench
        The lattice.
    supports
        Centres of the heads in order along the trajectory [m].
    rules
        Rules for the position of a base.
    closed
        True to pair the last support with the first.
    path
        Gives the point that is a share in [0, 1] of the path from a support, by its number from
        0, to the next; by default on the straight line.
    machine
        Reach that every position must have; None to leave it unchecked.

    Returns
    -------
    tuple
        One set per pair, several for a split pair.

    Raises
    ------
    UnreachableSupport
        If a pair cannot be served.
    """
    return tuple(
        part
        for index, e1, e2 in _pairs(supports, closed)
        for part in _Pair(
            bench, rules, index, _path(path, index, e1, e2), len(supports), machine
        ).sets()
    )


def last_goal_set(
    bench: Bench, rules: ReachRules, before: GoalSet, index: int, machine: MachineReach | None
) -> GoalSet:
    """Return the positions that hold the last support of an open trajectory.

    It has no next support: the positions of the set before hold it as well, unless the machine
    must reach it.

    Parameters
    ----------
    bench, rules, machine
        As in `goal_sets`.
    before
        The set of the path that leads to it.
    index
        Number of the last support, from 0.

    Raises
    ------
    UnreachableSupport
        If the machine reaches it from no position.
    """
    if machine is None:
        return replace(before, index=index, e1=before.e2, e2=before.e2)
    pair = _Pair(bench, rules, index, _path(None, index, before.e1, before.e2), index + 1, machine)
    return pair.last()


def preferring(goal_set: GoalSet, centres: ReachableCentres) -> GoalSet:
    """Return a goal set without the positions from which its support is out of reach.

    If that would leave none, the set stays as it is.

    Parameters
    ----------
    one
        The set; its support is `e1`.
    centres
        Reach of every position.
    """
    reached = set(centres.positions(goal_set.e1).tolist())
    kept = tuple(p for p in goal_set.positions if p in reached)
    return replace(goal_set, positions=kept) if kept else goal_set


def unreachable(
    bench: Bench,
    supports: Sequence[Point2],
    rules: ReachRules,
    closed: bool,
    path: PathBetween | None = None,
) -> tuple[UnreachableSupport, ...]:
    """List the faults of every pair that `goal_sets` cannot serve.

    Parameters
    ----------
    bench, supports, rules, closed
        As in `goal_sets`.
    path
        As its `path`.
    """
    faults = []
    for index, e1, e2 in _pairs(supports, closed):
        try:
            _Pair(bench, rules, index, _path(path, index, e1, e2), len(supports)).sets()
        except UnreachableSupport as error:
            faults.append(error)
    return tuple(faults)


def _pairs(supports: Sequence[Point2], closed: bool) -> Iterator[tuple[int, Point2, Point2]]:
    for index in range(len(supports) - (not closed)):
        yield index, supports[index], supports[(index + 1) % len(supports)]


def _path(
    path: PathBetween | None, index: int, e1: Point2, e2: Point2
) -> Callable[[float], Point2]:
    """Return the point at a share of the path between two supports."""

    def point(share: float) -> Point2:
        if share in (0.0, 1.0) or path is None:
            return ((1 - share) * e1[0] + share * e2[0], (1 - share) * e1[1] + share * e2[1])
        return path(index, share)

    return point


@dataclass(frozen=True)
class _Pair:
    """Two consecutive supports and the path between them."""

    bench: Bench
    rules: ReachRules
    index: int
    path: Callable[[float], Point2]
    n_supports: int
    machine: MachineReach | None = None

    @property
    def label(self) -> str:
        return f"supports {self.index + 1} and {(self.index + 1) % self.n_supports + 1}"

    def sets(self) -> list[GoalSet]:
        goal_set = self._served(0.0, 1.0)
        if goal_set is not None:
            return [goal_set]
        try:
            return self._halves(0.0, 1.0, 1)
        except UnreachableSupport:
            # The position that holds this support need not keep clear of the next one, which
            # has a position of its own.
            goal_set = self._reached(0.0, 1.0, _ALL_DROPPED)
            if goal_set is None:
                raise
            return [goal_set]

    def last(self) -> GoalSet:
        """Return the set of the support at the end of the path."""
        goal_set = self._first_reached(0.0, 1.0, last=True)
        if goal_set is None:
            raise UnreachableSupport(self.index, self._fault(1.0, 1.0))
        return goal_set

    def _first_reached(self, begin: float, end: float, *, last: bool = False) -> GoalSet | None:
        """Return the set that breaks the fewest rules; None if there is none."""
        always = self.machine is not None and self.machine.relax_always
        for dropped in (_ALL_DROPPED,) if always else _DROPPED:
            goal_set = self._reached(begin, end, dropped, last=last)
            if goal_set is not None:
                return goal_set
        return None

    def _reached(
        self, begin: float, end: float, dropped: tuple[str, ...], *, last: bool = False
    ) -> GoalSet | None:
        """Return the positions within the machine's reach that break no more than some rules."""
        if self.machine is None:
            return None
        e1, e2 = self.path(begin), self.path(end)
        support = e2 if last else e1
        masks = broken_rules(self.bench, e1, e2, self.rules, last=last)
        broken = {
            p: tuple(name for name, mask in masks.items() if mask[p])
            for p in self.machine.centres.positions(support).tolist()
        }
        kept = {p: names for p, names in broken.items() if set(names) <= set(dropped)}
        if not kept:
            return None
        whole = end - begin == 1
        how = How.RELAXED if all(kept.values()) else How.EQ34
        how = how if whole else How.SPLIT
        note = "" if whole else f"{begin:.4g} to {end:.4g} of the way between {self.label}"
        ends = (e2, e2) if last else (e1, e2)
        centre = self._centre(e1, e2)
        return GoalSet(self.index, *ends, tuple(kept), how, note, centre, kept)

    def _centre(self, e1: Point2, e2: Point2) -> Point2:
        """Return the centre of the quadrilateral [m]."""
        rules = self.rules
        corners = (
            np.array([e1]) if e1 == e2 else quadrilateral(e1, e2, rules.arm_length_m, rules.side)
        )
        x_m, y_m = corners.mean(axis=0).tolist()
        return x_m, y_m

    def _served(self, begin: float, end: float) -> GoalSet | None:
        """Return the set of a part of the path without splitting it; None if it is empty."""
        if self.machine is not None:
            return self._first_reached(begin, end)
        e1, e2, rules = self.path(begin), self.path(end), self.rules
        positions = () if e1 == e2 else candidates(self.bench, e1, e2, rules)
        whole = end - begin == 1
        how, notes = How.EQ34, []
        if not whole:
            how = How.SPLIT
            notes.append(f"{begin:.4g} to {end:.4g} of the way between {self.label}")
        if not positions:
            positions = within_reach(self.bench, e1, e2, rules)
            how = How.RELAXED if whole else How.SPLIT
            least_m, most_m = rules.reach_m
            notes.append(
                f"Eqs 3 and 4 leave no position; taken are those {least_m:g} to {most_m:g} m "
                f"from both ends"
            )
            if positions and on_the_other_side(self.bench, e1, e2, rules, positions):
                notes.append("on the other side of the trajectory")
        if not positions:
            return None
        centre = self._centre(e1, e2)
        return GoalSet(self.index, e1, e2, positions, how, "; ".join(notes), centre)

    def _halves(self, begin: float, end: float, depth: int) -> list[GoalSet]:
        if depth > MOST_SPLITS:
            raise UnreachableSupport(self.index, self._fault(begin, end))
        middle = (begin + end) / 2
        halves = []
        for low, high in ((begin, middle), (middle, end)):
            served = self._served(low, high)
            halves += self._halves(low, high, depth + 1) if served is None else [served]
        return halves

    def _fault(self, begin: float, end: float) -> str:
        """Describe the fault of a part of the path that cannot be split further."""
        least_m, most_m = self.rules.reach_m
        need = f"the arm needs {least_m:g} to {most_m:g} m"
        # A fault at a support is clearer than one at a point of a path split because of it.
        for share in (0.0, 1.0, begin, end):
            point = self.path(share)
            away_m = distances_m(self.bench, point)
            if not in_reach(away_m, self.rules).any():
                nearest = int(np.maximum(least_m - away_m, away_m - most_m).argmin())
                return (
                    f"Between {self.label} no position of the bench reaches {shown(point)}: "
                    f"{self.bench.name(nearest)} comes nearest, {away_m[nearest]:.3f} m "
                    f"away, and {need}. Move the trajectory, or enlarge the bench."
                )
        return (
            f"Between {self.label} no position of the bench reaches both "
            f"{shown(self.path(begin))} and {shown(self.path(end))}; {need}. Move the "
            "trajectory, or enlarge the bench."
        )
