"""Who does what when, as a Gantt chart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from skillplan.views.pictures.drawing import (
    SERIES,
    SMALL_PX,
    Drawing,
    Item,
    Label,
    Look,
    Shape,
    rectangle,
    shortened,
    text_width_px,
)
from skillplan.views.pictures.plan_bars import FAILED, NOT_SIMULATED, PlanBar

_LEFT_PX, _RIGHT_PX, _TOP_PX = 12.0, 18.0, 8.0
_ROW_PX, _BAR_PX, _AXIS_PX, _LEGEND_PX = 34.0, 24.0, 38.0, 26.0
_MOST_NAME_PX, _LEAST_PX = 220.0, 7.5
_TICKS = 8


def gantt_picture(bars: Sequence[PlanBar], title: str, width_px: float = 960.0) -> Drawing:
    """Return bars on a time line, a row for every agent and tool.

    Parameters
    ----------
    bars
        At least one.
    title
        What it shows.
    width_px
        How wide it is.

    Raises
    ------
    ValueError
        If there is no bar.
    """
    if not bars:
        raise ValueError("A Gantt chart needs at least one bar.")
    rows = list(dict.fromkeys(bar.row for bar in bars))
    kinds = list(dict.fromkeys(bar.kind for bar in bars))
    end_s = max(max(bar.end_s for bar in bars), 1e-9)
    names_px = min(_MOST_NAME_PX, max(text_width_px(row) for row in rows)) + 12
    left, right = _LEFT_PX + names_px, width_px - _RIGHT_PX
    bottom = _TOP_PX + _ROW_PX * len(rows)
    scale = (right - left) / end_s
    items: list[Item] = list(_axis(left, right, bottom, end_s))
    for number, row in enumerate(rows):
        middle = _TOP_PX + _ROW_PX * (number + 0.5)
        name = shortened(row, names_px - 8)
        items.append(Label((left - 8, middle), name, anchor="end"))
        if number:
            edge = _TOP_PX + _ROW_PX * number
            line = ((left, edge), (right, edge))
            items.append(Shape(line, Look(stroke="faint", width_px=0.6), closed=False))
    for bar in bars:
        middle = _TOP_PX + _ROW_PX * (rows.index(bar.row) + 0.5)
        role = SERIES[kinds.index(bar.kind) % len(SERIES)]
        items += _bar(bar, left + scale * bar.start_s, left + scale * bar.end_s, middle, role)
    numbered = any(
        bar.short.isdigit() and _words(bar, scale * (bar.end_s - bar.start_s))[0] == bar.short
        for bar in bars
    )
    items += _legend(kinds, left, bottom + _AXIS_PX + 10, numbered=numbered)
    height_px = bottom + _AXIS_PX + _LEGEND_PX
    marks = [mark for mark in (FAILED, NOT_SIMULATED) if any(bar.mark == mark for bar in bars)]
    if marks:
        items += _marks_legend(marks, left, height_px)
        height_px += _LEGEND_PX
    for bar in bars:
        if bar.mark == FAILED:
            items += _failure(left + scale * bar.end_s, _TOP_PX, bottom)
    return Drawing(width_px, height_px, title, tuple(items), (left, right, _TOP_PX - 4, bottom + 4))


def _bar(bar: PlanBar, left: float, right: float, middle: float, role: str) -> Iterator[Item]:
    top, bottom = middle - _BAR_PX / 2, middle + _BAR_PX / 2
    right = max(right, left + 1.0)
    look = Look(fill=role, stroke="paper", width_px=1.0, opacity=0.45)
    if bar.mark:
        look = _MARKS[bar.mark](role)
    yield Shape(rectangle(left, top, right, bottom), look, title=bar.title, seek_s=bar.start_s)
    edge = rectangle(left, top, left + min(3.0, right - left), bottom)
    yield Shape(edge, Look(fill=role))
    words, size_px = _words(bar, right - left)
    if words:
        yield Label(((left + right) / 2 + 1.5, middle), words, size_px=size_px)


def _failure(at: float, top: float, bottom: float) -> Iterator[Item]:
    """Yield a line across all rows where a simulation fails."""
    look = Look(stroke="red", width_px=1.5, dashed=True)
    yield Shape(((at, top), (at, bottom)), look, closed=False)


def _marks_legend(marks: Sequence[str], left: float, middle: float) -> Iterator[Item]:
    for mark in marks:
        square = rectangle(left, middle - 5, left + 10, middle + 5)
        yield Shape(square, _MARKS[mark]("grey"))
        yield Label((left + 15, middle), mark, "muted", SMALL_PX, "start")
        left += 30 + text_width_px(mark, SMALL_PX)


_MARKS = {
    FAILED: lambda role: Look(fill=role, stroke="red", width_px=2.5, opacity=0.45),
    NOT_SIMULATED: lambda role: Look(fill=role, stroke=role, dashed=True, opacity=0.12),
}
"""Looks of marked bars, by the role of their kind."""


def _words(bar: PlanBar, width_px: float) -> tuple[str, float]:
    """Return what is written into a bar, and how large [px]; nothing where there is no room."""
    room_px = width_px - 6
    for words in (bar.label, bar.short):
        wide_px = text_width_px(words, SMALL_PX)
        size_px = min(SMALL_PX, SMALL_PX * room_px / wide_px) if wide_px else 0.0
        if size_px >= _LEAST_PX:
            return words, size_px
    return ("" if bar.short else shortened(bar.label, room_px + 0.5, _LEAST_PX)), _LEAST_PX


def _axis(left: float, right: float, bottom: float, end_s: float) -> Iterator[Item]:
    step_s = _round_step(end_s / _TICKS)
    for number in range(int(end_s / step_s + 1e-9) + 1):
        x = left + (right - left) * number * step_s / end_s
        yield Shape(((x, _TOP_PX), (x, bottom)), Look(stroke="faint", width_px=0.8), closed=False)
        yield Label((x, bottom + 12), f"{number * step_s:g}", "muted", SMALL_PX)
    yield Shape(((left, bottom), (right, bottom)), Look(stroke="muted"), closed=False)
    yield Label(((left + right) / 2, bottom + 27), "time [s]", "muted", SMALL_PX)


def _legend(kinds: Sequence[str], left: float, middle: float, *, numbered: bool) -> Iterator[Item]:
    for number, kind in enumerate(kinds):
        role = SERIES[number % len(SERIES)]
        square = rectangle(left, middle - 5, left + 10, middle + 5)
        yield Shape(square, Look(fill=role, stroke=role, opacity=0.45))
        yield Label((left + 15, middle), kind, "muted", SMALL_PX, "start")
        left += 30 + text_width_px(kind, SMALL_PX)
    if numbered:
        words = "a number: the step, where its bar is too narrow for a name"
        yield Label((left, middle), words, "muted", SMALL_PX, "start")


def _round_step(about: float) -> float:
    """Return 1, 2 or 5 times a power of ten, no less than a number."""
    power = 10.0 ** math.floor(math.log10(about))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= about * (1 - 1e-9))
