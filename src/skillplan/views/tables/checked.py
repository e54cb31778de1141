"""A valid task file as a table of its tasks, with the errata of its source."""

from __future__ import annotations

from skillplan.records.checked import Checked
from skillplan.records.preview import Preview
from skillplan.views.tables.listing import listing_table
from skillplan.views.tables.results import not_checked_notes
from skillplan.views.text.table import Column, Table


def checked_tables(checked: Checked) -> list[Table]:
    """Return a row for every task of the file, and the errata."""
    errata = [] if checked.errata is None else [listing_table(checked.errata)]
    return [*errata, _tasks(checked)]


def _tasks(checked: Checked) -> Table:
    columns = [
        Column("task"),
        Column("actions", right=True),
        Column("facts", right=True),
        Column("observed", right=True),
        Column("step limit", right=True),
        Column("back ends"),
    ]
    keys = ("skills", "facts", "observation", "step_limit")
    rows = [
        (task["name"], *(str(task[key]) for key in keys), ", ".join(task["back_ends"]))
        for task in checked.document()["tasks"]
    ]
    notes = [f"kind       {checked.problem.kind}", f"sha256     {checked.problem.sha256}"]
    notes += not_checked_notes(checked.not_checked)
    return Table(
        f"{checked.problem.name}: valid", columns, rows, [*notes, *_preview_notes(checked.preview)]
    )


def _preview_notes(preview: Preview) -> list[str]:
    """Return what is known before anything is solved: what there is to see, orders, warnings."""
    notes = list(preview.overview.lines)
    for order in preview.orders:
        if not order.back_ends:
            notes.append(f"order      not derived of {order.not_derived}; give --collision for it")
            continue
        by = f"by {', '.join(order.back_ends)}"
        pairs = f"{order.pairs} pair{'' if order.pairs == 1 else 's'} of components {by}"
        notes.append(f"order      {f'none {by}' if order.lines else pairs}")
    return [*notes, *(f"warning    {warning}" for warning in preview.warnings)]
