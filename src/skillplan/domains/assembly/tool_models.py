"""Tools as data: files of the catalogue, and of users, that give the keys of a tool.

A tool file is YAML with ``kind: tool``, a name, sources, and the keys of ``tools.NAME`` in a task
except its place. The facts of the catalogue come from data sheets, its shapes are our own.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from skillplan.errors import TaskError, name_hint
from skillplan.files.regular_file import (
    CompanionFileError,
    RefusedFile,
    find_companion,
    read_bytes,
    read_companion,
)
from skillplan.files.yaml import MAX_BYTES, YAML_SUFFIXES, parse
from skillplan.robots import catalogue

_FOLDER: Final = Path(catalogue.__file__).with_name("tools")

TOOLS: Final = tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))
"""Names of the tools of the catalogue."""

KIND: Final = "tool"
"""Value of `kind` in a tool file."""

_OF_KIND: Final = re.compile(rb"^kind:\s*['\"]?tool['\"]?\s*(#.*)?$", re.MULTILINE)
# Keys of a tool file that are no keys of a task.
_ABOUT: Final = ("kind", "name", "sources", "notes")
# Keys of a tool in a task that belong to the cell.
_OF_CELL: Final = ("model", "holder_m", "holder_height_m")


class ToolFileError(Exception):
    """A file does not describe a tool."""


@dataclass(frozen=True)
class ToolModel:
    """The content of a tool file.

    Parameters
    ----------
    name
        Name of the product.
    sources, notes
        Sentences on the origin of its numbers, and on what they leave out.
    keys
        Keys of a tool in a task file, with their values.
    """

    name: str
    sources: tuple[str, ...]
    notes: tuple[str, ...]
    keys: Mapping[str, Any]


def read_tool_model(folder: Path, name: str) -> ToolModel:
    """Return a tool of the catalogue, or of a file.

    Parameters
    ----------
    folder
        Folder of the task file, which must contain the file.

    Raises
    ------
    ToolFileError
        If there is no such tool, or the file is none.
    """
    if name in TOOLS:
        return _read_catalogue(name)
    if not name.endswith(YAML_SUFFIXES):
        raise ToolFileError(f"There is no such tool. {name_hint(name, TOOLS)}")
    try:
        content = read_companion(find_companion(folder, name), MAX_BYTES, "tool")
    except CompanionFileError as error:
        raise ToolFileError(str(error)) from None
    return _read(content, name)


def is_tool_file(path: str) -> bool:
    """Return True if a YAML file says that it is of the kind `tool`."""
    if not path.endswith(YAML_SUFFIXES):
        return False
    try:
        start = read_bytes(path, MAX_BYTES)
    except (OSError, RefusedFile):
        return False
    return _OF_KIND.search(start) is not None


@cache
def _read_catalogue(name: str) -> ToolModel:
    return _read(read_bytes(_FOLDER / f"{name}.yaml", MAX_BYTES), name)


def _read(content: bytes, name: str) -> ToolModel:
    try:
        document = parse(content.decode("utf-8"), name)
    except UnicodeDecodeError:
        raise ToolFileError("It is not UTF-8; save it as such.") from None
    except TaskError as error:
        raise ToolFileError(f"It is faulty: {error}") from None
    data = document.data
    if document.issues:
        raise ToolFileError(f"It is faulty: {document.error([])}")
    if not isinstance(data, dict) or data.get("kind") != KIND:
        raise ToolFileError(f"It is no tool file; its first line is kind: {KIND}.")
    for key in _OF_CELL:
        if key in data:
            raise ToolFileError(f"It gives {key!r}, which belongs to the task; leave it out.")
    lists = [data.get(key, []) for key in ("sources", "notes")]
    if not all(isinstance(words, list) and all(map(_is_text, words)) for words in lists):
        raise ToolFileError("'sources' and 'notes' are lists of sentences.")
    if not _is_text(data.get("type")):
        raise ToolFileError("It does not give 'type', such as type: gripper.")
    title = data.get("name", posixpath.basename(name))
    if not _is_text(title):
        raise ToolFileError("'name' is a text.")
    keys = {key: value for key, value in data.items() if key not in _ABOUT}
    for part in ("fingers", "body"):
        if part in keys:
            keys[part] = _locate_meshes(keys[part], posixpath.dirname(name))
    return ToolModel(title, tuple(lists[0]), tuple(lists[1]), keys)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _locate_meshes(shape: Any, folder: str) -> Any:
    """Return a shape whose mesh files are relative to the task, not to the tool file."""
    meshes = shape.get("meshes") if isinstance(shape, dict) else None
    if not folder or not isinstance(meshes, list):
        return shape
    moved = [
        {
            key: posixpath.join(folder, value) if key in ("file", "pieces") else value
            for key, value in mesh.items()
        }
        if isinstance(mesh, dict)
        else mesh
        for mesh in meshes
    ]
    return {**shape, "meshes": moved}
