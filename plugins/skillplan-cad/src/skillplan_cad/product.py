"""A product: parts with mesh, faces and mass in one frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import manifold3d

Points = NDArray[np.float64]  # (n, 3)
Triangles = NDArray[np.int64]  # (m, 3) indices of points
Vector = tuple[float, float, float]
Closure = Literal["closed", "mended", "surface"]
FaceKind = Literal["plane", "cylinder", "cone", "sphere", "torus", "free"]
ROUND_KINDS: tuple[FaceKind, ...] = ("cylinder", "cone", "sphere", "torus")
GRAVITY_M_PER_S2 = 9.81
# Decimals of lengths in mesh files [m].
_FILE_DECIMALS = 7


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A face of a part, with its surface from CAD.

    Parameters
    ----------
    kind
        Kind of surface; ``free`` for others and unknown ones.
    triangles
        Indices of the part's triangles on the face.
    origin_m
        A point of the plane or axis, or the centre of a sphere.
    axis
        Unit normal of a plane, or unit vector of the axis.
    radius_m
        Radius of a cylinder, sphere or torus; of a cone at its origin; otherwise 0.
    minor_radius_m
        Minor radius of a torus; otherwise 0.
    half_angle_rad
        Half angle of a cone; otherwise 0.
    extent_m
        Lowest and highest position along the axis, from the origin.
    turn_rad
        Extent around the axis; a full turn is 2 pi.
    hollow
        True if a face of revolution faces its axis, such as the wall of a hole.
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
    """A rigid part in its place in the product.

    Parameters
    ----------
    name
        Unique path below the root, with slashes between assemblies and part; repeated names end in
        ``#2`` and so on.
    path
        Names of the assemblies above it, from the root on.
    vertices_m, triangles
        Mesh in the product's frame: merged vertices, outward triangles.
    volume_m3
        Volume, > 0: exact if CAD gives it, otherwise that of the mesh; of a surface, by its
        thickness or its bounding box.
    shape
        Number of its shape; identical parts share it.
    mirrors
        Number of the shape it mirrors, or None.
    design
        Name of its design, such as ``socket screw M4x10``; empty if unknown.
    closure
        ``closed`` as drawn; ``mended`` with gaps or holes closed, or a surface of stated thickness;
        ``surface`` for another open surface, whose mesh is a thin sheet.
    gap_m
        Largest gap that was closed [m].
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
    closure: Closure = "closed"
    gap_m: float = 0.0

    @property
    def mass_kg(self) -> float:
        """Volume times density."""
        return self.volume_m3 * self.density_kg_m3

    @property
    def bounds_m(self) -> Points:
        """Lowest and highest corner of the bounding box, one per row."""
        return np.stack([self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)])


@dataclass(frozen=True, slots=True, eq=False)
class Product:
    """Parts in one frame.

    Parameters
    ----------
    parts
        Two or more parts, in the order of the file.
    unit
        Unit of the file, such as ``mm``.
    chord_m
        Greatest distance of triangles from the true surface; 0 if unknown.
    notes
        Assumptions and repairs of the reader, one sentence each.
    warnings
        Parts left out and doubts of the reader, one sentence each.
    """

    name: str
    parts: tuple[Part, ...]
    unit: str
    chord_m: float
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Part]:
        return iter(self.parts)

    def __len__(self) -> int:
        return len(self.parts)

    def index(self, name: str) -> int:
        """Return the number of a part by its name.

        Raises
        ------
        KeyError
            If the name is unknown.
        """
        for number, part in enumerate(self.parts):
            if part.name == name:
                return number
        raise KeyError(name)

    def part(self, name: str) -> Part:
        """Return a part by its name.

        Raises
        ------
        KeyError
            If the name is unknown.
        """
        return self.parts[self.index(name)]


def make_solid(vertices_m: Points, triangles: Triangles) -> manifold3d.Manifold:
    """Return a closed mesh as a solid in millimetres; empty if the mesh is not closed."""
    import manifold3d

    return manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(vertices_m * 1e3),
            tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
        )
    )


def read_solid(solid: manifold3d.Manifold) -> tuple[Points, Triangles]:
    """Return the points [mm] and triangles of a solid."""
    mesh64 = solid.to_mesh64()
    points = np.asarray(mesh64.vert_properties, dtype=np.float64)[:, :3]
    return points, np.asarray(mesh64.tri_verts, dtype=np.int64)


def has_proper_edges(vertices_m: Points, triangles: Triangles) -> bool:
    """Return whether each edge lies between two faces once corners are rounded as in a file."""
    _, corner = np.unique(np.round(vertices_m, _FILE_DECIMALS), axis=0, return_inverse=True)
    faces = corner.reshape(-1)[triangles]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0, return_counts=True)
    return bool((counts == 2).all())


def part_touching_corners(vertices_m: Points, triangles: Triangles, gap_m: float) -> Points:
    """Return the corners; coinciding ones are drawn into their bodies by a gap."""
    rounded = np.round(vertices_m, _FILE_DECIMALS)
    _, place, counts = np.unique(rounded, axis=0, return_inverse=True, return_counts=True)
    corners = vertices_m[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = np.zeros_like(vertices_m)
    for column in triangles.T:
        np.add.at(outwards, column, across)
    outwards /= np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-30)
    is_shared = counts[place.reshape(-1)] > 1
    return np.where(is_shared[:, None], vertices_m - gap_m * outwards, vertices_m)


def simplify_mesh(
    vertices_m: Points, triangles: Triangles, error_m: float
) -> tuple[Points, Triangles]:
    """Return a mesh whose bodies are united and whose surface is moved by less than an error.

    The mesh itself if it is not closed.
    """
    import manifold3d

    bodies = make_solid(vertices_m, triangles).decompose()
    whole = manifold3d.Manifold.batch_boolean(bodies, manifold3d.OpType.Add)
    if whole.is_empty():
        return vertices_m, triangles
    return _build_mesh(whole.simplify(error_m * 1e3))


def split_bodies(vertices_m: Points, triangles: Triangles) -> list[tuple[Points, Triangles]]:
    """Return the bodies of a mesh; none if it is not closed, or if one of them is a cavity."""
    bodies = make_solid(vertices_m, triangles).decompose()
    has_cavity = any(body.volume() < 0 for body in bodies)
    return [] if has_cavity else [_build_mesh(body) for body in bodies]


def _build_mesh(solid: manifold3d.Manifold) -> tuple[Points, Triangles]:
    points, triangles = read_solid(solid)
    return points / 1e3, triangles
