"""What a checker found out about a result, as a table."""

from __future__ import annotations

from skillplan.records.certificate import Certificate, Outcome
from skillplan.views.tables.table import Column, Table


def certificate_table(certificate: Certificate) -> Table:
    """Return a row for every claim, and what they come to below."""
    columns = (Column("claim"), Column("outcome"), Column("by"), Column("detail"))
    rows = [(one.claim, one.outcome.value, one.method, one.detail) for one in certificate.claims]
    return Table(
        f"{certificate.name}: verification", columns, rows, [f"verdict    {_verdict(certificate)}"]
    )


def _verdict(certificate: Certificate) -> str:
    failing = [one.claim for one in certificate.claims if one.outcome is Outcome.FAILS]
    if failing:
        return f"NOT VALID: {', '.join(failing)}"
    open_ = [one.claim for one in certificate.claims if one.outcome is Outcome.NOT_CHECKED]
    rest = f", but for what was not checked: {', '.join(open_)}" if open_ else ""
    return f"valid{rest}"
