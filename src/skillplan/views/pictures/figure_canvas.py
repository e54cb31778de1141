"""A picture drawn by matplotlib."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from skillplan.views.figures.figure_style import Heading, axes_in, in_house_style, sheet
from skillplan.views.pictures.drawing import COLOURS, PIXELS_PER_IN, Disc, Drawing, Label, Look

_MARGIN_IN = 0.2
_HAIR_PX = 0.5
_ANCHORS = {"middle": "center", "start": "left", "end": "right"}


@in_house_style
def picture_figure(drawing: Drawing, heading: Heading) -> Figure:
    """Return a picture as a figure below a heading."""
    wide_in, tall_in = drawing.width_px / PIXELS_PER_IN, drawing.height_px / PIXELS_PER_IN
    width_in = wide_in + 2 * _MARGIN_IN
    height_in = tall_in + heading.height_in(width_in - 0.4) + _MARGIN_IN
    figure = sheet(width_in, height_in, heading)
    axes = axes_in(figure, _MARGIN_IN, _MARGIN_IN, wide_in, tall_in)
    axes.set_axis_off()
    axes.set_xlim(0, drawing.width_px)
    axes.set_ylim(drawing.height_px, 0)
    for order, item in enumerate(drawing.items):
        if isinstance(item, Label):
            _write(axes, item, order)
        elif isinstance(item, Disc):
            axes.add_patch(Circle(item.centre, item.radius_px, zorder=order, **_style(item.look)))
        else:
            style = _style(item.look)
            axes.add_patch(Polygon(item.points, closed=item.closed, zorder=order, **style))
    return figure


def _write(axes: Axes, label: Label, order: int) -> None:
    # A rim about the letters would make them outlines: they stay text on a patch of paper.
    patch = {"facecolor": COLOURS["paper"], "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
    axes.text(
        *label.at,
        label.text,
        ha=_ANCHORS[label.anchor],
        va="center_baseline",
        size=label.size_px * 72 / PIXELS_PER_IN,
        color=COLOURS[label.role],
        weight="bold" if label.bold else "normal",
        zorder=order,
        bbox=patch if label.halo else None,
    )


def _style(look: Look) -> dict[str, object]:
    """Return a look in matplotlib's words."""
    fill: object = "none"
    if look.fill is not None:
        red, green, blue = (value * (1 - look.shade) for value in to_rgb(COLOURS[look.fill]))
        fill = (red, green, blue, look.opacity)
    edge: object = "none" if look.stroke is None else to_hex(COLOURS[look.stroke])
    sealed = look.sealed and look.stroke is None
    width_px = _HAIR_PX if sealed else look.width_px
    return {
        "facecolor": fill,
        "edgecolor": fill if sealed else edge,
        "linewidth": width_px * 72 / PIXELS_PER_IN,
        "linestyle": (0, (4, 3)) if look.dashed else "-",
        "joinstyle": "round",
    }
