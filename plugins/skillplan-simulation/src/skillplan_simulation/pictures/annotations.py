"""Annotations on pictures: a caption, name tags, and an arrow at a contact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from skillplan.physics.performance import FIELD_OF_VIEW_DEG, Image, View
from skillplan.task.motion import Point

Pixel = tuple[float, float]
Rectangle = tuple[float, float, float, float]

# Relative to a picture's height: letters of caption and tags, arrow, margin, and free distance
# around a named point.
_LETTERS, _TAG_LETTERS, _ARROW, _MARGIN, _ABOUT = 0.031, 0.023, 0.14, 0.012, 0.016
_INK, _PAPER, _STRIP = (24, 26, 32), (255, 255, 255, 215), (40, 42, 48, 190)
_ARROW_COLOUR = (20, 30, 190)


@dataclass(frozen=True, slots=True)
class Notes:
    """Annotations of a picture.

    Parameters
    ----------
    caption
        Caption; may be empty.
    tags
        Names, and the named points [m].
    contact
        Point for the arrow [m], or None.
    """

    caption: str = ""
    tags: tuple[tuple[str, Point], ...] = ()
    contact: Point | None = None


def annotate(width: int, height: int, rgb: bytes, view: View, notes: Notes) -> Image:
    """Return a picture with annotations.

    Parameters
    ----------
    width, height, rgb
        Picture as in :class:`Image`.
    """
    if not (notes.caption or notes.tags or notes.contact):
        return Image(width, height, rgb)
    from PIL import Image as PillowImage
    from PIL import ImageDraw

    picture = PillowImage.frombytes("RGB", (width, height), rgb)
    # The annotations are translucent.
    pen = ImageDraw.Draw(picture, "RGBA")
    seen = Projection(view, width, height)
    taken = _write_caption(pen, notes.caption, height)
    if notes.contact is not None:
        _draw_arrow(pen, seen.pixel(notes.contact), height)
    _write_tags(pen, [(name, seen.pixel(at)) for name, at in notes.tags], (width, height), taken)
    return Image(width, height, picture.tobytes())


class Projection:
    """Projects points of the world onto a picture.

    Parameters
    ----------
    width, height
        Size of the picture [pixels].
    """

    def __init__(self, view: View, width: int, height: int) -> None:
        self._right, self._up, self._back = view.angle.axes
        self.eye = tuple(
            at + view.distance_m * back for at, back in zip(view.target, self._back, strict=True)
        )
        self._middle = width / 2, height / 2
        self.focal = height / 2 / math.tan(math.radians(FIELD_OF_VIEW_DEG) / 2)

    def pixel(self, point: Point) -> Pixel | None:
        """Return the pixel of a point, from the upper left; None behind the camera."""
        away = [value - eye for value, eye in zip(point, self.eye, strict=True)]
        x, y, z = (
            sum(own * other for own, other in zip(axis, away, strict=True))
            for axis in (self._right, self._up, self._back)
        )
        if z >= -1e-6:
            return None
        scale = self.focal / -z
        return self._middle[0] + scale * x, self._middle[1] - scale * y


def _write_caption(pen: Any, words: str, height: int) -> list[Rectangle]:
    """Write a caption in the lower left corner; return the covered rectangle."""
    if not words:
        return []
    margin, font = height * _MARGIN, _load_font(round(height * _LETTERS))
    left, _, right, _ = pen.textbbox((0, 0), words, font=font)
    ascent, descent = font.getmetrics()
    strip = (
        margin,
        height - 3 * margin - ascent - descent,
        3 * margin + right - left,
        height - margin,
    )
    pen.rounded_rectangle(strip, radius=margin / 2, fill=_STRIP)
    pen.text((2 * margin - left, strip[1] + margin), words, font=font, fill=(255, 255, 255))
    return [strip]


def _write_tags(
    pen: Any,
    tags: Iterable[tuple[str, Pixel | None]],
    size: tuple[int, int],
    taken: list[Rectangle],
) -> None:
    """Write names near the named points, in free space, with a line to the point."""
    width, height = size
    font = _load_font(round(height * _TAG_LETTERS))
    ascent, descent = font.getmetrics()
    edge, about = height * _MARGIN / 3, height * _ABOUT
    seen = [
        (name, at)
        for name, at in tags
        if at is not None and 0 <= at[0] < width and 0 <= at[1] < height
    ]
    if not seen:
        return
    middle = tuple(sum(at[axis] for _, at in seen) / len(seen) for axis in (0, 1))
    # Place labels so that none covers another labelled point.
    taken = [*taken, *((x - about, y - about, x + about, y + about) for _, (x, y) in seen)]
    high = ascent + descent + 2 * edge
    for name, at in seen:
        wide = pen.textlength(name, font=font) + 2 * edge
        outwards = math.atan2(middle[1] - at[1], at[0] - middle[0])
        spot = _find_free_spot(at, (wide, high), size, taken, outwards)
        taken.append(spot)
        end = min(max(at[0], spot[0]), spot[2]), min(max(at[1], spot[1]), spot[3])
        pen.line([at, end], fill=(*_INK, 190), width=max(1, round(height / 500)))
        dot = height / 240
        pen.ellipse((at[0] - dot, at[1] - dot, at[0] + dot, at[1] + dot), fill=_INK)
        pen.rounded_rectangle(spot, radius=edge, fill=_PAPER)
        pen.text((spot[0] + edge, spot[1] + edge), name, font=font, fill=_INK)


def _find_free_spot(
    at: Pixel,
    extent: tuple[float, float],
    size: tuple[int, int],
    taken: Sequence[Rectangle],
    outwards: float,
) -> Rectangle:
    """Return the nearest free place of a tag, preferably in one direction."""
    wide, high = extent
    spots = []
    for ring in range(1, 9):
        for turn in range(12):
            angle = outwards + (-1) ** turn * ((turn + 1) // 2) * math.pi / 6
            x = at[0] + math.cos(angle) * (wide / 2 + ring * high * 0.6)
            y = at[1] - math.sin(angle) * (0.4 + ring) * high
            spot = (x - wide / 2, y - high / 2, x + wide / 2, y + high / 2)
            spots.append(spot)
            inside = spot[0] >= 0 and spot[1] >= 0 and spot[2] <= size[0] and spot[3] <= size[1]
            if inside and not any(_is_overlapping(spot, other) for other in taken):
                return spot
    return spots[0]


def _is_overlapping(spot: Rectangle, other: Rectangle) -> bool:
    return spot[0] < other[2] and other[0] < spot[2] and spot[1] < other[3] and other[1] < spot[3]


def _draw_arrow(pen: Any, tip: Pixel | None, height: int) -> None:
    """Draw an arrow to a point from the upper left."""
    if tip is None:
        return
    long, thin = height * _ARROW, height / 220
    along = math.sqrt(0.5), math.sqrt(0.5)
    across = -along[1], along[0]

    def place(behind: float, aside: float) -> Pixel:
        return (
            tip[0] - behind * along[0] + aside * across[0],
            tip[1] - behind * along[1] + aside * across[1],
        )

    head, wide = 5 * thin, 2.6 * thin
    outline = [
        tip,
        place(head, wide),
        place(head, thin),
        place(long, thin),
        place(long, -thin),
        place(head, -thin),
        place(head, -wide),
    ]
    pen.line(
        [*outline, outline[0], outline[1]], fill=(255, 255, 255), width=round(thin), joint="curve"
    )
    pen.polygon(outline, fill=_ARROW_COLOUR)


@cache
def _load_font(size: int) -> Any:
    """Return the font of figures in a size."""
    from PIL import ImageFont

    spec = find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / "DejaVuSans.ttf"), size)
