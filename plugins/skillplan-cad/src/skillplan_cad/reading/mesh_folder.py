"""Read a folder of STL, OBJ and PLY meshes, one part per file, in one frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skillplan.domains.assembly.mesh_files import MeshFileError, parse_mesh
from skillplan.errors import OptionError, name_hint
from skillplan.files.regular_file import RefusedFile, read_bytes, resolve_within
from skillplan_cad.product import Points, Triangles
from skillplan_cad.reading.raw_part import MOST_PARTS, RawPart, RawProduct

SUFFIXES = (".stl", ".obj", ".ply")
UNITS_M = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254, "foot": 0.3048}
MOST_BYTES = 128 * 1024 * 1024
MOST_BYTES_TOGETHER = 512 * 1024 * 1024
_REMEDY = "Save it anew, or take it out of the folder"


def read_folder(folder: Path, unit: str | None) -> RawProduct:
    """Read the meshes of a folder, sorted by name.

    Parameters
    ----------
    folder
        Folder; files with other suffixes are ignored.

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
    parts, left = [], MOST_BYTES_TOGETHER
    for path in files:
        content = _read_content(folder, path)
        left -= len(content)
        if left < 0:
            raise OptionError(
                f"{folder}: its meshes have more than {MOST_BYTES_TOGETHER:,} bytes together. "
                "Save them with fewer triangles, or import sub-assemblies one by one."
            )
        parts.append(RawPart(path.stem, (), *_parse_mesh(path, content, scale)))
    return RawProduct(folder.resolve().name, tuple(parts), unit, 0.0)


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
        raise OptionError(f"{path}: is empty. {_REMEDY}.")
    return content


def _parse_mesh(path: Path, content: bytes, scale: float) -> tuple[Points, Triangles]:
    try:
        with np.errstate(over="ignore"):
            corners, triangles = parse_mesh(content, path.suffix.lower())
            vertices = corners * scale
    except MeshFileError:
        kind = path.suffix[1:].upper()
        raise OptionError(f"{path}: cannot be read as {kind}. {_REMEDY}.") from None
    if not len(triangles):
        raise OptionError(f"{path}: holds no triangles. {_REMEDY}.")
    if not np.isfinite(vertices).all():
        raise OptionError(f"{path}: holds coordinates that are not finite. {_REMEDY}.")
    return vertices, triangles
