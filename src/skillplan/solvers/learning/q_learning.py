"""Off-policy temporal-difference control: Q-learning.

Watkins, "Learning from delayed rewards" (1989); Sutton and Barto (2018), section 6.5. The update,
TD(0) towards the best next action, stands in `episode_kernels.td_episodes`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.solvers.learning import episode_kernels
from skillplan.solvers.learning.episode_kernels import Q_LEARNING, Environment, Schedule
from skillplan.solvers.learning.episodic_solver import EpisodicSolver, FallingStepOptions


class QLearningSolver(EpisodicSolver):
    """Learn a policy for all states step by step, off policy."""

    name = "q-learning"

    class Options(FallingStepOptions):
        """Rates and curves.

        Its targets do not depend on how much is explored, so that it takes larger steps than
        SARSA and explores more.
        """

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
        begun: int,
        q: NDArray[np.float64],
        stream: NDArray[np.uint64],
        lengths: NDArray[np.int64],
    ) -> None:
        """Run episodes of Q-learning; the update is in `episode_kernels.td_episodes`.

        Parameters
        ----------
        env, schedule
            The environment and the rates of episodes.
        begun
            Episodes run before these, >= 0: rates continue from there.
        q
            Value of every row, shape (m,); changed.
        stream
            State of the generator of random numbers, shape (1,); changed.
        lengths
            Filled with the steps of every episode.
        """
        episode_kernels.td_episodes(env, schedule, Q_LEARNING, begun, q, stream, lengths)
