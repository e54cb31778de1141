"""Meshes of a file, before and after repair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.collision.surface import cross_rows
from skillplan_cad.product import Face, Points, Triangles, Vector

# Largest number of parts; every pair is tested.
MOST_PARTS = 2_000
# Largest number of triangles of all parts: 2 GB with data derived from them.
MOST_TRIANGLES = 2_000_000


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
    label
        Unique name in the product; empty until it is assigned.
    """

    name: str
    path: tuple[str, ...]
    vertices_m: Points
    triangles: Triangles
    faces: tuple[Face, ...] = ()
    design: str = ""
    label: str = ""


@dataclass(frozen=True, slots=True)
class Measure:
    """Exact volume [m3] and centroid [m] of a body, from CAD."""

    volume_m3: float
    centre_m: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Mended:
    """A part with its mesh repaired as far as possible.

    Parameters
    ----------
    part
        Part with merged vertices and outward triangles.
    open_edges
        Number of edges without a triangle on one side; 0 if the mesh is closed.
    bodies
        Body number of each triangle; cavities belong to their body.
    gap_m
        Largest gap that was closed [m].
    measures
        Exact measures of the bodies; empty if unknown.
    """

    part: RawPart
    open_edges: int
    gap_point_m: NDArray[np.float64]
    bodies: NDArray[np.int64]
    notes: tuple[str, ...] = ()
    gap_m: float = 0.0
    measures: tuple[Measure, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """A shape at one place of the product.

    Parameters
    ----------
    shape
        Number of the shape.
    path
        Names of the root and of the assemblies above it.
    pose
        Matrix from the shape's frame to the product's, shape (4, 4), in metres.
    """

    shape: int
    name: str
    design: str
    path: tuple[str, ...]
    pose: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StepContent:
    """The content of a STEP file.

    Parameters
    ----------
    shapes
        Meshes in their own frames; text instead for one without surface, which gives the reason.
    refused
        Reason why the file is refused; empty if it is not.
    """

    name: str = ""
    shapes: tuple[Mended | str, ...] = ()
    instances: tuple[Instance, ...] = ()
    notes: tuple[str, ...] = ()
    refused: str = ""


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
    warnings
        What the reader left out, one sentence each.
    """

    name: str
    parts: tuple[Mended, ...]
    unit: str
    chord_m: float
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def compute_area_vectors_m2(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the normal of each triangle, scaled to its area."""
    a, b, c = (vertices_m[triangles[:, corner]] for corner in range(3))
    return 0.5 * cross_rows(b - a, c - a)
