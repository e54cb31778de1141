"""What was asked and found: status, figures, how it was proved, with which versions."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from typing import Any

from skillplan import __version__
from skillplan.records.certificate import Certificate, Outcome
from skillplan.views.report.markup import Markup, join, tag
from skillplan.views.report.page import Section
from skillplan.views.report.tables import facts, number, seconds, share

_TONES = {
    "optimal": "good",
    "solved": "good",
    "complete": "good",
    "infeasible": "bad",
    "wrong": "bad",
    "failed": "bad",
}
_MOST_NAMED = 3
_WORDS = {
    "optimal": "A valid plan, proved to be the best.",
    "solved": "A valid plan; that it is the best is not proved.",
    "infeasible": "Proved: there is no plan.",
    "unsolved": "No plan was found, which is no proof that there is none.",
}


def chip(status: object) -> Markup:
    """Return a status as a coloured word."""
    return tag("span", {"class": f"chip {_TONES.get(str(status), 'warn')}"}, status)


def planned_by(document: Mapping[str, Any]) -> str:
    """Return in words what a result has its planned times from."""
    return str(document.get("timed_by") or "the task's own figures")


def lead(
    document: Mapping[str, Any],
    measured_s: float | None = None,
    played_s: float | None = None,
    certificate: Certificate | None = None,
) -> Markup:
    """Return what a result is in a sentence, and its figures.

    Parameters
    ----------
    document
        ``skillplan.result/1``.
    measured_s
        How long the plan took when it was performed [s]; None where it was not.
    played_s
        How long it takes along its planned paths, as it is played [s]; None where it is not.
    certificate
        The verification of a stored result; None of one that was solved for the page.
    """
    status = str(document.get("status"))
    unit = document.get("cost_unit") or ""
    reasons = [one.rstrip(".") for one in str(document.get("reason") or "").splitlines()]
    claim = _WORDS.get(status, "There is no plan.")
    words = [*_verified(claim, certificate), *(f"{one}." for one in reasons if one)]
    sentence = join([tag("p", {"class": "lead"}, one) for one in words])
    planned, cost, bound = (document.get(k) for k in ("makespan_s", "cost", "lower_bound"))
    figures: list[tuple[str, object]] = [("Status", chip(status))]
    if cost is not None:
        figures.append(("Cost", _with(f"{number(cost)} {unit}", document.get("kind_of_cost"))))
    if bound is not None:
        figures.append(("Lower bound", f"{number(bound)} {unit}".strip()))
    if cost is not None:
        figures += [
            ("Gap", share(document.get("gap"))),
            ("Skills", number(document.get("makespan"))),
        ]
    if measured_s is not None:
        small = f"simulated; {seconds(planned)} s by {planned_by(document)}"
        figures.append(("Time of the plan", _with(f"{seconds(measured_s)} s", small)))
    elif planned is not None:
        small = "planned" if played_s is None else f"planned, by {planned_by(document)}"
        if played_s is not None and seconds(played_s) != seconds(planned):
            small += f"; {seconds(played_s)} s along the paths that are played"
        figures.append(("Time of the plan", _with(f"{seconds(planned)} s", small)))
    made = [tag("div", {}, tag("dt", {}, name), tag("dd", {}, value)) for name, value in figures]
    return join([sentence, tag("dl", {"class": "figures"}, *made)])


def _verified(claim: str, certificate: Certificate | None) -> list[str]:
    """Return the claim of a status, as a claim of the result unless it was verified."""
    if certificate is None:
        return [claim]
    if not certificate.valid:
        return [f"The result claims: {claim}", f"Not verified: {certificate.unconfirmed_words()}."]
    open_ = [one.claim for one in certificate.claims if one.outcome is Outcome.NOT_CHECKED]
    left = f", without {', '.join(open_[:_MOST_NAMED])}" if open_ else ""
    return [claim, f"Verified for this page{left}."]


def _with(value: str, small: object) -> Markup:
    return join([value, tag("small", {}, small)]) if small else join([value])


def summary_section(
    document: Mapping[str, Any],
    description: str,
    plugins: Sequence[tuple[str, str]],
    certificate: Certificate | None = None,
) -> Section:
    """Return all that a result says of how it came about.

    Parameters
    ----------
    document
        ``skillplan.result/1``.
    description
        What the task file says of the task; empty for nothing.
    plugins
        Names of installed distributions, and their versions.
    certificate
        The verification of a stored result; None of one that was solved for the page.
    """
    task, stats = _of(document, "task"), _of(document, "stats")
    origin = _of(document, "origin")
    changed = ", ".join(f"{key}={value}" for key, value in _of(origin, "set").items())
    entries: list[tuple[str, object]] = [
        ("Asked", description),
        ("Task", f"{task.get('name')} ({task.get('kind')})"),
        ("Task file", origin.get("file")),
        ("Read with", changed),
        ("Hash of the task", tag("code", {}, task.get("sha256") or "-")),
        ("Solver", f"{document.get('solver')}, seed {document.get('seed')}"),
        ("Status", document.get("status")),
        ("Bound proved by", _unchecked(document.get("bound_method"), certificate)),
        ("Physics", document.get("physics")),
        ("Collision", document.get("collision")),
        ("Durations from", document.get("timed_by") or "the task's own figures"),
        ("States", number(stats.get("states"))),
        ("Expanded", number(stats.get("expanded"))),
        ("Checks", f"{number(stats.get('checks'))}, {number(stats.get('cache_hits'))} reused"),
        ("Search took", f"{seconds(stats.get('wall_s'))} s"),
        *_verification(certificate),
        ("Versions", ", ".join(f"{name} {version}" for name, version in plugins)),
        ("Report by", f"skillplan {__version__}, Python {platform.python_version()}"),
    ]
    return Section("facts", "What was asked and found", facts(entries))


def _unchecked(value: object, certificate: Certificate | None) -> object:
    """Return a value, marked as a statement of the result if it cannot be checked."""
    return value if certificate is None or not value else f"{value}, says the result"


def _verification(certificate: Certificate | None) -> list[tuple[str, object]]:
    """Return the methods that verified a stored result, and the keys that none can check."""
    if certificate is None:
        return []
    held = [one for one in certificate.claims if one.outcome is Outcome.HOLDS]
    methods = ", ".join(dict.fromkeys(one.method for one in held))
    return [
        ("Verified by", f"{len(held)} of {len(certificate.claims)} claims: {methods or 'nothing'}"),
        ("Cannot be verified", ", ".join(certificate.unchecked)),
    ]


def _of(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = document.get(key)
    return found if isinstance(found, Mapping) else {}
