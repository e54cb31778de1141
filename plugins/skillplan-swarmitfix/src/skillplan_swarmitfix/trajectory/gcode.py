"""The contours of a G-code program: its feed moves in the XY plane.

Rapid moves (G0) place the tool and do not belong to a contour. Neither do motion along Z, feed
moves above the cut, and holes drilled by canned cycles, which are listed. A program is in the unit
of the task file, by default millimetres (G21), and absolute (G90) until it changes this, and the
centres of its arcs count from their start (G91.1). Codes that may lead the tool elsewhere and are
not followed here (rotation, scaling, subprograms, parameters) are refused; other codes without
motion are passed over with a note. Words have their meaning in RS274/NGC (T. R. Kramer, F. M.
Proctor, E. Messina, "The NIST RS274NGC Interpreter - Version 3", NISTIR 6556, 2000), and in
LinuxCNC's description.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from skillplan_swarmitfix.trajectory.contours import FileContours
from skillplan_swarmitfix.trajectory.path import (
    JOIN_M,
    Progress,
    TrajectoryFileError,
    count,
    merged_note,
    millimetres,
    one_line,
)
from skillplan_swarmitfix.trajectory.path_elements import (
    MAX_COORDINATE_M,
    SAME_POINT_M,
    Arc,
    Line,
    Point2,
    arc_or_line,
    end_directions,
)
from skillplan_swarmitfix.trajectory.program_lines import CORNER, ProgramLines
from skillplan_swarmitfix.trajectory.tool_path import Feed, find_contours
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, UNITS_M, UnitName

MOST_FEEDS = 100_000
"""Most feed moves, and most drilled holes, of a program."""

_WORD = re.compile(r"([A-Z])([~^]?)([+-]?(?:\d+\.?\d*|\.\d+))", re.ASCII)
_HOMING = re.compile(r"(G0*(?:28|30)(?:\.1)?(?![.\d]).*)", re.ASCII)
_BARE_AXIS = re.compile(r"([XYZ])(?![-+.\d])", re.ASCII)
_MESSAGE = re.compile(r"M11[78](?!\d).*", re.ASCII)
_FLOW = re.compile(r"O(?:<[^>]*>|\d+)(?:SUB|END|CALL|IF|ELSE|DO|WHILE|REPEAT|RETURN|BREAK|CONT)")
_MOTIONS = ("0", "1", "2", "3")
_USUAL_G = frozenset(("4", "40", "43", "49", "54", "61", "64", "80", "94", "98", "99"))
_IDLE_G = frozenset(
    [
        "8",
        "9",
        "15",
        "43.1",
        "44",
        "50",
        "50.1",
        "61.1",
        "62",
        "69",
        "93",
        "95",
        "96",
        "97",
        "187",
        "28.1",
        "30.1",
        "92.2",
        "92.3",
        "60",
        "450",
        "451",
        "601",
        "602",
        "603",
        "641",
        "642",
        "643",
        "644",
        "645",
    ]
)
_CYCLES = frozenset(["73", "74", "81", "82", "83", "84", "85", "86", "87", "88", "89"])
_UNITS_G: Mapping[str, UnitName] = {
    **dict.fromkeys(("20", "70", "700"), "in"),
    **dict.fromkeys(("21", "71", "710"), "mm"),
}
"""Codes of units; G70 and G71 with P or Q are cycles of lathes."""
_ORIGINS = frozenset(
    ["54", "55", "56", "57", "58", "59", "59.1", "59.2", "59.3", *map(str, range(500, 600))]
)
_COMPENSATION = frozenset(("41", "41.1", "42", "42.1"))
_OF_THE_MACHINE = frozenset(("28", "30", "53"))
_USUAL_M = frozenset(("0", "1", "3", "4", "5", "6", "7", "8", "9"))
_END_M = frozenset(("2", "30"))
_ELSEWHERE_M = frozenset(("72", "96", "97", "98"))
_PLACING = "XYIJR"
_TURNING_AXES = "ABCUVWE"
_MOST_TURNS = 1_000
_STRAIGHT_RAD = 1e-6
_MOST_NAMED = 12
_REPORTED = 1_000


def read_program(path: Path, text: str, unit: UnitName | None = None) -> FileContours:
    """Return the contours of a program.

    The first position that is given in full is where the tool is. A program that feeds before it
    gives one starts at its zero.

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
    lines = ProgramLines(path, text, machine)
    progress = Progress(path)
    for number, code in lines.run():
        machine.run(code)
        if number % _REPORTED == 0:
            progress.report(number, len(lines), "line")
        if machine.ended:
            break
    is_unit_assumed = unit is None and not machine.unit_said
    feeds, notes = _cutting(machine)
    if is_unit_assumed:
        codes = "G70 or G71" if lines.dialect == "siemens" else "G20 or G21"
        notes.append(f"lengths are read in mm, as there is no {codes}")
    if not feeds:
        drilled = f"drills {count(len(machine.holes), 'hole')} and " if machine.holes else ""
        raise TrajectoryFileError(
            path,
            f"The program {drilled}has no feed move in X or Y; give the trajectory by G1, G2 and "
            "G3.",
        )
    contours = tuple(cut.path() for cut in find_contours(feeds, progress))
    return FileContours(
        path,
        contours,
        (*machine.list_notes(), *notes, *lines.list_notes()),
        tuple(machine.holes),
        is_unit_assumed,
    )


class _Machine:
    """State of a program after the lines read so far."""

    def __init__(self, path: Path, unit: UnitName | None) -> None:
        self.path = path
        self.place = ""
        self.ended = False
        self.feeds: list[Feed] = []
        self.has_plunged: list[bool] = []
        self.is_on: list[bool] = []
        self.rapid_heights_m: list[float] = []
        self.holes: list[Point2] = []
        self.unit_said = False
        self._unit_m = UNITS_M[unit or DEFAULT_UNIT]
        self._absolute = True
        # X~5 counts from the position and I^5 from the zero, whatever the modes are.
        self._absolute_words: dict[str, bool] = {}
        self._absolute_centres = False
        self._plane = "17"
        self._motion: str | None = None
        self._cycle = False
        self._origin = "54"
        self._origin_moved = ""
        # Coordinates of the program, and what G92 adds to them.
        self._at: dict[str, float] = {}
        self._shift: dict[str, float] = {}
        self._lost = ""
        self._entered_by_feed = False
        self._spindle = self._speed = True
        self._idle: dict[str, None] = {}
        self._repeated = 0
        self._upright = 0
        self._compensated = ""
        self._assumed_start = ""
        # Whether the next corner is rounded or cut off, and its radius or legs [m].
        self._corner: tuple[bool, float] | None = None

    def run(self, code: str) -> None:
        """Execute one line, in capitals and without comments and blanks."""
        if corner := CORNER.fullmatch(code):
            self._corner = (corner[1] == "RND", float(corner[2]) * self._unit_m)
            return
        words, gs, ms = self._words(code)
        self._set_modes(words, gs)
        self._set_tool(words, ms)
        if "10" in gs or "92" in gs or not _OF_THE_MACHINE.isdisjoint(gs):
            self._move_origin(words, gs)
        elif any(g in ("52",) for g in gs):
            if any(words.get(letter) for letter in "XYZ"):
                self._refuse("G52 moves the origin; give the coordinates without it.")
        elif self._cycle and (any(g in _CYCLES for g in gs) or "X" in words or "Y" in words):
            self._drill(words)
        elif any(letter in words for letter in "XYZIJR") and not self._cycle:
            if "4" in gs:
                self._refuse("G4 with a position; give a dwell as P, in a line of its own.")
            self._move(words)
        self.ended = not _END_M.isdisjoint(ms)

    def position(self) -> Point2 | None:
        """Return X and Y as the program writes them; None if they are unknown."""
        if self._is_lost(self._at):
            return None
        return self._at["X"] / self._unit_m, self._at["Y"] / self._unit_m

    def direction_rad(self) -> float | None:
        """Return the direction in which the last feed move ended; None before the first."""
        if not self.feeds:
            return None
        return end_directions(self.feeds[-1].start, self.feeds[-1].element)[1]

    def pass_over(self, code: str) -> None:
        """Note a code that is passed over."""
        self._idle[code] = None

    def shift_origin(self, code: str) -> None:
        """Note a code that moves the origin, which no feed move before it may have used."""
        self._idle[code] = None
        if self.feeds:
            self._origin_moved = f"{code} in {self.place}"

    def list_notes(self) -> list[str]:
        """Return everything that was assumed or passed over, a clause each."""
        notes = []
        if self._assumed_start:
            notes.append(f"{self._assumed_start}: the start is taken to be X0 Y0")
        if self._repeated:
            notes.append(merged_note(self._repeated))
        if self.holes:
            shown = ", ".join(
                f"({x * 1e3:.4g}, {y * 1e3:.4g})" for x, y in self.holes[:_MOST_NAMED]
            )
            more = ", ..." if len(self.holes) > _MOST_NAMED else ""
            notes.append(f"{count(len(self.holes), 'hole')} drilled at {shown}{more} mm")
        if self._compensated:
            notes.append(
                f"{self._compensated}: the path is the edge as programmed; the tool's centre runs "
                "beside it by its radius, which the program does not give"
            )
        if self._upright:
            notes.append(f"upright arcs (G18, G19) read as lines in plan: {self._upright}")
        if self._idle:
            names = list(self._idle)
            more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
            notes.append(f"passed over: {', '.join(names[:_MOST_NAMED])}{more}")
        return notes

    def _words(self, code: str) -> tuple[dict[str, float], list[str], list[str]]:
        """Return the values of a line's words, and its G and M codes."""
        if _HOMING.search(code):
            code = _BARE_AXIS.sub(r"\g<1>0", code)
        if code.startswith(("%", "$", ":")):
            code = ""
        if code.startswith("/"):
            code = code.lstrip("/0123456789") if code[1:2].isdigit() else code.lstrip("/")
            self._idle[one_line(f"/{code}", 12)] = None
        code = _MESSAGE.sub("", code)
        if "#" in code or "[" in code or _FLOW.match(code):
            self._refuse(
                f"{one_line(code, 20)!r} is computed by the controller; write the moves out, as "
                "CAM does without macros."
            )
        words: dict[str, float] = {}
        self._absolute_words = {}
        codes: dict[str, list[str]] = {"G": [], "M": []}
        position = 0
        while position < len(code):
            match = _WORD.match(code, position)
            if match is None:
                self._refuse(
                    f"Cannot read {one_line(code[position:], 20)!r}; "
                    "write words of a letter and a number, such as X12.5."
                )
            letter, mark, number = match.groups()
            position = match.end()
            if letter in codes:
                codes[letter].append(f"{float(number):g}")
                continue
            if letter in _TURNING_AXES:
                if float(number) != 0:
                    self._refuse(
                        f"The word {match[0]} moves another axis; only X, Y and Z are followed."
                    )
                self._idle[match[0]] = None
            if letter in words and letter in "XYZIJKR":
                self._refuse(f"{letter} twice in one line; write two lines.")
            words[letter] = float(number)
            if mark:
                self._absolute_words[letter] = mark == "^"
        return words, codes["G"], codes["M"]

    def _set_modes(self, words: Mapping[str, float], gs: Sequence[str]) -> None:
        motions = [g for g in gs if g in _MOTIONS]
        if len(motions) > 1:
            self._refuse(f"G{motions[0]} and G{motions[1]} in one line; write two lines.")
        for g in gs:
            if g in _UNITS_G and not (g in ("70", "71") and ("P" in words or "Q" in words)):
                self._unit_m = UNITS_M[_UNITS_G[g]]
                self.unit_said = True
            elif g in ("90", "91"):
                self._absolute = g == "90"
            elif g in ("90.1", "91.1"):
                self._absolute_centres = g == "90.1"
            elif g in ("17", "18", "19"):
                self._plane = g
            elif g in _ORIGINS:
                if g != self._origin and self.feeds:
                    self._origin_moved = f"G{g} in {self.place}"
                self._origin = g
            elif g in _COMPENSATION:
                radius = f" D{words['D']:g}" if "D" in words else ""
                self._compensated = self._compensated or f"{self.place}: G{g}{radius}"
            elif g in _CYCLES:
                self._cycle = True
            elif g == "5.1" and "I" not in words and "J" not in words:
                self._idle[f"G5.1 Q{words['Q']:g}" if "Q" in words else "G5.1"] = None
            elif g in _IDLE_G:
                self._idle[f"G{g}"] = None
            elif g == "92.1":
                self._move_origin({}, gs)
            elif g not in (*_MOTIONS, *_USUAL_G, *_OF_THE_MACHINE, "10", "52", "92"):
                self._refuse(
                    f"G{g} is not read here, for it may lead the tool elsewhere; write the "
                    "trajectory by G0, G1, G2, G3 with G17, G20 or G21, G90 or G91."
                )
        if motions or "80" in gs:
            self._cycle = False
        self._motion = motions[0] if motions else self._motion

    def _set_tool(self, words: Mapping[str, float], ms: Sequence[str]) -> None:
        for m in ms:
            if m in _ELSEWHERE_M:
                self._refuse(f"M{m} is not read here; leave it out.")
            if m in ("3", "4", "5"):
                self._spindle = m != "5"
            if m not in _USUAL_M and m not in _END_M:
                self._idle[f"M{m}"] = None
        if "S" in words:
            self._speed = words["S"] > 0

    def _move_origin(self, words: Mapping[str, float], gs: Sequence[str]) -> None:
        """Follow G92, and note where coordinates no longer tell the place."""
        axes = [letter for letter in "XYZ" if letter in words]
        if "92.1" in gs:
            self._at = {
                letter: value + self._shift.get(letter, 0.0) for letter, value in self._at.items()
            }
            self._shift = {}
        elif "92" in gs:
            for letter in axes:
                value = words[letter] * self._unit_m
                if letter in self._at:
                    there = self._at[letter] + self._shift.get(letter, 0.0)
                    self._shift[letter] = there - value
                self._at[letter] = value
        elif "10" in gs:
            self.shift_origin("G10")
        else:
            code = next(g for g in gs if g in _OF_THE_MACHINE)
            if code == "53" and axes and self._motion not in (None, "0") and axes != ["Z"]:
                self._refuse("A feed move in the machine's coordinates (G53); use the part's.")
            for letter in axes or ("XYZ" if code != "53" else ""):
                self._at.pop(letter, None)
                if letter != "Z":
                    self._lost = f"G{code} in {self.place}"
            self._entered_by_feed = False

    def _drill(self, words: Mapping[str, float]) -> None:
        repeats = words.get("L", words.get("K", 1.0)) if not self._absolute else 1.0
        if not 0 <= repeats <= _MOST_TURNS:
            self._refuse(f"A cycle repeated {repeats:g} times; at most {_MOST_TURNS:,} are read.")
        for _ in range(int(repeats)):
            self._at = self._target({k: v for k, v in words.items() if k in "XY"})
            self._assume_start(self._at)
            self.holes.append(self._planar(self._at))
            if len(self.holes) > MOST_FEEDS:
                self._refuse(f"More than {MOST_FEEDS:,} holes; split the program.")

    def _target(self, words: Mapping[str, float]) -> dict[str, float]:
        """Return the program's coordinates after a line."""
        target = dict(self._at)
        for letter in "XYZ":
            if letter not in words:
                continue
            value = words[letter] * self._unit_m
            if not self._absolute_words.get(letter, self._absolute):
                if letter not in self._at and self._lost and letter != "Z":
                    self._refuse(f"G91 from an unknown position, after {self._lost}; use G90.")
                value += self._at.get(letter, 0.0)
                if letter not in self._at and letter != "Z":
                    self._assumed_start = self._assumed_start or self.place
            if not abs(value) <= MAX_COORDINATE_M:
                self._refuse(f"{letter} is beyond {MAX_COORDINATE_M:g} m, which no bench is.")
            target[letter] = value
        return target

    def _assume_start(self, at: dict[str, float]) -> None:
        """Take coordinates that no line has given to be 0, unless the tool was sent elsewhere."""
        for letter in "XY":
            if letter not in at:
                if self._lost:
                    self._refuse(
                        f"A feed move from an unknown position, after {self._lost}; first give "
                        "both X and Y by G0."
                    )
                at[letter] = 0.0
                self._assumed_start = self._assumed_start or self.place

    @staticmethod
    def _is_lost(at: Mapping[str, float]) -> bool:
        return "X" not in at or "Y" not in at

    def _planar(self, at: Mapping[str, float]) -> Point2:
        x, y = (at[letter] + self._shift.get(letter, 0.0) for letter in "XY")
        return x, y

    def _height_m(self, at: Mapping[str, float]) -> float | None:
        return at["Z"] + self._shift.get("Z", 0.0) if "Z" in at else None

    def _move(self, words: Mapping[str, float]) -> None:
        if self._motion is None:
            if all(letter not in words for letter in _PLACING):
                return
            self._refuse("A position before any of G0, G1, G2, G3; give the motion first.")
        curved = self._motion in ("2", "3")
        if not curved and any(letter in words for letter in "IJR"):
            self._refuse(f"I, J and R belong to an arc, but the motion is G{self._motion}.")
        before, target = dict(self._at), self._target(words)
        old_m, new_m = self._height_m(before), self._height_m(target)
        if "Z" in words:
            down = old_m is not None and new_m is not None and new_m < old_m
            self._entered_by_feed = down and self._motion != "0"
        self._at = target
        if not curved and not ("X" in words or "Y" in words):
            return
        if self._motion == "0":
            self._travel(before, target)
            return
        is_full = all(letter in target for letter in "XY")
        is_new = not ("X" in before or "Y" in before)
        if not curved and ((is_new and is_full) or (self._lost and self._is_lost(before))):
            # A feed move from an unknown position leads the tool to a known one.
            self._lost = "" if is_full else self._lost
            return
        self._assume_start(before)
        for letter in "XY":
            target.setdefault(letter, before[letter])
        self._feed(before, target, words, curved=curved)

    def _travel(self, before: Mapping[str, float], target: Mapping[str, float]) -> None:
        if all(letter in before and letter in target for letter in "XY"):
            moved = math.dist(self._planar(before), self._planar(target)) > JOIN_M
            heights = [self._height_m(at) for at in (before, target)]
            if moved and None not in heights:
                self.rapid_heights_m.append(min(h for h in heights if h is not None))

    def _feed(
        self,
        before: Mapping[str, float],
        target: Mapping[str, float],
        words: Mapping[str, float],
        *,
        curved: bool,
    ) -> None:
        """Add a feed move in plan."""
        if self._origin_moved:
            self._refuse(
                f"{self._origin_moved} has moved the origin; keep one origin in a program."
            )
        start, end = self._planar(before), self._planar(target)
        elements: list[Line | Arc] = [Line(end)]
        if curved and self._plane != "17":
            self._upright += 1
        elif curved:
            if words.get("K"):
                self._refuse(f"The word K{words['K']:g} belongs to no arc in the XY plane (G17).")
            centre = self._centre(start, end, words)
            turns = int(words.get("P", 1.0))
            if not 1 <= turns <= _MOST_TURNS:
                self._refuse(f"An arc of {turns} turns; give 1 to {_MOST_TURNS:,}.")
            clockwise = self._motion == "2"
            around = math.dist(start, end) > SAME_POINT_M
            elements = []
            for _ in range(turns - 1):
                elements += _arcs(start, start, centre, clockwise=clockwise)
            elements += (
                _arcs(start, end, centre, clockwise=clockwise) if around or turns >= 1 else []
            )
        heights = self._height_m(before), self._height_m(target)
        self._add(start, elements, heights, plunge="Z" in words)

    def _add(
        self,
        start: Point2,
        elements: Sequence[Line | Arc],
        heights: tuple[float | None, float | None],
        *,
        plunge: bool,
    ) -> None:
        # Lines continue from the last end, so that merged points leave no gap.
        if self.feeds and math.dist(self.feeds[-1].end, start) <= SAME_POINT_M:
            start = self.feeds[-1].end
            if self._corner is not None and math.dist(start, elements[0].end) > SAME_POINT_M:
                start = self._cut_corner(elements[0])
        for number, element in enumerate(elements):
            if math.dist(start, element.end) <= SAME_POINT_M:
                self._repeated += not plunge
                continue
            low, high = (
                None
                if heights[0] is None or heights[1] is None
                else heights[0] + (heights[1] - heights[0]) * (number + step) / len(elements)
                for step in (0, 1)
            )
            self.feeds.append(Feed(start, element, self.place, (low, high)))
            self.has_plunged.append(self._entered_by_feed)
            self.is_on.append(self._spindle and self._speed)
            start = element.end
        if len(self.feeds) > MOST_FEEDS:
            self._refuse(f"More than {MOST_FEEDS:,} feed moves; split the program.")

    def _cut_corner(self, element: Line | Arc) -> Point2:
        """Round off or cut off the corner before an element, and return its new start."""
        assert self._corner is not None
        (is_round, size_m), self._corner = self._corner, None
        last = self.feeds[-1]
        if not (isinstance(last.element, Line) and isinstance(element, Line)):
            self._refuse("A corner beside an arc is rounded off by the controller; write it out.")
        corner = last.end
        sides = last.length_m, math.dist(corner, element.end)
        back, ahead = (
            ((x - corner[0]) / side, (y - corner[1]) / side)
            for (x, y), side in zip((last.start, element.end), sides, strict=True)
        )
        half = math.acos(max(-1.0, min(1.0, back[0] * ahead[0] + back[1] * ahead[1]))) / 2
        if half > math.pi / 2 - _STRAIGHT_RAD:
            return corner
        leg_m = size_m / math.tan(half) if is_round and half > 0 else size_m
        if not (half > 0 and leg_m < min(sides) + SAME_POINT_M):
            self._refuse(
                f"A corner of {size_m * 1e3:g} mm is larger than its sides of "
                f"{sides[0] * 1e3:.4g} and {sides[1] * 1e3:.4g} mm."
            )
        begin, end = (
            (corner[0] + leg_m * along[0], corner[1] + leg_m * along[1]) for along in (back, ahead)
        )
        way: Line | Arc = Line(end)
        if is_round:
            # From the corner to the middle of the arc, along the bisector.
            depth_m = size_m / math.sin(half) - size_m
            share = depth_m / (2 * math.cos(half))
            way = Arc(
                end,
                (
                    corner[0] + share * (back[0] + ahead[0]),
                    corner[1] + share * (back[1] + ahead[1]),
                ),
            )
        self.feeds[-1:] = (
            [replace(last, element=Line(begin))]
            if math.dist(last.start, begin) > SAME_POINT_M
            else []
        )
        height = last.heights_m[1]
        fits = len(self.feeds) == len(self.has_plunged)
        self.feeds.append(Feed(begin, way, self.place, (height, height)))
        if fits:
            self.has_plunged.append(self.has_plunged[-1])
            self.is_on.append(self.is_on[-1])
        return end

    def _centre(self, start: Point2, end: Point2, words: Mapping[str, float]) -> Point2:
        """Return the centre of an arc, by I and J or by R."""
        if "R" not in words:
            if "I" not in words and "J" not in words:
                self._refuse("An arc without a centre; give it as I and J, or a radius as R.")
            if self._absolute_words.get("I", self._absolute_centres):
                if "I" not in words or "J" not in words:
                    self._refuse("An arc with G90.1 needs both I and J.")
                x, y = (
                    words[letter] * self._unit_m + self._shift.get(axis, 0.0)
                    for letter, axis in (("I", "X"), ("J", "Y"))
                )
            else:
                x = start[0] + words.get("I", 0.0) * self._unit_m
                y = start[1] + words.get("J", 0.0) * self._unit_m
            radii = math.dist((x, y), start), math.dist((x, y), end)
            if not SAME_POINT_M < radii[0] <= MAX_COORDINATE_M:
                self._refuse(f"An arc of radius {radii[0]:g} m; give its centre as I and J.")
            if abs(radii[0] - radii[1]) > max(JOIN_M, 1e-3 * radii[0]):
                origin = "the program's zero (G90.1)" if self._absolute_centres else "the start"
                self._refuse(
                    f"The arc's centre is {radii[0]:.9g} m from its start but {radii[1]:.9g} m "
                    f"from its end; mend I and J, which count from {origin}."
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
        return ((start[0] + end[0]) / 2 - side * dy, (start[1] + end[1]) / 2 + side * dx)

    def _refuse(self, message: str) -> NoReturn:
        raise TrajectoryFileError(self.path, message, self.place)


def _arcs(start: Point2, end: Point2, centre: Point2, *, clockwise: bool) -> list[Line | Arc]:
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


def _cutting(machine: _Machine) -> tuple[list[Feed], list[str]]:
    """Return the feed moves that cut, and notes about the others."""
    feeds, notes = list(machine.feeds), list[str]()
    lows = [feed.lowest_m for feed in feeds]
    known = [low for low in lows if low is not None]
    levels = {round(low / JOIN_M) for low in known}
    if len(levels) <= 1:
        if any(machine.is_on) and not all(machine.is_on):
            cuts = [feed for feed, on in zip(feeds, machine.is_on, strict=True) if on]
            off_m = sum(f.length_m for f in feeds) - sum(f.length_m for f in cuts)
            notes.append(f"left out: {millimetres(off_m)} mm fed with the tool off (M5 or S0)")
            return cuts, notes
        return feeds, notes
    lowest_m = min(known)
    clearance_m = min(
        (height for height in machine.rapid_heights_m if height > lowest_m + JOIN_M),
        default=math.inf,
    )

    def is_in_air(low_m: float | None, plunged: bool) -> bool:
        if low_m is None:
            return True
        if low_m <= lowest_m + JOIN_M or plunged:
            return False
        return low_m > JOIN_M >= lowest_m or low_m >= clearance_m - JOIN_M

    in_air = list(map(is_in_air, lows, machine.has_plunged))
    cuts = [feed for feed, air in zip(feeds, in_air, strict=True) if not air]
    air = [feed for feed, air in zip(feeds, in_air, strict=True) if air]
    if air:
        heights = sorted({feed.lowest_m for feed in air if feed.lowest_m is not None})
        cut_heights = sorted(
            {round(feed.lowest_m, 6) for feed in cuts if feed.lowest_m is not None}
        )
        at = f" at Z {_range(heights)}" if heights else " before the first Z"
        notes.append(
            f"left out: {millimetres(sum(feed.length_m for feed in air))} mm fed above the cut,"
            f"{at} mm; the cut is at Z {_range(cut_heights)} mm"
        )
    return cuts, notes


def _range(heights: Sequence[float]) -> str:
    low, high = millimetres(heights[0]), millimetres(heights[-1])
    return low if low == high else f"{low} to {high}"
