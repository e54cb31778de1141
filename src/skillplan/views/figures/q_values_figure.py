"""Values of all actions in several states during learning.

Veeramani and Muthuswamy 2022, Fig. 7.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from skillplan.errors import name_hint
from skillplan.task.task import Task
from skillplan.views.figures import figure_style as style
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run

SOLVER = "sarsa"
_POINTS = 400
_STATES = 3
_WIDE_IN, _TALL_IN = 3.9, 3.1
_COLUMNS = 3
_MARKS = "osD^v<>PXhd*"


@dataclass(frozen=True)
class StateValues:
    """The values of the actions of one state.

    Parameters
    ----------
    values
        Curves by action, with one value for each point on the x axis.

    Raises
    ------
    ValueError
        If actions are missing, or the numbers of points differ.
    """

    state: str
    values: Mapping[str, Sequence[float]]

    def __post_init__(self) -> None:
        if len({len(curve) for curve in self.values.values()}) != 1:
            raise ValueError(f"Actions of {self.state} need values, all of them as many.")

    @property
    def best(self) -> str:
        """The action with the largest last value; the first of several."""
        return max(self.values, key=lambda action: self.values[action][-1])


@style.in_house_style
def draw_q_values(
    episodes: Sequence[int],
    states: Sequence[StateValues],
    heading: style.Heading,
    *,
    order: Sequence[str] = (),
) -> Figure:
    """Draw the values of actions against episodes, with a panel for each state.

    Parameters
    ----------
    episodes
        Episodes of the points, ascending.
    order
        Order of the actions; missing ones come last.

    Raises
    ------
    ValueError
        If states are missing, or a state has not one value for each episode.
    """
    if not states:
        raise ValueError("No state to draw.")
    for state in states:
        if len(next(iter(state.values.values()))) != len(episodes):
            raise ValueError(f"State {state.state} has not a value for each of the episodes.")
    known = {action for state in states for action in state.values}
    actions = [action for action in order if action in known]
    actions += sorted(known - set(actions))
    named_in = 0.62 + max(style.measure_text_in(action, style.SMALL_PT + 0.5) for action in actions)
    columns = min(_COLUMNS, len(states))
    rows = math.ceil(len(states) / columns)
    left_in, gap_x_in, gap_y_in, bottom_in = 0.8, 0.65, 0.8, 0.6
    tall_in = max(_TALL_IN, 0.21 * len(actions)) if rows == 1 else _TALL_IN
    width_in = left_in + columns * _WIDE_IN + (columns - 1) * gap_x_in + 0.15 + named_in + 0.15
    head_in = heading.height_in(width_in - 0.4)
    height_in = head_in + 0.3 + rows * tall_in + (rows - 1) * gap_y_in + bottom_in
    figure = style.create_sheet(width_in, height_in, heading)
    for number, state in enumerate(states):
        row, column = divmod(number, columns)
        left = left_in + column * (_WIDE_IN + gap_x_in)
        bottom = bottom_in + (rows - 1 - row) * (tall_in + gap_y_in)
        axes = style.add_axes_in(figure, left, bottom, _WIDE_IN, tall_in)
        _draw_state(axes, episodes, state, actions)
        if column == 0:
            axes.set_ylabel("Q(s, a) [-]")
    lines = {
        line.get_label(): line
        for axes in figure.axes
        for line in axes.get_lines()
        if line.get_label() in actions
    }
    figure.legend(
        [lines[action] for action in actions],
        actions,
        loc="upper left",
        bbox_to_anchor=(1 - (named_in + 0.15) / width_in, 1 - (head_in + 0.25) / height_in),
        borderaxespad=0.0,
        labelspacing=0.45,
        handlelength=2.4,
    )
    return figure


def _draw_state(
    axes: Axes, episodes: Sequence[int], state: StateValues, actions: Sequence[str]
) -> None:
    best = state.best
    for action, curve in state.values.items():
        number = actions.index(action)
        colour, mark = choose_look(number)
        axes.plot(
            episodes,
            curve,
            color=colour,
            marker=mark,
            markersize=5.5 if action == best else 4,
            markevery=(len(episodes) // 24 * (number % 4), max(1, len(episodes) // 6)),
            linewidth=2.6 if action == best else 1.1,
            linestyle="-" if number < len(style.PALETTE) else "--",
            zorder=4 if action == best else 3,
            label=action,
        )
    axes.set_title(
        f"state {state.state}, best action {best}", loc="left", size=style.SMALL_PT + 1.5
    )
    axes.set_xlabel("episode [-]")
    axes.set_xlim(0, episodes[-1])
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.locator_params(axis="x", nbins=5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(style.FAINT)
    axes.grid()


def choose_look(number: int) -> tuple[str, str]:
    """Return colour and marker of an action by its number; up to 24 differ."""
    return style.PALETTE[number % len(style.PALETTE)], _MARKS[number % len(_MARKS)]


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the task and watches the states.

    Raises
    ------
    OptionError
        If a state is unknown, or the solver records no values.
    """
    request.check_records(("record", "watch"), "values of actions")
    task = _choose_task(request)
    options = {"watch": ",".join(_choose_states(request, task).values())}
    if "record" not in request.options:
        options["record"] = str(_POINTS)
    return [Run(task, options, may_fail=True)]


def _choose_task(request: FigureRequest) -> Task:
    """Return the requested task, or the first task of walking, or the only task."""
    if request.part is None and not request.problem.is_chain:
        return request.problem.task
    return request.walk()


def _choose_states(request: FigureRequest, task: Task) -> dict[str, str]:
    """Return the fact that selects each state, by the displayed name of the state."""
    facts = {place.name: fact for fact, place in task.places.items()}
    known = {**{name: name for name in task.facts.names}, **facts}
    for name in request.states:
        if name not in known:
            raise request.unfit(f"there is no state {name!r}", name_hint(name, known))
    if request.states:
        return {name: known[name] for name in request.states}
    if not task.places:
        raise request.unfit(
            "name the states by --states, each by a fact that holds in it alone, such as "
            f"--states '{task.facts.names[0]}'"
        )
    return {task.places[fact].name: fact for fact in _list_first_places(request, task)}


def _list_first_places(request: FigureRequest, task: Task) -> list[str]:
    """Return the facts of the start and of the next places on the way to the goal."""
    walk = request.walk_steps(task)
    here = next(fact for fact in task.initial if fact in task.places)
    facts = [here]
    while walk.fewest.get(here, 0) > 1 and len(facts) < _STATES:
        ends = [end for end in walk.successors[here] if end in walk.fewest]
        here = min(ends, key=lambda end: walk.fewest[end])
        facts.append(here)
    return facts


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the values that a learner recorded.

    Raises
    ------
    OptionError
        If the solver recorded none.
    """
    task, result = _choose_task(request), outcomes[0].result
    recorded = result.trace.get("q_values")
    episodes = result.trace.get("episodes")
    if not recorded or not episodes:
        raise request.unfit(f"{result.solver} was stopped before it had recorded a value")
    states = []
    for name, fact in _choose_states(request, task).items():
        keys = [key for key in recorded if fact in key.split(", ") and recorded[key]]
        if not keys:
            raise request.unfit(f"nothing is to be decided in state {name}, the goal or an end")
        states.append(StateValues(name, recorded[keys[0]]))
    title = f"Action values of {task.name}"
    if task in request.walks():
        title += ": from {} to {}".format(*request.ends(task))
    heading = style.Heading(title, request.details(outcomes[0].run))
    order = [skill.name for skill in task.skills]
    return draw_q_values(episodes, states, heading, order=order)
