"""Elements of HTML and SVG, whose texts and attributes are escaped where they are made."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping

from skillplan.views.text.escaping import escaped

_VOID = frozenset(("br", "hr", "meta", "link", "img", "input", "col"))


class Markup(str):
    """Text that is markup already."""

    __slots__ = ()


def text(value: object) -> Markup:
    """Return a value as text of a page: control characters are shown, markup is none."""
    if isinstance(value, Markup):
        return value
    return Markup(html.escape(escaped(str(value)), quote=True))


def join(parts: Iterable[object]) -> Markup:
    """Return parts one after the other; those that are no markup are text."""
    return Markup("".join(text(part) for part in parts))


def tag(name: str, attributes: Mapping[str, object] | None = None, *inner: object) -> Markup:
    """Return an element.

    Parameters
    ----------
    name
        Of the element; ours.
    attributes
        Their values are escaped; one that is None is left out, one that is True has no value.
    inner
        What is in it: markup, or text that is escaped.
    """
    made = [f"<{name}"]
    for key, value in (attributes or {}).items():
        if value is True:
            made.append(f" {key}")
        elif value is not None and value is not False:
            made.append(f' {key}="{text(str(value))}"')
    made.append(">")
    if name not in _VOID:
        made += [join(inner), f"</{name}>"]
    return Markup("".join(made))
