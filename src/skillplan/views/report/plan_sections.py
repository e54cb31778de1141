"""Sections on a plan: playback, time line, table, pictures, refusals and measurements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.physics.performance import Performance, PerformedSkill
from skillplan.records.execution.simulation import PlannedTimes, compute_time_difference
from skillplan.task.task import Task, find_unreachable_facts
from skillplan.views.figures.exploded_figure import draw_exploded_view
from skillplan.views.figures.gantt_figure import FAILED, PlanBar, draw_gantt_picture, list_plan_bars
from skillplan.views.figures.layout_figure import draw_layout
from skillplan.views.figures.picture import Picture
from skillplan.views.figures.precedence_figure import draw_precedence
from skillplan.views.figures.precedence_graph import PrecedenceGraph
from skillplan.views.report.markup import Markup, join, note, number, numbers, seconds, table, tag
from skillplan.views.report.page import Section
from skillplan.views.report.pictures import embed_picture
from skillplan.views.report.summary import describe_planner
from skillplan.views.tables.trials import describe_difference


def caption_picture(picture: Picture, name: str, caption: str, description: str = "") -> Markup:
    """Return a picture with its caption, which scrolls on narrow pages."""
    svg = embed_picture(picture, name, description)
    scroll = tag(
        "div", {"class": "wide", "tabindex": "0", "role": "region", "aria-label": caption}, svg
    )
    return tag("figure", {}, scroll, tag("figcaption", {}, caption))


def build_playback_section(
    playback: Mapping[str, Any] | None, still: Markup | None, missing: str = ""
) -> Section:
    """Return the section with the player.

    Parameters
    ----------
    playback
        Document ``skillplan.playback/1``; None for none.
    still
        Picture that is shown until the player starts.
    missing
        Reason for a missing playback, in words.
    """
    if playback is None:
        return Section("playback", "Playback", note(f"The page has no playback: {missing}."))
    words = "Playing it in 3-D needs JavaScript and WebGL; all else on this page does not."
    inner = [still] if still is not None else []
    inner.append(tag("noscript", {}, note(words)))
    root = tag("div", {"id": "playback-root", "aria-label": playback["title"]}, *inner)
    source = str(playback.get("note") or "")
    if "not simulated" in source:
        # Readers without the player need this, too.
        root = join([root, note(f"The motion is {source}.")])
    return Section("playback", "Playback", root)


def list_bars(
    task: Task, document: Mapping[str, Any], played: Sequence[PerformedSkill]
) -> list[PlanBar]:
    """Return a plan as bars, with measured times as far as known, then as planned."""
    steps = _list_steps(document)
    times = {index: (skill.begin_s, skill.end_s) for index, skill in enumerate(played)}
    names = [str(step["skill"]) for step in steps]
    durations_s = [float(step["duration_s"]) for step in steps]
    return list_plan_bars(task, names, durations_s, times, _find_failure(played))


def _find_failure(played: Sequence[PerformedSkill]) -> int | None:
    """Return the index of the first failed skill, from 0; None without one."""
    return next(
        (index for index, skill in enumerate(played) if not skill.verdict.is_feasible), None
    )


def build_gantt_section(
    bars: Sequence[PlanBar], name: str, *, measured: bool, played: bool, along_paths: bool = False
) -> Section:
    """Return the time line, with a cursor if the plan is played."""
    planned = "Times along the planned paths." if along_paths else "Times as planned."
    caption = "Times as simulated." if measured else planned
    failed = next((index for index, bar in enumerate(bars) if bar.mark == FAILED), None)
    if failed is not None:
        later = "; later steps as planned, not simulated" if failed + 1 < len(bars) else ""
        caption = f"Times as simulated up to step {failed + 1}, which fails{later}."
    picture = draw_gantt_picture(bars, "Plan by agent and tool over time", seeks=played)
    description = "; ".join(bar.title for bar in bars[:60])
    return Section(
        "gantt", "Time line", caption_picture(picture, f"{name}-gantt", caption, description)
    )


def build_plan_section(
    task: Task,
    document: Mapping[str, Any],
    done: Sequence[PerformedSkill] | None,
    how: str = "simulated",
) -> Section:
    """Return the plan step by step.

    Parameters
    ----------
    task, document
        The task and its ``skillplan.result/1``.
    done
        Performed skills with begin and end; later ones follow as planned. None if only planned
        times are known.
    how
        Source of their times: ``simulated`` or ``played``.
    """
    now_s, rows = 0.0, []
    costs = numbers([step["cost"] for step in _list_steps(document)])
    waits = any(step.get("wait_s") for step in _list_steps(document))
    for index, step in enumerate(_list_steps(document)):
        measured = done[index] if done is not None and index < len(done) else None
        begin_s = now_s if measured is None else measured.begin_s
        now_s = begin_s + float(step["duration_s"]) if measured is None else measured.end_s
        rows.append(
            [
                str(index + 1),
                tag("code", {}, step["skill"]),
                _get_tool(task, str(step["skill"])),
                seconds(begin_s),
                seconds(step["duration_s"]),
                *([seconds(step["wait_s"]) if step.get("wait_s") else "-"] if waits else []),
                *([_format_time(measured, how)] if done is not None else []),
                costs[index],
                _format_place(step.get("goal")),
                *(
                    [step.get("way") or "-"]
                    if any("way" in s for s in _list_steps(document))
                    else []
                ),
            ]
        )
    columns = ["step", "skill", "tool", "begins [s]", "planned [s]"]
    columns += ["of it waits [s]"] if waits else []
    columns += [f"{how} [s]"] if done is not None else []
    unit = task.metric.unit
    columns += [f"cost [{unit}]", "ends at [m]"]
    columns += ["way"] if any("way" in step for step in _list_steps(document)) else []
    kinds = "np nn" + ("n" if waits else "") + ("n" if done is not None else "") + "np"
    caption = f"{len(rows)} skills in order; planned times by {describe_planner(document)}"
    return Section("plan", "The plan", table(caption, columns, rows, kinds))


def _format_time(measured: PerformedSkill | None, how: str) -> Markup:
    """Return the time of a skill, marked if it failed or was not done."""
    if measured is None:
        return join([f"not {how}"])
    took = seconds(measured.end_s - measured.begin_s)
    if measured.verdict.is_feasible:
        return join([took])
    return join([f"{took} ", tag("span", {"class": "chip bad"}, "fails")])


def build_picture_section(task: Task, document: Mapping[str, Any], name: str) -> Section:
    """Return the cell from above and, if there is a plan, the exploded view."""
    skills = [str(step["skill"]) for step in _list_steps(document)]
    above = draw_layout(task, skills)
    words = "The cell from above" + (
        ", with the path of the plan; a number stands where its step ends." if skills else "."
    )
    figures = [caption_picture(above, f"{name}-layout", words)]
    try:
        exploded = draw_exploded_view(task, skills)
    except ValueError:
        pass
    else:
        words = "The product taken apart, numbered in the order in which parts are added."
        figures.append(caption_picture(exploded, f"{name}-exploded", words))
    return Section("pictures", "Cell and product", join(figures))


def build_precedence_section(graph: PrecedenceGraph, name: str) -> Section:
    """Return the precedence relation as a graph, and as a table with reasons."""
    picture = draw_precedence(graph, "Precedence relation")
    caption = (
        "Precedence relation. Rest the pointer on an arrow to read why; the table has it, too."
    )
    rows = [[edge.before, edge.after, edge.why.partition(": ")[2]] for edge in graph.edges]
    parts = [caption_picture(picture, f"{name}-precedence", caption)]
    if rows:
        listed = table("Pairs that follow from no others", ["before", "after", "why"], rows)
        parts.append(tag("details", {}, tag("summary", {}, f"All {len(rows)} pairs"), listed))
    return Section("precedence", "Precedence", join(parts))


def collect_refusals(
    task: Task,
    document: Mapping[str, Any],
    graph: PrecedenceGraph | None,
    performance: Performance | None,
) -> Section:
    """Return unreachable facts and refused skills with reasons."""
    rows: list[tuple[object, object, object]] = []
    rows += [(fact, "out of reach", why) for fact, why in find_unreachable_facts(task).items()]
    if performance is not None:
        for skill in performance.skills:
            if not skill.verdict.is_feasible:
                finding = f"{skill.verdict.status.value} in simulation"
                rows.append((skill.skill, finding, skill.verdict.reason))
    if graph is not None:
        skills = {skill.name for skill in task.skills}
        for words in graph.notes:
            first = words.partition(" ")[0]
            rows.append((first if first in skills else task.name, "by geometry", words))
        for choice in graph.choices:
            words = f"{choice.skill}: {choice.words}"
            rows.append((choice.component, "needs one or another", words))
    if document.get("status") not in ("optimal", "solved"):
        for words in str(document.get("reason") or "-").splitlines():
            rows.append((task.name, str(document.get("status")), words))
    return build_refused_section(rows)


def build_refused_section(rows: Sequence[tuple[object, object, object]]) -> Section:
    """Return unreachable facts and refused skills: name, finding and reason of each."""
    if not rows:
        content = note("Nothing of this task was found to be out of reach or refused.")
    else:
        content = table(
            "Refused, or possible only in some orders", ["what", "finding", "why"], rows
        )
    return Section("refused", "Unreachable or refused", content)


def build_measured_section(
    task: Task, document: Mapping[str, Any], performance: Performance, engine: str
) -> Section:
    """Return the final offsets of bodies, and the difference from the planned time."""
    rows = [
        [
            arrival.body,
            number(1000 * arrival.offset_m, 3),
            number(math.degrees(arrival.tilt_rad), 3),
        ]
        for arrival in performance.arrivals
    ]
    words = (
        f"Executed by {engine} in one continuous world: {performance.simulated_s:.2f} s, "
        f"{performance.steps:,} steps."
    )
    steps = _list_steps(document)
    planned = PlannedTimes(
        [float(step["duration_s"]) for step in steps],
        str(document.get("timed_by") or ""),
        [float(step.get("wait_s") or 0.0) for step in steps],
    )
    skills = [task.skill(str(step["skill"])) for step in steps]
    times = compute_time_difference(task, skills, planned, performance)
    if times is not None:
        words += f" Times: {describe_difference(times, performance.pace)}."
    columns = ["body", "off its goal [mm]", "turned off it [deg]"]
    offsets = table("Final places of bodies", columns, rows, " nn") if rows else Markup("")
    return Section("measured", "As simulated", join([note(words), offsets]))


def _list_steps(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return list(document.get("steps") or ())


def _get_tool(task: Task, skill: str) -> str:
    return str(task.skill(skill).parameters.get("tool") or "-")


def _format_place(goal: object) -> str:
    if not isinstance(goal, list | tuple):
        return "-"
    return ", ".join(f"{value:.3f}" for value in goal)
