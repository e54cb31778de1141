"""The rewards that proximal policy optimisation learns from, made of those of a buffer's steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.env.transition_table import COMPLETE, GOES_ON
from skillplan_torch.ppo.options import PpoOptions
from skillplan_torch.ppo.rollout_buffer import RolloutBuffer


class ScaledRewards:
    """Scales the rewards of steps to a typical one, and adds those of ends and of novelty.

    Parameters
    ----------
    options
        Of the solver.
    runs
        How many.
    step_limit
        Most skills of an episode.

    Attributes
    ----------
    typical
        What a step of every run typically loses, shape (runs,); NaN until steps have shown it.
    """

    def __init__(self, options: PpoOptions, runs: int, step_limit: int) -> None:
        self._options, self._limit = options, step_limit
        self.typical = np.full(runs, np.nan)

    def of(self, buffer: RolloutBuffer, novelty_weight: float) -> NDArray[np.float64]:
        """Return the rewards of a buffer's steps, shape (runs, rollout)."""
        options, given, ends = self._options, buffer.step_rewards, buffer.ends
        for run in np.flatnonzero(np.isnan(self.typical)).tolist():
            losses = -given[run][(ends[run] == GOES_ON) & (given[run] < 0)]
            if losses.size:
                self.typical[run] = np.median(losses)
        unit = np.nan_to_num(self.typical, nan=np.inf)[:, None]
        complete, over = ends == COMPLETE, ends != GOES_ON
        success = complete.sum(axis=1) / np.maximum(1, over.sum(axis=1))
        share = (options.steps_worth / self._limit * success)[:, None]
        rewards: NDArray[np.float64] = np.maximum(
            share * (given / unit), -share * options.step_floor
        )
        rewards += novelty_weight * buffer.novelties
        rewards += np.where(complete, options.complete, 0.0)
        rewards -= np.where(over & ~complete, options.failure, 0.0)
        return rewards
