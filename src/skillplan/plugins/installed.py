"""Entry points of this installation, read once, and the distributions that registered them."""

from __future__ import annotations

import json
from functools import cache
from importlib.metadata import Distribution, EntryPoint, EntryPoints, entry_points
from typing import Any

# Kind of plugin to the group that its entry points are in.
_KINDS = ("domain", "physics", "collision", "solver", "executor", "exporter", "sampler")
GROUPS = {kind: f"skillplan.{kind}" for kind in _KINDS}
# What takes a mesh apart into convex pieces: a function, not a class.
_DECOMPOSITION = "decomposition"
# What makes a task of a product's CAD: a function, too.
_IMPORTER = "importer"


def registered(kind: str) -> EntryPoints:
    """Return the entry points of a kind of plugin, such as ``solver``."""
    return _by_kind()[kind]


def decompositions() -> EntryPoints:
    """Return the entry points of what takes meshes apart into convex pieces."""
    return entry_points(group=f"skillplan.{_DECOMPOSITION}")


def importers() -> EntryPoints:
    """Return the entry points of what makes tasks of CAD."""
    return entry_points(group=f"skillplan.{_IMPORTER}")


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
    return tuple(sorted({(one.name, one.version) for one in found}))


def refresh() -> None:
    """Read anew, so that what was installed since the first time is found."""
    _by_kind.cache_clear()


@cache
def _by_kind() -> dict[str, EntryPoints]:
    """Return all at once: to look for one kind takes as long as for all."""
    found = entry_points()
    return {kind: found.select(group=group) for kind, group in GROUPS.items()}


def _names(entry: EntryPoint, plugin: type[Any]) -> bool:
    import sys

    if entry.value == f"{plugin.__module__}:{plugin.__qualname__}":
        return True
    found: Any = sys.modules.get(entry.module)
    for attribute in entry.attr.split("."):
        found = getattr(found, attribute, None)
    return found is plugin
