"""Pictures and figures within a page."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from xml.etree import ElementTree

from matplotlib.figure import Figure

from skillplan.views.figures.figure_file import render_figure
from skillplan.views.figures.picture import COLOURS, PIXELS_PER_IN, Note, Picture
from skillplan.views.report.markup import Markup, join, tag

CURSOR_ID = "gantt-cursor"

_DPI = 130
_SVG = "{http://www.w3.org/2000/svg}"
# In the figure, its first group is the background.
_AXES = f"{_SVG}g/{_SVG}g[2]"
_LINK = "{http://www.w3.org/1999/xlink}href"
# matplotlib writes SVG in points.
_PT_PER_PX = 72 / PIXELS_PER_IN
_ROLES = {colour: role for role, colour in COLOURS.items()}
_NUMBER = re.compile(r"-?\d+\.\d+")
# Styles that become attributes; colours become classes.
_ATTRIBUTES = ("fill-opacity", "opacity", "stroke-width", "stroke-dasharray", "text-anchor")


def embed_picture(picture: Picture, name: str, description: str = "") -> Markup:
    """Return a picture as SVG that the style sheet of the page colours.

    The page's policy forbids style attributes, so each colour becomes a class.

    Parameters
    ----------
    name
        Prefix of identifiers, unique in the page.
    description
        Text for readers who cannot see the picture.
    """
    root = ElementTree.fromstring(render_figure(picture.figure, ".svg"))
    parts = [
        tag("title", {"id": f"{name}-title"}, picture.title),
        tag("desc", {"id": f"{name}-desc"}, description or picture.title),
        *(shape for axes in root.iterfind(_AXES) for shape in _convert(axes, picture.notes)),
    ]
    if picture.cursor is not None:
        parts.append(_build_cursor(picture.cursor))
    size = [picture.width_px * _PT_PER_PX, picture.height_px * _PT_PER_PX]
    attributes = {
        "class": "picture",
        "viewBox": f"0 0 {_format_number(size[0])} {_format_number(size[1])}",
        "width": _format_number(picture.width_px),
        "height": _format_number(picture.height_px),
        "role": "img",
        "aria-labelledby": f"{name}-title {name}-desc",
    }
    return tag("svg", attributes, join(parts))


def _convert(
    element: ElementTree.Element, notes: dict[str, Note], note: Note | None = None
) -> Iterator[Markup]:
    """Yield the shapes of an element of matplotlib's SVG without its groups."""
    note = notes.get(element.get("id", ""), note)
    kind = element.tag.removeprefix(_SVG)
    for child in element if kind == "g" else ():
        yield from _convert(child, notes, note)
    if kind == "path":
        path = " ".join(_shorten(element.get("d", "")).split())
        attributes = {"d": path, **_restyle(element.get("style", "")), **_attach(note)}
        inner = tag("title", {}, note.title) if note is not None and note.title else Markup("")
        yield tag("path", attributes, inner)
    elif kind == "text":
        place = {key: _shorten(element.get(key, "")) for key in ("x", "y")}
        yield tag("text", {**place, **_restyle(element.get("style", ""), "f-ink")}, element.text)
    elif kind == "image":
        kept = {key: element.get(key) for key in ("width", "height", "transform")}
        yield tag("image", {**kept, "href": "".join(element.get(_LINK, "").split())})


def _attach(note: Note | None) -> dict[str, str]:
    if note is None or note.seek_s is None:
        return {}
    return {
        "data-seek-s": f"{note.seek_s:.3f}",
        "tabindex": "0",
        "role": "button",
        "aria-label": note.title,
    }


def _restyle(style: str, *classes: str) -> dict[str, str]:
    """Return a style attribute as classes for colours and attributes for all else."""
    values = dict(entry.split(": ", 1) for entry in style.split("; ") if entry)
    names = list(classes) if "fill" not in values else []
    for key, prefix in (("fill", "f"), ("stroke", "s")):
        colour = values.get(key)
        if colour is not None and (colour != "none" or key == "fill"):
            names.append("no-fill" if colour == "none" else f"{prefix}-{_ROLES[colour]}")
    if values.get("font-weight") in ("700", "bold"):
        names.append("bold")
    attributes = {key: _shorten(values[key]) for key in _ATTRIBUTES if key in values}
    if "font-size" in values:
        attributes["font-size"] = _shorten(values["font-size"].removesuffix("px"))
    return {"class": " ".join(names), **attributes}


def _build_cursor(ends: tuple[float, float, float, float]) -> Markup:
    """Return the line that a player moves along the time axis."""
    left, right, top, bottom = (_format_number(value * _PT_PER_PX) for value in ends)
    attributes = {
        "id": CURSOR_ID,
        "class": "s-red cursor",
        "x1": "0",
        "x2": "0",
        "y1": top,
        "y2": bottom,
        "data-x0": left,
        "data-x1": right,
        "transform": f"translate({left} 0)",
    }
    return tag("line", attributes)


def _shorten(text: str) -> str:
    """Return a text whose numbers have at most two decimals."""
    return _NUMBER.sub(lambda match: _format_number(float(match.group())), text)


def _format_number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")


def embed_figure(figure: Figure, description: str, caption: str) -> Markup:
    """Return a figure as a PNG within the page, with its caption."""
    data = base64.b64encode(render_figure(figure, ".png", _DPI)).decode("ascii")
    wide, tall = figure.get_size_inches()
    attributes = {
        "class": "picture",
        "src": f"data:image/png;base64,{data}",
        "alt": description,
        "width": round(96 * wide),
        "height": round(96 * tall),
    }
    return tag("figure", {}, tag("img", attributes), tag("figcaption", {}, caption))
