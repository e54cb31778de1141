"""The common style of figures: colours, fonts, headings and empty sheets.

The palette of Okabe and Ito ("Color universal design", 2008) is safe for people with common colour
vision deficiencies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FuncFormatter

INK = "#1a1a1a"
MUTED = "#5f6368"
FAINT = "#c9cdd2"
PAPER = "#ffffff"
BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
PURPLE, SKY, OLIVE, GREY = "#cc79a7", "#56b4e9", "#8a7a00", "#6e6e6e"
PALETTE = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, OLIVE, GREY)


@lru_cache(maxsize=4096)
def measure_text_in(text: str, size_pt: float) -> float:
    """Return the width of a text [in] at a font size [pt]."""
    if not text.strip():
        return 0.0
    font = FontProperties(family="DejaVu Sans")
    outlines, codes = text_to_path.get_text_path(font, text, ismath=False)
    drawn_pt = np.asarray(outlines)[np.asarray(codes) != Path.CLOSEPOLY, 0]
    # Glyph outlines have points at their extremes, so the curves need no bounds of their own.
    drawn_pt = drawn_pt * (size_pt / text_to_path.FONT_SCALE)
    return float(drawn_pt.max() - drawn_pt.min()) / 72


TITLE_PT, TEXT_PT, SMALL_PT, LEAST_PT = 12.0, 9.0, 7.5, 4.5
TITLE_IN = 0.30
LINE_IN = 0.18
LEAST_WIDTH_IN = 5.5

_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
    "font.size": TEXT_PT,
    "axes.labelsize": TEXT_PT,
    "axes.titlesize": TEXT_PT + 1,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "grid.color": "#e3e5e8",
    "grid.linewidth": 0.6,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "text.color": INK,
    "legend.fontsize": SMALL_PT + 0.5,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "hatch.linewidth": 0.6,
    # A dollar in a name is a dollar.
    "text.parse_math": False,
    # Text stays text, and equal figures are equal files.
    "svg.fonttype": "none",
    "svg.hashsalt": "skillplan",
}

_P = ParamSpec("_P")
_R = TypeVar("_R")


@dataclass(frozen=True, slots=True)
class Heading:
    """The heading of a figure.

    Parameters
    ----------
    title
        Subject of the figure.
    details
        Task, solver, seed and parameters.
    """

    title: str
    details: str = ""

    def lines(self, width_in: float) -> list[str]:
        """Return the details as lines that fit into a width [in]."""
        return _wrap(self.details, SMALL_PT + 0.5, width_in) if self.details else []

    def title_lines(self, width_in: float) -> list[str]:
        """Return the title as lines that fit into a width [in]."""
        return _wrap(self.title, 1.12 * TITLE_PT, width_in)

    def height_in(self, width_in: float) -> float:
        """Return the height of the heading at a width [in]."""
        titles, lines = len(self.title_lines(width_in)), len(self.lines(width_in))
        return 0.22 + TITLE_IN * titles + LINE_IN * lines


def _wrap(text: str, size_pt: float, width_in: float) -> list[str]:
    """Return a text as lines no wider than a width [in]; longer words stay whole."""
    lines: list[str] = []
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and measure_text_in(longer, size_pt) <= width_in:
            lines[-1] = longer
        else:
            lines.append(word)
    return [line.strip() for line in lines]


def darken_colour(colour: str) -> str:
    """Return a colour of the same hue that is dark enough to read on white."""
    red, green, blue = to_rgb(colour)
    light = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    share = min(1.0, 0.36 / max(light, 1e-9))
    return str(to_hex((share * red, share * green, share * blue)))


@contextmanager
def apply_house_style() -> Iterator[None]:
    """Apply the style of this package and ignore the user's matplotlibrc."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


def in_house_style(draw: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function so that it draws in the house style."""

    @wraps(draw)
    def styled(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with apply_house_style():
            return draw(*args, **kwargs)

    return styled


def create_sheet(width_in: float, height_in: float, heading: Heading) -> Figure:
    """Return a figure of a size [in] with a heading only.

    Raises
    ------
    ValueError
        If a side is not > 0.
    """
    if not (width_in > 0 and height_in > 0):
        raise ValueError(f"A figure cannot be {width_in} x {height_in} in.")
    figure = Figure(figsize=(width_in, height_in), facecolor=PAPER)
    write_heading(figure, heading)
    return figure


def write_heading(figure: Figure, heading: Heading) -> None:
    """Write a heading at the top of a figure."""
    width_in, height_in = figure.get_size_inches()
    left, down = 0.2, 0.12

    def write(line: str, **style: Any) -> None:
        figure.text(left / width_in, 1 - down / height_in, line, va="top", ha="left", **style)

    for line in heading.title_lines(width_in - 2 * left):
        write(line, size=TITLE_PT, weight="bold")
        down += TITLE_IN
    for line in heading.lines(width_in - 2 * left):
        write(line, size=SMALL_PT + 0.5, color=MUTED)
        down += LINE_IN


def add_axes_in(
    figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float
) -> Axes:
    """Return axes whose lower left corner and size are given in inches."""
    whole_w, whole_h = figure.get_size_inches()
    return figure.add_axes(
        (left_in / whole_w, bottom_in / whole_h, width_in / whole_w, height_in / whole_h)
    )


def label_log_axis(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers, also between powers of ten if few fit.

    The labels of matplotlib are formulas, which the house style does not parse.
    """

    def between(value: float, _: int | None) -> str:
        low, high = sorted(axis.get_view_interval())
        digit = round(value / 10 ** math.floor(math.log10(value) + 1e-9))
        decades = math.log10(high / low)
        shown = decades < 1 or (decades < 2 and digit in (2, 5))
        return f"{value:,.10g}" if shown else ""

    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
    axis.set_minor_formatter(FuncFormatter(between))


def fit_legend(labels: list[str], width_in: float) -> tuple[int, float]:
    """Return the number of columns of a legend below a figure, and its height [in]."""
    if not labels:
        return 1, 0.0
    widest = max(measure_text_in(label, SMALL_PT + 0.5) for label in labels)
    columns = min(len(labels), max(1, int(width_in / (widest + 0.62))))
    rows = -(-len(labels) // columns)
    return columns, 0.21 * rows + 0.12
