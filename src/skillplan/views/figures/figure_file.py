"""Figures as files: PNG or SVG, equal bytes for equal figures, there whole or not at all."""

from __future__ import annotations

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.text import Text

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.output_path import output_path
from skillplan.views.figures.figure_style import house_style
from skillplan.views.text.wording import escaped

SUFFIXES = (".png", ".svg")
DOT = ".dot"
"""Suffix of a graph as text, of a figure that is one."""


def figure_bytes(figure: Figure, suffix: str, dpi: int = 150) -> bytes:
    """Return a figure as PNG or SVG; neither holds the date or the version of a program.

    Parameters
    ----------
    figure
        The figure.
    suffix
        ``.png`` or ``.svg``.
    dpi
        Dots per inch of a PNG, > 0.

    Raises
    ------
    ValueError
        If the suffix is another one.
    """
    if suffix not in SUFFIXES:
        raise ValueError(f"A figure is saved as one of {', '.join(SUFFIXES)}, not {suffix!r}.")
    made = io.BytesIO()
    for text in figure.findobj(Text):
        # Titles and labels hold names of documents.
        text.set_text(escaped(text.get_text()))
    for image in figure.findobj(AxesImage):
        # An SVG holds images as they are; a PNG resamples them.
        image.set_interpolation("none" if suffix == ".svg" else "antialiased")
    with house_style():
        if suffix == ".png":
            FigureCanvasAgg(figure)
            figure.savefig(made, format="png", dpi=dpi, metadata={"Software": None})
        else:
            FigureCanvasSVG(figure)
            nothing = {"Date": None, "Creator": None}
            figure.savefig(made, format="svg", metadata=nothing)
    return made.getvalue()


def checked_path(out: str, more: tuple[str, ...] = ()) -> Path:
    """Return where a figure goes, having seen that it can go there before anything is solved.

    Parameters
    ----------
    out
        The file as the user named it.
    more
        Suffixes that it may have beside those of all figures.

    Raises
    ------
    OptionError
        If the suffix is unknown, or the folder is missing or closed to writing.
    """
    return output_path("--out", out, (*SUFFIXES, *more), "figures")


def save_figure(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a figure in the format that the suffix says, replacing what was there.

    Raises
    ------
    OptionError
        If it cannot be written; what was there stays.
    """
    save_content(figure_bytes(figure, path.suffix.lower(), dpi), path)


def save_content(content: bytes | str, path: Path) -> None:
    """Write a figure that is bytes or text already, replacing what was there.

    Raises
    ------
    OptionError
        If it cannot be written; what was there stays.
    """
    try:
        write_whole(path, content)
    except OSError as error:
        raise OptionError(f"--out {path}: cannot be written: {error.strerror}.") from None
