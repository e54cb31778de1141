"""The input of a report chapter on a job on the bench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillplan.domains.load import Problem
from skillplan.views.figures.gantt_figure import PlanBar
from skillplan.views.report.chapters import ChainInput, chain_account
from skillplan.views.report.markup import Markup
from skillplan.views.report.plan_sections import figure
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.report.bench_picture import bench_picture
from skillplan_swarmitfix.report.bench_playback import bench_playback, fleet_playback, swings_of

_AGENTS = {"head": "head", "pkm": "PKM", "base": "base"}


def bench_input(
    problem: Problem, document: Mapping[str, Any], name: str, playing: bool
) -> ChainInput:
    """Return the input of a chapter on a chain of tasks.

    Parameters
    ----------
    problem
        The loaded file.
    document
        Its result.
    name
        Name of the chapter.
    playing
        True if the chapter may bring the playback of the page.
    """
    account = chain_account(problem, document)
    known = account.document
    playback, images = None, tuple[Markup, ...]()
    missing = "the file describes no bench, or nothing has been planned"
    if "bench" in known:
        shape = known["bench"]
        bench = Bench(shape["rows"], shape["cols"], shape["pitch_m"], shape["actions"])
        picture, words = bench_picture(problem.name, bench, known)
        images = (figure(picture, f"{name}-bench", words),)
        if not playing:
            missing = "the page plays another plan"
        elif known.get("timeline"):
            playback = bench_playback(problem.name, bench, known).document()
        elif known.get("schedule"):
            playback = fleet_playback(problem.name, bench, known).document()
    return ChainInput(
        document,
        listings=account.listings,
        refused=_refused(known, document),
        images=images,
        bars=_bars(known),
        playback=playback,
        missing=missing,
    )


def _refused(known: Mapping[str, Any], document: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the supports that the machine cannot hold, and the reason of the status."""
    rows = [
        (f"support {goal['sequence']} from {goal['goal']}", "out of reach", goal["pkm"]["reason"])
        for goal in known.get("goals") or ()
        if goal.get("pkm", {}).get("status") == "infeasible"
    ]
    if document.get("status") not in ("optimal", "solved"):
        name = str(document.get("task", {}).get("name"))
        rows.append((name, str(document.get("status")), str(document.get("reason") or "-")))
    return rows


def _bars(known: Mapping[str, Any]) -> list[PlanBar]:
    """Return the five steps of each sequence, or the swings of each base, as bars."""
    bars = []
    for phase in known.get("timeline") or ():
        swing = phase.get("swing")
        for agent in phase["agents"]:
            label = f"{swing['action']} to {swing['end']}" if swing else phase["step"]
            begin_s, end_s = phase["start_s"], phase["end_s"]
            words = f"{begin_s:.2f} s to {end_s:.2f} s"
            title = f"sequence {phase['sequence']}, {phase['step']}: {label}, {words}"
            short = swing["action"] if swing else ""
            row = _AGENTS[agent]
            bars.append(PlanBar(row, label, phase["step"], begin_s, end_s, title, short))
    if not bars and known.get("schedule"):
        for number, robot, action, (start, end), times in swings_of(known):
            words = f"{start} to {end}, {times[0]:.2f} s to {times[1]:.2f} s"
            title = f"step {number}: {robot} {action}, {words}"
            bars.append(PlanBar(robot, end, "swing", *times, title))
    return bars
