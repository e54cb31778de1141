"""Recognise screws, nuts, washers and pins, by name or by features.

Attributes
----------
cylinder in a hole is not sufficient
    shafts, plugs and sleeves match it, too. Without a telling
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.joints.cylinder_fits import CylinderFit
from skillplan_cad.joints.turned_shape import TurnedShape, describe_turned_shape
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
# Head width by shank width, lowest and highest; shortest shank, in diameters.
_HEAD, _WIDEST_HEAD, _LEAST_SHANK = 1.25, 3.5, 0.8
# Smallest excess of a shank over its tapped hole, in radii.
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


def find_fasteners(
    product: Product,
    fits: Sequence[CylinderFit],
    contacts: Sequence[Contact],
    tolerance_m: float,
) -> tuple[Fastener, ...]:
    """Return the fasteners of a product, in the order of its parts.

    Parameters
    ----------
    tolerance_m
        Largest clearance of a hole that still grips [m].
    """
    candidates = []
    for number, part in enumerate(product.parts):
        shape = describe_turned_shape(part)
        if shape is not None:
            own = tuple(fit for fit in fits if fit.inner == number)
            candidates.append(_Candidate(number, part, shape, _recognise_name(part), own))
    fasteners: dict[int, Fastener] = {}
    for candidate in candidates:
        by = _find_screw_features(candidate)
        if by:
            fasteners[candidate.number] = _build_screw(
                product, candidate, contacts, by, tolerance_m
            )
    screws = dict(fasteners)
    for candidate in candidates:
        if candidate.number not in fasteners:
            ring = _build_ring(product, candidate, screws, contacts)
            if ring is not None:
                fasteners[candidate.number] = ring
    return tuple(
        _attach_nuts(product, fasteners[number], fasteners, contacts)
        for number in sorted(fasteners)
    )


def _recognise_name(part: Part) -> PartKind | None:
    """Return the kind that a part's own name or its design's name implies, or None."""
    for text in (part.name.rpartition("/")[2], part.design):
        words = re.sub(r"([a-z])([A-Z])|[_\-]+", r"\1 \2", text)
        for kind, pattern in _WORDS:
            if re.search(rf"(?<![a-z0-9])({pattern})(?![a-z])", words.lower()):
                return kind
    return None


def _find_screw_features(candidate: _Candidate) -> tuple[str, ...]:
    """Return the features that make a candidate a screw or pin; empty if it is neither."""
    shape = candidate.shape
    if candidate.named in ("screw", "pin"):
        return ("name",)
    if (
        candidate.named is not None
        or shape.is_ring
        or shape.shank_length_m < _LEAST_SHANK * 2 * shape.shank.radius_m
    ):
        return ()
    head = _HEAD <= shape.wide_share <= _WIDEST_HEAD
    drive = shape.inner_planes in (2, 4, 6) or (head and shape.outer_planes == 6)
    tapped = any(
        fit.radius_difference_m < -_TAPPED * fit.shaft.radius_m
        and _is_coaxial(shape, np.asarray(fit.shaft.axis), np.asarray(fit.shaft.origin_m))
        for fit in candidate.fits
    )
    threaded = _is_threaded(candidate.part, shape)
    features = tuple(
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
    gripped = any(_is_coaxial_fit(shape, fit) for fit in candidate.fits) or threaded
    return features if enough and gripped else ()


def _is_threaded(part: Part, shape: TurnedShape) -> bool:
    """Return whether most of the shank surface is neither flat nor cylindrical, like a helix."""
    area = free = 0.0
    corners = part.vertices_m[part.triangles]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    offsets = corners.mean(axis=1) - shape.origin_m
    along = offsets @ shape.axis
    on_shank = along < shape.low_m + shape.shank_length_m
    for face in part.faces:
        own = face.triangles[on_shank[face.triangles]]
        area += float(areas[own].sum())
        if face.kind == "free":
            free += float(areas[own].sum())
    return area > 0 and free > 0.3 * area


def _build_screw(
    product: Product,
    candidate: _Candidate,
    contacts: Sequence[Contact],
    by: tuple[str, ...],
    tolerance_m: float,
) -> Fastener:
    shape, name = candidate.shape, candidate.part.name
    places: dict[str, float] = {}
    gripping: dict[str, float] = {}
    for fit in candidate.fits:
        if not _is_coaxial_fit(shape, fit):
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
    if not gripping and candidate.named != "pin" and "thread" in (*by, _name_thread(candidate)):
        gripping = _find_shank_contacts(shape, name, contacts)
    joins = tuple(sorted(places, key=lambda other: (-places[other], other)))
    # If CAD draws all holes as wide as the shank, the last one has the thread.
    threaded = (min(gripping, key=lambda other: (gripping[other], other)),) if gripping else ()
    return Fastener(
        part=name,
        kind="pin" if candidate.named == "pin" else "screw",
        axis=_vector(shape.axis),
        point_m=_vector(shape.origin_m + shape.high_m * shape.axis),
        diameter_m=2 * shape.shank.radius_m,
        length_m=shape.shank_length_m,
        joins=joins,
        threaded_in=() if candidate.named == "pin" else threaded,
        by=by,
    )


def _name_thread(candidate: _Candidate) -> str:
    return "thread" if _is_threaded(candidate.part, candidate.shape) else ""


def _find_shank_contacts(
    shape: TurnedShape, name: str, contacts: Sequence[Contact]
) -> dict[str, float]:
    """Return the positions of parts that touch the shank, for modelled threads."""
    positions: dict[str, float] = {}
    for contact in contacts:
        if name not in contact.parts:
            continue
        other = contact.parts[1 - contact.parts.index(name)]
        points = np.asarray(contact.points_m).reshape(-1, 3)
        along = (points - shape.origin_m) @ shape.axis
        if len(along) and np.median(along) < shape.low_m + shape.shank_length_m:
            positions[other] = float(np.median(along))
    return positions


def _build_ring(
    product: Product,
    candidate: _Candidate,
    screws: dict[int, Fastener],
    contacts: Sequence[Contact],
) -> Fastener | None:
    """Return a nut or washer, by name or as a ring on the axis of a screw, or None."""
    shape, bore = candidate.shape, candidate.shape.bore
    on = [
        (number, screw)
        for number, screw in screws.items()
        if _is_coaxial(shape, np.asarray(screw.axis), np.asarray(screw.point_m))
        and _passes_through(shape, product.parts[number])
    ]
    kind = candidate.named if candidate.named in ("nut", "washer") else None
    by: tuple[str, ...] = ("name",)
    if kind is None and bore is not None and on:
        flat = shape.length_m <= _THIN_WASHER * bore.radius_m and shape.outer_planes == 0
        ring = 1.3 <= shape.head_radius_m / bore.radius_m <= 4
        plain = sum(face.kind != "plane" for face in candidate.part.faces) <= 4
        if shape.outer_planes == 6 and ring:
            kind, by = "nut", ("hexagon", "on a screw")
        elif flat and ring and plain and len(candidate.part.faces) <= 8:
            kind, by = "washer", ("flat ring", "on a screw")
    if kind is None:
        return None
    axis = np.asarray(on[0][1].axis) if on else shape.axis
    # A nut comes off the end of the screw.
    axis = -axis if kind == "nut" else axis
    end = max(np.dot(candidate.part.vertices_m - shape.origin_m, axis))
    own = tuple(screw.part for _, screw in on)
    return Fastener(
        part=candidate.part.name,
        kind=kind,
        axis=_vector(axis),
        point_m=_vector(shape.origin_m + end * axis),
        diameter_m=2 * (bore.radius_m if bore is not None else shape.shank.radius_m),
        length_m=shape.length_m,
        joins=(
            *own,
            *(_find_pressed(candidate.part.name, axis, contacts) if kind == "nut" and on else ()),
        ),
        threaded_in=own if kind == "nut" else (),
        by=by,
    )


def _find_pressed(name: str, axis: Floats, contacts: Sequence[Contact]) -> tuple[str, ...]:
    """Return the parts that a nut lies flat on; its axis points away from them."""
    parts = set()
    for contact in contacts:
        if contact.kind == "plane" and name in contact.parts:
            sign = 1 if contact.parts[0] == name else -1
            if any(sign * float(np.dot(normal, axis)) < -_FLAT for normal in contact.normals):
                parts.add(contact.parts[1 - contact.parts.index(name)])
    return tuple(sorted(parts))


def _attach_nuts(
    product: Product,
    fastener: Fastener,
    fasteners: dict[int, Fastener],
    contacts: Sequence[Contact],
) -> Fastener:
    """Return a screw as threaded in its nuts instead of the parts that only guide it."""
    if fastener.kind != "screw":
        return fastener
    nuts = tuple(other.part for other in fasteners.values() if fastener.part in other.threaded_in)
    if not nuts:
        return fastener
    return replace(fastener, threaded_in=nuts)


def _is_coaxial_fit(shape: TurnedShape, fit: CylinderFit) -> bool:
    return _is_coaxial(shape, np.asarray(fit.shaft.axis), np.asarray(fit.shaft.origin_m))


def _is_coaxial(shape: TurnedShape, axis: Floats, point_m: Floats) -> bool:
    offset = point_m - shape.origin_m
    off = float(np.linalg.norm(offset - (offset @ shape.axis) * shape.axis))
    return bool(
        np.linalg.norm(np.cross(shape.axis, axis)) < 0.02 and off < 0.2 * shape.shank.radius_m
    )


def _passes_through(shape: TurnedShape, screw: Part) -> bool:
    """Return whether a screw passes through, or below, the parts on its axis."""
    along = (screw.vertices_m - shape.origin_m) @ shape.axis
    return bool(along.min() <= shape.high_m + 1e-4 and along.max() >= shape.low_m - 1e-4)


def _vector(numbers: Floats) -> Vector:
    x, y, z = (float(number) + 0.0 for number in numbers)
    return x, y, z
