"""Tabular learners: SARSA, Q-learning and Monte Carlo control on the MDP of a task.

Their updates are in `episode_kernels`, one kernel for the temporal differences and one for Monte
Carlo. Sutton and Barto, "Reinforcement Learning: An Introduction" (2018), sections 5.3 and 6.4 to
6.6; Veeramani and Muthuswamy, Table 2 and Eq. 10.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.model.skill_model import SkillModel
from skillplan.model.tabular_mdp import TabularMDP
from skillplan.solvers.learning import episode_kernels
from skillplan.solvers.learning.episode_kernels import (
    EXPECTED_SARSA,
    Q_LEARNING,
    SARSA,
    Environment,
    Schedule,
)
from skillplan.solvers.mdp.tabular_solver import (
    TabularOptions,
    TabularSolver,
    build_policy,
    build_rewards,
)
from skillplan.solvers.solution import Policy, Solution

# Episodes between two polls of the stop: about a millisecond on a small task.
_CHUNK = 1_000

Values = NDArray[np.float64]
Stream = NDArray[np.uint64]
Lengths = NDArray[np.int64]


class EpisodicOptions(TabularOptions):
    """Options of every tabular learner; defaults as in the paper."""

    episodes: int = Field(default=35_000, ge=1, le=100_000_000, description="episodes to run [-]")
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
    epsilon: float = Field(
        default=0.1,
        ge=0.0,
        le=1.0,
        description="probability of a random action, in the first episode [-]",
    )
    epsilon_end: float | None = Field(
        default=None,
        ge=0.0,
        le=1.0,
        description="that probability in the last episode, approached linearly; null for "
        "epsilon [-]",
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


class FallingStepOptions(EpisodicOptions):
    """Options of learners whose step size falls."""

    alpha: float = Field(
        default=0.5, gt=0.0, le=1.0, description="step size of an update, in the first episode [-]"
    )
    alpha_end: float | None = Field(
        default=0.1,
        ge=0.0,
        le=1.0,
        description="step size in the last episode, approached linearly; null for alpha [-]",
    )


class EpisodicSolver(TabularSolver):
    """Learns action values from random episodes that begin in any state."""

    Options = EpisodicOptions
    options: EpisodicOptions

    @abstractmethod
    def run_episodes(
        self,
        env: Environment,
        schedule: Schedule,
        previous: int,
        q: Values,
        stream: Stream,
        lengths: Lengths,
    ) -> None:
        """Run `len(lengths)` episodes; arguments as for `episode_kernels.td_episodes`."""

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Learn, and return the greedy policy for all states."""
        mdp = self.mdp(model)
        env = self._environment(model, mdp)
        if not len(env.starts):
            return Solution(Policy({}), trace=self.figures(mdp, 0, 0.0))
        schedule = self._schedule()
        q = np.zeros(len(mdp.actions))
        stream = np.array([seed % 2**64], dtype=np.uint64)
        lengths = np.zeros(self.options.episodes, dtype=np.int64)
        record = _Record(model, mdp, self.options)
        # Compile the kernel before time is measured; no episode is run.
        self.run_episodes(env, schedule, 0, q, stream, lengths[:0])
        done, learning_s = 0, 0.0
        while done < len(lengths) and not self.stop():
            record.add_point(done, q)
            end = min(done + _CHUNK, len(lengths), record.next_point(done))
            begin_s = time.perf_counter()
            self.run_episodes(env, schedule, done, q, stream, lengths[done:end])
            learning_s += time.perf_counter() - begin_s
            done = end
        record.add_point(done, q)
        trace = {**self.figures(mdp, done, learning_s), **record.trace(lengths)}
        trace["steps"] = int(lengths.sum())
        return Solution(build_policy(model, mdp, greedy_rows(mdp, q)), trace=trace)

    def _environment(self, model: SkillModel, mdp: TabularMDP) -> Environment:
        choices = np.diff(mdp.rows)
        rewards = build_rewards(model, mdp, self.options.objective)
        return Environment(
            mdp.rows,
            mdp.outcomes,
            mdp.successors,
            mdp.probabilities,
            rewards.rewards,
            choices == 0,
            np.where(mdp.goal, 0.0, rewards.stuck),
            np.flatnonzero(choices),
        )

    def _schedule(self) -> Schedule:
        options = self.options
        last = max(1, options.episodes - 1)
        alpha_end = options.alpha if options.alpha_end is None else options.alpha_end
        epsilon_end = options.epsilon if options.epsilon_end is None else options.epsilon_end
        return Schedule(
            options.alpha,
            (alpha_end - options.alpha) / last,
            options.epsilon,
            (epsilon_end - options.epsilon) / last,
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

    def run_episodes(
        self,
        env: Environment,
        schedule: Schedule,
        previous: int,
        q: Values,
        stream: Stream,
        lengths: Lengths,
    ) -> None:
        """Run episodes with the target r + gamma Q(s', a') of the next action taken."""
        rule = EXPECTED_SARSA if self.options.expected else SARSA
        episode_kernels.td_episodes(env, schedule, rule, previous, q, stream, lengths)


class QLearningSolver(EpisodicSolver):
    """Learn a policy for all states step by step, off policy (Watkins, 1989)."""

    name = "q-learning"

    class Options(FallingStepOptions):
        """Targets do not depend on exploration, so steps are larger than SARSA's."""

        epsilon: float = Field(
            default=0.3,
            ge=0.0,
            le=1.0,
            description="probability of a random action, in the first episode [-]",
        )

    options: Options

    def run_episodes(
        self,
        env: Environment,
        schedule: Schedule,
        previous: int,
        q: Values,
        stream: Stream,
        lengths: Lengths,
    ) -> None:
        """Run episodes with the target r + gamma max Q(s', a) over the next actions."""
        episode_kernels.td_episodes(env, schedule, Q_LEARNING, previous, q, stream, lengths)


class MonteCarloSolver(EpisodicSolver):
    """Learn a policy for all states from whole episodes, first-visit with exploring starts.

    With a mean over all returns, those of the first policies, which wander, would weigh as much as
    the last; with constant exploration, returns would depend on recovery from random actions.
    Both keep some states from their best action. Hence updates have a step size, and both rates
    fall linearly.
    """

    name = "monte-carlo"

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

    def run_episodes(
        self,
        env: Environment,
        schedule: Schedule,
        previous: int,
        q: Values,
        stream: Stream,
        lengths: Lengths,
    ) -> None:
        """Run episodes, each followed by updates towards the returns after first visits."""
        episode_kernels.monte_carlo_episodes(
            env,
            schedule,
            previous,
            q,
            np.full(len(q), -1, dtype=np.int64),
            np.empty(schedule.max_steps, dtype=np.int64),
            np.empty(schedule.max_steps),
            stream,
            lengths,
        )


def greedy_rows(mdp: TabularMDP, q: Values) -> NDArray[np.int64]:
    """Return the row of the largest value in every state; of equals the first, -1 for none.

    Parameters
    ----------
    mdp
        The n states and m rows.
    q
        Value of every row, shape (m,).
    """
    chosen = np.full(len(mdp.states), -1, dtype=np.int64)
    choices = np.diff(mdp.rows)
    states = np.flatnonzero(choices)
    if len(states):
        most = np.repeat(np.maximum.reduceat(q, mdp.rows[states]), choices[states])
        rows = np.flatnonzero(q == most)
        owners = np.repeat(states, choices[states])[rows]
        chosen[owners[::-1]] = rows[::-1]  # of equals, the first is written last
    return chosen


class _Record:
    """Learning curves of a run: steps of the episodes, and values in watched states."""

    def __init__(self, model: SkillModel, mdp: TabularMDP, options: EpisodicOptions) -> None:
        points = min(options.record, options.episodes)
        self._marks = [round(i * options.episodes / points) for i in range(1, points + 1)]
        self._episodes: list[int] = []
        facts = [name.strip() for name in options.watch.split(",") if name.strip()]
        watched = model.task.facts.none
        # The tasks of other stages of a chain have none of these facts.
        if not model.task.stage or any(fact in model.task.facts for fact in facts):
            watched = model.task.facts.of(*facts)
        self._values: dict[str, dict[str, list[float]]] = {}
        self._rows: list[tuple[list[float], int]] = []
        if not points:
            return
        for i, state in enumerate(mdp.states):
            if state & watched:
                curves = self._values[", ".join(state)] = {}
                for row in range(mdp.rows[i], mdp.rows[i + 1]):
                    curve = curves[model.task.skills[mdp.actions[row]].name] = []
                    self._rows.append((curve, row))

    def next_point(self, done: int) -> int:
        """Return the episode of the next point."""
        return next((mark for mark in self._marks if mark > done), done + _CHUNK)

    def add_point(self, done: int, q: Values) -> None:
        """Keep the values if a point is due; `done` is the number of episodes."""
        if done in self._marks and done not in self._episodes:
            self._episodes.append(done)
            for curve, row in self._rows:
                curve.append(float(q[row]))

    def trace(self, lengths: Lengths) -> dict[str, Any]:
        """Return the curves; steps are means over the episodes since the previous point."""
        if not self._marks:
            return {}
        bounds = [0, *self._episodes]
        means = [
            float(lengths[begin:end].mean())
            for begin, end in zip(bounds, self._episodes, strict=False)
        ]
        curves: dict[str, Any] = {
            "episodes": self._episodes,
            "steps_per_episode": means,
            "steps_of_first_episode": int(lengths[0]),
        }
        return curves | ({"q_values": self._values} if self._values else {})
