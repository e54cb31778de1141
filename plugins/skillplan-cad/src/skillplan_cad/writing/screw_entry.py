"""The entry of a screw in a task file: its hole, its axis and the size of its head."""

from __future__ import annotations

from typing import Any

import numpy as np

from skillplan.task.pose import DOWN
from skillplan_cad.product import Part
from skillplan_cad.relation import Fastener, Relation
from skillplan_cad.writing.upright import Upright

_FLAT = 0.999


def screw_entry(
    part: Part, fastener: Fastener, relation: Relation, upright: Upright
) -> dict[str, Any]:
    """Return where a screw belongs, along which axis unless straight down, its head and mass."""
    axis = np.asarray(fastener.axis)
    along = part.vertices_m @ axis
    seat = _seat(part, fastener, relation)
    point = np.asarray(fastener.point_m)
    mouth = point + (seat - float(point @ axis)) * axis
    apart = part.vertices_m - point
    radius = float(np.linalg.norm(apart - np.outer(apart @ axis, axis), axis=1).max())
    into = upright.vector((-float(axis[0]), -float(axis[1]), -float(axis[2])))
    entry: dict[str, Any] = {
        "hole_m": list(upright.point((float(mouth[0]), float(mouth[1]), float(mouth[2])))),
        "head_diameter_m": round(2 * radius, 6),
        "head_height_m": round(float(along.max()) - seat, 6),
        "mass_kg": float(f"{max(part.mass_kg, 1e-6):.4g}"),
    }
    if into != DOWN:
        entry["axis"] = list(into)
    return entry


def _seat(part: Part, fastener: Fastener, relation: Relation) -> float:
    """Return where along a fastener's axis its head rests: where it touches what it joins.

    A nut is all head.
    """
    axis = np.asarray(fastener.axis)
    if fastener.kind == "nut":
        return float((part.vertices_m @ axis).min())
    for contact in relation.contacts:
        if {part.name, fastener.joins[0]} != set(contact.parts) or not contact.points_m:
            continue
        if any(abs(float(np.dot(normal, axis))) > _FLAT for normal in contact.normals):
            return float(np.median(np.asarray(contact.points_m) @ axis))
    return float((part.vertices_m @ axis).min()) + fastener.length_m
