"""Costs of skills, which may depend on the state.

A cost has a value in each state (:meth:`Cost.at`), and a lower bound over all states in which some
facts are known (:meth:`Cost.least`), from which solvers build admissible bounds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, runtime_checkable

from skillplan.task.motion import Motion, Point, Visit
from skillplan.task.state import State
from skillplan.task.zone import SlowTravel


@runtime_checkable
class Cost(Protocol):
    """A non-negative value of a skill in a state."""

    def at(self, state: State) -> float:
        """Return the value in `state`, >= 0."""

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return a lower bound over the states with these facts known true and false."""


class DerivedCost:
    """A cost that is calculated from another one and depends on no further facts."""

    __slots__ = ()
    cost: Cost


@dataclass(frozen=True, slots=True)
class ConstantCost:
    """A cost that is equal in all states."""

    value: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.value) and self.value >= 0):
            raise ValueError(f"Cost must be finite and >= 0, not {self.value}.")

    def at(self, state: State) -> float:
        """Return the value."""
        return self.value

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return the value."""
        return self.value


@dataclass(frozen=True)
class CaseCost:
    """A cost that depends on which of some facts holds, such as the time of a swing by position.

    Parameters
    ----------
    values
        Values, >= 0, by the bit of the fact; at most one of these facts holds at a time.
    """

    values: Mapping[int, float] = field(hash=False)
    _mask: int = field(init=False, repr=False, compare=False)
    _numbers: Mapping[int, tuple[int, float]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.values:
            raise ValueError("CaseCost needs at least one value.")
        for value in self.values.values():
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"Cost must be finite and >= 0, not {value}.")
        object.__setattr__(self, "_mask", sum(self.values))
        # Keyed by the number of the bit: powers of two hash badly, see `State.__hash__`.
        numbers = {bit.bit_length(): (bit, value) for bit, value in self.values.items()}
        object.__setattr__(self, "_numbers", numbers)

    def at(self, state: State) -> float:
        """Return the value of the fact that holds in `state`.

        Raises
        ------
        ValueError
            If not exactly one of the facts holds.
        """
        held = state.bits & self._mask
        bit, value = self._numbers.get(held.bit_length(), (0, 0.0))
        if not held or bit != held:
            raise ValueError(f"No value is given for the state {state}.")
        return value

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return the least value that the known facts allow."""
        known = true_bits & self._mask
        if known:
            return self.values.get(known, math.inf)
        return min(
            (value for bit, value in self.values.items() if not bit & false_bits), default=math.inf
        )


@dataclass(frozen=True)
class DistanceCost:
    """The planar length of a motion from the place of the arm, scaled, with or without dwells.

    The paper's cost of an action (Moller et al., section 4.2): the 2D Cartesian distance from its
    start pose, which is the goal pose of the previous action, to its goal pose.

    Parameters
    ----------
    places
        Positions of the arm [m] by the bit of the fact; shared by all skills of a robot.
    motion
        Motion; its visits are made in order.
    per_m
        Cost per metre, >= 0: 1 for a distance, the inverse of a speed for a time.
    dwells
        True to add the dwells of the visits.
    behind_m
        Distances to places that are not counted yet [m], >= 0, by bit. The next skill counts them,
        such as the path of a grasp that failed.
    slow
        Additional cost of travels through zones with a speed limit; None for no such zone.
    """

    places: Mapping[int, Point] = field(hash=False)
    motion: Motion
    per_m: float = 1.0
    dwells: bool = False
    behind_m: Mapping[int, float] = field(default_factory=dict, hash=False)
    slow: SlowTravel | None = field(default=None, hash=False, compare=False)
    _starts: Mapping[int, tuple[float, float, float]] = field(init=False, repr=False, compare=False)
    _places_mask: int = field(init=False, repr=False, compare=False)
    _routes: tuple[tuple[int, float, float, float, float], ...] = field(
        init=False, repr=False, compare=False
    )
    _slow_s: dict[tuple[float, float, float, float], float] = field(
        init=False, repr=False, compare=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        if not (math.isfinite(self.per_m) and self.per_m >= 0):
            raise ValueError(f"DistanceCost per_m must be finite and >= 0, not {self.per_m}.")
        if not self.places:
            raise ValueError("DistanceCost needs at least one place.")
        for length_m in self.behind_m.values():
            if not (math.isfinite(length_m) and length_m >= 0):
                raise ValueError(f"DistanceCost behind_m must be finite and >= 0, not {length_m}.")
        mask = 0
        for bit in self.places:
            mask |= bit
        starts = {
            bit: (x_m, y_m, self.behind_m.get(bit, 0.0))
            for bit, (x_m, y_m, _) in self.places.items()
        }
        object.__setattr__(self, "_starts", starts)
        routes = []
        for route in self.motion.routes:
            first, beyond, dwell_s = self._measure_route(route.visits)
            routes.append((route.when.bits, first[0], first[1], beyond, dwell_s))
        object.__setattr__(self, "_places_mask", mask)
        object.__setattr__(self, "_routes", tuple(routes))

    def at(self, state: State) -> float:
        """Return the value from the place of the arm in `state`.

        Raises
        ------
        ValueError
            If the state gives no place of the arm, or no route fits.
        """
        bits = state.bits
        start = self._starts.get(bits & self._places_mask)
        if start is None:
            raise ValueError(f"The state gives no place of the arm: {state}.")
        for when, x_m, y_m, beyond_m, dwell_s in self._routes:
            if bits & when == when:
                length_m = math.hypot(x_m - start[0], y_m - start[1]) + beyond_m + start[2]
                slow_s = 0.0 if self.slow is None else self._slow_to(start, x_m, y_m)
                return dwell_s + slow_s + self.per_m * length_m
        raise ValueError(f"No route of {self.motion.robot!r} fits the state {state}.")

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return the least value over all places and routes that the known facts allow."""
        return min(
            (
                dwell_s
                + (0.0 if self.slow is None else self._slow_to(start, x_m, y_m))
                + self.per_m * (math.hypot(x_m - start[0], y_m - start[1]) + beyond_m + start[2])
                for when, x_m, y_m, beyond_m, dwell_s in self._routes
                if not when & false_bits
                for start in self._open_places(true_bits, false_bits)
            ),
            default=math.inf,
        )

    def _measure_route(self, visits: Sequence[Visit]) -> tuple[Point, float, float]:
        """Return the first point of a route, its length from there [m], and a fixed amount.

        A path with a speed of its own counts with its time instead of its length, if time counts.
        """
        times_s = [visit.dwell_s for visit in visits] if self.dwells else []
        beyond_m = slow_s = 0.0
        here: Point | None = None
        for visit in visits:
            is_timed = self.dwells and visit.path_speed_m_per_s is not None
            for number, point in enumerate((*visit.path, visit.position)):
                if here is not None:
                    length_m = compute_planar_distance(here, point)
                    lost_s = 0.0 if self.slow is None else self.slow.cost_s(here, point)
                    if is_timed and number:
                        least_s = visit.measure_leg_s((here, point))
                        times_s.append(max(least_s, self.per_m * length_m + lost_s))
                    else:
                        beyond_m += length_m
                        slow_s += lost_s
                here = point
        first = (*visits[0].path, visits[0].position)[0]
        return first, beyond_m, math.fsum(times_s) + slow_s

    def _slow_to(self, start: tuple[float, float, float], x_m: float, y_m: float) -> float:
        """Return the additional cost from a place to the first visit."""
        assert self.slow is not None
        key = (start[0], start[1], x_m, y_m)
        if key not in self._slow_s:
            self._slow_s[key] = self.slow.cost_s((*key[:2], 0.0), (*key[2:], 0.0))
        return self._slow_s[key]

    def _open_places(self, true_bits: int, false_bits: int) -> Iterator[tuple[float, float, float]]:
        known = true_bits & self._places_mask
        if known:
            if known in self._starts:
                yield self._starts[known]
            return
        for bit, start in self._starts.items():
            if not bit & false_bits:
                yield start


@dataclass(frozen=True)
class WeightedCost:
    """A weighted sum of a path, of a duration, and of a fixed amount.

    Parameters
    ----------
    path_m
        Length of the path [m].
    per_m
        Cost per metre, >= 0.
    duration_s
        Duration [s], unless a back end provides it.
    per_s
        Cost per second, >= 0.
    fixed
        Cost of each execution, such as wear and energy, >= 0.
    """

    path_m: Cost
    per_m: float
    duration_s: Cost
    per_s: float
    fixed: float = 0.0

    def __post_init__(self) -> None:
        for name in ("per_m", "per_s", "fixed"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"WeightedCost {name} must be finite and >= 0, not {value}.")

    def at(self, state: State) -> float:
        """Return the value in `state`, with the duration of the task."""
        return self.price(state, self.duration_s.at(state))

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return a lower bound, with the duration of the task."""
        least_s = self.duration_s.least(true_bits, false_bits)
        return self.bound(true_bits, false_bits, least_s)

    def price(self, state: State, duration_s: float) -> float:
        """Return the value in `state` for a given duration [s]."""
        return self.fixed + self.per_m * self.path_m.at(state) + self.per_s * duration_s

    def bound(self, true_bits: int, false_bits: int, least_s: float) -> float:
        """Return a lower bound over the states with these facts known, for a least duration [s]."""
        least_m = self.path_m.least(true_bits, false_bits)
        # A weight of 0 would make no number of an infinite bound.
        if math.isinf(least_m) or math.isinf(least_s):
            return math.inf
        return self.fixed + self.per_m * least_m + self.per_s * least_s


@dataclass(frozen=True)
class WaitingCost(DerivedCost):
    """The duration of taking a part from a feeder that needs time to present the next one.

    Two takes end at least one cycle apart. The state determines the time since the last take if the
    arm comes straight from the place of that part; otherwise a cycle must be over.

    Parameters
    ----------
    cost
        Duration without waiting [s].
    cycle_s
        Least time between the ends of two takes [s], > 0.
    after
        Skill that ended the last take's part, and time since that take [s], by the place of the
        arm; a back end may know another time.
    """

    cost: Cost
    cycle_s: float
    after: Mapping[int, tuple[str, float]] = field(hash=False)

    def at(self, state: State) -> float:
        """Return the duration in `state`, with the time of waiting."""
        since_s = next((s for bit, (_, s) in self.after.items() if state.bits & bit), math.inf)
        return self.prolong(self.cost.at(state), since_s)

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return a lower bound, without waiting."""
        return self.cost.least(true_bits, false_bits)

    def prolong(self, duration_s: float, since_s: float) -> float:
        """Return a duration with waiting, `since_s` after the last take [s]."""
        return max(duration_s, self.cycle_s - since_s)

    def find_last(self, state: State) -> str | None:
        """Return the skill with which the part of the last take was placed, if it was the last."""
        return next((name for bit, (name, _) in self.after.items() if state.bits & bit), None)


def compute_planar_distance(start: Point, goal: Point) -> float:
    """Return the horizontal distance between two points [m]."""
    return math.hypot(goal[0] - start[0], goal[1] - start[1])


NEVER = -1
"""Marks a place in a table from which the skill is impossible."""


@dataclass(frozen=True)
class TableCost:
    """An integer cost that depends on the place, such as a row of a cost matrix.

    Skills share the facts of the places, so a table stores a single row of numbers.

    Parameters
    ----------
    places
        Facts of the places; their bits are adjacent, and one of them holds at a time.
    values
        Value of each place in the order of the bits, >= 0 or `NEVER`.
    """

    places: State
    values: tuple[int, ...] = field(hash=False, repr=False)
    _mask: int = field(init=False, repr=False, compare=False)
    _below: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        mask = self.places.bits
        below = (mask & -mask).bit_length()
        if not mask or mask.bit_length() - below + 1 != mask.bit_count():
            raise ValueError("The places of a TableCost must lie side by side.")
        if len(self.values) != mask.bit_count():
            raise ValueError(
                f"TableCost needs {mask.bit_count()} values, one a place, not {len(self.values)}."
            )
        if min(self.values) < NEVER:
            raise ValueError(f"Cost must be >= 0, or -1 for never, not {min(self.values)}.")
        object.__setattr__(self, "_mask", mask)
        object.__setattr__(self, "_below", below)

    def at(self, state: State) -> float:
        """Return the value for the place in `state`; inf if the skill is impossible there.

        Raises
        ------
        ValueError
            If not exactly one of the places holds.
        """
        held = state.bits & self._mask
        if not held or held & (held - 1):
            raise ValueError(f"The state gives no single place: {state}.")
        value = self.values[held.bit_length() - self._below]
        return math.inf if value < 0 else float(value)

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return the least value over all places that the known facts allow."""
        known = true_bits & self._mask
        if known & (known - 1):
            return math.inf
        if known:
            value = self.values[known.bit_length() - self._below]
            return math.inf if value < 0 else float(value)
        closed = false_bits & self._mask
        if not closed:
            return self._least
        closed >>= self._below - 1
        return float(
            min(
                (
                    value
                    for place, value in enumerate(self.values)
                    if value >= 0 and not closed >> place & 1
                ),
                default=math.inf,
            )
        )

    @cached_property
    def _least(self) -> float:
        """The least value of the table."""
        return float(min((value for value in self.values if value >= 0), default=math.inf))
