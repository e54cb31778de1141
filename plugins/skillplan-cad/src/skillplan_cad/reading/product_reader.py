"""Read a file or folder as a product: closed parts with unique names, masses and shapes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skillplan.errors import OptionError
from skillplan.files.regular_file import is_folder, is_regular
from skillplan_cad.product import Part, Points, Product, Triangles
from skillplan_cad.reading.mending import Mended, compute_centre_m, compute_volumes_m3, mend, split
from skillplan_cad.reading.mesh_folder import SUFFIXES as MESHES
from skillplan_cad.reading.mesh_folder import UNITS_M, is_utf8, read_folder
from skillplan_cad.reading.raw_part import RawPart, RawProduct, compute_area_vectors_m2
from skillplan_cad.reading.step_file import SUFFIXES as STEP
from skillplan_cad.reading.step_file import is_step, read_step
from skillplan_cad.reading.surface_fit import fit_faces, recognise_face

# Largest number of corner pairs to try.
_TRIED = 400
_SAMPLES = 400


def find_shapes(
    parts: Sequence[RawPart], chord_m: float
) -> tuple[NDArray[np.int64], dict[int, int]]:
    """Return the shape number of each part, and the originals of mirrored shapes.

    Parameters
    ----------
    chord_m
        Largest distance between meshes of the same shape, in chords [m].
    """
    figures = [_Figure(part, chord_m) for part in parts]
    shape = np.zeros(len(parts), dtype=np.int64)
    originals: list[_Figure] = []
    mirrors: dict[int, int] = {}
    for number, figure in enumerate(figures):
        match = None
        for known, other in enumerate(originals):
            if not figure.may_equal(other):
                continue
            if figure.lies_over(other, mirrored=False):
                match = known
                break
            if known not in mirrors and figure.lies_over(other, mirrored=True):
                mirrors.setdefault(len(originals), known)
        if match is None:
            match = len(originals)
            originals.append(figure)
        else:
            mirrors.pop(len(originals), None)
        shape[number] = match
    return shape, mirrors


class _Figure:
    """A mesh about its centre, with the measures that equal meshes share."""

    def __init__(self, part: RawPart, chord_m: float) -> None:
        vertices, triangles = part.vertices_m, part.triangles
        self.volume = float(compute_volumes_m3(vertices, triangles).sum())
        self.area = float(
            np.linalg.norm(compute_area_vectors_m2(vertices, triangles), axis=1).sum()
        )
        self.points = vertices - compute_centre_m(vertices, triangles)
        self.radii = np.linalg.norm(self.points, axis=1)
        self.size = float(self.radii.max())
        self.tolerance = max(2 * chord_m, 1e-4 * self.size)
        dense, spacing = _sample_surface(self.points, triangles, self.tolerance)
        self.tree, self.reach = cKDTree(dense), max(3 * self.tolerance, spacing)
        step = max(1, len(self.points) // _SAMPLES)
        self.samples = self.points[::step]

    def may_equal(self, other: _Figure) -> bool:
        """Return whether size, volume and area allow equality."""
        slack = self.tolerance
        return (
            abs(self.size - other.size) <= 2 * slack
            and abs(self.volume - other.volume) <= slack * min(self.area, other.area) * 0.5
            and abs(self.area - other.area) <= max(0.01 * self.area, slack * self.size)
        )

    def lies_over(self, other: _Figure, *, mirrored: bool) -> bool:
        """Return whether a motion, optionally with a mirror, maps this mesh onto another."""
        for turn in self._iterate_turns(other, mirrored):
            if other.covers(self.samples @ turn.T) and self.covers(other.samples @ turn):
                return True
        return False

    def covers(self, points: Points) -> bool:
        """Return whether all points lie on the surface."""
        distances, _ = self.tree.query(points, distance_upper_bound=self.reach)
        return bool(np.isfinite(distances).all())

    def _iterate_turns(self, other: _Figure, mirrored: bool) -> Iterator[NDArray[np.float64]]:
        first = int(np.argmax(self.radii))
        a = self.points[first]
        off = np.linalg.norm(np.cross(self.points, a / self.radii[first]), axis=1)
        b = self.points[int(np.argmax(off))]
        own = _build_frame(a, b, mirrored=False)
        slack, tried = 2 * self.tolerance, 0
        if own is None:
            return
        heads = np.flatnonzero(np.abs(other.radii - np.linalg.norm(a)) < slack)
        seconds = np.flatnonzero(np.abs(other.radii - np.linalg.norm(b)) < slack)
        distance = np.linalg.norm(a - b)
        for head in heads:
            gaps = np.linalg.norm(other.points[seconds] - other.points[head], axis=1)
            for second in seconds[np.abs(gaps - distance) < slack]:
                frame = _build_frame(other.points[head], other.points[second], mirrored=mirrored)
                if frame is None:
                    continue
                tried += 1
                yield frame @ own.T
                if tried >= _TRIED:
                    return


def _build_frame(
    a: NDArray[np.float64], b: NDArray[np.float64], *, mirrored: bool
) -> NDArray[np.float64] | None:
    """Return the axes defined by two points, as columns; the third is flipped if mirrored."""
    x = a / np.linalg.norm(a)
    across = b - (b @ x) * x
    length = np.linalg.norm(across)
    if length < 1e-9:
        return None
    y = across / length
    z = np.cross(x, y)
    return np.stack([x, y, -z if mirrored else z], axis=1)


def _sample_surface(points: Points, triangles: Triangles, spacing: float) -> tuple[Points, float]:
    """Return the vertices with points spread over the triangles, and their spacing."""
    corners = points[triangles]
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    total = float(area.sum())
    count = int(min(20000, max(2000, total / max(spacing, 1e-9) ** 2)))
    per = np.ceil(count * area / max(total, 1e-30)).astype(np.int64)
    which = np.repeat(np.arange(len(triangles)), per)
    order = np.arange(len(which))
    u, v = (order * 0.7548776662466927) % 1.0, (order * 0.5698402909980532) % 1.0
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    spread = a[which] + u[:, None] * ab[which] + v[:, None] * ac[which]
    return np.concatenate([points, spread]), float(np.sqrt(total / max(len(which), 1)))


STEEL_KG_M3 = 7850.0
# Rays have single precision, which resolves 1/16,000,000 of a length.
MOST_EXTENT_M = 10_000.0
# The smallest tolerance does not resolve thinner parts.
LEAST_THICKNESS_M = 1e-6
# Largest number of open parts in a message.
_NAMED = 6


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options of reading a product.

    Parameters
    ----------
    unit
        Unit of meshes; None for STEP, which states its own.
    chord_m
        Greatest distance of triangles from curved faces of STEP [m].
    split_bodies
        True to make each body a part.
    """

    unit: str | None = None
    chord_m: float = 5e-5
    split_bodies: bool = False
    density_kg_m3: float = STEEL_KG_M3


def read_product(path: Path, options: ReadOptions) -> Product:
    """Read the product of a STEP file or a folder of meshes.

    Raises
    ------
    OptionError
        If it is unreadable, a part is not watertight, or it has fewer than two parts.
    """
    raw = _read_raw(path, options)
    _refuse_far(path, raw)
    repaired = [mend(part) for part in raw.parts]
    _refuse_open(path, repaired)
    _refuse_thin(path, [mesh.part for mesh in repaired])
    notes = [*raw.notes, *(note for mesh in repaired for note in mesh.notes)]
    parts: list[RawPart] = []
    bodies: list[int] = []
    for mesh in repaired:
        count = int(mesh.bodies.max()) + 1
        if count > 1 and options.split_bodies:
            parts += split(mesh)
            bodies += [1] * count
            notes.append(f"{mesh.part.name}: its {count} bodies are parts of their own")
            continue
        if count > 1:
            notes.append(
                f"{mesh.part.name}: is one part of {count} bodies; --split-bodies makes each a part"
            )
        parts.append(mesh.part)
        bodies.append(count)
    _refuse_single(path, parts, bodies)
    notes.append(
        f"masses are those of a density of {options.density_kg_m3:g} kg/m3"
        + (", steel" if options.density_kg_m3 == STEEL_KG_M3 else "")
    )
    return _build_product(raw, parts, bodies, tuple(notes), options)


def _read_raw(path: Path, options: ReadOptions) -> RawProduct:
    if not is_utf8(path.resolve().name):
        raise OptionError(f"{path}: its name is not UTF-8, and the product takes its name from it.")
    if is_folder(path):
        return read_folder(path, options.unit)
    if not is_regular(path):
        raise OptionError(f"{path}: there is no such file or folder.")
    if is_step(path):
        if options.unit is not None:
            raise OptionError(f"--unit {options.unit}: STEP states its unit itself; leave it out.")
        return read_step(path, options.chord_m)
    if path.suffix.lower() in MESHES:
        raise OptionError(
            f"{path}: is one mesh. Give the folder of all parts, one file a part, and --unit."
        )
    raise OptionError(
        f"{path}: is neither STEP ({', '.join(STEP)}) nor a folder of meshes ({', '.join(MESHES)})."
    )


def _refuse_far(path: Path, raw: RawProduct) -> None:
    """Refuse a product that is too long to resolve its parts."""
    filled = [part for part in raw.parts if len(part.vertices_m)]
    if not filled:
        return
    low = np.min([part.vertices_m.min(axis=0) for part in filled], axis=0)
    high = np.max([part.vertices_m.max(axis=0) for part in filled], axis=0)
    with np.errstate(over="ignore"):
        extent_m = float((high - low).max())
    if extent_m <= MOST_EXTENT_M:
        return
    middle = np.median([part.vertices_m[0] for part in filled], axis=0)
    with np.errstate(over="ignore"):
        reach = [float(np.abs(part.vertices_m - middle).max()) for part in filled]
    farthest = filled[int(np.argmax(reach))]
    raise OptionError(
        f"{path}: is {extent_m:.3g} m long, where {MOST_EXTENT_M:,.0f} m are the most; "
        f"{_join_name(farthest)} reaches farthest. Correct that part, or its unit ({raw.unit})."
    )


def _refuse_thin(path: Path, parts: Sequence[RawPart]) -> None:
    """Refuse a part without thickness, by the ratio of volume and surface."""
    for part in parts:
        volume = float(compute_volumes_m3(part.vertices_m, part.triangles).sum())
        surface = float(
            np.linalg.norm(compute_area_vectors_m2(part.vertices_m, part.triangles), axis=1).sum()
        )
        if not volume > LEAST_THICKNESS_M / 2 * surface > 0:
            thickness_m = 2 * volume / surface if surface > 0 else 0.0
            raise OptionError(
                f"{path}: {_join_name(part)} is {thickness_m:.3g} m thick, where "
                f"{LEAST_THICKNESS_M:g} m are the least. Correct it, or leave it out."
            )


def _refuse_open(path: Path, repaired: Sequence[Mended]) -> None:
    gaps = [mesh for mesh in repaired if mesh.open_edges or not len(mesh.part.triangles)]
    if not gaps:
        return
    named = []
    for gap in gaps[:_NAMED]:
        at = ", ".join(f"{value * 1000:.4g}" for value in gap.gap_point_m)
        named.append(f"{_join_name(gap.part)} ({gap.open_edges} open edges, one at [{at}] mm)")
    more = f" and {len(gaps) - _NAMED} more" if len(gaps) > _NAMED else ""
    raise OptionError(
        f"{path}: not watertight: {'; '.join(named)}{more}. Make solids of these in CAD, or leave "
        "them out."
    )


def _refuse_single(path: Path, parts: Sequence[RawPart], bodies: Sequence[int]) -> None:
    if len(parts) > 1:
        return
    if bodies[0] > 1:
        raise OptionError(
            f"{path}: holds one part, {parts[0].name}, of {bodies[0]} bodies. --split-bodies makes "
            "each of these a part."
        )
    raise OptionError(
        f"{path}: holds one part, {parts[0].name}; there is nothing to assemble. Save the assembly."
    )


def _build_product(
    raw: RawProduct,
    parts: Sequence[RawPart],
    bodies: Sequence[int],
    notes: tuple[str, ...],
    options: ReadOptions,
) -> Product:
    shapes, mirrors = find_shapes(parts, raw.chord_m)
    names = _assign_names(parts)
    product_parts = []
    for number, part in enumerate(parts):
        faces = (
            tuple(recognise_face(face, part.vertices_m, part.triangles) for face in part.faces)
            if part.faces
            else fit_faces(part.vertices_m, part.triangles)
        )
        centre = compute_centre_m(part.vertices_m, part.triangles)
        product_parts.append(
            Part(
                name=names[number],
                path=part.path,
                vertices_m=part.vertices_m,
                triangles=part.triangles,
                faces=faces,
                volume_m3=float(compute_volumes_m3(part.vertices_m, part.triangles).sum()),
                density_kg_m3=options.density_kg_m3,
                centre_m=(float(centre[0]), float(centre[1]), float(centre[2])),
                shape=int(shapes[number]),
                mirrors=mirrors.get(int(shapes[number])),
                bodies=bodies[number],
                design=part.design,
            )
        )
    repeated = sorted(name for name, count in Counter(map(_join_name, parts)).items() if count > 1)
    if repeated:
        shown = ", ".join(repeated[:_NAMED]) + (" and others" if len(repeated) > _NAMED else "")
        notes = (*notes, f"names that repeat are numbered: {shown}")
    return Product(raw.name, tuple(product_parts), raw.unit, raw.chord_m, notes)


def _assign_names(parts: Sequence[RawPart]) -> list[str]:
    """Return the path of each part below the root; repeated paths are numbered."""
    taken: set[str] = set()
    names = []
    for part in parts:
        name = stem = _join_name(part)
        number = 1
        while name in taken:
            number += 1
            name = f"{stem}#{number}"
        taken.add(name)
        names.append(name)
    return names


def _join_name(part: RawPart) -> str:
    return "/".join((*part.path[1:], part.name or "part"))


__all__ = ["STEEL_KG_M3", "UNITS_M", "ReadOptions", "read_product"]
