"""Simulation of a schedule of swings: every pin holds at most one base at a time.

An independent judge of plans: it knows the pins of the bench and where they are, follows the
schedule through time, and works out for itself which pins a swing passes. It shares nothing with
the task that solvers plan on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from skillplan_swarmitfix.bench.bench import Bench

_TURN_TOLERANCE_DEG = 1e-3
_LENGTH_TOLERANCE = 1e-6


Ends = Mapping[str, tuple[int, int]]
"""First and last position of every robot, both from 0."""


@dataclass(frozen=True, slots=True)
class FleetSwing:
    """One swing of one base in a schedule.

    Parameters
    ----------
    robot
        Name of the robot.
    action
        Number of the action, >= 1.
    start, end
        Positions, from 0.
    start_s, end_s
        When it runs [s], or in steps; it ends after it starts.

    Raises
    ------
    ValueError
        If it does not end after it starts.
    """

    robot: str
    action: int
    start: int
    end: int
    start_s: float
    end_s: float

    def __post_init__(self) -> None:
        if not 0 <= self.start_s < self.end_s < math.inf:
            raise ValueError(f"A swing cannot run from {self.start_s} s to {self.end_s} s.")


@dataclass(frozen=True, slots=True)
class FleetViolation:
    """The first thing that goes wrong in a schedule.

    Parameters
    ----------
    time_s
        When [s], or in steps.
    robots
        Names of the robots involved.
    pin
        The pin that two of them need, such as ``P9``; None where something else is wrong.
    reason
        In a sentence.
    in_steps
        True if the time is counted in steps.
    """

    time_s: float
    robots: tuple[str, ...]
    pin: str | None
    reason: str
    in_steps: bool = False

    def __str__(self) -> str:
        when = f"step {self.time_s + 1:.0f}" if self.in_steps else f"{self.time_s:.3f} s"
        return f"{when}: {self.reason}"


def simulate(
    bench: Bench, robots: Ends, steps: Iterable[Iterable[tuple[str, int, int, int]]]
) -> FleetViolation | None:
    """Follow a schedule of synchronous steps and return the first thing that goes wrong.

    Parameters
    ----------
    bench
        The lattice.
    robots
        First and last position of every robot.
    steps
        For every step its swings: robot, action, position before and after, both from 0. All
        swings of a step run from its beginning to its end.

    Returns
    -------
    FleetViolation or None
        None where all robots end at their last positions and no pin is ever docked or swept by
        two of them.
    """
    swings = [FleetSwing(*swing, t, t + 1) for t, step in enumerate(steps) for swing in step]
    violation = simulate_timed(bench, robots, swings)
    return None if violation is None else replace(violation, in_steps=True)


def simulate_timed(
    bench: Bench, robots: Ends, swings: Iterable[FleetSwing]
) -> FleetViolation | None:
    """Follow a schedule in continuous time and return the first thing that goes wrong.

    A standing base docks its three pins. A swinging one keeps its pivot and every pin that its
    legs pass, from the old ones to the new ones, from the start of the swing to its end. What
    ends at a moment is over before what starts at the same moment.

    Parameters
    ----------
    bench
        The lattice.
    robots
        First and last position of every robot.
    swings
        In any order.
    """
    ordered = sorted(swings, key=lambda swing: (swing.start_s, swing.end_s, swing.robot))
    return _Simulation(bench).first_violation(robots, ordered)


class _Simulation:
    """Holder of every pin over time."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.positions: dict[str, int] = {}
        self.holder: dict[int, str] = {}
        self.under_way: dict[str, FleetSwing] = {}
        self.time_s = 0.0

    def first_violation(self, robots: Ends, swings: Sequence[FleetSwing]) -> FleetViolation | None:
        """Follow swings in the order of their starts; return the first violation, if any."""
        for robot, (home, _) in robots.items():
            self.positions[robot] = home
            violation = self._hold(robot, self._legs(home), "docks")
            if violation is not None:
                return violation
        for swing in swings:
            self._finish_until(swing.start_s)
            violation = self._begin(swing)
            if violation is not None:
                return violation
        self._finish_until(math.inf)
        for robot, (_, goal) in robots.items():
            place = self.positions[robot]
            if place != goal:
                names = self.bench.name(place), self.bench.name(goal)
                return self._wrong(robot, f"{robot} ends at {names[0]}, not at its goal {names[1]}")
        return None

    def _wrong(self, robot: str, reason: str) -> FleetViolation:
        return FleetViolation(self.time_s, (robot,), None, reason)

    def _finish_until(self, time_s: float) -> None:
        """End the swings that are over by then; what ends at that time is."""
        for robot, swing in sorted(self.under_way.items(), key=lambda item: item[1].end_s):
            if swing.end_s > time_s:
                break
            del self.under_way[robot]
            self.positions[robot] = swing.end
            self.time_s = swing.end_s
            docked = self._legs(swing.end)
            for pin in [pin for pin, holder in self.holder.items() if holder == robot]:
                if pin not in docked:
                    del self.holder[pin]
        if math.isfinite(time_s):
            self.time_s = time_s

    def _begin(self, swing: FleetSwing) -> FleetViolation | None:
        reason = self._misfit(swing)
        if reason is not None:
            return self._wrong(swing.robot, reason)
        pins = passed_pins(self.bench, swing.start, swing.action)
        violation = self._hold(swing.robot, pins, f"by B{swing.action} sweeps")
        if violation is None:
            self.under_way[swing.robot] = swing
        return violation

    def _misfit(self, swing: FleetSwing) -> str | None:
        """Return the fault of a single swing, None if it is valid."""
        robot, bench = swing.robot, self.bench
        if robot not in self.positions:
            return f"robot {robot} does not exist"
        what = f"B{swing.action}"
        if robot in self.under_way:
            return f"{robot} starts {what} before its last swing has ended"
        here = self.positions[robot]
        if here != swing.start:
            return (
                f"{robot} starts {what} at position {swing.start + 1}, but is at {bench.name(here)}"
            )
        expected = bench.swing(here, swing.action) if 1 <= swing.action < bench.actions else None
        if expected is None:
            return f"{robot} cannot make {what} at {bench.name(here)}"
        if expected.end != swing.end:
            return (
                f"{what} at {bench.name(here)} leads to {bench.name(expected.end)}, not elsewhere"
            )
        return None

    def _hold(self, robot: str, pins: frozenset[int], what: str) -> FleetViolation | None:
        """Assign pins to a robot; return the present holder of one of them, if any."""
        for pin in sorted(pins):
            holder = self.holder.setdefault(pin, robot)
            if holder != robot:
                name = self.bench.pin_name(pin)
                doing = "sweeps" if holder in self.under_way else "docks"
                reason = f"{robot} {what} {name}, which {holder} {doing}"
                return FleetViolation(self.time_s, (robot, holder), name, reason)
        return None

    def _legs(self, position: int) -> frozenset[int]:
        return frozenset(self.bench.legs[position].tolist())


def passed_pins(bench: Bench, position: int, action: int) -> frozenset[int]:
    """Return the pins that a swing keeps busy, from where pins are and how far it turns.

    Parameters
    ----------
    bench
        The lattice.
    position
        Position of the base.
    action
        1 to ``bench.actions - 1``, a swing that stays on the bench.

    Raises
    ------
    ValueError
        If the action is not a swing at the position.
    """
    swing = bench.swing(position, action)
    if swing is None:
        raise ValueError(f"B{action} is not a swing at {bench.name(position)}.")
    x_m, y_m = bench.pins_m[swing.pivot]
    sign = 1.0 if swing.direction == "CCW" else -1.0

    def heading_deg(pin: int) -> float:
        return math.degrees(math.atan2(bench.pins_m[pin, 1] - y_m, bench.pins_m[pin, 0] - x_m))

    free = [int(leg) for leg in bench.legs[position] if leg != swing.pivot]
    passed = {swing.pivot}
    for pin in range(bench.n_pins):
        distance_m = math.dist(bench.pins_m[pin], (x_m, y_m))
        if abs(distance_m - bench.pitch_m) > _LENGTH_TOLERANCE * bench.pitch_m:
            continue
        for leg in free:
            turn_deg = sign * (heading_deg(pin) - heading_deg(leg)) % 360.0
            turn_deg = 0.0 if turn_deg > 360.0 - _TURN_TOLERANCE_DEG else turn_deg
            if turn_deg <= swing.angle_deg + _TURN_TOLERANCE_DEG:
                passed.add(pin)
    return frozenset(passed)
