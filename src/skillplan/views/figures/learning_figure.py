"""Learning curves: steps of an episode against episodes, for two sets of parameters.

Veeramani and Muthuswamy 2022, Fig. 8 and section 5.2.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from skillplan.records.result import Result
from skillplan.task.task import Task
from skillplan.views.figures import figure_style as style
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run

SOLVER = "sarsa"
SETS: Mapping[str, Mapping[str, str]] = {
    "set 1": {"gamma": "0.999", "alpha": "0.1", "epsilon": "0.1"},
    "set 2": {"gamma": "0.85", "alpha": "0.001", "epsilon": "0.01"},
}
"""The two sets of parameters of section 5.2."""
_GREEK = {
    "gamma": "\N{GREEK SMALL LETTER GAMMA}",
    "alpha": "\N{GREEK SMALL LETTER ALPHA}",
    "epsilon": "\N{GREEK SMALL LETTER EPSILON}",
}
_COLOURS, _DASHES = (style.BLUE, style.RED), ("-", (0, (5, 1.5)))
_POINTS = 10_000
_BINS = 48
_PANELS = 2


@dataclass(frozen=True)
class LearningCurve:
    """Steps of the episodes of several runs with the same parameters.

    Parameters
    ----------
    episodes
        Ends of the intervals over which steps are averaged, ascending, shape (n,).
    steps
        Mean steps of an episode in each interval, shape (runs, n), at least one run.

    Raises
    ------
    ValueError
        If runs are missing, the shapes differ, or episodes do not ascend from 1 on.
    """

    label: str
    episodes: NDArray[np.float64]
    steps: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.steps.ndim != 2 or not self.steps.size:
            raise ValueError(f"The learning curve {self.label!r} has no run.")
        if self.steps.shape[1] != len(self.episodes):
            raise ValueError(
                f"The learning curve {self.label!r} has {len(self.episodes)} stretches, but "
                f"steps of {self.steps.shape[1]}."
            )
        if self.episodes[0] < 1 or (np.diff(self.episodes) <= 0).any():
            raise ValueError(f"Episodes of {self.label!r} must ascend from 1 on.")

    def binned(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return middles and steps of intervals of about equal length on a log axis."""
        widths = np.diff(self.episodes, prepend=0.0)
        edges = np.geomspace(1.0, self.episodes[-1] + 1.0, _BINS + 1)
        member = np.clip(np.searchsorted(edges, self.episodes, side="right") - 1, 0, _BINS - 1)
        bins = np.unique(member)
        middles, steps = [], []
        for number in bins.tolist():
            inside = member == number
            middles.append(np.average(self.episodes[inside] - (widths[inside] - 1) / 2))
            steps.append(np.average(self.steps[:, inside], axis=1, weights=widths[inside]))
        return np.array(middles), np.array(steps).T


@dataclass(frozen=True)
class LearningPanel:
    """The curves of one task.

    Parameters
    ----------
    curves
        At most one curve for each set of parameters.
    fewest
        Mean of the fewest steps over all starts; None if unknown.

    Raises
    ------
    ValueError
        If the number of curves is not 1 or 2.
    """

    title: str
    curves: tuple[LearningCurve, ...]
    fewest: float | None = field(default=None)

    def __post_init__(self) -> None:
        if not 1 <= len(self.curves) <= len(_COLOURS):
            raise ValueError(f"A panel shows 1 to {len(_COLOURS)} curves, not {len(self.curves)}.")


@style.in_house_style
def draw_learning(panels: Sequence[LearningPanel], heading: style.Heading) -> Figure:
    """Draw learning curves on logarithmic axes: mean and range of all runs.

    Parameters
    ----------
    panels
        One panel for each task, at least one.

    Raises
    ------
    ValueError
        If `panels` is empty.
    """
    if not panels:
        raise ValueError("No learning curve to draw.")
    left_in, wide_in, tall_in, gap_in = 0.8, 4.6, 3.4, 0.35
    width_in = left_in + len(panels) * wide_in + (len(panels) - 1) * gap_in + 0.3
    labels = [curve.label for curve in panels[0].curves]
    if any(panel.fewest is not None for panel in panels):
        labels.append("fewest, mean over all starts")
    columns, legend_in = style.fit_legend(labels, width_in - 0.9)
    head_in = heading.height_in(width_in - 0.4)
    bottom_in = 0.6 + legend_in
    figure = style.create_sheet(width_in, head_in + 0.35 + tall_in + bottom_in, heading)
    first: Axes | None = None
    for number, panel in enumerate(panels):
        place = left_in + number * (wide_in + gap_in)
        axes = style.add_axes_in(figure, place, bottom_in, wide_in, tall_in)
        if first is None:
            first = axes
            axes.set_ylabel("steps of an episode [-]")
        else:
            axes.sharey(first)
            axes.tick_params(axis="y", labelleft=False)
        _draw_panel(axes, panel)
    assert first is not None
    handles, names = first.get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.05 / figure.get_size_inches()[1]),
        ncols=columns,
        borderaxespad=0.0,
        handlelength=2.6,
    )
    return figure


def _draw_panel(axes: Axes, panel: LearningPanel) -> None:
    for curve, colour, dashes in zip(panel.curves, _COLOURS, _DASHES, strict=False):
        episodes, steps = curve.binned()
        axes.fill_between(
            episodes, steps.min(axis=0), steps.max(axis=0), color=colour, alpha=0.2, linewidth=0
        )
        axes.plot(episodes, steps.mean(axis=0), color=colour, linestyle=dashes, label=curve.label)
    if panel.fewest is not None:
        axes.axhline(
            panel.fewest,
            color=style.INK,
            linewidth=1.0,
            linestyle=":",
            label="fewest, mean over all starts",
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        style.label_log_axis(axis)
    axes.grid(which="major")
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("episode [-]")
    axes.set_title(panel.title, loc="left", size=style.SMALL_PT + 1.5)


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return a run for every task, set of parameters and seed.

    Raises
    ------
    OptionError
        If the user gives an option that the sets give, or the solver does not learn from episodes.
    """
    chosen = [key for key in next(iter(SETS.values())) if key in request.options]
    if chosen:
        raise request.unfit(f"it compares two sets of parameters; leave -O {chosen[0]} out")
    request.check_records(("record", *next(iter(SETS.values()))), "episodes")
    record = {} if "record" in request.options else {"record": str(_POINTS)}
    return [
        Run(task, {**options, **record}, seed, may_fail=True)
        for task in _choose_tasks(request)
        for options in SETS.values()
        for seed in range(request.seeds)
    ]


def _choose_tasks(request: FigureRequest) -> list[Task]:
    """Return the requested task, or the first two tasks of walking, or the only task."""
    if request.part is not None:
        return [request.problem.part(request.part)]
    return request.walks()[:_PANELS] or [request.problem.task]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the curves that a learner recorded.

    Raises
    ------
    OptionError
        If the solver recorded none.
    """
    panels = []
    for task in _choose_tasks(request):
        curves = []
        for name, options in SETS.items():
            results = [
                outcome.result
                for outcome in outcomes
                if outcome.run.task is task and options.items() <= outcome.run.options.items()
            ]
            values = ", ".join(f"{_GREEK[key]} = {value}" for key, value in options.items())
            curves.append(_build_curve(request, f"{name}: {values}", results))
        start, goal = request.ends(task) if task in request.walks() else (None, None)
        title = task.name if start is None else f"{task.name}: {start} to {goal}"
        panels.append(LearningPanel(title, tuple(curves), _average_fewest(request, task)))
    repetitions = "1 run" if request.seeds == 1 else f"mean and range of {request.seeds} runs"
    starts = {outcome.result.trace.get("starts", "exploring") for outcome in outcomes}
    begin = "anywhere" if starts == {"exploring"} else "at the task's start"
    heading = style.Heading(
        f"Learning curves of {request.solver} on {request.problem.name}",
        f"{request.details(*(outcome.run for outcome in outcomes))},  {repetitions} a set,  "
        f"episodes begin {begin}",
    )
    return draw_learning(panels, heading)


def _build_curve(request: FigureRequest, label: str, results: Sequence[Result]) -> LearningCurve:
    for result in results:
        if not result.trace.get("episodes") or not result.trace.get("steps_per_episode"):
            raise request.unfit(f"{result.solver} was stopped before it had recorded an episode")
    shared = min(len(result.trace["episodes"]) for result in results)
    return LearningCurve(
        label,
        np.array(results[0].trace["episodes"][:shared], dtype=np.float64),
        np.array([result.trace["steps_per_episode"][:shared] for result in results]),
    )


def _average_fewest(request: FigureRequest, task: Task) -> float | None:
    """Return the mean of the fewest steps to the goal over all starts; None if unknown."""
    if task not in request.walks():
        return None
    fewest = [steps for steps in request.walk_steps(task).fewest.values() if steps > 0]
    return statistics.fmean(fewest) if fewest else None
