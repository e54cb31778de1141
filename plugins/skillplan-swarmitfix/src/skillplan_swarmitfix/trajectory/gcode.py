"""The tool trajectory of a G-code program: its feed moves in the XY plane.

Rapid moves (G0) place the tool and do not belong to the trajectory; neither does motion along Z.
A program is in the unit of the task file, by default millimetres (G21), and absolute (G90)
until it changes this, and the centres of
its arcs are given from their start (G91.1). What could lead the tool elsewhere and is not read
here (tool compensation, other planes, offsets, canned cycles, subprograms) is refused, not passed
over. Words have their meaning in RS274/NGC (T. R. Kramer, F. M. Proctor, E. Messina,
"The NIST RS274NGC Interpreter - Version 3", NISTIR 6556, 2000).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from skillplan_swarmitfix.trajectory.path import (
    JOIN_M,
    TrajectoryFileError,
    TrajectoryPath,
    one_line,
)
from skillplan_swarmitfix.trajectory.path_elements import Element, Line, arc_or_line
from skillplan_swarmitfix.trajectory.plane_point import (
    MAX_COORDINATE_M,
    SAME_POINT_M,
    Point2,
    shown,
)
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, UNITS_M, UnitName

_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))", re.ASCII)
_BLANK = re.compile(r"\([^()]*\)|;.*|\s")
_LINE_END = re.compile(r"\r\n|\r|\n")
_MOTIONS = ("0", "1", "2", "3")
_HARMLESS_G = frozenset(("4", "17", "40", "43", "49", "54", "61", "64", "80", "91.1", "94", "98"))
_OF_THE_MACHINE = frozenset(("28", "30", "53"))
_HARMLESS_M = frozenset(("0", "1", "3", "4", "5", "6", "7", "8", "9"))
_END_M = frozenset(("2", "30"))
_PLACING = "XYIJR"
_HARMLESS_WORDS = "FSTHNOPZ"


def gcode_trajectory(path: Path, text: str, unit: UnitName | None = None) -> TrajectoryPath:
    """Return the trajectory of a program.

    The first position that is given in full is where the tool is; the trajectory starts where
    the first feed move (G1, G2, G3) does.

    Parameters
    ----------
    path
        The program's file, for messages.
    text
        The program.
    unit
        Unit of its lengths until G20 or G21; None for millimetres.

    Raises
    ------
    TrajectoryFileError
        With the line that cannot be read or placed, or if the program has no feed move.
    """
    machine = _Machine(path, unit)
    for number, line in enumerate(_LINE_END.split(text), 1):
        machine.place = f"line {number}"
        machine.run(line)
        if machine.ended:
            break
    if not machine.elements:
        raise TrajectoryFileError(
            path, "The program has no feed move in X or Y; give the trajectory by G1, G2 and G3."
        )
    trajectory = TrajectoryPath.ended(machine.start, machine.elements, machine.places)
    return replace(trajectory, unit_assumed=unit is None and not machine.unit_said)


class _Machine:
    """State of a program after the lines read so far."""

    def __init__(self, path: Path, unit: UnitName | None) -> None:
        self.path = path
        self.place = ""
        self.ended = False
        self.start: Point2 = (0.0, 0.0)
        self.elements: list[Element] = []
        self.places: list[str] = []
        self.unit_said = False
        self._unit_m = UNITS_M[unit or DEFAULT_UNIT]
        self._absolute = True
        self._motion: str | None = None
        self._at: dict[str, float] = {}

    def run(self, line: str) -> None:
        """Execute one line."""
        words, gs, ms = self._words(line)
        placed = any(letter in words for letter in _PLACING)
        for g in gs:
            if g in ("20", "21"):
                self._unit_m = UNITS_M["in" if g == "20" else "mm"]
                self.unit_said = True
            elif g in ("90", "91"):
                self._absolute = g == "90"
            elif g in _OF_THE_MACHINE and "Z" in words and not placed:
                continue
            elif g not in _MOTIONS and g not in _HARMLESS_G:
                self._refuse(
                    f"G{g} is not read here, for it may lead the tool elsewhere; write the "
                    "trajectory by G0, G1, G2, G3 with G17, G20 or G21, G90 or G91."
                )
        motions = [g for g in gs if g in _MOTIONS]
        if len(motions) > 1:
            self._refuse(f"G{motions[0]} and G{motions[1]} in one line; write two lines.")
        self._motion = motions[0] if motions else self._motion
        for m in ms:
            if m not in _HARMLESS_M and m not in _END_M:
                self._refuse(f"M{m} is not read here; leave it out.")
        if placed:
            if "4" in gs:
                self._refuse("G4 with a position; give a dwell as P, in a line of its own.")
            self._move(words)
        self.ended = not _END_M.isdisjoint(ms)

    def _words(self, line: str) -> tuple[dict[str, float], list[str], list[str]]:
        """Return the values of a line's words, and its G and M codes."""
        code = _BLANK.sub("", line).upper()
        if code.startswith("%"):
            code = ""
        words: dict[str, float] = {}
        codes: dict[str, list[str]] = {"G": [], "M": []}
        position = 0
        while position < len(code):
            match = _WORD.match(code, position)
            if match is None:
                self._refuse(
                    f"Cannot read {one_line(code[position:], 20)!r}; "
                    "write words of a letter and a number, such as X12.5."
                )
            letter, number = match.groups()
            position = match.end()
            if letter in codes:
                codes[letter].append(f"{float(number):g}")
            elif letter not in _PLACING and letter not in _HARMLESS_WORDS:
                self._refuse(f"The word {match[0]} is not read here; leave it out.")
            elif letter in words:
                self._refuse(f"{letter} twice in one line; write two lines.")
            else:
                words[letter] = float(number)
        return words, codes["G"], codes["M"]

    def _move(self, words: Mapping[str, float]) -> None:
        if self._motion is None:
            self._refuse("A position before any of G0, G1, G2, G3; give the motion first.")
        curved = self._motion in ("2", "3")
        if not curved and any(letter in words for letter in "IJR"):
            self._refuse(f"I, J and R belong to an arc, but the motion is G{self._motion}.")
        before = self._position()
        target = dict(self._at)
        for letter in "XY":
            if letter in words:
                value = words[letter] * self._unit_m
                if not self._absolute:
                    if letter not in self._at:
                        self._refuse("G91 before a first position; give that one in G90.")
                    value += self._at[letter]
                if not abs(value) <= MAX_COORDINATE_M:
                    self._refuse(f"{letter} is beyond {MAX_COORDINATE_M:g} m, which no bench is.")
                target[letter] = value
        self._at = target
        after = self._position()
        if before is None or after is None:
            if curved or (self._motion == "1" and after is None):
                self._refuse("A feed move from an unknown position; first give both X and Y by G0.")
            return
        if self._motion == "0":
            return
        moved = math.dist(before, after) > SAME_POINT_M
        if not curved:
            # A plunge names the position it is at; a line of no length is left to be reported.
            if moved or "Z" not in words:
                self._feed(before, [Line(after)])
        else:
            centre = self._centre(before, after, words)
            self._feed(before, _arcs(before, after, centre, clockwise=self._motion == "2"))

    def _position(self) -> Point2 | None:
        return (self._at["X"], self._at["Y"]) if len(self._at) == 2 else None

    def _feed(self, start: Point2, elements: list[Element]) -> None:
        if not self.elements:
            self.start = start
        elif math.dist(self.elements[-1].end, start) > JOIN_M:
            self._refuse(
                f"A second trajectory starts here, at {shown(start)}; the first ended in "
                f"{self.places[-1]}. Keep one in a file."
            )
        self.elements += elements
        self.places += [self.place] * len(elements)

    def _centre(self, start: Point2, end: Point2, words: Mapping[str, float]) -> Point2:
        """Return the centre of an arc, by I and J or by R."""
        if "R" not in words:
            if "I" not in words and "J" not in words:
                self._refuse("An arc without a centre; give it as I and J, or a radius as R.")
            x = start[0] + words.get("I", 0.0) * self._unit_m
            y = start[1] + words.get("J", 0.0) * self._unit_m
            radii = math.dist((x, y), start), math.dist((x, y), end)
            if not SAME_POINT_M < radii[0] <= MAX_COORDINATE_M:
                self._refuse(f"An arc of radius {radii[0]:g} m; give its centre as I and J.")
            if abs(radii[0] - radii[1]) > max(JOIN_M, 1e-3 * radii[0]):
                self._refuse(
                    f"The arc's centre is {radii[0]:.9g} m from its start but {radii[1]:.9g} m "
                    "from its end; mend I and J, which count from the start."
                )
            return (x, y)
        if "I" in words or "J" in words:
            self._refuse("An arc with a centre and a radius; give I and J, or R.")
        radius, chord = words["R"] * self._unit_m, math.dist(start, end)
        if not SAME_POINT_M < chord <= 2 * abs(radius) + JOIN_M or abs(radius) > MAX_COORDINATE_M:
            self._refuse(
                f"No arc of radius {abs(radius):.9g} m joins points {chord:.9g} m apart; "
                "correct R, and write a full circle with I and J."
            )
        height = math.sqrt(max(0.0, radius * radius - chord * chord / 4))
        # The centre of a short arc (R > 0) lies on the side to which the arc turns.
        side = height if (self._motion == "3") == (radius > 0) else -height
        dx, dy = (end[0] - start[0]) / chord, (end[1] - start[1]) / chord
        return (
            (start[0] + end[0]) / 2 - side * dy,
            (start[1] + end[1]) / 2 + side * dx,
        )

    def _refuse(self, message: str) -> NoReturn:
        raise TrajectoryFileError(self.path, message, self.place)


def _arcs(start: Point2, end: Point2, centre: Point2, *, clockwise: bool) -> list[Element]:
    """Return an arc about a centre; a full circle, which ends where it starts, as two halves."""
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    last = math.atan2(end[1] - centre[1], end[0] - centre[0])
    radius_m = (math.dist(centre, start) + math.dist(centre, end)) / 2

    def at(angle: float) -> Point2:
        return (centre[0] + radius_m * math.cos(angle), centre[1] + radius_m * math.sin(angle))

    if math.dist(start, end) <= SAME_POINT_M:
        quarter = -math.pi / 2 if clockwise else math.pi / 2
        half = at(first + 2 * quarter)
        return [
            arc_or_line(start, half, at(first + quarter)),
            arc_or_line(half, end, at(first + 3 * quarter)),
        ]
    sweep = -((first - last) % math.tau) if clockwise else (last - first) % math.tau
    return [arc_or_line(start, end, at(first + sweep / 2))]
