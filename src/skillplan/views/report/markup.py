"""Elements of HTML and SVG with escaped texts and attributes, tables and lists of facts."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence

from skillplan.views.text.wording import escape

_VOID = frozenset(("br", "hr", "meta", "link", "img", "input", "col"))


class Markup(str):
    """Text that needs no escaping."""

    __slots__ = ()


def text(value: object) -> Markup:
    """Return a value as text of a page, with markup and control characters escaped."""
    if isinstance(value, Markup):
        return value
    return Markup(html.escape(escape(str(value)), quote=True))


def join(parts: Iterable[object]) -> Markup:
    """Return parts one after the other, escaped unless they are markup."""
    return Markup("".join(text(part) for part in parts))


def tag(name: str, attributes: Mapping[str, object] | None = None, *inner: object) -> Markup:
    """Return an element.

    Parameters
    ----------
    name
        Name of the element, never from a document.
    attributes
        Attributes, whose values are escaped. None omits an attribute, True omits its value.
    inner
        Content: markup, or text that is escaped.
    """
    parts = [f"<{name}"]
    for key, value in (attributes or {}).items():
        if value is True:
            parts.append(f" {key}")
        elif value is not None and value is not False:
            parts.append(f' {key}="{text(str(value))}"')
    parts.append(">")
    if name not in _VOID:
        parts += [join(inner), f"</{name}>"]
    return Markup("".join(parts))


def table(
    caption: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[object]],
    numbers: str = "",
    *,
    captioned: bool = True,
) -> Markup:
    """Return a table whose first column names the rows.

    Parameters
    ----------
    rows
        Cells: markup, or values that are shown as text.
    numbers
        One character per column: ``n`` for numbers, ``p`` for cells that do not wrap.
    captioned
        True if the caption is visible. Screen readers read it in any case.
    """
    kinds = numbers.ljust(len(columns))

    def classes(index: int) -> dict[str, str | None]:
        return {"class": kinds[index].strip() or None}

    heads = [
        tag("th", {"scope": "col", **classes(index)}, name) for index, name in enumerate(columns)
    ]
    lines = []
    for row in rows:
        cells = [
            tag("th", {"scope": "row", **classes(0)}, cell)
            if index == 0
            else tag("td", classes(index), cell)
            for index, cell in enumerate(row)
        ]
        lines.append(tag("tr", {}, *cells))
    whole = tag(
        "table",
        {},
        tag("caption", {}, caption) if captioned else Markup(""),
        tag("thead", {}, tag("tr", {}, *heads)),
        tag("tbody", {}, *lines),
    )
    return tag(
        "div", {"class": "scroll", "tabindex": "0", "role": "region", "aria-label": caption}, whole
    )


def facts(entries: Iterable[tuple[str, object]]) -> Markup:
    """Return a list of names with values, without empty values."""
    items = [
        join([tag("dt", {}, name), tag("dd", {}, value)])
        for name, value in entries
        if value not in (None, "")
    ]
    return tag("dl", {"class": "facts"}, *items)


def note(words: object) -> Markup:
    """Return a remark."""
    return tag("p", {"class": "note"}, words)


def number(value: object, digits: int = 6) -> str:
    """Return a number for people; a dash for other values."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return "-"
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:,.{digits}g}"


def numbers(values: Sequence[object], most: int = 5) -> list[str]:
    """Return the numbers of a column for people, all with the same decimals."""
    written = [number(value) for value in values]
    decimals = min(max((len(text.partition(".")[2]) for text in written), default=0), most)
    return [
        f"{value:,.{decimals}f}" if isinstance(value, float) and text != "-" else text
        for value, text in zip(values, written, strict=True)
    ]


def seconds(value: object) -> str:
    """Return a time [s] for people; a dash for other values."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return "-"
    return f"{value:.2f}"


def share(value: object) -> str:
    """Return a fraction as per cent; a dash for other values."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return "-"
    return f"{100 * value:.4g} %"
