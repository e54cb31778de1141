"""Chapters on a plan of one task, or of a chain of tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from skillplan.domains.domain import Account, Listing
from skillplan.domains.load import Problem
from skillplan.errors import PluginError, SkillplanError
from skillplan.physics.performance import Performance, PerformedSkill
from skillplan.plugins.blame import ends_program
from skillplan.plugins.installed import chapters
from skillplan.records.certificate import Certificate
from skillplan.task.task import Task
from skillplan.views.figures.exploded_figure import draw_exploded_view
from skillplan.views.figures.gantt_figure import PlanBar
from skillplan.views.figures.precedence_graph import PrecedenceGraph
from skillplan.views.report.markup import Markup, facts, join, note, number, seconds, table
from skillplan.views.report.page import Chapter, Section
from skillplan.views.report.pictures import embed_picture
from skillplan.views.report.plan_sections import (
    build_gantt_section,
    build_measured_section,
    build_picture_section,
    build_plan_section,
    build_playback_section,
    build_precedence_section,
    build_refused_section,
    collect_refusals,
    list_bars,
)
from skillplan.views.report.summary import build_lead, build_summary_section, format_chip

Plugins = Sequence[tuple[str, str]]
# Width of the name column in remarks, which are written for a terminal.
_NAME_COLUMN = 11


@dataclass(frozen=True)
class PlanInput:
    """The input of a chapter on one task.

    Parameters
    ----------
    graph
        Precedence relation; None for none.
    performance, engine
        Performance of the plan and name of its engine; None and empty if it was not performed.
    playback
        ``skillplan.playback/1``; None for none.
    missing
        Reason for a missing playback.
    played
        Skills with begin and end in the playback of a plan that was not performed.
    certificate
        Verification of a stored result; None for a result that was solved for the page.
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
    certificate: Certificate | None = None


def build_plan_chapter(given: PlanInput, name: str) -> Chapter:
    """Return the chapter on a plan of one task."""
    document, task = given.document, given.task
    has_plan = bool(document.get("steps"))
    in_cell = bool(task.scene.robots and task.scene.bodies)
    sections: list[Section] = []
    measured = given.performance
    if has_plan and in_cell:
        sections.append(
            build_playback_section(given.playback, _draw_still(given, name), given.missing)
        )
    if has_plan and task.scene.robots:
        bars = list_bars(task, document, given.played if measured is None else measured.skills)
        whole = measured is not None and len(measured.skills) == len(document["steps"])
        sections.append(
            build_gantt_section(
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
        sections.append(build_plan_section(task, document, done, how))
    if in_cell:
        sections.append(build_picture_section(task, document, name))
    if given.graph is not None and given.graph.components:
        sections.append(build_precedence_section(given.graph, name))
    sections.append(collect_refusals(task, document, given.graph, measured))
    if measured is not None:
        sections.append(build_measured_section(task, document, measured, given.engine))
    sections += given.extra
    sections.append(
        build_summary_section(document, given.description, given.plugins, given.certificate)
    )
    took_s = measured.simulated_s if measured is not None and measured.failed is None else None
    played_s = max((skill.end_s for skill in given.played), default=None)
    lead = build_lead(document, took_s, played_s, given.certificate, task.covered)
    return Chapter(name, task.name, lead, sections)


def _draw_still(given: PlanInput, name: str) -> Markup | None:
    skills = [str(step["skill"]) for step in given.document["steps"]]
    try:
        return embed_picture(draw_exploded_view(given.task, skills), f"{name}-still")
    except ValueError:
        return None


@dataclass(frozen=True)
class ChainInput:
    """The input of a chapter on a chain of tasks; other parameters as in `PlanInput`.

    Parameters
    ----------
    document
        ``skillplan.result/1`` of a chain.
    refused
        Names, findings and reasons of refusals.
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
    certificate: Certificate | None = None


def prepare_chain_input(
    problem: Problem, document: Mapping[str, Any], name: str, playing: bool
) -> ChainInput:
    """Return the input of the chapter on a chain: prepared by a plugin, or else tables only.

    A plugin registers a function with these parameters in the entry point group
    ``skillplan.chapter``, under the kind of task.

    Parameters
    ----------
    document
        ``skillplan.result/1`` of the chain.
    name
        Name of the chapter, unique on the page.
    playing
        True if the chapter may bring a playback; a page has one at most.

    Raises
    ------
    PluginError
        If the plugin fails.
    """
    for point in chapters().select(name=problem.kind):
        try:
            prepared: ChainInput = point.load()(problem, document, name, playing)
        except BaseException as error:
            if isinstance(error, SkillplanError) or ends_program(error):
                raise
            raise PluginError(
                f"The report's chapter on tasks of kind {problem.kind!r} ({point.value}) failed: "
                f"{type(error).__name__}: {error}"
            ) from error
        return prepared
    missing = f"no plugin shows tasks of kind {problem.kind!r} in motion"
    return ChainInput(
        document, listings=get_chain_account(problem, document).listings, missing=missing
    )


def get_chain_account(problem: Problem, document: Mapping[str, Any]) -> Account:
    """Return the domain's account of a chain, from the plans in its result."""
    plans = {
        part["name"]: tuple(part["skills"])
        for part in [*document.get("stages", ()), *(document.get("sequences") or ())]
    }
    account: Account = problem.account(plans, document.get("replans", 0))
    return account


def build_chain_chapter(given: ChainInput, name: str) -> Chapter:
    """Return the chapter on a chain of tasks."""
    document = given.document
    sections = [build_playback_section(given.playback, None, given.missing)]
    if given.bars:
        sections.append(
            build_gantt_section(given.bars, name, measured=False, played=given.playback is not None)
        )
    if given.images:
        sections.append(Section("pictures", "Pictures", join(given.images)))
    parts = [*document.get("stages", ()), *(document.get("sequences") or ())]
    rows = [
        [
            part["name"],
            part.get("solver"),
            format_chip(part.get("status")),
            number(part.get("cost")),
            number(part.get("optimum")),
            number(part.get("makespan")),
            seconds(part.get("makespan_s")),
            _describe_path(part),
        ]
        for part in parts
    ]
    columns = ["task", "solver", "status", "cost", "optimum", "skills", "in all [s]", "path"]
    caption = f"{len(rows)} {'task' if len(rows) == 1 else 'tasks'} of the chain"
    sections.append(Section("plan", "The plan", table(caption, columns, rows, "   nnnn")))
    for index, listing in enumerate(given.listings):
        parts = [table(listing.title, listing.columns, listing.rows, captioned=False)]
        parts += _list_remarks(listing.notes)
        sections.append(Section(f"listing-{index + 1}", listing.title, join(parts)))
    sections.append(build_refused_section(given.refused))
    sections.append(
        build_summary_section(document, given.description, given.plugins, given.certificate)
    )
    title = str(document.get("task", {}).get("name"))
    return Chapter(name, title, build_lead(document, certificate=given.certificate), sections)


def _list_remarks(notes: Sequence[str]) -> list[Markup]:
    """Return remarks; a remark with a name in the first column becomes a fact."""
    named: list[tuple[str, str]] = []
    others = []
    for words in notes:
        column, value = words[:_NAME_COLUMN], words[_NAME_COLUMN:].strip()
        name = column.strip()
        if column.endswith(" ") and " " not in name and value:
            named.append((name, value))
        else:
            others.append(note(words))
    return [facts(named), *others] if named else others


def _describe_path(part: Mapping[str, Any]) -> str:
    places = part.get("path") or part.get("skills") or []
    return " ".join(map(str, places))
