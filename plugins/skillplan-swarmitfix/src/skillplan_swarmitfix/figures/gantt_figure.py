"""Gantt chart of head, parallel kinematic machine and base in the five steps.

Veeramani and Muthuswamy 2022, section 3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from skillplan.views.figures import figure_style as style
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan_swarmitfix.figures.bench_canvas import get_requested_bench

SOLVER = "exact"
STEPS = {
    "retract": style.BLUE,
    "park": style.PURPLE,
    "swing": "#d9dce0",
    "approach": style.ORANGE,
    "support": style.GREEN,
}
"""Colour of each of the five steps, in their order."""
ROWS = ("head", "pkm", "base")

_LEFT_IN, _RIGHT_IN, _LINE_IN, _BAR_IN, _GAP_IN = 0.75, 0.3, 10.5, 0.3, 0.85
_SCALE_IN_PER_S = 0.2
_MOST_LINES = 8


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar of one of the five steps.

    Parameters
    ----------
    sequence
        Number of the sequence, from 1.
    step
        Name of the step, such as ``swing``.
    agents
        Busy agents among ``head``, ``pkm`` and ``base``.
    start_s, end_s
        Begin and end [s], from 0.
    labels
        Texts by agent, such as ``B2: C66 to C54``.

    Raises
    ------
    ValueError
        If the step or an agent is unknown, or it ends before it starts.
    """

    sequence: int
    step: str
    agents: tuple[str, ...]
    start_s: float
    end_s: float
    labels: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.step not in STEPS:
            raise ValueError(f"{self.step!r} is none of the steps {', '.join(STEPS)}.")
        unknown = [agent for agent in (*self.agents, *self.labels) if agent not in ROWS]
        if unknown:
            raise ValueError(f"{unknown[0]!r} is none of the agents {', '.join(ROWS)}.")
        if not 0 <= self.start_s <= self.end_s:
            raise ValueError(f"A step cannot run from {self.start_s} s to {self.end_s} s.")


@style.in_house_style
def draw_gantt(bars: Sequence[Bar], heading: style.Heading) -> Figure:
    """Draw a Gantt chart in as many lines as needed.

    Parameters
    ----------
    bars
        Steps in order of time, at least one.

    Raises
    ------
    ValueError
        If `bars` is empty.
    """
    if not bars:
        raise ValueError("A Gantt chart needs at least one step.")
    lines, per_line_s = _split_lines(bars)
    width_in = _LEFT_IN + _LINE_IN + _RIGHT_IN
    used = [step for step in STEPS if any(bar.step == step for bar in bars)]
    columns, legend_in = style.fit_legend(used, width_in - 0.4)
    tall_in = _BAR_IN * len(ROWS)
    each_in = tall_in + _GAP_IN
    head_in = heading.height_in(width_in - 0.4)
    height_in = head_in + each_in * len(lines) + legend_in + 0.05
    figure = style.create_sheet(width_in, height_in, heading)
    for number, line in enumerate(lines):
        top_in = height_in - head_in - 0.25 - number * each_in
        begin_s = line[0].start_s
        span_s = max(line[-1].end_s - begin_s, 1e-3 * per_line_s)
        wide_in = _LINE_IN * span_s / per_line_s
        axes = style.add_axes_in(figure, _LEFT_IN, top_in - tall_in, wide_in, tall_in)
        axes.set_xlim(begin_s, begin_s + span_s)
        _draw_line(axes, line, wide_in / span_s, last=number == len(lines) - 1)
    handles = [Patch(facecolor=STEPS[step], edgecolor=style.INK, linewidth=0.5) for step in used]
    figure.legend(
        handles,
        used,
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.05 / height_in),
        ncols=columns,
        borderaxespad=0.0,
    )
    return figure


def _split_lines(bars: Sequence[Bar]) -> tuple[list[list[Bar]], float]:
    """Return the bars of every line, broken between sequences, and the time of a line [s]."""
    total_s = bars[-1].end_s - bars[0].start_s
    per_line_s = max(_LINE_IN / _SCALE_IN_PER_S, total_s / _MOST_LINES * 1.15)
    if total_s <= per_line_s:
        return [list(bars)], max(total_s, 1e-9)
    sequences: dict[int, list[Bar]] = {}
    for bar in bars:
        sequences.setdefault(bar.sequence, []).append(bar)
    lines: list[list[Bar]] = []
    for group in sequences.values():
        if lines and group[-1].end_s - lines[-1][0].start_s <= per_line_s:
            lines[-1] += group
        else:
            lines.append(list(group))
    return lines, max(line[-1].end_s - line[0].start_s for line in lines)


def _draw_line(axes: Axes, bars: Sequence[Bar], in_per_s: float, *, last: bool) -> None:
    axes.set_ylim(len(ROWS) - 0.5, -0.5)
    axes.set_yticks(range(len(ROWS)), [row.upper() if row == "pkm" else row for row in ROWS])
    axes.tick_params(axis="y", length=0, labelsize=style.SMALL_PT + 0.5, labelcolor=style.INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.grid(axis="x")
    if last:
        axes.set_xlabel("time [s]")
    for bar in bars:
        for agent in bar.agents:
            axes.barh(
                ROWS.index(agent),
                bar.end_s - bar.start_s,
                left=bar.start_s,
                height=0.8,
                color=STEPS[bar.step],
                edgecolor=style.INK if bar.step == "swing" else "none",
                linewidth=0.5,
            )
        for agent, label in bar.labels.items():
            _write_in(axes, bar, agent, label, in_per_s)
    _mark_sequences(axes, bars, in_per_s)


def _write_in(axes: Axes, bar: Bar, agent: str, label: str, in_per_s: float) -> None:
    """Write a label into the bar of an agent, as large as fits."""
    room_in = (bar.end_s - bar.start_s) * in_per_s - 0.06
    size_pt = style.SMALL_PT * min(
        1.0, room_in / max(1e-6, style.measure_text_in(label, style.SMALL_PT))
    )
    if size_pt >= style.LEAST_PT:
        axes.text(
            (bar.start_s + bar.end_s) / 2,
            ROWS.index(agent),
            label,
            ha="center",
            va="center_baseline",
            size=size_pt,
        )


def _mark_sequences(axes: Axes, bars: Sequence[Bar], in_per_s: float) -> None:
    """Draw a line at the start of each sequence, and write its number above if it fits."""
    first: dict[int, float] = {}
    until: dict[int, float] = {}
    for bar in bars:
        first.setdefault(bar.sequence, bar.start_s)
        until[bar.sequence] = bar.end_s
    free_from_s = -1.0
    for sequence, start_s in first.items():
        axes.axvline(
            start_s, color=style.MUTED, linewidth=0.9, linestyle=(0, (4, 2)), ymax=1.22
        ).set(clip_on=False, zorder=4)
        middle_s = (start_s + until[sequence]) / 2
        text = f"sequence {sequence}"
        room_in = (until[sequence] - start_s) * in_per_s
        if style.measure_text_in(text, style.SMALL_PT) + 0.08 > room_in:
            text = str(sequence)
        half_s = (style.measure_text_in(text, style.SMALL_PT) / 2 + 0.02) / in_per_s
        if middle_s - half_s < free_from_s:
            continue
        free_from_s = middle_s + half_s
        axes.text(
            middle_s,
            -0.68,
            text,
            ha="center",
            va="center_baseline",
            size=style.SMALL_PT,
            color=style.MUTED,
            backgroundcolor=style.PAPER,
            bbox={"facecolor": style.PAPER, "edgecolor": "none", "pad": 0.4},
            zorder=5,
        )


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the whole chain."""
    get_requested_bench(request)
    last = request.problem.tasks[-1]
    if len(last.places_in(last.initial)) != 1:
        raise request.unfit("it shows one base that walks, but the file has several")
    return [request.chain_run()]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the timeline of a solved chain.

    Raises
    ------
    OptionError
        If the chain has no timeline.
    """
    chain = outcomes[0].chain
    timeline = chain.account.document.get("timeline")
    if not timeline:
        raise request.unfit("the solved file has no five steps")
    bars = []
    for phase in timeline:
        bars.append(
            Bar(
                phase["sequence"],
                phase["step"],
                tuple(phase["agents"]),
                phase["start_s"],
                phase["end_s"],
                _list_labels(phase.get("swing")),
            )
        )
    swings = sum(bar.step == "swing" for bar in bars)
    title = (
        f"The five steps of {chain.name}: {swings} swings, {bars[-1].end_s:.1f} s, "
        f"{bars[-1].sequence} sequences"
    )
    return draw_gantt(bars, style.Heading(title, request.details(outcomes[0].run)))


def _list_labels(swing: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the labels of base and PKM in a swing."""
    if swing is None:
        return {}
    turn = f"{swing['counter_rotation_deg']:+d}\N{DEGREE SIGN}"
    return {
        "base": f"{swing['action']}: {swing['start']} \N{RIGHTWARDS ARROW} {swing['end']}",
        "pkm": "turns " + turn.replace("-", "\N{MINUS SIGN}"),
    }
