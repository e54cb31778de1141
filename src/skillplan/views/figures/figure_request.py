"""Requests for figures, the runs that they need, and the outcomes of these runs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from matplotlib.figure import Figure

from skillplan.chart.precedence_chart import DerivedChart
from skillplan.domains.load import Problem
from skillplan.errors import OptionError
from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.task.state import State
from skillplan.task.task import Task


class WalkSteps:
    """The places of a task with one robot, and what leads from one to another.

    Only preconditions and predictions count; no back end is queried.

    Parameters
    ----------
    task
        A task of walking: its skills change the place and nothing else that matters.
    goal
        The fact of the place where it leads.
    """

    def __init__(self, task: Task, goal: str) -> None:
        facts = task.facts
        placeless = task.initial - facts.of(*task.places)
        self.successors: Mapping[str, Sequence[str]] = {
            fact: _find_step_ends(task, placeless | facts.of(fact)) for fact in task.places
        }
        """Ends of the skills from every place, in their order, including the place itself."""
        self.fewest: Mapping[str, int] = self._search(goal)
        """Fewest steps to the goal, by place; places from which it is not reached are missing."""

    def _search(self, goal: str) -> dict[str, int]:
        """Return the fewest steps to the goal by place; breadth-first from the goal."""
        before: dict[str, list[str]] = {}
        for start, ends in self.successors.items():
            for end in ends:
                before.setdefault(end, []).append(start)
        fewest, frontier = {goal: 0}, deque([goal])
        while frontier:
            end = frontier.popleft()
            for start in before.get(end, ()):
                if start not in fewest:
                    fewest[start] = fewest[end] + 1
                    frontier.append(start)
        return fewest


def _find_step_ends(task: Task, state: State) -> list[str]:
    """Return the facts of the places where skills that begin in a state end."""
    ends = []
    for skill in task.skills:
        if skill.applicable(state):
            after = skill.prediction_in(state).apply(state)
            ends += [fact for fact in after if fact in task.places]
    return ends


# Options that headings always name, and options that they never name.
_TOLD = ("gamma", "alpha", "epsilon", "episodes")
_UNTOLD = ("watch", "record")


@dataclass(frozen=True, slots=True)
class Run:
    """A run of a solver that a figure needs.

    Parameters
    ----------
    task
        The task; None for the whole chain of the file.
    options
        Solver options in addition to the user's.
    seed
        Offset from the user's seed, >= 0.
    may_fail
        True if the figure can be drawn without a plan.

    Raises
    ------
    ValueError
        If the seed is negative.
    """

    task: Task | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    seed: int = 0
    may_fail: bool = False

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"A seed must be >= 0, not {self.seed}.")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a run: of its task, or of the whole chain."""

    run: Run
    answer: Result | ChainResult

    @property
    def result(self) -> Result:
        """The result of one task.

        Raises
        ------
        TypeError
            If the whole chain was solved.
        """
        if isinstance(self.answer, ChainResult):
            raise TypeError("The outcome is of a chain, not of one task.")
        return self.answer

    @property
    def chain(self) -> ChainResult:
        """The result of the whole chain.

        Raises
        ------
        TypeError
            If one task was solved.
        """
        if not isinstance(self.answer, ChainResult):
            raise TypeError("The outcome is of one task, not of a chain.")
        return self.answer


@dataclass(frozen=True)
class FigureRequest:
    """A figure that the user requests.

    Parameters
    ----------
    solver, options, seed
        Solver, the user's options for it as texts, and seed.
    parameters
        All solver options with their values, for headings.
    chart
        Function that derives the precedence relation of a task and returns it with the names of
        the back ends; None if only the hand-made relation is shown.
    part
        Name of the task; None for the figure's own choice.
    states
        Names of states; empty for the figure's own choice.
    seeds
        Number of repetitions of learning, >= 1.
    """

    figure: str
    problem: Problem
    solver: str
    options: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    part: str | None = None
    states: tuple[str, ...] = ()
    seeds: int = 5
    parameters: Mapping[str, Any] = field(default_factory=dict)
    chart: Callable[[Task], tuple[DerivedChart, Sequence[str]]] | None = None

    def __post_init__(self) -> None:
        if self.seeds < 1:
            raise ValueError(f"Learning is repeated at least once, not {self.seeds} times.")

    def unfit(self, reason: str, hint: str = "") -> OptionError:
        """Return an error with the reason why the figure cannot be drawn, and a hint."""
        words = f"Figure {self.figure!r} of {self.problem.name!r}: {reason}. {hint}"
        return OptionError(words.rstrip())

    def check_records(self, options: Iterable[str], what: str) -> None:
        """Check that the solver has the options that make it record the data.

        Raises
        ------
        OptionError
            If an option is missing.
        """
        if not set(options) <= self.parameters.keys():
            raise self.unfit(
                f"{self.solver} records no {what}; name a learner such as sarsa by --solver"
            )

    def chain_run(self) -> Run:
        """Return the run of the whole file.

        Raises
        ------
        OptionError
            If the request names a part.
        """
        if self.part is not None:
            raise self.unfit("it shows all tasks of the file; leave --part out")
        return Run() if self.problem.is_chain else Run(self.problem.tasks[0])

    def walks(self) -> list[Task]:
        """Return the tasks of walking from one place to another."""
        return [
            task
            for task in self.problem.tasks
            if None not in (ends := _find_ends(task)) and len(set(ends)) == 2
        ]

    def walk(self) -> Task:
        """Return the requested task of walking, or else the first one of the file.

        Raises
        ------
        OptionError
            If there is none, or the requested task is of another kind.
        """
        if self.part is None:
            walks = self.walks()
            if not walks:
                raise self.unfit("no task of the file leads from one place to another")
            return walks[0]
        task = self.problem.part(self.part)
        if None in _find_ends(task):
            names = ", ".join(walk.name for walk in self.walks()[:8]) or "none"
            raise self.unfit(f"{task.name} is not a task of walking; such are: {names}")
        return task

    def ends(self, task: Task) -> tuple[str, str]:
        """Return the names of the start and the goal of a task of walking."""
        start, goal = _find_ends(task)
        assert start is not None
        assert goal is not None
        return start, goal

    def walk_steps(self, task: Task) -> WalkSteps:
        """Return the graph of places of a task of walking."""
        (goal,) = (fact for fact in task.goal.requires if fact in task.places)
        return WalkSteps(task, goal)

    def details(self, *runs: Run, solver: str | None = None) -> str:
        """Return the task, solver, seed and options for the heading of a figure."""
        chosen = {
            key: self.parameters[key] for key in _TOLD if self.parameters.get(key) is not None
        }
        chosen |= {key: value for key, value in self.options.items() if key not in _UNTOLD}
        for run in runs:
            for key, value in run.options.items():
                if len(runs) == 1 and key not in _UNTOLD:
                    chosen[key] = value
                elif len(runs) > 1:
                    chosen.pop(key, None)
        parts = [f"task {self.problem.name}", f"solver {solver or self.solver}"]
        parts.append(f"seed {self.seed}" if len(runs) <= 1 else f"seeds from {self.seed}")
        parts += [f"{key} = {value}" for key, value in chosen.items()]
        return ",  ".join(parts)


def _find_ends(task: Task) -> tuple[str | None, str | None]:
    first = [place.name for place in task.places_in(task.initial)]
    last = [place.name for place in task.places_in(task.goal.requires)]
    return (first[0] if len(first) == 1 else None, last[0] if len(last) == 1 else None)


class FigureModule(Protocol):
    """Members of a module that draws a figure.

    Attributes
    ----------
    SOLVER
        Name of the default solver.
    """

    SOLVER: str

    def runs(self, request: FigureRequest) -> Sequence[Run]:
        """Return the runs that have to be solved first.

        Raises
        ------
        OptionError
            If the figure does not fit the file.
        """

    def draw(self, request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
        """Return the figure.

        Raises
        ------
        OptionError
            If the outcomes lack the data.
        """


def get_requested_task(request: FigureRequest) -> Task:
    """Return the task of a request, which must be one of parts and an arm.

    Raises
    ------
    OptionError
        If it has no bodies or no arm.
    """
    task = request.problem.part(request.part)
    if not (task.scene.bodies and task.scene.robots):
        raise request.unfit(
            f"it shows parts and an arm, but the file is of kind {request.problem.kind}. Figures "
            "of any kind are rewards, learning and q-values"
        )
    return task
