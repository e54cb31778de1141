"""What bodies are made of: boxes, upright cylinders and convex meshes, in the body's frame.

The body's frame begins at the centre of its bottom, z up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from skillplan.task.motion import Point


@dataclass(frozen=True, slots=True)
class Box:
    """A box of a body.

    Parameters
    ----------
    size
        Extents along x, y and z [m], each > 0.
    centre
        Position of its centre in the body's frame [m].

    Raises
    ------
    ValueError
        If an extent is not positive.
    """

    size: Point
    centre: Point

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) and value > 0 for value in self.size):
            raise ValueError(f"Box extents must be > 0, not {self.size}.")

    @property
    def box(self) -> Box:
        """The box itself, as the smallest upright box about it."""
        return self


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder of a body.

    Parameters
    ----------
    diameter_m, height_m
        Each > 0 [m].
    centre
        Position of its centre in the body's frame [m].

    Raises
    ------
    ValueError
        If diameter or height is not positive.
    """

    diameter_m: float
    height_m: float
    centre: Point

    def __post_init__(self) -> None:
        for name in ("diameter_m", "height_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"Cylinder {name} must be > 0, not {value}.")

    @property
    def box(self) -> Box:
        """The smallest upright box about it."""
        return Box((self.diameter_m, self.diameter_m, self.height_m), self.centre)


@dataclass(frozen=True, slots=True)
class Mesh:
    """A convex polyhedron of a body, given by its corners.

    Parameters
    ----------
    corners
        At least four points in the body's frame [m], not in one plane.

    Raises
    ------
    ValueError
        If there are too few corners, a number is not finite, or an extent is zero.
    """

    corners: tuple[Point, ...]

    def __post_init__(self) -> None:
        if len(self.corners) < 4:
            raise ValueError(f"Mesh needs at least 4 corners, not {len(self.corners)}.")
        if not all(math.isfinite(value) for corner in self.corners for value in corner):
            raise ValueError("Mesh corners must be finite.")
        if not all(high > low for low, high in zip(*self._bounds(), strict=True)):
            raise ValueError("Mesh must have an extent along every axis.")

    @property
    def box(self) -> Box:
        """The smallest upright box about it."""
        (x0, y0, z0), (x1, y1, z1) = self._bounds()
        return Box((x1 - x0, y1 - y0, z1 - z0), ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2))

    def _bounds(self) -> tuple[Point, Point]:
        xs, ys, zs = zip(*self.corners, strict=True)
        return (min(xs), min(ys), min(zs)), (max(xs), max(ys), max(zs))


Shape = Box | Cylinder | Mesh
