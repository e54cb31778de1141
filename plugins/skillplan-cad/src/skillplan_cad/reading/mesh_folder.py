"""Read a folder of meshes in one frame: a part per file, or per solid of an ASCII STL."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np

from skillplan.domains.assembly.mesh_files import MeshFileError, parse_mesh
from skillplan.errors import OptionError, name_hint
from skillplan.files.regular_file import RefusedFile, read_bytes, resolve_within
from skillplan_cad.product import Points, Triangles
from skillplan_cad.reading.mending import mend
from skillplan_cad.reading.raw_part import MOST_PARTS, Mended, RawPart, RawProduct

SUFFIXES = (".stl", ".obj", ".ply")
UNITS_M = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254, "foot": 0.3048}
MOST_BYTES = 128 * 1024 * 1024
MOST_BYTES_TOGETHER = 512 * 1024 * 1024
_REMEDY = "Save it anew, or leave it out: --leave-out"
_SOLID_LINE = re.compile(rb"(?:\A|\n)[ \t]*solid\b", re.IGNORECASE)


def read_folder(
    folder: Path,
    unit: str | None,
    weld_m: float = 0.0,
    is_wanted: Callable[[str], bool] = lambda name: True,
    report: Callable[[str], None] = lambda text: None,
) -> RawProduct:
    """Read the meshes of a folder, sorted by name.

    Parameters
    ----------
    folder
        Folder; files with other suffixes are ignored.
    weld_m
        Largest gap between open edges that is closed [m].
    is_wanted
        False for the names of files that are not read.
    report
        Called with progress.

    Raises
    ------
    OptionError
        If the unit is missing or unknown, or a file is unreadable.
    """
    files = list_mesh_files(folder)
    if not files:
        raise OptionError(f"{folder}: holds no meshes: no {', '.join(SUFFIXES)} files lie in it.")
    if unit is None:
        raise OptionError(
            f"{folder}: meshes have no unit. State it: --unit mm, or {', '.join(UNITS_M)}."
        )
    scale = resolve_unit_m(unit)
    parts: list[Mended] = []
    left = MOST_BYTES_TOGETHER
    prefix = _find_common_prefix([path.stem for path in files])
    for number, path in enumerate(files, 1):
        name = path.stem[len(prefix) :]
        if not is_wanted(name):
            continue
        report(f"{number} of {len(files)} meshes")
        content = _read_content(folder, path)
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
            parts.append(mend(raw, weld_m))
    return RawProduct(folder.resolve().name, tuple(parts), unit, 0.0)


def _find_common_prefix(names: list[str]) -> str:
    """Return the name of the assembly that CAD puts before all names, up to `` - ``."""
    first = names[0].rpartition(" - ")[0]
    while first:
        prefix = f"{first} - "
        if len(names) > 1 and all(name.startswith(prefix) for name in names):
            return prefix
        first = first.rpartition(" - ")[0]
    return ""


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
        name = text.partition(b"\n")[0][5:].strip().decode("utf-8", "replace")
        solids.append((_clean_name(name), text))
    return solids


def _clean_name(name: str) -> str:
    return "".join(letter if letter.isprintable() else "_" for letter in name)[:200]


def list_mesh_files(folder: Path) -> list[Path]:
    """Return the mesh files of a folder, sorted by name.

    Raises
    ------
    OptionError
        If there are more than `MOST_PARTS`, a name is not UTF-8, or listing fails.
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
    for path in files:
        if not is_utf8(path.name):
            raise OptionError(f"{path}: its name is not UTF-8, and parts take theirs from it.")
    return files


def is_utf8(name: str) -> bool:
    """Return whether a file name is UTF-8; other bytes are surrogates in it."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def resolve_unit_m(unit: str) -> float:
    """Return the length of a unit [m]; raises OptionError if it is unknown."""
    scale = UNITS_M.get(unit)
    if scale is None:
        raise OptionError(f"--unit {unit}: is not a known unit. {name_hint(unit, UNITS_M)}")
    return scale


def _read_content(folder: Path, path: Path) -> bytes:
    try:
        content = read_bytes(resolve_within(path, folder), MOST_BYTES, within=folder)
    except RefusedFile as refused:
        remedies = {"large": ". Save it with fewer triangles", "outside": ". Copy the file there"}
        remedy = remedies.get(refused.why, "")
        raise OptionError(f"{path}: cannot be read: {refused.strerror}{remedy}.") from None
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror or error}.") from None
    if not content.strip():
        raise OptionError(f"{path}: is empty. {_REMEDY} {shlex.quote(path.stem)}.")
    return content


def _parse_mesh(path: Path, content: bytes, scale: float) -> tuple[Points, Triangles]:
    try:
        with np.errstate(over="ignore"):
            corners, triangles = parse_mesh(content, path.suffix.lower())
            vertices = corners * scale
    except MeshFileError:
        kind = path.suffix[1:].upper()
        raise OptionError(
            f"{path}: cannot be read as {kind}. {_REMEDY} {shlex.quote(path.stem)}."
        ) from None
    if not len(triangles):
        raise OptionError(f"{path}: holds no triangles. {_REMEDY} {shlex.quote(path.stem)}.")
    if not np.isfinite(vertices).all():
        raise OptionError(
            f"{path}: holds coordinates that are not finite. {_REMEDY} {shlex.quote(path.stem)}."
        )
    return vertices, triangles
