"""Bases of policy iteration and value iteration: enumeration, objectives, ties and claims."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.errors import ModelTooLarge, SearchStopped
from skillplan.model.policy_value import Convergence
from skillplan.model.skill_model import SkillModel
from skillplan.model.tabular_mdp import DEFAULT_LIMIT, TabularMDP
from skillplan.solvers.mdp.bellman_backup import Choices, find_proper_policy, find_tight_rows, sweep
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.task import back_end


class TabularOptions(back_end.Options):
    """Options of every tabular solver."""

    max_states: int = Field(
        default=DEFAULT_LIMIT,
        ge=1,
        le=10_000_000,
        description="greatest number of reachable states, about 1 kB each; larger tasks are "
        "refused [-]",
    )


class TabularSolver(Solver):
    """Enumerates the model once and works on its arrays.

    Attributes
    ----------
    enumeration_s
        Time of the enumeration [s]; 0 before.
    """

    Options = TabularOptions
    options: TabularOptions
    polls = True
    enumeration_s = 0.0
    _enumerated: tuple[SkillModel, TabularMDP] | None = None

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason why there are too many reachable states, or None."""
        try:
            self.mdp(model)
        except ModelTooLarge as error:
            return str(error)
        except SearchStopped:
            return None  # solving will stop for the same reason
        return None

    def mdp(self, model: SkillModel) -> TabularMDP:
        """Return the arrays of a model; the last ones are kept.

        Raises
        ------
        ModelTooLarge
            If there are too many reachable states.
        SearchStopped
            If the solver is stopped.
        """
        if self._enumerated is None or self._enumerated[0] is not model:
            begin_s = time.perf_counter()
            mdp = TabularMDP.from_model(model, self.options.max_states, self.stop)
            self.enumeration_s = time.perf_counter() - begin_s
            self._enumerated = (model, mdp)
        return self._enumerated[1]

    def figures(self, mdp: TabularMDP, iterations: int, learning_s: float) -> dict[str, Any]:
        """Return the figures that all these solvers add to a trace."""
        return {
            "states": len(mdp.states),
            "iterations": iterations,
            "learning_s": learning_s,
            "enumeration_s": self.enumeration_s,
            "ended": self.stop.reason or "finished",
        }


def build_policy(model: SkillModel, mdp: TabularMDP, chosen: NDArray[np.int64]) -> Policy:
    """Return the policy of chosen rows.

    Parameters
    ----------
    chosen
        Row of every state, -1 for none, shape (n,).
    """
    skills = model.task.skills
    rows = chosen.tolist()
    actions = mdp.actions.tolist()
    return Policy(
        {
            state: skills[actions[row]]
            for state, row in zip(mdp.states, rows, strict=True)
            if row >= 0
        }
    )


@dataclass(frozen=True, slots=True)
class LearnerRewards:
    """The rewards that a learner maximises.

    Parameters
    ----------
    rewards
        Reward of every outcome, shape (k,).
    stuck
        Value of a state without actions.
    """

    rewards: NDArray[np.float64]
    stuck: float


def build_rewards(model: SkillModel, mdp: TabularMDP, objective: str) -> LearnerRewards:
    """Return the rewards of the task's scheme, or rewards derived from its costs.

    In a state without actions a robot can only fail, for which a scheme has a reward. Without a
    scheme,
    or for the objective ``cost``, the reward is minus the cost. The goal has a bonus as large as
    the
    most expensive plan within the step limit; otherwise an endless cycle of zero cost would be
    optimal.
    Being stuck costs the same.

    Parameters
    ----------
    objective
        ``reward`` or ``cost``.
    """
    reward = model.task.reward
    if objective == "reward" and reward is not None:
        return LearnerRewards(mdp.rewards, reward.infeasible)
    largest = float(mdp.costs.max(initial=0.0)) or 1.0
    bonus = largest * model.step_limit
    costs = np.repeat(mdp.costs, np.diff(mdp.outcomes))
    return LearnerRewards(np.where(mdp.goal[mdp.successors], bonus, 0.0) - costs, -bonus)


# Largest number of stored choices: states times steps.
MOST_CELLS = 50_000_000


def plan_within(
    mdp: TabularMDP, steps: int, stop: Callable[[], bool]
) -> tuple[list[int] | None, bool]:
    """Return the cheapest plan from state 0, the fastest among equals.

    Parameters
    ----------
    mdp
        A model whose rows have one outcome each.
    steps
        Greatest number of steps, >= 0.
    stop
        Polled before every step; returns True to stop.

    Returns
    -------
    list of int or None
        Rows in order; None if no plan exists or the search was incomplete.
    bool
        True if the search was complete; False if stopped, or if states times steps exceed
        `MOST_CELLS`.
    """
    n = len(mdp.states)
    if n * steps > MOST_CELLS:
        return None, False
    cost = np.where(mdp.goal, 0.0, np.inf)
    time_s = np.where(mdp.goal, 0.0, np.inf)
    choices = np.diff(mdp.rows)
    states = np.flatnonzero(choices)
    layers = []
    for _ in range(steps):
        if stop():
            return None, False
        if not len(states):
            break
        # The first row of each state in the order of cost, then time, then number.
        costs = mdp.costs + cost[mdp.successors]
        times_s = mdp.durations_s + time_s[mdp.successors]
        starts = mdp.rows[states]
        lowest = np.repeat(np.minimum.reduceat(costs, starts), choices[states])
        # Sums in another order may differ in their last bits.
        times_s[costs > lowest + 1e-12 * np.maximum(1.0, np.abs(lowest))] = np.inf
        fastest = np.repeat(np.minimum.reduceat(times_s, starts), choices[states])
        rows = np.flatnonzero((times_s <= fastest) & np.isfinite(costs))
        chosen = np.full(n, -1, dtype=np.int32)
        owners = np.repeat(states, choices[states])
        chosen[owners[rows][::-1]] = rows[::-1]  # the first of several is written last
        there = chosen >= 0
        cost = np.where(mdp.goal, 0.0, np.inf)
        time_s = cost.copy()
        cost[there], time_s[there] = costs[chosen[there]], times_s[chosen[there]]
        layers.append(chosen)
    if not np.isfinite(cost[0]):
        return None, True
    plan: list[int] = []
    state = 0
    for chosen in reversed(layers):
        if mdp.goal[state]:
            break
        row = int(chosen[state])
        plan.append(row)
        state = int(mdp.successors[row])
    return plan, True


# Relative difference below which values count as equal.
_TIE = 1e-12
# With chance a difference may be paid at every try, so the tolerance is smaller.
_TIES = (_TIE, 1e-14, 1e-15, 3e-16)
_SAME_COST = 1e-10
_CONVERGED = 1e-14
_MOST_SWEEPS = 1_000_000
# Number of states up to which a policy is evaluated by a dense linear system, within a second.
_MOST_EQUATIONS = 2_000


class BellmanOptions(TabularOptions):
    """Objective and its discount."""

    objective: Literal["cost", "reward"] = Field(
        default="cost",
        description="objective: least expected cost until the goal, undiscounted, then least "
        "time; or largest discounted reward [-]",
    )
    gamma: float = Field(
        default=0.999,
        ge=0.0,
        lt=1.0,
        description="discount factor of later rewards; costs are never discounted [-]",
    )


@dataclass(frozen=True)
class Minimisation:
    """One criterion to be minimised.

    Parameters
    ----------
    choices
        Choices of n states and m rows.
    allowed
        Allowed rows, shape (m,).
    weights
        Expected weight of each row, shape (m,).
    gamma
        Discount factor; 1 for none.
    start
        Initial policy, -1 for no row, shape (n,); proper without discount.
    order
        States to compute, nearest to the goal first if known.
    values
        Fixed values of the other states, shape (n,).
    deterministic
        True if all rows have one outcome.
    """

    choices: Choices
    allowed: NDArray[np.bool_]
    weights: NDArray[np.float64]
    gamma: float
    start: NDArray[np.int64]
    order: NDArray[np.int64]
    values: NDArray[np.float64]
    deterministic: bool


@dataclass(frozen=True)
class Optimum:
    """The result of a minimisation.

    Parameters
    ----------
    values
        Values of the states, shape (n,).
    chosen
        Row of every state, -1 for none, shape (n,).
    iterations
        Sweeps, or rounds of improvement, for the first criterion.
    finished
        True if it is the optimum; False if the solver was stopped.
    """

    values: NDArray[np.float64]
    chosen: NDArray[np.int64]
    iterations: int
    finished: bool


class BellmanSolver(TabularSolver):
    """Solves Bellman's equations and claims the optimum that they prove."""

    seeded = False
    Options = BellmanOptions
    options: BellmanOptions

    @abstractmethod
    def minimise(self, task: Minimisation) -> Optimum:
        """Return the least values and their policy, proper without discount."""

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Return the optimal policy for all states, and a proof for costs."""
        mdp = self.mdp(model)
        self._optimum(model, _build_rehearsal(mdp))
        begin_s = time.perf_counter()
        optimum = self._optimum(model, mdp)
        trace = self.figures(mdp, optimum.iterations, time.perf_counter() - begin_s)
        if self.options.objective == "reward":
            return Solution(build_policy(model, mdp, optimum.chosen), trace=trace)
        trace["bound_method"] = "Bellman's equations over all states"
        return self._claim(model, mdp, optimum, trace)

    def _optimum(self, model: SkillModel, mdp: TabularMDP) -> Optimum:
        if self.options.objective == "cost":
            return self.least_cost(mdp)
        return self._most_reward(model, mdp)

    def least_cost(self, mdp: TabularMDP) -> Optimum:
        """Return the least expected costs and their proper policy.

        Ties go to the least expected time, then to the lowest actions.
        """
        choices = Choices.of(mdp)
        deterministic = len(mdp.successors) == len(mdp.actions)
        every = np.ones(len(mdp.actions), dtype=np.bool_)
        chosen, order, allowed = find_proper_policy(choices, every, mdp.goal)
        free = np.where(mdp.goal, 0.0, np.inf)
        task = Minimisation(
            choices, allowed, mdp.costs, 1.0, chosen, order, free.copy(), deterministic
        )
        optimum = self.minimise(task)
        if not optimum.finished:
            return optimum
        for tie in _TIES:
            policy = self._fastest(mdp, replace(task, values=free.copy()), optimum.values, tie)
            if policy is None:
                continue
            if deterministic or self._costs_as_much(task, policy, optimum.values):
                return replace(optimum, chosen=policy)
        # Rounding hides the best rows.
        return replace(optimum, finished=False)

    def _fastest(
        self, mdp: TabularMDP, task: Minimisation, costs: NDArray[np.float64], tie: float
    ) -> NDArray[np.int64] | None:
        """Return a proper policy with least costs and, among these, the least expected time.

        Parameters
        ----------
        costs
            Least cost of every state, shape (n,).
        tie
            Relative difference to the largest cost below which rows count as equal.

        Returns
        -------
        ndarray or None
            Row of every state, the lowest action among equals, shape (n,). None if some state has
            no row
            within the tolerance.
        """
        choices = task.choices
        allowed = find_tight_rows(
            choices, task.allowed, mdp.costs, 1.0, costs, _compute_margin(costs, tie)
        )
        chosen = find_proper_policy(choices, allowed, mdp.goal)[0]
        if (chosen[task.order] < 0).any():
            return None
        optimum = self.minimise(
            replace(task, allowed=allowed, weights=mdp.durations_s, start=chosen)
        )
        if not optimum.finished:
            return optimum.chosen
        margin = _compute_margin(optimum.values, _TIE)
        allowed = find_tight_rows(choices, allowed, mdp.durations_s, 1.0, optimum.values, margin)
        chosen = find_proper_policy(choices, allowed, mdp.goal)[0]
        if (chosen[task.order] < 0).any():
            return None
        lowest = find_first_allowed(mdp.rows, allowed)
        only = np.zeros(len(mdp.actions), dtype=np.bool_)
        only[lowest[lowest >= 0]] = True
        proper = find_proper_policy(choices, only, mdp.goal)[0] >= 0
        return lowest if (proper == (chosen >= 0)).all() else chosen

    def _costs_as_much(
        self, task: Minimisation, chosen: NDArray[np.int64], costs: NDArray[np.float64]
    ) -> bool:
        """Return True if a policy has the least costs: small differences add up over many tries."""
        values = task.values.copy()
        converged = self.evaluate(task, chosen, values)[1]
        allowed = _SAME_COST * max(1.0, abs(float(costs[0])))
        return converged and not abs(float(values[0]) - float(costs[0])) > allowed

    def _most_reward(self, model: SkillModel, mdp: TabularMDP) -> Optimum:
        choices, gamma = Choices.of(mdp), self.options.gamma
        rewards = build_rewards(model, mdp, "reward")
        weights = -mdp.probabilities * rewards.rewards
        if len(weights):
            weights = np.add.reduceat(weights, mdp.outcomes[:-1])
        every = np.ones(len(mdp.actions), dtype=np.bool_)
        start = find_first_allowed(mdp.rows, every)
        order = np.flatnonzero(start >= 0)
        values = np.where(mdp.goal | (start >= 0), 0.0, -rewards.stuck)
        deterministic = len(mdp.successors) == len(mdp.actions)
        optimum = self.minimise(
            Minimisation(choices, every, weights, gamma, start, order, values, deterministic)
        )
        if not optimum.finished:
            return optimum
        margin = _compute_margin(optimum.values, _TIE)
        tight = find_tight_rows(choices, every, weights, gamma, optimum.values, margin)
        return Optimum(
            optimum.values, find_first_allowed(mdp.rows, tight), optimum.iterations, True
        )

    def _claim(
        self, model: SkillModel, mdp: TabularMDP, optimum: Optimum, trace: dict[str, Any]
    ) -> Solution:
        policy = build_policy(model, mdp, optimum.chosen)
        if not optimum.finished:
            return Solution(policy, trace=trace)
        cost = float(optimum.values[0])
        if len(mdp.successors) != len(mdp.actions):
            if np.isinf(cost):
                reason = "no policy reaches the goal with certainty"
                return Solution(trace={**trace, "reason": reason})
            return Solution(policy, cost, proved=True, trace=trace)
        if np.isinf(cost):
            return Solution(proved=True, trace=trace)
        self.stop.bound(cost)
        rows = _follow_policy(mdp, optimum.chosen)
        if len(rows) <= model.step_limit:
            self.stop.incumbent(_plan(model, mdp, rows))
            return Solution(policy, cost, proved=True, trace=trace)
        short, complete = plan_within(mdp, model.step_limit, self.stop)
        if short is None:
            trace["reason"] = (
                f"the cheapest plan takes {len(rows)} skills, the limit is {model.step_limit}"
            )
            return Solution(None, cost, proved=complete, trace=trace)
        plan = _plan(model, mdp, short)
        return Solution(plan, plan.cost, proved=True, trace=trace)

    def converge(
        self,
        task: Minimisation,
        values: NDArray[np.float64],
        allowed: NDArray[np.bool_] | None = None,
    ) -> tuple[int, bool]:
        """Sweep until the values have converged.

        Parameters
        ----------
        values
            Initial values; changed.

        Returns
        -------
        tuple
            Number of sweeps, and True for convergence; False if stopped.
        """
        allowed = task.allowed if allowed is None else allowed
        convergence = Convergence(_CONVERGED)
        for sweeps in range(1, _MOST_SWEEPS + 1):
            change = sweep(task.choices, allowed, task.weights, task.gamma, values, task.order)
            if convergence.reached(change, float(np.abs(values[task.order]).max(initial=0.0))):
                return sweeps, True
            if self.stop():
                return sweeps, False
        self.stop.end(f"limit of {_MOST_SWEEPS:,} sweeps")
        return _MOST_SWEEPS, False

    def evaluate(
        self, task: Minimisation, chosen: NDArray[np.int64], values: NDArray[np.float64]
    ) -> tuple[int, bool]:
        """Set the values of a policy by linear equations, or by sweeps if there are too many.

        Parameters
        ----------
        chosen
            Row of every state, proper without discount, shape (n,).
        values
            Fixed values of the other states, shape (n,); changed.

        Returns
        -------
        tuple
            Number of sweeps, and True if the values are exact.
        """
        if len(task.order) <= _MOST_EQUATIONS:
            values[task.order] = _solve(task, chosen[task.order], values)
            return 1, True
        values[task.order] = 0.0
        own = np.zeros(len(task.allowed), dtype=np.bool_)
        own[chosen[task.order]] = True
        return self.converge(task, values, own)


def _solve(
    task: Minimisation, rows: NDArray[np.int64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the values of the states of a task under a policy."""
    choices, order = task.choices, task.order
    n = len(order)
    place = np.full(len(values), -1)
    place[order] = np.arange(n)
    counts = choices.outcomes[rows + 1] - choices.outcomes[rows]
    owners = np.repeat(np.arange(n), counts)
    first = np.repeat(choices.outcomes[rows] - np.cumsum(counts) + counts, counts)
    outcomes = first + np.arange(len(owners))
    following = choices.successors[outcomes]
    shares = task.gamma * choices.probabilities[outcomes]
    # Outcomes that stay are divided out: with failures that are almost certain, the equations would
    # lose all digits.
    stays = following == order[owners]
    leaving = (1.0 - task.gamma) + np.bincount(owners[~stays], shares[~stays], minlength=n)
    shares = shares / leaving[owners]
    inside = (place[following] >= 0) & ~stays
    outside = (place[following] < 0) & ~stays
    matrix = np.eye(n)
    np.subtract.at(matrix, (owners[inside], place[following[inside]]), shares[inside])
    known = task.weights[rows] / leaving
    np.add.at(known, owners[outside], shares[outside] * values[following[outside]])
    return np.linalg.solve(matrix, known).astype(np.float64)


def find_first_allowed(rows: NDArray[np.int64], allowed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the first allowed row of every state, -1 for none.

    Parameters
    ----------
    rows
        Offsets of the rows of n states, shape (n + 1,).
    """
    candidates = np.append(np.flatnonzero(allowed), len(allowed))
    first = candidates[np.searchsorted(candidates, rows[:-1])]
    return np.where(first < rows[1:], first, -1)


def _compute_margin(values: NDArray[np.float64], tie: float) -> float:
    finite = values[np.isfinite(values)]
    return tie * max(1.0, float(np.abs(finite).max(initial=0.0)))


def _follow_policy(mdp: TabularMDP, chosen: NDArray[np.int64]) -> list[int]:
    """Return the rows of a policy from state 0 to a goal; each has one outcome."""
    rows, state = [], 0
    while not mdp.goal[state]:
        rows.append(int(chosen[state]))
        state = int(mdp.successors[rows[-1]])
    return rows


def _plan(model: SkillModel, mdp: TabularMDP, rows: list[int]) -> Plan:
    names = tuple(model.task.skills[mdp.actions[row]].name for row in rows)
    return Plan(names, float(sum(mdp.costs[row] for row in rows)))


def _build_rehearsal(mdp: TabularMDP) -> TabularMDP:
    """Return a model of two states, on which kernels are compiled before time is measured.

    It is stochastic and has distinct costs if the given model is and has, so only needed kernels
    are
    compiled.
    """
    chance = len(mdp.successors) != len(mdp.actions)
    differ = len(mdp.costs) > 0 and bool((mdp.costs != mdp.costs[0]).any())
    outcomes = 2 if chance else 1
    return TabularMDP(
        states=(mdp.states[0], mdp.states[0]),
        goal=np.array([False, True]),
        rows=np.array([0, 2, 2]),
        actions=np.array([0, 0]),
        costs=np.array([1.0, 2.0 if differ else 1.0]),
        durations_s=np.ones(2),
        outcomes=np.array([0, outcomes, 2 * outcomes]),
        successors=np.array([1, 0, 1, 0] if chance else [1, 1]),
        probabilities=np.full(2 * outcomes, 1.0 / outcomes),
        rewards=np.zeros(2 * outcomes),
    )
