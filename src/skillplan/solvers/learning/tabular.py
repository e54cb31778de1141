"""Tabular learners: SARSA, Q-learning and Monte Carlo control on sampled episodes of a task.

A learner samples episodes; its table holds the states and actions that they met. Whether an action
is feasible it sees by taking it, unless the mask shows it. Updates are in `episode_kernels`, one
kernel for the temporal differences and one for Monte Carlo. Sutton and Barto, "Reinforcement
Learning: An Introduction" (2018), sections 5.3, 5.4 and 6.4 to 6.6; Veeramani and Muthuswamy,
Table 2 and Eq. 10.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from skillplan.model.skill_model import SkillModel
from skillplan.model.tabular_mdp import DEFAULT_LIMIT
from skillplan.solvers.learning import episode_kernels
from skillplan.solvers.learning.episode_kernels import (
    CHEAPEST_STEPS,
    EPISODE,
    EXPECTED_SARSA,
    FAILED,
    Q_LEARNING,
    SARSA,
    UNTRIED,
    Progress,
    Schedule,
)
from skillplan.solvers.learning.sampled_table import SampledTable
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.task import back_end
from skillplan.task.task import Task

# Episodes between two polls of the stop: about a millisecond on a small task.
_CHUNK = 1_000
_EPISODES_PER_START, _BY_CHANCE = 450, 8
_ROUND = 1_000
_FEWEST_EPISODES, _MOST_EPISODES = 5_000, 1_000_000

Lengths = NDArray[np.int64]


class EpisodicOptions(back_end.Options):
    """Options of every tabular learner; defaults as in the paper."""

    episodes: int | None = Field(
        default=None,
        ge=1,
        le=100_000_000,
        description="episodes to run; null to derive them from the task [-]",
    )
    starts: Literal["task", "exploring"] | None = Field(
        default=None,
        description="first states of episodes: task, the task's start; exploring, any state met "
        "and all starts that the task lists, at random; null for exploring if it lists any, else "
        "for task [-]",
    )
    mask: Literal["none", "applicable", "feasible"] = Field(
        default="applicable",
        description="mask of the actions: none; applicable, skills whose preconditions hold; "
        "feasible, skills that back ends allow, which are queried for all of them [-]",
    )
    gamma: float = Field(
        default=0.999, ge=0.0, le=1.0, description="discount factor of later rewards [-]"
    )
    alpha: float = Field(
        default=0.1, gt=0.0, le=1.0, description="step size of an update, in the first episode [-]"
    )
    alpha_end: float | None = Field(
        default=None,
        ge=0.0,
        le=1.0,
        description="step size in the last episode, approached linearly; null for alpha [-]",
    )
    epsilon: float | None = Field(
        default=None,
        ge=0.0,
        le=1.0,
        description="probability of a random action, in the first episode; null for 0.1 "
        "(q-learning 0.3), but 0 for optimistic values in a task without chance [-]",
    )
    epsilon_end: float | None = Field(
        default=None,
        ge=0.0,
        le=1.0,
        description="that probability in the last episode, approached linearly; null for "
        "epsilon with exploring starts, and for q-learning under chance; else for 0 [-]",
    )
    optimistic: bool | None = Field(
        default=None,
        description="begin with the value of completing the task for every action, so that "
        "all actions that might be better are tried; null for true (monte-carlo false), but "
        "false with exploring starts [-]",
    )
    max_steps: int = Field(
        default=1_000, ge=1, le=1_000_000, description="steps after which an episode is cut off [-]"
    )
    objective: Literal["reward", "cost"] = Field(
        default="reward",
        description="learn from the task's rewards; or, also if it has none, from minus its costs "
        "and a bonus at the goal [-]",
    )
    record: int = Field(
        default=0,
        ge=0,
        le=10_000,
        description="points of the learning curves to keep in the trace, evenly spaced [-]",
    )
    watch: str = Field(
        default="",
        description="facts, separated by commas; records the values of all skills in the states "
        "in which one of them holds [-]",
    )
    max_states: int = Field(
        default=DEFAULT_LIMIT,
        ge=1,
        le=10_000_000,
        description="greatest number of states in the table, about 1 kB each; learning ends "
        "there [-]",
    )


class FallingStepOptions(EpisodicOptions):
    """Options of learners whose step size falls."""

    alpha: float = Field(
        default=0.5, gt=0.0, le=1.0, description="step size of an update, in the first episode [-]"
    )
    alpha_end: float | None = Field(
        default=None,
        ge=0.0,
        le=1.0,
        description="step size in the last episode, approached linearly; null for 0.1, but 0.01 "
        "under chance [-]",
    )


class EpisodicSolver(Solver):
    """Learns action values from episodes that it samples; the model is not enumerated."""

    Options: ClassVar[type[BaseModel]] = EpisodicOptions
    options: EpisodicOptions
    polls = True
    # Defaults of `optimistic`, `epsilon` and `episodes`, if the task calls for no other ones.
    usually_optimistic: ClassVar[bool] = True
    usual_epsilon: ClassVar[float] = 0.1
    episodes_per_pair: ClassVar[int] = 100
    # True if step sizes fall.
    step_falls: ClassVar[bool] = False
    # True if targets do not depend on exploration, which may then go on under chance.
    off_policy: ClassVar[bool] = False

    @abstractmethod
    def run_episodes(self, run: _Run, lengths: Lengths) -> int:
        """Run episodes; lengths and result as for `episode_kernels.td_episodes`."""

    def derived(self, tasks: Sequence[Task]) -> dict[str, Any]:
        """Return the values of options that are null, derived from the task.

        Parameters
        ----------
        tasks
            The task, alone.
        """
        options, task = self.options, tasks[0]
        starts = options.starts or ("exploring" if task.starts else "task")
        optimistic = options.optimistic
        if optimistic is None:
            optimistic = self.usually_optimistic and starts == "task"
        epsilon = options.epsilon
        if epsilon is None:
            epsilon = 0.0 if optimistic and task.deterministic else self.usual_epsilon
        keeps_exploring = starts == "exploring" or (self.off_policy and not task.deterministic)
        usual_alpha_end = 0.1 if task.deterministic else 0.01
        values = {
            "episodes": usual_episodes(task, starts, self.episodes_per_pair),
            "starts": starts,
            "optimistic": optimistic,
            "alpha_end": usual_alpha_end if self.step_falls else options.alpha,
            "epsilon": epsilon,
            "epsilon_end": epsilon if keeps_exploring else 0.0,
        }
        return {name: value for name, value in values.items() if getattr(options, name) is None}

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Learn, and return the greedy policy for all states met."""
        derived = self.derived([model.task])
        options = self.options.model_copy(update=derived)
        run = _Run(model, options, seed)
        # Compile the kernel before time is measured; no episode is run.
        self._advance(run, 0)
        begin_s = time.perf_counter()
        while run.goes_on and not self.stop():
            run.record.add_point(run.done, run.table)
            self._advance(run, min(_CHUNK, run.record.next_point(run.done) - run.done))
            plan = run.cheapest_plan()
            if plan is not None:
                self.stop.incumbent(plan)
        run.record.add_point(run.done, run.table)
        learning_s = time.perf_counter() - begin_s
        trace = run.figures() | {
            "derived": derived,
            "learning_s": learning_s - run.sampling_s,
            "sampling_s": run.sampling_s,
            "ended": self.stop.reason or ("finished" if run.is_finished else "table full"),
            **run.record.trace(),
        }
        trace |= run.describe(derived)
        return Solution(None if "reason" in trace else run.policy(), trace=trace)

    def _advance(self, run: _Run, episodes: int) -> None:
        """Run at most `episodes` episodes, and sample the actions that they take first."""
        lengths = np.zeros(min(episodes, run.left), dtype=np.int64)
        run.progress.cursor[EPISODE] = 0
        while True:
            row = self.run_episodes(run, lengths)
            if row == UNTRIED or self.stop() or run.is_full:
                break
            begin_s = time.perf_counter()
            run.table.take(row)
            run.sampling_s += time.perf_counter() - begin_s
        run.add_lengths(lengths[: run.progress.cursor[EPISODE]])


class _Run:
    """A run in progress: its tables, its figures, and the policy that it has learned."""

    def __init__(self, model: SkillModel, options: EpisodicOptions, seed: int) -> None:
        self.model, self.options = model, options
        exploring = options.starts == "exploring"
        self.table = SampledTable(
            model,
            options.mask,
            options.objective,
            exploring=exploring,
            optimistic=bool(options.optimistic),
            seed=seed,
        )
        self.schedule = _make_schedule(options)
        self.progress = Progress(
            stream=np.array([seed % 2**64], dtype=np.uint64),
            cursor=np.array([0, 0, -1, 0, 0, 0, 0, 0, 0]),
            spent=np.zeros(2),
            taken=np.zeros(options.max_steps, dtype=np.int64),
            received=np.zeros(options.max_steps),
            cheapest=np.zeros(options.max_steps, dtype=np.int64),
        )
        self.record = _Record(model, self.table, options)
        self.done = self.steps = 0
        self.sampling_s = 0.0

    @property
    def left(self) -> int:
        """Number of episodes left."""
        return int(self.options.episodes or 0) - self.done

    @property
    def is_full(self) -> bool:
        """True if the table has as many states as it may have."""
        return len(self.table) >= self.options.max_states

    @property
    def is_finished(self) -> bool:
        """True if no episode is left, or none can begin."""
        return self.left <= 0 or not self.table.tables.counts[1]

    @property
    def goes_on(self) -> bool:
        """True if another episode can begin."""
        return not self.is_finished and not self.is_full

    def learn_by(self, rule: int, lengths: Lengths) -> int:
        """Run episodes with a rule of temporal differences; see `episode_kernels.td_episodes`."""
        return episode_kernels.td_episodes(
            self.table.tables, self.schedule, rule, self.done, self.progress, lengths
        )

    def add_lengths(self, lengths: Lengths) -> None:
        """Count episodes that have ended, by their steps."""
        self.done += len(lengths)
        self.steps += int(lengths.sum())
        self.record.add_lengths(lengths)

    def figures(self) -> dict[str, Any]:
        """Return the figures of the episodes and of the table."""
        failed, completed, cut = self.progress.cursor[FAILED:].tolist()
        plan = self.cheapest_plan()
        return {
            "starts": self.options.starts,
            "states": len(self.table),
            "actions_tried": self.table.tried,
            "actions_seen": len(self.table.actions),
            "iterations": self.done,
            "steps": self.steps,
            "completed": completed,
            "failed": failed,
            "cut_off": cut,
            "best_cost_seen": None if plan is None else plan.cost,
        }

    def describe(self, derived: Mapping[str, Any]) -> dict[str, str]:
        """Return a line about the episodes, and the reason if none completed the task."""
        figures = self.figures()
        source = " (derived from the task)" if "episodes" in derived else ""
        origin = "any state met" if self.options.starts == "exploring" else "the task's start"
        line = (
            f"{self.done:,} of {self.options.episodes:,} episodes{source} from {origin}: "
            f"{figures['completed']:,} complete, {figures['failed']:,} fail, "
            f"{figures['cut_off']:,} cut off after {self.options.max_steps:,} steps; "
            f"{figures['states']:,} states, {figures['actions_tried']:,} of "
            f"{figures['actions_seen']:,} actions tried"
        )
        if figures["completed"] or not self.table.tables.counts[1]:
            return {"learned": line}
        reason = "no episode completed the task"
        if self.is_full:
            reason += f", and the table has max_states={self.options.max_states} states"
        return {"learned": line, "reason": reason}

    def cheapest_plan(self) -> Plan | None:
        """Return the cheapest plan that an episode without exploration followed from the start.

        None under chance, or if no such episode completed the task.
        """
        count = int(self.progress.cursor[CHEAPEST_STEPS])
        if not count or not self.model.task.deterministic:
            return None
        if self.model.is_goal(self.model.initial):
            return None
        skills = self.model.task.skills
        actions = [self.table.actions[row] for row in self.progress.cheapest[:count].tolist()]
        return Plan(tuple(skills[a].name for a in actions), float(self.progress.spent[1]))

    def policy(self) -> Policy:
        """Return the greedy policy of the states met.

        From a single start without chance, it follows the cheapest episode without exploration: the
        best evaluated policy, as of every learner, also if the last values lead elsewhere.
        """
        table, skills = self.table, self.model.task.skills
        chosen = table.greedy_rows()
        plan = self.cheapest_plan()
        if plan is not None and (self.options.starts == "task" or not self.model.task.starts):
            for row in self.progress.cheapest[: len(plan)].tolist():
                chosen[int(table.tables.owners[row])] = row
        choices = {}
        for number, row in chosen.items():
            state = table.states[number]
            assert state is not None
            choices[state] = skills[table.actions[row]]
        return Policy(choices)


def usual_episodes(task: Task, starts: str, per_pair: int) -> int:
    """Return the default number of episodes, in whole thousands.

    Exploring starts take 450 for every start that the task lists, as the paper runs 35,000 from 78
    positions. Otherwise it is proportional to the number of pairs of skills, and under chance
    eight times as large.

    Parameters
    ----------
    starts
        ``task`` or ``exploring``.
    per_pair
        Episodes for every pair of skills, if the task lists no starts.
    """
    if starts == "exploring" and task.starts:
        count = _EPISODES_PER_START * len({task.initial, *task.starts})
    else:
        count = per_pair * len(task.skills) ** 2 * (1 if task.deterministic else _BY_CHANCE)
    return min(_MOST_EPISODES, max(_FEWEST_EPISODES, round(count / _ROUND) * _ROUND))


def _make_schedule(options: EpisodicOptions) -> Schedule:
    last = max(1, int(options.episodes or 1) - 1)
    alpha_end = options.alpha if options.alpha_end is None else options.alpha_end
    epsilon = options.epsilon or 0.0
    epsilon_end = epsilon if options.epsilon_end is None else options.epsilon_end
    return Schedule(
        options.alpha,
        (alpha_end - options.alpha) / last,
        epsilon,
        (epsilon_end - epsilon) / last,
        options.gamma,
        options.max_steps,
    )


class SarsaSolver(EpisodicSolver):
    """Learn a policy for all states step by step, on policy, as in the paper's Table 2."""

    name = "sarsa"

    class Options(EpisodicOptions):
        """The defaults are the parameters that the paper found best."""

        expected: bool = Field(
            default=False,
            description="update towards the mean over the next actions instead of the one "
            "taken [-]",
        )

    options: Options

    def run_episodes(self, run: _Run, lengths: Lengths) -> int:
        """Run episodes with the target r + gamma Q(s', a') of the next action taken."""
        return run.learn_by(EXPECTED_SARSA if self.options.expected else SARSA, lengths)


class QLearningSolver(EpisodicSolver):
    """Learn a policy for all states step by step, off policy (Watkins, 1989)."""

    name = "q-learning"
    usual_epsilon = 0.3
    off_policy = True
    step_falls = True

    class Options(FallingStepOptions):
        """Targets do not depend on exploration, so steps are larger than SARSA's."""

    options: Options

    def run_episodes(self, run: _Run, lengths: Lengths) -> int:
        """Run episodes with the target r + gamma max Q(s', a) over the next actions."""
        return run.learn_by(Q_LEARNING, lengths)


class MonteCarloSolver(EpisodicSolver):
    """Learn a policy for all states from whole episodes, first-visit with exploring starts.

    With a mean over all returns, those of the first policies, which wander, would weigh as much as
    the last; with constant exploration, returns would depend on recovery from random actions.
    Both keep some states from their best action. Hence updates have a step size, and both rates
    fall linearly.
    """

    name = "monte-carlo"
    usually_optimistic = False
    episodes_per_pair = 200
    step_falls = True

    class Options(FallingStepOptions):
        """The schedules are this project's, the rest is the paper's."""

        epsilon_end: float | None = Field(
            default=0.0,
            ge=0.0,
            le=1.0,
            description="probability of a random action in the last episode, approached "
            "linearly; null for epsilon [-]",
        )
        max_steps: int = Field(
            default=200,
            ge=1,
            le=1_000_000,
            description="steps after which an episode is cut off, so that returns of wandering "
            "do not outweigh the rest [-]",
        )

    options: Options

    def run_episodes(self, run: _Run, lengths: Lengths) -> int:
        """Run episodes, each followed by updates towards the returns after first visits."""
        exploring = run.options.starts == "exploring"
        return episode_kernels.monte_carlo_episodes(
            run.table.tables, run.schedule, exploring, run.done, run.progress, lengths
        )


class _Record:
    """Learning curves of a run: steps of the episodes, and values in watched states."""

    def __init__(self, model: SkillModel, table: SampledTable, options: EpisodicOptions) -> None:
        episodes = int(options.episodes or 1)
        points = min(options.record, episodes)
        self._marks = [round(i * episodes / points) for i in range(1, points + 1)]
        self._episodes: list[int] = []
        self._means: list[float] = []
        self._lengths: list[int] = []
        self._first_length = 0
        facts = [name.strip() for name in options.watch.split(",") if name.strip()]
        self._watched = model.task.facts.none
        # The tasks of other stages of a chain have none of these facts.
        if not model.task.stage or any(fact in model.task.facts for fact in facts):
            self._watched = model.task.facts.of(*facts)
        self._skills = [skill.name for skill in model.task.skills]
        self._values: dict[str, dict[str, list[float]]] = {}

    def next_point(self, done: int) -> int:
        """Return the episode of the next point."""
        return next((mark for mark in self._marks if mark > done), done + _CHUNK)

    def add_lengths(self, lengths: Lengths) -> None:
        """Add the steps of further episodes."""
        if self._marks and len(lengths):
            self._first_length = self._first_length or int(lengths[0])
            self._lengths += [int(lengths.sum()), len(lengths)]

    def add_point(self, done: int, table: SampledTable) -> None:
        """Keep the values if a point is due; `done` is the number of episodes."""
        if done not in self._marks or done in self._episodes:
            return
        self._means.append(sum(self._lengths[::2]) / sum(self._lengths[1::2]))
        self._lengths.clear()
        for number, state in enumerate(table.states):
            if state is not None and state & self._watched:
                first, end = table.tables.rows[number : number + 2].tolist()
                curves = self._values.setdefault(", ".join(state), {})
                for row in range(first, end):
                    curve = curves.setdefault(self._skills[table.actions[row]], [])
                    # Values are 0 until a state is met.
                    curve += [0.0] * (len(self._episodes) - len(curve))
                    curve.append(float(table.tables.q[row]))
        self._episodes.append(done)

    def trace(self) -> dict[str, Any]:
        """Return the curves; steps are means over the episodes since the previous point."""
        if not self._marks:
            return {}
        curves: dict[str, Any] = {
            "episodes": self._episodes,
            "steps_per_episode": self._means,
            "steps_of_first_episode": self._first_length,
        }
        return curves | ({"q_values": self._values} if self._values else {})
