"""The domain ``assembly``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skillplan.domains.assembly.consistency import issues
from skillplan.domains.assembly.grounding import ground
from skillplan.domains.assembly.layout_family import layouts
from skillplan.domains.assembly.overview import hints, rest_overview, way_overview
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.domain import Domain, Overview
from skillplan.errors import Issue
from skillplan.task.task import Task

# What facts are about, by their kind.
_SECTIONS = {"at_start": "parts", "held": "parts", "placed": "parts", "fastened": "screws"}


class AssemblyDomain(Domain):
    """Assembly by pick, place, load, offload and fasten."""

    kind = "assembly"
    Config = AssemblyConfig

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return faults of references, order and geometry."""
        return issues(config)

    def hints(self, config: Any) -> Iterable[Issue]:
        """Return the parts that block a feeder from the start on."""
        return hints(config)

    def overview(self, config: Any) -> Overview:
        """Return what every part rests on, and how those with a choice are held and go in."""
        rests, ways = rest_overview(config), way_overview(config)
        return Overview({**rests.document, **ways.document}, (*rests.lines, *ways.lines))

    def has_family(self, config: Any) -> bool:
        """Return whether there is a block ``family``."""
        return config.family is not None

    def variants(self, config: Any, seed: int, count: int) -> list[Any]:
        """Return layouts of the file's family, by its block ``family``."""
        return layouts(config, seed, count)

    def ground(self, config: Any, sha256: str) -> list[Task]:
        """Return the one task of an assembly."""
        return [ground(config, sha256)]

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the path of the part or screw that a fact is about, else of the goal."""
        kind, _, rest = fact.partition("(")
        section = _SECTIONS.get(kind)
        return ("goal",) if section is None else (section, rest.rstrip(")"))

    def locate_skill(self, config: Any, skill: str, *, reach: bool) -> tuple[str | int, ...]:
        """Return the path of the grasp, the place or the hole that a skill fails by."""
        name, _, rest = skill.partition("(")
        which = rest.rstrip(")")
        if name == "fasten":
            return ("screws", which, "hole_m")
        if which not in config.parts:
            return ()
        part = config.parts[which]
        if reach and "grasp" in part.model_fields_set:
            return ("parts", which, "grasp")
        if name == "place":
            return ("parts", which, "goal_m")
        keys = ("start_m", "start_on", "feeder")
        return ("parts", which, next(key for key in keys if getattr(part, key) is not None))
