"""Surfaces that are painted: triangles, and which way each of their corners faces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Capsule, Hand, Hull, LinkShape
from skillplan.task.shape import Box, Cylinder, Mesh, Shape
from skillplan_pinocchio.shapes import ConvexPiece
from skillplan_simulation.pictures.rasteriser import corner_normals

Corners = NDArray[np.float64]
Triangles = NDArray[np.float32]

# How many corners a circle has, and a quarter of the outline of a ball.
_CIRCLE, _QUARTER = 40, 8
# Where two triangles meet at less than this, their edge is not seen (its cosine).
_SMOOTH = float(np.cos(np.radians(38.0)))


@dataclass(frozen=True, slots=True)
class Surface:
    """A surface in the frame of what it belongs to.

    Parameters
    ----------
    corners
        Of its triangles, anticlockwise from outside [m], shape (n, 3, 3).
    normals
        Of every corner, shape (n, 3, 3).
    """

    corners: Triangles
    normals: Triangles

    @property
    def middle(self) -> Corners:
        """The middle of the box about it [m], shape (3,)."""
        points = self.corners.reshape(-1, 3).astype(np.float64)
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


def body_surface(shapes: Iterable[Shape]) -> Surface:
    """Return the surface of the shapes of a body."""
    return _surface([_of_shape(shape) for shape in shapes])


def link_surface(shapes: Iterable[LinkShape]) -> Surface:
    """Return the surface of the shapes of a link."""
    return _surface([_of_link(shape) for shape in shapes])


def hand_surface(hand: Hand) -> Surface:
    """Return the surface of the body of a hand, from the tip."""
    # The first piece is the body as it is described.
    corners = [(across, along, deep - hand.tip_m) for along, across, deep in hand.body[0]]
    return _surface([_hull(corners)])


def finger_surface(hand: Hand, side: int) -> Surface:
    """Return the surface of a jaw where it is closed, from the tip; its side is 1 or -1."""
    corners = [(across, side * behind, -up) for behind, across, up in hand.jaw]
    return _surface([_hull(corners)])


def _surface(found: Sequence[Corners]) -> Surface:
    corners = np.concatenate([np.zeros((0, 3, 3)), *found])
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(across, axis=1)
    corners, across = corners[size > 0.0], across[size > 0.0]
    _, places = np.unique(np.round(corners.reshape(-1, 3), 7), axis=0, return_inverse=True)
    places = np.asarray(places, dtype=np.int64).ravel()
    order = np.argsort(places, kind="stable")
    normals = corner_normals(across, places, order, _SMOOTH)
    return Surface(corners.astype(np.float32), normals.reshape(-1, 3, 3).astype(np.float32))


def _of_shape(shape: Shape) -> Corners:
    if isinstance(shape, Mesh) and shape.faces:
        return np.asarray(np.array(shape.corners)[np.array(shape.faces)])
    if isinstance(shape, Mesh):
        return _hull(shape.corners)
    if isinstance(shape, Cylinder):
        x, y, z = shape.centre
        half = shape.height_m / 2
        return _round((x, y, z - half), (x, y, z + half), shape.diameter_m / 2, domed=False)
    return _box(shape)


def _of_link(shape: LinkShape) -> Corners:
    if isinstance(shape, Hull):
        return _hull(shape.corners_m)
    domed = isinstance(shape, Capsule)
    return _round(shape.start_m, shape.end_m, shape.radius_m, domed=domed)


def _box(box: Box) -> Corners:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return _hull((np.array(box.centre) + signs * np.array(box.size) / 2).tolist())


def _hull(points: Sequence[Sequence[float]]) -> Corners:
    """Return the triangles of the hull of some points."""
    corners, triangles = ConvexPiece(np.array(points, dtype=np.float64)).surface
    found = corners[triangles]
    # Whatever the order of a triangle's corners, it is seen from without.
    across = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    away = found.mean(axis=1) - corners.mean(axis=0)
    inward = np.einsum("ij,ij->i", across, away) < 0.0
    found[inward] = found[inward][:, ::-1]
    return np.asarray(found)


def _round(
    start_m: Sequence[float], end_m: Sequence[float], radius_m: float, *, domed: bool
) -> Corners:
    """Return the triangles of a cylinder between two points, or of a capsule about them."""
    start, end = np.array(start_m), np.array(end_m)
    length_m = float(np.linalg.norm(end - start))
    axis = (end - start) / length_m if length_m > 0.0 else np.array((0.0, 0.0, 1.0))
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    # Rings from end to end: how far along the axis, and how wide.
    if domed:
        turns = np.linspace(0.0, np.pi / 2, _QUARTER + 1)
        ends = [(-radius_m * np.cos(turn), radius_m * np.sin(turn)) for turn in turns]
        rings = ends + [(length_m - along, wide) for along, wide in ends[::-1]]
    else:
        rings = [(0.0, 0.0), (0.0, radius_m), (length_m, radius_m), (length_m, 0.0)]
    angles = np.arange(_CIRCLE) * 2 * np.pi / _CIRCLE
    about = np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * other
    points = np.array([start + along * axis + wide * about for along, wide in rings])
    after = np.roll(points, -1, axis=1)
    low = np.stack([points[:-1], after[:-1], after[1:]], axis=2)
    high = np.stack([points[:-1], after[1:], points[1:]], axis=2)
    return np.concatenate([low.reshape(-1, 3, 3), high.reshape(-1, 3, 3)])
