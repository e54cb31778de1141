"""The kind of task `assembly`: parts, stacks, feeders, screws and tools on a board."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from skillplan.domains.assembly.consistency import find_issues
from skillplan.domains.assembly.cost_schema import choose_cost, list_cost_names
from skillplan.domains.assembly.expansion import expand
from skillplan.domains.assembly.grounding import ground
from skillplan.domains.assembly.layout_family import draw_layouts
from skillplan.domains.assembly.overview import (
    find_assumptions,
    find_hints,
    list_choices,
    list_holding,
    list_screws,
    list_supports,
)
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.zone_faults import find_zone_hints, list_zones
from skillplan.domains.domain import CellChange, Domain, Overview
from skillplan.errors import Issue, OptionError
from skillplan.files.yaml import Document
from skillplan.task.task import Task

# Section of the file that a fact comes from, by the kind of fact.
_SECTIONS = {
    **dict.fromkeys(("at_start", "held", "placed", "apart", "in_buffer", "grasp"), "parts"),
    "fastened": "screws",
}
_SECTIONS |= {"pressed": "works", "dispensed": "works"}
_SECTIONS |= {"turned": "workholders", "holds": "holders", "open": "holders"}


class AssemblyDomain(Domain):
    """Assembly by pick, place, load, offload and fasten."""

    kind = "assembly"
    Config = AssemblyConfig

    def expand(self, document: Document) -> Document:
        """Return the document with counted entries and trays written out."""
        return expand(document)

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return faults of references, order and geometry."""
        return find_issues(config)

    def warnings(self, config: Any) -> Iterable[Issue]:
        """Return the assumptions of the arm's file, in one message."""
        return find_assumptions(config)

    def hints(self, config: Any) -> Iterable[Issue]:
        """Return parts too wide for the hand, blocked feeders, dwells and zones without effect."""
        return (*find_hints(config), *(find_zone_hints(config) if config.zones else ()))

    def overview(self, config: Any) -> Overview:
        """Return supports, meshes, zones, turns, screws, and choices of grasps and insertions."""
        listings = list_supports, list_zones, list_holding, list_choices, list_screws
        views = [listing(config) for listing in listings]
        document = {key: value for view in views for key, value in view.document.items()}
        return Overview(document, tuple(line for view in views for line in view.lines))

    def list_costs(self, config: Any) -> tuple[str, ...]:
        """Return distance and time, and of a weighted sum also cost, wear and energy."""
        return list_cost_names(config.cost)

    def with_cost(self, config: Any, name: str) -> Any:
        """Return the file with another of its costs."""
        return config.model_copy(update={"cost": choose_cost(config.cost, name)})

    def list_changes(self, config: Any, within_m: float) -> Iterable[CellChange]:
        """Return other places, tools, grips, orders and travels."""
        from skillplan.domains.assembly.cell_changes import list_changes

        return list_changes(config, within_m)

    def has_family(self, config: Any) -> bool:
        """Return True if the file has a block ``family``."""
        return config.family is not None

    def variants(self, config: Any, seed: int, count: int) -> list[Any]:
        """Return layouts of the file's family, by its block ``family``."""
        return draw_layouts(config, seed, count)

    def ground(self, config: Any, sha256: str) -> list[Task]:
        """Return the one task of an assembly."""
        return [ground(config, sha256)]

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the path of a fact's part or screw, or else of the goal."""
        kind, _, rest = fact.partition("(")
        section = _SECTIONS.get(kind)
        return ("goal",) if section is None else (section, rest.rstrip(")").partition(".")[0])

    def locate_skill(self, config: Any, skill: str, *, reach: bool) -> tuple[str | int, ...]:
        """Return the path of the grasp, place or hole to change for a skill."""
        name, _, rest = skill.partition("(")
        subject, *where = rest.rstrip(")").split(".")
        if name == "fasten":
            return ("screws", subject, "hole_m")
        if name in ("press", "dispense"):
            return ("works", subject)
        if name == "turn":
            return ("workholders", subject, "pivot_m")
        if name in ("clamp", "hold", "release"):
            part, _, by = subject.partition(":")
            holders = config.holders.items()
            first = (holder for holder, entry in holders if part in entry.parts)
            return ("holders", by or next(first))
        if name == "join":
            return ("parts", subject, "made_of")
        if subject not in config.parts:
            return ()
        part = config.parts[subject]
        if reach and "grasp" in part.model_fields_set:
            return ("parts", subject, "grasp")
        if where and where[0] in config.buffers:
            return ("buffers", where[0])
        if name == "place":
            return ("parts", subject, "goal_m")
        keys = ("made_of", "start_m", "start_on", "feeder")
        return ("parts", subject, next(key for key in keys if getattr(part, key) is not None))

    def generate(self, parameters: Mapping[str, Any]) -> str:
        """Return a random board with the parameters of `BoardGenerator`."""
        from skillplan.domains.assembly.board_generator import BoardGenerator

        try:
            given = {**parameters, "failures": tuple(parameters.get("failures", ())) or None}
            return BoardGenerator(**given).text()
        except TypeError as error:
            raise OptionError(f"The board cannot be generated: {error}.") from None
