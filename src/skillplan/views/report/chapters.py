"""What the page says of each kind of input: a plan of one task, a chain, a comparison, runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from skillplan.domains.domain import Listing
from skillplan.physics.performance import Performance, PerformedSkill
from skillplan.task.task import Task
from skillplan.views.pictures.exploded_picture import exploded_picture
from skillplan.views.pictures.gantt_picture import gantt_picture
from skillplan.views.pictures.plan_bars import PlanBar
from skillplan.views.pictures.precedence_graph import PrecedenceGraph
from skillplan.views.pictures.svg_canvas import picture_svg
from skillplan.views.report.markup import Markup, join, tag
from skillplan.views.report.page import Chapter, Section
from skillplan.views.report.plan_sections import (
    bars_of,
    figure,
    gantt_section,
    measured_section,
    picture_section,
    plan_section,
    precedence_section,
    refusals_section,
    refused_section,
)
from skillplan.views.report.playback_section import playback_section
from skillplan.views.report.summary import chip, lead, summary_section
from skillplan.views.report.tables import facts, note, number, seconds, share, table

Plugins = Sequence[tuple[str, str]]


@dataclass(frozen=True)
class PlanInput:
    """What a chapter on one task is made of.

    Parameters
    ----------
    document
        ``skillplan.result/1``.
    task
        What was solved.
    description
        What the file says of it.
    plugins
        Distributions and their versions.
    graph
        The precedence relation; None where there is none.
    performance, engine
        What was measured when the plan was performed, and by which engine; None and empty where
        it was not.
    playback
        ``skillplan.playback/1``; None where there is none.
    missing
        Why there is no playback.
    played
        When each skill begins and ends in a playback of what was not performed.
    extra
        Further sections.
    """

    document: Mapping[str, Any]
    task: Task
    description: str = ""
    plugins: Plugins = ()
    graph: PrecedenceGraph | None = None
    performance: Performance | None = None
    engine: str = ""
    playback: Mapping[str, Any] | None = None
    missing: str = ""
    played: Sequence[PerformedSkill] = ()
    extra: Sequence[Section] = field(default_factory=tuple)


def plan_chapter(given: PlanInput, name: str) -> Chapter:
    """Return all that is said of a plan of one task."""
    document, task = given.document, given.task
    has_plan = bool(document.get("steps"))
    in_cell = bool(task.scene.robots and task.scene.bodies)
    sections: list[Section] = []
    measured = given.performance
    if has_plan and in_cell:
        sections.append(playback_section(given.playback, _still(given, name), given.missing))
    if has_plan and task.scene.robots:
        bars = bars_of(task, document, given.played if measured is None else measured.skills)
        whole = measured is not None and len(measured.skills) == len(document["steps"])
        sections.append(
            gantt_section(
                bars,
                name,
                measured=whole,
                played=given.playback is not None,
                along_paths=bool(given.played),
            )
        )
    if has_plan:
        done = given.played or None if measured is None else measured.skills
        how = "played" if measured is None else "simulated"
        sections.append(plan_section(task, document, done, how))
    if in_cell:
        sections.append(picture_section(task, document, name))
    if given.graph is not None and given.graph.components:
        sections.append(precedence_section(given.graph, name))
    sections.append(refusals_section(task, document, given.graph, measured))
    if measured is not None:
        sections.append(measured_section(measured, given.engine))
    sections += given.extra
    sections.append(summary_section(document, given.description, given.plugins))
    took_s = measured.simulated_s if measured is not None and measured.failed is None else None
    return Chapter(name, task.name, lead(document, took_s), sections)


def _still(given: PlanInput, name: str) -> Markup | None:
    skills = [str(step["skill"]) for step in given.document["steps"]]
    try:
        return picture_svg(exploded_picture(given.task, skills), f"{name}-still")
    except ValueError:
        return None


@dataclass(frozen=True)
class ChainInput:
    """What a chapter on a chain of tasks is made of.

    Parameters
    ----------
    document
        ``skillplan.result/1`` of a chain.
    description, plugins
        As of `PlanInput`.
    listings
        Tables of the domain.
    refused
        What cannot be done, what was found, and why.
    images
        Figures as markup.
    bars
        The time line; empty where there is none.
    playback, missing
        As of `PlanInput`.
    """

    document: Mapping[str, Any]
    description: str = ""
    plugins: Plugins = ()
    listings: Sequence[Listing] = ()
    refused: Sequence[tuple[str, str, str]] = ()
    images: Sequence[Markup] = ()
    bars: Sequence[PlanBar] = ()
    playback: Mapping[str, Any] | None = None
    missing: str = ""


def chain_chapter(given: ChainInput, name: str) -> Chapter:
    """Return all that is said of a chain of tasks."""
    document = given.document
    sections = [playback_section(given.playback, None, given.missing)]
    if given.bars:
        sections.append(
            gantt_section(given.bars, name, measured=False, played=given.playback is not None)
        )
    if given.images:
        sections.append(Section("pictures", "Pictures", join(given.images)))
    parts = [*document.get("stages", ()), *(document.get("sequences") or ())]
    rows = [
        [
            part["name"],
            part.get("solver"),
            chip(part.get("status")),
            number(part.get("cost")),
            number(part.get("optimum")),
            number(part.get("makespan")),
            seconds(part.get("makespan_s")),
            _path(part),
        ]
        for part in parts
    ]
    columns = ["task", "solver", "status", "cost", "optimum", "skills", "time [s]", "path"]
    caption = f"{len(rows)} {'task' if len(rows) == 1 else 'tasks'} of the chain"
    sections.append(Section("plan", "The plan", table(caption, columns, rows, "   nnnn")))
    for index, listing in enumerate(given.listings):
        made = [table(listing.title, listing.columns, listing.rows)]
        made += [note(words) for words in listing.notes]
        sections.append(Section(f"listing-{index + 1}", listing.title, join(made)))
    sections.append(refused_section(given.refused))
    sections.append(summary_section(document, given.description, given.plugins))
    title = str(document.get("task", {}).get("name"))
    return Chapter(name, title, lead(document), sections)


def _path(part: Mapping[str, Any]) -> str:
    places = part.get("path") or part.get("skills") or []
    return " ".join(map(str, places))


def comparison_chapter(document: Mapping[str, Any], name: str) -> Chapter:
    """Return a comparison of solvers as a table and bars.

    Parameters
    ----------
    document
        ``skillplan.comparison/1``, which anybody may have written.
    name
        Of the chapter.
    """
    found = document.get("rows")
    rows = [row for row in found if isinstance(row, Mapping)] if isinstance(found, list) else []
    lines = []
    for row in rows:
        stats = _mapping(row.get("stats"))
        lines.append(
            [
                row.get("solver"),
                chip(row.get("status")),
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
    names = {str(_mapping(row.get("task")).get("name")) for row in rows}
    title = f"Solvers compared: {', '.join(sorted(names)) or 'no task'}"
    words = "Each solver began with a cold cache." if not document.get("warm") else "Warm cache."
    made = table(f"{len(lines)} solvers side by side", columns, lines, "   nnnnn")
    timed = [
        PlanBar(
            str(row.get("solver")), str(row.get("status")), str(row.get("status")), 0.0, took, ""
        )
        for row in rows
        if (took := _seconds_of(row)) is not None
    ]
    sections = [Section("solvers", "Solvers", made)]
    if timed:
        drawing = replace(gantt_picture(timed, "Seconds of each solver"), cursor=None)
        caption = "How long each solver took [s]; the colour is its status."
        sections.append(Section("times", "Seconds", figure(drawing, f"{name}-times", caption)))
    return Chapter(name, title, tag("p", {"class": "lead"}, words), sections)


def _seconds_of(row: Mapping[str, Any]) -> float | None:
    took = _mapping(row.get("stats")).get("wall_s")
    return float(took) if isinstance(took, int | float) and took >= 0 else None


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def training_chapter(
    manifest: Sequence[tuple[str, object]],
    document: Mapping[str, Any] | None,
    images: Sequence[Markup],
    heading: str,
    name: str,
) -> Chapter:
    """Return what runs of a learner came to, with their learning curves.

    Parameters
    ----------
    manifest
        What was to be learned, and how: names with what is said of them.
    document
        ``skillplan.training/1``; None where it is not finished.
    images
        Learning curves.
    heading, name
        Of the chapter.
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
                chip(run.get("status")),
                number(run.get("cost")),
                share(run.get("deviation")),
                share(run.get("success_rate")),
                number(run.get("best_cost_seen")),
                number(run.get("wall_s"), 3),
            ]
        )
    columns = ["run", "seed", "status", "cost", "deviation", "success", "best seen", "seconds"]
    if lines:
        made = table(f"{len(lines)} runs", columns, lines, " n nnnnn")
        sections.append(Section("runs", "Runs", made))
    sections.append(Section("facts", "What was learned, and how", facts(manifest)))
    rate = (document or {}).get("success_rate")
    words = (
        "The training has not finished."
        if document is None
        else (
            f"{len(lines)} runs; optimum {number(document.get('optimum'))} "
            f"{document.get('cost_unit') or ''}; success of the policies {share(rate)}."
        )
    )
    return Chapter(name, heading, tag("p", {"class": "lead"}, words), sections)
