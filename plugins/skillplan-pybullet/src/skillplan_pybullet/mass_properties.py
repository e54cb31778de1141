"""Centre of mass and moments of inertia of a body whose mass is spread evenly over its shapes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.task.scene import Body
from skillplan.task.shape import Box, Cylinder, Shape


@dataclass(frozen=True, slots=True)
class MassProperties:
    """Of a body, in its own frame.

    Parameters
    ----------
    centre
        Centre of mass [m], shape (3,).
    inertia_kg_m2
        Moments of inertia about the axes through it, shape (3,); products are left out.
    """

    centre: NDArray[np.float64]
    inertia_kg_m2: NDArray[np.float64]

    def at_least(self, inertia_kg_m2: float) -> MassProperties:
        """Return them with no moment of inertia below a limit."""
        return MassProperties(self.centre, np.maximum(self.inertia_kg_m2, inertia_kg_m2))


def mass_properties(body: Body) -> MassProperties:
    """Return where the mass of a body is; meshes count as the boxes about them."""
    volumes = np.array([_volume_m3(shape) for shape in body.shapes])
    masses = body.mass_kg * volumes / volumes.sum()
    centres = np.array([shape.box.centre for shape in body.shapes])
    centre = masses @ centres / body.mass_kg
    inertia = np.zeros(3)
    for mass, shape, own in zip(masses, body.shapes, centres, strict=True):
        apart = own - centre
        inertia += mass * (_unit_inertia_m2(shape) + apart @ apart - apart**2)
    return MassProperties(centre, inertia)


def _volume_m3(shape: Shape) -> float:
    if isinstance(shape, Cylinder):
        return math.pi / 4 * shape.diameter_m**2 * shape.height_m
    return math.prod(shape.box.size)


def _unit_inertia_m2(shape: Shape) -> NDArray[np.float64]:
    """Return the moments of inertia about the shape's own centre, by its mass."""
    if isinstance(shape, Cylinder):
        across = (3 * (shape.diameter_m / 2) ** 2 + shape.height_m**2) / 12
        return np.array([across, across, shape.diameter_m**2 / 8])
    box: Box = shape.box
    x_m, y_m, z_m = box.size
    return np.array([y_m**2 + z_m**2, x_m**2 + z_m**2, x_m**2 + y_m**2]) / 12
