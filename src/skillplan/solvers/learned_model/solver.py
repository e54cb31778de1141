"""The solver `learned-model`: learns action schemas from its own steps, and plans with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON, INFEASIBLE
from skillplan.solvers.learned_model.planned_episodes import PlannedEpisodes
from skillplan.solvers.learning.episode_training import (
    Arrays,
    CompletedEpisode,
    EpisodeRecord,
    EpisodeTraining,
    read_array,
)
from skillplan.solvers.learning.learner import (
    Episode,
    Learner,
    LearnerOptions,
    Training,
    is_certain,
)
from skillplan.solvers.learning.network_policy import NetworkPolicy, allowing, lookup_network
from skillplan.solvers.learning.observation_counts import ObservationCounts
from skillplan.task.task import Task

GOAL, FAILURE = -1, -2
"""Successors that end an episode."""

# Cost to go after a failed action, in units of the greatest cost of a step times the step limit.
_FAILURE_FACTOR = 10.0
# Additional cost of every step, in units of the greatest: cycles without cost, such as tool
# changes at one place, must not look as good as progress. The second value only breaks ties.
_EXPLORING_COST, _TIE_COST = 0.02, 1e-7
# Most sweeps of value iteration; it stops when values change by less, relative to a failure.
_MOST_SWEEPS = 1_000
_TOLERANCE = 1e-12


class _Solution(NamedTuple):
    """Costs to go of observations and actions, shapes (m, 2) and (m,)."""

    pairs: NDArray[np.int64]
    costs: NDArray[np.float64]


class OutcomeTable:
    """The table of one run.

    Parameters
    ----------
    counts
        Observations of all runs.
    run
        Index of the run.
    step_limit
        Most skills of an episode.
    """

    def __init__(self, counts: ObservationCounts, run: int, step_limit: int) -> None:
        self._counts, self._run, self._limit = counts, run, step_limit
        # By observation and action: number and summed cost of the steps to every successor.
        self._outcomes: dict[tuple[int, int], dict[int, list[float]]] = {}
        self._values = np.zeros((64, counts.masks.shape[2]))
        self._most_cost = 0.0

    def add(self, index: int, action: int, successor: int, cost: float) -> None:
        """Add a step.

        Parameters
        ----------
        index, action
            Index of the observation, and the action.
        successor
            Index of the next observation, `GOAL` or `FAILURE`.
        cost
            Cost of the step.
        """
        outcome = self._outcomes.setdefault((index, action), {}).setdefault(successor, [0, 0.0])
        outcome[0] += 1
        outcome[1] += cost
        self._most_cost = max(self._most_cost, cost)

    def update(self, index: int, action: int) -> None:
        """Set an optimistic cost to go to the mean over the outcomes seen."""
        while index >= len(self._values):
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        outcomes = self._outcomes[index, action]
        total = sum(
            cost + number * self._least(next_) for next_, (number, cost) in outcomes.items()
        )
        self._values[index, action] = total / sum(number for number, _ in outcomes.values())

    def choose(self, index: int, generator: np.random.Generator) -> int:
        """Return the action of least optimistic cost to go; of equals a rarely taken one."""
        allowed = np.flatnonzero(self._counts.masks[self._run, index])
        if index >= len(self._values):
            return int(generator.choice(allowed))
        values = self._values[index, allowed]
        best = allowed[values <= values.min() + 1e-12]
        visits = self._counts.visits[self._run, index, best]
        return int(generator.choice(best[visits == visits.min()]))

    def refresh(self) -> None:
        """Set all optimistic costs to go to the fixed point of `update`.

        Dead ends get the cost of a failure, which updates along episodes approach slowly.
        """
        size = self._counts.known(self._run)
        visits, masks = self._counts.visits[self._run, :size], self._counts.masks[self._run, :size]
        solution = self._solve(_EXPLORING_COST, (masks & (visits == 0)).any(axis=1))
        while size > len(self._values):
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        self._values[solution.pairs[:, 0], solution.pairs[:, 1]] = solution.costs

    def policy(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the best action by the outcomes seen, untried actions excluded.

        Returns
        -------
        indices, actions
            Observations from which the goal can be reached, and the action there, shape (n,).
        """
        size = self._counts.known(self._run)
        pairs, costs = self._solve(_TIE_COST, np.zeros(size, dtype=np.bool_))
        order = np.lexsort((pairs[:, 1], costs, pairs[:, 0]))
        indices, first = np.unique(pairs[order, 0], return_index=True)
        best = order[first]
        reached = costs[best] < self._failure_cost()
        return indices[reached], pairs[best, 1][reached]

    def _solve(self, step_cost: float, open_: NDArray[np.bool_]) -> _Solution:
        """Return the costs to go of all actions taken, by value iteration.

        Parameters
        ----------
        step_cost
            Additional cost of every step, in units of the greatest cost.
        open_
            Observations at which an untried action ends the search at no cost, shape (n,).
        """
        size, ceiling = len(open_), self._failure_cost()
        flat = self._flat()
        pairs, rows = np.unique(flat[:, :2].astype(np.int64), axis=0, return_inverse=True)
        rows, numbers, successors = rows.reshape(-1), flat[:, 3], flat[:, 2].astype(np.int64)
        totals = np.bincount(rows, numbers, minlength=len(pairs))
        costs = np.bincount(rows, flat[:, 4], minlength=len(pairs)) / totals
        costs += step_cost * self._most_cost
        shares = numbers / totals[rows]
        # From above: from below, cycles without cost would hold values down.
        values = np.full(size + 2, ceiling)
        values[GOAL] = 0.0
        ahead = np.zeros(len(pairs))
        for _ in range(_MOST_SWEEPS):
            ahead = costs + np.bincount(rows, shares * values[successors], minlength=len(pairs))
            updated = np.full(size + 2, ceiling)
            np.minimum.at(updated, pairs[:, 0], ahead)
            updated[:size][open_] = 0.0
            updated[GOAL], updated[FAILURE] = 0.0, ceiling
            if np.abs(updated - values).max() <= _TOLERANCE * ceiling:
                break
            values = updated
        return _Solution(pairs, ahead)

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        return {
            f"{name}.outcomes": self._flat(),
            f"{name}.values": self._values.copy(),
            f"{name}.most_cost": np.array(self._most_cost),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        rows = len(arrays.get(f"{name}.outcomes", ()))
        self._outcomes = {}
        for line in read_array(arrays, f"{name}.outcomes", (rows, 5)).tolist():
            index, action, successor = (int(number) for number in line[:3])
            self._outcomes.setdefault((index, action), {})[successor] = line[3:]
        size = len(arrays.get(f"{name}.values", ()))
        shape = (size, self._values.shape[1])
        self._values = read_array(arrays, f"{name}.values", shape).copy()
        self._most_cost = float(read_array(arrays, f"{name}.most_cost", ()))

    def _least(self, successor: int) -> float:
        """Return the optimistic cost to go of a successor."""
        if successor == GOAL:
            return 0.0
        if successor == FAILURE:
            return self._failure_cost()
        if successor >= len(self._values):
            return 0.0
        mask = self._counts.masks[self._run, successor]
        return float(self._values[successor, mask].min())

    def _failure_cost(self) -> float:
        return _FAILURE_FACTOR * self._limit * (self._most_cost or 1.0)

    def _flat(self) -> NDArray[np.float64]:
        """Return a row for every outcome: index, action, successor, number and summed cost."""
        return np.array(
            [
                (index, action, successor, *outcome)
                for (index, action), outcomes in self._outcomes.items()
                for successor, outcome in outcomes.items()
            ]
        ).reshape(-1, 5)


# Share of the episodes that follow the best known policy instead of exploring: without plans, and
# after plans have settled up to this share of the steps. Then all episodes follow it.
_FOLLOWING, _EXPLORING_UNTIL = 0.5, 0.6
# Steps after which the policy of a run without plans is computed anew.
_POLICY_STEPS = 500


class LearnedModelOptions(LearnerOptions):
    """Options of `learned-model`; observations must be bits."""

    observation: Literal["paper", "markov"] = Field(
        default="markov",
        description="observation: paper, the bits listed in the task file; markov, also the "
        "place of the arm, on which costs depend [-]",
    )
    plan_width: int = Field(
        default=32,
        ge=1,
        le=4_096,
        description="plans that the first search expands at equal progress [-]",
    )


class LearnedModelSolver(Learner):
    """Learn action schemas from the own steps and plan with them; needs no network."""

    name = "learned-model"

    Options = LearnedModelOptions
    options: LearnedModelOptions

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training before its first step."""
        return LearnedModelTraining(self.options, env, seeds, steps)


class LearnedModelTraining(EpisodeTraining):
    """Runs of `learned-model` in progress.

    A run plans its episodes until no better plan is found. Then it repeats its cheapest one, and in
    half of the episodes of the first part of the training it explores: a surprise revives plans. If
    schemas cannot model the task, because of chance, several boards, or effects that differ
    between states, it explores with a table of outcomes instead: half of the episodes follow the
    best policy by the outcomes seen, the others try actions that look good or are untried.

    Parameters
    ----------
    options
        Options of the solver.
    env
        One environment for every run.
    seeds
        One for every run.
    steps
        Environment steps of every run in all.
    """

    def __init__(
        self, options: LearnedModelOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        super().__init__(options, env, seeds, steps)
        runs = len(seeds)
        self._skills = [skill.name for skill in env.models[0].task.skills]
        observations, infos = env.reset(seed=list(seeds))
        self._counts = ObservationCounts(runs, observations.shape[1], self._actions)
        self._tables = [OutcomeTable(self._counts, run, self._limit) for run in range(runs)]
        self._planned: PlannedEpisodes | None = None
        if self._one_episode_suffices:
            self._planned = PlannedEpisodes(
                self._generators, self._counts, self._limit, options.plan_width
            )
        # Step at which a run found no better plan; None before.
        self._settled_steps: list[int | None] = [None] * runs
        # Actions to follow by index of the observation: of the cheapest episode once plans have
        # settled; without plans, of the best policy, which is computed now and then.
        self._followed: list[dict[int, int]] = [{} for _ in range(runs)]
        self._followed_steps, self._follows = [0] * runs, [False] * runs
        self._observe(observations, infos["action_mask"])

    def advance(self, steps: int) -> list[Episode]:
        """Take environment steps in every run; return the episodes that ended."""
        ended: list[Episode] = []
        for _ in range(steps):
            before = self._at
            actions = np.array([self._choose(run) for run in range(len(self._episodes))])
            observations, rewards, _, _, infos = self._env.step(actions)
            self.steps += 1
            after = self._counts.indices(infos["final_obs"], allowing(infos["final_mask"]))
            for run, end in enumerate(infos["end"].tolist()):
                action, cost = int(actions[run]), float(infos["cost"][run])
                self._learn_step(run, int(before[run]), action, int(after[run]), end, cost)
                self._episodes[run].add(int(before[run]), action, cost, float(rewards[run]))
                if end != GOES_ON:
                    ended.append(self._end_episode(run, end))
            self._observe(observations, infos["action_mask"])
        return ended

    def figures(self) -> list[dict[str, float]]:
        """Return the number of observations, and when plans settled or were given up."""
        figures = []
        for run, settled in enumerate(self._settled_steps):
            figure = {"situations": float(self._counts.known(run))}
            if settled is not None:
                figure["settled_step"] = float(settled)
            if self._planned is None or self._planned.contradicted(run):
                figure["explores"] = 1.0
            figures.append(figure)
        return figures

    def remarks(self, run: int) -> dict[str, Any]:
        """Return the step at which plans settled, and why the run explores instead of planning."""
        return {"settled_step": self._settled_steps[run], "fallback": self._fallback(run)}

    def _fallback(self, run: int) -> str | None:
        if self._planned is None:
            return "explored without plans: schemas model one task without chance"
        contradicted = [self._skills[action] for action in self._planned.contradicted(run)]
        if not contradicted:
            return None
        return (
            f"explored without plans: the effects of {', '.join(contradicted)} differ between "
            "states"
        )

    def _observe(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        self._at = self._counts.indices(observations, allowing(masks))

    def _choose(self, run: int) -> int:
        """Return a run's next action: planned, of the cheapest episode, or exploring."""
        record, index = self._episodes[run], int(self._at[run])
        if self._planned is not None and not self._planned.is_settled(run):
            action = self._planned.action(run, index, record.last_action, record.length)
            record.planned, record.greedy = True, False
            if action is not None:
                return action
        elif self._follows[run] and index in self._followed[run]:
            return self._followed[run][index]
        record.greedy = False
        return self._tables[run].choose(index, self._generators[run])

    def _learn_step(
        self, run: int, before: int, action: int, after: int, end: int, cost: float
    ) -> None:
        self._counts.visits[run, before, action] += 1
        successor = {COMPLETE: GOAL, INFEASIBLE: FAILURE}.get(end, after)
        self._tables[run].add(before, action, successor, cost)
        self._tables[run].update(before, action)
        if self._planned is not None:
            self._planned.learn_step(
                run,
                before,
                self._episodes[run].last_action,
                action,
                None if end == INFEASIBLE else after,
                cost=cost,
                complete=end == COMPLETE,
            )

    def _end_episode(self, run: int, end: int) -> Episode:
        record = self._episodes[run]
        episode = record.finish(run, self.steps, end)
        self._episodes[run] = EpisodeRecord()
        for index, action in zip(reversed(record.indices), reversed(record.actions), strict=True):
            self._tables[run].update(index, action)
        if self._one_episode_suffices and episode.success:
            rows, actions = np.array(record.indices), np.array(record.actions)
            completed = CompletedEpisode(
                episode.cost,
                self._counts.observations[run, rows],
                self._counts.masks[run, rows],
                actions,
            )
            policy = lookup_network(completed.observations, actions, self._actions)
            self._best.compare(run, self.steps, completed, policy)
        if self._planned is not None:
            self._planned.begin_episode(run)
        if self._planned is None or self._planned.contradicted(run):
            self._begin_exploring(run)
        else:
            self._begin_planned(run)
        return episode

    def _begin_planned(self, run: int) -> None:
        """Follow the cheapest episode once plans have settled."""
        assert self._planned is not None
        settled = self._planned.is_settled(run)
        explores = settled and self.steps < _EXPLORING_UNTIL * self._total
        follows = not explores or self._generators[run].random() < _FOLLOWING
        self._follows[run] = settled and follows
        if not settled:
            self._settled_steps[run] = None
        elif self._settled_steps[run] is None:
            self._settled_steps[run] = self.steps
            cheapest = self._best.cheapest(run)
            assert cheapest is not None
            indices = self._counts.find(run, cheapest.observations, cheapest.masks)
            self._followed[run] = dict(zip(indices, cheapest.actions.tolist(), strict=True))

    def _begin_exploring(self, run: int) -> None:
        """Draw whether the next episode follows the best policy by the outcomes seen."""
        self._settled_steps[run] = None
        self._follows[run] = bool(self._generators[run].random() < _FOLLOWING)
        if self.steps - self._followed_steps[run] >= _POLICY_STEPS:
            self._tables[run].refresh()
            indices, actions = self._tables[run].policy()
            self._followed[run] = dict(zip(indices.tolist(), actions.tolist(), strict=True))
            self._followed_steps[run] = self.steps

    def _policy_of(self, run: int) -> NetworkPolicy:
        """Return the cheapest episode's policy; without one, the best by the outcomes seen."""
        best = self._best.best(run)
        if best is not None:
            return best
        indices, actions = self._tables[run].policy()
        observations = self._counts.observations[run, indices]
        return lookup_network(observations, actions, self._actions)

    def _own_arrays(self) -> Arrays:
        arrays = self._counts.arrays("situations")
        for run, table in enumerate(self._tables):
            arrays |= table.arrays(f"table.{run}")
            followed = np.array(list(self._followed[run].items()), dtype=np.int64).reshape(-1, 2)
            arrays[f"followed.{run}"] = followed
        return arrays if self._planned is None else arrays | self._planned.arrays("planned")

    def _own_notes(self) -> dict[str, Any]:
        return {
            "settled": list(self._settled_steps),
            "follows": list(self._follows),
            "followed": list(self._followed_steps),
            "plans": [] if self._planned is None else self._planned.notes(),
        }

    def _read_own(self, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        self._counts.read("situations", arrays)
        for run, table in enumerate(self._tables):
            table.read(f"table.{run}", arrays)
            rows = arrays.get(f"followed.{run}", np.zeros((0, 2), np.int64)).tolist()
            self._followed[run] = {int(index): int(action) for index, action in rows}
        self._follows = [bool(follows) for follows in notes["follows"]]
        self._followed_steps = [int(step) for step in notes["followed"]]
        self._settled_steps = [None if step is None else int(step) for step in notes["settled"]]
        if self._planned is not None:
            self._planned.read("planned", arrays, notes["plans"])


def can_model(tasks: Sequence[Task], observation: str) -> bool:
    """Return whether schemas may model tasks: one task without chance, observed in bits."""
    return is_certain(tasks) and observation != "layout"
