"""Policy iteration: alternates policy evaluation and policy improvement until neither changes.

Howard, "Dynamic Programming and Markov Processes" (1960); the paper's baseline (Veeramani and
Muthuswamy, Table 3).
"""

from __future__ import annotations

import numpy as np

from skillplan.solvers.mdp.bellman_backup import evaluate_deterministic, improve
from skillplan.solvers.mdp.bellman_solver import (
    BellmanOptions,
    BellmanSolver,
    Minimisation,
    Optimum,
    find_first_allowed,
)

# Least improvement, as a fraction of the largest value.
_WORTH = 1e-13


class PolicyIterationSolver(BellmanSolver):
    """Improve a policy for all states until it is optimal; proves its cost."""

    name = "policy-iteration"

    class Options(BellmanOptions):
        """Objective and its discount."""

    def minimise(self, task: Minimisation) -> Optimum:
        """Improve the initial policy.

        In a deterministic task any policy will do, such as the first action of every state: a cycle
        has
        infinite cost and is improved. In a stochastic task that could last for ever, as two states
        may have
        to be improved at once; there the initial policy is proper and stays proper.
        """
        chosen = task.start.copy()
        values = task.values.copy()
        if task.deterministic:
            chosen[task.order] = find_first_allowed(task.choices.rows, task.allowed)[task.order]
        rounds = 0
        while True:
            rounds += 1
            if task.deterministic:
                evaluate_deterministic(task.choices, chosen, task.weights, task.gamma, values)
            else:
                if not self.evaluate(task, chosen, values)[1]:
                    return Optimum(values, chosen, rounds, False)
            finite = values[np.isfinite(values)]
            margin = _WORTH * max(1.0, float(np.abs(finite).max(initial=0.0)))
            switched = improve(
                task.choices, task.allowed, task.weights, task.gamma, values, chosen, margin
            )
            if not switched:
                return Optimum(values, chosen, rounds, True)
            if self.stop():
                return Optimum(values, chosen, rounds, False)
