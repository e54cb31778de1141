"""A picture in pixels, drawn by matplotlib: for files, and with themed colours for pages."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, PathPatch, Polygon
from matplotlib.path import Path

from skillplan.views.figures import figure_style as style
from skillplan.views.figures.solids import Bytes, Point

COLOURS: Mapping[str, str] = {
    "ink": style.INK,
    "muted": style.MUTED,
    "faint": style.FAINT,
    "paper": style.PAPER,
    "blue": style.BLUE,
    "orange": style.ORANGE,
    "green": style.GREEN,
    "red": style.RED,
    "purple": style.PURPLE,
    "sky": style.SKY,
    "olive": style.OLIVE,
    "grey": style.GREY,
    # Farthest from the others and from each other in OKLab, also with red or green missing.
    "indigo": "#330099",
    "violet": "#7700ff",
    "maroon": "#881100",
    "lilac": "#8877ff",
    "petrol": "#004455",
    "mint": "#66cc88",
    "magenta": "#cc11aa",
    "plum": "#773388",
}
"""Colours on paper by role. A page has other colours for the same roles in its dark theme."""

SERIES = (
    *("blue", "orange", "green", "purple", "sky", "red", "olive", "grey"),
    *("indigo", "mint", "maroon", "lilac", "petrol", "magenta", "violet", "plum"),
)
"""Roles of the members of a series, in order; with more members they repeat."""

PIXELS_PER_IN = 96.0
TEXT_PX, SMALL_PX = 12.0, 10.0
_PT_PER_PX = 72 / PIXELS_PER_IN
_ANCHORS = {"middle": "center", "start": "left", "end": "right"}


@dataclass(frozen=True, slots=True)
class Note:
    """Text and time that a page attaches to a shape.

    Parameters
    ----------
    title
        Text that appears when the pointer rests on the shape.
    seek_s
        Time to which the player jumps on a click [s]; None for none.
    """

    title: str = ""
    seek_s: float | None = None


class Picture:
    """A sheet of pixels with x to the right and y down. Later shapes cover earlier ones.

    Parameters
    ----------
    width_px, height_px
        Size of the picture, > 0.
    title
        Title for readers who cannot see it.

    Attributes
    ----------
    notes
        Notes by the ``gid`` of the shape.
    cursor
        Left, right, top and bottom of the time axis [px]; None without a time axis.

    Raises
    ------
    ValueError
        If a side is not positive.
    """

    def __init__(self, width_px: float, height_px: float, title: str) -> None:
        if not (width_px > 0 and height_px > 0):
            raise ValueError(f"A picture cannot be {width_px} x {height_px} px.")
        self.width_px, self.height_px, self.title = width_px, height_px, title
        self.notes: dict[str, Note] = {}
        self.cursor: tuple[float, float, float, float] | None = None
        self.figure = Figure(
            figsize=(width_px / PIXELS_PER_IN, height_px / PIXELS_PER_IN), facecolor=style.PAPER
        )
        self._axes = self.figure.add_axes((0, 0, 1, 1))
        self._axes.set_axis_off()
        self._axes.set_xlim(0, width_px)
        self._axes.set_ylim(height_px, 0)
        self._order = 0

    @property
    def texts(self) -> list[str]:
        """All labels in the order in which they were written."""
        return [text.get_text() for text in self._axes.texts]

    def polygon(
        self,
        points: Sequence[Point],
        fill: str | None = None,
        stroke: str | None = None,
        width_px: float = 1.0,
        *,
        dashed: bool = False,
        opacity: float = 1.0,
        note: Note | None = None,
    ) -> None:
        """Draw a polygon.

        Parameters
        ----------
        points
            Corners [px].
        fill, stroke
            Roles of `COLOURS`; None for none.
        width_px
            Width of the stroke, > 0.
        opacity
            Opacity of the fill, in [0, 1].
        note
            Note for pages.
        """
        self._add(Polygon(points, closed=True), fill, stroke, width_px, dashed, opacity, note)

    def area(
        self,
        rings: Sequence[Sequence[Point]],
        fill: str | None,
        stroke: str | None = None,
        width_px: float = 1.0,
        *,
        opacity: float = 1.0,
    ) -> None:
        """Draw an area between rings, whose holes run the other way; parameters as of `polygon`."""
        if not rings:
            return
        path = Path.make_compound_path(*(Path([*ring, ring[0]], closed=True) for ring in rings))
        self._add(PathPatch(path), fill, stroke, width_px, False, opacity, None)

    def line(
        self,
        points: Sequence[Point],
        stroke: str,
        width_px: float = 1.0,
        *,
        dashed: bool = False,
        note: Note | None = None,
    ) -> None:
        """Draw an open polyline; parameters as of `polygon`."""
        self._add(Polygon(points, closed=False), None, stroke, width_px, dashed, 1.0, note)

    def disc(
        self,
        centre: Point,
        radius_px: float,
        fill: str | None = None,
        stroke: str | None = None,
        width_px: float = 1.0,
        *,
        opacity: float = 1.0,
        note: Note | None = None,
    ) -> None:
        """Draw a disc; parameters as of `polygon`."""
        self._add(Circle(centre, radius_px), fill, stroke, width_px, False, opacity, note)

    def arrow(
        self,
        start: Point,
        end: Point,
        stroke: str,
        width_px: float = 1.0,
        *,
        short_px: float = 0.0,
        head_px: float = 7.0,
    ) -> None:
        """Draw a straight arrow whose tip ends `short_px` before its end."""
        dx, dy = end[0] - start[0], end[1] - start[1]
        length = math.hypot(dx, dy)
        if length <= short_px + 1e-9:
            return
        ux, uy = dx / length, dy / length
        tip = (end[0] - short_px * ux, end[1] - short_px * uy)
        head = min(head_px, length - short_px)
        neck = (tip[0] - head * ux, tip[1] - head * uy)
        self.line((start, neck), stroke, width_px)
        half = 0.42 * head
        left = (neck[0] - half * uy, neck[1] + half * ux)
        right = (neck[0] + half * uy, neck[1] - half * ux)
        self.polygon((tip, left, right), fill=stroke)

    def label(
        self,
        at: Point,
        text: str,
        role: str = "ink",
        size_px: float = TEXT_PX,
        anchor: str = "middle",
        *,
        bold: bool = False,
        halo: bool = False,
    ) -> None:
        """Write a line of text.

        Parameters
        ----------
        at
            Place of the anchor at half the height of the text [px].
        text
            Any text; it is escaped in files and pages.
        role
            Role of `COLOURS`.
        size_px
            Font size, > 0.
        anchor
            ``middle``, ``start`` or ``end``.
        halo
            True for a patch of paper behind the text.
        """
        patch = {"facecolor": style.PAPER, "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
        self._axes.text(
            *at,
            text,
            ha=_ANCHORS[anchor],
            va="center_baseline",
            size=size_px * _PT_PER_PX,
            color=COLOURS[role],
            weight="bold" if bold else "normal",
            parse_math=False,
            bbox=patch if halo else None,
            zorder=self._next_order(),
        )

    def image(self, pixels: Bytes) -> None:
        """Draw an image with transparency over the whole picture, shape (h, w, 4)."""
        extent = (0.0, self.width_px, self.height_px, 0.0)
        self._axes.imshow(pixels, extent=extent, aspect="auto", zorder=self._next_order())

    def with_heading(self, heading: style.Heading) -> Figure:
        """Return the picture as a figure below a heading; the picture is used up."""
        return _put_below(self.figure, heading)

    def pixels(self, scale: float = 1.0) -> Bytes:
        """Return the picture as pixels, shape (h, w, 4)."""
        self.figure.set_dpi(PIXELS_PER_IN * scale)
        canvas: Any = FigureCanvasAgg(self.figure)
        with style.apply_house_style():
            canvas.draw()
        return np.array(canvas.buffer_rgba())

    def _add(
        self,
        patch: Patch,
        fill: str | None,
        stroke: str | None,
        width_px: float,
        dashed: bool,
        opacity: float,
        note: Note | None,
    ) -> None:
        patch.set(
            facecolor="none" if fill is None else (*to_rgb(COLOURS[fill]), opacity),
            edgecolor="none" if stroke is None else COLOURS[stroke],
            linewidth=width_px * _PT_PER_PX,
            linestyle=(0, (4, 3)) if dashed else "-",
            joinstyle="round",
            clip_on=False,
            zorder=self._next_order(),
        )
        if note is not None:
            patch.set_gid(f"note-{len(self.notes)}")
            self.notes[f"note-{len(self.notes)}"] = note
        self._axes.add_patch(patch)

    def _next_order(self) -> int:
        self._order += 1
        return self._order


@style.in_house_style
def _put_below(figure: Figure, heading: style.Heading) -> Figure:
    margin_in = 0.2
    wide_in, tall_in = figure.get_size_inches()
    width_in = wide_in + 2 * margin_in
    height_in = tall_in + heading.height_in(width_in - 0.4) + margin_in
    figure.set_size_inches(width_in, height_in)
    figure.axes[0].set_position(
        (margin_in / width_in, margin_in / height_in, wide_in / width_in, tall_in / height_in)
    )
    style.write_heading(figure, heading)
    return figure


def measure_text_px(text: str, size_px: float = TEXT_PX) -> float:
    """Return the width of a text [px]."""
    return PIXELS_PER_IN * style.measure_text_in(text, size_px * _PT_PER_PX)


def shorten(text: str, width_px: float, size_px: float = TEXT_PX) -> str:
    """Return a text, or as much of it as fits with an ellipsis; empty if nothing fits."""
    return _shorten(text, lambda kept: (text[:kept], ""), width_px, size_px)


def shorten_middle(text: str, width_px: float, size_px: float = TEXT_PX) -> str:
    """Return a text, or as much of its beginning and end as fits with an ellipsis between them."""
    return _shorten(
        text, lambda kept: (text[: kept // 2], text[kept // 2 - kept :]), width_px, size_px
    )


def _shorten(
    text: str, split: Callable[[int], tuple[str, str]], width_px: float, size_px: float
) -> str:
    """Return a text, or the two ends of it with the most characters that fit."""
    if measure_text_px(text, size_px) <= width_px:
        return text

    def cut(kept: int) -> str:
        head, tail = split(kept)
        return f"{head.rstrip()}\N{HORIZONTAL ELLIPSIS}{tail.lstrip()}"

    # In halves: to measure a text takes a millisecond, and products have hundreds of long names.
    counts = range(2, len(text))
    fits = bisect_left(counts, True, key=lambda n: measure_text_px(cut(n), size_px) > width_px)
    return cut(counts[fits - 1]) if fits else ""


def make_rectangle(left: float, top: float, right: float, bottom: float) -> tuple[Point, ...]:
    """Return the corners of an upright rectangle [px]."""
    return ((left, top), (right, top), (right, bottom), (left, bottom))


NUMBER_PX: Final = 9.5
"""Half the height of a row of numbers."""
_APART_PX = 2.0
# Bold text is wider by this factor.
_BOLDER = 1.15
# Largest distance of a row from its place, in heights of a row.
_MOST_ROWS = 5


@dataclass(frozen=True, slots=True)
class NumberRow:
    """Numbers of the steps that end at a place.

    Parameters
    ----------
    centre
        Centre of the row [px]: the place itself, or near it.
    """

    at: Point
    centre: Point
    half_px: float
    numbers: tuple[int, ...]

    def draw_leader(self, picture: Picture) -> None:
        """Draw a line from the place to a row that is not there. Leaders belong behind all rows."""
        if self.centre != self.at:
            picture.line((self.at, self.centre), "ink", 0.8)
            picture.disc(self.at, 2.5, "ink")

    def draw(self, picture: Picture, title: str) -> None:
        """Draw the numbers in a rectangle with round ends."""
        points = []
        for turn in range(24):
            angle = -math.pi / 2 + 2 * math.pi * (turn + 0.5) / 24
            side = (self.half_px - NUMBER_PX) * (1 if math.cos(angle) > 0 else -1)
            x = self.centre[0] + side + NUMBER_PX * math.cos(angle)
            points.append((x, self.centre[1] + NUMBER_PX * math.sin(angle)))
        picture.polygon(points, "paper", "ink", 1.1, note=Note(title))
        picture.label(self.centre, _join(self.numbers), size_px=SMALL_PX, bold=True)


def place_number_rows(ends: Mapping[Point, Sequence[int]], room_px: Point) -> list[NumberRow]:
    """Return a row of numbers for each place, moved aside if it would cover another row.

    Parameters
    ----------
    ends
        Numbers by the place where their steps end [px].
    room_px
        Width and height of the area for rows.
    """
    halves = {
        at: max(NUMBER_PX, _BOLDER * measure_text_px(_join(numbers), SMALL_PX) / 2 + 4)
        for at, numbers in ends.items()
    }
    rows: list[NumberRow] = []
    # Short rows stay at their places.
    for at in sorted(ends, key=halves.__getitem__):
        centre = _find_free(at, halves[at], rows, room_px)
        rows.append(NumberRow(at, centre, halves[at], tuple(ends[at])))
    return rows


def _find_free(at: Point, half_px: float, rows: Sequence[NumberRow], room_px: Point) -> Point:
    """Return the nearest centre at which a row covers no other; the place itself if all do."""
    high = 2 * NUMBER_PX + _APART_PX
    shifts = [
        (across * half_px, down * high)
        for across in (0, -1, 1)
        for down in range(-_MOST_ROWS, _MOST_ROWS + 1)
    ]
    for across, down in sorted(shifts, key=lambda shift: math.hypot(*shift)):
        x, y = at[0] + across, at[1] + down
        inside = half_px <= x <= room_px[0] - half_px and NUMBER_PX <= y <= room_px[1] - NUMBER_PX
        if inside and not any(
            abs(x - row.centre[0]) < half_px + row.half_px + _APART_PX
            and abs(y - row.centre[1]) < high - 1e-9
            for row in rows
        ):
            return x, y
    return at


def _join(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))
