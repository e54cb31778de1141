"""A picture before it is drawn: shapes, discs and labels in pixels, colours by their role.

One picture serves two canvases: a file of matplotlib has fixed colours, a page those of the
reader's scheme, dark or light.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from skillplan.views.figures.colours import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    INK,
    MUTED,
    OLIVE,
    ORANGE,
    PAPER,
    PURPLE,
    RED,
    SKY,
)
from skillplan.views.figures.text_width import text_width_in

Point = tuple[float, float]

COLOURS = {
    "ink": INK,
    "muted": MUTED,
    "faint": FAINT,
    "paper": PAPER,
    "blue": BLUE,
    "orange": ORANGE,
    "green": GREEN,
    "red": RED,
    "purple": PURPLE,
    "sky": SKY,
    "olive": OLIVE,
    "grey": GREY,
}
"""Colour of each role on paper."""

SERIES = ("blue", "orange", "green", "purple", "sky", "red", "olive", "grey")
"""Roles of things that are told apart, in turn."""

PIXELS_PER_IN = 96.0
TEXT_PX, SMALL_PX = 12.0, 10.0


@dataclass(frozen=True, slots=True)
class Look:
    """How a shape is drawn.

    Parameters
    ----------
    fill, stroke
        Roles of `COLOURS`; None for none.
    width_px
        Of the stroke, > 0 [px].
    dashed
        Whether the stroke is broken.
    opacity
        Of the fill, in (0, 1].
    shade
        How much darker the fill is, from 0 to 1.
    sealed
        Whether the fill reaches a hair's breadth beyond the edge, so that none is left to a
        neighbour of the same surface.

    Raises
    ------
    ValueError
        If a role is unknown, or a number is out of range.
    """

    fill: str | None = None
    stroke: str | None = None
    width_px: float = 1.0
    dashed: bool = False
    opacity: float = 1.0
    shade: float = 0.0
    sealed: bool = False

    def __post_init__(self) -> None:
        for role in (self.fill, self.stroke):
            if role is not None and role not in COLOURS:
                raise ValueError(f"{role!r} is none of the roles {', '.join(COLOURS)}.")
        if not (self.width_px > 0 and 0 < self.opacity <= 1 and 0 <= self.shade <= 1):
            raise ValueError(f"A shape cannot look like {self}.")


@dataclass(frozen=True, slots=True)
class Shape:
    """A polygon, or a line where it has no fill.

    Parameters
    ----------
    points
        At least two [px]; x to the right, y down.
    look
        How it is drawn.
    closed
        Whether its last point is joined to the first.
    title
        What a page says where the pointer rests on it; empty for nothing.
    seek_s
        Of a bar, the moment that a page goes to where it is chosen [s]; None for none.
    """

    points: tuple[Point, ...]
    look: Look
    closed: bool = True
    title: str = ""
    seek_s: float | None = None

    def __post_init__(self) -> None:
        if len(self.points) < 2:
            raise ValueError("A shape has at least two points.")


@dataclass(frozen=True, slots=True)
class Disc:
    """A circle about a point, of a radius > 0 [px]."""

    centre: Point
    radius_px: float
    look: Look
    title: str = ""


@dataclass(frozen=True, slots=True)
class Label:
    """A line of text.

    Parameters
    ----------
    at
        Where its middle, left or right end is, in the middle of its height [px].
    text
        Any text; canvases escape it.
    role
        Of `COLOURS`.
    size_px
        Height of the font, > 0.
    anchor
        ``middle``, ``start`` or ``end``.
    bold
        Whether it is.
    halo
        Whether it keeps what is behind it off by a rim of the paper's colour.
    """

    at: Point
    text: str
    role: str = "ink"
    size_px: float = TEXT_PX
    anchor: str = "middle"
    bold: bool = False
    halo: bool = False


Item = Shape | Disc | Label


@dataclass(frozen=True)
class Drawing:
    """A picture.

    Parameters
    ----------
    width_px, height_px
        Its size, > 0.
    title
        What it shows, in a few words.
    items
        From the back to the front.
    cursor
        Of a time line: where time 0 and its end are, top and bottom [px]; None of other pictures.

    Raises
    ------
    ValueError
        If a side is not positive.
    """

    width_px: float
    height_px: float
    title: str
    items: tuple[Item, ...] = field(default=(), repr=False)
    cursor: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        if not (self.width_px > 0 and self.height_px > 0):
            raise ValueError(f"A picture cannot be {self.width_px} x {self.height_px} px.")


def text_width_px(text: str, size_px: float = TEXT_PX) -> float:
    """Return how wide a text is [px]."""
    return PIXELS_PER_IN * text_width_in(text, size_px * 72 / PIXELS_PER_IN)


def shortened(text: str, width_px: float, size_px: float = TEXT_PX) -> str:
    """Return a text, or as much of its beginning as fits with an ellipsis; empty for none."""
    if text_width_px(text, size_px) <= width_px:
        return text
    while text and text_width_px(f"{text}\N{HORIZONTAL ELLIPSIS}", size_px) > width_px:
        text = text[:-1]
    return f"{text.rstrip()}\N{HORIZONTAL ELLIPSIS}" if len(text) > 1 else ""


def rectangle(left: float, top: float, right: float, bottom: float) -> tuple[Point, ...]:
    """Return the corners of an upright rectangle [px]."""
    return ((left, top), (right, top), (right, bottom), (left, bottom))


def arrow(
    start: Point, end: Point, look: Look, *, short_px: float = 0.0, head_px: float = 7.0
) -> Iterable[Shape]:
    """Yield a straight arrow that ends a little before its goal.

    Parameters
    ----------
    start, end
        Where from and to [px].
    look
        Of the line; the head is filled with its stroke.
    short_px, head_px
        How much is left out at the end, and how long the head is.
    """
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy)
    if length <= short_px + 1e-9:
        return
    ux, uy = dx / length, dy / length
    tip = (end[0] - short_px * ux, end[1] - short_px * uy)
    head = min(head_px, length - short_px)
    neck = (tip[0] - head * ux, tip[1] - head * uy)
    yield Shape((start, neck), look, closed=False)
    half = 0.42 * head
    wings = ((neck[0] - half * uy, neck[1] + half * ux), (neck[0] + half * uy, neck[1] - half * ux))
    yield Shape((tip, *wings), Look(fill=look.stroke, opacity=look.opacity))


def hull(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return the corners of the convex hull of some points (Andrew's monotone chain)."""
    left = sorted(set(points))
    if len(left) < 3:
        return tuple(left)

    def half(ordered: Iterable[Point]) -> list[Point]:
        chain: list[Point] = []
        for point in ordered:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        return chain[:-1]

    return (*half(left), *half(reversed(left)))


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
