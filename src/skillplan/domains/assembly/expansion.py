"""Entries with `count`, and trays, written out: a task of numbered parts, screws and fixtures.

This happens before a file is validated. Every key that is written out keeps the position of the
key it comes from, so faults of ``clip_3`` are reported where ``clip`` stands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from skillplan.domains.assembly.many_schema import PatternConfig, TrayConfig
from skillplan.errors import Issue, name_hint
from skillplan.files.yaml import Document

_Path = tuple[str | int, ...]
_Model = TypeVar("_Model", bound=BaseModel)

# Keys that only entries to be written out have, by section.
_KEYS = {
    "parts": ("count", "start_in", "start_pattern", "goal_pattern", "interchangeable"),
    "screws": ("count", "start_in", "start_pattern", "hole_pattern"),
}
# Keys of an entry that name other parts.
_REFERENCES = ("start_on", "goal_on", "through", "into", "made_of")
_MOST = 256


def expand(document: Document) -> Document:
    """Return a document whose counted entries and trays are written out.

    Entries whose keys have a wrong type stay as they are, for the schema to report.
    """
    data = document.data
    if not isinstance(data, dict) or not (data.get("trays") or any(_list_counted(data))):
        return document
    return _Expansion(document).run()


def _list_counted(data: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield section and name of every entry to be written out."""
    for section, keys in _KEYS.items():
        entries = data.get(section)
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            if isinstance(entry, dict) and (
                any(key in entry for key in keys) or isinstance(entry.get("tool"), list)
            ):
                yield section, name


def _get_count(entry: Any) -> int | None:
    """Return the valid count of an entry, or None."""
    count = entry.get("count") if isinstance(entry, dict) else None
    if not isinstance(count, int) or isinstance(count, bool):
        return None
    return count if 1 <= count <= _MOST else None


class _Expansion:
    """The document while it is written out."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.data = deepcopy(document.data)
        self.issues: list[Issue] = []
        # Where written keys come from, the most recent last.
        self.sources: dict[_Path, _Path] = {}
        self.counts = {
            name: count
            for section in _KEYS
            for name, entry in self._entries(section).items()
            if (count := _get_count(entry)) is not None
        }
        self.trays: dict[str, TrayConfig] = {}
        self.taken: dict[str, int] = {}

    def run(self) -> Document:
        """Return the written document."""
        self._write_trays()
        for section in _KEYS:
            if isinstance(self.data.get(section), dict):
                self._write_section(section)
        self._write_chart()
        self._write_goal()
        self._write_holding()
        values, keys = dict(self.document.values), dict(self.document.keys)
        given = list(self.document.given)
        for target, source in self.sources.items():
            for known, positions in ((self.document.values, values), (self.document.keys, keys)):
                positions |= {
                    target + path[len(source) :]: position
                    for path, position in known.items()
                    if path[: len(source)] == source
                }
            given += [
                target + path[len(source) :]
                for path in self.document.given
                if path[: len(source)] == source
            ]
        return replace(
            self.document,
            data=self.data,
            values=values,
            keys=keys,
            given=tuple(given),
            issues=(*self.document.issues, *map(self.document.locate, self.issues)),
            written_from=self.document,
            sources=self.sources,
        )

    def _entries(self, section: str) -> dict[str, Any]:
        entries = self.data.get(section)
        return entries if isinstance(entries, dict) else {}

    def _fault(self, message: str, *path: str | int) -> None:
        self.issues.append(Issue(message, path))

    def _write_trays(self) -> None:
        """Add a fixture for every valid tray."""
        trays = self.data.get("trays")
        if not isinstance(trays, dict):
            return
        fixtures = self.data.setdefault("fixtures", {})
        for name, entry in trays.items():
            tray = _read(TrayConfig, entry)
            if tray is None or not isinstance(fixtures, dict):
                continue
            self.trays[name] = tray
            if name in fixtures:
                self._fault(
                    f"the name {name!r} is taken in 'fixtures'. Choose another.", "trays", name
                )
                continue
            fixtures[name] = tray.build_fixture()
            self.sources["fixtures", name] = ("trays", name)
        if len(self.trays) == len(trays):
            del self.data["trays"]

    def _write_section(self, section: str) -> None:
        written: dict[str, Any] = {}
        for name, entry in self.data[section].items():
            if not isinstance(entry, dict) or (section, name) not in set(_list_counted(self.data)):
                written[name] = self._with_references(entry, 0, None)
                continue
            if "count" in entry and name not in self.counts:
                written[name] = entry  # a fault, which the schema reports
                continue
            for new_name, new_entry in self._write_entry(section, name, entry):
                if new_name in self.data[section] and new_name != name:
                    self._fault(
                        f"the name {new_name!r} is taken by the count of {name!r}. Choose another.",
                        *(section, new_name),
                    )
                written[new_name] = new_entry
        self.data[section] = written

    def _write_entry(
        self, section: str, name: str, entry: dict[str, Any]
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the numbered entries of one entry, or the entry with a place in its tray."""
        count = self.counts.get(name)
        self._check_places(section, name, entry, count)
        places = {
            key: self._read_pattern(section, name, entry, f"{key}_pattern", count)
            for key in ("start", "goal", "hole")
        }
        pockets = self._take_pockets(section, name, entry, count or 1)
        arrivals = entry.get("arrives_s") if section == "parts" and count is not None else None
        if isinstance(arrivals, list) and len(arrivals) != count:
            words = f"{len(arrivals)} times for {count} parts. Give one for each, or a single one."
            self._fault(words, section, name, "arrives_s")
        for index in range(count or 1):
            new_name = name if count is None else f"{name}_{index + 1}"
            new = {
                key: deepcopy(value) for key, value in entry.items() if key not in _KEYS[section]
            }
            new = self._with_references(new, index, count)
            here: _Path = (section, new_name)
            self.sources[here] = (section, name)
            tools = new.get("tool")
            if isinstance(tools, list) and tools:
                new["tool"] = tools[0]
                if tools[1:]:
                    new["other_tools"] = tools[1:] + _as_list(new.get("other_tools", []))
                    self.sources[*here, "other_tools"] = (section, name, "tool")
            if isinstance(arrivals, list) and index < len(arrivals):
                new["arrives_s"] = arrivals[index]
                self.sources[*here, "arrives_s"] = (section, name, "arrives_s", index)
            for key, pattern in places.items():
                if pattern is None and f"{key}_pattern" in entry:
                    # The schema names what is wrong with it.
                    new[f"{key}_pattern"] = entry[f"{key}_pattern"]
                first = new.get(f"{key}_m")
                if pattern is not None and isinstance(first, list) and index < pattern.places:
                    new[f"{key}_m"] = _move(first, pattern.offset(index))
                    if not index and pattern.levels > 1 and len(first) == 2:
                        words = "several levels need the height of the first: give x y z [m]."
                        self._fault(words, section, name, f"{key}_m")
            if index < len(pockets):
                tray, number = pockets[index]
                new["start_m"] = list(tray.pocket(number))
                if section == "parts":
                    self._lay_on_tray(new, entry["start_in"], tray)
                self.sources[*here, "start_m"] = (section, name, "start_in")
            if section == "parts":
                self._write_class(new, name, entry, count)
            yield new_name, new

    def _write_class(
        self, new: dict[str, Any], name: str, entry: dict[str, Any], count: int | None
    ) -> None:
        """Set the class of an interchangeable part."""
        given = entry.get("interchangeable")
        if not isinstance(given, bool | None):
            new["interchangeable"] = given
            return
        numbered = count is not None and count > 1
        if given and not numbered:
            self._fault(
                "is true of parts with a 'count' of 2 or more. Name a class that the parts share.",
                *("parts", name, "interchangeable"),
            )
        starts = "feeder" not in entry and not entry.get("fixed")
        if given and numbered and not starts:
            self._fault(
                "parts of a feeder need no assignment: the next goes to any goal. Leave it out.",
                *("parts", name, "interchangeable"),
            )
        if numbered and starts and given is not False:
            new["interchangeable"] = name

    def _check_places(
        self, section: str, name: str, entry: dict[str, Any], count: int | None
    ) -> None:
        """Find numbered entries that would all lie at one place, and patterns without a count."""
        if count is None:
            for key in ("start_pattern", "goal_pattern", "hole_pattern"):
                if key in entry:
                    self._fault("a pattern needs 'count'. Add it.", section, name, key)
            return
        if count == 1:
            return
        shared = any(self._is_paired(entry, key, count) for key in ("goal_on", "through"))
        if section == "screws":
            for key, needed in (("hole", True), ("start", "start_m" in entry)):
                if needed and f"{key}_pattern" not in entry:
                    words = f"{count} screws need '{key}_pattern'."
                    self._fault(words, section, name, "count")
            return
        starts = ("feeder", "start_in", "start_pattern")
        is_laid = any(key in entry for key in starts) or self._is_paired(entry, "start_on", count)
        if not is_laid and not entry.get("fixed"):
            self._fault(
                f"{count} parts need 'start_in', 'start_pattern' or 'feeder'.",
                *(section, name, "count"),
            )
        if "goal_pattern" not in entry and not shared:
            self._fault(f"{count} parts need 'goal_pattern'.", section, name, "count")

    def _is_paired(self, entry: dict[str, Any], key: str, count: int) -> bool:
        named = entry.get(key)
        names = named if isinstance(named, list) else [named]
        return any(isinstance(other, str) and self.counts.get(other) == count for other in names)

    def _read_pattern(
        self, section: str, name: str, entry: dict[str, Any], key: str, count: int | None
    ) -> PatternConfig | None:
        pattern = _read(PatternConfig, entry.get(key))
        first = f"{key.removesuffix('_pattern')}_m"
        if pattern is not None and first not in entry:
            self._fault(f"a pattern needs {first!r}, the place of the first.", section, name, key)
        if pattern is not None and count is not None and pattern.places < count:
            grid = " x ".join(map(str, pattern.grid))
            self._fault(
                f"{grid} places are too few for {count}. Enlarge the grid.", section, name, key
            )
        return pattern

    def _take_pockets(
        self, section: str, name: str, entry: dict[str, Any], count: int
    ) -> list[tuple[TrayConfig, int]]:
        """Return the next free pockets of the tray of an entry."""
        if "start_in" not in entry:
            return []
        path = (section, name, "start_in")
        tray_name = entry["start_in"]
        if not isinstance(tray_name, str) or tray_name not in self.trays:
            known = self.document.data.get("trays")
            names = list(known) if isinstance(known, dict) else []
            if tray_name not in names:
                hint = name_hint(str(tray_name), names) if names else "Add 'trays:'."
                self._fault(f"unknown tray {tray_name!r}. {hint}", *path)
            return []
        for key in ("start_m", "start_on", "feeder", "start_pattern"):
            if key in entry:
                self._fault(f"give one of 'start_in' and {key!r}, not both.", section, name, key)
        tray, first = self.trays[tray_name], self.taken.get(tray_name, 0)
        self.taken[tray_name] = first + count
        if first + count > tray.pattern.places:
            self._fault(
                f"{tray_name!r} has {tray.pattern.places} pockets, {first} of them taken: too few "
                f"for {count}. Enlarge its grid.",
                *path,
            )
            return []
        return [(tray, index) for index in range(first, first + count)]

    @staticmethod
    def _lay_on_tray(new: dict[str, Any], name: str, tray: TrayConfig) -> None:
        """Let a part lie on its tray, turned with it."""
        new["start_on"] = name
        yaw_rad = new.get("start_yaw_rad", 0.0)
        if tray.yaw_rad and "start_rpy_rad" not in new and isinstance(yaw_rad, int | float):
            new["start_yaw_rad"] = yaw_rad + tray.yaw_rad

    def _with_references(self, entry: Any, index: int, count: int | None) -> Any:
        """Return an entry whose names of counted entries are written out."""
        if not isinstance(entry, dict):
            return entry

        def resolve(named: Any, alone: bool) -> Any:
            known = self.counts.get(named) if isinstance(named, str) else None
            if known is None:
                return named
            if known == count:
                return f"{named}_{index + 1}"
            return named if alone else _number(named, known)

        new = dict(entry)
        for key in _REFERENCES:
            if key not in new:
                continue
            named = new[key]
            if isinstance(named, list):
                new[key] = _flatten(named, lambda other: resolve(other, False))
            else:
                new[key] = resolve(named, key in ("start_on", "through"))
        if isinstance(new.get("fits"), dict):
            new["fits"] = {
                other: fit
                for named, fit in new["fits"].items()
                for other in _as_list(resolve(named, False))
            }
        return new

    def _write_chart(self) -> None:
        """Write out names in the chart: a counted name stands for all of its entries."""
        chart = self.data.get("chart")
        if not isinstance(chart, list):
            return
        lines: list[Any] = []
        for line_index, line in enumerate(chart):
            if not isinstance(line, dict):
                lines.append(line)
                continue
            new = dict(line)
            for key in ("after", "any_of"):
                if isinstance(new.get(key), list):
                    new[key] = _flatten(new[key], self._all_of)
            for before in _as_list(self._all_of(new.get("before"))):
                self.sources["chart", len(lines)] = ("chart", line_index)
                lines.append(new if "before" not in new else {**new, "before": before})
        if len(lines) != len(chart) or lines != chart:
            self.data["chart"] = lines
        else:
            self.sources = {k: v for k, v in self.sources.items() if k[0] != "chart"}

    def _write_goal(self) -> None:
        """Write out facts of the goal: ``placed(clip)`` stands for all clips."""
        goal = self.data.get("goal")
        if isinstance(goal, list):
            self.data["goal"] = _flatten(goal, self._all_facts)

    def _write_holding(self) -> None:
        """Write out the parts of workholders and holders: a counted name stands for all."""
        for section, key in (("workholders", "carries"), ("holders", "parts")):
            for entry in self._entries(section).values():
                if isinstance(entry, dict) and key in entry:
                    entry[key] = _flatten(_as_list(entry[key]), self._all_of)

    def _all_of(self, name: Any) -> Any:
        count = self.counts.get(name) if isinstance(name, str) else None
        return name if count is None else _number(name, count)

    def _all_facts(self, fact: Any) -> Any:
        if not isinstance(fact, str):
            return fact
        kind, bracket, rest = fact.partition("(")
        names = self._all_of(rest.removesuffix(")"))
        return (
            [f"{kind}({name})" for name in names] if bracket and isinstance(names, list) else fact
        )


def _read(model: type[_Model], value: Any) -> _Model | None:
    """Return a value as a model, or None if it is none, which the schema reports."""
    try:
        return model.model_validate(value)
    except ValidationError:
        return None


def _number(name: str, count: int) -> list[str]:
    return [f"{name}_{number}" for number in range(1, count + 1)]


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _flatten(values: list[Any], resolve: Callable[[Any], Any]) -> list[Any]:
    """Return a list whose entries may each be replaced by several."""
    return [item for value in values for item in _as_list(resolve(value))]


def _move(place_m: list[Any], by_m: tuple[float, float, float]) -> list[Any]:
    """Return a place, with or without height, that is moved [m]."""
    return [
        round(value + more_m, 9) if isinstance(value, int | float) else value
        for value, more_m in zip(place_m, by_m, strict=False)
    ]
