"""Choose the directions of motion: axes of the file, of cylinders, and of contacts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.joints.cylinder_fits import CylinderFit
from skillplan_cad.product import Vector
from skillplan_cad.relation import Contact, Fastener

Floats = NDArray[np.float64]
Source = Literal["axes", "cylinders", "contacts"]

# Smallest angle between distinct lines [rad]; largest number of lines in addition to the axes.
_ONE_LINE_RAD, _MOST = 2e-3, 24


def choose_directions(
    source: Source,
    fits: Sequence[CylinderFit],
    fasteners: Sequence[Fastener],
    contacts: Sequence[Contact],
) -> tuple[Vector, ...]:
    """Return unit vectors, each followed by its opposite, the axes of the file first.

    Parameters
    ----------
    source
        ``axes``: axes of the file; ``cylinders``: also axes of fasteners and of cylinders in holes,
        with a frame about the first; ``contacts``: also normals of flat contacts and edges between
        two of them, along which a part slides on both.
    """
    lines: list[Floats] = list(np.eye(3))
    if source != "axes":
        weights: list[tuple[float, Vector]] = [
            (fit.shaft.radius_m * fit.length_m, fit.shaft.axis) for fit in fits
        ]
        weights += [
            (fastener.diameter_m * fastener.length_m, fastener.axis) for fastener in fasteners
        ]
        by_weight = _rank_lines(weights)
        _add(lines, by_weight)
        _add(lines, _find_frame(lines[3:]))
    if source == "contacts":
        flat = [contact for contact in contacts if contact.kind == "plane"]
        _add(lines, _rank_lines([(face.area_m2, n) for face in flat for n in face.normals[:3]]))
        _add(lines, _find_edges(contacts))
    return tuple(sign for line in lines for sign in (_vector(line), _vector(-line)))


def _rank_lines(weighted: Iterable[tuple[float, Vector]]) -> list[Floats]:
    """Return the distinct lines among vectors, the largest weight first."""
    lines: list[Floats] = []
    weights: list[float] = []
    for weight, vector in weighted:
        line = _normalize_line(np.asarray(vector))
        for number, known in enumerate(lines):
            if abs(known @ line) > np.cos(_ONE_LINE_RAD):
                weights[number] += weight
                break
        else:
            lines.append(line)
            weights.append(weight)
    order = np.argsort(-np.round(weights, 12), kind="stable")
    return [lines[number] for number in order]


def _add(lines: list[Floats], more: Iterable[Floats]) -> None:
    for line in more:
        if len(lines) >= 3 + _MOST:
            return
        if all(abs(known @ line) < np.cos(_ONE_LINE_RAD) for known in lines):
            lines.append(line)


def _find_frame(lines: Sequence[Floats]) -> list[Floats]:
    """Return two lines across the first line, along other lines if those are perpendicular."""
    if not lines:
        return []
    first = lines[0]
    square = [line for line in lines[1:] if abs(line @ first) < _ONE_LINE_RAD]
    across = square[0] if square else np.eye(3)[int(np.argmin(np.abs(first)))]
    across = across - (across @ first) * first
    across = across / np.linalg.norm(across)
    return [_normalize_line(across), _normalize_line(np.cross(first, across))]


def _find_edges(contacts: Sequence[Contact]) -> list[Floats]:
    """Return the lines along which parts slide on two flat contacts at once."""
    normals: dict[str, list[tuple[float, Vector]]] = {}
    for contact in contacts:
        if contact.kind == "plane":
            for name in contact.parts:
                own = normals.setdefault(name, [])
                own += [(contact.area_m2, normal) for normal in contact.normals[:3]]
    crossed: list[tuple[float, Vector]] = []
    for own in normals.values():
        largest = sorted(own, key=lambda normal_a: -normal_a[0])[:6]
        for number, (area, normal_a) in enumerate(largest):
            for other_area, normal_b in largest[number + 1 :]:
                line = np.cross(normal_a, normal_b)
                length = float(np.linalg.norm(line))
                if length > 0.05:
                    crossed.append((min(area, other_area), _vector(line / length)))
    return _rank_lines(crossed)


def _normalize_line(line: Floats) -> Floats:
    """Return the unit vector of a line, with a positive first significant component."""
    unit = line / np.linalg.norm(line)
    leading = unit[int(np.argmax(np.abs(unit) > 1e-6))]
    return unit if leading > 0 else -unit


def _vector(numbers: Floats) -> Vector:
    x, y, z = (round(float(number), 9) + 0.0 for number in numbers)
    return x, y, z
