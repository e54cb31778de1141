"""The summary of a result: status, figures, proof and versions."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from typing import Any

from skillplan import __version__
from skillplan.records.advice import compute_cycles_per_hour
from skillplan.records.certificate import Certificate, Outcome
from skillplan.records.result import SimulationOutcome
from skillplan.views.report.markup import Markup, facts, join, number, seconds, share, tag
from skillplan.views.report.page import Section
from skillplan.views.tables.results import describe_simulation
from skillplan.views.text.wording import describe_covered

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
    "optimal": "A valid plan, proved to be the best{by}.",
    "solved": "A valid plan{by}; that it is the best is not proved.",
    "infeasible": "Proved{by}: there is no plan.",
    "unsolved": "No plan was found, which is no proof that there is none.",
}
_NO_PLAN = "There is no plan."
_FAILED_WORDS = {
    "optimal": "Proved{by}; the simulation {failure}.",
    "solved": "Checked{by}, not proved to be the best; the simulation {failure}.",
}
_GEOMETRIC = ("aabb", "swept")


def format_chip(status: object) -> Markup:
    """Return a status as a coloured word."""
    return tag("span", {"class": f"chip {_TONES.get(str(status), 'warn')}"}, status)


def describe_planner(document: Mapping[str, Any]) -> str:
    """Return the source of planned times in words."""
    return str(document.get("timed_by") or "the task's own figures")


def build_lead(
    document: Mapping[str, Any],
    measured_s: float | None = None,
    played_s: float | None = None,
    certificate: Certificate | None = None,
    covered: tuple[int, int] | None = None,
) -> Markup:
    """Return a result in a sentence, with its figures.

    Parameters
    ----------
    measured_s
        Time of the performed plan [s]; None if it was not performed.
    played_s
        Time of the playback along planned paths [s]; None for no such playback.
    certificate
        Verification of a stored result; None for a result that was solved for the page.
    covered
        Number of parts of the task, and of its product; None if unknown.
    """
    status = str(document.get("status"))
    unit = document.get("cost_unit") or ""
    reasons = [line.rstrip(".") for line in str(document.get("reason") or "").splitlines()]
    words = [
        *_describe_verified(document, certificate),
        *([f"It is about {describe_covered(covered)}."] if covered is not None else []),
        *(f"{reason}." for reason in reasons if reason),
    ]
    sentence = join([tag("p", {"class": "lead"}, line) for line in words])
    planned, cost, bound = (document.get(k) for k in ("makespan_s", "cost", "lower_bound"))
    figures: list[tuple[str, object]] = [("Status", format_chip(status))]
    simulation = _get_mapping(document, "simulation")
    if simulation:
        complete, step = simulation["complete"], simulation["failed_step"]
        tone = "good" if complete else "bad"
        words_of = "complete" if complete else "not complete" if step is None else "fails"
        word = tag("span", {"class": f"chip {tone}"}, words_of)
        small = f"at step {step} of {len(document['steps'])}" if step is not None else None
        figures.append(("Simulation", _append_small(word, small)))
    if cost is not None:
        figures.append(
            ("Cost", _append_small(f"{number(cost)} {unit}", document.get("kind_of_cost")))
        )
    if bound is not None:
        figures.append(("Lower bound", f"{number(bound)} {unit}".strip()))
    if cost is not None:
        figures += [
            ("Gap", share(document.get("gap"))),
            ("Skills", number(document.get("makespan"))),
        ]
    if measured_s is not None:
        small = f"simulated; {seconds(planned)} s by {describe_planner(document)}"
        figures.append(("Time of the plan", _append_small(f"{seconds(measured_s)} s", small)))
    elif planned is not None:
        small = "planned" if played_s is None else f"planned, by {describe_planner(document)}"
        if played_s is not None and seconds(played_s) != seconds(planned):
            small += f"; {seconds(played_s)} s along the paths that are played"
        figures.append(("Time of the plan", _append_small(f"{seconds(planned)} s", small)))
    hourly = compute_cycles_per_hour(planned if measured_s is None else measured_s)
    if hourly is not None:
        figures.append(("Cycles per hour", number(hourly, 4)))
    items = [tag("div", {}, tag("dt", {}, name), tag("dd", {}, value)) for name, value in figures]
    return join([sentence, tag("dl", {"class": "figures"}, *items)])


def _describe_verified(document: Mapping[str, Any], certificate: Certificate | None) -> list[str]:
    """Return the claim of a result, failures first; an unverified claim is marked as such."""
    claim, limits = _describe_claim(document), _describe_limits(document, certificate)
    if certificate is None:
        return [claim, *limits]
    if not certificate.valid:
        plain = _WORDS.get(str(document.get("status")), _NO_PLAN).format(by="")
        failure = _describe_simulation(document)
        return [
            f"Not verified: {certificate.unconfirmed_words()}.",
            *([f"The simulation {failure}."] if failure else []),
            f"The result claims: {plain}",
            *limits,
        ]
    open_ = [claim.claim for claim in certificate.claims if claim.outcome is Outcome.NOT_CHECKED]
    left = f", without {', '.join(open_[:_MOST_NAMED])}" if open_ else ""
    return [claim, *limits, f"Verified for this page{left}."]


def _describe_claim(document: Mapping[str, Any]) -> str:
    """Return the proved claim, its back ends, and the outcome of a simulation."""
    status, names = str(document.get("status")), list_checkers(document)
    kind = "geometry " if any(name in _GEOMETRIC for name in names) else ""
    by = f" by {kind}({', '.join(names)})" if kind else f" by {', '.join(names)}" if names else ""
    failure = _describe_simulation(document)
    if failure and status in _FAILED_WORDS and not _get_mapping(document, "simulation")["complete"]:
        return _FAILED_WORDS[status].format(by=by, failure=failure)
    claim = _WORDS.get(status, _NO_PLAN).format(by=by)
    return f"{claim} The simulation {failure}." if failure else claim


def _describe_limits(document: Mapping[str, Any], certificate: Certificate | None) -> list[str]:
    """Return a sentence on properties that back ends leave unchecked, if any."""
    sentences = list_unchecked(document, certificate)
    more = len(sentences) - _MOST_NAMED
    if not sentences:
        return []
    shown = "; ".join(sentences[:_MOST_NAMED]) + (f"; and {more} more" if more > 0 else "")
    return [f"Not checked: {shown}."]


def list_checkers(document: Mapping[str, Any]) -> list[str]:
    """Return the back ends of the status; results of old versions have them, too."""
    if document.get("status") not in ("optimal", "solved", "infeasible"):
        return []
    names = [document.get("physics"), *str(document.get("collision") or "").split(",")]
    return [str(name) for name in names if name]


def list_unchecked(document: Mapping[str, Any], certificate: Certificate | None) -> list[str]:
    """Return the unchecked properties, from the verification if there is one."""
    if certificate is not None:
        return list(certificate.not_checked)
    return [str(sentence) for sentence in document.get("not_checked") or ()]


def _describe_simulation(document: Mapping[str, Any]) -> str:
    """Return the outcome of the simulation as the end of a sentence; empty without one."""
    simulation = _get_mapping(document, "simulation")
    if not simulation:
        return ""
    return describe_simulation(SimulationOutcome(**simulation), len(document.get("steps") or ()))


def _append_small(value: str | Markup, small: object) -> Markup:
    return join([value, tag("small", {}, small)]) if small else join([value])


def build_summary_section(
    document: Mapping[str, Any],
    description: str,
    plugins: Sequence[tuple[str, str]],
    certificate: Certificate | None = None,
) -> Section:
    """Return the facts of a result: task, solver, proof, effort and versions.

    Parameters
    ----------
    certificate
        Verification of a stored result; None for a result that was solved for the page.
    """
    task, stats = _get_mapping(document, "task"), _get_mapping(document, "stats")
    origin = _get_mapping(document, "origin")
    changed = ", ".join(f"{key}={value}" for key, value in _get_mapping(origin, "set").items())
    entries: list[tuple[str, object]] = [
        ("Asked", description),
        ("Task", f"{task.get('name')} ({task.get('kind')})"),
        ("Task file", origin.get("file")),
        ("Read with", changed),
        ("Hash of the task", tag("code", {}, task.get("sha256") or "-")),
        ("Solver", f"{document.get('solver')}, seed {document.get('seed')}"),
        ("Status", document.get("status")),
        ("Proved by", ", ".join(list_checkers(document))),
        ("Simulation", _describe_simulation(document)),
        ("Not checked", "; ".join(list_unchecked(document, certificate))),
        ("Bound proved by", _mark_unchecked(document.get("bound_method"), certificate)),
        ("Physics", document.get("physics")),
        ("Collision", document.get("collision")),
        ("Durations from", document.get("timed_by") or "the task's own figures"),
        ("States", number(stats.get("states"))),
        ("Expanded", number(stats.get("expanded"))),
        ("Checks", f"{number(stats.get('checks'))}, {number(stats.get('cache_hits'))} reused"),
        ("Search took", f"{seconds(stats.get('wall_s'))} s"),
        *_list_verification(certificate),
        ("Versions", ", ".join(f"{name} {version}" for name, version in plugins)),
        ("Report by", f"skillplan {__version__}, Python {platform.python_version()}"),
    ]
    return Section("facts", "What was asked and found", facts(entries))


def _mark_unchecked(value: object, certificate: Certificate | None) -> object:
    """Return a value, marked as unchecked if the result was stored."""
    return value if certificate is None or not value else f"{value}, says the result"


def _list_verification(certificate: Certificate | None) -> list[tuple[str, object]]:
    """Return the methods that verified a stored result, and the keys without a check."""
    if certificate is None:
        return []
    held = [claim for claim in certificate.claims if claim.outcome is Outcome.HOLDS]
    methods = ", ".join(dict.fromkeys(claim.method for claim in held))
    return [
        ("Verified by", f"{len(held)} of {len(certificate.claims)} claims: {methods or 'nothing'}"),
        ("Cannot be verified", ", ".join(certificate.unchecked)),
    ]


def _get_mapping(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = document.get(key)
    return value if isinstance(value, Mapping) else {}
