"""What a checker found out about a result: in short what holds, in full what does not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from skillplan.records.certificate import Asked, Certificate, Claim, Outcome
from skillplan.views.tables.results import not_checked_notes
from skillplan.views.text.table import Column, Table

# How claims were checked, by the label that stands in front; every other method is a proof.
_LABELS = {"replay": "replay", "arithmetic": "figures", "grounding": "replay"}
_PROOF = "proof"
_MOST_NAMED = 5


def certificate_table(certificate: Certificate) -> Table:
    """Return a row for every claim, and what they come to below."""
    everything = len(certificate.claims)
    asked = [_asked(one) for one in certificate.asked]
    notes = [
        *_task_notes(certificate),
        f"asked      {'; '.join(asked) or 'no back end'}"
        + (", with verdicts kept on disk" if certificate.warm else ""),
        *(f"unchecked  {key}: {why}" for key, why in certificate.unchecked.items()),
    ]
    notes += not_checked_notes(certificate.not_checked)
    return _table(certificate, certificate.claims, [*notes, _verdict(certificate, everything)])


def certificate_summary(certificate: Certificate) -> Table:
    """Return a row for every claim that does not hold, and below in short what does."""
    amiss = [one for one in certificate.claims if one.outcome is not Outcome.HOLDS]
    groups: dict[str, list[Claim]] = {}
    for one in certificate.claims:
        groups.setdefault(_LABELS.get(one.method, _PROOF), []).append(one)
    notes = [
        *_task_notes(certificate),
        *(
            f"{label:<10} {_held(groups[label])}"
            for label in dict.fromkeys((*_LABELS.values(), _PROOF))
            if label in groups
        ),
    ]
    notes += not_checked_notes(certificate.not_checked)
    return _table(certificate, amiss, [*notes, _verdict(certificate, _MOST_NAMED)])


def _task_notes(certificate: Certificate) -> list[str]:
    """Return the options that made another task of the file; no note without them."""
    origin = certificate.origin
    if origin is None or not origin.given():
        return []
    return [f"task       {origin.file} with {' '.join(origin.given())}"]


def _asked(one: Asked) -> str:
    options = ", ".join(f"{key}={value}" for key, value in one.options.items())
    return f"{one.name} {one.version}" + (f" ({options})" if options else "")


def _table(certificate: Certificate, claims: Iterable[Claim], notes: Sequence[str]) -> Table:
    columns = (Column("claim"), Column("outcome"), Column("by"), Column("detail"))
    rows = [(one.claim, one.outcome.value, one.method, one.detail) for one in claims]
    return Table(f"{certificate.name}: verification", columns, rows, notes)


def _held(claims: Sequence[Claim]) -> str:
    """Return which claims hold, of how many tasks, and how those that were proved were."""
    held = [one for one in claims if one.outcome is Outcome.HOLDS]
    if len(held) < len(claims):
        words = f"{len(held)} of {len(claims)} claims hold"
    else:
        names = list(dict.fromkeys(one.claim.rpartition(": ")[2] for one in held))
        words = f"{', '.join(names)} {'holds' if len(names) == 1 else 'hold'}"
        tasks = len({one.claim.rpartition(": ")[0] for one in held} - {""})
        words += f", {len(claims)} claims of {tasks} tasks" if tasks > 1 else ""
    methods = list(dict.fromkeys(one.method for one in held if one.method not in _LABELS))
    return f"{words}, by {' and '.join(methods)}" if methods else words


def _verdict(certificate: Certificate, most: int) -> str:
    """Return the conclusion with the names of the claims that do not hold, or their number."""
    refuted = [one.claim for one in certificate.refuted]
    if refuted:
        return f"verdict    NOT VALID: {_named(refuted, most)}"
    unconfirmed = [one.claim for one in certificate.unconfirmed]
    if unconfirmed:
        return f"verdict    NOT CONFIRMED: not checked: {_named(unconfirmed, most)}"
    open_ = [one.claim for one in certificate.claims if one.outcome is Outcome.NOT_CHECKED]
    rest = f", but for what was not checked: {_named(open_, most)}" if open_ else ""
    return f"verdict    valid{rest}"


def _named(claims: Sequence[str], most: int) -> str:
    return ", ".join(claims) if len(claims) <= most else f"{len(claims)} claims"
