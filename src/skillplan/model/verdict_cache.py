"""Verdicts kept for reuse: in memory for a run, on disk between runs.

A verdict serves every state that agrees on the facts it rests on. On disk, a file holds the
verdicts of one skill under one back end; its name is a hash of everything that could change
the answer, so that nothing stale is ever found. A file that cannot be read is dropped and its
verdicts are made anew.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Container, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import Facts, State
from skillplan.task.verdict import Verdict, VerdictStatus

FORMAT = "skillplan.verdicts/1"


class VerdictCache:
    """Verdicts by back end and skill, found by the facts they rest on."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], list[tuple[int, int, Verdict]]] = {}

    def find(self, back_end: BackEnd, skill: Skill, state: State) -> Verdict | None:
        """Return a kept verdict that applies in `state`, or None."""
        bits = state.bits
        for present, absent, verdict in self._entries(back_end, skill):
            if bits & present == present and not bits & absent:
                return verdict
        return None

    def keep(self, back_end: BackEnd, skill: Skill, verdict: Verdict) -> None:
        """Keep a verdict that names the facts it rests on."""
        assert verdict.present is not None
        assert verdict.absent is not None
        entry = (verdict.present.bits, verdict.absent.bits, verdict)
        self._entries(back_end, skill).append(entry)

    def only(self, back_ends: Container[str]) -> VerdictCache:
        """Return a cache in memory that starts with the verdicts of some back ends."""
        copy = VerdictCache()
        copy._known = {
            key: list(entries) for key, entries in self._known.items() if key[0] in back_ends
        }
        return copy

    def _entries(self, back_end: BackEnd, skill: Skill) -> list[tuple[int, int, Verdict]]:
        return self._known.setdefault((back_end.name, skill.name), [])


class DiskVerdictCache(VerdictCache):
    """A cache that also keeps the verdicts of dear back ends in a folder.

    Parameters
    ----------
    folder
        Created when first needed.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.dropped: list[Path] = []

    def keep(self, back_end: BackEnd, skill: Skill, verdict: Verdict) -> None:
        """Keep a verdict in memory and, of a dear back end, on disk."""
        super().keep(back_end, skill, verdict)
        if back_end.dear and verdict.status is not VerdictStatus.UNKNOWN:
            kept = [entry[2] for entry in self._entries(back_end, skill)]
            decided = [entry for entry in kept if entry.status is not VerdictStatus.UNKNOWN]
            self._write(self._path(back_end, skill), decided)

    def _entries(self, back_end: BackEnd, skill: Skill) -> list[tuple[int, int, Verdict]]:
        key = (back_end.name, skill.name)
        if key not in self._known:
            self._known[key] = []
            if back_end.dear:
                self._known[key] = self._read(self._path(back_end, skill), back_end.task.facts)
        return self._known[key]

    def _path(self, back_end: BackEnd, skill: Skill) -> Path:
        return self.folder / back_end.name / f"{verdict_key(back_end, skill)}.json"

    def _read(self, path: Path, facts: Facts) -> list[tuple[int, int, Verdict]]:
        try:
            content = json.loads(path.read_text("utf-8"))
            if content["format"] != FORMAT:
                raise ValueError(f"format {content['format']!r}")
            verdicts = [_from_json(entry, facts) for entry in content["verdicts"]]
        except FileNotFoundError:
            return []
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            # A corrupt entry is never trusted; what it held is asked again.
            self.dropped.append(path)
            path.unlink(missing_ok=True)
            return []
        return [(v.present.bits, v.absent.bits, v) for v in verdicts]  # type: ignore[union-attr]

    def _write(self, path: Path, verdicts: list[Verdict]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        content = {"format": FORMAT, "verdicts": [_to_json(verdict) for verdict in verdicts]}
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                json.dump(content, file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def verdict_key(back_end: BackEnd, skill: Skill) -> str:
    """Return the hash of all that an answer of `back_end` about `skill` depends on.

    Scene, skill, facts, and the back end's name, version, distribution version and options.
    """
    content = {
        "back_end": [back_end.name, back_end.version, _distribution_version(back_end)],
        "options": back_end.options.model_dump(mode="json"),
        "facts": list(back_end.task.facts.names),
        "scene": plain(back_end.task.scene),
        "skill": [skill.name, plain(skill.motion), str(skill.precondition)],
        "prediction": [str(skill.prediction.add), str(skill.prediction.delete)],
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
    return Verdict(
        VerdictStatus(entry["status"]),
        str(entry["reason"]),
        str(entry["stage"]),
        facts.of(*entry["present"]),
        facts.of(*entry["absent"]),
        dict(entry["evidence"]),
    )
