"""Value iteration: sweeps of Bellman backups until no value changes.

Bellman, "Dynamic Programming" (1957). In a deterministic task one sweep is enough for costs if the
states are settled in order of cost (see `label_setting`).
"""

from __future__ import annotations

import numpy as np

from skillplan.model.tabular_mdp import TabularMDP
from skillplan.solvers.mdp.bellman_backup import improve
from skillplan.solvers.mdp.bellman_solver import (
    BellmanOptions,
    BellmanSolver,
    Minimisation,
    Optimum,
)
from skillplan.solvers.mdp.label_setting import compute_costs_to_go


class ValueIterationSolver(BellmanSolver):
    """Sweep over the values of all states until they are optimal; proves them."""

    name = "value-iteration"

    class Options(BellmanOptions):
        """Objective and its discount."""

    def least_cost(self, mdp: TabularMDP) -> Optimum:
        """Settle every state once, in order of cost, if the task is deterministic."""
        if len(mdp.successors) != len(mdp.actions):
            return super().least_cost(mdp)
        shortest = compute_costs_to_go(
            mdp.rows, mdp.successors, mdp.goal, mdp.costs, mdp.durations_s
        )
        return Optimum(shortest.costs, shortest.chosen.astype(np.int64), 1, True)

    def minimise(self, task: Minimisation) -> Optimum:
        """Sweep; without discount from the values of the initial policy.

        From above, the values converge to those of the best proper policy, even if a cycle costs
        nothing; from below they could converge to the values of the cycle (Bertsekas and Yu,
        "Stochastic shortest path problems under weak conditions", 2016).
        """
        values = task.values.copy()
        values[task.order] = 0.0
        chosen = task.start.copy()
        sweeps, converged = 0, True
        if task.gamma == 1.0:
            sweeps, converged = self.evaluate(task, chosen, values)
        if converged:
            more, converged = self.converge(task, values)
            sweeps += more
        improve(task.choices, task.allowed, task.weights, task.gamma, values, chosen, 0.0)
        return Optimum(values, chosen, sweeps, converged)
