"""The input of a report chapter on a job on the bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from skillplan.domains.load import Problem
from skillplan.views.figures.gantt_figure import PlanBar
from skillplan.views.figures.picture import (
    NUMBER_PX,
    SERIES,
    SMALL_PX,
    Note,
    Picture,
    make_rectangle,
    measure_text_px,
    place_number_rows,
)
from skillplan.views.report.chapters import ChainInput, get_chain_account
from skillplan.views.report.markup import Markup
from skillplan.views.report.plan_sections import caption_picture
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.report.bench_playback import (
    build_bench_playback,
    build_fleet_playback,
    list_swings,
)

_WIDTH_PX, _MARGIN_PX, _LEGEND_PX = 960.0, 20.0, 40.0
# Visible margin round the outermost pins [m].
_RIM_M = 0.12
_HEAD_PX, _NAME_PX = 5.0, 9.5


def draw_bench(name: str, bench: Bench, known: Mapping[str, Any]) -> tuple[Picture, str]:
    """Return the bench with its bases, heads and paths, and a caption.

    Parameters
    ----------
    known
        The domain's account of the solved file.
    """
    bench_sheet = _BenchSheet(name, bench, known)
    bench_sheet.draw_ground()
    if known.get("robots"):
        bench_sheet.draw_fleet(known["robots"])
        return bench_sheet.picture, "The path of each base, from dot to arrow."
    bench_sheet.draw_walk(known.get("goals") or (), known.get("timeline") or ())
    words = "The bench from above; a number stands where the base holds that support."
    return bench_sheet.picture, words


class _BenchSheet:
    def __init__(self, name: str, bench: Bench, known: Mapping[str, Any]) -> None:
        self.bench = bench
        self.points_m = [
            (float(x), float(y)) for x, y in (known.get("workpiece") or {}).get("points_m", ())
        ]
        shown = [*bench.pins_m.tolist(), *self.points_m]
        self.low = [min(point[axis] for point in shown) - _RIM_M for axis in (0, 1)]
        self.high = [max(point[axis] for point in shown) + _RIM_M for axis in (0, 1)]
        self.scale = (_WIDTH_PX - 2 * _MARGIN_PX) / (self.high[0] - self.low[0])
        self.foot_px = 2 * _MARGIN_PX + self.scale * (self.high[1] - self.low[1])
        title = f"Bench of {name} from above"
        self.picture = Picture(_WIDTH_PX, self.foot_px + _LEGEND_PX, title)

    def draw_ground(self) -> None:
        """Draw the pins and the trajectory."""
        for number, pin in enumerate(self.bench.pins_m.tolist(), start=1):
            note = Note(f"P{number}")
            self.picture.disc(self._pixels(pin), 3.0, "faint", "muted", 0.8, note=note)
        if len(self.points_m) > 1:
            line = [*map(self._pixels, self.points_m)]
            self.picture.line(line, "ink", 2.0, note=Note("trajectory"))

    def draw_walk(
        self, goals: Sequence[Mapping[str, Any]], timeline: Sequence[Mapping[str, Any]]
    ) -> None:
        """Draw the way of a base, its heads, and the stands that hold them."""
        for phase in timeline:
            swing = phase.get("swing")
            if swing:
                ends = (self._at(swing["start"]), self._at(swing["end"]))
                self.picture.line(ends, "muted", dashed=True)
        stands: dict[str, list[int]] = {}
        for goal in goals:
            stands.setdefault(goal["goal"], []).append(int(goal["sequence"]))
            self._draw_head(goal, SERIES[list(stands).index(goal["goal"]) % len(SERIES)])
        ends_at = {self._at(stand): numbers for stand, numbers in stands.items()}
        names = {self._at(stand): stand for stand in stands}
        rows = place_number_rows(ends_at, (_WIDTH_PX, self.foot_px))
        for row in rows:
            row.draw_leader(self.picture)
        for row in rows:
            supports = ", ".join(map(str, row.numbers))
            row.draw(self.picture, f"{names[row.at]}: supports {supports}")
            below = (row.centre[0], row.centre[1] + NUMBER_PX + 7)
            self.picture.label(below, names[row.at], "muted", _NAME_PX, halo=True)
        self._draw_legend()

    def _draw_head(self, goal: Mapping[str, Any], role: str) -> None:
        """Draw the head of a support, with a line from its stand."""
        spots = goal.get("support_m")
        if not spots:
            return
        x, y = self._pixels(spots[0])
        reach = goal.get("pkm") or {}
        beyond = reach.get("status") == "infeasible"
        self.picture.line((self._at(goal["goal"]), (x, y)), role, 1.4, dashed=beyond)
        box = make_rectangle(x - _HEAD_PX, y - _HEAD_PX, x + _HEAD_PX, y + _HEAD_PX)
        why = f": {reach['reason']}" if beyond else ""
        note = Note(f"support {goal['sequence']} from {goal['goal']}{why}")
        self.picture.polygon(box, "paper" if beyond else role, role, 1.4, note=note)

    def draw_fleet(self, robots: Sequence[Mapping[str, Any]]) -> None:
        """Draw the path of every base, shifted a little from the others."""
        for number, robot in enumerate(robots):
            role = SERIES[number % len(SERIES)]
            aside_px = 3.0 * (number - (len(robots) - 1) / 2)
            points = [self._at(stand) for stand in robot["path"]] or [self._at(robot["start"])]
            points = [(x + aside_px, y + aside_px) for x, y in points]
            note = Note(f"{robot['robot']}: {' '.join(robot['path'])}")
            self.picture.disc(points[0], 5.0, role, note=note)
            for begin, end in pairwise(points):
                self.picture.arrow(begin, end, role, 2.0, short_px=3.0)
            words = f"{robot['robot']}, {robot['start']} to {robot['goal']}"
            x, y = points[0]
            half_px = measure_text_px(words, SMALL_PX) / 2 + 8
            middle = min(max(x, half_px), _WIDTH_PX - half_px)
            label_y = y - 15 if y < self.foot_px / 2 else y + 15
            self.picture.label((middle, label_y), words, role, SMALL_PX, bold=True, halo=True)

    def _draw_legend(self) -> None:
        left, top = _MARGIN_PX, self.foot_px + 10
        for fill, words in (
            ("blue", "head, held from the number that its line leads to"),
            ("paper", "beyond the legs of the machine"),
        ):
            box = make_rectangle(left, top - _HEAD_PX, left + 2 * _HEAD_PX, top + _HEAD_PX)
            self.picture.polygon(box, fill, "blue", 1.4)
            self.picture.label((left + 16, top), words, "muted", SMALL_PX, "start")
            left += 36 + measure_text_px(words, SMALL_PX)
        self.picture.line(((left, top), (left + 18, top)), "muted", dashed=True)
        self.picture.label((left + 24, top), "way of the base", "muted", SMALL_PX, "start")

    def _at(self, stand: str) -> tuple[float, float]:
        x, y = self.bench.centroids_m[self.bench.position(stand)].tolist()
        return self._pixels((x, y))

    def _pixels(self, point: Sequence[float]) -> tuple[float, float]:
        x = _MARGIN_PX + self.scale * (point[0] - self.low[0])
        return (round(x, 2), round(_MARGIN_PX + self.scale * (self.high[1] - point[1]), 2))


_AGENTS = {"head": "head", "pkm": "PKM", "base": "base"}


def bench_input(
    problem: Problem, document: Mapping[str, Any], name: str, playing: bool
) -> ChainInput:
    """Return the input of a chapter on a chain of tasks.

    Parameters
    ----------
    playing
        True if the chapter may bring the playback of the page.
    """
    account = get_chain_account(problem, document)
    known = account.document
    playback, images = None, tuple[Markup, ...]()
    missing = "the file describes no bench, or nothing has been planned"
    if "bench" in known:
        shape = known["bench"]
        bench = Bench(shape["rows"], shape["cols"], shape["pitch_m"], shape["actions"])
        picture, words = draw_bench(problem.name, bench, known)
        images = (caption_picture(picture, f"{name}-bench", words),)
        if not playing:
            missing = "the page plays another plan"
        elif known.get("timeline"):
            playback = build_bench_playback(problem.name, bench, known).document()
        elif known.get("schedule"):
            playback = build_fleet_playback(problem.name, bench, known).document()
    return ChainInput(
        document,
        listings=account.listings,
        refused=_list_refused(known, document),
        images=images,
        bars=_list_bars(known),
        playback=playback,
        missing=missing,
    )


def _list_refused(
    known: Mapping[str, Any], document: Mapping[str, Any]
) -> list[tuple[str, str, str]]:
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


def _list_bars(known: Mapping[str, Any]) -> list[PlanBar]:
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
        for number, robot, action, (start, end), times in list_swings(known):
            words = f"{start} to {end}, {times[0]:.2f} s to {times[1]:.2f} s"
            title = f"step {number}: {robot} {action}, {words}"
            bars.append(PlanBar(robot, end, "swing", *times, title))
    return bars
