"""Additions to the textbook algorithms, each an option that is off by default.

Count bonus: Rashid et al., "Optimistic exploration even with a pessimistic initialisation" (2020).
Margin loss: Hester et al., "Deep Q-learning from demonstrations" (2018), with the run's own
cheapest episode as the demonstration.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.env.transition_table import COMPLETE, INFEASIBLE
from skillplan.solvers.learned_model import PlannedEpisodes
from skillplan.solvers.learning.episode_training import Arrays, CheapestSteps, EpisodeRecord
from skillplan.solvers.learning.observation_counts import ObservationCounts, take_rows

# Factor of the count bonus after n visits; negligible at the last entry.
_FADING = 1.0 / np.arange(1.0, 17.0) ** 10
# Worth of an untried action when an episode leaves the policy; falls with the root of its tries.
_UNTRIED = 5.0
# Share of the steps up to which episodes leave the policy.
_BRANCHING_UNTIL = 0.88
# Shares of the steps after which imitation sets in, and over which it grows.
_IMITATION_FROM, _IMITATION_RAMP = 0.65, 0.05
# Margin by which imitated actions are to stand out; values range from about -1 to 4.
_MARGIN = 0.2
# Step at which plans settled, if it is not known.
_UNKNOWN = -1


def count_bonus(
    visits: NDArray[np.int64], indices: NDArray[np.int64], weight: float
) -> NDArray[np.float64]:
    """Return a bonus on the values of rarely tried actions, shape (runs, n, actions).

    Parameters
    ----------
    visits
        Visits by run, observation and action.
    indices
        Indices of observations, shape (runs, n).
    weight
        Bonus of an untried action.
    """
    rows = np.minimum(take_rows(visits, indices), len(_FADING) - 1)
    bonus: NDArray[np.float64] = weight * _FADING.take(rows)
    return bonus


def imitation_weight(progress: float) -> float:
    """Return the weight of imitation after a share of the steps: 0 at first, 1 in the end."""
    return min(1.0, max(0.0, (progress - _IMITATION_FROM) / _IMITATION_RAMP))


def margin_loss(
    values_of: Callable[[torch.Tensor], torch.Tensor], steps: CheapestSteps
) -> torch.Tensor:
    """Return the shortfall of the cheapest episodes' actions from the margin."""
    if not steps.shares.any():
        return torch.zeros(())
    rivals = steps.masks.copy()
    np.put_along_axis(rivals, steps.actions, False, axis=2)
    values = values_of(torch.from_numpy(steps.observations))
    own = values.gather(2, torch.from_numpy(steps.actions))
    others = values.masked_fill(torch.from_numpy(~rivals), -torch.inf)
    short = torch.relu(others.amax(2) + _MARGIN - own[..., 0])
    return (short * torch.from_numpy(steps.shares)).sum()


class Branching:
    """Lets a share of the episodes leave the policy once, at a random depth.

    Parameters
    ----------
    share
        Share of the episodes, in [0, 1].
    step_limit
        Most skills of an episode.
    generators
        One for every run.

    Attributes
    ----------
    depths
        Depth at which each run's episode leaves the policy; the step limit for never.
    """

    def __init__(
        self, share: float, step_limit: int, generators: Sequence[np.random.Generator]
    ) -> None:
        self._share, self._limit, self._generators = share, step_limit, generators
        self.depths = [step_limit] * len(generators)

    def begin_episode(self, run: int, progress: float) -> None:
        """Draw the depth of a run's next episode after a share of the steps."""
        depth, generator = self._limit, self._generators[run]
        if progress < _BRANCHING_UNTIL and generator.random() < self._share:
            depth = int(generator.integers(self._limit))
        self.depths[run] = depth

    def action(
        self,
        run: int,
        length: int,
        values: NDArray[np.float32],
        allowed: NDArray[np.bool_],
        visits: NDArray[np.int64],
        *,
        untried: bool,
    ) -> int | None:
        """Return the most promising other action if the episode leaves the policy here.

        Parameters
        ----------
        run
            Index of the run.
        length
            Steps of its episode.
        values, allowed, visits
            Shape (actions,); values are -inf if not allowed.
        untried
            True if only untried actions count.
        """
        if length < self.depths[run]:
            return None
        others = allowed.copy()
        others[int(values.argmax())] = False
        if untried:
            others &= visits == 0
        if not others.any():
            return None
        self.depths[run] = self._limit
        promise = values + _UNTRIED / np.sqrt(visits + 1.0)
        return int(np.where(others, promise, -np.inf).argmax())


class Plans:
    """Plans of the episodes of all runs, with learned action schemas.

    Parameters
    ----------
    generators
        One for every run.
    counts
        Observations and visits of all runs.
    step_limit
        Most skills of an episode.
    width
        Plans that the first search expands at equal progress.
    """

    def __init__(
        self,
        generators: Sequence[np.random.Generator],
        counts: ObservationCounts,
        step_limit: int,
        width: int,
    ) -> None:
        self._episodes = PlannedEpisodes(generators, counts, step_limit, width)
        self._settled_steps: list[int | None] = [None] * len(generators)

    def action(self, run: int, index: int, record: EpisodeRecord) -> int | None:
        """Return the planned action of a run; None if it plans no more, or has no plan."""
        if self._episodes.is_settled(run):
            return None
        action = self._episodes.action(run, index, record.last_action, record.length)
        record.planned = record.planned or action is not None
        return action

    def learn_step(
        self, run: int, before: int, action: int, after: int, end: int, cost: float, last: int
    ) -> None:
        """Learn from a step between two observations; `last` is the action before it."""
        self._episodes.learn_step(
            run,
            before,
            last,
            action,
            None if end == INFEASIBLE else after,
            cost=cost,
            complete=end == COMPLETE,
        )

    def begin_episode(self, run: int, step: int) -> None:
        """Plan a run's next episode; `step` is the number of steps so far."""
        self._episodes.begin_episode(run)
        if not self._episodes.is_settled(run):
            self._settled_steps[run] = None
        elif self._settled_steps[run] is None:
            self._settled_steps[run] = step

    def figures(self, run: int) -> dict[str, float]:
        """Return the step at which plans settled, or that the effects of an action differ."""
        if self._episodes.contradicted(run):
            return {"explores": 1.0}
        settled = self._settled_steps[run]
        return {} if settled in (None, _UNKNOWN) else {"settled_step": float(settled)}

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        return self._episodes.arrays(name)

    def notes(self) -> dict[str, Any]:
        """Return the state of all plans as JSON values for `read`."""
        return {"plans": self._episodes.notes(), "settled": list(self._settled_steps)}

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        """Restore what `arrays` and `notes` returned; raises ValueError if it does not fit."""
        self._episodes.read(name, arrays, notes["plans"])
        runs = range(len(self._settled_steps))
        # Version 0.2 did not store the step.
        unknown = [_UNKNOWN if self._episodes.is_settled(run) else None for run in runs]
        steps = notes.get("settled", unknown)
        self._settled_steps = [None if step is None else int(step) for step in steps]
