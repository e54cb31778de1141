"""Finite-horizon dynamic programming: the cheapest plan of limited length, by one sweep a step.

Needed only where the cheapest plan is longer than the task allows: then the best action depends on
how many steps are left, and no stationary policy gives it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillplan.model.tabular_mdp import TabularMDP

# Largest number of stored choices: states times steps.
MOST_CELLS = 50_000_000


def plan_within(
    mdp: TabularMDP, steps: int, stop: Callable[[], bool]
) -> tuple[list[int] | None, bool]:
    """Return the cheapest plan from state 0; of equals, the fastest.

    Parameters
    ----------
    mdp
        A model whose rows have one outcome each.
    steps
        The most that the plan may have, >= 0.
    stop
        Called before every step; returns whether to stop.

    Returns
    -------
    list of int or None
        Rows in order; None where there is no such plan, or the search did not end.
    bool
        Whether the search ended: false if stopped, or if states times steps exceed `MOST_CELLS`.
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
        # Of each state's rows the first in the order of cost, then time, then number.
        costs = mdp.costs + cost[mdp.successors]
        times_s = mdp.durations_s + time_s[mdp.successors]
        starts = mdp.rows[states]
        least = np.repeat(np.minimum.reduceat(costs, starts), choices[states])
        # Sums in another order may differ in their last bits.
        times_s[costs > least + 1e-12 * np.maximum(1.0, np.abs(least))] = np.inf
        fastest = np.repeat(np.minimum.reduceat(times_s, starts), choices[states])
        rows = np.flatnonzero((times_s <= fastest) & np.isfinite(costs))
        chosen = np.full(n, -1, dtype=np.int32)
        owners = np.repeat(states, choices[states])
        chosen[owners[rows][::-1]] = rows[::-1]  # of several the first is written last
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
