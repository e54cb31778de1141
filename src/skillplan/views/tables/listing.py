"""What a domain has to show in its own words, as a table."""

from __future__ import annotations

from skillplan.domains.domain import Listing
from skillplan.views.text.table import Column, Table


def listing_table(listing: Listing) -> Table:
    """Return a domain's listing as a table; columns of figures are set flush right."""
    columns = []
    for index, heading in enumerate(listing.columns):
        cells = [row[index] for row in listing.rows]
        columns.append(Column(heading, right=all(_is_figure(cell) for cell in cells)))
    return Table(listing.title, columns, listing.rows, listing.notes)


def _is_figure(cell: str) -> bool:
    return cell in ("-", "") or cell.replace(".", "", 1).lstrip("-").isdigit()
