"""Which verdicts were reused, and where: a sample that costs a search next to nothing."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict

DEFAULT_SIZE = 8


@dataclass(frozen=True, slots=True)
class Reuse:
    """A verdict that answered for a back end.

    Parameters
    ----------
    back_end
        The index of the one that gave it.
    skill, state
        What was asked, and where.
    verdict
        The answer that was kept.
    """

    back_end: int
    skill: Skill
    state: State
    verdict: Verdict


class ReuseSample:
    """Of every skill and back end each n-th reuse, where n doubles when there are too many.

    Parameters
    ----------
    most
        So many of a skill and back end are remembered, >= 2.
    """

    def __init__(self, most: int = DEFAULT_SIZE) -> None:
        self.most = most
        self._rows: dict[tuple[int, str], _Row] = {}

    def keep(self, wanted: int) -> None:
        """Remember so many of each that as many as are wanted can be drawn."""
        self.most = max(DEFAULT_SIZE, 2 * wanted)

    def note(self, back_end: int, skill: Skill, state: State, said: Verdict) -> None:
        """Note that a verdict of a back end, given by its index, was reused."""
        key = (back_end, skill.name)
        row = self._rows.get(key)
        if row is None:
            row = self._rows[key] = _Row()
        row.count += 1
        if row.count == row.due:
            row.entries.append(Reuse(back_end, skill, state, said))
            if len(row.entries) >= self.most:
                row.entries = row.entries[::2]
                row.every *= 2
            row.due = row.count + row.every

    @property
    def count(self) -> int:
        """How many reuses there were."""
        return sum(row.count for row in self._rows.values())

    def by_skill(self) -> list[list[Reuse]]:
        """Return what is remembered, a list for every skill and back end."""
        # At once: a search that goes on in another thread adds rows.
        return [list(row.entries) for row in list(self._rows.values())]


class _Row:
    """What is remembered of one skill and back end."""

    __slots__ = ("count", "due", "entries", "every")

    def __init__(self) -> None:
        self.count = 0
        self.due = 1
        self.every = 1
        self.entries: list[Reuse] = []
