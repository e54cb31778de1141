"""Read and write `relation.json` in millimetres; equal relations give equal bytes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skillplan.errors import OptionError
from skillplan.files.json_file import format_document, read_document
from skillplan.records.schemas import RELATION
from skillplan_cad.product import Vector
from skillplan_cad.relation import (
    Blocking,
    Contact,
    Fastener,
    Fit,
    Relation,
    RelationPart,
    Sensitive,
)

_REMEDY = "Write it anew with `skillplan import-cad`"


def format_relation(relation: Relation) -> str:
    """Return the content of `relation.json`."""
    return format_document(RELATION, build_relation_document(relation)) + "\n"


def build_relation_document(relation: Relation) -> dict[str, Any]:
    """Return the document without its schema; lengths in millimetres."""
    directions = [_round_vector(direction) for direction in relation.directions]
    return {
        "unit": "mm",
        "tolerance_mm": _mm(relation.tolerance_m),
        "parts": [
            {
                "name": part.name,
                "kind": part.kind,
                "identical_to": part.identical_to,
                "mirror_of": part.mirror_of,
                "mass_kg": _round(part.mass_kg, 9),
            }
            for part in relation.parts
        ],
        "directions": directions,
        "blocked": [
            {
                "part": blocking.part,
                "by": blocking.by,
                "direction": directions[blocking.direction],
                "distance_mm": _mm(blocking.distance_m),
                "width_mm": _mm(blocking.width_m),
                "point_mm": _mm3(blocking.point_m),
                "sensitive": blocking.sensitive,
            }
            for blocking in relation.blocked
        ],
        "sensitive": [
            {
                "part": answer.part,
                "by": answer.by,
                "direction": directions[answer.direction],
                "blocked": answer.blocked,
                "otherwise_at_mm": _mm(answer.otherwise_at_m),
            }
            for answer in relation.sensitive
        ],
        "contacts": [_build_contact_document(contact) for contact in relation.contacts],
        "fasteners": [_build_fastener_document(fastener) for fastener in relation.fasteners],
        "groups": [list(group) for group in relation.groups],
        "stuck": list(relation.stuck),
    }


def read_relation(path: Path) -> Relation:
    """Read a relation file.

    Raises
    ------
    OptionError
        If the file is unreadable or not a valid `relation.json`.
    """
    document = read_document(path, RELATION, _REMEDY)
    try:
        return _parse_relation(document)
    except (KeyError, TypeError, ValueError) as error:
        raise OptionError(f"{path}: is damaged: {error!r}. {_REMEDY}.") from None


def _parse_relation(document: Mapping[str, Any]) -> Relation:
    directions = tuple(_parse_vector(vector) for vector in document["directions"])
    numbers = {direction: number for number, direction in enumerate(directions)}
    return Relation(
        parts=tuple(
            RelationPart(
                entry["name"],
                entry["kind"],
                entry["identical_to"],
                entry["mirror_of"],
                entry["mass_kg"],
            )
            for entry in document["parts"]
        ),
        tolerance_m=document["tolerance_mm"] / 1000,
        directions=directions,
        blocked=tuple(
            Blocking(
                entry["part"],
                entry["by"],
                numbers[_parse_vector(entry["direction"])],
                entry["distance_mm"] / 1000,
                entry["width_mm"] / 1000,
                _convert_to_metres(entry["point_mm"]),
                entry["sensitive"],
            )
            for entry in document["blocked"]
        ),
        contacts=tuple(_parse_contact(entry) for entry in document["contacts"]),
        fasteners=tuple(_parse_fastener(entry) for entry in document["fasteners"]),
        sensitive=tuple(
            Sensitive(
                entry["part"],
                entry["by"],
                numbers[_parse_vector(entry["direction"])],
                entry["blocked"],
                entry["otherwise_at_mm"] / 1000,
            )
            for entry in document["sensitive"]
        ),
        groups=tuple(tuple(entry) for entry in document["groups"]),
        stuck=tuple(document["stuck"]),
    )


def _build_contact_document(contact: Contact) -> dict[str, Any]:
    point, difference = contact.overlap_point_m, contact.radius_difference_m
    return {
        "parts": list(contact.parts),
        "kind": contact.kind,
        "area_mm2": _round(contact.area_m2 * 1e6, 4),
        "normals": [_round_vector(normal) for normal in contact.normals],
        "axis": None if contact.axis is None else _round_vector(contact.axis),
        "axis_point_mm": None if contact.axis_point_m is None else _mm3(contact.axis_point_m),
        "radius_mm": None if contact.radius_m is None else _mm(contact.radius_m),
        "radius_difference_mm": None if difference is None else _mm(difference),
        "points_mm": [_mm3(location) for location in contact.points_m],
        "overlap_mm3": _round(contact.overlap_m3 * 1e9, 4),
        "overlap_surface_mm2": _round(contact.overlap_surface_m2 * 1e6, 4),
        "overlap_allowed_mm3": _round(contact.overlap_allowed_m3 * 1e9, 4),
        "overlap_point_mm": None if point is None else _mm3(point),
        "overlap_depth_mm": _mm(contact.overlap_depth_m),
        "overlap_thickness_mm": _mm(contact.overlap_thickness_m),
        "overlap_section_mm": _mm(contact.overlap_section_m),
        "interference": contact.interferes,
        "fit": None
        if contact.fit is None
        else {
            "kind": contact.fit.kind,
            "depth_mm": _mm(contact.fit.depth_m),
            "allowed_mm": _mm(contact.fit.allowed_m),
            "volume_mm3": _round(contact.fit.volume_m3 * 1e9, 4),
        },
    }


def _parse_contact(fields: Mapping[str, Any]) -> Contact:
    radius, difference = fields["radius_mm"], fields["radius_difference_mm"]
    point, axis, axis_point = fields["overlap_point_mm"], fields["axis"], fields["axis_point_mm"]
    return Contact(
        parts=(fields["parts"][0], fields["parts"][1]),
        kind=fields["kind"],
        area_m2=fields["area_mm2"] / 1e6,
        normals=tuple(_parse_vector(normal) for normal in fields["normals"]),
        axis=None if axis is None else _parse_vector(axis),
        axis_point_m=None if axis_point is None else _convert_to_metres(axis_point),
        radius_m=None if radius is None else radius / 1000,
        radius_difference_m=None if difference is None else difference / 1000,
        points_m=tuple(_convert_to_metres(location) for location in fields["points_mm"]),
        overlap_m3=fields["overlap_mm3"] / 1e9,
        overlap_surface_m2=fields["overlap_surface_mm2"] / 1e6,
        overlap_allowed_m3=fields["overlap_allowed_mm3"] / 1e9,
        overlap_point_m=None if point is None else _convert_to_metres(point),
        # Files of 0.3.0 have no depths and no fits.
        overlap_depth_m=fields.get("overlap_depth_mm", 0.0) / 1000,
        overlap_thickness_m=fields.get("overlap_thickness_mm", 0.0) / 1000,
        overlap_section_m=fields.get("overlap_section_mm", 0.0) / 1000,
        fit=_parse_fit(fields.get("fit")),
    )


def _parse_fit(fields: Mapping[str, Any] | None) -> Fit | None:
    if fields is None:
        return None
    return Fit(
        fields["kind"],
        fields["depth_mm"] / 1000,
        fields["allowed_mm"] / 1000,
        fields["volume_mm3"] / 1e9,
    )


def _build_fastener_document(fastener: Fastener) -> dict[str, Any]:
    return {
        "part": fastener.part,
        "kind": fastener.kind,
        "axis": _round_vector(fastener.axis),
        "point_mm": _mm3(fastener.point_m),
        "diameter_mm": _mm(fastener.diameter_m),
        "length_mm": _mm(fastener.length_m),
        "joins": list(fastener.joins),
        "threaded_in": list(fastener.threaded_in),
        "by": list(fastener.by),
        "held": fastener.held,
    }


def _parse_fastener(fields: Mapping[str, Any]) -> Fastener:
    return Fastener(
        part=fields["part"],
        kind=fields["kind"],
        axis=_parse_vector(fields["axis"]),
        point_m=_convert_to_metres(fields["point_mm"]),
        diameter_m=fields["diameter_mm"] / 1000,
        length_m=fields["length_mm"] / 1000,
        joins=tuple(fields["joins"]),
        threaded_in=tuple(fields["threaded_in"]),
        by=tuple(fields["by"]),
        held=fields.get("held", False),
    )


def _round(value: float, digits: int) -> float:
    """Return a number without insignificant digits, and zero without a sign."""
    return round(float(value), digits) + 0.0


def _mm(value_m: float) -> float:
    return _round(value_m * 1000, 4)


def _mm3(point_m: Vector) -> list[float]:
    return [_mm(value) for value in point_m]


def _round_vector(vector: Vector) -> list[float]:
    return [_round(value, 9) for value in vector]


def _parse_vector(numbers: Any) -> Vector:
    x, y, z = (float(number) for number in np.asarray(numbers, dtype=float))
    return x, y, z


def _convert_to_metres(point_mm: Any) -> Vector:
    x, y, z = _parse_vector(point_mm)
    return x / 1000, y / 1000, z / 1000
