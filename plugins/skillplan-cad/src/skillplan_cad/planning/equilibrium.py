"""Decide whether a released part stays in place, by the contacts of the true meshes.

`skillplan.collision.decide_standing` has the forces. Here contacts get their points and normals:
those of the surfaces that CAD states, not of their chords.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.collision.contact_forces import BEARS, select_spread
from skillplan.collision.standing import Touch, Weight, decide_standing
from skillplan_cad.planning.precedence import encode_set
from skillplan_cad.product import ROUND_KINDS, Face, Part, Product, Vector
from skillplan_cad.relation import Contact, Relation

Array = NDArray[np.float64]

_NEAR_M = 2e-4
# Friction without which a part only leans: the next move would drag it along [-].
_LEANS = 0.05
# Names in the program; part names have no blanks at their ends.
_PART, _TABLE = " part", " table"


class Equilibrium:
    """Decides which parts stay on others that stand firm, for any set of those."""

    def __init__(self, product: Product, relation: Relation) -> None:
        self._parts = {relation.index(part.name): part for part in product}
        self._relation = relation
        self._contacts: list[Contact] = []
        self._pushes: dict[int, tuple[Array, Array]] = {}
        # For each part the parts that it touches, with the number of the contact and the sign of
        # its normals.
        self._touching: list[list[tuple[int, int, float]]] = [[] for _ in relation.parts]
        for contact in relation.contacts:
            first, second = (relation.index(name) for name in contact.parts)
            if contact.kind == "thread" or not {first, second} <= self._parts.keys():
                continue
            if contact.points_m:
                self._contacts.append(contact)
                self._touching[first].append((second, len(self._contacts) - 1, -1.0))
                self._touching[second].append((first, len(self._contacts) - 1, 1.0))
        self._known: dict[tuple[int, int, Vector, bytes | None], bool] = {}
        self._touched = [
            encode_set([other for other, _, _ in touching]) for touching in self._touching
        ]

    def stays(self, part: int, others: int, up: Vector, foot_m: Array | None = None) -> bool:
        """Return whether a part stays on others.

        Parameters
        ----------
        others
            Parts that stand firm, as bits.
        foot_m
            Points of level faces on which the part stands; None without one.
        """
        feet = None if foot_m is None else foot_m.tobytes()
        key = (part, others & self._touched[part], up, feet)
        if key not in self._known:
            self._known[key] = self._has_forces(part, others, np.asarray(up), foot_m)
        return self._known[key]

    def list_bearers(self, part: int, others: int, up: Vector) -> list[int]:
        """Return the others that push a part upwards."""
        return [
            other
            for other, _, normals in self._list_pushes(part, others)
            if (normals @ np.asarray(up) > BEARS).any()
        ]

    def _list_pushes(self, part: int, others: int) -> list[tuple[int, Array, Array]]:
        """Return the others that touch a part, with the points and the directions of the pushes."""
        pushes = []
        for other, number, sign in self._touching[part]:
            if others >> other & 1:
                if number not in self._pushes:
                    contact = self._contacts[number]
                    first, second = (self._relation.index(name) for name in contact.parts)
                    pair = self._parts[first], self._parts[second]
                    self._pushes[number] = _find_pushes(contact, *pair)
                points, normals = self._pushes[number]
                pushes.append((other, points, sign * normals))
        return pushes

    def _has_forces(self, part: int, others: int, up: Array, foot_m: Array | None) -> bool:
        # Faces above do not hold it: with the play of a fit it tips before it meets them.
        touches = [
            Touch(_PART, self._relation.names[other], points[bears], normals[bears])
            for other, points, normals in self._list_pushes(part, others)
            for bears in (normals @ up > -BEARS,)
        ]
        if foot_m is not None and len(foot_m):
            upwards = np.tile(up, (len(foot_m), 1))
            chosen = select_spread(foot_m, upwards)
            touches.append(Touch(_PART, _TABLE, foot_m[chosen], upwards[chosen]))
        if not any((touch.normals @ up > BEARS).any() for touch in touches):
            return False
        x, y, z = self._parts[part].centre_m
        extent_m = float(np.ptp(self._parts[part].vertices_m, axis=0).max())
        weights, up_at = {_PART: Weight(1.0, (x, y, z), extent_m)}, (up[0], up[1], up[2])
        return (
            decide_standing(weights, touches, up=up_at, friction=_LEANS, tilt_deg=0).stands
            and decide_standing(weights, touches, up=up_at).stands
        )


def _find_pushes(contact: Contact, first: Part, second: Part) -> tuple[Array, Array]:
    """Return points of a contact, and the outward normals of the first part there."""
    everywhere = np.array(contact.points_m).reshape(-1, 3)
    if not len(everywhere):
        return everywhere, everywhere
    mine, theirs = _Surface(first, everywhere), _Surface(second, everywhere)
    listed = np.array(contact.normals).reshape(-1, 3)
    points, normals = [], []
    for point in everywhere:
        own, other = mine.find(point, listed), theirs.find(point, -listed)
        if own is None and other is None:
            continue
        normal, face = own if own is not None else (-other[0], None)  # type: ignore[index]
        round_face, flat = face, other
        if face is None or face.kind not in ROUND_KINDS:
            round_face, flat = (None if other is None else other[1]), own
        is_convex = (
            round_face is not None and round_face.kind in ROUND_KINDS and not round_face.hollow
        )
        is_flat = flat is None or flat[1] is None or flat[1].kind not in ROUND_KINDS
        if round_face is not None and is_convex and is_flat:
            # A round face meets a flat one in its tangent line only: chords would keep it upright.
            level = normal if flat is None else (flat[0] if flat is own else -flat[0])
            moved = _move_to_tangent(point, level, round_face)
            if moved is None:
                continue
            point, normal = moved, level
        points.append(point)
        normals.append(normal)
    chosen = select_spread(np.array(points).reshape(-1, 3), np.array(normals).reshape(-1, 3))
    return np.array(points).reshape(-1, 3)[chosen], np.array(normals).reshape(-1, 3)[chosen]


class _Surface:
    """The triangles of a part near some points.

    Parameters
    ----------
    near
        Points, shape (points, 3) [m].
    """

    def __init__(self, part: Part, near: Array) -> None:
        corners = part.vertices_m[part.triangles]
        low, high = near.min(axis=0) - _NEAR_M, near.max(axis=0) + _NEAR_M
        close = (corners.max(axis=1) >= low).all(axis=1) & (corners.min(axis=1) <= high).all(axis=1)
        numbers = np.flatnonzero(close)
        self._corners = corners[numbers]
        normals = np.cross(
            self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0]
        )
        lengths = np.linalg.norm(normals, axis=1)
        self._normals = normals / np.maximum(lengths, 1e-30)[:, None]
        sides = np.roll(self._corners, -1, axis=1) - self._corners
        inwards = np.cross(self._normals[:, None], sides)
        lengths = np.linalg.norm(inwards, axis=2)
        self._inwards = inwards / np.maximum(lengths, 1e-30)[..., None]
        face_of = np.full(len(part.triangles), -1)
        for number, face in enumerate(part.faces):
            face_of[face.triangles] = number
        self._faces, self._face_of = part.faces, face_of[numbers]

    def find(self, point: Array, listed: Array) -> tuple[Array, Face | None] | None:
        """Return the outward normal and the face at a point that fits listed normals best."""
        offsets = point - self._corners[:, 0]
        heights = np.einsum("ij,ij->i", offsets, self._normals)
        near = np.flatnonzero(np.abs(heights) < _NEAR_M)
        inside = near[self._mask_over(near, point)].tolist()
        if not inside:
            return None
        alike = (self._normals[inside] @ listed.T).max(axis=1) if len(listed) else np.ones(1)
        # Heights decide between faces that fit equally well.
        best = inside[int(np.lexsort((np.abs(heights[inside]), -np.round(alike, 2)))[0])]
        face = self._faces[self._face_of[best]] if self._face_of[best] >= 0 else None
        return self._find_normal(best, point, face), face

    def _mask_over(self, numbers: NDArray[np.int64], point: Array) -> NDArray[np.bool_]:
        """Return a mask of the triangles that a point lies over, or within the tolerance of."""
        corners, inwards = self._corners[numbers], self._inwards[numbers]
        distances = np.einsum("ijk,ijk->ij", point - corners, inwards)
        return np.asarray((distances >= -_NEAR_M).all(axis=1))

    def _find_normal(self, number: int, point: Array, face: Face | None) -> Array:
        normal = self._normals[number]
        if face is None or face.kind != "cylinder":
            return np.asarray(normal)
        axis = np.asarray(face.axis)
        radial = point - np.asarray(face.origin_m)
        radial = radial - (radial @ axis) * axis
        length = float(np.linalg.norm(radial))
        if length < 1e-9:
            return np.asarray(normal)
        return np.asarray(radial / length * np.sign(radial @ normal or 1.0))


def _move_to_tangent(point: Array, normal: Array, face: Face) -> Array | None:
    """Return the point of a flat face's contact with a round one nearest to a point, or None."""
    offset = point - np.asarray(face.origin_m)
    beside = offset - (offset @ normal) * normal
    if face.kind == "sphere":
        return np.asarray(point - beside)
    axis = np.asarray(face.axis)
    if face.kind == "cylinder" and abs(float(axis @ normal)) < BEARS:
        return np.asarray(point - (beside - (beside @ axis) * axis))
    return None
