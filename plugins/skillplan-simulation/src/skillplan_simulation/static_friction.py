"""Static friction between jaws and a held part: the part does not move within the friction limit.

Simulators implement friction as a velocity that is driven towards zero. The residue of every step,
and the deviation of a turning arm within a step, add up: a held part creeps by some tenths of a
millimetre per second, which real parts do not. So a held part is fixed to the hand as long as
Coulomb's limit holds: its load, the force and moment of the jaws on it, stays within an ellipsoid
(Howe and Cutkosky, 1996). The half axes follow from the jaws' normal forces, friction coefficients
and contact patches. Beyond the limit the contacts alone hold the part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skillplan_pinocchio.kinematics.fixed_order import cross, dot, length, times
from skillplan_simulation.kinematics import TipPose
from skillplan_simulation.simulator import FINGERS, GRAVITY_M_PER_S2, Touch

Vector = NDArray[np.float64]

# Acceleration that balances gravity for a part at rest [m/s2].
_UPWARDS = np.array([0.0, 0.0, GRAVITY_M_PER_S2])


@dataclass(frozen=True, slots=True)
class Pads:
    """Contact patches of two jaws.

    Parameters
    ----------
    normal_n
        Sum of the normal forces of the weaker jaw, and of both [N].
    centre
        Centre between the patches [m], shape (3,).
    closing
        Unit vector along which the jaws close, shape (3,).
    apart_m
        Distance of the two patches [m].
    reach_m
        Mean distance of contact points from the centre of their patch [m].
    """

    normal_n: tuple[float, float]
    centre: Vector
    closing: Vector
    apart_m: float
    reach_m: float


def compute_utilisation(
    pads: Pads, force_n: Vector, moment_nm: Vector, *, friction: float, spinning_m: float
) -> float:
    """Return the load as a share of the friction limit; above 1 the part slips.

    Parameters
    ----------
    force_n, moment_nm
        Force and moment of the jaws on the part, about the centre of the pads, shape (3,) each.
    friction
        Coefficient of lateral friction [-].
    spinning_m
        Torsional friction of a contact point per unit of normal force [m].
    """
    weaker_n, both_n = pads.normal_n
    if weaker_n <= 0.0:
        return math.inf
    across = dot(force_n, pads.closing)
    along = length(force_n - across * pads.closing)
    twist = dot(moment_nm, pads.closing)
    tilt = length(moment_nm - twist * pads.closing)
    soft_m = spinning_m + friction * pads.reach_m
    return math.hypot(
        along / (friction * both_n),
        # A larger force pushes a jaw open.
        across / (both_n / 2),
        twist / (soft_m * both_n),
        tilt / ((soft_m + pads.reach_m + friction * pads.apart_m / 2) * both_n),
    )


class HeldWorld(Protocol):
    """The part of a world's interface that the grip needs.

    Attributes
    ----------
    friction
        Coefficient of lateral friction of bodies [-].
    """

    friction: float

    def velocity(self, name: str) -> tuple[Vector, Vector]:
        """Return the velocity of a body's centre of mass [m/s] and its angular velocity [rad/s]."""

    def centre(self, name: str) -> Vector:
        """Return the centre of mass of a body [m], shape (3,)."""

    def mass_kg(self, name: str) -> float:
        """Return the mass of a body [kg]."""

    def inertia_kg_m2(self, name: str) -> Vector:
        """Return the inertia tensor about the centre of mass in world axes, shape (3, 3)."""

    def pushed_n(self, name: str) -> Vector:
        """Return the force that pushes the centre of a body [N], shape (3,)."""

    def points_on(self, name: str) -> Sequence[Touch]:
        """Return the contacts of a body, as it feels them, with zero forces included."""

    def release(self, constraint: int) -> None:
        """Remove a constraint."""


class HoldingArm(Protocol):
    """The part of an arm's interface that the grip needs."""

    def tip(self) -> TipPose:
        """Return the pose of the tip."""

    def grip(self, name: str) -> int:
        """Fix a body to the hand in its current pose; return the constraint."""

    def grip_friction(self, friction: float) -> tuple[float, float]:
        """Return the lateral [-] and torsional friction [m] between a jaw and a body."""


class StaticFriction:
    """Holds a part still between the jaws within the friction limit.

    Parameters
    ----------
    world, arm
        World, and arm with the jaws.
    """

    def __init__(self, world: HeldWorld, arm: HoldingArm, name: str) -> None:
        self.world, self.arm, self.name = world, arm, name
        self._reach_m = 0.0
        self._velocity: tuple[Vector, Vector] | None = None
        pads = self._pads(world.points_on(name))
        # A part that is not between both jaws is not held.
        self.constraint = None if pads is None else arm.grip(name)

    def hold(self, elapsed_s: float) -> None:
        """Let the part slip if its load since the last call exceeds the friction limit.

        Parameters
        ----------
        elapsed_s
            Time since the last call [s].
        """
        if self.constraint is None:
            return
        points = self.world.points_on(self.name)
        pads = self._pads(points)
        if pads is None:
            self.let_go()
            return
        before, self._velocity = self._velocity, self.world.velocity(self.name)
        if before is None:
            return
        linear, angular = (
            (now - then) / elapsed_s for now, then in zip(self._velocity, before, strict=True)
        )
        force_n, moment_nm = self._load(linear, angular, points)
        moment_nm = moment_nm + cross(self.world.centre(self.name) - pads.centre, force_n)
        friction, spinning_m = self.arm.grip_friction(self.world.friction)
        share = compute_utilisation(
            pads, force_n, moment_nm, friction=friction, spinning_m=spinning_m
        )
        if share > 1.0:
            self.let_go()

    def let_go(self) -> None:
        """Release the part to its contacts."""
        if self.constraint is not None:
            self.world.release(self.constraint)
            self.constraint = None

    def _load(
        self, linear: Vector, angular: Vector, points: Sequence[Touch]
    ) -> tuple[Vector, Vector]:
        """Return the force of the jaws on the part, and the moment about its centre of mass.

        They follow from its acceleration, weight and other contacts.
        """
        force = self.world.mass_kg(self.name) * (linear + _UPWARDS)
        force = force - self.world.pushed_n(self.name)
        moment = times(self.world.inertia_kg_m2(self.name), angular)
        centre = self.world.centre(self.name)
        for point in points:
            if point.second not in FINGERS:
                force = force - point.force_n
                moment = moment - cross(point.place - centre, point.force_n)
        return force, moment

    def _pads(self, points: Sequence[Touch]) -> Pads | None:
        """Return the pads, or None if the part is not between two jaws."""
        forces: list[float] = []
        middles: list[Vector] = []
        for jaw in FINGERS:
            touching = [point for point in points if point.second == jaw]
            if not touching:
                return None
            middle = [
                sum(axis) / len(touching)
                for axis in zip(*(point.place.tolist() for point in touching), strict=True)
            ]
            away = sum(math.dist(point.place, middle) for point in touching) / len(touching)
            # Refreshed contacts have few points at first.
            self._reach_m = max(self._reach_m, away)
            forces.append(sum(point.normal_n for point in touching))
            middles.append(np.array(middle))
        left, right = middles
        return Pads(
            (min(forces), sum(forces)),
            (left + right) / 2,
            self.arm.tip().rotation[:, 1],
            math.dist(left, right),
            self._reach_m,
        )
