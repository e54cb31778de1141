"""Closed triangulated surfaces in the world: of turned shapes, and of meshes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from skillplan.task.pose import Pose
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Sides of the prism about a cylinder that lies or leans: it stands out by 0.03 % of the radius at
# most, and not at all where it is lowest.
_SIDES = 128
# Of the normal of a wall, by its upright part.
_UPRIGHT = 1e-6
_CORNERS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float) / 2
_BOX_FACES = np.array(
    [
        (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
        (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5),
    ]
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A closed surface of triangles.

    Parameters
    ----------
    corners
        In the world [m], shape (corners, 3).
    faces
        Three indices of corners each, anticlockwise from outside, shape (faces, 3).
    flat
        Of every face, whether it stands for a plane and not for a part of a curve.
    convex
        Whether it is.
    """

    corners: Floats
    faces: Indices
    flat: npt.NDArray[np.bool_]
    convex: bool = True

    @cached_property
    def triangles(self) -> Floats:
        """Corners of its faces [m], shape (faces, 3, 3)."""
        return np.asarray(self.corners[self.faces])

    @cached_property
    def normals(self) -> Floats:
        """Outward unit normals of its faces, shape (faces, 3); zero of what has no area."""
        a, b, c = (self.triangles[:, i] for i in range(3))
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.where(lengths > 0, lengths, 1.0))

    @cached_property
    def upper(self) -> npt.NDArray[np.intp]:
        """Indices of the faces that look up."""
        return np.flatnonzero(self.normals[:, 2] > _UPRIGHT)

    @cached_property
    def lower(self) -> npt.NDArray[np.intp]:
        """Indices of the faces that look down."""
        return np.flatnonzero(self.normals[:, 2] < -_UPRIGHT)

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """Outward normals of its faces and how far they are from the origin [m], each once."""
        sound = np.abs(self.normals).max(axis=1) > 0
        normals = self.normals[sound]
        offsets = np.einsum("ij,ij->i", normals, self.triangles[sound, 0])
        known = np.round(np.column_stack([normals, offsets]), 9)
        _, first = np.unique(known, axis=0, return_index=True)
        return np.asarray(normals[first]), np.asarray(offsets[first])

    def edges_of(self, faces: npt.NDArray[np.intp]) -> Floats:
        """Return the ends of all edges of some faces [m], each once, shape (edges, 2, 3)."""
        chosen = self.faces[faces]
        pairs = np.concatenate([chosen[:, [0, 1]], chosen[:, [1, 2]], chosen[:, [2, 0]]])
        # Numbers are told apart far quicker than rows.
        count = len(self.corners)
        numbers = np.unique(pairs.min(axis=1) * count + pairs.max(axis=1))
        return np.asarray(self.corners[np.stack(np.divmod(numbers, count), axis=1)])

    @cached_property
    def edges(self) -> Floats:
        """Ends of its edges [m], without those between faces of one plane, (edges, 2, 3)."""
        sides = np.concatenate(
            [self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]
        )
        owners = np.tile(np.arange(len(self.faces)), 3)
        pairs, index = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
        total = np.zeros((len(pairs), 3))
        np.add.at(total, index.reshape(-1), self.normals[owners])
        # The normals of two faces of one plane add up to the length 2.
        return np.asarray(self.corners[pairs[np.linalg.norm(total, axis=1) < 2 - 1e-12]])

    def narrowed(self, by_m: float) -> Polyhedron:
        """Return it with every wall shifted inwards in the plane by a length [m].

        Of a slope, too, by as much in the plane; to first order, where more than three faces meet.
        """
        flat = self.normals[:, :2]
        lengths = np.linalg.norm(flat, axis=1)
        walls = lengths > _UPRIGHT
        across = flat[walls] / lengths[walls, None]
        count = len(self.corners)
        matrix, vector = np.zeros((count, 2, 2)), np.zeros((count, 2))
        for i in range(3):
            np.add.at(matrix, self.faces[walls, i], across[:, :, None] * across[:, None, :])
            np.add.at(vector, self.faces[walls, i], across)
        shift = -by_m * np.einsum("ijk,ik->ij", np.linalg.pinv(matrix, rcond=1e-6), vector)
        length = np.linalg.norm(shift, axis=1, keepdims=True)
        shift *= np.minimum(1.0, 4 * by_m / np.maximum(length, by_m))
        moved = self.corners.copy()
        moved[:, :2] += shift
        return Polyhedron(moved, self.faces, self.flat, self.convex)


def polyhedron_of(shape: Shape, pose: Pose) -> Polyhedron:
    """Return the surface of a shape at a pose."""
    rotation = np.array(pose.rotation)
    if isinstance(shape, Box):
        corners, faces = _CORNERS * np.array(shape.size) + np.array(shape.centre), _BOX_FACES
        flat = np.ones(len(faces), dtype=bool)
    elif isinstance(shape, Cylinder):
        corners, faces, flat = _prism(shape, rotation[2])
    else:
        corners, faces = np.array(shape.corners, dtype=float), np.array(shape.faces)
        flat = np.ones(len(faces), dtype=bool)
    convex = not isinstance(shape, Mesh) or shape.convex
    return Polyhedron(corners @ rotation.T + np.array(pose.position), faces, flat, convex)


def _prism(cylinder: Cylinder, up: Floats) -> tuple[Floats, Indices, npt.NDArray[np.bool_]]:
    """Return the prism about a cylinder with the middle of a side where it is lowest.

    Parameters
    ----------
    cylinder
        In the frame of its body.
    up
        The vertical of the world in that frame.
    """
    step = 2 * math.pi / _SIDES
    angles = math.atan2(up[1], up[0]) + step * (np.arange(_SIDES) + 0.5)
    radius_m = cylinder.diameter_m / 2 / math.cos(step / 2)
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) * radius_m
    half_m = cylinder.height_m / 2
    corners = np.concatenate(
        [
            np.column_stack([ring, np.full(_SIDES, -half_m)]),
            np.column_stack([ring, np.full(_SIDES, half_m)]),
        ]
    ) + np.array(cylinder.centre)
    here, there = np.arange(_SIDES), (np.arange(_SIDES) + 1) % _SIDES
    sides = np.concatenate(
        [
            np.column_stack([here, there, there + _SIDES]),
            np.column_stack([here, there + _SIDES, here + _SIDES]),
        ]
    )
    fan = np.arange(1, _SIDES - 1)
    zeros = np.zeros_like(fan)
    ends = np.concatenate(
        [
            np.column_stack([zeros, fan + 1, fan]),
            np.column_stack([zeros, fan, fan + 1]) + _SIDES,
        ]
    )
    faces = np.concatenate([sides, ends])
    return corners, faces, np.arange(len(faces)) >= len(sides)
