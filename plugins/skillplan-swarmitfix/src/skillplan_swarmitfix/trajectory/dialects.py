"""Lines for Siemens and Heidenhain controllers in words of RS274/NGC.

A mark between letter and number overrides the modes of the program: ``X~5`` counts from the last
position, ``I^5`` from the zero. Sources: SINUMERIK 840D, Programming Manual Fundamentals;
HEIDENHAIN TNC 640, User's Manual for Conversational Programming.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import NoReturn, Protocol

from skillplan_swarmitfix.trajectory.path import one_line
from skillplan_swarmitfix.trajectory.path_elements import Point2

_BLANK = re.compile(r"\s")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_SIEMENS_WORD = re.compile(
    rf"\b([XYZIJKABCFSM])\d?\s*=\s*(AC|IC|DC|ACP|ACN)?\s*\(?\s*({_NUMBER})\s*\)?"
)
_SIEMENS_IDLE = re.compile(
    r"\b(?:SOFT|BRISK|DRIVE|FFWON|FFWOF|CFTCP|CFC|CFIN|COMPON|COMPOF|COMPCURV|COMPCAD|COMPSURF|UPATH|"
    r"SPATH|ORI\w+|STOPRE|DIAM\w+|KONT|NORM|RTLIO\w+|CDOF|CDON|WALIM\w+|PAROTOF|TRAFOOF|FNORM|FLIN|"
    r"SPCO\w+|TOFRAME|ROTS|CYCLE832|WORKPIECE|FGROUP|MSG|SPOS\s*=\s*[\d.]+|TCARR\s*=\s*\d+|"
    r"LIMS\s*=\s*[\d.]+|T\s*=\s*[\w\"]+)(?:\s*\([^)]*\))?"
)
_SIEMENS_FRAME = re.compile(r"\bA?(?:TRANS|ROT|SCALE|MIRROR)\b(.*)|\bCYCLE800\b(.*)")
_SIEMENS_CORNER = re.compile(r"\b(RNDM|ANG|AR|AP|RP|CIP|CT|I1|J1)\s*=?")
_SIEMENS_ROUND = re.compile(r"\b(RND|CHF|CHR)\s*=\s*([\d.]+)")
_SIEMENS_DRILL = re.compile(r"\b(?:CYCLE8[1-9]|CYCLE840)\s*\([^)]*\)")
_SIEMENS_COMPUTED = re.compile(
    r"=\s*R\d|\b(?:R\d+\s*=|IF|ELSE|ENDIF|FOR|WHILE|LOOP|REPEAT\w*|GOTO\w*|DEF|CASE|\$\w+)|\bR\d+\s*[-+*/]"
)
_IDENTIFIER = re.compile(r"\b(?:L\d+|[A-Z_]{2}\w*)")
_AXIS = re.compile(rf"\b(I?)([XYZABCUVW])\s*({_NUMBER})")
_POLAR = re.compile(rf"\b(I?)(PR|PA)\s*({_NUMBER})")
_HEIDENHAIN_WORD = re.compile(
    rf"I?[XYZABCUVW] ?{_NUMBER}|I?P[RA] ?{_NUMBER}|[IJ]\^\S+|F ?(?:MAX|AUTO|Q\d+|U? ?{_NUMBER})|"
    rf"\bF\b|\bR[0LR]\b|R ?{_NUMBER}|DR[-+]|M\d+|MB ?(?:MAX|{_NUMBER})|LEN ?{_NUMBER}|"
    rf"CCA ?{_NUMBER}|\b(?:LT|LN|CT|LCT)\b"
)
_HEIDENHAIN_DRILLS = {1, 2, 17, 18, 240, 241, *range(200, 210), *range(262, 266)}
_HEIDENHAIN_FRAMES = {"7", "8", "10", "11", "19", "26"}
_HEIDENHAIN_IDLE = {"BLK", "TOOL", "END", "STOP", "FUNCTION"}
_HEIDENHAIN_MOVES = {
    "RND",
    "CHF",
    "CYCL",
    "CYCLE",
    "CC",
    "L",
    "LP",
    "C",
    "CP",
    "CR",
    "CT",
    "APPR",
    "DEP",
}
_KEPT_M = {
    "0": "0",
    "1": "1",
    "2": "2",
    "3": "3",
    "4": "4",
    "5": "5",
    "30": "30",
    "13": "3",
    "14": "4",
}


class Machine(Protocol):
    """The state of the program so far, which some lines refer to."""

    place: str

    def position(self) -> Point2 | None:
        """Return X and Y as the program writes them; None if they are unknown."""

    def direction_rad(self) -> float | None:
        """Return the direction in which the last feed move ended; None before the first."""

    def pass_over(self, code: str) -> None:
        """Note a code that is passed over."""

    def shift_origin(self, code: str) -> None:
        """Note a code that moves the origin, which no feed move before it may have used."""


Refuse = Callable[[str], NoReturn]
"""Raises an error with the line at fault."""


class Siemens:
    """Translates lines of a SINUMERIK program."""

    def __init__(self, machine: Machine, refuse: Refuse) -> None:
        self._machine = machine
        self._refuse = refuse
        self._drills = False

    def lines(self, code: str, _: str) -> list[str]:
        """Return a line in words of RS274; a drilling cycle as several lines."""
        code = re.sub(r'"[^"]*"', '""', code)
        code = re.sub(r"^(?:[N:]\d+\s*)?(?:[A-Z_]\w+:\s+)?", "", code)
        if _SIEMENS_COMPUTED.search(code):
            self._refuse(
                f"{one_line(code, 30)!r} is computed by the controller; write the moves out."
            )
        frame = _SIEMENS_FRAME.search(code)
        if frame:
            if re.search(r"[1-9]", frame[1] or frame[2] or ""):
                if not frame[0].startswith(("TRANS", "ATRANS")):
                    self._refuse(f"{one_line(code, 30)!r} turns the plane; write the moves out.")
                self._machine.shift_origin(one_line(frame[0], 30))
            return [_BLANK.sub("", code[: frame.start()])]
        corners = [
            # The length of a chamfer is given at right angles to the bisector.
            f"{'RND' if kind == 'RND' else 'CHR'}"
            f"{float(size) * (math.sqrt(0.5) if kind == 'CHF' else 1.0):.9f}"
            for kind, size in _SIEMENS_ROUND.findall(code)
        ]
        code = _SIEMENS_ROUND.sub("", code)
        if corner := _SIEMENS_CORNER.search(code):
            self._refuse(
                f"{corner[1]} is not read here; give corners and arcs by their points and I and "
                "J, or CR=."
            )
        if re.search(r"\bG7[45]\b", code):
            axes = re.findall(r"\b([XYZ])\d?\s*=", code) or ["X", "Y", "Z"]
            return ["G28" + "".join(f"{axis}0" for axis in axes)]
        drills = bool(_SIEMENS_DRILL.search(code))
        if "MCALL" in code:
            self._drills = drills
            drills = False
            code = code.replace("MCALL", "")
        code = _SIEMENS_IDLE.sub("", _SIEMENS_DRILL.sub("", code))
        code = re.sub(r"\bCR\s*=\s*", "R", code)
        code = re.sub(r"\bTURN\s*=\s*(\d+)", lambda match: f"P{int(match[1]) + 1}", code)
        code = _SIEMENS_WORD.sub(lambda m: f"{m[1]}{_MARKS.get(m[2], '')}{m[3]} ", code)
        code = re.sub(r"\bSUPA\b", "G53", code)
        if name := _IDENTIFIER.search(code):
            self._refuse(f"It calls {one_line(name[0], 30)}, which is not in this file.")
        code = _BLANK.sub("", code)
        if drills or (self._drills and re.search(r"[XY]", code)):
            return [code, "G81", "G80"]
        return [code, *corners]


_MARKS = {"IC": "~", "AC": "^"}


class Heidenhain:
    """Translates lines of a HEIDENHAIN program in conversational form."""

    def __init__(self, machine: Machine, refuse: Refuse) -> None:
        self._machine = machine
        self._refuse = refuse
        self._pole: Point2 | None = None
        self._cycle = 0
        self._modal = False
        self._continues = False

    def lines(self, code: str, raw: str) -> list[str]:
        """Return a line in words of RS274; a drilling cycle as several lines."""
        continues, self._continues = self._continues, raw.rstrip().endswith("~")
        if continues or not code:
            return []
        head = code.split()[0]
        if head == "BEGIN":
            return ["G20G90" if code.endswith("INCH") else "G21G90"]
        if head in _HEIDENHAIN_IDLE or re.match(r"\*|[MF]\d", head):
            return [self._codes_m(code)]
        if re.match(r"(?:FN ?(?:[0-8]|1[4-9]|[23]\d) ?:|Q[LRS]?\d+ ?=)", code):
            # A move that needs the value is refused, as it is not a number.
            self._machine.pass_over(one_line(code, 20))
            return []
        if head == "LBL" or code in ("PLANE RESET STAY", "PLANE RESET"):
            return []
        if head not in _HEIDENHAIN_MOVES:
            self._refuse(
                f"{one_line(code, 30)!r} is computed by the controller; write the moves out as L, "
                "C and CR."
            )
        match head:
            case "CYCL" | "CYCLE":
                return self._cycles(code.replace("CYCLE", "CYCL", 1))
            case "CC":
                self._set_pole(code)
                return []
            case "L" | "LP":
                motion = "0" if re.search(r"\bF\s*MAX\b", code) else "1"
                return self._moved(code, motion, polar=head == "LP")
            case "C" | "CP":
                return self._moved(self._about_pole(code), self._sense(code), polar=head == "CP")
            case "CR":
                return self._moved(code, self._sense(code), polar=False)
            case "CT":
                return self._tangential(code)
            case "RND" | "CHF":
                size = re.search(r"[\d.]+", code)
                return [f"{'RND' if head == 'RND' else 'CHR'}{size[0]}" if size else ""]
            case _:
                return self._led(code)

    def _led(self, code: str) -> list[str]:
        """Return the move to the first point of a contour, or to a point beside it, as a rapid."""
        kind = " ".join(code.split()[:2])
        if kind.split()[-1].startswith("P"):
            self._refuse(f"{kind} is polar; give its point as X and Y.")
        self._machine.pass_over(kind)
        return self._moved(re.sub(r"\bR[-+\d.]+", "", code), "0", polar=False)

    def _moved(self, code: str, motion: str, *, polar: bool) -> list[str]:
        """Return a motion, with its radius compensation and the spindle's codes."""
        unread = _HEIDENHAIN_WORD.sub("", code.partition(" ")[2]).strip()
        if unread:
            self._refuse(f"Cannot read {one_line(unread, 20)!r}; write a letter and a number.")
        words = [f"G{motion}"]
        if re.search(r"\bM9[12]\b|\bM140\b", code):
            words = ["G0", "G53"]
            code += " Z0" if "M140" in code else ""
        for side, g in (("RL", "41"), ("RR", "42"), ("R0", "40")):
            if re.search(rf"\b{side}\b", code):
                words.append(f"G{g}")
        if polar:
            words.append(self._polar(code))
        words += [
            f"{axis}{'~' if step else ''}{value}" for step, axis, value in _AXIS.findall(code)
        ]
        words += re.findall(r"[IJ]\^[-+\d.e]+", code)
        radius = re.search(rf"\bR({_NUMBER})", code)
        if radius and motion in ("2", "3"):
            words.append(f"R{radius[1]}")
        line = "".join([*words, self._codes_m(code)])
        if re.search(r"\bM99\b", code) or (self._modal and re.search(r"[XY]", line)):
            return [line, *self._drilled()]
        return [line]

    @staticmethod
    def _codes_m(code: str) -> str:
        numbers = [number.lstrip("0") or "0" for number in re.findall(r"\bM(\d+)", code)]
        return "".join(f"M{_KEPT_M[number]}" for number in numbers if number in _KEPT_M)

    def _sense(self, code: str) -> str:
        match = re.search(r"\bDR([-+])", code)
        if match is None:
            self._refuse("An arc without DR+ or DR-; give its sense.")
        return "3" if match[1] == "+" else "2"

    def _position(self) -> Point2:
        position = self._machine.position()
        if position is None:
            self._refuse("The position before it is unknown; first give both X and Y.")
        return position

    def _set_pole(self, code: str) -> None:
        axes = {axis: (step, float(value)) for step, axis, value in _AXIS.findall(code)}
        if not axes:
            self._pole = self._position()
            return
        at = list(self._pole or (0.0, 0.0))
        for number, axis in enumerate("XY"):
            if axis in axes:
                step, value = axes[axis]
                at[number] = value + (self._position()[number] if step else 0.0)
        self._pole = (at[0], at[1])

    def _about_pole(self, code: str) -> str:
        if self._pole is None:
            self._refuse("An arc before any CC; give its centre.")
        x, y = self._pole
        return f"{code} I^{x:.9f} J^{y:.9f}"

    def _polar(self, code: str) -> str:
        """Return X and Y of a point given by its radius and angle about the pole."""
        pole, here = self._pole, self._position()
        if pole is None:
            self._refuse("A polar point before any CC; give the pole.")
        radius, angle = math.dist(pole, here), math.atan2(here[1] - pole[1], here[0] - pole[0])
        turns = 1
        for step, name, value in _POLAR.findall(code):
            if name == "PR":
                radius = float(value) + (radius if step else 0.0)
            else:
                turns = max(1, math.ceil(abs(float(value)) / 360 - 1e-9)) if step else 1
                angle = math.radians(float(value)) + (angle if step else 0.0)
        x, y = pole[0] + radius * math.cos(angle), pole[1] + radius * math.sin(angle)
        return f"X{x:.9f}Y{y:.9f}" + (f"P{turns}" if turns > 1 else "")

    def _tangential(self, code: str) -> list[str]:
        """Return an arc that continues the last move without a corner."""
        start, heading = self._position(), self._machine.direction_rad()
        if heading is None:
            self._refuse("CT before any feed move; it continues one.")
        axes = {axis: (step, float(value)) for step, axis, value in _AXIS.findall(code)}
        chord = [
            value if step else value - start[number]
            for number, axis in enumerate("XY")
            for step, value in [axes.get(axis, ("I", 0.0))]
        ]
        normal = (-math.sin(heading), math.cos(heading))
        across = chord[0] * normal[0] + chord[1] * normal[1]
        if abs(across) <= 1e-9 * math.hypot(*chord):
            return self._moved(code, "1", polar=False)
        radius = (chord[0] ** 2 + chord[1] ** 2) / (2 * across)
        x, y = start[0] + radius * normal[0], start[1] + radius * normal[1]
        return self._moved(f"{code} I^{x:.9f} J^{y:.9f}", "3" if radius > 0 else "2", polar=False)

    def _cycles(self, code: str) -> list[str]:
        if code.startswith("CYCL CALL"):
            return self._drilled()
        match = re.match(r"CYCL DEF ?(\d+)(?: ?\.(\d+))?(.*)", code)
        if match is None:
            self._refuse(f"Cannot read {one_line(code, 30)!r}; write CYCL DEF and a number.")
        number, part, values = match.groups()
        if number == "12":
            self._refuse("CYCL DEF 12 calls another file; put its moves here.")
        if number in _HEIDENHAIN_FRAMES:
            if part not in (None, "0") and re.search(r"[1-9]", values):
                if number != "7":
                    self._refuse(f"{one_line(code, 30)!r} turns the plane; write the moves out.")
                self._machine.shift_origin("CYCL DEF 7")
        elif number not in ("9", "32", "247"):
            self._cycle = int(number)
        return []

    def _drilled(self) -> list[str]:
        if self._cycle not in _HEIDENHAIN_DRILLS:
            self._refuse(
                f"Cycle {self._cycle} mills what the controller computes; write the moves out as "
                "L, C and CR."
            )
        return ["G81", "G80"]
