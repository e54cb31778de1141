"""Convex pieces of concave meshes: made by a plugin, then measured and cached."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np

from skillplan.collision.surface import (
    Floats,
    Polyhedron,
    cross_rows,
    make_polyhedron,
    measure_outermost,
)
from skillplan.errors import PluginError
from skillplan.files.atomic_file import write_whole
from skillplan.files.folder import get_cache_folder
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import read_bytes
from skillplan.plugins.installed import list_decompositions
from skillplan.task.pose import Pose
from skillplan.task.shape import Mesh

_LOG = logging.getLogger(__name__)
_STILL = Pose((0.0, 0.0, 0.0))
_DECIMALS = 9
_MOST_BYTES = 64 * 1024 * 1024
# Number of points on either surface at which pieces and mesh are compared.
_SAMPLES = 3_000
# Distance of points from the box of a piece that may reach them [m].
_NEAR_M = 1e-5


class NoPieces(PluginError):
    """No plugin decomposes meshes, or the plugin failed."""


@dataclass(frozen=True)
class Decomposition:
    """Convex pieces of a mesh.

    Parameters
    ----------
    outside_m
        Greatest distance of the pieces outside the mesh [m], at points of their surfaces.
    missing_m
        Greatest distance of the mesh outside the pieces [m], at points of its surface.
    """

    pieces: tuple[Mesh, ...]
    outside_m: float
    missing_m: float

    @property
    def error_m(self) -> float:
        """Greatest distance between the surfaces of mesh and pieces [m]."""
        return max(self.outside_m, self.missing_m)


def decompose(mesh: Mesh, label: str = "a mesh") -> Decomposition:
    """Return the convex pieces of a mesh, from the user's cache or newly made.

    New pieces take seconds to minutes, which a line on stderr announces. A plugin makes them: a
    function under an entry point of the group ``skillplan.decomposition``, from arrays of corners
    [m]
    and faces to corners and faces of each piece.

    Raises
    ------
    NoPieces
        If no plugin is installed, or it raises or returns invalid pieces.
    """
    pieces = _get_cache_slot(mesh)
    if not pieces:
        pieces.append(_load_or_make(mesh, label))
    return pieces[0]


@lru_cache(maxsize=64)
def _get_cache_slot(mesh: Mesh) -> list[Decomposition]:
    """Return the cached list for the pieces of a mesh, empty until they are known."""
    return []


def _load_or_make(mesh: Mesh, label: str) -> Decomposition:
    entry = next(
        iter(sorted(list_decompositions(), key=lambda decomposition: decomposition.name)), None
    )
    if entry is None:
        raise NoPieces(
            "it is not convex, and nothing here takes it apart. Install skillplan-pinocchio, or "
            "split it into convex pieces, one entry of 'meshes' each"
        )
    path = get_cache_folder() / "pieces" / f"{_compute_key(mesh, entry)}.json"
    kept = _load_cached(path)
    if kept is not None:
        return kept
    # logging prints warnings on stderr by default.
    _LOG.warning(
        "skillplan: making convex pieces of %s (%s faces), once on this machine ...",
        label,
        f"{len(mesh.faces):,}",
    )
    try:
        new_pieces = _measure(mesh, _make_pieces(mesh, entry))
    except Exception as error:
        # Plugins may raise any exception.
        raise NoPieces(f"{entry.name} could not take it apart: {error!r}") from error
    # Pieces that cannot be cached are made again.
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(_build_document(new_pieces)))
    return new_pieces


@lru_cache(maxsize=64)
def measure_given(mesh: Mesh, pieces: tuple[Mesh, ...]) -> Decomposition:
    """Return measured convex pieces from a task file."""
    return _measure(mesh, pieces)


def _compute_key(mesh: Mesh, entry: EntryPoint) -> str:
    """Return a hash of everything that affects the pieces."""
    distribution = "" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    version = getattr(_load_plugin(entry), "version", "")
    parts = [entry.value, distribution, version, repr(mesh.corners), repr(mesh.faces), _SAMPLES]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _load_plugin(entry: EntryPoint) -> Any:
    try:
        return entry.load()
    except Exception as error:
        raise NoPieces(
            f"it is not convex, and {entry.name}, which would take it apart, cannot be loaded: "
            f"{error}. Install its distribution again"
        ) from error


def _make_pieces(mesh: Mesh, entry: EntryPoint) -> tuple[Mesh, ...]:
    corners, faces = np.array(mesh.corners, dtype=float), np.array(mesh.faces, dtype=np.int64)
    surfaces: Iterable[tuple[Any, Any]] = _load_plugin(entry)(corners, faces)
    pieces = tuple(
        _build_piece(np.asarray(own, dtype=float), np.asarray(of)) for own, of in surfaces
    )
    if not pieces:
        raise ValueError("it returned no piece")
    return pieces


def _build_piece(corners: Floats, faces: Any) -> Mesh:
    a, b, c = (corners[faces[:, i]] for i in range(3))
    if float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) < 0:
        faces = faces[:, ::-1]
    rounded = np.round(corners, _DECIMALS) + 0.0
    return Mesh(
        tuple((float(x), float(y), float(z)) for x, y, z in rounded),
        tuple((int(i), int(j), int(k)) for i, j, k in faces),
    )


def _measure(mesh: Mesh, pieces: tuple[Mesh, ...]) -> Decomposition:
    whole = make_polyhedron(mesh, _STILL)
    parts = [make_polyhedron(piece, _STILL) for piece in pieces]
    outer = np.concatenate(
        [_sample_surface(part.triangles, _SAMPLES // len(parts)) for part in parts]
    )
    own = _sample_surface(whole.triangles, _SAMPLES)
    reached = np.full(len(own), -np.inf)
    for part in parts:
        # Most points are in a piece, and few pieces have a point in their box.
        low, high = part.corners.min(axis=0) - _NEAR_M, part.corners.max(axis=0) + _NEAR_M
        near = np.flatnonzero(((own >= low) & (own <= high)).all(axis=1))
        reached[near] = np.maximum(reached[near], _measure_reached(part, own[near]))
    missing_m = _measure_missing(parts, own, reached)
    return Decomposition(pieces, round(measure_outermost(whole, outer), 7), round(missing_m, 7))


def _measure_missing(parts: Sequence[Polyhedron], points: Floats, at_least_m: Floats) -> float:
    """Return how far the outermost point is outside all convex pieces [m]; 0 if none is.

    Parameters
    ----------
    at_least_m
        How far points are within some of the pieces at least [m].
    """
    order, least_m, first, count = np.argsort(at_least_m), 0.0, 0, 1
    while first < len(order) and at_least_m[order[first]] < least_m:
        some = points[order[first : first + count]]
        reached = np.max([_measure_reached(part, some) for part in parts], axis=0)
        least_m = min(least_m, float(reached.min()))
        first, count = first + count, 2 * count
    return -least_m


def _measure_reached(part: Polyhedron, points: Floats) -> Floats:
    """Return how far points are within a convex piece [m]; negative outside."""
    normals, offsets = part.planes
    # A row for each plane: the least of columns is found many times as fast as that of rows.
    return np.asarray((offsets[:, None] - normals @ points.T).min(axis=0))


def _sample_surface(triangles: Floats, count: int) -> Floats:
    """Return evenly spread points on triangles: corners, and `count` points in between."""
    a, b, c = (triangles[:, i] for i in range(3))
    areas = np.linalg.norm(cross_rows(b - a, c - a), axis=1) / 2
    steps = np.cumsum(areas) / max(areas.sum(), 1e-30)
    # Halton sequence in bases 2 and 3: the same points in every run.
    shares = (np.arange(count) + 0.5) / count
    which = np.minimum(np.searchsorted(steps, shares), len(triangles) - 1)
    u, v = _draw_halton(count, 2), _draw_halton(count, 3)
    over = u + v > 1
    u, v = np.where(over, 1 - u, u)[:, None], np.where(over, 1 - v, v)[:, None]
    inner = a[which] + u * (b - a)[which] + v * (c - a)[which]
    return np.concatenate([triangles.reshape(-1, 3)[:count], inner])


@lru_cache(maxsize=64)
def _draw_halton(count: int, base: int) -> Floats:
    values, share, rest = np.zeros(count), 1.0, np.arange(1, count + 1)
    while rest.any():
        share /= base
        values += share * (rest % base)
        rest //= base
    return values


def _build_document(decomposition: Decomposition) -> dict[str, Any]:
    pieces = [{"corners": piece.corners, "faces": piece.faces} for piece in decomposition.pieces]
    return {
        "pieces": pieces,
        "outside_m": decomposition.outside_m,
        "missing_m": decomposition.missing_m,
    }


def _load_cached(path: Path) -> Decomposition | None:
    """Return the pieces in a file; None if it is missing or damaged."""
    try:
        document = parse_json(read_bytes(path, _MOST_BYTES))
        pieces = tuple(
            Mesh(
                tuple((float(x), float(y), float(z)) for x, y, z in piece["corners"]),
                tuple((int(a), int(b), int(c)) for a, b, c in piece["faces"]),
            )
            for piece in document["pieces"]
        )
        outside_m, missing_m = float(document["outside_m"]), float(document["missing_m"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        _LOG.warning("Pieces in %s are made again: %s", path, error)
        return None
    return Decomposition(pieces, outside_m, missing_m) if pieces else None
