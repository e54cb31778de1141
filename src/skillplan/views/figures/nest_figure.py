"""Drawings of nests: from above and in section, with their sizes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skillplan.views.figures.figure_file import render_figure
from skillplan.views.figures.picture import PIXELS_PER_IN, SMALL_PX, Picture, shorten
from skillplan.views.figures.solids import Point

_Ring = Sequence[Sequence[float]]
_WIDTH_PX, _MARGIN_PX, _SIDE_PX, _GAP_PX = 720.0, 26.0, 110.0, 74.0
_MOST_TALL_PX = 420.0
_PNG_SCALE = 2.5
# Distance of the lines of a section.
_HATCH_PX = 8.0
_HEADING_PX, _LINE_PX = 22.0, 15.0
# Opacity of the lowest and the highest material from above.
_LOW_OPACITY, _HIGH_OPACITY = 0.15, 0.75
# Scales of drawings, as pixels of paper per millimetre at 1:1.
_PX_PER_MM = PIXELS_PER_IN / 25.4


def render_nest_png(nest: Mapping[str, Any]) -> bytes:
    """Return the drawing of an entry of ``skillplan.nest/1`` as PNG."""
    return render_figure(draw_nest(nest).figure, ".png", round(PIXELS_PER_IN * _PNG_SCALE))


def draw_nest(nest: Mapping[str, Any]) -> Picture:
    """Return a nest from above and in section, with its part and its sizes.

    Parameters
    ----------
    nest
        An entry of ``skillplan.nest/1``.
    """
    return _Drawing(nest).draw()


class _Drawing:
    """Two views of a nest on a common scale; the section lies below the view from above."""

    def __init__(self, nest: Mapping[str, Any]) -> None:
        self.nest, self.views = nest, nest["views"]
        rings = [ring for level in self.views["top"] for ring in level["outlines"]]
        section = self.views["section"]
        plan = np.concatenate([np.array(ring) for ring in (*rings, *self.views["part"])])
        side = np.concatenate([np.array(ring) for ring in (*section["nest"], *section["part"])])
        self.low = np.array([min(plan[:, 0].min(), side[:, 0].min()), plan[:, 1].min()])
        self.high = np.array([max(plan[:, 0].max(), side[:, 0].max()), plan[:, 1].max()])
        self.bottom, self.top = min(0.0, float(side[:, 1].min())), float(side[:, 1].max())
        wide, deep = self.high - self.low
        tall = self.top - self.bottom
        room = _WIDTH_PX - 2 * _MARGIN_PX - _SIDE_PX
        fitting = min(room / wide, _MOST_TALL_PX / deep, _MOST_TALL_PX / tall)
        self.scale = choose_scale(fitting / _PX_PER_MM) * _PX_PER_MM
        self.left = _MARGIN_PX + (room - self.scale * wide) / 2
        self.lines = list_nest_facts(nest)
        self.plan_px = _MARGIN_PX + _HEADING_PX + 14
        self.side_px = self.plan_px + self.scale * deep + _GAP_PX
        self.text_px = self.side_px + self.scale * tall + 50
        height = self.text_px + _LINE_PX * len(self.lines) + _MARGIN_PX
        self.picture = Picture(_WIDTH_PX, height, f"Drawing of {nest['name']}")

    def draw(self) -> Picture:
        picture, names = self.picture, ", ".join(self.nest["parts"])
        title = shorten(f"{self.nest['name']} for {names}", _WIDTH_PX - 320)
        picture.label((_MARGIN_PX, _MARGIN_PX), title, anchor="start", bold=True)
        ratio = describe_scale(self.scale / _PX_PER_MM)
        words = f"scale {ratio} on paper {_WIDTH_PX / _PX_PER_MM:.0f} mm wide; sizes in mm"
        right = _WIDTH_PX - _MARGIN_PX
        picture.label((right, _MARGIN_PX), words, "muted", SMALL_PX, "end")
        self._draw_plan()
        self._draw_section()
        for number, line in enumerate(self.lines):
            at = (_MARGIN_PX, self.text_px + _LINE_PX * number)
            good = self.nest["check"]["good"] or number < len(self.lines) - 1
            words = shorten(line, _WIDTH_PX - 2 * _MARGIN_PX, SMALL_PX)
            picture.label(at, words, "ink" if good else "red", SMALL_PX, "start")
        return picture

    def _plan(self, ring: _Ring) -> list[tuple[float, float]]:
        return [
            (
                self.left + self.scale * (x - self.low[0]),
                self.plan_px + self.scale * (self.high[1] - y),
            )
            for x, y in ring
        ]

    def _side(self, ring: _Ring) -> list[tuple[float, float]]:
        return [
            (self.left + self.scale * (x - self.low[0]), self.side_px + self.scale * (self.top - z))
            for x, z in ring
        ]

    def _draw_plan(self) -> None:
        levels = self.views["top"]
        for number, level in enumerate(levels):
            share = number / max(1, len(levels) - 1)
            opacity = _LOW_OPACITY + share * (_HIGH_OPACITY - _LOW_OPACITY)
            rings = [self._plan(ring) for ring in level["outlines"]]
            # Each level covers those below it with paper first.
            self._fill(rings, "paper", 1.0)
            self._fill(rings, "grey", opacity)
        for ring in self.views["part"]:
            self.picture.polygon(self._plan(ring), None, "blue", 1.4, dashed=True)
        for pin in self.nest["pins"]:
            x, y, _ = pin["top_mm"]
            at = self._plan([(x, y)])[0]
            self.picture.disc(at, self.scale * pin["diameter_mm"] / 2, "orange", "ink", 0.8)
        y_mm = self.views["section"]["y_mm"]
        ends = self._plan([(self.low[0], y_mm), (self.high[0], y_mm)])
        (x0, y0), (x1, _) = ends
        self.picture.line([(x0 - 12, y0), (x1 + 12, y0)], "red", 0.9, dashed=True)
        for x in (x0 - 18, x1 + 18):
            self.picture.label((x, y0), "A", "red", SMALL_PX, bold=True)
        outer = np.concatenate([np.array(ring) for ring in levels[0]["outlines"]])
        low, high = outer.min(axis=0), outer.max(axis=0)
        self._measure_width(self._plan, low[0], high[0], low[1], 16)
        self._measure_height(self._plan, low[1], high[1], high[0], 40)
        mouth = self._find_mouth()
        if mouth is not None:
            (x_low, y_low), (x_high, y_high) = mouth
            self._measure_width(self._plan, x_low, x_high, low[1], 34)
            self._measure_height(self._plan, y_low, y_high, high[0], 74)

    def _find_mouth(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Return the corners of the largest opening of the highest walls that close around it."""
        for level in reversed(self.views["top"]):
            rings = [np.array(ring) for ring in level["outlines"]]
            holes = [ring for ring in rings if _compute_area(ring) < 0]
            if holes:
                largest = min(holes, key=_compute_area)
                (x_low, y_low), (x_high, y_high) = largest.min(axis=0), largest.max(axis=0)
                return (float(x_low), float(y_low)), (float(x_high), float(y_high))
        return None

    def _draw_section(self) -> None:
        section = self.views["section"]
        cut = [self._side(ring) for ring in section["nest"]]
        self._fill(cut, "grey", 0.35)
        for line in list_hatches(cut):
            self.picture.line(line, "ink", 0.6)
        for ring in section["part"]:
            self.picture.polygon(self._side(ring), None, "blue", 1.4, dashed=True)
        width_mm, _, height_mm = self.nest["size_mm"]
        walls_mm = self.nest["base_mm"] + self.nest["depth_mm"]
        right_mm = width_mm / 2
        self._measure_height(self._side, 0.0, self.nest["base_mm"], right_mm, 40)
        self._measure_height(self._side, self.nest["base_mm"], walls_mm, right_mm, 40)
        self._measure_height(self._side, 0.0, height_mm, right_mm, 74)
        middle = (self.low[0] + self.high[0]) / 2
        x, _ = self._side([(middle, 0.0)])[0]
        y = self.side_px + self.scale * (self.top - self.bottom) + 20
        self.picture.label((x, y), "A - A", "red", SMALL_PX, bold=True)

    def _fill(
        self, rings: Sequence[Sequence[tuple[float, float]]], role: str, opacity: float
    ) -> None:
        """Fill rings; those inside others are holes."""
        self.picture.area(rings, role, "ink", 0.8, opacity=opacity)

    def _measure_width(self, view: Any, low: float, high: float, edge: float, away: float) -> None:
        """Draw the size between two places of x, below an edge."""
        (x0, y), (x1, _) = view([(low, edge), (high, edge)])
        for x in (x0, x1):
            self.picture.line([(x, y + 2), (x, y + away + 4)], "muted", 0.6)
        self._draw_arrows((x0, y + away), (x1, y + away))
        at = ((x0 + x1) / 2, y + away)
        self.picture.label(at, f"{high - low:.4g}", size_px=SMALL_PX, halo=True)

    def _measure_height(self, view: Any, low: float, high: float, edge: float, away: float) -> None:
        """Draw the size between two heights of the page, right of an edge."""
        (x, y0), (_, y1) = view([(edge, low), (edge, high)])
        for y in (y0, y1):
            self.picture.line([(x + 2, y), (x + away + 4, y)], "muted", 0.6)
        self._draw_arrows((x + away, y0), (x + away, y1))
        at = (x + away + 6, (y0 + y1) / 2)
        self.picture.label(at, f"{high - low:.4g}", size_px=SMALL_PX, anchor="start", halo=True)

    def _draw_arrows(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        length = math.dist(start, end)
        head = min(6.0, length / 2.5)
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        for tip in (start, end):
            self.picture.arrow(middle, tip, "ink", 0.7, head_px=head)


def _compute_area(ring: Any) -> float:
    """Return the area within a ring; negative if clockwise."""
    x, y = ring[:, 0], ring[:, 1]
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def list_hatches(rings: Sequence[Sequence[Point]]) -> list[list[Point]]:
    """Return parallel lines within an area between rings [px]."""
    import shapely

    area: Any = shapely.Polygon()
    for ring in rings:
        # Holes lie in the rings around them.
        area = area.symmetric_difference(shapely.Polygon(ring))
    if area.is_empty:
        return []
    left, top, right, bottom = area.bounds
    high = bottom - top
    starts = np.arange(left - high, right, _HATCH_PX)
    lines = [shapely.LineString([(x, bottom), (x + high, top)]) for x in starts.tolist()]
    cut = shapely.get_parts(shapely.intersection(lines, area))
    cut = shapely.get_parts(cut[shapely.length(cut) > 0])
    return [[*line.coords] for line in cut if line.geom_type == "LineString"]


def choose_scale(fitting: float) -> float:
    """Return the largest usual scale of drawings that is at most a number."""
    usual = [share * 10.0**power for power in range(-4, 4) for share in (1, 2, 5)]
    return max((scale for scale in usual if scale <= fitting), default=fitting)


def describe_scale(scale: float) -> str:
    """Return a scale such as 2 or 0.5 as 2:1 or 1:2."""
    return f"{scale:.4g}:1" if scale >= 1 else f"1:{1 / scale:.4g}"


def list_nest_facts(nest: Mapping[str, Any]) -> list[str]:
    """Return sizes and the check of a nest, a line each; the last states whether it is good."""
    check = nest["check"]
    turn = check["turn_deg"]
    low, high = check["play_mm"]
    play = f"{low:.3g} to {high:.3g} mm" if high < 5 else f"{low:.3g} mm and more"
    around = "turns freely" if turn is None else f"turns by {turn:.2g} degrees"
    gap = "5 mm or more"
    if check["gap_at_mm"]:
        place = ", ".join(f"{value:.4g}" for value in check["gap_at_mm"])
        gap = f"{check['least_gap_mm']:.3f} mm at {place}"
    lines = [
        f"size {' x '.join(f'{size:.4g}' for size in nest['size_mm'])} mm; walls "
        f"{nest['wall_mm']:g}, base {nest['base_mm']:g}, held {nest['depth_mm']:.4g} mm deep; "
        f"clearance {nest['clearance_mm']:g} mm, draft {nest['draft_deg']:g} degrees",
        f"{check['rays']:,} rays from {check['samples']:,} points: least gap {gap}",
        f"seated: play {play}, {around}",
        _describe_support(nest),
    ]
    lines += [
        f"undercut: {undercut['part']} from {undercut['low_mm']:.3g} to {undercut['high_mm']:.3g} "
        f"mm, {undercut['area_mm2']:.4g} mm2, not held by a wall"
        for undercut in check["undercuts"]
    ]
    if check["good"]:
        lines.append("good: the part enters without collision")
    else:
        lines.append(f"not good: {'; '.join(check['faults'])}")
    return lines


def _describe_support(nest: Mapping[str, Any]) -> str:
    check, pins = nest["check"], len(nest["pins"])
    if not check["supports"]:
        return "rests on nothing"
    words = f"rests at {check['supports']} sampled points"
    if pins:
        words += f", on {pins} pin{'s' if pins > 1 else ''}, too"
    margin_mm = check["support_margin_mm"]
    where = f"{abs(margin_mm):.3g} mm {'inside' if margin_mm > 0 else 'outside'} their edge"
    if abs(margin_mm) < 0.005:
        where = "on their edge"
    held = "; walls keep it in place" if check["held_by_walls"] else ""
    return f"{words}; centre of mass {where}{held}"
