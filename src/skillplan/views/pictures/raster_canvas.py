"""A picture drawn pixel by pixel: many a second, for films."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillplan.physics.performance import Image
from skillplan.views.pictures.drawing import COLOURS, Disc, Drawing, Label, Look, Shape

if TYPE_CHECKING:
    from skillplan.views.pictures.depth_buffer import Bytes

FINER = 2
"""Drawn so many times larger, and made smaller again, edges are smooth."""

_ANCHORS = {"middle": "mm", "start": "lm", "end": "rm"}


def raster(drawing: Drawing, under: Bytes | None = None, scale: float = 1.0) -> Image:
    """Return a picture as pixels.

    Parameters
    ----------
    drawing
        The picture; dashes are drawn as lines.
    under
        What is there before, `FINER` times larger, shape (height, width, 3); None for paper.
    scale
        Pixels of the image for one of the drawing, > 0; 1 where something is there before.
    """
    from PIL import Image as PillowImage
    from PIL import ImageDraw

    size = (round(drawing.width_px * scale), round(drawing.height_px * scale))
    factor = scale * FINER
    if under is None:
        finer = (size[0] * FINER, size[1] * FINER)
        sheet = PillowImage.new("RGB", finer, COLOURS["paper"])
    else:
        sheet = PillowImage.fromarray(under)
    # Mixes a colour with what is there, as its opacity says.
    pen = ImageDraw.Draw(sheet, "RGBA")
    for item in drawing.items:
        if isinstance(item, Shape):
            _shape(pen, item, factor)
        elif isinstance(item, Disc):
            _disc(pen, item, factor)
        else:
            _write(pen, item, factor)
    smooth = sheet.resize(size, PillowImage.Resampling.BOX)
    return Image(*size, smooth.tobytes())


def _shape(pen: Any, shape: Shape, factor: float) -> None:
    points = [(x * factor, y * factor) for x, y in shape.points]
    look = shape.look
    if look.fill is not None and len(points) > 2:
        pen.polygon(points, fill=_fill(look))
    if look.stroke is not None:
        ring = [*points, points[0]] if shape.closed else points
        pen.line(ring, fill=rgb(look.stroke), width=_width(look, factor), joint="curve")


def _disc(pen: Any, disc: Disc, factor: float) -> None:
    (x, y), radius = disc.centre, disc.radius_px
    look = disc.look
    ends = (x - radius, y - radius, x + radius, y + radius)
    box = [value * factor for value in ends]
    outline = None if look.stroke is None else rgb(look.stroke)
    fill = None if look.fill is None else _fill(look)
    pen.ellipse(box, fill=fill, outline=outline, width=_width(look, factor))


def _write(pen: Any, label: Label, factor: float) -> None:
    x, y = label.at
    pen.text(
        (x * factor, y * factor),
        label.text,
        fill=rgb(label.role),
        anchor=_ANCHORS[label.anchor],
        font=_font(round(label.size_px * factor), label.bold),
    )


@lru_cache(maxsize=16)
def _font(size_px: int, bold: bool) -> Any:
    """Return the font of all figures, which matplotlib brings."""
    import matplotlib
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name, size_px)


def _width(look: Look, factor: float) -> int:
    return max(1, round(look.width_px * factor))


def _fill(look: Look) -> tuple[int, ...]:
    assert look.fill is not None
    channels = (round(value * (1 - look.shade)) for value in rgb(look.fill))
    return (*channels, round(255 * look.opacity))


@lru_cache(maxsize=len(COLOURS))
def rgb(role: str) -> tuple[int, int, int]:
    """Return the colour of a role, each channel from 0 to 255."""
    from PIL import ImageColor

    red, green, blue = ImageColor.getrgb(COLOURS[role])[:3]
    return (red, green, blue)
