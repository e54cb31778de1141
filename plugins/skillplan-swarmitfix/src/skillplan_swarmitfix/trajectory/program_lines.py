"""The lines of a program in the order in which a controller runs them, in words of RS274/NGC.

Subprograms of the same file are followed: M98 and M97 (Fanuc, Haas), ``O100 call`` (LinuxCNC),
names (Siemens) and ``CALL LBL`` (Heidenhain).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, NoReturn

from skillplan_swarmitfix.trajectory.dialects import Heidenhain, Machine, Siemens
from skillplan_swarmitfix.trajectory.path import TrajectoryFileError, one_line

MOST_LINES = 1_000_000
"""Most lines that a program runs, its subprograms included."""
MOST_NESTED = 10
"""Subprograms call one another so deep."""

Dialect = Literal["rs274", "siemens", "heidenhain"]

_LINE_END = re.compile(r"\r\n|\r|\n")
_BRACKET = re.compile(r"[()]")
_BLANK = re.compile(r"\s")
CORNER = re.compile(r"(RND|CHR)(\d+\.?\d*|\.\d+)")
"""A line that rounds off (radius) or cuts off (legs) the corner between two moves; not of RS274."""
_COMMA = re.compile(r",([RC])(\d+\.?\d*|\.\d+)$")
_CALL = re.compile(r"M0*9([78])(?!\d)")
_END = re.compile(r"M0*99(?!\d)")
_LABEL = re.compile(r"[O:]0*(\d+)$")
_NAMED = re.compile(r"O(<[^>]*>|\d+)(SUB|ENDSUB|CALL|RETURN)(.*)$")
_IS_SIEMENS = re.compile(
    r"^%_N_|^;\s*%_N_|\bCR ?=|\bMSG$|\bCYCLE\d|\bWORKPIECE|\b[XYZIJ] ?=|\bMCALL|\bT ?=\"",
    re.MULTILINE,
)
_IS_HEIDENHAIN = re.compile(r"(?:N?\d+\s+)?BEGIN\s+PGM\b")
_SIEMENS_HEAD = re.compile(r";?\s*%_N_(\w+?)_(MPF|SPF)")


class ProgramLines:
    """A program's lines, in the order in which they run.

    Parameters
    ----------
    path
        The program's file, for messages and for its suffix.
    text
        The program.
    machine
        Runs each line before the next one is asked for.
    """

    def __init__(self, path: Path, text: str, machine: Machine) -> None:
        self._path = path
        self._machine = machine
        self._lines = _LINE_END.split(text)
        self.dialect = _dialect(path, self._lines)
        self._codes = [_clean(line, self.dialect) for line in self._lines]
        self._labels = self._find_labels()
        self._called = {match[1] for code in self._codes for match in [self._call(code)] if match}
        self._place = ""
        self._left = MOST_LINES
        self._run = [False] * len(self._lines)
        self._translate: Callable[[str, str], list[str]] | None = None
        if self.dialect != "rs274":
            arguments = machine, self._refuse
            is_siemens = self.dialect == "siemens"
            self._translate = (Siemens(*arguments) if is_siemens else Heidenhain(*arguments)).lines

    def __len__(self) -> int:
        return len(self._lines)

    def run(self) -> Iterator[tuple[int, str]]:
        """Yield the number of each line, and its code; the machine has its place for messages.

        Raises
        ------
        TrajectoryFileError
            With the line that only the controller can compute.
        """
        yield from self._section(0, len(self._codes), "", 0)

    def list_notes(self) -> list[str]:
        """Return the programs in the file that nothing calls, as a note."""
        idle = [
            f"{name} (line {begin})"
            for name, begin in self._labels.items()
            if begin < len(self._run) and not self._run[begin] and not name.startswith("N")
        ]
        return [f"passed over: {', '.join(idle[:8])}, which nothing calls"] if idle else []

    def _find_labels(self) -> dict[str, int]:
        """Return the number of the first line of every subprogram, by its name."""
        labels: dict[str, int] = {}
        for i, (line, code) in enumerate(zip(self._lines, self._codes, strict=True)):
            name = ""
            if self.dialect == "heidenhain":
                if code.startswith("LBL ") and code != "LBL 0":
                    name = code.strip()
            elif self.dialect == "siemens":
                head = _SIEMENS_HEAD.match(line.upper().strip())
                name = head[1] if head else ""
            elif match := _NAMED.match(code):
                name = f"O{match[1]}" if match[2] == "SUB" else ""
            elif match := _LABEL.match(code):
                name = f"O{match[1]}"
            elif match := re.match(r"N0*(\d+)", code):
                labels.setdefault(f"N{match[1]}", i)
            if name:
                labels.setdefault(name, i + 1)
        if self.dialect == "siemens" and labels and min(labels.values()) == 1:
            del labels[next(iter(labels))]
        return labels

    def _call(self, code: str) -> tuple[str, str, int] | None:
        """Return the rest of a line that calls a subprogram, its name, and how often it runs."""
        if self.dialect == "heidenhain":
            match = re.match(r"CALL LBL\s+(\S+)", code)
            return ("", f"LBL {match[1]}", 1) if match else None
        if self.dialect == "siemens":
            match = re.match(
                r"(?:N\d+\s*)?(?:CALL\s*\")?([A-Z_]\w+)\"?(?:\s+P\s*=?\s*(\d+))?\s*$", code
            )
            known = match is not None and (match[1] in self._labels)
            return ("", match[1], int(match[2] or 1)) if match and known else None
        named = _NAMED.match(code)
        if named and named[2] == "CALL":
            if named[3]:
                self._refuse(
                    f"{one_line(code, 30)!r} passes values, which the controller computes."
                )
            return "", f"O{named[1]}", 1
        match = _CALL.search(code)
        if match is None:
            return None
        words = dict(re.findall(r"([PLQ])(\d+)", code))
        if "P" not in words or "Q" in words:
            return code, "", 1
        number, times = words["P"], int(words.get("L", 1))
        letter = "O" if match[1] == "8" else "N"
        if letter == "O" and len(number) > 4 and f"O{int(number)}" not in self._labels:
            # P0032000 is O2000 three times.
            number, times = number[-4:], int(number[:-4])
        rest = re.sub(r"[PL]\d+", "", _CALL.sub("", code))
        return rest, f"{letter}{int(number)}", times

    def _section(self, begin: int, end: int, called: str, depth: int) -> Iterator[tuple[int, str]]:
        i = begin
        while i < end:
            code = self._codes[i]
            number = i + 1
            self._machine.place = self._place = f"line {number}{called}"
            self._run[i] = True
            self._left -= 1
            if self._left < 0:
                self._refuse(f"It runs more than {MOST_LINES:,} lines; write a shorter program.")
            i += 1
            named = _NAMED.match(code) if self.dialect == "rs274" else None
            if named and named[2] == "SUB":
                i = self._after_end_of(named[1], i)
                continue
            if self._ends(code, depth, i):
                return
            call = self._call(code)
            if call is None:
                for line in self._rs274(code, self._lines[i - 1]):
                    yield number, line
                continue
            rest, name, times = call
            if rest:
                yield number, rest
            repeated = self.dialect == "heidenhain" and re.search(r"\bREP\s*(\d+)", code)
            if name not in self._labels:
                self._refuse(
                    f"It calls {name or 'a subprogram'}, which is not in this file; put it after "
                    "the end of the main program."
                )
            if depth == MOST_NESTED:
                self._refuse(f"Subprograms are nested more than {MOST_NESTED} deep.")
            first = self._labels[name]
            last = i - 1 if repeated else len(self._codes)
            for _ in range(int(repeated[1]) if repeated else times):
                inner = f", called in line {number}" if not repeated else called
                yield from self._section(first, last, inner, depth + 1)
            self._machine.place = self._place = f"line {number}{called}"

    def _rs274(self, code: str, line: str) -> list[str]:
        if self._translate:
            return self._translate(code, line)
        comma = _COMMA.search(code)
        if comma is None:
            return [code]
        kind = "RND" if comma[1] == "R" else "CHR"
        return [code[: comma.start()], f"{kind}{comma[2]}"]

    def _ends(self, code: str, depth: int, number: int) -> bool:
        """Return whether a program or subprogram ends before this line."""
        if self.dialect == "heidenhain":
            return depth > 0 and code == "LBL 0"
        if self.dialect == "siemens":
            is_head = _SIEMENS_HEAD.match(self._lines[number - 1].upper().strip()) and number > 1
            return bool(is_head) or bool(re.search(r"\b(?:M17|RET)\b", code))
        named = _NAMED.match(code)
        if named:
            return named[2] in ("ENDSUB", "RETURN")
        label = _LABEL.match(code)
        if label and (depth or f"O{label[1]}" in self._called):
            return True
        if _END.search(code) and "P" in code:
            self._refuse("M99 with P goes on elsewhere; write the moves out.")
        return bool(_END.search(code))

    def _after_end_of(self, name: str, i: int) -> int:
        while i < len(self._codes):
            match = _NAMED.match(self._codes[i])
            i += 1
            if match and match[1] == name and match[2] == "ENDSUB":
                break
        return i

    def _refuse(self, message: str) -> NoReturn:
        raise TrajectoryFileError(self._path, message, self._place)


def _dialect(path: Path, lines: list[str]) -> Dialect:
    text = [line.strip().upper() for line in lines]
    first = next((line for line in text if line), "")
    if any(_IS_HEIDENHAIN.match(line) for line in [first, *text]):
        return "heidenhain"
    if path.suffix.lower() in (".mpf", ".spf"):
        return "siemens"
    code = "\n".join(_without_comments(line).partition(";")[0].rstrip() for line in text)
    return "siemens" if _IS_SIEMENS.search(code) or _SIEMENS_HEAD.match(first) else "rs274"


def _clean(line: str, dialect: Dialect) -> str:
    """Return a line in capitals, without comments, and in RS274 without blanks."""
    if dialect == "rs274":
        return _BLANK.sub("", _without_comments(line).partition(";")[0]).upper()
    line = line.upper().partition(";")[0].strip()
    if dialect == "siemens":
        return "" if line.startswith(("%", "$PATH")) else line
    line = "" if line.startswith("(") else line
    return " ".join(
        re.sub(r"^N?\d+(?:\s+|$)", "", line).replace(",", ".").removesuffix("~").split()
    )


def _without_comments(line: str) -> str:
    """Return a line without text in brackets, which may be nested, or open up to the line's end."""
    if "(" not in line:
        return line
    kept, depth, begin = [], 0, 0
    for match in _BRACKET.finditer(line):
        if match[0] == "(":
            if depth == 0:
                kept.append(line[begin : match.start()])
            depth += 1
        elif depth:
            depth -= 1
            begin = match.end()
    return "".join(kept) + ("" if depth else line[begin:])
