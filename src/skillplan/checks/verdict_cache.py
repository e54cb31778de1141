"""Caches of verdicts: in memory for a run, on disk between runs.

A verdict applies in every state that agrees on the facts it rests on. On disk, the folder of a
verdict is named by a hash of everything that could change it, so no outdated verdict is ever
found. A damaged file is dropped, and its verdict is made again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from skillplan.checks.single_check import Checked
from skillplan.checks.variants import list_queried_skills
from skillplan.checks.verdict_files import (
    VerdictRecord,
    find_key_folder,
    is_verdict_file,
    read_record,
)
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import Facts, State
from skillplan.task.verdict import Verdict, VerdictStatus

# Class of the back end, its options and basis, identity of the task, and the skill.
_ShelfKey = tuple[type[BackEnd], str, str, int, str]


class _Shelf:
    """Verdicts of a back end on one skill, grouped by the facts they rest on.

    A look-up takes constant time per group.
    """

    def __init__(self, verdicts: Iterable[tuple[Verdict, State]] = ()) -> None:
        # By the bits of these facts, then by the true ones of them: verdict and its state.
        self._groups: dict[int, dict[int, tuple[Verdict, State]]] = {}
        for verdict, state in verdicts:
            self.add(verdict, state)

    def __iter__(self) -> Iterator[tuple[Verdict, State]]:
        for group in self._groups.values():
            yield from group.values()

    def made_in(self, verdict: Verdict) -> State | None:
        """Return the state in which a verdict was made, or None if it is not kept."""
        basis, present = _basis(verdict)
        entry = self._groups.get(basis, {}).get(present)
        return None if entry is None else entry[1]

    def add(self, verdict: Verdict, state: State) -> None:
        basis, present = _basis(verdict)
        self._groups.setdefault(basis, {})[present] = (verdict, state)

    def find(self, bits: int) -> Verdict | None:
        for basis, group in self._groups.items():
            entry = group.get(bits & basis)
            if entry is not None:
                return entry[0]
        return None


class VerdictCache:
    """Verdicts by back end, task and skill.

    Back ends of one class with equal options on the same task share their verdicts.
    """

    def __init__(self) -> None:
        self._shelves: dict[_ShelfKey, _Shelf] = {}
        # By identity of the back end, for speed. The reference keeps the identity unique.
        self._by_object: dict[tuple[int, str], tuple[BackEnd, _Shelf]] = {}

    def find(self, back_end: BackEnd, skill: Skill, state: State) -> Verdict | None:
        """Return a kept verdict that applies in `state`, or None."""
        return self._shelf(back_end, skill).find(state.bits)

    def keep(self, back_end: BackEnd, skill: Skill, checked: Checked, state: State) -> None:
        """Keep the answer to a query; its verdict names the facts it rests on."""
        self._shelf(back_end, skill).add(checked.verdict, state)

    def made_in(self, back_end: BackEnd, skill: Skill, verdict: Verdict) -> State | None:
        """Return the state in which a verdict was made, or None if it is not kept."""
        return self._shelf(back_end, skill).made_in(verdict)

    def made(self, back_end: BackEnd, skill: Skill) -> Iterator[tuple[Verdict, State]]:
        """Yield the verdicts on a skill with the states in which they were made."""
        yield from self._shelf(back_end, skill)

    def only(self, back_ends: Iterable[BackEnd]) -> VerdictCache:
        """Return a new cache in memory with the verdicts of some back ends."""
        copy = VerdictCache()
        for back_end in back_ends:
            for skill in list_queried_skills(back_end.task):
                shelf = self._shelves.get(_shelf_key(back_end, skill))
                if shelf is not None:
                    copy._shelves[_shelf_key(back_end, skill)] = _Shelf(shelf)
        return copy

    def take_over(self, other: VerdictCache) -> None:
        """Add the verdicts that another cache holds in memory, on the same task objects."""
        for key, shelf in other._shelves.items():
            own = self._shelves.setdefault(key, _Shelf())
            for verdict, state in shelf:
                own.add(verdict, state)

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


class AskingCache(VerdictCache):
    """A cache that finds nothing, so that back ends check every query again.

    Parameters
    ----------
    kept
        Cache that keeps the answers.
    """

    def __init__(self, kept: VerdictCache) -> None:
        super().__init__()
        self._kept = kept

    def find(self, back_end: BackEnd, skill: Skill, state: State) -> Verdict | None:
        """Return None."""
        return None

    def keep(self, back_end: BackEnd, skill: Skill, checked: Checked, state: State) -> None:
        """Keep an answer in the other cache."""
        self._kept.keep(back_end, skill, checked, state)


class _DiskShelf(_Shelf):
    """A shelf with a folder, to which other processes may add verdicts.

    Parameters
    ----------
    folder
        Folder of the verdicts; it need not exist.
    dropped
        List to which unreadable and damaged files are added.
    """

    def __init__(self, folder: Path, facts: Facts, dropped: list[Path]) -> None:
        super().__init__()
        self.folder = folder
        self.seen: set[str] = set()
        self._facts = facts
        self._dropped = dropped

    def find(self, bits: int) -> Verdict | None:
        verdict = super().find(bits)
        # Reading the folder again takes microseconds, a check a second.
        return super().find(bits) if verdict is None and self._read() else verdict

    def _read(self) -> bool:
        """Read new files, and return whether there were any."""
        try:
            names = set(os.listdir(self.folder))
        except OSError:
            return False
        new = sorted(name for name in names - self.seen if is_verdict_file(name))
        for name in new:
            self.seen.add(name)
            path = self.folder / name
            try:
                record = read_record(path)
                self.add(record.verdict(self._facts), self._facts.of(*record.state))
            except FileNotFoundError:
                continue
            except (OSError, ValueError):
                self._dropped.append(path)
                with suppress(OSError):
                    path.unlink()
        return bool(new)


class DiskVerdictCache(VerdictCache):
    """A cache that also writes verdicts of expensive back ends to a folder, one file each.

    Several processes may share the folder, and may be killed. If the folder cannot be written,
    a warning is logged and the run goes on.

    Parameters
    ----------
    folder
        The folder; created when first needed.

    Attributes
    ----------
    dropped
        Unreadable and damaged files.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder
        self.dropped: list[Path] = []
        self._writable = True

    def keep(self, back_end: BackEnd, skill: Skill, checked: Checked, state: State) -> None:
        """Keep an answer in memory and, if the back end is expensive, on disk."""
        super().keep(back_end, skill, checked, state)
        shelf = self._shelf(back_end, skill)
        is_decided = checked.verdict.status is not VerdictStatus.UNKNOWN
        if isinstance(shelf, _DiskShelf) and self._writable and is_decided:
            try:
                record = VerdictRecord.of(back_end, skill, checked, state)
                shelf.seen.add(record.write(shelf.folder))
            except OSError as error:
                self._writable = False
                import logging

                logging.getLogger(__name__).warning(
                    "skillplan: verdicts cannot be kept in %s: %s", self.folder, error.strerror
                )

    def take_over(self, other: VerdictCache) -> None:
        """Do nothing: the folder already holds the expensive verdicts."""

    def _new_shelf(self, back_end: BackEnd, skill: Skill) -> _Shelf:
        if not back_end.expensive:
            return _Shelf()
        folder = find_key_folder(self.folder, back_end, skill)
        return _DiskShelf(folder, back_end.task.facts, self.dropped)


def _basis(verdict: Verdict) -> tuple[int, int]:
    """Return the bits of the facts that a verdict rests on, and of the true facts among them."""
    assert verdict.present is not None
    assert verdict.absent is not None
    return verdict.present.bits | verdict.absent.bits, verdict.present.bits


def _shelf_key(back_end: BackEnd, skill: Skill) -> _ShelfKey:
    basis = json.dumps(dict(back_end.basis), sort_keys=True)
    options = back_end.options.model_dump_json()
    return type(back_end), options, basis, id(back_end.task), skill.name
