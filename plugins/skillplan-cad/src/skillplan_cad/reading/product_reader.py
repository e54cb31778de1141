"""Read a file or folder as a product: closed parts with unique names, masses and shapes."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skillplan.errors import OptionError, name_hint
from skillplan.files.regular_file import is_folder, is_regular
from skillplan_cad.product import Closure, Part, Points, Product, Triangles, make_solid
from skillplan_cad.reading.mending import compute_centre_m, compute_volumes_m3, join, split, thicken
from skillplan_cad.reading.mesh_folder import SCENES, UNITS_M, read_folder, read_scene
from skillplan_cad.reading.mesh_folder import SUFFIXES as MESHES
from skillplan_cad.reading.raw_part import (
    MOST_TRIANGLES,
    Measure,
    Mended,
    RawPart,
    RawProduct,
    compute_area_vectors_m2,
)
from skillplan_cad.reading.step_file import SUFFIXES as STEP
from skillplan_cad.reading.step_file import Report, is_step, read_step
from skillplan_cad.reading.surface_fit import fit_faces, recognise_face

# Largest number of corner pairs to try.
_TRIED = 400
_SAMPLES = 400


def find_shapes(
    parts: Sequence[RawPart], chord_m: float, report: Report = lambda text: None
) -> tuple[NDArray[np.int64], dict[int, int]]:
    """Return the shape number of each part, and the originals of mirrored shapes.

    Parameters
    ----------
    chord_m
        Largest distance between meshes of the same shape, in chords [m].
    report
        Called with progress.
    """
    shape = np.zeros(len(parts), dtype=np.int64)
    originals: list[_Figure] = []
    mirrors: dict[int, int] = {}
    for number, part in enumerate(parts):
        report(f"comparing shapes, {number + 1} of {len(parts)} parts")
        figure = _Figure(part, chord_m)
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
        self.triangles = triangles
        self.volume = float(compute_volumes_m3(vertices, triangles).sum())
        self.area = float(
            np.linalg.norm(compute_area_vectors_m2(vertices, triangles), axis=1).sum()
        )
        self.points = vertices - compute_centre_m(vertices, triangles)
        self.radii = np.linalg.norm(self.points, axis=1)
        self.size = float(self.radii.max())
        self.tolerance = max(2 * chord_m, 1e-4 * self.size)
        self.samples = self.points[:: max(1, len(self.points) // _SAMPLES)]

    @cached_property
    def surface(self) -> tuple[Any, float]:
        """Points spread over the surface as a tree, and the reach of a search among them [m]."""
        dense, spacing = _sample_surface(self.points, self.triangles, self.tolerance)
        return cKDTree(dense), max(3 * self.tolerance, spacing)

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
        if self._equals(other, mirrored):
            return True
        for turn in self._iterate_turns(other, mirrored):
            if other.covers(self.samples @ turn.T) and self.covers(other.samples @ turn):
                return True
        return False

    def covers(self, points: Points) -> bool:
        """Return whether all points lie on the surface."""
        tree, reach = self.surface
        distances, _ = tree.query(points, distance_upper_bound=reach)
        return bool(np.isfinite(distances).all())

    def _equals(self, other: _Figure, mirrored: bool) -> bool:
        """Return whether the meshes have the same triangles, and corners after a motion.

        That is so for instances of a design. Source: Kabsch, Acta Cryst. A32 (1976), 922.
        """
        same = [self.triangles, self.triangles[:, ::-1]]
        if not any(np.array_equal(triangles, other.triangles) for triangles in same):
            return False
        left, _, right = np.linalg.svd(self.points.T @ other.points)
        sign = np.linalg.det(left) * np.linalg.det(right)
        turn = (left * (1, 1, -sign if mirrored else sign)) @ right
        off = np.abs(self.points @ turn - other.points).max()
        return bool(off <= self.tolerance)

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
# Interval of reports of progress [s].
_PATIENCE_S = 2.0
# Largest number of parts in a message.
_NAMED = 6
# Largest thickness of a surface without a stated one [m].
_SHEET_M = 2e-5
# Largest number of parts tested for a common frame; smallest share of their pairs that overlap, and
# smallest share of the smaller volume of such a pair.
_FRAME_SAMPLE, _FRAME_SHARE, _DEEP = 10, 0.6, 0.1
# Sizes at which the unit of meshes is in doubt [m].
_LEAST_PART_M, _LEAST_PRODUCT_M, _MOST_PART_M = 1e-3, 1e-2, 10.0


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options of reading a product.

    Parameters
    ----------
    unit
        Unit of meshes; of STEP, a unit in place of the stated one; None for that.
    chord_m
        Greatest distance of triangles from curved faces of STEP, and largest gap to close [m].
    split_bodies
        True to make each body a part.
    thickness_m
        Thickness of open surfaces, for their mass [m]; None for the mass of their boxes.
    leave_out, only
        Patterns of the names of parts that are left out, or of the only parts that are read.
    as_one
        Patterns; the parts of each become one part.
    units
        Names of the parts of bought-in units, each of which becomes one part.
    split_parts
        Names of parts whose bodies become parts.
    fewest
        Number of parts below which a product is refused.
    """

    unit: str | None = None
    chord_m: float = 5e-5
    split_bodies: bool = False
    thickness_m: float | None = None
    leave_out: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    as_one: tuple[str, ...] = ()
    units: tuple[tuple[str, ...], ...] = ()
    split_parts: tuple[str, ...] = ()
    fewest: int = 2


def read_product(path: Path, options: ReadOptions, report: Report | None = None) -> Product:
    """Read the product of a STEP file or a folder of meshes.

    Parameters
    ----------
    report
        Called with progress.

    Raises
    ------
    OptionError
        If it is unreadable, or fewer than two parts are left.
    """
    report = _report_seldom(report or (lambda text: None))
    raw = _read_raw(path, options, report)
    notes, warnings = [*raw.notes], [*raw.warnings]
    parts, split_notes = _split_bodies(raw.parts, options)
    parts = _rename(parts)
    parts, far = _leave_out_far(path, parts, raw.unit)
    warnings += far
    parts, left_out = _select_parts(path, parts, options)
    repeated = sorted(_list_repeated(parts))
    parts, joined = _join_parts(path, parts, options)
    notes += (note for mesh in parts for note in mesh.notes)
    notes += [*split_notes, *left_out, *joined]
    parts, sheets = _thicken_surfaces(parts, options)
    warnings += sheets
    parts, thin = _leave_out_thin(parts)
    warnings += thin
    _refuse_few(path, parts, options.fewest, warnings)
    _refuse_many_triangles(path, parts)
    _refuse_own_frames(path, parts)
    shapes, mirrors = find_shapes([mesh.part for mesh in parts], raw.chord_m, report)
    twice = _find_doubles(parts, shapes, raw.chord_m)
    warnings += twice.values()
    kept = [number for number in range(len(parts)) if number not in twice]
    parts, shapes = [parts[number] for number in kept], shapes[kept]
    _refuse_few(path, parts, options.fewest, warnings)
    if raw.chord_m == 0:
        warnings += _question_unit(parts, raw.unit)
    if repeated:
        shown = ", ".join(repeated[:_NAMED]) + (" and others" if len(repeated) > _NAMED else "")
        notes.append(f"names that repeat are numbered: {shown}")
    built = []
    for number, (mesh, shape) in enumerate(zip(parts, shapes, strict=True), 1):
        report(f"faces of {number} of {len(parts)} parts")
        built.append(_build_part(mesh, int(shape), mirrors.get(int(shape)), options))
    return Product(
        raw.name,
        tuple(built),
        raw.unit,
        raw.chord_m,
        tuple(dict.fromkeys(notes)),
        tuple(dict.fromkeys(warnings)),
    )


def read_finer(path: Path, product: Product, options: ReadOptions, share: float) -> Product:
    """Return a product of STEP with a finer tessellation; parts keep theirs if it fails for them.

    Parameters
    ----------
    options
        Options by which the product was read.
    share
        Factor on the chord.
    """
    if is_folder(path) or not is_step(path):
        return product
    try:
        changed = replace(options, chord_m=share * options.chord_m, unit=product.unit)
        finer = read_product(path, changed)
    except OptionError:
        # The product has been read, so another chord is no reason to refuse it.
        return product
    parts = {part.name: part for part in finer}
    return replace(
        product,
        parts=tuple(
            parts[own.name] if own.name in parts and parts[own.name].closure == own.closure else own
            for own in product
        ),
    )


def _split_bodies(meshes: Sequence[Mended], options: ReadOptions) -> tuple[list[Mended], list[str]]:
    """Return the parts, with bodies as parts if requested, and notes."""
    parts: list[Mended] = []
    notes = []
    for name, mesh in zip(_assign_names([mesh.part for mesh in meshes]), meshes, strict=True):
        count = int(mesh.bodies.max(initial=0)) + 1
        if count > 1 and (options.split_bodies or name in options.split_parts):
            bodies = split(mesh)
            bodies[0] = replace(bodies[0], notes=mesh.notes)
            parts += bodies
            words = "" if options.split_bodies else ", as they close other parts in; --no-units"
            end = f"{words} keeps them together" if words else ""
            notes.append(f"{mesh.part.name}: its {count} bodies are parts of their own{end}")
            continue
        if count > 1:
            notes.append(
                f"{mesh.part.name}: is one part of {count} bodies; --split-bodies makes each a part"
            )
        parts.append(mesh)
    return parts, notes


def _rename(meshes: Sequence[Mended]) -> list[Mended]:
    """Return parts with unique names below the root, in their paths."""
    names = _assign_names([mesh.part for mesh in meshes])
    return [
        replace(mesh, part=replace(mesh.part, label=name))
        for mesh, name in zip(meshes, names, strict=True)
    ]


def _select_parts(
    path: Path, meshes: Sequence[Mended], options: ReadOptions
) -> tuple[list[Mended], list[str]]:
    """Return the parts that options select, and a note on the others."""
    names = [mesh.part.label for mesh in meshes]
    dropped: set[str] = set()
    for option, patterns in (("--leave-out", options.leave_out), ("--only", options.only)):
        chosen: set[str] = set()
        for pattern in patterns:
            fitting = {name for name in names if fits_pattern(name, pattern)}
            # Files of meshes are left out before they are read.
            if not fitting and not (option == "--leave-out" and is_folder(path)):
                raise OptionError(_describe_no_match(option, pattern, names))
            chosen |= fitting
        if option == "--leave-out":
            dropped |= chosen
        elif patterns:
            dropped |= set(names) - chosen
    kept = [mesh for mesh in meshes if mesh.part.label not in dropped]
    ordered = [name for name in names if name in dropped]
    if not ordered:
        return kept, []
    shown = ", ".join(ordered[:_NAMED]) + (" and others" if len(ordered) > _NAMED else "")
    return kept, [f"{len(ordered)} part{'s' if ordered[1:] else ''} left out as requested: {shown}"]


def fits_pattern(name: str, pattern: str) -> bool:
    """Return whether a part's name, or its last word, fits a pattern such as ``bolt*``."""
    return any(fnmatchcase(text, pattern) for text in (name, name.rpartition("/")[2]))


def _describe_no_match(option: str, pattern: str, names: Sequence[str]) -> str:
    return f"{option} {pattern}: no part has such a name. {name_hint(pattern, names)}"


def _join_parts(
    path: Path, meshes: list[Mended], options: ReadOptions
) -> tuple[list[Mended], list[str]]:
    """Return the parts with those of each pattern joined to one, and notes."""
    notes = []
    for pattern in options.as_one:
        fitting = [mesh for mesh in meshes if fits_pattern(mesh.part.label, pattern)]
        if not fitting:
            raise OptionError(
                _describe_no_match("--as-one", pattern, [mesh.part.label for mesh in meshes])
            )
        if len(fitting) < 2:
            raise OptionError(
                f"--as-one {pattern}: only {fitting[0].part.label} has such a name; give a pattern "
                "that fits two parts or more."
            )
        meshes, note = _join(meshes, fitting)
        notes.append(note)
    for names in options.units:
        meshes, note = _join(meshes, [mesh for mesh in meshes if mesh.part.label in names])
        notes.append(f"{note}, which is bought in as a unit; --no-units keeps them apart")
    return meshes, notes


def _join(meshes: list[Mended], chosen: Sequence[Mended]) -> tuple[list[Mended], str]:
    """Return the parts with some of them joined to one, and a note."""
    largest = max(chosen, key=_measure_volume_m3).part
    whole = join(largest.name, list(chosen))
    whole = replace(whole, part=replace(largest, **_get_geometry(whole.part)))
    first = meshes.index(chosen[0])
    kept = [mesh for mesh in meshes if mesh not in chosen]
    kept.insert(first, whole)
    others = ", ".join(mesh.part.label for mesh in chosen)
    return kept, f"{others} are one part, {largest.label}"


def _get_geometry(part: RawPart) -> dict[str, Any]:
    return {"vertices_m": part.vertices_m, "triangles": part.triangles, "faces": part.faces}


def _measure_volume_m3(mesh: Mended) -> float:
    return abs(float(compute_volumes_m3(mesh.part.vertices_m, mesh.part.triangles).sum()))


def _thicken_surfaces(
    meshes: Sequence[Mended], options: ReadOptions
) -> tuple[list[Mended], list[str]]:
    """Return the parts with open surfaces as thin sheets, and warnings about these."""
    parts, warnings = [], []
    for mesh in meshes:
        part = mesh.part
        if not mesh.open_edges:
            parts.append(mesh)
            continue
        thickness_m = options.thickness_m or min(_SHEET_M, options.chord_m)
        size_m = np.ptp(part.vertices_m, axis=0)
        sheet = thicken(part, thickness_m)
        if options.thickness_m:
            volume_m3, words = None, f"a sheet {options.thickness_m * 1000:g} mm thick"
        else:
            volume_m3 = float(np.prod(np.maximum(size_m, thickness_m)))
            words = "a surface, with the mass of its box; --thickness MM makes it a sheet"
        measures: tuple[Measure, ...] = ()
        if volume_m3 is not None:
            middle = (part.vertices_m.min(axis=0) + part.vertices_m.max(axis=0)) / 2
            measures = (Measure(volume_m3, (float(middle[0]), float(middle[1]), float(middle[2]))),)
        parts.append(
            replace(
                mesh,
                part=sheet,
                bodies=np.zeros(len(sheet.triangles), dtype=np.int64),
                measures=measures,
            )
        )
        extents = " x ".join(f"{value:.4g}" for value in size_m * 1000 if value > 1e-6)
        at = ", ".join(f"{value * 1000:.4g}" for value in mesh.gap_point_m)
        warnings.append(
            f"{part.label} is not closed: a surface of {extents} mm with {mesh.open_edges} open "
            f"edges, one at [{at}] mm. It is taken as {words}, or --leave-out it."
        )
    return parts, warnings


def _leave_out_thin(meshes: Sequence[Mended]) -> tuple[list[Mended], list[str]]:
    """Return the parts with a thickness, and warnings about the others."""
    parts, warnings = [], []
    for mesh in meshes:
        part = mesh.part
        volume = float(compute_volumes_m3(part.vertices_m, part.triangles).sum())
        surface = float(
            np.linalg.norm(compute_area_vectors_m2(part.vertices_m, part.triangles), axis=1).sum()
        )
        if volume > LEAST_THICKNESS_M / 2 * surface > 0:
            parts.append(mesh)
            continue
        thickness_m = 2 * volume / surface if surface > 0 else 0.0
        warnings.append(
            f"{part.label} is left out: it is {thickness_m:.3g} m thick, where "
            f"{LEAST_THICKNESS_M:g} m are the least."
        )
    return parts, warnings


def _find_doubles(
    meshes: Sequence[Mended], shapes: NDArray[np.int64], chord_m: float
) -> dict[int, str]:
    """Return the parts that have the shape and the place of an earlier one, with a warning each."""
    doubles: dict[int, str] = {}
    for number, mesh in enumerate(meshes):
        vertices = mesh.part.vertices_m
        near_m = max(2 * chord_m, 1e-4 * float(np.ptp(vertices, axis=0).max()))
        for other in range(number):
            if other in doubles or shapes[other] != shapes[number]:
                continue
            there = meshes[other].part.vertices_m
            if (
                np.abs(
                    np.concatenate(
                        [
                            vertices.min(axis=0) - there.min(axis=0),
                            vertices.max(axis=0) - there.max(axis=0),
                        ]
                    )
                ).max()
                > near_m
            ):
                continue
            distances, _ = cKDTree(there).query(vertices)
            if distances.max() <= near_m:
                volume = _measure_volume_m3(mesh) * 1e9
                doubles[number] = (
                    f"{mesh.part.label} has the shape and the place of {meshes[other].part.label} "
                    f"({volume:,.0f} mm3); it is taken once."
                )
                break
    return doubles


def _refuse_own_frames(path: Path, meshes: Sequence[Mended]) -> None:
    """Refuse parts that lie in each other, because each has a frame of its own."""
    count = len(meshes)
    if count < 3:
        return
    order = sorted(range(count), key=lambda number: len(meshes[number].part.triangles))
    sample = sorted(order[:_FRAME_SAMPLE])
    pairs = list(combinations(sample, 2))
    low = {number: meshes[number].part.vertices_m.min(axis=0) for number in sample}
    high = {number: meshes[number].part.vertices_m.max(axis=0) for number in sample}

    def share_boxes(first: int, second: int) -> bool:
        common = np.minimum(high[first], high[second]) - np.maximum(low[first], low[second])
        smaller = np.minimum(high[first] - low[first], high[second] - low[second])
        return bool((common > 0.1 * smaller).all())

    sharing = [pair for pair in pairs if share_boxes(*pair)]
    if len(sharing) < _FRAME_SHARE * len(pairs):
        return
    deep = 0
    for left, (first, second) in zip(range(len(sharing), 0, -1), sharing, strict=True):
        if deep + left < _FRAME_SHARE * len(pairs):
            return
        deep += _overlap_deeply(meshes[first].part, meshes[second].part)
    if deep < _FRAME_SHARE * len(pairs):
        return
    middle = np.mean([(low[number] + high[number]) / 2 for number in sample], axis=0)
    at = ", ".join(f"{value * 1000:.4g}" for value in middle)
    looked = "" if len(sample) == count else f" of {len(sample)} looked at"
    raise OptionError(
        f"{path}: all {count} parts lie about one point, [{at}] mm, and {deep} of {len(pairs)} "
        f"pairs{looked} overlap: each part is in a frame of its own, so this is no assembly. "
        "Export the parts from the assembly, in its frame."
    )


def _overlap_deeply(first: RawPart, second: RawPart) -> bool:
    """Return whether two parts share a tenth of the smaller volume."""
    solids = [make_solid(part.vertices_m, part.triangles) for part in (first, second)]
    volumes = [float(solid.volume()) for solid in solids]
    if min(volumes) <= 0:
        return False
    return float((solids[0] ^ solids[1]).volume()) > _DEEP * min(volumes)


def _question_unit(meshes: Sequence[Mended], unit: str) -> list[str]:
    """Return a warning if the unit of meshes makes a part or the product tiny or huge."""
    sizes = [float(np.ptp(mesh.part.vertices_m, axis=0).max()) for mesh in meshes]
    low = np.min([mesh.part.vertices_m.min(axis=0) for mesh in meshes], axis=0)
    high = np.max([mesh.part.vertices_m.max(axis=0) for mesh in meshes], axis=0)
    length_m = float((high - low).max())
    smallest, largest = int(np.argmin(sizes)), int(np.argmax(sizes))
    if sizes[largest] > _MOST_PART_M:
        what = f"{meshes[largest].part.label} is {_show_length(sizes[largest])} long"
    elif length_m < _LEAST_PRODUCT_M:
        what = f"the product is {_show_length(length_m)} long"
    elif sizes[smallest] < _LEAST_PART_M:
        what = f"{meshes[smallest].part.label} is {_show_length(sizes[smallest])} long"
    else:
        return []
    others = [
        f"{name} ({_show_length(length_m * scale / UNITS_M[unit])})"
        for name, scale in UNITS_M.items()
        if name != unit
        and _LEAST_PRODUCT_M <= length_m * scale / UNITS_M[unit] <= _MOST_PART_M
        and (scale > UNITS_M[unit]) == (sizes[largest] <= _MOST_PART_M)
    ]
    rest = f" Is it {' or '.join(others)}?" if others else ""
    return [f"{what} with --unit {unit}.{rest}"]


def _show_length(length_m: float) -> str:
    return f"{length_m:.3g} m" if length_m >= 1 else f"{length_m * 1000:.3g} mm"


def _read_raw(path: Path, options: ReadOptions, report: Report) -> RawProduct:
    if is_folder(path) or (path.suffix.lower() in MESHES and is_regular(path)):
        return read_folder(
            path,
            options.unit,
            options.chord_m,
            lambda name: not any(fits_pattern(name, pattern) for pattern in options.leave_out),
            report,
        )
    if not is_regular(path):
        raise OptionError(f"{path}: there is no such file or folder.")
    if is_step(path):
        return read_step(path, options.chord_m, report, options.unit)
    if path.suffix.lower() in SCENES:
        return read_scene(path, options.unit, options.chord_m, report)
    raise OptionError(
        f"{path}: is neither STEP ({', '.join(STEP)}), nor {' or '.join(SCENES)}, nor a folder of "
        f"meshes ({', '.join(MESHES)})."
    )


def _leave_out_far(path: Path, meshes: list[Mended], unit: str) -> tuple[list[Mended], list[str]]:
    """Return the parts of a product short enough to resolve them, and warnings about the others.

    Raises
    ------
    OptionError
        If less than half of the parts would be left.
    """
    warnings: list[str] = []
    filled = [mesh.part for mesh in meshes if len(mesh.part.vertices_m)]
    if not filled:
        return meshes, warnings
    middle = np.median([part.vertices_m[0] for part in filled], axis=0)
    left = list(meshes)
    while True:
        low = np.min([mesh.part.vertices_m.min(axis=0, initial=np.inf) for mesh in left], axis=0)
        high = np.max([mesh.part.vertices_m.max(axis=0, initial=-np.inf) for mesh in left], axis=0)
        with np.errstate(over="ignore"):
            extent_m = float((high - low).max())
            reach = [np.abs(mesh.part.vertices_m - middle).max(initial=0.0) for mesh in left]
        if extent_m <= MOST_EXTENT_M:
            return left, warnings
        farthest = left.pop(int(np.argmax(reach))).part
        if 2 * len(left) < len(meshes) or len(left) < 2:
            raise OptionError(
                f"{path}: is {extent_m:.3g} m long, where {MOST_EXTENT_M:,.0f} m are the most; "
                f"{farthest.label} reaches farthest. Correct that part, or its unit ({unit})."
            )
        warnings.append(
            f"{farthest.label} is left out: with it the product is {extent_m:.3g} m long, where "
            f"{MOST_EXTENT_M:,.0f} m are the most. Correct it, or its unit ({unit})."
        )


def _refuse_many_triangles(path: Path, meshes: Sequence[Mended]) -> None:
    """Refuse a product whose meshes take too much memory."""
    counts = [len(mesh.part.triangles) for mesh in meshes]
    if sum(counts) <= MOST_TRIANGLES:
        return
    largest = meshes[int(np.argmax(counts))].part
    raise OptionError(
        f"{path}: its parts have {sum(counts):,} triangles, where {MOST_TRIANGLES:,} are the most; "
        f"{largest.label} has {max(counts):,}. Give a larger --chord for STEP, save meshes with "
        "fewer triangles, or --leave-out parts."
    )


def _report_seldom(report: Report) -> Report:
    """Return a function that reports progress every two seconds."""
    last = time.monotonic()

    def tell(text: str) -> None:
        nonlocal last
        if time.monotonic() - last > _PATIENCE_S:
            last = time.monotonic()
            report(text)

    return tell


def _refuse_few(path: Path, meshes: Sequence[Mended], fewest: int, warnings: Sequence[str]) -> None:
    if len(meshes) >= fewest:
        return
    about = f" {' '.join(warnings)}" if warnings else ""
    if not meshes:
        raise OptionError(f"{path}: no part is left.{about}")
    name, bodies = meshes[0].part.label, int(meshes[0].bodies.max(initial=0)) + 1
    if bodies > 1:
        raise OptionError(
            f"{path}: holds one part, {name}, of {bodies} bodies. --split-bodies makes each of "
            f"these a part.{about}"
        )
    remedy = (
        "Give the folder of all parts" if path.suffix.lower() in MESHES else "Save the assembly"
    )
    raise OptionError(
        f"{path}: holds one part, {name}; there is nothing to assemble. {remedy}.{about}"
    )


def _build_part(mesh: Mended, shape: int, mirrors: int | None, options: ReadOptions) -> Part:
    part = mesh.part
    faces = (
        tuple(recognise_face(face, part.vertices_m, part.triangles) for face in part.faces)
        if part.faces
        else fit_faces(part.vertices_m, part.triangles)
    )
    if mesh.measures:
        volume_m3 = sum(measure.volume_m3 for measure in mesh.measures)
        weighted = [measure.volume_m3 * np.asarray(measure.centre_m) for measure in mesh.measures]
        centre = np.sum(weighted, axis=0) / volume_m3
    else:
        volume_m3 = float(compute_volumes_m3(part.vertices_m, part.triangles).sum())
        centre = compute_centre_m(part.vertices_m, part.triangles)
    closure: Closure = "closed"
    if mesh.open_edges and options.thickness_m is None:
        closure = "surface"
    elif mesh.open_edges or mesh.gap_m:
        closure = "mended"
    return Part(
        name=part.label,
        path=part.path,
        vertices_m=part.vertices_m,
        triangles=part.triangles,
        faces=faces,
        volume_m3=volume_m3,
        density_kg_m3=STEEL_KG_M3,
        centre_m=(float(centre[0]), float(centre[1]), float(centre[2])),
        shape=shape,
        mirrors=mirrors,
        bodies=int(mesh.bodies.max(initial=0)) + 1,
        design=part.design,
        closure=closure,
        gap_m=mesh.gap_m,
    )


def _list_repeated(meshes: Sequence[Mended]) -> list[str]:
    counts = Counter(_join_name(mesh.part) for mesh in meshes)
    return [name for name, count in counts.items() if count > 1]


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
