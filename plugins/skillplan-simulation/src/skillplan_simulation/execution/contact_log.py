"""Log of contacts and displacements, 60 frames a simulated second."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from skillplan.physics.performance import Contact
from skillplan.task.motion import Point
from skillplan.task.scene import Fit, Pose
from skillplan_pinocchio.kinematics.fixed_order import dot, length
from skillplan_simulation.record import FRAMES_PER_S, Pair
from skillplan_simulation.simulator import ROBOT, STEPS_PER_S, TABLE, Arm, Touch, World

Vector = NDArray[np.float64]

STEPS_PER_FRAME = STEPS_PER_S // FRAMES_PER_S

# Gap that resting bodies occasionally open [m].
_CLOSE_M = 0.0005

# Contacts are sideways if the cosine between velocity and force is below this.
_ASIDE = 0.7


@dataclass(frozen=True, slots=True)
class Guides:
    """Bodies that a part slides along on the last stretch to its seat.

    Parameters
    ----------
    seat_m, along
        Final position of the part, and the direction in which it gets there.
    lengths_m
        Length of the stretch along each body [m].
    fits
        Stated fits of the part in some of these bodies.
    """

    subject: str
    seat_m: Point
    along: Point
    lengths_m: Mapping[str, float]
    fits: tuple[Fit, ...] = ()

    @property
    def led(self) -> tuple[Fit, ...]:
        """Fits whose contacts a stated force replaces."""
        return tuple(fit for fit in self.fits if fit.is_led)

    @property
    def force_n(self) -> float | None:
        """Greatest stated force of the fits [N], or None."""
        return max((fit.force_n for fit in self.fits if fit.force_n is not None), default=None)

    def aside_m(self, position_m: Point) -> float:
        """Return the distance of the part from the line to its seat [m]."""
        off = [here - end for here, end in zip(position_m, self.seat_m, strict=True)]
        left = sum(axis * value for axis, value in zip(self.along, off, strict=True))
        return math.hypot(
            *(value - left * axis for axis, value in zip(self.along, off, strict=True))
        )

    def at(self, position_m: Point) -> set[str]:
        """Return the bodies that guide the part at a position."""
        left_m = sum(
            axis * (end - here)
            for axis, end, here in zip(self.along, self.seat_m, position_m, strict=True)
        )
        return {name for name, length_m in self.lengths_m.items() if left_m < length_m + _CLOSE_M}


@dataclass(frozen=True, slots=True)
class DrivenHead:
    """The head of a screw with the bit of its driver in it.

    Contacts of a simulation are soft, so a low head sinks in below the end of the bit.

    Parameters
    ----------
    screw, drivers
        Names of the screw, and of the bodies that drive it.
    tip_m, along
        End of the bit when the screw touches, and direction in which the screw goes in.
    radius_m, reach_m
        Radius of the head, and greatest distance of its contacts from `tip_m` along the axis [m].
    """

    screw: str
    drivers: frozenset[str]
    tip_m: Vector
    along: Vector
    radius_m: float
    reach_m: float

    def name(self, body: str, place: Vector) -> str:
        """Return the name of a body at a contact: that of the screw for the bit in its head."""
        if body not in self.drivers:
            return body
        off = place - self.tip_m
        ahead_m = dot(off, self.along)
        aside_m = length(off - ahead_m * self.along)
        return self.screw if abs(ahead_m) <= self.reach_m and aside_m <= self.radius_m else body


class ContactLog:
    """Frames of one execution.

    Parameters
    ----------
    handled
        Handled bodies, whose displacement is not logged.
    """

    def __init__(self, world: World, arm: Arm, handled: Iterable[str]) -> None:
        self.world, self.arm = world, arm
        self.handled = frozenset(handled)
        self.frames = 0
        self.phases: list[tuple[int, str]] = []
        self.forces: dict[str, list[Vector]] = {name: [] for name in world.bodies}
        self.pairs: dict[Pair, list[float]] = {}
        # Pairs whose first contact was sideways to the motion of the handled part.
        self.beside: set[Pair] = set()
        self.moved: dict[str, list[float]] = {}
        self.expected: set[Pair] = set()
        # Bodies that may touch anything: released or driven parts.
        self.free: set[str] = set()
        # Inserted part, and resistance to it in every frame since [N].
        self.inserted: str | None = None
        self.resistance_n: list[float] = []
        # Stretches on which other bodies guide the handled part to its seat.
        self.guides: Guides | None = None
        # Head of the screw that is being driven.
        self.head: DrivenHead | None = None
        # Constraints that act like contacts, such as a suction cup's.
        self.cups: dict[str, int] = {}
        self.last_pairs: dict[Pair, float] = {}
        self._last_points: list[Touch] = []
        # Poses of bodies that are not handled at the start of the log.
        self.stood: dict[str, Pose] = {}
        self._origin: dict[str, Point] = {}
        # Dwells at rest: number of the next frame, and duration [s].
        self.pauses: list[tuple[int, float]] = []
        self._begun = False

    def begin(self) -> None:
        """Record current contacts as expected, and current poses as reference."""
        self._begun = True
        self.expected |= self._close()
        self.stood = {
            name: self.world.pose(name) for name in self.world.bodies if name not in self.handled
        }
        self._origin = {name: pose.position for name, pose in self.stood.items()}
        self.moved = {name: [] for name in self._origin}

    def insert(self, name: str) -> None:
        """Start to log the resistance to a part that is inserted."""
        self.free.add(name)
        self.inserted = name

    def phase(self, label: str) -> None:
        """Record the start of a phase."""
        self.phases.append((self.frames, label))

    @property
    def phase_now(self) -> str:
        """The current phase."""
        return self.phases[-1][1] if self.phases else ""

    def frame(self) -> None:
        """Log a frame, once the log has started."""
        if not self._begun:
            return
        forces = {name: np.zeros(3) for name in self.world.bodies}
        pairs = self._touching(forces)
        for name, constraint in self.cups.items():
            forces[name] += self.world.pulled_n(name, constraint)
        for name, force in forces.items():
            self.forces.setdefault(name, [np.zeros(3)] * self.frames).append(force)
        guiding = self._find_guiding()
        guided = set() if self.guides is None else {self.guides.subject}
        for pair, force_n in pairs.items():
            if guided & set(pair) and guiding & set(pair):
                continue
            if pair not in self.expected and not self.free & set(pair):
                if pair not in self.pairs and self._touch_sideways(pair):
                    self.beside.add(pair)
                self.pairs.setdefault(pair, [0.0] * self.frames).append(force_n)
        for name, origin in self._origin.items():
            self.moved[name].append(math.dist(self.world.pose(name).position, origin))
        self.frames += 1
        for values in self.pairs.values():
            if len(values) < self.frames:
                values.append(0.0)
        self.last_pairs = pairs
        if self.inserted is not None:
            into = set(self.world.others(self.inserted)) - {self.inserted}
            self.resistance_n.append(self.pressing_n({self.inserted}, into))
        elif guiding:
            self.resistance_n.append(self._measure_guiding_n(guiding))

    def _measure_guiding_n(self, guiding: set[str]) -> float:
        """Return the net force of some bodies on the guided part, as at the wrist [N]."""
        assert self.guides is not None
        force_n = np.zeros(3)
        for point in self._last_points:
            if point.first == self.guides.subject and point.second in guiding:
                force_n += point.force_n
            elif point.second == self.guides.subject and point.first in guiding:
                force_n -= point.force_n
        return length(force_n)

    def _find_guiding(self) -> set[str]:
        """Return the bodies that guide the handled part where it is now."""
        if self.guides is None:
            return set()
        here = self.world.pose(self.guides.subject).position
        return self.guides.at(here)

    def pressing_n(self, ones: Iterable[str], others: Iterable[str]) -> float:
        """Return the normal force between two groups of bodies in the last frame [N]."""
        some, rest = set(ones), set(others)
        return sum(
            force
            for (first, second), force in self.last_pairs.items()
            if (first in some and second in rest) or (first in rest and second in some)
        )

    def contacts(self) -> tuple[Contact, ...]:
        """Return the contacts of the last frame, one per pair of bodies."""
        sums: dict[Pair, tuple[float, Vector, Vector]] = {}
        for point in self._last_points:
            normal_n, first, second = point.normal_n, point.first, point.second
            force = -point.force_n
            if second < first:
                first, second, force = second, first, -force
            total_n, place, so_far = sums.get((first, second), (0.0, np.zeros(3), np.zeros(3)))
            sums[first, second] = (
                total_n + normal_n,
                place + normal_n * point.place,
                so_far + force,
            )
        return tuple(
            Contact(pair, _make_point(place / total_n), _make_point(force))
            for pair, (total_n, place, force) in sums.items()
        )

    def unexpected_n(self) -> float:
        """Return the largest force of an unexpected pair in the last frame [N]."""
        return max((values[-1] for values in self.pairs.values() if values), default=0.0)

    def _close(self) -> set[Pair]:
        """Return the pairs of bodies that touch or almost touch."""
        pairs = set()
        for first, second in combinations(sorted((TABLE, *self.world.bodies)), 2):
            if self.world.is_near(first, second, _CLOSE_M):
                pairs.add((first, second))
        return pairs

    def _touching(self, forces: dict[str, Vector] | None = None) -> dict[Pair, float]:
        """Return the normal force of every touching pair, and add forces on bodies."""
        pairs: dict[Pair, float] = {}
        self._last_points = self.world.touches()
        for point in self._last_points:
            first, second, normal_n = point.first, point.second, point.normal_n
            if self.head is not None:
                first, second = (self.head.name(body, point.place) for body in (first, second))
            pair = (first, second) if first <= second else (second, first)
            pairs[pair] = pairs.get(pair, 0.0) + normal_n
            if forces is None:
                continue
            force = point.force_n
            if point.first in forces:
                forces[point.first] += force
            if point.second in forces:
                forces[point.second] -= force
        return pairs

    def _touch_sideways(self, pair: Pair) -> bool:
        """Return whether a handled part moves along the other body of a pair, not towards it."""
        ones, others = set(pair) & self.handled, set(pair) - self.handled
        if not ones or others & {ROBOT, TABLE, *self.arm.link_names.values()}:
            return False
        way = np.zeros(3) if self.arm.setpoint is None else self.arm.setpoint.velocity
        towards = np.zeros(3)
        for point in self._last_points:
            if {point.first, point.second} == set(pair):
                towards += point.normal_n * point.normal
        both = length(way) * length(towards)
        return both > 0.0 and abs(dot(way, towards)) < _ASIDE * both


def _make_point(values: Vector) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
