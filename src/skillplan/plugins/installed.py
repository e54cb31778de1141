"""Entry points of this installation, read once, and the distributions that registered them."""

from __future__ import annotations

import json
from functools import cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, distributions
from typing import Any, NamedTuple

# Kind of plugin to the group that its entry points are in.
_KINDS = ("domain", "physics", "collision", "solver", "executor", "exporter", "sampler")
GROUPS = {kind: f"skillplan.{kind}" for kind in _KINDS}
# What takes a mesh apart into convex pieces: a function, not a class.
_DECOMPOSITION = "decomposition"
# What makes a task of a product's CAD: a function, too.
_IMPORTER = "importer"
# Entries of the catalogue of figures.
_FIGURE = "figure"
# Functions that prepare the report's chapter on a chain, by the kind of task.
_CHAPTER = "chapter"


class Unreadable(NamedTuple):
    """A distribution whose entry points cannot be read."""

    name: str
    version: str
    problem: str


def registered(kind: str) -> EntryPoints:
    """Return the entry points of a kind of plugin, such as ``solver``."""
    return _of_group(GROUPS[kind])


def decompositions() -> EntryPoints:
    """Return the entry points of what takes meshes apart into convex pieces."""
    return _of_group(f"skillplan.{_DECOMPOSITION}")


def importers() -> EntryPoints:
    """Return the entry points of what makes tasks of CAD."""
    return _of_group(f"skillplan.{_IMPORTER}")


def unreadable() -> tuple[Unreadable, ...]:
    """Return the distributions whose entry points cannot be read; they provide nothing."""
    return _entry_points()[1]


def figures() -> EntryPoints:
    """Return the entry points of figures of tasks, by the name of the figure."""
    return _of_group(f"skillplan.{_FIGURE}")


def chapters() -> EntryPoints:
    """Return the entry points of report chapters, by the kind of task."""
    return _of_group(f"skillplan.{_CHAPTER}")


def registered_as(plugin: type[Any]) -> EntryPoint | None:
    """Return the entry point through which a class was, or could be, loaded; None without one.

    By the class itself, never by a module's name: an entry point may name a package that only
    imports the class.
    """
    name = getattr(plugin, "name", None) or getattr(plugin, "kind", None)
    for kind in GROUPS:
        for entry in registered(kind):
            if entry.name == name and _names(entry, plugin):
                return entry
    return None


def is_editable(distribution: Distribution) -> bool:
    """Whether a distribution is installed as a folder that somebody edits."""
    try:
        stated = json.loads(distribution.read_text("direct_url.json") or "{}")
        return bool(stated.get("dir_info", {}).get("editable"))
    except (ValueError, AttributeError):
        return False


def distribution_versions() -> tuple[tuple[str, str], ...]:
    """Return the names of distributions that provide plugins, and their versions."""
    found = {entry.dist for kind in GROUPS for entry in registered(kind) if entry.dist is not None}
    return tuple(sorted(name_and_version(one) for one in found))


@cache
def name_and_version(distribution: Distribution) -> tuple[str, str]:
    """Return name and version of a distribution; its metadata, with a README, are read once.

    Where they cannot be read, the name is that of its folder.
    """
    name: str | None = None
    version: str | None = None
    try:
        metadata = distribution.metadata
        name, version = metadata["Name"], metadata["Version"]
    except Exception:
        # Whatever is wrong with it, the caller goes on with the name of the folder.
        version = ""
    if name is None:
        name = getattr(getattr(distribution, "_path", None), "name", "a distribution without name")
    return name, version or ""


def refresh() -> None:
    """Read anew, so that what was installed since the first time is found."""
    _of_group.cache_clear()
    _entry_points.cache_clear()
    name_and_version.cache_clear()


@cache
def _of_group(group: str) -> EntryPoints:
    return _entry_points()[0].select(group=group)


# As the library reads them, also after `shield_libraries`.
_read_entry_points = Distribution.entry_points.fget  # type: ignore[attr-defined]


@cache
def _entry_points() -> tuple[EntryPoints, tuple[Unreadable, ...]]:
    """Return all entry points that can be read, and the distributions whose cannot.

    Of two distributions of one name the first on the path counts, as in `importlib.metadata`.
    """
    names: set[str] = set()
    entries: list[EntryPoint] = []
    broken: list[Unreadable] = []
    for distribution in distributions():
        try:
            # From the name of its folder: to read all metadata takes a tenth of a second.
            name = distribution._normalized_name  # type: ignore[attr-defined]
            if name not in names:
                names.add(name)
                entries += _read_entry_points(distribution)
        except Exception as error:
            reason = f"its entry_points.txt cannot be read: {type(error).__name__}: {error}"
            problem = f"{reason}. Install it anew or remove it."
            broken.append(Unreadable(*name_and_version(distribution), problem))
    if broken:
        shield_libraries()
    return EntryPoints(entries), tuple(broken)


def shield_libraries() -> None:
    """Let libraries read entry points, too, as numba and networkx do when they are imported.

    Called only if there are some that cannot be read, which would end the import otherwise.
    """

    def entry_points(distribution: Distribution) -> EntryPoints:
        try:
            return _read_entry_points(distribution)  # type: ignore[no-any-return]
        except Exception:
            return EntryPoints()

    Distribution.entry_points = property(entry_points)  # type: ignore[assignment]


def _names(entry: EntryPoint, plugin: type[Any]) -> bool:
    import sys

    if entry.value == f"{plugin.__module__}:{plugin.__qualname__}":
        return True
    if entry.pattern.match(entry.value) is None:
        return False
    found: Any = sys.modules.get(entry.module)
    for attribute in entry.attr.split("."):
        found = getattr(found, attribute, None)
    return found is plugin


AUTO = "auto"
"""What names no engine, but the first of `PREFERRED` that is installed."""

PREFERRED = ("pybullet", "mujoco")
"""Engines that execute skills, the one that is taken first."""


def installed_simulator() -> str | None:
    """Return the name of the engine that ``auto`` stands for; None where none is installed."""
    known = registered("physics").names
    return next((name for name in PREFERRED if name in known), None)
