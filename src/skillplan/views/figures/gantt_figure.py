"""A plan as bars on a time line, with a row for each agent and tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from skillplan.task.task import Task
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.figure_style import Heading
from skillplan.views.figures.picture import (
    SERIES,
    SMALL_PX,
    Note,
    Picture,
    make_rectangle,
    measure_text_px,
    shorten,
)

SOLVER = "auto"

CHANGE = "tool change"
FAILED, NOT_SIMULATED = "fails in simulation", "as planned, not simulated"
"""Marks of bars in a plan whose simulation failed."""

_WIDTH_PX, _LEFT_PX, _RIGHT_PX, _TOP_PX = 960.0, 12.0, 18.0, 8.0
_ROW_PX, _BAR_PX, _AXIS_PX, _LEGEND_PX = 34.0, 24.0, 38.0, 26.0
_MOST_NAME_PX, _LEAST_PX = 220.0, 7.5
_TICKS = 8


@dataclass(frozen=True, slots=True)
class PlanBar:
    """A bar: one agent busy for a while.

    Parameters
    ----------
    row
        Agent and tool, such as ``panda, gripper``.
    label
        Text in the bar: the part or the place.
    kind
        Kind of the skill or step, which has its own colour.
    start_s, end_s
        Begin and end [s], from 0.
    title
        Full description.
    short
        Text in a bar that is too narrow for the label; empty for a shortened label.
    mark
        `FAILED`, `NOT_SIMULATED` or empty.

    Raises
    ------
    ValueError
        If it ends before it starts.
    """

    row: str
    label: str
    kind: str
    start_s: float
    end_s: float
    title: str
    short: str = ""
    mark: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.start_s <= self.end_s:
            raise ValueError(f"A bar cannot run from {self.start_s} s to {self.end_s} s.")


def list_plan_bars(
    task: Task,
    skills: Sequence[str],
    durations_s: Sequence[float],
    times_s: Mapping[int, tuple[float, float]] | None = None,
    failed: int | None = None,
) -> list[PlanBar]:
    """Return a plan whose skills follow each other as bars.

    Parameters
    ----------
    skills, durations_s
        Names of the skills in order, and their durations [s].
    times_s
        Measured begin and end of steps [s]. Steps without them follow as planned.
    failed
        Step at which a simulation failed, from 0; later ones were not simulated.
    """
    bars = []
    now_s = 0.0
    for index, (name, duration_s) in enumerate(zip(skills, durations_s, strict=True)):
        skill = task.skill(name)
        tool = skill.parameters.get("tool")
        changes = skill.kind in ("load", "offload")
        agent = ", ".join(skill.agents)
        row = f"{agent}, {CHANGE}" if changes else f"{agent}, {tool}" if tool else agent
        begin_s, end_s = (times_s or {}).get(index, (now_s, now_s + duration_s))
        mark = "" if failed is None or index < failed else NOT_SIMULATED
        mark = FAILED if index == failed else mark
        subject = next((v for k, v in skill.parameters.items() if k in ("screw", "part")), tool)
        title = f"{index + 1}. {name}: {begin_s:.2f} s to {end_s:.2f} s, {end_s - begin_s:.2f} s"
        title += f", {mark}" if mark else ""
        label = str(subject or name)
        bars.append(PlanBar(row, label, skill.kind, begin_s, end_s, title, str(index + 1), mark))
        now_s = end_s
    return bars


def draw_gantt_picture(bars: Sequence[PlanBar], title: str, *, seeks: bool = False) -> Picture:
    """Return bars on a time line.

    Parameters
    ----------
    seeks
        True if bars and a cursor are connected with the player of a page.

    Raises
    ------
    ValueError
        If `bars` is empty.
    """
    if not bars:
        raise ValueError("A Gantt chart needs at least one bar.")
    rows = list(dict.fromkeys(bar.row for bar in bars))
    roles = {
        kind: SERIES[number % len(SERIES)]
        for number, kind in enumerate(dict.fromkeys(bar.kind for bar in bars))
    }
    marks = [mark for mark in (FAILED, NOT_SIMULATED) if any(bar.mark == mark for bar in bars)]
    names_px = min(_MOST_NAME_PX, max(measure_text_px(row) for row in rows)) + 12
    left, right = _LEFT_PX + names_px, _WIDTH_PX - _RIGHT_PX
    bottom = _TOP_PX + _ROW_PX * len(rows)
    legend_y = bottom + _AXIS_PX + 10
    height_px = bottom + _AXIS_PX + (2 if marks else 1) * _LEGEND_PX
    picture = Picture(_WIDTH_PX, height_px, title)
    end_s = max(max(bar.end_s for bar in bars), 1e-9)
    scale = (right - left) / end_s
    for time_s in MaxNLocator(_TICKS, steps=[1, 2, 5, 10]).tick_values(0, end_s):
        x = left + scale * time_s
        if x <= right + 1e-6:
            picture.line(((x, _TOP_PX), (x, bottom)), "faint", 0.8)
            picture.label((x, bottom + 12), f"{time_s:g}", "muted", SMALL_PX)
    picture.line(((left, bottom), (right, bottom)), "muted")
    picture.label(((left + right) / 2, bottom + 27), "time [s]", "muted", SMALL_PX)
    for number, row in enumerate(rows):
        top = _TOP_PX + _ROW_PX * number
        name = shorten(row, names_px - 8)
        picture.label((left - 8, top + _ROW_PX / 2), name, anchor="end")
        if number:
            picture.line(((left, top), (right, top)), "faint", 0.6)
    numbered = False
    for bar in bars:
        start, end = left + scale * bar.start_s, left + scale * bar.end_s
        middle = _TOP_PX + _ROW_PX * (rows.index(bar.row) + 0.5)
        note = Note(bar.title, bar.start_s if seeks else None)
        words = _draw_bar(picture, bar, (start, end), middle, roles[bar.kind], note)
        numbered = numbered or (words == bar.short and words.isdigit())
    x = left
    for kind, role in roles.items():
        square = make_rectangle(x, legend_y - 5, x + 10, legend_y + 5)
        picture.polygon(square, role, role, opacity=0.45)
        x = _write_entry(picture, x, legend_y, kind)
    if numbered:
        words = "a number: the step, where its bar is too narrow for a name"
        picture.label((x, legend_y), words, "muted", SMALL_PX, "start")
    x, legend_y = left, legend_y + _LEGEND_PX - 10
    for mark in marks:
        square = make_rectangle(x, legend_y - 5, x + 10, legend_y + 5)
        picture.polygon(square, "grey", **_LOOKS[mark]("grey"))
        x = _write_entry(picture, x, legend_y, mark)
    for bar in bars:
        if bar.mark == FAILED:
            x = left + scale * bar.end_s
            picture.line(((x, _TOP_PX), (x, bottom)), "red", 1.5, dashed=True)
    if seeks:
        picture.cursor = (left, right, _TOP_PX - 4, bottom + 4)
    return picture


_LOOKS: Mapping[str, Any] = {
    "": lambda role: {"stroke": "paper", "width_px": 1.0, "opacity": 0.45},
    FAILED: lambda role: {"stroke": "red", "width_px": 2.5, "opacity": 0.45},
    NOT_SIMULATED: lambda role: {"stroke": role, "dashed": True, "opacity": 0.12},
}
"""Styles of bars by mark, from the role of their kind."""


def _draw_bar(
    picture: Picture, bar: PlanBar, ends: tuple[float, float], middle: float, role: str, note: Note
) -> str:
    """Draw a bar from a left to a right end, and return the text in it."""
    left, right = ends
    top, bottom = middle - _BAR_PX / 2, middle + _BAR_PX / 2
    right = max(right, left + 1.0)
    picture.polygon(
        make_rectangle(left, top, right, bottom), role, note=note, **_LOOKS[bar.mark](role)
    )
    picture.polygon(make_rectangle(left, top, left + min(3.0, right - left), bottom), role)
    words, size_px = _fit_words(bar, right - left)
    if words:
        picture.label(((left + right) / 2 + 1.5, middle), words, size_px=size_px)
    return words


def _write_entry(picture: Picture, x: float, y: float, words: str) -> float:
    """Write a legend entry next to its square, and return the left end of the next."""
    picture.label((x + 15, y), words, "muted", SMALL_PX, "start")
    return x + 30 + measure_text_px(words, SMALL_PX)


def _fit_words(bar: PlanBar, width_px: float) -> tuple[str, float]:
    """Return the text in a bar and its size [px]; an empty text if none fits."""
    room_px = width_px - 6
    for words in (bar.label, bar.short):
        wide_px = measure_text_px(words, SMALL_PX)
        size_px = min(SMALL_PX, SMALL_PX * room_px / wide_px) if wide_px else 0.0
        if size_px >= _LEAST_PX:
            return words, size_px
    return ("" if bar.short else shorten(bar.label, room_px + 0.5, _LEAST_PX)), _LEAST_PX


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the task."""
    return [Run(_get_task_of_arm(request))]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the timeline of a solved task."""
    task, result = _get_task_of_arm(request), outcomes[0].result
    skills = [step.skill for step in result.steps]
    bars = list_plan_bars(task, skills, [step.duration_s for step in result.steps])
    title = f"Plan of {task.name}: {len(skills)} skills, {bars[-1].end_s:.1f} s"
    heading = Heading(title, request.details(outcomes[0].run))
    return draw_gantt_picture(bars, title).with_heading(heading)


def _get_task_of_arm(request: FigureRequest) -> Task:
    task = request.problem.part(request.part)
    if not task.scene.robots:
        raise request.unfit(
            f"it shows an arm, but the file is of kind {request.problem.kind}. Figures of any kind "
            "are rewards, learning and q-values"
        )
    return task
