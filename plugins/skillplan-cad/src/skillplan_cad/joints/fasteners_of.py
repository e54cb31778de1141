"""Screws, nuts, washers and pins of a product: by name, or by what they are made like.

A cylinder in a hole is not enough: shafts, plugs and sleeves are that, too. Without a name, a
screw has a head or a tapped hole, and a drive or a thread besides.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.joints.cylinder_fits import CylinderFit
from skillplan_cad.joints.turned_shape import TurnedShape, turned_shape
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.relation import Contact, Fastener, PartKind

Floats = NDArray[np.float64]

_WORDS: tuple[tuple[PartKind, str], ...] = (
    ("washer", r"washers?|scheiben?|rondelles?|din ?(125|127|433|9021)|iso ?(7089|7090|7093)"),
    ("nut", r"(hex)?nuts?|muttern?|ecrous?|din ?(934|985|439)|iso ?(4032|4035|10511)"),
    ("pin", r"(dowel|taper|spring|roll|cotter|clevis)[ _-]?pins?|zylinderstifte?|din ?(7|6325)|"
     r"iso ?(2338|8734|8735)"),
    ("screw", r"screws?|bolts?|shcs|bhcs|fhcs|[a-z]*schrauben?|vis|setscrews?|grubscrews?|"
     r"m\d+(\.\d+)?( ?x ?\d+(\.\d+)?)+|din ?(84|912|913|916|931|933|963|965|7984|7991)|"
     r"iso ?(1207|2009|4014|4017|4026|4029|4762|7045|7046|7380|10642)"),
)  # fmt: skip
# A head is wider than the shank by this, and no more than that; a shank is as long as this share
# of its diameter at least.
_HEAD, _WIDEST_HEAD, _LEAST_SHANK = 1.25, 3.5, 0.8
# A hole grips a shank that is wider than itself by this share of the radius at least.
_TAPPED = 0.02
_THIN_WASHER = 1.0
_FLAT = 0.999


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    number: int
    part: Part
    shape: TurnedShape
    named: PartKind | None
    fits: tuple[CylinderFit, ...]


def fasteners_of(
    product: Product,
    fits: Sequence[CylinderFit],
    contacts: Sequence[Contact],
    tolerance_m: float,
) -> tuple[Fastener, ...]:
    """Return the fasteners of a product, in the order of its parts.

    Parameters
    ----------
    product
        The product.
    fits
        Cylinders in holes.
    contacts
        What touches.
    tolerance_m
        How much wider a hole may be that still grips.
    """
    candidates = []
    for number, part in enumerate(product.parts):
        shape = turned_shape(part)
        if shape is not None:
            own = tuple(one for one in fits if one.inner == number)
            candidates.append(_Candidate(number, part, shape, _named(part), own))
    made: dict[int, Fastener] = {}
    for one in candidates:
        by = _screw_by(one)
        if by:
            made[one.number] = _screw(product, one, contacts, by, tolerance_m)
    screws = dict(made)
    for one in candidates:
        if one.number not in made:
            other = _ring(product, one, screws, contacts)
            if other is not None:
                made[one.number] = other
    return tuple(_with_nuts(product, made[number], made, contacts) for number in sorted(made))


def _named(part: Part) -> PartKind | None:
    """Return what a part is by its own name or that of its design."""
    for text in (part.name.rpartition("/")[2], part.design):
        words = re.sub(r"([a-z])([A-Z])|[_\-]+", r"\1 \2", text)
        for kind, pattern in _WORDS:
            if re.search(rf"(?<![a-z0-9])({pattern})(?![a-z])", words.lower()):
                return kind
    return None


def _screw_by(one: _Candidate) -> tuple[str, ...]:
    """Return by what a candidate is a screw or pin; empty if it is none."""
    shape = one.shape
    if one.named in ("screw", "pin"):
        return ("name",)
    if (
        one.named is not None
        or shape.is_ring
        or shape.shank_length_m < _LEAST_SHANK * 2 * shape.shank.radius_m
    ):
        return ()
    head = _HEAD <= shape.wide_share <= _WIDEST_HEAD
    drive = shape.inner_planes in (2, 4, 6) or (head and shape.outer_planes == 6)
    tapped = any(
        fit.radius_difference_m < -_TAPPED * fit.shaft.radius_m
        and _same_line(shape, np.asarray(fit.shaft.axis), np.asarray(fit.shaft.origin_m))
        for fit in one.fits
    )
    threaded = _is_threaded(one.part, shape)
    found = tuple(
        word
        for word, holds in (
            ("head", head),
            ("drive", drive),
            ("thread", threaded),
            ("tapped hole", tapped),
        )
        if holds
    )
    enough = (head and (drive or threaded or tapped)) or (drive and (threaded or tapped))
    gripped = any(_same_line_fit(shape, fit) for fit in one.fits) or threaded
    return found if enough and gripped else ()


def _is_threaded(part: Part, shape: TurnedShape) -> bool:
    """Whether much of the surface about the axis is neither flat nor a cylinder, as a helix is."""
    area = free = 0.0
    corners = part.vertices_m[part.triangles]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    apart = corners.mean(axis=1) - shape.origin_m
    along = apart @ shape.axis
    on_shank = along < shape.low_m + shape.shank_length_m
    for face in part.faces:
        own = face.triangles[on_shank[face.triangles]]
        area += float(areas[own].sum())
        if face.kind == "free":
            free += float(areas[own].sum())
    return area > 0 and free > 0.3 * area


def _screw(
    product: Product,
    one: _Candidate,
    contacts: Sequence[Contact],
    by: tuple[str, ...],
    tolerance_m: float,
) -> Fastener:
    shape, name = one.shape, one.part.name
    places: dict[str, float] = {}
    gripping: dict[str, float] = {}
    for fit in one.fits:
        if not _same_line_fit(shape, fit):
            continue
        other = product.parts[fit.outer].name
        middle = sum(fit.shared_m) / 2
        point = np.asarray(fit.shaft.origin_m) + middle * np.asarray(fit.shaft.axis)
        place = float((point - shape.origin_m) @ shape.axis)
        places[other] = max(place, places.get(other, -np.inf))
        if fit.radius_difference_m <= max(_TAPPED * fit.shaft.radius_m, tolerance_m):
            gripping[other] = min(place, gripping.get(other, np.inf))
    for contact in contacts:
        if name in contact.parts and contact.points_m:
            other = contact.parts[1 - contact.parts.index(name)]
            along = (np.asarray(contact.points_m) - shape.origin_m) @ shape.axis
            places.setdefault(other, float(np.median(along)))
    if not gripping and one.named != "pin" and "thread" in (*by, _threaded_word(one)):
        gripping = _deepest_touched(shape, name, contacts)
    joins = tuple(sorted(places, key=lambda other: (-places[other], other)))
    # Where CAD draws all holes as wide as the shank, the thread is in the last.
    threaded = (min(gripping, key=lambda other: (gripping[other], other)),) if gripping else ()
    return Fastener(
        part=name,
        kind="pin" if one.named == "pin" else "screw",
        axis=_vector(shape.axis),
        point_m=_vector(shape.origin_m + shape.high_m * shape.axis),
        diameter_m=2 * shape.shank.radius_m,
        length_m=shape.shank_length_m,
        joins=joins,
        threaded_in=() if one.named == "pin" else threaded,
        by=by,
    )


def _threaded_word(one: _Candidate) -> str:
    return "thread" if _is_threaded(one.part, one.shape) else ""


def _deepest_touched(
    shape: TurnedShape, name: str, contacts: Sequence[Contact]
) -> dict[str, float]:
    """Return what the shank touches or overlaps, with where: modelled threads are no cylinders."""
    found: dict[str, float] = {}
    for contact in contacts:
        if name not in contact.parts:
            continue
        other = contact.parts[1 - contact.parts.index(name)]
        points = np.asarray(contact.points_m).reshape(-1, 3)
        along = (points - shape.origin_m) @ shape.axis
        if len(along) and np.median(along) < shape.low_m + shape.shank_length_m:
            found[other] = float(np.median(along))
    return found


def _ring(
    product: Product,
    one: _Candidate,
    screws: dict[int, Fastener],
    contacts: Sequence[Contact],
) -> Fastener | None:
    """Return a nut or washer: by name, or a ring on the axis of a screw."""
    shape, bore = one.shape, one.shape.bore
    on = [
        (number, screw)
        for number, screw in screws.items()
        if _same_line(shape, np.asarray(screw.axis), np.asarray(screw.point_m))
        and _within(shape, product.parts[number])
    ]
    kind = one.named if one.named in ("nut", "washer") else None
    by: tuple[str, ...] = ("name",)
    if kind is None and bore is not None and on:
        flat = shape.length_m <= _THIN_WASHER * bore.radius_m and shape.outer_planes == 0
        ring = 1.3 <= shape.head_radius_m / bore.radius_m <= 4
        plain = sum(face.kind != "plane" for face in one.part.faces) <= 4
        if shape.outer_planes == 6 and ring:
            kind, by = "nut", ("hexagon", "on a screw")
        elif flat and ring and plain and len(one.part.faces) <= 8:
            kind, by = "washer", ("flat ring", "on a screw")
    if kind is None:
        return None
    axis = np.asarray(on[0][1].axis) if on else shape.axis
    # A nut comes off the end of the screw.
    axis = -axis if kind == "nut" else axis
    end = max(np.dot(one.part.vertices_m - shape.origin_m, axis))
    own = tuple(screw.part for _, screw in on)
    return Fastener(
        part=one.part.name,
        kind=kind,
        axis=_vector(axis),
        point_m=_vector(shape.origin_m + end * axis),
        diameter_m=2 * (bore.radius_m if bore is not None else shape.shank.radius_m),
        length_m=shape.length_m,
        joins=(*own, *(_pressed(one.part.name, axis, contacts) if kind == "nut" and on else ())),
        threaded_in=own if kind == "nut" else (),
        by=by,
    )


def _pressed(name: str, axis: Floats, contacts: Sequence[Contact]) -> tuple[str, ...]:
    """Return what a nut lies flat on: its axis looks away from that."""
    found = set()
    for contact in contacts:
        if contact.kind == "plane" and name in contact.parts:
            sign = 1 if contact.parts[0] == name else -1
            if any(sign * float(np.dot(normal, axis)) < -_FLAT for normal in contact.normals):
                found.add(contact.parts[1 - contact.parts.index(name)])
    return tuple(sorted(found))


def _with_nuts(
    product: Product, one: Fastener, made: dict[int, Fastener], contacts: Sequence[Contact]
) -> Fastener:
    """Return a screw that is also threaded in the nuts on it, and not in what only guides it."""
    if one.kind != "screw":
        return one
    nuts = tuple(other.part for other in made.values() if one.part in other.threaded_in)
    if not nuts:
        return one
    return Fastener(
        one.part, one.kind, one.axis, one.point_m, one.diameter_m, one.length_m,
        one.joins, nuts, one.by,
    )  # fmt: skip


def _same_line_fit(shape: TurnedShape, fit: CylinderFit) -> bool:
    return _same_line(shape, np.asarray(fit.shaft.axis), np.asarray(fit.shaft.origin_m))


def _same_line(shape: TurnedShape, axis: Floats, point_m: Floats) -> bool:
    apart = point_m - shape.origin_m
    off = float(np.linalg.norm(apart - (apart @ shape.axis) * shape.axis))
    return bool(
        np.linalg.norm(np.cross(shape.axis, axis)) < 0.02 and off < 0.2 * shape.shank.radius_m
    )


def _within(shape: TurnedShape, screw: Part) -> bool:
    """Whether a screw passes through, or under, what lies about its axis."""
    along = (screw.vertices_m - shape.origin_m) @ shape.axis
    return bool(along.min() <= shape.high_m + 1e-4 and along.max() >= shape.low_m - 1e-4)


def _vector(numbers: Floats) -> Vector:
    x, y, z = (float(one) + 0.0 for one in numbers)
    return x, y, z
