"""A product as it was read: its parts, each with a mesh in the product's frame, faces and mass."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]  # (n, 3)
Triangles = NDArray[np.int64]  # (m, 3) indices of points
Vector = tuple[float, float, float]
FaceKind = Literal["plane", "cylinder", "cone", "sphere", "torus", "free"]


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """One face of a part's boundary, with what CAD says of its surface.

    Parameters
    ----------
    kind
        ``free`` where the surface has no such form, or none is known.
    triangles
        Indices of those of the part's triangles that lie on it.
    origin_m
        A point of the plane or axis, or the centre of a sphere.
    axis
        Unit vector: the normal of a plane, else the axis.
    radius_m
        Of a cylinder, sphere or torus; of a cone at its origin; 0 for what has none.
    minor_radius_m
        Of a torus; 0 else.
    half_angle_rad
        Of a cone; 0 else.
    extent_m
        Least and greatest position along the axis, from the origin on.
    turn_rad
        How far round the axis it reaches; a whole turn is 2 pi.
    hollow
        Whether a face of revolution looks at its axis, as a hole's does.
    """

    kind: FaceKind
    triangles: NDArray[np.int64]
    origin_m: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 0.0, 1.0)
    radius_m: float = 0.0
    minor_radius_m: float = 0.0
    half_angle_rad: float = 0.0
    extent_m: tuple[float, float] = (0.0, 0.0)
    turn_rad: float = 0.0
    hollow: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One rigid part where it stands in the assembled product.

    Parameters
    ----------
    name
        Unique in the product: the names of the assemblies that it stands in below the root, and
        its own, with slashes between; ``#2`` and so on ends the name of what would repeat one.
    path
        Names of the assemblies that it stands in, from the root of the tree on, without its own.
    vertices_m, triangles
        Its mesh in the product's frame: merged vertices, triangles that look outwards.
    faces
        Faces of its boundary.
    volume_m3
        What the mesh encloses; positive.
    density_kg_m3
        Of its material.
    centre_m
        Its centre of mass.
    shape
        Number of its shape: parts of one number are identical.
    mirrors
        Number of the shape that its own is the mirror image of; None where there is none.
    bodies
        How many bodies it consists of.
    design
        Name of what it is an instance of, such as ``socket screw M4x10``; empty where the file
        tells none apart.
    """

    name: str
    path: tuple[str, ...]
    vertices_m: Points
    triangles: Triangles
    faces: tuple[Face, ...]
    volume_m3: float
    density_kg_m3: float
    centre_m: Vector
    shape: int
    mirrors: int | None = None
    bodies: int = 1
    design: str = ""

    @property
    def mass_kg(self) -> float:
        """Volume by density."""
        return self.volume_m3 * self.density_kg_m3

    @property
    def bounds_m(self) -> Points:
        """The least and the greatest corner of its box, one a row."""
        return np.stack([self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)])


@dataclass(frozen=True, slots=True, eq=False)
class Product:
    """Parts in one frame.

    Parameters
    ----------
    name
        Of the product, as the file says.
    parts
        In the order of the file; at least two.
    unit
        Of the file, such as ``mm``.
    chord_m
        How far triangles may lie from the surface that they stand for; 0 where that is unknown.
    notes
        What was assumed or mended when it was read, a sentence each.
    """

    name: str
    parts: tuple[Part, ...]
    unit: str
    chord_m: float
    notes: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Part]:
        return iter(self.parts)

    def __len__(self) -> int:
        return len(self.parts)

    def index(self, name: str) -> int:
        """Return the number of the part of a name.

        Raises
        ------
        KeyError
            If there is none.
        """
        for number, part in enumerate(self.parts):
            if part.name == name:
                return number
        raise KeyError(name)

    def identical(self, part: Part) -> tuple[str, ...]:
        """Return the names of the other parts of the same shape."""
        return tuple(one.name for one in self.parts if one.shape == part.shape and one is not part)
