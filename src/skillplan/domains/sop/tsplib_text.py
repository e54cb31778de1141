"""TSPLIB ``.sop`` files: a header and a full matrix, or a bare matrix of numbers.

The format is that of G. Reinelt, "TSPLIB 95", section 1. What is read is a document like that
of a YAML file of kind ``sop``, so that what is wrong with the matrix has a position, too.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from skillplan.domains.sop.matrix_text import MatrixText, fault_at, position_at
from skillplan.domains.sop.schema import MOST_NODES
from skillplan.errors import Issue, TaskError, name_hint, nearest
from skillplan.files.schema_errors import shown
from skillplan.files.yaml import Document, Path_, Position

SECTION = "EDGE_WEIGHT_SECTION"

# Keywords with the only value that a full matrix with precedence may give them.
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
    """A TSPLIB file's content; entries of its matrix are found where they stand in the text."""

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
    text
        The file's content.
    source
        The file as the user named it; the task is called after it where it names itself not.

    Raises
    ------
    TaskError
        If it is no such file; every fault has its line and column, what is wrong and what to
        write instead.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    odd = _UNPRINTABLE.search(text)
    if odd is not None:
        message = f"character U+{ord(odd[0]):04X} is not allowed in a .sop file. Remove it."
        raise TaskError(source, [fault_at(text, odd.start(), message)])
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
    data = {"kind": "sop", "name": _name(header.values.get("NAME", ""), source), "costs": rows}
    if header.comments:
        data["description"] = " ".join(header.comments)
    values: dict[Path_, Position] = {(): (1, 1), ("costs",): position_at(text, matrix.first)}
    if "NAME" in header.places:
        values["name",] = position_at(text, header.places["NAME"])
    return TsplibDocument(source, data, values, {}, matrix=matrix)


class _Header:
    """What stands before the numbers; nothing in a file that is a bare matrix."""

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
        """Note what is wrong at an offset; return that reading need not go on."""
        self.issues.append(fault_at(self.text, place, message))
        return False

    def _read(self) -> bool:
        """Take the lines in up to the section; return whether it is worth checking them."""
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
        # What is cut off in the middle of a word is no unknown keyword.
        last = fault_at(self.text, max(len(self.text.rstrip()) - 1, 0), "")
        self.issues = [issue for issue in self.issues if issue.line != last.line]
        message = f"the file ends before {SECTION}. Write it, and the matrix."
        self.issues.append(Issue(message, (), last.line, last.column))
        return False

    def _take(self, key: str, written: str, value: str | None, place: int) -> None:
        """Take one line in."""
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
        """Hold the values against what can be read, and note what is missing."""
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


def _name(written: str, source: str) -> str:
    """Return the name that a file gives itself, or else its own; odd characters become '_'."""
    for text in (written, Path(source).name):
        stem = text[: -len(".sop")] if text.lower().endswith(".sop") else text
        name = _UNNAMED.sub("_", stem).lstrip("_.+-")[:64]
        if name:
            return name
    return "unnamed"
