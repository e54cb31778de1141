"""Entry points of this installation, and the distributions that registered them."""

from __future__ import annotations

import json
from functools import cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, distributions
from typing import Any, NamedTuple

# Entry point groups by kind of plugin.
_KINDS = ("domain", "physics", "collision", "solver", "executor", "exporter", "sampler")
GROUPS = {kind: f"skillplan.{kind}" for kind in _KINDS}
# Functions that decompose meshes into convex pieces.
_DECOMPOSITION = "decomposition"
# Functions that mesh the content of a STEP file.
_MESH_READER = "mesh_reader"
# Functions that convert CAD to tasks.
_IMPORTER = "importer"
# Figures of tasks.
_FIGURE = "figure"
# Functions that prepare the report chapter on a chain, by kind of task.
_CHAPTER = "chapter"


class Unreadable(NamedTuple):
    """A distribution whose entry points cannot be read."""

    name: str
    version: str
    problem: str


def registered(kind: str) -> EntryPoints:
    """Return the entry points of a kind of plugin, such as ``solver``."""
    return _of_group(GROUPS[kind])


def list_decompositions() -> EntryPoints:
    """Return the entry points that decompose meshes."""
    return _of_group(f"skillplan.{_DECOMPOSITION}")


def list_mesh_readers() -> EntryPoints:
    """Return the entry points that mesh STEP files."""
    return _of_group(f"skillplan.{_MESH_READER}")


def importers() -> EntryPoints:
    """Return the entry points that convert CAD to tasks."""
    return _of_group(f"skillplan.{_IMPORTER}")


def unreadable() -> tuple[Unreadable, ...]:
    """Return the distributions with unreadable entry points."""
    return _entry_points()[1]


def figures() -> EntryPoints:
    """Return the entry points of figures, by name."""
    return _of_group(f"skillplan.{_FIGURE}")


def chapters() -> EntryPoints:
    """Return the entry points of report chapters, by kind of task."""
    return _of_group(f"skillplan.{_CHAPTER}")


def find_entry_point(plugin: type[Any]) -> EntryPoint | None:
    """Return the entry point of a class, or None.

    The class decides, not the name of its module: an entry point may name a package that imports
    the class.
    """
    name = getattr(plugin, "name", None) or getattr(plugin, "kind", None)
    for kind in GROUPS:
        for entry in registered(kind):
            if entry.name == name and _names(entry, plugin):
                return entry
    return None


def is_editable(distribution: Distribution) -> bool:
    """Return whether a distribution is installed in editable mode."""
    try:
        stated = json.loads(distribution.read_text("direct_url.json") or "{}")
        return bool(stated.get("dir_info", {}).get("editable"))
    except (ValueError, AttributeError):
        return False


def list_distribution_versions() -> tuple[tuple[str, str], ...]:
    """Return names and versions of the distributions with plugins."""
    providers = {
        entry.dist for kind in GROUPS for entry in registered(kind) if entry.dist is not None
    }
    return tuple(sorted(name_and_version(provider) for provider in providers))


@cache
def name_and_version(distribution: Distribution) -> tuple[str, str]:
    """Return name and version of a distribution; its metadata are read once.

    If they are unreadable, the name is that of its folder.
    """
    name: str | None = None
    version: str | None = None
    try:
        metadata = distribution.metadata
        name, version = metadata["Name"], metadata["Version"]
    except Exception:
        # After any error, the caller continues with the name of the folder.
        version = ""
    if name is None:
        name = getattr(getattr(distribution, "_path", None), "name", "a distribution without name")
    return name, version or ""


def refresh() -> None:
    """Read again, to find distributions installed meanwhile."""
    _of_group.cache_clear()
    _entry_points.cache_clear()
    name_and_version.cache_clear()


@cache
def _of_group(group: str) -> EntryPoints:
    return _entry_points()[0].select(group=group)


# The original function of the library, even after `shield_libraries`.
_read_entry_points = Distribution.entry_points.fget  # type: ignore[attr-defined]


@cache
def _entry_points() -> tuple[EntryPoints, tuple[Unreadable, ...]]:
    """Return all readable entry points, and the distributions with unreadable ones.

    If two distributions share a name, the first on the path counts, as in `importlib.metadata`.
    """
    names: set[str] = set()
    entries: list[EntryPoint] = []
    broken: list[Unreadable] = []
    for distribution in distributions():
        try:
            # From the name of the folder: reading all metadata takes a tenth of a second.
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
    """Patch `importlib.metadata` so that libraries can read the entry points.

    numba and networkx read them when they are imported. Called only if some entry points are
    unreadable, which would end these imports.
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
    named: Any = sys.modules.get(entry.module)
    for attribute in entry.attr.split("."):
        named = getattr(named, attribute, None)
    return named is plugin


AUTO = "auto"
"""Stands for the first installed engine of `PREFERRED`."""

PREFERRED = ("pybullet", "mujoco")
"""Engines that execute skills, the preferred first."""


def find_simulator() -> str | None:
    """Return the name of the engine for ``auto``, or None."""
    known = registered("physics").names
    return next((name for name in PREFERRED if name in known), None)
