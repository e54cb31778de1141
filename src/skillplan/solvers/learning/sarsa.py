"""On-policy temporal-difference control: SARSA.

Veeramani and Muthuswamy, Table 2 and Eq. 10; Sutton and Barto (2018), sections 6.4 and 6.6. The
update, TD(0) towards the next action taken, stands in `episode_kernels.td_episodes`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.solvers.learning import episode_kernels
from skillplan.solvers.learning.episode_kernels import EXPECTED_SARSA, SARSA, Environment, Schedule
from skillplan.solvers.learning.episodic_solver import EpisodicOptions, EpisodicSolver


class SarsaSolver(EpisodicSolver):
    """Learn a policy for all states step by step, on policy, as in the paper's Table 2."""

    name = "sarsa"

    class Options(EpisodicOptions):
        """Rates and curves; the defaults are the parameters the paper found best."""

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
        begun: int,
        q: NDArray[np.float64],
        stream: NDArray[np.uint64],
        lengths: NDArray[np.int64],
    ) -> None:
        """Run episodes of SARSA; the update is in `episode_kernels.td_episodes`.

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
        rule = EXPECTED_SARSA if self.options.expected else SARSA
        episode_kernels.td_episodes(env, schedule, rule, begun, q, stream, lengths)
