"""Figures of matplotlib within a page."""

from __future__ import annotations

import base64

from matplotlib.figure import Figure

from skillplan.views.figures.figure_file import figure_bytes
from skillplan.views.report.markup import Markup, tag

_DPI = 130


def image(figure: Figure, description: str, caption: str) -> Markup:
    """Return a figure as an image within the page, with its caption."""
    data = base64.b64encode(figure_bytes(figure, ".png", _DPI)).decode("ascii")
    wide, tall = figure.get_size_inches()
    attributes = {
        "class": "picture",
        "src": f"data:image/png;base64,{data}",
        "alt": description,
        "width": round(96 * wide),
        "height": round(96 * tall),
    }
    return tag("figure", {}, tag("img", attributes), tag("figcaption", {}, caption))
