"""Static friction between jaws and what they hold: nothing moves while friction can hold it.

The simulator works friction out as a velocity that is brought near to zero, at points of contact
that it keeps as they were found. In a hand that turns, a part creeps by some tenths of a degree
and of a millimetre in seconds, which no real part does. So a held part is fixed to the hand for
as long as Coulomb's limit holds: its load, which is what the jaws have to do to it, stays within
an ellipsoid in the space of forces and moments (Howe and Cutkosky, 1996). Its half axes are what
the jaws' normal forces, the friction coefficients and the patches of contact allow. Beyond it the
part is let slip, as the contacts say.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pybullet

from skillplan_pinocchio.simulation.arm.rotations import Vector
from skillplan_pinocchio.simulation.simulator import GRAVITY_M_PER_S2
from skillplan_pybullet.simulator.world import World

if TYPE_CHECKING:
    from skillplan_pybullet.arm.simulated_arm import SimulatedArm

# Of what touches a body, as the simulator gives it: what and which of its links, where on the body,
# the normal towards it, the normal force, and the two friction forces before their directions.
_OTHER, _LINK, _PLACE, _NORMAL, _FORCE, _FRICTION, _OTHER_FRICTION = 2, 4, 5, 7, 9, 10, 12
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
        return np.inf
    across = float(force_n @ pads.closing)
    along = float(np.linalg.norm(force_n - across * pads.closing))
    twist = float(moment_nm @ pads.closing)
    tilt = float(np.linalg.norm(moment_nm - twist * pads.closing))
    soft_m = spinning_m + friction * pads.reach_m
    shares = (
        along / (friction * both_n),
        # A jaw is pushed open by more.
        across / (both_n / 2),
        twist / (soft_m * both_n),
        tilt / ((soft_m + pads.reach_m + friction * pads.apart_m / 2) * both_n),
    )
    return float(np.linalg.norm(shares))


class StaticFriction:
    """Holds a part still in the jaws while friction can.

    Parameters
    ----------
    world, arm
        Where, and whose jaws.
    name
        Of the part.
    """

    def __init__(self, world: World, arm: SimulatedArm, name: str) -> None:
        self.world, self.arm, self.name = world, arm, name
        self._reach_m = 0.0
        self._velocity: tuple[Vector, Vector] | None = None
        pads = self._pads(self._points())
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
        points = self._points()
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
        moment_nm = moment_nm + np.cross(self.world.centre(self.name) - pads.centre, force_n)
        friction, spinning_m = self.arm.grip_friction(self.world.friction)
        share = utilisation(pads, force_n, moment_nm, friction=friction, spinning_m=spinning_m)
        if share > 1.0:
            self.let_go()

    def let_go(self) -> None:
        """Leave the part to its contacts."""
        if self.constraint is not None:
            self.world.release(self.constraint)
            self.constraint = None

    def _points(self) -> list[Any]:
        return list(
            pybullet.getContactPoints(
                self.world.numbers[self.name], physicsClientId=self.world.client
            )
        )

    def _load(self, linear: Vector, angular: Vector, points: list[Any]) -> tuple[Vector, Vector]:
        """Return the force and the moment about its centre of mass that jaws do to the part.

        They are what its acceleration takes beside its weight and what else touches it.
        """
        force = self.world.mass_kg(self.name) * (linear + _UPWARDS)
        moment = self.world.inertia_kg_m2(self.name) @ angular
        centre = self.world.centre(self.name)
        for point in points:
            if self._jaw_of(point) is not None:
                continue
            pushed = _push(point)
            force = force - pushed
            moment = moment - np.cross(np.array(point[_PLACE]) - centre, pushed)
        return force, moment

    def _jaw_of(self, point: Any) -> int | None:
        """Return the jaw that touches the part, if one does."""
        is_jaw = point[_OTHER] == self.arm.number and point[_LINK] in self.arm.file.jaws
        return int(point[_LINK]) if is_jaw else None

    def _pads(self, points: list[Any]) -> Pads | None:
        """Return the pads; None where the part is not between two jaws."""
        forces: list[float] = []
        middles: list[Vector] = []
        for jaw in self.arm.file.jaws:
            touching = [point for point in points if self._jaw_of(point) == jaw]
            if not touching:
                return None
            middle = [
                sum(axis) / len(touching)
                for axis in zip(*(point[_PLACE] for point in touching), strict=True)
            ]
            away = sum(math.dist(point[_PLACE], middle) for point in touching) / len(touching)
            # Points that are found anew are few at first.
            self._reach_m = max(self._reach_m, away)
            forces.append(sum(point[_FORCE] for point in touching))
            middles.append(np.array(middle))
        left, right = middles
        return Pads(
            (min(forces), sum(forces)),
            (left + right) / 2,
            self.arm.tip().rotation[:, 1],
            math.dist(left, right),
            self._reach_m,
        )


def _push(point: Any) -> Vector:
    """Return what a body feels at a point of contact [N]."""
    force: Vector = point[_FORCE] * np.array(point[_NORMAL])
    for index in (_FRICTION, _OTHER_FRICTION):
        force = force + point[index] * np.array(point[index + 1])
    return force
