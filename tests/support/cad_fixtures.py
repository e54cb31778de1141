"""Parts of solids, and relations by hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import manifold3d
import numpy as np

from cad_products import AXES, truth
from skillplan_cad import Blocking, Contact, Face, Part, Relation, RelationPart

NUMBERS = {"+x": 0, "-x": 1, "+y": 2, "-y": 3, "+z": 4, "-z": 5}
OPPOSITE = {"+x": "-x", "+y": "-y", "+z": "-z"}

# Bourjault's ball pen: what each part, moved that way, runs into.
PEN = {
    "+x": {
        "cap": "head cartridge ink body button",
        "head": "ink cartridge body button",
        "cartridge": "button",
        "ink": "button",
        "body": "button",
    },
    "+y": {
        "cartridge": "body head cap ink",
        "body": "cartridge ink button head cap",
        "cap": "head cartridge ink body",
        "head": "cap cartridge body",
        "button": "body",
        "ink": "cartridge body cap",
    },
    "+z": {
        "head": "cap cartridge body",
        "cap": "head body ink cartridge",
        "cartridge": "body cap ink head",
        "body": "cap ink cartridge head button",
        "button": "body",
        "ink": "body cap cartridge",
    },
}
PEN_PARTS = ("cap", "head", "cartridge", "ink", "body", "button")
PEN_TOUCHES = ("cap body", "head body", "head cartridge", "cartridge ink", "body button")


def blockings(blocked: Mapping[str, Mapping[str, str | Iterable[str]]]) -> set[tuple]:
    """Return (part, by, direction) for what is said of the positive directions, and the rest."""
    result = set()
    for direction, parts in blocked.items():
        for part, others in parts.items():
            for by in others.split() if isinstance(others, str) else others:
                result.add((part, by, direction))
                result.add((by, part, OPPOSITE[direction]))
    return result


def relation_by_hand(
    names: Iterable[str],
    blocked: Mapping[str, Mapping[str, str | Iterable[str]]],
    touches: Iterable[str | Iterable[str]] = (),
    masses_kg: Mapping[str, float] | None = None,
) -> Relation:
    """Return a relation along the axes, with contacts of which nothing more is known."""
    names, masses_kg = tuple(names), masses_kg or {}
    pairs = [pair.split() if isinstance(pair, str) else list(pair) for pair in touches]
    return Relation(
        parts=tuple(
            RelationPart(name, "part", None, None, masses_kg.get(name, 0.1)) for name in names
        ),
        tolerance_m=0.0001,
        directions=AXES,
        blocked=tuple(
            Blocking(part, by, NUMBERS[direction], 0.0, 0.001, (0.0, 0.0, 0.0))
            for part, by, direction in sorted(blockings(blocked))
        ),
        contacts=tuple(
            Contact((a, b), "free", 1e-4, ((0.0, 0.0, 1.0),), points_m=((0.0, 0.0, 0.0),))
            for a, b in pairs
        ),
    )


def pen() -> Relation:
    """Return Bourjault's pen."""
    return relation_by_hand(PEN_PARTS, PEN, PEN_TOUCHES)


def of_fixture(name: str) -> Relation:
    """Return the relation that holds of a fixture by its construction."""
    message = truth(name)
    names = sorted({part for part, _, _ in blockings(message["blocked"])})
    pairs = [pair for kind in message.get("contacts", {}).values() for pair in kind]
    return relation_by_hand(names, message["blocked"], pairs)


def box(x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> manifold3d.Manifold:
    """Return the box between two corners [mm]."""
    return manifold3d.Manifold.cube((x1 - x0, y1 - y0, z1 - z0)).translate((x0, y0, z0))


def rod(x: float, y: float, z: float, radius: float, height: float) -> manifold3d.Manifold:
    """Return an upright cylinder of 48 sides from the centre of its bottom on [mm]."""
    return manifold3d.Manifold.cylinder(height, radius, radius, 48).translate((x, y, z))


def part_of(name: str, solid: manifold3d.Manifold, faces: Iterable[Face] = ()) -> Part:
    """Return a part of steel from a solid in millimetres."""
    mesh = solid.scale((1e-3, 1e-3, 1e-3)).to_mesh64()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    triangles = np.asarray(mesh.tri_verts, dtype=np.int64)
    corners = vertices[triangles]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    centre = (volumes[:, None] * corners.sum(axis=1) / 4).sum(axis=0) / volumes.sum()
    return Part(
        name,
        (),
        vertices,
        triangles,
        tuple(faces),
        float(volumes.sum()),
        7850.0,
        (float(centre[0]), float(centre[1]), float(centre[2])),
        shape=0,
    )
