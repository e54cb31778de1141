"""Which code an answer of a back end rests on: distributions, versions and, where need be, source.

A kept verdict must die with the code that gave it. The version of a distribution tells it apart as
long as nobody edits the files: of an editable distribution, and of a class that no distribution
registered, the source itself counts. A distribution is never guessed from the name of a module.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType

from skillplan.files.regular_file import read_bytes
from skillplan.plugins.installed import is_editable, registered_as

# Whatever is larger is no source, and what is not Python's own leftovers may be read at run time.
_MOST_BYTES = 32 * 1024 * 1024
_LEFTOVERS = ("__pycache__", ".git", ".mypy_cache", ".ruff_cache")
CORE = "skillplan"
# Of skillplan itself, what a verdict rests on; the scene and the skill are in the key.
_CORE_FOLDERS = ("checks", "collision", "physics", "robots", "task")
_NAME = re.compile(r"[\w.-]+")


@cache
def code_origin(plugin: type) -> tuple[str, ...]:
    """Return what tells the code of a plugin apart from all other, as texts.

    Parameters
    ----------
    plugin
        The class; of the classes that it is derived from, those of other packages count, too.

    Returns
    -------
    tuple of str
        ``name version`` of the distribution that registered it, of skillplan, and of what that
        distribution needs; ``package hash`` of every package whose version does not tell.

    Raises
    ------
    OSError
        If source cannot be read.
    """
    entry = registered_as(plugin)
    registering = None if entry is None else entry.dist
    found = list(_stated(registering))
    packages = {base.__module__.partition(".")[0] for base in plugin.__mro__}
    own = {plugin.__module__.partition(".")[0]}
    if entry is not None:
        own.add(entry.module.partition(".")[0])
    packages -= {"builtins", "abc", "typing"}
    for package in sorted(packages | own):
        if package in own:
            told = registering
        else:
            # Of a distribution that registers nothing here, only skillplan's name is known.
            told = _distribution(CORE) if package == CORE else None
            found += _stated(told)
        if told is None or not told.version or is_editable(told):
            found.append(f"{package} {_source_hash(package, sys.modules.get(package))}")
    return tuple(dict.fromkeys(found))


def _stated(found: Distribution | None) -> Iterator[str]:
    """Yield name and version of a distribution, and of those that it needs."""
    if found is None:
        return
    yield f"{found.name} {found.version}"
    if found.name == CORE:
        return
    for needed in found.requires or ():
        name = None if "extra ==" in needed else _NAME.match(needed)
        other = None if name is None else _distribution(name[0])
        if other is not None:
            yield f"{other.name} {other.version}"


def _distribution(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


@cache
def _source_hash(package: str, module: ModuleType | None) -> str:
    """Return the hash of all files of a package, or of a module that is a single file."""
    file = getattr(module, "__file__", None)
    digest = hashlib.sha256()
    if file is None:
        return "without source"
    path = Path(file)
    single = path.name != "__init__.py"
    root = path.parent
    folders = [root / name for name in _CORE_FOLDERS] if package == CORE else [root]
    for one in [path] if single else sorted(file for folder in folders for file in _files(folder)):
        content = read_bytes(one, _MOST_BYTES)
        digest.update(f"{one.relative_to(root).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def _files(root: Path) -> Iterator[Path]:
    for one in root.iterdir():
        if one.is_dir() and not one.is_symlink():
            if one.name not in _LEFTOVERS:
                yield from _files(one)
        elif one.is_file() and one.suffix not in (".pyc", ".pyo"):
            yield one
