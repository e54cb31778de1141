"""Chapters on solvers: a comparison, or the runs of a learner."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.views.figures.figure_style import Heading
from skillplan.views.figures.front_figure import draw_front
from skillplan.views.figures.gantt_figure import PlanBar, draw_gantt_picture
from skillplan.views.report.markup import Markup, facts, join, number, seconds, share, table, tag
from skillplan.views.report.page import Chapter, Section
from skillplan.views.report.pictures import embed_figure
from skillplan.views.report.plan_sections import caption_picture
from skillplan.views.report.summary import format_chip
from skillplan.views.tables.training import describe_cause


def build_comparison_chapter(document: Mapping[str, Any], name: str) -> Chapter:
    """Return a comparison of solvers as a table and bars.

    Parameters
    ----------
    document
        ``skillplan.comparison/1`` from an untrusted source.
    """
    entries = document.get("rows")
    rows = [row for row in entries if isinstance(row, Mapping)] if isinstance(entries, list) else []
    lines = []
    for row in rows:
        stats = _get_mapping(row.get("stats"))
        lines.append(
            [
                row.get("solver"),
                format_chip(row.get("status")),
                f"{number(row.get('cost'))} {row.get('cost_unit') or ''}".strip(),
                number(row.get("lower_bound")),
                share(row.get("gap")),
                number(stats.get("checks")),
                number(stats.get("expanded")),
                number(stats.get("wall_s"), 3),
                row.get("reason") or "-",
            ]
        )
    columns = ["solver", "status", "cost", "bound", "gap", "checks", "expanded", "seconds", "why"]
    names = {str(_get_mapping(row.get("task")).get("name")) for row in rows}
    title = f"Solvers compared: {', '.join(sorted(names)) or 'no task'}"
    words = "Each solver began with a cold cache." if not document.get("warm") else "Warm cache."
    words += " The figures come from the file; nothing was verified for this page."
    solvers = table(f"{len(lines)} solvers side by side", columns, lines, "   nnnnn")
    timed = [
        PlanBar(
            str(row.get("solver")), str(row.get("status")), str(row.get("status")), 0.0, took, ""
        )
        for row in rows
        if (took := _get_seconds(row)) is not None
    ]
    sections = [Section("solvers", "Solvers", solvers)]
    if timed:
        picture = draw_gantt_picture(timed, "Seconds of each solver")
        caption = "Time of each solver [s]; the colour is its status."
        sections.append(
            Section("times", "Seconds", caption_picture(picture, f"{name}-times", caption))
        )
    return Chapter(name, title, tag("p", {"class": "lead"}, words), sections)


def build_front_chapter(document: Mapping[str, Any], name: str) -> Chapter:
    """Return a Pareto front as a picture and a table.

    Parameters
    ----------
    document
        ``skillplan.front/1`` from an untrusted source.
    """
    labels = _list_cost_labels(document)
    entries = document.get("points")
    rows: list[list[object]] = []
    drawn: list[tuple[float, float, bool]] = []
    for entry in entries if isinstance(entries, list) else []:
        point = _get_mapping(entry)
        costs = point.get("costs")
        if not isinstance(costs, list) or len(costs) != len(labels):
            continue
        proved = point.get("proved") is True
        actions = point.get("actions")
        rows.append(
            [
                str(len(rows) + 1),
                *(number(cost) for cost in costs),
                number(point.get("makespan")),
                seconds(point.get("makespan_s")),
                "yes" if proved else "no",
                ", ".join(map(str, actions)) if isinstance(actions, list) else "-",
            ]
        )
        if all(isinstance(cost, int | float) and math.isfinite(cost) for cost in costs):
            drawn.append((float(costs[0]), float(costs[1]), proved))
    whole = document.get("status") == "optimal"
    words = "Every point is proved, and there are no others." if whole else "Not the whole front."
    words += " No plan is better than one of these in both costs."
    words += " The figures come from the file; nothing was verified for this page."
    task = str(_get_mapping(document.get("task")).get("name"))
    columns = ["point", *labels, "skills", "in all [s]", "proved", "sequence"]
    sections = []
    if drawn:
        figure = draw_front(sorted(drawn), (labels[0], labels[1]), Heading(f"{task}: Pareto front"))
        caption = f"{labels[0]} against {labels[1]}; plans lie in the shaded region."
        picture = embed_figure(figure, f"Pareto front of {' and '.join(labels)}", caption)
        sections.append(Section("picture", "The front", picture))
    points = table(f"{len(rows)} points", columns, rows, "nnnnn")
    sections.append(Section("points", "Points", points))
    lead = join([format_chip(document.get("status")), tag("p", {"class": "lead"}, words)])
    return Chapter(name, f"{task}: {' against '.join(labels)}", lead, sections)


def build_advice_chapter(document: Mapping[str, Any], name: str) -> Chapter:
    """Return advice on a cell as a table, with the shares of the cycle.

    Parameters
    ----------
    document
        ``skillplan.advice/1`` from an untrusted source.
    """
    unit = f" [{document['cost_unit']}]" if document.get("cost_unit") else ""
    tips = document.get("tips")
    rows: list[list[object]] = []
    for entry in tips if isinstance(tips, list) else []:
        tip = _get_mapping(entry)
        settings = _get_mapping(tip.get("set"))
        rows.append(
            [
                str(len(rows) + 1),
                tip.get("words"),
                number(tip.get("saving")),
                number(tip.get("cost")),
                seconds(tip.get("makespan_s")),
                number(tip.get("cycles_per_hour"), 4),
                "yes" if tip.get("proved") is True else "no",
                " ".join(f"--set '{key}={value}'" for key, value in settings.items()),
            ]
        )
    task = str(_get_mapping(document.get("task")).get("name"))
    words = f"{number(document.get('tried'))} changes of the cell were solved, one at a time; "
    words += f"{len(rows)} that save most are listed."
    words += " The figures come from the file; nothing was verified for this page."
    columns = ["no", "change", f"saves{unit}", f"cost{unit}", "time [s]", "cycles/h", "proved"]
    columns.append("as options")
    sections = [
        Section("tips", "Advice", table(f"{len(rows)} changes", columns, rows, "n nnnn")),
        Section("cycle", "The cycle as it is", facts(_list_cycle(document, unit))),
    ]
    return Chapter(name, f"Advice on {task}", tag("p", {"class": "lead"}, words), sections)


def _list_cycle(document: Mapping[str, Any], unit: str) -> list[tuple[str, object]]:
    """Return cost and time of the file, and the counts of the tries."""
    cycle = _get_mapping(document.get("cycle"))
    total_s = cycle.get("makespan_s")
    entries: list[tuple[str, object]] = [
        (f"Cost{unit}", number(document.get("cost"))),
        ("Time of the plan [s]", seconds(total_s)),
        ("Cycles per hour", number(cycle.get("cycles_per_hour"), 4)),
    ]
    parts = [("travel_s", "Travel"), ("work_s", "Work"), ("change_s", "Tool changes")]
    if cycle.get("wait_s"):
        parts.append(("wait_s", "Waits for parts"))
    for key, label in parts:
        value = cycle.get(key)
        if isinstance(value, int | float) and isinstance(total_s, int | float) and total_s > 0:
            entries.append((f"{label} [s]", f"{seconds(value)} ({share(value / total_s)})"))
    counts = (
        ("proposed", "Changes in all"),
        ("tried", "Solved"),
        ("useless", "Solved without a saving"),
        ("refused", "Refused by the checks of the file"),
        ("longer", "Places left out that do not shorten the plan"),
        ("wrong", "Results that failed the referee's check"),
        ("cut", "Searches that ended at a limit of the solver"),
    )
    entries += [(label, number(document.get(key))) for key, label in counts]
    entries.append(("Ended by", document.get("reason") or "nothing left to try"))
    return entries


def _list_cost_labels(document: Mapping[str, Any]) -> list[str]:
    costs = document.get("costs")
    labels = []
    for cost in costs if isinstance(costs, list) else []:
        entry = _get_mapping(cost)
        unit = f" [{entry['unit']}]" if entry.get("unit") else ""
        labels.append(f"{entry.get('name')}{unit}")
    return labels if len(labels) == 2 else ["first cost", "second cost"]


def _get_seconds(row: Mapping[str, Any]) -> float | None:
    took = _get_mapping(row.get("stats")).get("wall_s")
    return float(took) if isinstance(took, int | float) and took >= 0 else None


def _get_mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _list_shortfall(short: Mapping[str, Any], steps: int | None) -> list[tuple[str, object]]:
    """Return the obstacles that kept runs from completing the task, as names and values."""
    failed = (f"{entry['skill']} {entry['times']:,} times" for entry in short["failed_skills"])
    entries = [
        ("Runs that do not complete it", ", ".join(map(str, short["runs"]))),
        ("Goals reached at most", f"{short['most_goals_reached']} of {short['goals']}"),
        ("First at step", number(short["last_progress_step"])),
        ("Goals never reached", ", ".join(short["goals_never_reached"])),
        ("Skills never executed", ", ".join(short["skills_never_executed"])),
        ("Skills that failed", ", ".join(failed)),
        ("Episodes into a dead end", f"{short['dead_ends_entered']:,} of {short['episodes']:,}"),
        ("Skills hidden by the mask", number(short["skills_hidden_mean"])),
        ("What ended it", describe_cause(short["cause"], short["last_progress_step"], steps)),
        ("Try", short["advice"]),
    ]
    return [(name, value) for name, value in entries if value]


def build_training_chapter(
    manifest: Sequence[tuple[str, object]],
    document: Mapping[str, Any] | None,
    images: Sequence[Markup],
    heading: str,
    name: str,
) -> Chapter:
    """Return the runs of a learner with their learning curves.

    Parameters
    ----------
    manifest
        Task and options of the training, as names and values.
    document
        ``skillplan.training/1``; None for an unfinished training.
    """
    sections = []
    if images:
        sections.append(Section("curves", "Learning curves", join(images)))
    lines: list[list[object]] = []
    for run in (document or {}).get("runs", ()):
        lines.append(
            [
                str(run.get("run", len(lines))),
                number(run.get("seed")),
                format_chip(run.get("status")),
                number(run.get("cost")),
                share(run.get("deviation")),
                share(run.get("success_rate")),
                number(run.get("best_cost_seen")),
                number(run.get("wall_s"), 3),
            ]
        )
    columns = ["run", "seed", "status", "cost", "deviation", "success", "best seen", "seconds"]
    if lines:
        runs = table(f"{len(lines)} runs", columns, lines, " n nnnnn")
        sections.append(Section("runs", "Runs", runs))
    short = (document or {}).get("shortfall")
    if short:
        sections.append(
            Section(
                "shortfall",
                "Why runs fall short",
                facts(_list_shortfall(short, (document or {}).get("steps"))),
            )
        )
    sections.append(Section("facts", "What was learned, and how", facts(manifest)))
    rate = (document or {}).get("success_rate")
    words = (
        "The training has not finished."
        if document is None
        else (
            f"{len(lines)} runs; optimum {number(document.get('optimum'))} "
            f"{document.get('cost_unit') or ''}; success of the policies {share(rate)}. "
            "The figures come from the folder; nothing was verified for this page."
        )
    )
    return Chapter(name, heading, tag("p", {"class": "lead"}, words), sections)
