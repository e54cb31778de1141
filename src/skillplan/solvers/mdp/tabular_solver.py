"""Base of tabular solvers: enumeration, refusal, policies for all states."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.errors import ModelTooLarge, SearchStopped
from skillplan.model.skill_model import SkillModel
from skillplan.model.tabular_mdp import DEFAULT_LIMIT, TabularMDP
from skillplan.solvers.solution import Policy
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
