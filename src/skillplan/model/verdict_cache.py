"""Verdicts kept for reuse: in memory for a run, on disk between runs.

A verdict serves every state that agrees on the facts it rests on. On disk, a file holds the
verdicts of one skill under one back end; its name is a hash of everything that could change
the answer, so that nothing stale is ever found. A file that cannot be read is dropped and its
verdicts are made anew.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from skillplan.task.atomic_file import write_whole
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import Facts, State
from skillplan.task.verdict import Verdict, VerdictStatus

FORMAT = "skillplan.verdicts/1"

_LOG = logging.getLogger(__name__)

# Class of the back end, its options, the task as an object, and the skill.
_ShelfKey = tuple[type[BackEnd], str, int, str]


class _Shelf:
    """The verdicts on one skill by one back end, grouped by the facts they rest on.

    Within a group a look-up is a dictionary's, however many verdicts it holds.
    """

    def __init__(self, verdicts: Iterable[Verdict] = ()) -> None:
        self._groups: dict[int, dict[int, Verdict]] = {}
        for verdict in verdicts:
            self.add(verdict)

    def __iter__(self) -> Iterator[Verdict]:
        for group in self._groups.values():
            yield from group.values()

    def add(self, verdict: Verdict) -> None:
        assert verdict.present is not None
        assert verdict.absent is not None
        basis = verdict.present.bits | verdict.absent.bits
        self._groups.setdefault(basis, {})[verdict.present.bits] = verdict

    def find(self, bits: int) -> Verdict | None:
        for basis, group in self._groups.items():
            verdict = group.get(bits & basis)
            if verdict is not None:
                return verdict
        return None


class VerdictCache:
    """Verdicts by back end, task and skill, found by the facts they rest on.

    Back ends of one class with equal options, made for the same task, share what they said.
    """

    def __init__(self) -> None:
        self._shelves: dict[_ShelfKey, _Shelf] = {}
        # By back end as an object, for speed; the back end is held so that its id stays its own.
        self._by_object: dict[tuple[int, str], tuple[BackEnd, _Shelf]] = {}

    def find(self, back_end: BackEnd, skill: Skill, state: State) -> Verdict | None:
        """Return a kept verdict that applies in `state`, or None."""
        return self._shelf(back_end, skill).find(state.bits)

    def keep(self, back_end: BackEnd, skill: Skill, verdict: Verdict) -> None:
        """Keep a verdict that names the facts it rests on."""
        self._shelf(back_end, skill).add(verdict)

    def only(self, back_ends: Iterable[BackEnd]) -> VerdictCache:
        """Return a cache in memory that starts with the verdicts of some back ends."""
        copy = VerdictCache()
        for back_end in back_ends:
            for skill in back_end.task.skills:
                shelf = self._shelves.get(_shelf_key(back_end, skill))
                if shelf is not None:
                    copy._shelves[_shelf_key(back_end, skill)] = _Shelf(shelf)
        return copy

    def _shelf(self, back_end: BackEnd, skill: Skill) -> _Shelf:
        known = self._by_object.get((id(back_end), skill.name))
        if known is not None:
            return known[1]
        key = _shelf_key(back_end, skill)
        shelf = self._shelves.get(key)
        if shelf is None:
            shelf = self._shelves[key] = self._new_shelf(back_end, skill)
        self._by_object[id(back_end), skill.name] = (back_end, shelf)
        return shelf

    def _new_shelf(self, back_end: BackEnd, skill: Skill) -> _Shelf:
        return _Shelf()


class DiskVerdictCache(VerdictCache):
    """A cache that also keeps the verdicts of dear back ends in a folder.

    A folder that cannot be written costs reuse between runs and a warning, never a run.

    Parameters
    ----------
    folder
        Created when first needed.

    Attributes
    ----------
    dropped
        Files that could not be read or trusted.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.dropped: list[Path] = []
        self._paths: dict[_ShelfKey, Path] = {}
        self._writable = True

    def keep(self, back_end: BackEnd, skill: Skill, verdict: Verdict) -> None:
        """Keep a verdict in memory and, of a dear back end, on disk."""
        super().keep(back_end, skill, verdict)
        if back_end.dear and self._writable and verdict.status is not VerdictStatus.UNKNOWN:
            shelf = self._shelf(back_end, skill)
            decided = [kept for kept in shelf if kept.status is not VerdictStatus.UNKNOWN]
            try:
                _write(self._path(back_end, skill), decided)
            except OSError as error:
                self._writable = False
                _LOG.warning(
                    "skillplan: verdicts cannot be kept in %s: %s", self.folder, error.strerror
                )

    def _new_shelf(self, back_end: BackEnd, skill: Skill) -> _Shelf:
        if not back_end.dear:
            return _Shelf()
        path = self._path(back_end, skill)
        try:
            return _Shelf(_read(path, back_end.task.facts))
        except FileNotFoundError:
            return _Shelf()
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            # What cannot be trusted is asked again, and written over.
            self.dropped.append(path)
            return _Shelf()

    def _path(self, back_end: BackEnd, skill: Skill) -> Path:
        key = _shelf_key(back_end, skill)
        if key not in self._paths:
            name = f"{verdict_key(back_end, skill)}.json"
            self._paths[key] = self.folder / back_end.name / name
        return self._paths[key]


def _shelf_key(back_end: BackEnd, skill: Skill) -> _ShelfKey:
    return type(back_end), back_end.options.model_dump_json(), id(back_end.task), skill.name


def _class_name(back_end: BackEnd) -> str:
    """Return what tells an engine from a detector of the same name."""
    return f"{type(back_end).__module__}.{type(back_end).__qualname__}"


def _read(path: Path, facts: Facts) -> list[Verdict]:
    content = json.loads(path.read_text("utf-8"))
    if content["format"] != FORMAT:
        raise ValueError(f"format {content['format']!r}")
    return [_from_json(entry, facts) for entry in content["verdicts"]]


def _write(path: Path, verdicts: list[Verdict]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"format": FORMAT, "verdicts": [_to_json(verdict) for verdict in verdicts]}
    write_whole(path, json.dumps(content))


def verdict_key(back_end: BackEnd, skill: Skill) -> str:
    """Return the hash of all that an answer of `back_end` about `skill` depends on.

    Scene, skill, facts, and the back end's name, version, distribution version and options.
    """
    content = {
        "back_end": [
            _class_name(back_end),
            back_end.name,
            back_end.version,
            _distribution_version(back_end),
        ],
        "options": back_end.options.model_dump(mode="json"),
        "facts": list(back_end.task.facts.names),
        "scene": plain(back_end.task.scene),
        "skill": [skill.name, skill.kind, list(skill.agents), dict(skill.parameters)],
        "execution": [plain(skill.motion), str(skill.precondition)],
        "prediction": [str(skill.prediction.add), str(skill.prediction.delete)],
        "cases": [
            plain(case.fact) + plain(case.forbids) + plain(case.outcomes) for case in skill.cases
        ],
        "chart": [[line.before, line.after] for line in back_end.task.chart],
        "operations": dict(back_end.task.operations),
    }
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def plain(value: Any) -> Any:
    """Return a data class as JSON values; states become their facts' names."""
    if isinstance(value, State):
        return list(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        names = value.__dataclass_fields__
        return {name: plain(getattr(value, name)) for name in names if not name.startswith("_")}
    return value


def _distribution_version(back_end: BackEnd) -> str:
    package = type(back_end).__module__.partition(".")[0].replace("_", "-")
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _to_json(verdict: Verdict) -> dict[str, Any]:
    return {
        "status": verdict.status.value,
        "reason": verdict.reason,
        "stage": verdict.stage,
        "present": list(verdict.present or ()),
        "absent": list(verdict.absent or ()),
        "evidence": dict(verdict.evidence),
    }


def _from_json(entry: dict[str, Any], facts: Facts) -> Verdict:
    names = [*entry["present"], *entry["absent"]]
    if not all(name in facts for name in names):
        raise ValueError("a kept verdict rests on unknown facts")
    if entry["status"] == VerdictStatus.UNKNOWN:
        raise ValueError("a verdict that is unknown is never kept")
    return Verdict(
        VerdictStatus(entry["status"]),
        str(entry["reason"]),
        str(entry["stage"]),
        facts.of(*entry["present"]),
        facts.of(*entry["absent"]),
        dict(entry["evidence"]),
    )
