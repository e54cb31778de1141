"""Read meshes in one frame: a part per file of a folder, solid of an ASCII STL, or object."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from skillplan.domains.assembly.mesh_files import MeshFileError, parse_mesh, parse_objects
from skillplan.errors import OptionError, name_hint
from skillplan.files.regular_file import RefusedFile, is_folder, read_bytes, resolve_within
from skillplan_cad.product import Points, Triangles
from skillplan_cad.reading.mending import mend
from skillplan_cad.reading.names import (
    clean_name,
    decode_file_name,
    decode_text,
    find_common_beginning,
    says_nothing,
)
from skillplan_cad.reading.raw_part import MOST_PARTS, MOST_TRIANGLES, Mended, RawPart, RawProduct

SUFFIXES = (".stl", ".obj", ".ply")
# Files of several meshes, in a unit of their own.
SCENES = (".3mf", ".glb")
UNITS_M = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254, "foot": 0.3048}
MOST_BYTES = 128 * 1024 * 1024
MOST_BYTES_TOGETHER = 512 * 1024 * 1024
_REMEDY = "Save it anew: the plan does not know of it"
Report = Callable[[str], None]
# Largest number of faults in a message.
_SHOWN = 3
_SOLID_LINE = re.compile(rb"(?:\A|\n)[ \t]*solid\b", re.IGNORECASE)


def read_folder(
    folder: Path,
    unit: str | None,
    weld_m: float = 0.0,
    is_wanted: Callable[[str], bool] = lambda name: True,
    report: Report = lambda text: None,
) -> RawProduct:
    """Read the meshes of a folder, sorted by name, or one mesh of several solids.

    Parameters
    ----------
    folder
        Folder, or file; files of a folder with other suffixes are ignored.
    weld_m
        Largest gap between open edges that is closed [m].
    is_wanted
        False for the names of files that are not read.
    report
        Called with progress.

    Raises
    ------
    OptionError
        If the unit is missing or unknown, or no file is readable.
    """
    files = list_mesh_files(folder) if is_folder(folder) else [folder]
    if not files:
        raise OptionError(f"{folder}: holds no meshes: no {', '.join(SUFFIXES)} files lie in it.")
    if unit is None:
        raise OptionError(
            f"{folder}: meshes have no unit. State it: --unit mm, or {', '.join(UNITS_M)}."
        )
    scale = resolve_unit_m(unit)
    parts: list[Mended] = []
    notes, warnings = [], []
    left, count = MOST_BYTES_TOGETHER, 0
    stems = [decode_file_name(path).removesuffix(path.suffix) for path in files]
    beginning = find_common_beginning(stems)
    if beginning:
        notes.append(f"{beginning!r}, with which the names of all files begin, is cut off")
    for number, (path, stem) in enumerate(zip(files, stems, strict=True), 1):
        name = clean_name(stem[len(beginning) :])
        if not is_wanted(name):
            continue
        report(f"{number} of {len(files)} meshes")
        try:
            content = _read_content(path.parent if path == folder else folder, path)
            left -= len(content)
            if left < 0:
                raise OptionError(
                    f"{folder}: its meshes have more than {MOST_BYTES_TOGETHER:,} bytes together. "
                    "Save them with fewer triangles, or import sub-assemblies one by one."
                )
            solids = _split_solids(path, content)
            above = ("", name) if len(files) > 1 and len(solids) > 1 else ()
            for own, text in solids:
                raw = RawPart(own or name, above, *_parse_mesh(path, text, scale))
                count += len(raw.triangles)
                if count > MOST_TRIANGLES:
                    raise OptionError(
                        f"{folder}: has more than {MOST_TRIANGLES:,} triangles up to {path.name}. "
                        "Save it with fewer triangles, or import sub-assemblies one by one."
                    )
                parts.append(mend(raw, weld_m))
        except _FaultyMeshError as fault:
            warnings.append(f"{name} is left out: {decode_file_name(path)} {fault}")
    if not parts and warnings:
        raise OptionError(f"{folder}: no mesh can be used. {' '.join(warnings[:_SHOWN])}")
    name = decode_file_name(folder.resolve())
    if path == folder:
        name = name.removesuffix(folder.suffix)
    return RawProduct(name, tuple(parts), unit, 0.0, tuple(notes), tuple(warnings))


def read_scene(path: Path, unit: str | None, weld_m: float, report: Report) -> RawProduct:
    """Read the objects of a 3MF or GLB file as parts.

    Parameters
    ----------
    unit
        Unit of a GLB whose exporter kept that of CAD; None for metres.
    weld_m, report
        See `read_folder`.

    Raises
    ------
    OptionError
        If it is unreadable, or a unit is given for 3MF.
    """
    suffix = path.suffix.lower()
    if unit is not None and suffix == ".3mf":
        raise OptionError(f"--unit {unit}: 3MF states its unit itself; leave it out.")
    scale = resolve_unit_m(unit or "m")
    try:
        objects = parse_objects(read_bytes(path, MOST_BYTES), suffix)
    except MeshFileError as fault:
        raise OptionError(f"{path}: {fault}") from None
    except RefusedFile as refused:
        raise OptionError(f"{path}: cannot be read: {refused.strerror}.") from None
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror or error}.") from None
    parts = []
    for number, item in enumerate(objects, 1):
        report(f"{number} of {len(objects)} objects")
        above = tuple(clean_name(name) or "group" for name in item.path)
        name = clean_name(item.name)
        if says_nothing(name) and above:
            name, above = above[-1], above[:-1]
        corners = np.asarray(item.corners * scale)
        if len(item.faces) and np.isfinite(corners).all():
            parts.append(mend(RawPart(name, ("", *above), corners, item.faces), weld_m))
    name = decode_file_name(path).partition(".")[0]
    return RawProduct(name, tuple(parts), unit or "m", 0.0)


def _split_solids(path: Path, content: bytes) -> list[tuple[str, bytes]]:
    """Return the solids of an ASCII STL with their names, or a whole file without a name."""
    whole = [("", content)]
    if path.suffix.lower() != ".stl" or content.lstrip()[:5].lower() != b"solid":
        return whole
    starts = [match.start() for match in _SOLID_LINE.finditer(content)]
    if len(starts) < 2:
        return whole
    ends = [*starts[1:], len(content)]
    solids = []
    for start, end in zip(starts, ends, strict=True):
        text = content[start:end].lstrip()
        name, _ = decode_text(text.partition(b"\n")[0][5:].strip())
        solids.append((clean_name(name), text))
    return solids


def list_mesh_files(folder: Path) -> list[Path]:
    """Return the mesh files of a folder, sorted by name.

    Raises
    ------
    OptionError
        If there are more than `MOST_PARTS`, or listing fails.
    """
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise OptionError(f"{folder}: cannot be listed: {error.strerror or error}.") from None
    if len(files) > MOST_PARTS:
        raise OptionError(
            f"{folder}: holds {len(files):,} meshes, where {MOST_PARTS:,} are the most. Import "
            "sub-assemblies one by one."
        )
    return files


def resolve_unit_m(unit: str) -> float:
    """Return the length of a unit [m]; raises OptionError if it is unknown."""
    scale = UNITS_M.get(unit)
    if scale is None:
        raise OptionError(f"--unit {unit}: is not a known unit. {name_hint(unit, UNITS_M)}")
    return scale


class _FaultyMeshError(Exception):
    """A mesh is left out; the message is a clause with the remedy."""


def _read_content(folder: Path, path: Path) -> bytes:
    try:
        content = read_bytes(resolve_within(path, folder), MOST_BYTES, within=folder)
    except RefusedFile as refused:
        remedies = {"large": ". Save it with fewer triangles", "outside": ". Copy the file there"}
        remedy = remedies.get(refused.why, "")
        raise _FaultyMeshError(f"cannot be read: {refused.strerror}{remedy}.") from None
    except OSError as error:
        raise _FaultyMeshError(f"cannot be read: {error.strerror or error}.") from None
    if not content.strip():
        raise _FaultyMeshError(f"is empty. {_REMEDY}.")
    return content


def _parse_mesh(path: Path, content: bytes, scale: float) -> tuple[Points, Triangles]:
    try:
        with np.errstate(over="ignore"):
            corners, triangles = parse_mesh(content, path.suffix.lower())
            vertices = corners * scale
    except MeshFileError:
        kind = path.suffix[1:].upper()
        raise _FaultyMeshError(f"cannot be read as {kind}. {_REMEDY}.") from None
    if not len(triangles):
        raise _FaultyMeshError(f"holds no triangles. {_REMEDY}.")
    if not np.isfinite(vertices).all():
        raise _FaultyMeshError(f"holds coordinates that are not finite. {_REMEDY}.")
    return vertices, triangles
