"""Centre of mass and moments of inertia of a body of uniform density."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.task.scene import Body
from skillplan.task.shape import Cylinder, Mesh, Shape
from skillplan_pinocchio.kinematics.fixed_order import times


@dataclass(frozen=True, slots=True)
class MassProperties:
    """Mass properties of a body in its own frame.

    Parameters
    ----------
    centre
        Centre of mass [m], shape (3,).
    inertia_kg_m2
        Moments of inertia about the axes through the centre, shape (3,); products are neglected.
    """

    centre: NDArray[np.float64]
    inertia_kg_m2: NDArray[np.float64]

    def at_least(self, inertia_kg_m2: float) -> MassProperties:
        """Return the properties with every moment of inertia raised to a minimum."""
        return MassProperties(self.centre, np.maximum(self.inertia_kg_m2, inertia_kg_m2))


def compute_mass_properties(body: Body) -> MassProperties:
    """Return the mass properties of a body."""
    solids = [_make_solid(shape) for shape in body.shapes]
    volumes = np.array([solid.volume_m3 for solid in solids])
    masses = body.mass_kg * volumes / volumes.sum()
    centre = (
        times(masses[np.newaxis], np.array([solid.centre for solid in solids]))[0] / body.mass_kg
    )
    inertia = np.zeros(3)
    for mass, solid in zip(masses, solids, strict=True):
        apart = solid.centre - centre
        spread = solid.spread_m2 + apart**2
        inertia += mass * (spread.sum() - spread)
    return MassProperties(centre, inertia)


@dataclass(frozen=True, slots=True)
class _Solid:
    """Volume, centre, and mean square distances from it along x, y and z [m2], shape (3,)."""

    volume_m3: float
    centre: NDArray[np.float64]
    spread_m2: NDArray[np.float64]


def _make_solid(shape: Shape) -> _Solid:
    if isinstance(shape, Mesh):
        return _sum_tetrahedra(shape)
    size = np.array(shape.box.size)
    centre = np.array(shape.box.centre)
    if isinstance(shape, Cylinder):
        across_m2 = shape.diameter_m**2 / 16
        spread = np.array([across_m2, across_m2, shape.height_m**2 / 12])
        return _Solid(math.pi / 4 * shape.diameter_m**2 * shape.height_m, centre, spread)
    return _Solid(float(size.prod()), centre, size**2 / 12)


def _sum_tetrahedra(mesh: Mesh) -> _Solid:
    """Sum the signed tetrahedra between the faces and a point."""
    corners = np.array(mesh.corners)
    origin = corners.mean(axis=0)
    faces = corners[np.array(mesh.faces)] - origin
    volumes = (np.cross(faces[:, 0], faces[:, 1]) * faces[:, 2]).sum(axis=1) / 6
    volume = float(volumes.sum())
    sums = faces.sum(axis=1)
    centre = times(volumes[np.newaxis], sums)[0] / (4 * volume)
    spread = sums**2 + (faces**2).sum(axis=1)
    squares = times(volumes[np.newaxis], spread)[0] / (20 * volume)
    return _Solid(volume, origin + centre, squares - centre**2)
