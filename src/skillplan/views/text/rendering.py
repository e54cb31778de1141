"""Tables as text, CSV or Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO

from skillplan.views.text.table import Table, as_csv, as_markdown


def render(tables: Sequence[Table], style: str, out: IO[str]) -> str:
    """Return tables as text.

    Parameters
    ----------
    tables
        At least one; CSV holds the last only, which is the most particular.
    style
        ``table``, ``csv`` or ``md``.
    out
        Where the text will go: a terminal's width and colours count.
    """
    if style == "csv":
        return as_csv(tables[-1])
    if style == "md":
        return "\n".join(as_markdown(table) for table in tables)
    # Here and not above: CSV and Markdown must not wait for rich.
    from skillplan.views.text.terminal import as_terminal_text

    return as_terminal_text(tables, out)
