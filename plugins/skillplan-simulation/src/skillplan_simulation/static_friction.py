"""Static friction between jaws and what they hold: nothing moves while friction can hold it.

Simulators work friction out as a velocity that is brought near to zero. What is left of it in every
step, or what a turning arm strays from its velocity within one, adds up: a held part creeps by some
tenths of a millimetre in a second, which no real part does. So a held part is fixed to the hand for
as long as Coulomb's limit holds: its load, which is what the jaws have to do to it, stays within
an ellipsoid in the space of forces and moments (Howe and Cutkosky, 1996). Its half axes are what
the jaws' normal forces, the friction coefficients and the patches of contact allow. Beyond it the
part is let slip, as the contacts say.
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

# What a part at rest is accelerated by, so as not to fall [m/s2].
_UPWARDS = np.array([0.0, 0.0, GRAVITY_M_PER_S2])


@dataclass(frozen=True, slots=True)
class Pads:
    """What two jaws press with, and where.

    Parameters
    ----------
    normal_n
        Sum of the normal forces of the weaker jaw, and of both [N].
    centre
        Between the patches of contact [m], shape (3,).
    closing
        Unit vector along which the jaws close, shape (3,).
    apart_m
        Distance of the two patches.
    reach_m
        Mean distance of points of contact from the middle of their patch.
    """

    normal_n: tuple[float, float]
    centre: Vector
    closing: Vector
    apart_m: float
    reach_m: float


def utilisation(
    pads: Pads, force_n: Vector, moment_nm: Vector, *, friction: float, spinning_m: float
) -> float:
    """Return which share of what friction can hold a load takes; above 1 it slips.

    Parameters
    ----------
    pads
        Of the jaws.
    force_n, moment_nm
        What the jaws do to the part, the moment about the centre of the pads, shape (3,) each.
    friction
        Coefficient of lateral friction [-].
    spinning_m
        Torsional friction of a single point of contact, by its normal force [m].
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
        # A jaw is pushed open by more.
        across / (both_n / 2),
        twist / (soft_m * both_n),
        tilt / ((soft_m + pads.reach_m + friction * pads.apart_m / 2) * both_n),
    )


class HeldWorld(Protocol):
    """What of a world bears on a part in the jaws.

    Attributes
    ----------
    friction
        Coefficient of lateral friction of bodies [-].
    """

    friction: float

    def velocity(self, name: str) -> tuple[Vector, Vector]:
        """Return how fast a body's centre of mass moves [m/s] and the body turns [rad/s]."""

    def centre(self, name: str) -> Vector:
        """Return where the centre of mass of a body is [m], shape (3,)."""

    def mass_kg(self, name: str) -> float:
        """Return the mass of a body [kg]."""

    def inertia_kg_m2(self, name: str) -> Vector:
        """Return the inertia of a body about its centre of mass in the world, shape (3, 3)."""

    def points_on(self, name: str) -> Sequence[Touch]:
        """Return where a body is touched, as what is felt by it, also where nothing presses."""

    def release(self, constraint: int) -> None:
        """Undo a constraint."""


class HoldingArm(Protocol):
    """What of an arm bears on a part in its jaws."""

    def tip(self) -> TipPose:
        """Return where the tip is."""

    def grip(self, name: str) -> int:
        """Fix a body to the hand as it is; return the constraint."""

    def grip_friction(self, friction: float) -> tuple[float, float]:
        """Return lateral [-] and torsional friction [m] between a jaw and what has a friction."""


class StaticFriction:
    """Holds a part still in the jaws while friction can.

    Parameters
    ----------
    world, arm
        Where, and whose jaws.
    name
        Of the part.
    """

    def __init__(self, world: HeldWorld, arm: HoldingArm, name: str) -> None:
        self.world, self.arm, self.name = world, arm, name
        self._reach_m = 0.0
        self._velocity: tuple[Vector, Vector] | None = None
        pads = self._pads(world.points_on(name))
        # What jaws do not hold between them is held by nothing.
        self.constraint = None if pads is None else arm.grip(name)

    def hold(self, elapsed_s: float) -> None:
        """Let the part slip if its load since the last time was beyond what friction holds.

        Parameters
        ----------
        elapsed_s
            Since then.
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
        share = utilisation(pads, force_n, moment_nm, friction=friction, spinning_m=spinning_m)
        if share > 1.0:
            self.let_go()

    def let_go(self) -> None:
        """Leave the part to its contacts."""
        if self.constraint is not None:
            self.world.release(self.constraint)
            self.constraint = None

    def _load(
        self, linear: Vector, angular: Vector, points: Sequence[Touch]
    ) -> tuple[Vector, Vector]:
        """Return the force and the moment about its centre of mass that jaws do to the part.

        They are what its acceleration takes beside its weight and what else touches it.
        """
        force = self.world.mass_kg(self.name) * (linear + _UPWARDS)
        moment = times(self.world.inertia_kg_m2(self.name), angular)
        centre = self.world.centre(self.name)
        for point in points:
            if point.second not in FINGERS:
                force = force - point.force_n
                moment = moment - cross(point.place - centre, point.force_n)
        return force, moment

    def _pads(self, points: Sequence[Touch]) -> Pads | None:
        """Return the pads; None where the part is not between two jaws."""
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
            # Points that are found anew are few at first.
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
