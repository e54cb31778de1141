"""A product that was imported from CAD, as a table of its parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.views.text.table import Column, Table


def imported_table(document: Mapping[str, Any], lines: Sequence[str]) -> Table:
    """Return a row for every part, and below the rows what was found.

    Parameters
    ----------
    document
        `skillplan.import/1`.
    lines
        What was found, in words.
    """
    columns = [
        Column("part"),
        Column("kind"),
        Column("mass [kg]", right=True),
        Column("size [mm]", right=True),
        Column("free directions", right=True),
    ]
    rows = [
        (
            part["name"],
            part["kind"],
            f"{part['mass_kg']:.4g}",
            " x ".join(f"{one:.4g}" for one in part["size_mm"]),
            str(len(part["free"])),
        )
        for part in document["parts"]
    ]
    return Table(f"{document['product']}: imported", columns, rows, list(lines))
