"""The numbers of a TSPLIB file: how many there must be, and where each of them stands."""

from __future__ import annotations

import re
from array import array
from collections import Counter
from functools import cached_property
from math import isqrt

from skillplan.domains.sop.schema import MOST_COST, MOST_NODES
from skillplan.errors import Issue
from skillplan.files.schema_errors import shown
from skillplan.files.yaml import Position

_TOKEN = re.compile(r"\S+")
_END = re.compile(r"(?<!\S)EOF(?!\S)")
_PLAIN = re.compile(r"[-+0-9\s]*")
_WHOLE = re.compile(r"[-+]?[0-9]+")
_DECIMAL = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")

# Longer than any number that may stand there, and short enough to be converted at once.
_MOST_DIGITS = 20
# Of tokens that are no numbers, so many are listed.
_MOST_LISTED = 5


class MatrixText:
    """The part of a text that holds the numbers of a square matrix, up to ``EOF``.

    Parameters
    ----------
    text
        The whole file, its lines ended by line feeds.
    start
        Where the numbers begin.
    """

    def __init__(self, text: str, start: int) -> None:
        end = _END.search(text, start)
        self.text = text
        self.start = start
        self.end = len(text) if end is None else end.start()
        self._skipped = 0

    def rows(self, dimension: int | None) -> tuple[list[list[int]], list[Issue]]:
        """Return the matrix, and its faults; where there are any, the matrix is empty.

        Parameters
        ----------
        dimension
            How many rows and columns there must be, >= 2; None for what the numbers say.
        """
        after = _TOKEN.search(self.text, self.end + len("EOF"))
        faults = []
        if after is not None:
            message = f"nothing may follow EOF, but {shown(after[0])} does. Remove it."
            faults.append(fault_at(self.text, after.start(), message))
        numbers, unread = self._numbers()
        faults += unread
        if unread:
            return [], faults
        n, skipped = self._shape(numbers, dimension)
        if n == 0:
            faults.append(self._count_fault(numbers, dimension))
        elif n > MOST_NODES:
            message = f"the matrix is {n} x {n}; at most {MOST_NODES} nodes can be ordered."
            faults.append(fault_at(self.text, self._offset(0), message))
        if faults:
            return [], faults
        self._skipped = skipped
        return [numbers[first : first + n] for first in range(skipped, skipped + n * n, n)], []

    @property
    def first(self) -> int:
        """Where the numbers begin, without the blanks before them."""
        token = _TOKEN.search(self.text, self.start, self.end)
        return self.start if token is None else token.start()

    def position(self, index: int) -> Position:
        """Return line and column, from 1, of an entry of the matrix, counted row by row."""
        return position_at(self.text, self._offset(self._skipped + index))

    @cached_property
    def _offsets(self) -> array[int]:
        tokens = _TOKEN.finditer(self.text, self.start, self.end)
        return array("L", (token.start() for token in tokens))

    def _offset(self, index: int) -> int:
        """Return where a number begins; where the numbers end if there are not as many."""
        return self._offsets[index] if index < len(self._offsets) else self._close

    @property
    def _close(self) -> int:
        """Where ``EOF`` stands, or else the last character that is no white space."""
        if self.end < len(self.text):
            return self.end
        return max(len(self.text.rstrip()) - 1, 0)

    def _numbers(self) -> tuple[list[int], list[Issue]]:
        """Return the numbers and the faults of what is none."""
        body = self.text[self.start : self.end]
        if _PLAIN.fullmatch(body):
            try:
                return list(map(int, body.split())), []
            except ValueError:
                pass  # a sign by itself, or endless digits: reported below, with its place
        numbers, faults = [], []
        for token in _TOKEN.finditer(self.text, self.start, self.end):
            word = token[0]
            if _WHOLE.fullmatch(word) and len(word) <= _MOST_DIGITS:
                numbers.append(int(word))
            else:
                faults.append(fault_at(self.text, token.start(), _token_fault(word)))
            if len(faults) == _MOST_LISTED:
                break
        return numbers, faults

    @cached_property
    def _counts(self) -> list[int]:
        """How many numbers each line holds that holds any."""
        lines = self.text[self.start : self.end].split("\n")
        return [count for count in (len(line.split()) for line in lines) if count]

    def _led(self, numbers: list[int], n: int) -> bool:
        """Whether the first of n x n numbers is the dimension, so that one of them is missing.

        It is where it stands alone in its line, while others do not, or where it is n.
        """
        alone = self._counts[0] == 1 and max(self._counts) > 1
        return (alone and numbers[0] > 1) or (numbers[0] == n and self._counts[0] != n)

    def _shape(self, numbers: list[int], dimension: int | None) -> tuple[int, int]:
        """Return how many rows the numbers make and how many stand before them; 0 for none."""
        count = len(numbers)
        n = isqrt(count) if dimension is None else dimension
        if count and count == n * n:
            return (0, 0) if self._led(numbers, n) else (n, 0)
        if dimension is None and count > 1:
            n = isqrt(count - 1)
        return (n, 1) if count == n * n + 1 and numbers[0] == n else (0, 0)

    def _count_fault(self, numbers: list[int], dimension: int | None) -> Issue:
        """Return what is wrong with how many numbers there are, where that is best seen."""
        counts = self._counts
        count = len(numbers)
        alone = counts[:1] == [1] and len(counts) > 1 and numbers[0] > 1
        if alone and dimension not in (None, numbers[0]):
            message = f"this says {numbers[0]} nodes, but DIMENSION says {dimension}."
            return fault_at(self.text, self._offset(0), f"{message} Make them agree.")
        n = dimension
        if n is None and (alone or numbers[0] ** 2 == count):
            n = numbers[0]
        led = alone or (n is not None and numbers[:1] == [n] and count in (n * n, n * n + 1))
        if alone:
            counts = counts[1:]
        count -= led
        if not count:
            return fault_at(self.text, self._close, f"the {n} x {n} numbers are missing.")
        usual, often = Counter(counts).most_common(1)[0]
        width = usual if n is None else n
        odd = next((i for i, found in enumerate(counts) if found != width), None)
        if n is None:
            message = f"{count} numbers make no square matrix."
        else:
            message = f"there are {count} numbers instead of {n * n}, {n} x {n}."
        if width == usual and 2 * often >= len(counts) > 1 and odd is not None:
            message += f" This line has {counts[odd]} where {width} are needed."
            return fault_at(self.text, self._offset(sum(counts[:odd]) + alone), message)
        if n is None:
            if often == len(counts) > 1:
                message += f" There are {often} lines of {usual}."
            return fault_at(self.text, self._offset(0), message)
        if count < n * n:
            return fault_at(self.text, self._close, f"{message} The rest is missing.")
        surplus = self._offset(n * n + led)
        return fault_at(self.text, surplus, f"{message} Here is the first too many.")


def fault_at(text: str, offset: int, message: str) -> Issue:
    """Return the issue of what stands at an offset of a text."""
    return Issue(message, (), *position_at(text, offset))


def position_at(text: str, offset: int) -> Position:
    """Return line and column of an offset, both from 1."""
    return text.count("\n", 0, offset) + 1, offset - text.rfind("\n", 0, offset)


def _token_fault(word: str) -> str:
    if _WHOLE.fullmatch(word):
        digits = len(word.lstrip("+-"))
        return f"a number of {digits} digits is too large; {MOST_COST:,} is the most."
    if _DECIMAL.fullmatch(word):
        return f"must be a whole number, not {word[:40]}. Scale the costs until all are whole."
    if word[0].isalpha():
        return f"must be a number or EOF, not {shown(word)}."
    if "," in word or ";" in word:
        return f"must be a number, not {shown(word)}. Separate numbers by blanks."
    return f"must be a number, not {shown(word)}."
