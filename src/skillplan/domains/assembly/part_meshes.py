"""Meshes of parts and fixtures: shifts against their files' frames, and pieces of concave ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from skillplan.domains.assembly.part_schema import MeshConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue
from skillplan.files.schema_errors import shown
from skillplan.task.motion import Point
from skillplan.task.shape import Mesh

# A shift below this is rounding of the file [m].
_SHIFT_M = 1e-5
_DECIMALS = 6


@dataclass(frozen=True, slots=True)
class MovedMesh:
    """A mesh without ``centre_m`` whose origin differs from that of its part.

    Parameters
    ----------
    index
        Number of the mesh in the part, from 0.
    moved_m
        Shift from the file's frame to the part's [m].
    keeping_m
        ``centre_m`` that keeps the origin [m]; None if only the height differs, because the origin
        of a part is at its bottom.
    """

    part: str
    index: int
    mesh: MeshConfig
    moved_m: Point
    keeping_m: Point | None

    @property
    def words(self) -> str:
        """One sentence without a full stop."""
        moved = " ".join(f"{value * 1e3:.4g}" for value in self.moved_m)
        begin = f"{shown(self.mesh.file)} is moved by {moved} mm"
        if self.keeping_m is None:
            return f"{begin}, as heights count from the part's bottom"
        keeping = ", ".join(f"{value:.6g}" for value in self.keeping_m)
        return f"{begin}, so that its box is centred; give centre_m: [{keeping}] to keep its origin"


def find_moved_meshes(config: AssemblyConfig, parts: Iterable[str]) -> Iterator[MovedMesh]:
    """Yield the moved meshes of some parts."""
    for name in parts:
        meshes = (config.fixtures.get(name) or config.parts[name]).meshes or []
        # Several meshes of a part keep their heights relative to the lowest.
        lowest_m = min((mesh.middle_m[2] - mesh.size_m[2] / 2 for mesh in meshes), default=0.0)
        for index, mesh in enumerate(meshes):
            if mesh.centre_m is not None:
                continue
            x_m, y_m, z_m = mesh.middle_m
            keeping: Point = (x_m, y_m, z_m - lowest_m)
            moved: Point = (-x_m, -y_m, mesh.size_m[2] / 2 - z_m)
            is_aside = max(abs(x_m), abs(y_m), abs(keeping[2] - mesh.size_m[2] / 2)) > _SHIFT_M
            if is_aside or abs(moved[2]) > _SHIFT_M:
                kept = _round_point(keeping) if is_aside else None
                yield MovedMesh(name, index, mesh, _round_point(moved), kept)


def build_origin_hint(config: AssemblyConfig, parts: Iterable[str]) -> str:
    """Return sentences on moved meshes, to be appended to a fault of their parts' places."""
    moved = find_moved_meshes(config, parts)
    words = dict.fromkeys(mesh.words for mesh in moved if mesh.keeping_m is not None)
    return "".join(f" {sentence}." for sentence in words)


def list_moved_meshes(config: AssemblyConfig) -> tuple[list[str], list[dict[str, Any]]]:
    """Return all moved meshes of an assembly, in words and as JSON values."""
    moved = list(find_moved_meshes(config, (*config.parts, *config.fixtures)))
    lines = [f"mesh       {mesh.words} ({mesh.part})" for mesh in moved]
    entries = [
        {
            "part": mesh.part,
            "mesh": mesh.index,
            "moved_mm": [round(value * 1e3, 3) for value in mesh.moved_m],
            "centre_m": None if mesh.keeping_m is None else list(mesh.keeping_m),
        }
        for mesh in moved
    ]
    return lines, entries


def find_piece_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield concave meshes that no plugin decomposes into convex pieces."""
    concave = [entry for entry in _list_concave_meshes(config) if not entry[3]]
    for number, (name, index, mesh, _) in enumerate(concave, 1):
        # Imports numpy, which most boards do not need.
        from skillplan.collision.decomposition import NoPieces, decompose

        try:
            decompose(mesh, f"{name!r}, mesh {number} of {len(concave)}")
        except NoPieces as error:
            section = "fixtures" if name in config.fixtures else "parts"
            yield Issue(f"{error}.", (section, name, "meshes", index, "file"))


def list_pieces(config: AssemblyConfig) -> tuple[list[str], list[dict[str, Any]]]:
    """Return number and errors of the pieces of each concave mesh, in words and as JSON values."""
    lines, entries = [], []
    for name, index, mesh, given in _list_concave_meshes(config):
        from skillplan.collision.decomposition import decompose, measure_given

        decomposition = measure_given(mesh, given) if given else decompose(mesh)
        count = len(decomposition.pieces)
        lines.append(
            f"pieces     {name} moves as {count} convex piece{'' if count == 1 else 's'}, "
            f"{decomposition.outside_m * 1e3:.2f} mm outside its mesh and "
            f"{max(0.0, decomposition.missing_m) * 1e3:.2f} mm short of it"
        )
        entries.append(
            {
                "part": name,
                "mesh": index,
                "pieces": count,
                "outside_mm": round(decomposition.outside_m * 1e3, 4),
                "missing_mm": round(decomposition.missing_m * 1e3, 4),
            }
        )
    return lines, entries


def _list_concave_meshes(
    config: AssemblyConfig,
) -> Iterator[tuple[str, int, Mesh, tuple[Mesh, ...]]]:
    for name, body in (*config.parts.items(), *config.fixtures.items()):
        for index, mesh in enumerate(body.meshes or ()):
            if body.moves_as_pieces(mesh):
                yield name, index, mesh.shape, mesh.given_pieces


def _round_point(point: Point) -> Point:
    x, y, z = (round(value, _DECIMALS) + 0.0 for value in point)
    return (x, y, z)
