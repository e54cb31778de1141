"""What a format hands over: meshes as they stand in the file, before anything is mended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Face, Points, Triangles

# Of one product: every pair of parts is tested.
MOST_PARTS = 2_000


@dataclass(frozen=True, slots=True, eq=False)
class RawPart:
    """A mesh of a file.

    Parameters
    ----------
    name
        In the file; it may repeat.
    path
        Names of the assemblies above it.
    vertices_m, triangles
        In the product's frame.
    faces
        What CAD says of its faces; triangles as in `triangles`. Empty for files of mere meshes.
    design
        Name of what it is an instance of; empty where the file tells none apart.
    """

    name: str
    path: tuple[str, ...]
    vertices_m: Points
    triangles: Triangles
    faces: tuple[Face, ...] = ()
    design: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class RawProduct:
    """What a file or folder holds.

    Parameters
    ----------
    name
        Of the product.
    parts
        In the order of the file.
    unit
        Of the file.
    chord_m
        How far triangles may lie from the surface; 0 where nobody knows.
    notes
        A sentence each.
    """

    name: str
    parts: tuple[RawPart, ...]
    unit: str
    chord_m: float
    notes: tuple[str, ...] = ()


def area_vectors_m2(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return for every triangle its normal, as long as its area."""
    a, b, c = (vertices_m[triangles[:, corner]] for corner in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))
