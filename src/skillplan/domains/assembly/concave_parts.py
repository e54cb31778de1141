"""Parts of meshes that are not convex: whether they can be taken apart, and how well."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue
from skillplan.task.shape import Mesh


def piece_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield meshes that are not convex where nothing takes them apart into pieces that are."""
    concave = [entry for entry in _concave(config) if not entry[3]]
    for number, (name, index, mesh, _) in enumerate(concave, 1):
        # Takes numpy, which most boards do without.
        from skillplan.collision.solids.decomposition import NoPieces, decomposition_of

        try:
            decomposition_of(mesh, f"{name!r}, mesh {number} of {len(concave)}")
        except NoPieces as error:
            yield Issue(f"{error}.", ("parts", name, "meshes", index, "file"))


def piece_lines(config: AssemblyConfig) -> tuple[list[str], list[dict[str, Any]]]:
    """Return of every mesh that is not convex its pieces and their error, in words and as JSON."""
    lines, entries = [], []
    for name, index, mesh, given in _concave(config):
        from skillplan.collision.solids.decomposition import decomposition_of, given_decomposition

        found = given_decomposition(mesh, given) if given else decomposition_of(mesh)
        count = len(found.pieces)
        lines.append(
            f"pieces     {name} moves as {count} convex piece{'' if count == 1 else 's'}, "
            f"{found.outside_m * 1e3:.2f} mm outside its mesh and {found.missing_m * 1e3:.2f} mm "
            "short of it"
        )
        entries.append(
            {
                "part": name,
                "mesh": index,
                "pieces": count,
                "outside_mm": round(found.outside_m * 1e3, 4),
                "missing_mm": round(found.missing_m * 1e3, 4),
            }
        )
    return lines, entries


def _concave(config: AssemblyConfig) -> Iterator[tuple[str, int, Mesh, tuple[Mesh, ...]]]:
    for name, part in config.parts.items():
        for index, mesh in enumerate(part.meshes or ()):
            if not mesh.convex:
                yield name, index, mesh.shape, mesh.given_pieces
