"""A picture as SVG elements of a page, which colours them by its own style sheet.

There are no style attributes, which the page's policy forbids: a role is a class.
"""

from __future__ import annotations

from skillplan.views.pictures.drawing import Disc, Drawing, Item, Label, Look, Shape
from skillplan.views.report.markup import Markup, join, tag

CURSOR_ID = "gantt-cursor"


def picture_svg(drawing: Drawing, name: str, description: str = "") -> Markup:
    """Return a picture as one element.

    Parameters
    ----------
    drawing
        The picture.
    name
        Unique in the page; other identifiers begin with it.
    description
        What a reader who does not see it should know.
    """
    parts = [
        tag("title", {"id": f"{name}-title"}, drawing.title),
        tag("desc", {"id": f"{name}-desc"}, description or drawing.title),
        *(_element(item) for item in drawing.items),
    ]
    if drawing.cursor is not None:
        parts.append(_cursor(drawing.cursor))
    return tag(
        "svg",
        {
            "class": "picture",
            "viewBox": f"0 0 {_number(drawing.width_px)} {_number(drawing.height_px)}",
            "width": _number(drawing.width_px),
            "height": _number(drawing.height_px),
            "role": "img",
            "aria-labelledby": f"{name}-title {name}-desc",
        },
        join(parts),
    )


def _element(item: Item) -> Markup:
    if isinstance(item, Label):
        classes = f"f-{item.role}" + (" bold" if item.bold else "") + (" halo" if item.halo else "")
        attributes = {
            "x": _number(item.at[0]),
            "y": _number(item.at[1]),
            "font-size": _number(item.size_px),
            "text-anchor": item.anchor,
            "dominant-baseline": "central",
            "class": classes,
        }
        return tag("text", attributes, item.text)
    inner = tag("title", {}, item.title) if item.title else Markup("")
    if isinstance(item, Disc):
        place = {
            "cx": _number(item.centre[0]),
            "cy": _number(item.centre[1]),
            "r": _number(item.radius_px),
        }
        return tag("circle", {**place, **_look(item.look)}, inner)
    return _shape(item, inner)


def _shape(shape: Shape, inner: Markup) -> Markup:
    points = " ".join(f"{_number(x)},{_number(y)}" for x, y in shape.points)
    attributes = {"points": points, **_look(shape.look)}
    if shape.seek_s is not None:
        attributes |= {
            "data-seek-s": f"{shape.seek_s:.3f}",
            "tabindex": "0",
            "role": "button",
            "aria-label": shape.title,
        }
    return tag("polygon" if shape.closed else "polyline", attributes, inner)


def _cursor(ends: tuple[float, float, float, float]) -> Markup:
    """Return the line that a player moves along the time line."""
    left, right, top, bottom = ends
    attributes = {
        "id": CURSOR_ID,
        "class": "s-red cursor",
        "x1": "0",
        "x2": "0",
        "y1": _number(top),
        "y2": _number(bottom),
        "data-x0": _number(left),
        "data-x1": _number(right),
        "transform": f"translate({_number(left)} 0)",
    }
    return tag("line", attributes)


def _look(look: Look) -> dict[str, str]:
    classes = [f"f-{look.fill}" if look.fill is not None else "no-fill"]
    found: dict[str, str] = {}
    if look.stroke is not None:
        classes.append(f"s-{look.stroke}")
        found["stroke-width"] = _number(look.width_px)
        found["stroke-linejoin"] = "round"
    if look.dashed:
        found["stroke-dasharray"] = "5 4"
    if look.fill is not None and look.opacity < 1:
        found["fill-opacity"] = _number(look.opacity)
    if look.shade:
        # Ten steps are enough for a face.
        classes.append(f"shade-{round(10 * look.shade)}")
    return {"class": " ".join(classes), **found}


def _number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")
