"""Figures as PNG or SVG files. Equal figures make equal bytes, and files are written atomically."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.text import Text

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.output_path import check_output_path
from skillplan.views.figures.figure_style import apply_house_style
from skillplan.views.text.wording import escape

SUFFIXES = (".png", ".svg")
DOT = ".dot"
"""Suffix of a graph in the language of Graphviz."""


def render_figure(figure: Figure, suffix: str, dpi: int = 150) -> bytes:
    """Return a figure as PNG or SVG, without a date or the version of a program.

    Parameters
    ----------
    suffix
        ``.png`` or ``.svg``.
    dpi
        Dots per inch of a PNG, > 0.

    Raises
    ------
    ValueError
        If the suffix is unknown.
    """
    if suffix not in SUFFIXES:
        raise ValueError(f"A figure is saved as one of {', '.join(SUFFIXES)}, not {suffix!r}.")
    content = io.BytesIO()
    # Titles and labels contain names from documents.
    texts = [(text, text.get_text()) for text in figure.findobj(Text)]
    for text, words in texts:
        text.set_text(escape(words))
    for image in figure.findobj(AxesImage):
        # An SVG holds images as they are; a PNG resamples them.
        image.set_interpolation("none" if suffix == ".svg" else "antialiased")
    with apply_house_style(), warnings.catch_warnings():
        # Characters that the font lacks are drawn as boxes.
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from font")
        if suffix == ".png":
            FigureCanvasAgg(figure)
            figure.savefig(content, format="png", dpi=dpi, metadata={"Software": None})
        else:
            FigureCanvasSVG(figure)
            nothing = {"Date": None, "Creator": None}
            figure.savefig(content, format="svg", metadata=nothing)
    for text, words in texts:
        text.set_text(words)
    return content.getvalue()


def check_path(out: str, more: tuple[str, ...] = ()) -> Path:
    """Return the path of a figure, and check before solving that it can be written.

    Parameters
    ----------
    out
        The user's file name.

    Raises
    ------
    OptionError
        If the suffix is unknown, or the folder is missing or closed to writing.
    """
    return check_output_path("--out", out, (*SUFFIXES, *more), "figures")


def save_figure(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a figure in the format of the suffix, and replace an old file.

    Raises
    ------
    OptionError
        If it cannot be written; an old file stays.
    """
    save_content(render_figure(figure, path.suffix.lower(), dpi), path)


def save_content(content: bytes | str, path: Path) -> None:
    """Write the content of a figure file, and replace an old file.

    Raises
    ------
    OptionError
        If it cannot be written; an old file stays.
    """
    try:
        write_whole(path, content)
    except OSError as error:
        raise OptionError(f"--out {path}: cannot be written: {error.strerror}.") from None
