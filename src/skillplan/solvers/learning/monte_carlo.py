"""First-visit Monte Carlo control with exploring starts.

Sutton and Barto (2018), section 5.3; the update stands in `episode_kernels.monte_carlo_episodes`.
With a mean over all returns, those of the first policies, which wander, weigh as much as those of
the last; and with a constant probability of random actions, returns measure how well the robot
recovers from these. Both keep some states from their best action. So updates
have a step size, which forgets old returns, and both rates fall linearly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.solvers.learning import episode_kernels
from skillplan.solvers.learning.episode_kernels import Environment, Schedule
from skillplan.solvers.learning.episodic_solver import EpisodicSolver, FallingStepOptions


class MonteCarloSolver(EpisodicSolver):
    """Learn a policy for all states from whole episodes, first-visit with exploring starts."""

    name = "monte-carlo"

    class Options(FallingStepOptions):
        """Rates and curves; the schedules are this project's, the rest is the paper's."""

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
            description="steps after which an episode is cut off: returns of wandering "
            "must not outweigh the rest [-]",
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
        """Run episodes of first-visit Monte Carlo; see `episode_kernels.monte_carlo_episodes`.

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
        episode_kernels.monte_carlo_episodes(
            env,
            schedule,
            begun,
            q,
            np.full(len(q), -1, dtype=np.int64),
            np.empty(schedule.max_steps, dtype=np.int64),
            np.empty(schedule.max_steps),
            stream,
            lengths,
        )
