"""Boards at random to learn on: a family without a task file, such as ``generated:6-12``."""

from __future__ import annotations

import random
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from skillplan.domains.assembly.board_generator import MOST_PARTS, BoardGenerator
from skillplan.errors import OptionError
from skillplan.pipeline.setup import load_problem
from skillplan.task.task import Task

_FORM = re.compile(r"generated:(\d{1,3})(?:-(\d{1,3}))?")
# The boards of issue-wide tables: one to four tools, a tenth to half of all pairs ordered.
_TOOLS = (1, 4)
_DENSITIES = (0.1, 0.5)


@dataclass(frozen=True)
class GeneratedFamily:
    """Boards of `skillplan generate assembly`, of so many parts.

    Tools and density are drawn for every board, evenly, from 1 to 4 and from 0.1 to 0.5.

    Parameters
    ----------
    least, most
        How many parts, 1 <= least <= most.

    Raises
    ------
    OptionError
        If there are no such boards.
    """

    least: int
    most: int

    def __post_init__(self) -> None:
        if not 1 <= self.least <= self.most <= MOST_PARTS:
            raise OptionError(
                f"--family {self}: parts must be LEAST-MOST with 1 <= LEAST <= MOST <= "
                f"{MOST_PARTS}."
            )

    def __str__(self) -> str:
        return f"generated:{self.least}-{self.most}"

    @classmethod
    def parse(cls, text: str) -> GeneratedFamily:
        """Return the family of a text such as ``generated:6-12`` or ``generated:8``.

        Raises
        ------
        OptionError
            If it is none.
        """
        found = _FORM.fullmatch(text)
        if found is None:
            raise OptionError(
                f"--family {text}: is neither a number of layouts nor generated:LEAST-MOST, such "
                "as generated:6-12."
            )
        least = int(found[1])
        return cls(least, int(found[2] or least))

    def boards(self, count: int, seed: int) -> Iterator[BoardGenerator]:
        """Yield so many boards; the same arguments yield the same, and other seeds others.

        Parameters
        ----------
        count
            How many.
        seed
            >= 0; of two seeds no two boards are the same.
        """
        draw = random.Random(f"{self} {seed}").random
        for number in range(count):
            parts = self.least + int((self.most - self.least + 1) * draw())
            tools = min(parts, _TOOLS[0] + int((_TOOLS[1] - _TOOLS[0] + 1) * draw()))
            density = round(_DENSITIES[0] + (_DENSITIES[1] - _DENSITIES[0]) * draw(), 2)
            yield BoardGenerator(parts, density, tools, seed * 1_000_000 + number)

    def tasks(self, count: int, seed: int) -> Iterator[Task]:
        """Yield the tasks of `boards`."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "board.yaml"
            for board in self.boards(count, seed):
                path.write_text(board.text(), encoding="utf-8")
                yield load_problem(str(path)).task
