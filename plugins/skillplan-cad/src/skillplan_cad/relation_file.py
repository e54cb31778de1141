"""`relation.json`: a relation in millimetres, written and read; one relation, the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skillplan.errors import OptionError
from skillplan.files.json_file import format_document, read_document
from skillplan.records.schemas import RELATION
from skillplan_cad.product import Vector
from skillplan_cad.relation import Blocking, Contact, Fastener, Relation, RelationPart, Sensitive

_REMEDY = "Write it anew with `skillplan import-cad`"


def relation_text(relation: Relation) -> str:
    """Return the content of `relation.json`."""
    return format_document(RELATION, relation_document(relation)) + "\n"


def relation_document(relation: Relation) -> dict[str, Any]:
    """Return the document without the name of its schema; lengths are millimetres."""
    directions = [_plain(one) for one in relation.directions]
    return {
        "unit": "mm",
        "tolerance_mm": _mm(relation.tolerance_m),
        "parts": [
            {
                "name": one.name,
                "kind": one.kind,
                "identical_to": one.identical_to,
                "mirror_of": one.mirror_of,
                "mass_kg": _rounded(one.mass_kg, 9),
            }
            for one in relation.parts
        ],
        "directions": directions,
        "blocked": [
            {
                "part": one.part,
                "by": one.by,
                "direction": directions[one.direction],
                "distance_mm": _mm(one.distance_m),
                "width_mm": _mm(one.width_m),
                "point_mm": _mm3(one.point_m),
                "sensitive": one.sensitive,
            }
            for one in relation.blocked
        ],
        "sensitive": [
            {
                "part": one.part,
                "by": one.by,
                "direction": directions[one.direction],
                "blocked": one.blocked,
                "otherwise_at_mm": _mm(one.otherwise_at_m),
            }
            for one in relation.sensitive
        ],
        "contacts": [_contact_document(one) for one in relation.contacts],
        "fasteners": [_fastener_document(one) for one in relation.fasteners],
        "groups": [list(one) for one in relation.groups],
        "stuck": list(relation.stuck),
    }


def read_relation(path: Path) -> Relation:
    """Return the relation that a file holds.

    Raises
    ------
    OptionError
        If it cannot be read, or is no `relation.json`.
    """
    document = read_document(path, RELATION, _REMEDY)
    try:
        return _relation(document)
    except (KeyError, TypeError, ValueError) as error:
        raise OptionError(f"{path}: is damaged: {error!r}. {_REMEDY}.") from None


def _relation(document: Mapping[str, Any]) -> Relation:
    directions = tuple(_vector(one) for one in document["directions"])
    numbers = {one: number for number, one in enumerate(directions)}
    return Relation(
        parts=tuple(
            RelationPart(
                one["name"], one["kind"], one["identical_to"], one["mirror_of"], one["mass_kg"]
            )
            for one in document["parts"]
        ),
        tolerance_m=document["tolerance_mm"] / 1000,
        directions=directions,
        blocked=tuple(
            Blocking(
                one["part"],
                one["by"],
                numbers[_vector(one["direction"])],
                one["distance_mm"] / 1000,
                one["width_mm"] / 1000,
                _metres(one["point_mm"]),
                one["sensitive"],
            )
            for one in document["blocked"]
        ),
        contacts=tuple(_contact(one) for one in document["contacts"]),
        fasteners=tuple(_fastener(one) for one in document["fasteners"]),
        sensitive=tuple(
            Sensitive(
                one["part"],
                one["by"],
                numbers[_vector(one["direction"])],
                one["blocked"],
                one["otherwise_at_mm"] / 1000,
            )
            for one in document["sensitive"]
        ),
        groups=tuple(tuple(one) for one in document["groups"]),
        stuck=tuple(document["stuck"]),
    )


def _contact_document(contact: Contact) -> dict[str, Any]:
    point, difference = contact.overlap_point_m, contact.radius_difference_m
    return {
        "parts": list(contact.parts),
        "kind": contact.kind,
        "area_mm2": _rounded(contact.area_m2 * 1e6, 4),
        "normals": [_plain(one) for one in contact.normals],
        "axis": None if contact.axis is None else _plain(contact.axis),
        "axis_point_mm": None if contact.axis_point_m is None else _mm3(contact.axis_point_m),
        "radius_mm": None if contact.radius_m is None else _mm(contact.radius_m),
        "radius_difference_mm": None if difference is None else _mm(difference),
        "points_mm": [_mm3(one) for one in contact.points_m],
        "overlap_mm3": _rounded(contact.overlap_m3 * 1e9, 4),
        "overlap_surface_mm2": _rounded(contact.overlap_surface_m2 * 1e6, 4),
        "overlap_allowed_mm3": _rounded(contact.overlap_allowed_m3 * 1e9, 4),
        "overlap_point_mm": None if point is None else _mm3(point),
        "interference": contact.interferes,
    }


def _contact(one: Mapping[str, Any]) -> Contact:
    radius, difference = one["radius_mm"], one["radius_difference_mm"]
    point, axis, axis_point = one["overlap_point_mm"], one["axis"], one["axis_point_mm"]
    return Contact(
        parts=(one["parts"][0], one["parts"][1]),
        kind=one["kind"],
        area_m2=one["area_mm2"] / 1e6,
        normals=tuple(_vector(normal) for normal in one["normals"]),
        axis=None if axis is None else _vector(axis),
        axis_point_m=None if axis_point is None else _metres(axis_point),
        radius_m=None if radius is None else radius / 1000,
        radius_difference_m=None if difference is None else difference / 1000,
        points_m=tuple(_metres(each) for each in one["points_mm"]),
        overlap_m3=one["overlap_mm3"] / 1e9,
        overlap_surface_m2=one["overlap_surface_mm2"] / 1e6,
        overlap_allowed_m3=one["overlap_allowed_mm3"] / 1e9,
        overlap_point_m=None if point is None else _metres(point),
    )


def _fastener_document(fastener: Fastener) -> dict[str, Any]:
    return {
        "part": fastener.part,
        "kind": fastener.kind,
        "axis": _plain(fastener.axis),
        "point_mm": _mm3(fastener.point_m),
        "diameter_mm": _mm(fastener.diameter_m),
        "length_mm": _mm(fastener.length_m),
        "joins": list(fastener.joins),
        "threaded_in": list(fastener.threaded_in),
        "by": list(fastener.by),
    }


def _fastener(one: Mapping[str, Any]) -> Fastener:
    return Fastener(
        part=one["part"],
        kind=one["kind"],
        axis=_vector(one["axis"]),
        point_m=_metres(one["point_mm"]),
        diameter_m=one["diameter_mm"] / 1000,
        length_m=one["length_mm"] / 1000,
        joins=tuple(one["joins"]),
        threaded_in=tuple(one["threaded_in"]),
        by=tuple(one["by"]),
    )


def _rounded(value: float, digits: int) -> float:
    """Return a number without the digits that mean nothing, and zero without a sign."""
    return round(float(value), digits) + 0.0


def _mm(value_m: float) -> float:
    return _rounded(value_m * 1000, 4)


def _mm3(point_m: Vector) -> list[float]:
    return [_mm(one) for one in point_m]


def _plain(vector: Vector) -> list[float]:
    return [_rounded(one, 9) for one in vector]


def _vector(numbers: Any) -> Vector:
    x, y, z = (float(one) for one in np.asarray(numbers, dtype=float))
    return x, y, z


def _metres(point_mm: Any) -> Vector:
    x, y, z = _vector(point_mm)
    return x / 1000, y / 1000, z / 1000
