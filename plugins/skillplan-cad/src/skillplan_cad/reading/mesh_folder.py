"""Parts of a folder of meshes, one a file, that share one frame: STL, OBJ and PLY."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from skillplan.errors import OptionError, name_hint
from skillplan.files.regular_file import RefusedFile, read_bytes
from skillplan_cad.product import Points, Triangles
from skillplan_cad.reading.raw_part import RawPart, RawProduct

SUFFIXES = (".stl", ".obj", ".ply")
UNITS_M = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254, "foot": 0.3048}
MOST_BYTES = 128 * 1024 * 1024
_REMEDY = "Save it anew, or take it out of the folder"


def read_folder(folder: Path, unit: str | None) -> RawProduct:
    """Return the meshes of a folder, by name.

    Parameters
    ----------
    folder
        What lies in it under another suffix is left alone.
    unit
        Of the files, which hold none.

    Raises
    ------
    OptionError
        If the unit is missing or unknown, or a file cannot be read.
    """
    files = sorted(one for one in folder.iterdir() if one.suffix.lower() in SUFFIXES)
    if not files:
        raise OptionError(f"{folder}: holds no meshes: no {', '.join(SUFFIXES)} files lie in it.")
    if unit is None:
        raise OptionError(
            f"{folder}: meshes have no unit. State it: --unit mm, or {', '.join(UNITS_M)}."
        )
    scale = unit_m(unit)
    parts = tuple(RawPart(one.stem, (), *_mesh(one, scale)) for one in files)
    return RawProduct(folder.resolve().name, parts, unit, 0.0)


def unit_m(unit: str) -> float:
    """Return how long a unit is; raises OptionError where it is unknown."""
    scale = UNITS_M.get(unit)
    if scale is None:
        raise OptionError(f"--unit {unit}: is no unit known here. {name_hint(unit, UNITS_M)}")
    return scale


def _mesh(path: Path, scale: float) -> tuple[Points, Triangles]:
    import trimesh

    try:
        content = read_bytes(path, MOST_BYTES)
    except RefusedFile as refused:
        remedy = ". Save it with fewer triangles" if refused.why == "large" else ""
        raise OptionError(f"{path}: cannot be read: {refused.strerror}{remedy}.") from None
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror or error}.") from None
    if not content.strip():
        raise OptionError(f"{path}: is empty. {_REMEDY}.")
    try:
        mesh: Any = trimesh.load(
            BytesIO(content), file_type=path.suffix[1:].lower(), force="mesh", process=False
        )
        vertices = np.asarray(mesh.vertices, dtype=np.float64) * scale
        triangles = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:
        kind = path.suffix[1:].upper()
        raise OptionError(
            f"{path}: cannot be read as {kind}: {error or 'damaged'}. {_REMEDY}."
        ) from None
    if not len(triangles):
        raise OptionError(f"{path}: holds no triangles. {_REMEDY}.")
    if not np.isfinite(vertices).all():
        raise OptionError(f"{path}: holds coordinates that are no finite numbers. {_REMEDY}.")
    return vertices, triangles
