"""Bellman backups on the arrays of a model, compiled: sweeps, policy evaluation, improvement.

Everything is minimised; a reward is a negative weight. Without discount this is the stochastic
shortest path problem (Bertsekas and Tsitsiklis, "An analysis of stochastic shortest path problems",
1991), restricted to *proper* policies, which reach a goal with certainty.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skillplan.model.tabular_mdp import TabularMDP
from skillplan.solvers.kernels import compiled

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


class Choices(NamedTuple):
    """Actions by state and their outcomes; offsets as in `TabularMDP`."""

    rows: Integers
    outcomes: Integers
    successors: Integers
    probabilities: Floats

    @classmethod
    def of(cls, mdp: TabularMDP) -> Choices:
        """Return the choices of a model."""
        return cls(mdp.rows, mdp.outcomes, mdp.successors, mdp.probabilities)


@compiled
def _compute_row(
    outcomes: Integers,
    successors: Integers,
    probabilities: Floats,
    values: Floats,
    state: int,
    row: int,
    weight: float,
    gamma: float,
) -> float:
    """Return the value of taking a row until its state is left (Bellman backup)."""
    total, stay = weight, 0.0
    for outcome in range(outcomes[row], outcomes[row + 1]):
        following = successors[outcome]
        if following == state:
            stay += probabilities[outcome]
        else:
            total += gamma * probabilities[outcome] * values[following]
    left = 1.0 - gamma * stay
    return total / left if left > 1e-12 else np.inf


@compiled
def sweep(
    choices: Choices,
    allowed: Booleans,
    weights: Floats,
    gamma: float,
    values: Floats,
    order: Integers,
) -> float:
    """Set states one after the other to the least value of their allowed rows.

    Parameters
    ----------
    choices
        Choices of n states and m rows.
    allowed
        Allowed rows, shape (m,); states without one keep their value.
    weights
        Expected weight of every row, shape (m,).
    gamma
        Discount factor, in [0, 1].
    values
        Values of the states, shape (n,); changed.
    order
        States in the order of the sweep.

    Returns
    -------
    float
        The largest change of a value.
    """
    rows, out, to, p = choices
    largest = 0.0
    for state in order:
        best, any_allowed = np.inf, False
        for row in range(rows[state], rows[state + 1]):
            if allowed[row]:
                any_allowed = True
                best = min(best, _compute_row(out, to, p, values, state, row, weights[row], gamma))
        if any_allowed and best != values[state]:
            largest = max(largest, abs(best - values[state]))
            values[state] = best
    return largest


@compiled
def evaluate_deterministic(
    choices: Choices, chosen: Integers, weights: Floats, gamma: float, values: Floats
) -> None:
    """Set `values` to the exact values of a policy whose rows have one outcome each.

    Each state is followed to a known value, or around a cycle, whose value has a closed form;
    without
    discount it is infinite.

    Parameters
    ----------
    choices, weights, gamma
        See `sweep`.
    chosen
        Row of every state, -1 for none, shape (n,).
    values
        Shape (n,); kept for states without a row, else changed.
    """
    n = len(values)
    status = np.zeros(n, dtype=np.int8)  # 1 on the present path, 2 done
    path = np.empty(n, dtype=np.int64)
    for begin in range(n):
        state, length = begin, 0
        while status[state] == 0 and chosen[state] >= 0:
            status[state] = 1
            path[length] = state
            length += 1
            state = choices.successors[choices.outcomes[chosen[state]]]
        if status[state] == 1:
            round_trip, factor = 0.0, 1.0
            around = state
            while True:
                row = chosen[around]
                round_trip += factor * weights[row]
                factor *= gamma
                around = choices.successors[choices.outcomes[row]]
                if around == state:
                    break
            values[state] = round_trip / (1.0 - factor) if factor < 1.0 else np.inf
            status[state] = 2
        else:
            status[state] = 2
        for index in range(length - 1, -1, -1):
            behind = path[index]
            if status[behind] != 2:
                row = chosen[behind]
                following = choices.successors[choices.outcomes[row]]
                values[behind] = weights[row] + gamma * values[following]
                status[behind] = 2


@compiled
def improve(
    choices: Choices,
    allowed: Booleans,
    weights: Floats,
    gamma: float,
    values: Floats,
    chosen: Integers,
    margin: float,
) -> int:
    """Switch to the best row if it beats the chosen one by more than `margin`.

    Smaller gains could turn a proper policy into a cycle of zero cost.

    Parameters
    ----------
    choices, allowed, weights, gamma, values
        See `sweep`.
    chosen
        Row of every state, -1 for none, shape (n,); changed.
    margin
        Least gain, >= 0.

    Returns
    -------
    int
        Number of switched states.
    """
    rows, out, to, p = choices
    switched = 0
    for state in range(len(values)):
        if chosen[state] < 0:
            continue
        best_row, best = chosen[state], values[state] - margin
        for row in range(rows[state], rows[state + 1]):
            if allowed[row]:
                value = _compute_row(out, to, p, values, state, row, weights[row], gamma)
                if value < best:
                    best_row, best = row, value
        if best_row != chosen[state]:
            chosen[state] = best_row
            switched += 1
    return switched


@compiled
def find_tight_rows(
    choices: Choices,
    allowed: Booleans,
    weights: Floats,
    gamma: float,
    values: Floats,
    margin: float,
) -> Booleans:
    """Return the allowed rows that are optimal within a margin.

    Parameters
    ----------
    choices, allowed, weights, gamma
        See `sweep`.
    values
        Optimal value of every state, shape (n,).
    margin
        Greatest excess of a row, >= 0.
    """
    rows, out, to, p = choices
    tight = np.zeros(len(allowed), dtype=np.bool_)
    for state in range(len(values)):
        for row in range(rows[state], rows[state + 1]):
            if allowed[row] and values[state] < np.inf:
                value = _compute_row(out, to, p, values, state, row, weights[row], gamma)
                tight[row] = value <= values[state] + margin
    return tight


@compiled
def find_proper_policy(
    choices: Choices, allowed: Booleans, goal: Booleans
) -> tuple[Integers, Integers, Booleans]:
    """Return a policy that reaches a goal with certainty, if allowed rows can.

    States without a path to the goal by allowed rows that avoid removed states are removed
    repeatedly
    (the states of *almost sure* reachability remain).

    Returns
    -------
    tuple
        Row of every state, -1 at goals and without a proper policy, shape (n,); the states with a
        row,
        nearest to the goal first; and the allowed rows that avoid removed states, shape (m,).
    """
    n, m = len(goal), len(allowed)
    # Outcomes into each state, grouped by state, and the row and state of each.
    begins = np.zeros(n + 2, dtype=np.int64)
    into = np.empty(len(choices.successors), dtype=np.int64)
    owners = np.empty(m, dtype=np.int64)
    for following in choices.successors:
        begins[following + 2] += 1
    for state in range(1, n + 1):
        begins[state + 1] += begins[state]
    for state in range(n):
        for row in range(choices.rows[state], choices.rows[state + 1]):
            owners[row] = state
            for outcome in range(choices.outcomes[row], choices.outcomes[row + 1]):
                following = choices.successors[outcome]
                into[begins[following + 1]] = row
                begins[following + 1] += 1
    kept = np.ones(n, dtype=np.bool_)
    safe = allowed.copy()
    chosen = np.empty(n, dtype=np.int64)
    order = np.empty(n, dtype=np.int64)
    while True:
        chosen[:] = -1
        policy = 0
        for state in range(n):
            if goal[state]:
                order[policy] = state
                policy += 1
        goals, head = policy, 0
        while head < policy:
            for index in range(begins[order[head]], begins[order[head] + 1]):
                row = into[index]
                state = owners[row]
                if safe[row] and chosen[state] < 0 and not goal[state]:
                    chosen[state] = row
                    order[policy] = state
                    policy += 1
            head += 1
        given_up = False
        for state in range(n):
            if kept[state] and chosen[state] < 0 and not goal[state]:
                kept[state] = False
                given_up = True
                for index in range(begins[state], begins[state + 1]):
                    safe[into[index]] = False
        if not given_up:
            return chosen, order[goals:policy].copy(), safe & kept[owners]
