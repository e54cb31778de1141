"""Verdicts kept for reuse: in memory for a run, on disk between runs.

A verdict serves every state that agrees on the facts it rests on. On disk each has a file of its
own, in a folder named by a hash of everything that could change the answer, so that nothing
stale is ever found. A file that is not exactly as it was written is dropped and its verdict made
again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from skillplan.checks.single_check import Checked
from skillplan.checks.verdict_file import VerdictRecord, is_verdict_file, read_record
from skillplan.checks.verdict_key import verdict_key
from skillplan.checks.ways import asked_about
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import Facts, State
from skillplan.task.verdict import Verdict, VerdictStatus

# Class of the back end, its options and basis, the task as an object, and the skill.
_ShelfKey = tuple[type[BackEnd], str, str, int, str]


class _Shelf:
    """The verdicts on one skill by one back end, grouped by the facts they rest on.

    Within a group a look-up is a dictionary's, however many verdicts it holds.
    """

    def __init__(self, verdicts: Iterable[tuple[Verdict, State]] = ()) -> None:
        # Each with the state in which it was made.
        self._groups: dict[int, dict[int, tuple[Verdict, State]]] = {}
        for verdict, state in verdicts:
            self.add(verdict, state)

    def __iter__(self) -> Iterator[tuple[Verdict, State]]:
        for group in self._groups.values():
            yield from group.values()

    def made_in(self, verdict: Verdict) -> State | None:
        """Return the state in which a verdict was made, or None for one that is not kept."""
        basis, present = _basis(verdict)
        kept = self._groups.get(basis, {}).get(present)
        return None if kept is None else kept[1]

    def add(self, verdict: Verdict, state: State) -> None:
        basis, present = _basis(verdict)
        self._groups.setdefault(basis, {})[present] = (verdict, state)

    def find(self, bits: int) -> Verdict | None:
        for basis, group in self._groups.items():
            kept = group.get(bits & basis)
            if kept is not None:
                return kept[0]
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

    def keep(self, back_end: BackEnd, skill: Skill, checked: Checked, state: State) -> None:
        """Keep what was said of a skill in a state; the verdict names the facts it rests on."""
        self._shelf(back_end, skill).add(checked.verdict, state)

    def made_in(self, back_end: BackEnd, skill: Skill, verdict: Verdict) -> State | None:
        """Return the state in which a verdict of this cache was made, or None."""
        return self._shelf(back_end, skill).made_in(verdict)

    def made(self, back_end: BackEnd, skill: Skill) -> Iterator[tuple[Verdict, State]]:
        """Yield the verdicts on a skill, each with the state in which it was made."""
        yield from self._shelf(back_end, skill)

    def only(self, back_ends: Iterable[BackEnd]) -> VerdictCache:
        """Return a cache in memory that starts with the verdicts of some back ends."""
        copy = VerdictCache()
        for back_end in back_ends:
            for skill in asked_about(back_end.task):
                shelf = self._shelves.get(_shelf_key(back_end, skill))
                if shelf is not None:
                    copy._shelves[_shelf_key(back_end, skill)] = _Shelf(shelf)
        return copy

    def take_over(self, other: VerdictCache) -> None:
        """Take over what another cache has in memory, of the same tasks as objects."""
        for key, shelf in other._shelves.items():
            mine = self._shelves.setdefault(key, _Shelf())
            for verdict, state in shelf:
                mine.add(verdict, state)

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
    """Answers nothing, so that every query is put to a back end; keeps what is said elsewhere.

    Parameters
    ----------
    kept
        Where verdicts are kept.
    """

    def __init__(self, kept: VerdictCache) -> None:
        super().__init__()
        self._kept = kept

    def find(self, back_end: BackEnd, skill: Skill, state: State) -> Verdict | None:
        """Return None."""
        return None

    def keep(self, back_end: BackEnd, skill: Skill, checked: Checked, state: State) -> None:
        """Keep what was said where others find it."""
        self._kept.keep(back_end, skill, checked, state)


class _DiskShelf(_Shelf):
    """A shelf with a folder, in which other processes may put verdicts, too.

    Parameters
    ----------
    folder
        Where the verdicts are; need not be there.
    facts
        The vocabulary of the task.
    dropped
        Where files are noted that could not be read or trusted.
    """

    def __init__(self, folder: Path, facts: Facts, dropped: list[Path]) -> None:
        super().__init__()
        self.folder = folder
        self.seen: set[str] = set()
        self._facts = facts
        self._dropped = dropped

    def find(self, bits: int) -> Verdict | None:
        found = super().find(bits)
        # Looking again costs microseconds, another check a second.
        return super().find(bits) if found is None and self._read() else found

    def _read(self) -> bool:
        """Read what is new in the folder; return whether there was anything."""
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
                # What cannot be trusted is queried again.
                self._dropped.append(path)
                with suppress(OSError):
                    path.unlink()
        return bool(new)


class DiskVerdictCache(VerdictCache):
    """A cache that also keeps verdicts of expensive back ends in a folder, each in its own file.

    Several processes may use one folder at a time, and be killed: what one has kept, all find.
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
        self._writable = True

    def keep(self, back_end: BackEnd, skill: Skill, checked: Checked, state: State) -> None:
        """Keep what was said in memory and, of an expensive back end, on disk."""
        super().keep(back_end, skill, checked, state)
        shelf = self._shelf(back_end, skill)
        decided = checked.verdict.status is not VerdictStatus.UNKNOWN
        if isinstance(shelf, _DiskShelf) and self._writable and decided:
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
        """Do nothing: what was worth a check is found in the folder."""

    def _new_shelf(self, back_end: BackEnd, skill: Skill) -> _Shelf:
        if not back_end.expensive:
            return _Shelf()
        folder = key_folder(self.folder, back_end, skill)
        return _DiskShelf(folder, back_end.task.facts, self.dropped)


def _basis(verdict: Verdict) -> tuple[int, int]:
    """Return the bits of the facts that a verdict rests on, and of those among them that hold."""
    assert verdict.present is not None
    assert verdict.absent is not None
    return verdict.present.bits | verdict.absent.bits, verdict.present.bits


def key_folder(root: Path, back_end: BackEnd, skill: Skill) -> Path:
    """Return the folder below `root` of what a back end says about a skill."""
    return root / back_end.name / verdict_key(back_end, skill)


def _shelf_key(back_end: BackEnd, skill: Skill) -> _ShelfKey:
    basis = json.dumps(dict(back_end.basis), sort_keys=True)
    options = back_end.options.model_dump_json()
    return type(back_end), options, basis, id(back_end.task), skill.name
