"""Action and reward of every step.

Veeramani and Muthuswamy 2022, Fig. 10.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.views.figures import figure_style as style
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run

SOLVER = "auto"
_RIGHT_IN, _STEP_IN, _MOST_IN = 0.3, 0.42, 14.0
# Bars smaller than the largest by more than this factor are invisible on a linear axis.
_MOST_RATIO = 100.0


@dataclass(frozen=True, slots=True)
class RewardStep:
    """A step and its reward.

    Parameters
    ----------
    place
        Place where it ends; empty if the robot does not walk.
    """

    sequence: str
    action: str
    place: str
    reward: float


@style.in_house_style
def draw_rewards(
    steps: Sequence[RewardStep], actions: Sequence[str], heading: style.Heading
) -> Figure:
    """Draw actions above and rewards below, for every step.

    Parameters
    ----------
    actions
        All actions in the order of the axis.

    Raises
    ------
    ValueError
        If steps are missing, or the action of a step is not among the actions.
    """
    if not steps:
        raise ValueError("No step to draw.")
    unknown = [step.action for step in steps if step.action not in actions]
    if unknown:
        raise ValueError(f"{unknown[0]!r} is none of the actions.")
    left_in = 0.65 + max(style.measure_text_in(action, style.SMALL_PT) for action in actions)
    wide_in = min(_MOST_IN, max(5.0, _STEP_IN * (len(steps) + 0.6)))
    width_in = left_in + wide_in + _RIGHT_IN
    upper_in, lower_in = max(1.2, 0.2 * len(actions)), 1.9
    below_in = 0.8 if any(step.place for step in steps) else 0.6
    head_in = heading.height_in(width_in - 0.4)
    height_in = head_in + 0.35 + upper_in + 0.15 + lower_in + below_in
    figure = style.create_sheet(width_in, height_in, heading)
    lower = style.add_axes_in(figure, left_in, below_in, wide_in, lower_in)
    upper = style.add_axes_in(figure, left_in, below_in + lower_in + 0.15, wide_in, upper_in)
    for axes in (upper, lower):
        axes.set_xlim(0.4, len(steps) + 0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y")
    _draw_actions(upper, steps, actions)
    _draw_rewards(lower, steps, wide_in)
    _mark_sequences(upper, lower, steps, wide_in)
    return figure


def _draw_actions(axes: Axes, steps: Sequence[RewardStep], actions: Sequence[str]) -> None:
    rows = [actions.index(step.action) for step in steps]
    axes.vlines(range(1, len(steps) + 1), -0.6, rows, color="#b9c7d3", linewidth=1.0, zorder=2)
    axes.plot(range(1, len(steps) + 1), rows, "o", color=style.BLUE, markersize=6, zorder=3)[
        0
    ].set_gid("actions")
    axes.set_yticks(range(len(actions)), list(actions))
    axes.set_ylim(-0.6, len(actions) - 0.4)
    axes.set_ylabel("action")
    axes.tick_params(axis="x", length=0, labelbottom=False)


def _draw_rewards(axes: Axes, steps: Sequence[RewardStep], wide_in: float) -> None:
    rewards = [step.reward for step in steps]
    numbers = range(1, len(steps) + 1)
    bars = axes.bar(
        numbers,
        rewards,
        width=0.62,
        color=[style.GREEN if reward >= 0 else style.RED for reward in rewards],
        edgecolor=style.INK,
        linewidth=0.4,
        zorder=3,
    )
    axes.axhline(0.0, color=style.INK, linewidth=0.8, zorder=4)
    _scale_rewards(axes, rewards)
    step_in = wide_in / (len(steps) + 0.2)
    texts = [_format_reward(reward) for reward in rewards]
    if max(style.measure_text_in(text, 6.5) for text in texts) + 0.05 <= step_in:
        axes.bar_label(bars, texts, padding=3, size=6.5)
    every = max(1, -(-len(steps) // int(wide_in / 0.3)))
    shown = [number for number in numbers if (number - 1) % every == 0]
    axes.set_xticks(shown, [_format_tick(number, steps[number - 1]) for number in shown])
    places = any(step.place for step in steps)
    axes.set_xlabel("step, and the position where it ends" if places else "step")


def _scale_rewards(axes: Axes, rewards: Sequence[float]) -> None:
    """Scale the axis of rewards with room for numbers; logarithmic if small bars would vanish."""
    low, high = min(0.0, *rewards), max(0.0, *rewards)
    sizes = [abs(reward) for reward in rewards if reward]
    if not sizes or max(sizes) <= _MOST_RATIO * min(sizes):
        room = 0.16 * ((high - low) or 1.0)
        axes.set_ylim(low - (room if low < 0 else 0.0), high + room)
        axes.set_ylabel("reward [-]")
        return
    # From zero to the smallest bar the axis is linear, beyond it logarithmic on both sides.
    linear = 10.0 ** math.floor(math.log10(min(sizes)))
    axes.set_yscale("symlog", linthresh=linear, linscale=0.5)
    axes.set_ylim(8 * low if low < 0 else 0.0, 8 * high if high > 0 else 0.0)
    decades = math.floor(math.log10(max(sizes))) - round(math.log10(linear))
    powers = [linear * 10.0**power for power in range(0, decades + 1, -(-decades // 3))]
    ticks = [-power for power in powers if -power >= low] + [0.0]
    ticks += [power for power in powers if power <= high]
    axes.set_yticks(ticks, [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("reward [-], log scale")


def _format_reward(reward: float) -> str:
    """Return a reward with two decimals, or with two digits if that would be 0."""
    text = f"{reward:.2g}" if 0 < abs(reward) < 0.095 else f"{reward:.2f}"
    return text.replace("-", "\N{MINUS SIGN}")


def _format_tick(number: int, step: RewardStep) -> str:
    return f"{number}\n{step.place}" if step.place else str(number)


def _mark_sequences(upper: Axes, lower: Axes, steps: Sequence[RewardStep], wide_in: float) -> None:
    """Separate the steps of different tasks, and write the names of the tasks above."""
    begins = [i for i, step in enumerate(steps) if i == 0 or step.sequence != steps[i - 1].sequence]
    if len(begins) == 1:
        return
    step_in = wide_in / (len(steps) + 0.2)
    names = [steps[begin].sequence for begin in begins]
    rooms_in = [step_in * (end - begin) for begin, end in pairwise([*begins, len(steps)])]
    if any(
        style.measure_text_in(name, style.SMALL_PT) > room_in - 0.06
        for name, room_in in zip(names, rooms_in, strict=True)
    ):
        prefix = names[0].rpartition("-")[0]
        _write_above(upper, 0.2, prefix, "right")
        names = [name.rpartition("-")[2] for name in names]
    free_from_in = -1.0
    for name, begin, end in zip(names, begins, [*begins[1:], len(steps)], strict=True):
        if begin:
            for axes in (upper, lower):
                axes.axvline(
                    begin + 0.5, color=style.MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1
                )
        middle, half_in = (begin + end + 1) / 2, style.measure_text_in(name, style.SMALL_PT) / 2
        if middle * step_in - half_in >= free_from_in:
            free_from_in = middle * step_in + half_in + 0.03
            _write_above(upper, middle, name, "center")


def _write_above(axes: Axes, x: float, text: str, align: Literal["center", "right"]) -> None:
    axes.text(
        x,
        1.03,
        text,
        transform=axes.get_xaxis_transform(),
        ha=align,
        va="bottom",
        size=style.SMALL_PT,
        color=style.MUTED,
    )


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves all tasks of the file."""
    return [request.chain_run()]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the steps of a solved file; without rewards, minus the cost of each step.

    Learners use the same stand-in for rewards.

    Raises
    ------
    OptionError
        If the plan has no step.
    """
    answer = outcomes[0].answer
    results: list[Result] = (
        [part.result for part in answer.main] if isinstance(answer, ChainResult) else [answer]
    )
    rewarded = request.problem.tasks[-1].reward is not None
    steps = [
        RewardStep(
            result.task,
            step.skill,
            step.place or "",
            (step.reward or 0.0) if rewarded else -step.cost,
        )
        for result in results
        for step in result.steps
    ]
    if not steps:
        raise request.unfit("nothing has to be done, so there is no step to draw")
    task = request.problem.tasks[-1]
    actions = [skill.name for skill in task.skills]
    idle = len(results) - len({step.sequence for step in steps})
    title = f"Actions and rewards of {request.problem.name}: {_count(len(steps), 'step')}"
    if len(results) > 1:
        title += f" for {len(results)} goals"
    details = request.details(outcomes[0].run)
    if not rewarded:
        details += ",  reward = -cost, as the file has no rewards"
    if idle:
        details += f",  {_count(idle, 'sequence')} without a step left out"
    return draw_rewards(steps, actions, style.Heading(title, details))


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
