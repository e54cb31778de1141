"""TSPLIB ``.sop`` files: a header and a full matrix, or a bare matrix of numbers.

The format is that of G. Reinelt, "TSPLIB 95", section 1. The result is a document like that of a
YAML file of kind ``sop``, with positions for faults of the matrix.
"""

from __future__ import annotations

import re
from array import array
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from math import isqrt
from pathlib import Path

from skillplan.domains.sop.problem import MOST_COST, MOST_NODES
from skillplan.errors import Issue, TaskError, name_hint, nearest
from skillplan.files.schema_errors import shown
from skillplan.files.yaml import Document, Path_, Position

_TOKEN = re.compile(r"\S+")
_END = re.compile(r"(?<!\S)EOF(?!\S)")
_PLAIN = re.compile(r"[-+0-9\s]*")
_WHOLE = re.compile(r"[-+]?[0-9]+")
_DECIMAL = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")

# Longer than any valid number and short enough to convert at once.
_MOST_DIGITS = 20
# Greatest number of invalid tokens listed.
_MOST_LISTED = 5


class MatrixText:
    """The numbers of a square matrix in a text, up to ``EOF``."""

    def __init__(self, text: str, start: int) -> None:
        end = _END.search(text, start)
        self.text = text
        self.start = start
        self.end = len(text) if end is None else end.start()
        self._skipped = 0

    def rows(self, dimension: int | None) -> tuple[list[list[int]], list[Issue]]:
        """Return the matrix and its faults; the matrix is empty if there are faults.

        Parameters
        ----------
        dimension
            Number of rows and columns, >= 2; None to derive it from the numbers.
        """
        after = _TOKEN.search(self.text, self.end + len("EOF"))
        faults = []
        if after is not None:
            message = f"nothing may follow EOF, but {shown(after[0])} does. Remove it."
            faults.append(build_issue(self.text, after.start(), message))
        numbers, unread = self._numbers()
        faults += unread
        if unread:
            return [], faults
        n, skipped = self._shape(numbers, dimension)
        if n == 0:
            faults.append(self._count_fault(numbers, dimension))
        elif n > MOST_NODES:
            message = f"the matrix is {n} x {n}; at most {MOST_NODES} nodes can be ordered."
            faults.append(build_issue(self.text, self._offset(0), message))
        if faults:
            return [], faults
        self._skipped = skipped
        return [numbers[first : first + n] for first in range(skipped, skipped + n * n, n)], []

    @property
    def first(self) -> int:
        """Offset of the first number, without leading blanks."""
        token = _TOKEN.search(self.text, self.start, self.end)
        return self.start if token is None else token.start()

    def position(self, index: int) -> Position:
        """Return line and column, from 1, of an entry of the matrix, counted row by row."""
        return find_position(self.text, self._offset(self._skipped + index))

    @cached_property
    def _offsets(self) -> array[int]:
        tokens = _TOKEN.finditer(self.text, self.start, self.end)
        return array("L", (token.start() for token in tokens))

    def _offset(self, index: int) -> int:
        """Return the offset of a number; the end of the numbers if there are fewer."""
        return self._offsets[index] if index < len(self._offsets) else self._close

    @property
    def _close(self) -> int:
        """Offset of ``EOF``, or else of the last character that is not blank."""
        if self.end < len(self.text):
            return self.end
        return max(len(self.text.rstrip()) - 1, 0)

    def _numbers(self) -> tuple[list[int], list[Issue]]:
        """Return the numbers and the faults of invalid tokens."""
        body = self.text[self.start : self.end]
        if _PLAIN.fullmatch(body):
            try:
                return list(map(int, body.split())), []
            except ValueError:
                pass  # a lone sign or too many digits: reported below with its position
        numbers, faults = [], []
        for token in _TOKEN.finditer(self.text, self.start, self.end):
            word = token[0]
            if _WHOLE.fullmatch(word) and len(word) <= _MOST_DIGITS:
                numbers.append(int(word))
            else:
                faults.append(build_issue(self.text, token.start(), _describe_token(word)))
            if len(faults) == _MOST_LISTED:
                break
        return numbers, faults

    @cached_property
    def _counts(self) -> list[int]:
        """Number of numbers in each line with any."""
        lines = self.text[self.start : self.end].split("\n")
        return [count for count in (len(line.split()) for line in lines) if count]

    def _led(self, numbers: list[int], n: int) -> bool:
        """Return True if the first number is the dimension, so that one entry is missing.

        It is if it stands alone in its line while others do not, or equals n.
        """
        alone = self._counts[0] == 1 and max(self._counts) > 1
        return (alone and numbers[0] > 1) or (numbers[0] == n and self._counts[0] != n)

    def _shape(self, numbers: list[int], dimension: int | None) -> tuple[int, int]:
        """Return the number of rows and of numbers before them; 0 rows if no shape fits."""
        count = len(numbers)
        n = isqrt(count) if dimension is None else dimension
        if count and count == n * n:
            return (0, 0) if self._led(numbers, n) else (n, 0)
        if dimension is None and count > 1:
            n = isqrt(count - 1)
        return (n, 1) if count == n * n + 1 and numbers[0] == n else (0, 0)

    def _count_fault(self, numbers: list[int], dimension: int | None) -> Issue:
        """Return the fault of the number of entries at its most telling position."""
        counts = self._counts
        count = len(numbers)
        alone = counts[:1] == [1] and len(counts) > 1 and numbers[0] > 1
        if alone and dimension not in (None, numbers[0]):
            message = f"this says {numbers[0]} nodes, but DIMENSION says {dimension}."
            return build_issue(self.text, self._offset(0), f"{message} Make them agree.")
        n = dimension
        if n is None and (alone or numbers[0] ** 2 == count):
            n = numbers[0]
        led = alone or (n is not None and numbers[:1] == [n] and count in (n * n, n * n + 1))
        if alone:
            counts = counts[1:]
        count -= led
        if not count:
            return build_issue(self.text, self._close, f"the {n} x {n} numbers are missing.")
        usual, often = Counter(counts).most_common(1)[0]
        width = usual if n is None else n
        odd = next((i for i, number in enumerate(counts) if number != width), None)
        if n is None:
            message = f"{count} numbers make no square matrix."
        else:
            message = f"there are {count} numbers instead of {n * n}, {n} x {n}."
        if width == usual and 2 * often >= len(counts) > 1 and odd is not None:
            message += f" This line has {counts[odd]} where {width} are needed."
            return build_issue(self.text, self._offset(sum(counts[:odd]) + alone), message)
        if n is None:
            if often == len(counts) > 1:
                message += f" There are {often} lines of {usual}."
            return build_issue(self.text, self._offset(0), message)
        if count < n * n:
            return build_issue(self.text, self._close, f"{message} The rest is missing.")
        surplus = self._offset(n * n + led)
        return build_issue(self.text, surplus, f"{message} Here is the first too many.")


def build_issue(text: str, offset: int, message: str) -> Issue:
    """Return an issue at an offset of a text."""
    return Issue(message, (), *find_position(text, offset))


def find_position(text: str, offset: int) -> Position:
    """Return line and column of an offset, both from 1."""
    return text.count("\n", 0, offset) + 1, offset - text.rfind("\n", 0, offset)


def _describe_token(word: str) -> str:
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


SECTION = "EDGE_WEIGHT_SECTION"

# Keywords with the only value that a full matrix with precedence allows.
_FIXED = {"TYPE": "SOP", "EDGE_WEIGHT_TYPE": "EXPLICIT", "EDGE_WEIGHT_FORMAT": "FULL_MATRIX"}
_KEYWORDS = ("NAME", "COMMENT", "DIMENSION", *_FIXED, "DISPLAY_DATA_TYPE")
_WORDS = (*_KEYWORDS, SECTION, "EOF")
_INSTEAD = {
    "TYPE": "A task is a path on which some nodes come before others, by entries -1",
    "EDGE_WEIGHT_TYPE": "Write the costs out as numbers",
    "EDGE_WEIGHT_FORMAT": "Write every row out in full",
}
_LINE = re.compile(r"[^\n]*")
_ENTRY = re.compile(r"\s*([A-Za-z][A-Za-z0-9_]*)\s*(?::\s*(.*?))?\s*")
_COUNT = re.compile(r"[0-9]{1,9}")
_NUMBER = re.compile(r"\s*[-+.]?[0-9]")
_UNPRINTABLE = re.compile("[\x00-\x08\x0e-\x1f\x7f]")
_UNNAMED = re.compile(r"[^A-Za-z0-9_.+-]+")


@dataclass(frozen=True)
class TsplibDocument(Document):
    """A TSPLIB file's content, which locates matrix entries in the text."""

    matrix: MatrixText | None = None

    def locate(self, issue: Issue) -> Issue:
        """Return the issue with the position of its row or entry, or of the nearest key."""
        key, *entry = issue.path or ("",)
        given = any(issue.path[: len(path)] == path for path in self.given)
        if self.matrix is None or key != "costs" or not entry or given:
            return super().locate(issue)
        row, column = (int(index) for index in (*entry, 0)[:2])
        line, place = self.matrix.position(row * len(self.data["costs"]) + column)
        return Issue(issue.message, issue.path, line, place, issue.at_key)


def read_tsplib(text: str, source: str) -> Document:
    """Return the content of a ``.sop`` file, with the keys of `SopConfig`.

    Parameters
    ----------
    source
        Path as the user gave it, and default for the name of the task.

    Raises
    ------
    TaskError
        With every fault: position, problem and remedy.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    odd = _UNPRINTABLE.search(text)
    if odd is not None:
        message = f"character U+{ord(odd[0]):04X} is not allowed in a .sop file. Remove it."
        raise TaskError(source, [build_issue(text, odd.start(), message)])
    if not text.strip():
        message = f"is empty. Give a TSPLIB header and {SECTION}, or a square matrix."
        raise TaskError(source, [Issue(message, (), 1, 1)])
    header = _Header(text)
    faults = header.issues
    matrix = MatrixText(text, header.end)
    rows: list[list[int]] = []
    if not faults:
        rows, faults = matrix.rows(header.dimension)
    if faults:
        raise TaskError(source, faults)
    data = {
        "kind": "sop",
        "name": _choose_name(header.values.get("NAME", ""), source),
        "costs": rows,
    }
    if header.comments:
        data["description"] = " ".join(header.comments)
    values: dict[Path_, Position] = {(): (1, 1), ("costs",): find_position(text, matrix.first)}
    if "NAME" in header.places:
        values["name",] = find_position(text, header.places["NAME"])
    return TsplibDocument(source, data, values, {}, matrix=matrix)


class _Header:
    """Header before the numbers; empty for a bare matrix."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.issues: list[Issue] = []
        self.values: dict[str, str] = {}
        self.places: dict[str, int] = {}
        self.comments: list[str] = []
        self.dimension: int | None = None
        self.end = 0
        if not _NUMBER.match(text) and self._read():
            self._check()

    def fault(self, place: int, message: str) -> bool:
        """Add a fault at an offset and return False, which ends the reading."""
        self.issues.append(build_issue(self.text, place, message))
        return False

    def _read(self) -> bool:
        """Parse the lines up to the section; return whether its values can be checked."""
        while self.end < len(self.text):
            line = _LINE.match(self.text, self.end)
            assert line is not None
            place, self.end = line.end() - len(line[0].lstrip()), line.end() + 1
            if not line[0].strip():
                continue
            entry = _ENTRY.fullmatch(line[0])
            key = "" if entry is None else entry[1].upper()
            if key == SECTION and entry is not None:
                self.places[key] = place
                if entry[2]:
                    self.end = line.start() + entry.start(2)
                return True
            if key == "EOF":
                return self.fault(place, f"{SECTION} is missing. Write it, and the matrix.")
            if _NUMBER.match(line[0]):
                message = f"numbers begin, but {SECTION} does not stand above them. Write it there."
                return self.fault(place, message)
            if entry is None:
                known = f"'KEYWORD: value', {SECTION} or a number"
                return self.fault(place, f"must be {known}, not {shown(line[0].strip())}.")
            if key == "KIND":
                return self.fault(
                    place, "this is YAML, it seems. Let the file's name end in .yaml."
                )
            self._take(key, entry[1], entry[2], place)
            if key not in _KEYWORDS and nearest(key, _WORDS) == SECTION:
                return True
        # A keyword cut off at the end of the file is not an unknown keyword.
        last = build_issue(self.text, max(len(self.text.rstrip()) - 1, 0), "")
        self.issues = [issue for issue in self.issues if issue.line != last.line]
        message = f"the file ends before {SECTION}. Write it, and the matrix."
        self.issues.append(Issue(message, (), last.line, last.column))
        return False

    def _take(self, key: str, written: str, value: str | None, place: int) -> None:
        """Parse one line."""
        if key not in _KEYWORDS:
            hint = name_hint(key, _WORDS)
            self.fault(place, f"unknown keyword {shown(written)}. {hint}")
        elif value is None:
            meant = _FIXED.get(key, "...")
            self.fault(place, f"{key} has no value. Write '{key}: {meant}'.")
        elif key == "COMMENT":
            self.comments += [value] if value else []
        elif key in self.values:
            self.fault(place, f"{key} stands twice. Keep one.")
        else:
            self.values[key], self.places[key] = value, place

    def _check(self) -> None:
        """Check the values, and add faults of missing ones."""
        for key, only in _FIXED.items():
            value = self.values.get(key, only)
            if value.upper() != only:
                message = f"{key} must be {only}, not {shown(value)}. {_INSTEAD[key]}."
                self.fault(self.places[key], message)
        dimension = self.values.get("DIMENSION")
        if dimension is None:
            if not any("DIMENSION" in issue.message for issue in self.issues):
                message = "DIMENSION is missing. Write 'DIMENSION: ' and the number of nodes."
                self.fault(self.places.get(SECTION, 0), message)
        elif _COUNT.fullmatch(dimension) and 2 <= int(dimension) <= MOST_NODES:
            self.dimension = int(dimension)
        else:
            message = f"must be a whole number from 2 to {MOST_NODES}, not {shown(dimension)}."
            self.fault(self.places["DIMENSION"], f"DIMENSION {message}")


def _choose_name(written: str, source: str) -> str:
    """Return the name in the file, or else that of the file; odd characters become '_'."""
    for text in (written, Path(source).name):
        stem = text[: -len(".sop")] if text.lower().endswith(".sop") else text
        name = _UNNAMED.sub("_", stem).lstrip("_.+-")[:64]
        if name:
            return name
    return "unnamed"
