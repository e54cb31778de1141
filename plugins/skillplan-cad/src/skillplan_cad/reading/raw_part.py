"""Meshes as they stand in a file, before repair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Face, Points, Triangles

# Largest number of parts; every pair is tested.
MOST_PARTS = 2_000


@dataclass(frozen=True, slots=True, eq=False)
class RawPart:
    """A mesh of a file.

    Parameters
    ----------
    name
        Name in the file; may repeat.
    path
        Names of the assemblies above it.
    vertices_m, triangles
        Mesh in the product's frame.
    faces
        CAD faces with indices into `triangles`; empty for plain meshes.
    design
        Name of its design; empty if unknown.
    """

    name: str
    path: tuple[str, ...]
    vertices_m: Points
    triangles: Triangles
    faces: tuple[Face, ...] = ()
    design: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class RawProduct:
    """The content of a file or folder.

    Parameters
    ----------
    parts
        Parts in the order of the file.
    chord_m
        Greatest distance of triangles from the true surface; 0 if unknown.
    notes
        Remarks of the reader, one sentence each.
    """

    name: str
    parts: tuple[RawPart, ...]
    unit: str
    chord_m: float
    notes: tuple[str, ...] = ()


def compute_area_vectors_m2(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the normal of each triangle, scaled to its area."""
    a, b, c = (vertices_m[triangles[:, corner]] for corner in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))
