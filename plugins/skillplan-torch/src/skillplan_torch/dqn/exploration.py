"""Which action deep Q-learning tries: by plan, at random now and then, or off the policy once.

Where mistakes end episodes and nothing is planned, untried actions are taken to be better than they
look instead, where an action is chosen and where a value is learned from the next one: Rashid et
al., "Optimistic exploration even with a pessimistic initialisation" (2020).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learned_model.planned_episodes import PlannedEpisodes
from skillplan.solvers.learning.observation_counts import ObservationCounts, take_rows
from skillplan_torch.dqn.options import DqnOptions
from skillplan_torch.dqn.schedules import Schedules

# Off the policy this is added to the value of an action, over the root of one more than its tries.
_TRIED_SELDOM = 5.0
# By tries, the share of the bonus that is left: as good as gone from the last one on.
_FADING = 1.0 / np.arange(1.0, 17.0) ** 10


class Exploration:
    """Chooses the actions of all runs.

    Parameters
    ----------
    options, schedules
        How it explores, and when.
    generators
        One for every run.
    counts
        Of what every run has tried.
    step_limit
        Most skills of an episode.
    plans
        Whether episodes are planned.

    Attributes
    ----------
    branch_depths
        After how many skills the episode of every run leaves the policy; `step_limit` where it
        does not.
    completed
        Whether a run has completed the task yet, shape (runs,).
    following
        Whether the episode of every run keeps to the policy, whatever else is due.
    planned
        The episodes that are planned with what was learned; None where none is.
    """

    def __init__(
        self,
        options: DqnOptions,
        schedules: Schedules,
        generators: Sequence[np.random.Generator],
        counts: ObservationCounts,
        step_limit: int,
        *,
        plans: bool,
    ) -> None:
        self._options, self._schedules = options, schedules
        self._generators, self._counts, self._limit = generators, counts, step_limit
        self.completed = np.zeros(len(generators), dtype=np.bool_)
        self.branch_depths = [step_limit] * len(generators)
        self.following = [False] * len(generators)
        self.planned = None
        if plans:
            self.planned = PlannedEpisodes(generators, counts, step_limit, options.plan_width)
        for run in range(len(generators)):
            self.begin_episode(run, 0)

    def begin_episode(self, run: int, steps: int) -> None:
        """Draw after how many skills the episode that begins leaves the policy.

        Parameters
        ----------
        run
            Whose.
        steps
            How many steps the run has done.
        """
        depth, generator = self._limit, self._generators[run]
        if self._schedules.branches(steps) and generator.random() < self._options.branching:
            depth = int(generator.integers(self._limit))
        self.branch_depths[run] = depth
        self.following[run] = False
        if self.planned is not None:
            self.planned.begin_episode(run)

    def plans(self, run: int) -> bool:
        """Whether the episode of a run follows a plan."""
        return self.planned is not None and not self.planned.is_settled(run)

    def choose(
        self,
        values: NDArray[np.float32],
        allowed: NDArray[np.bool_],
        at: NDArray[np.int64],
        lengths: Sequence[int],
        lasts: Sequence[int],
        steps: int,
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the action of every run, and whether it is the policy's own.

        Parameters
        ----------
        values, allowed
            Of all actions of every run, shape (runs, actions); -inf where not allowed.
        at
            Index of what every run observes, shape (runs,).
        lengths
            How many skills the episode of every run has had.
        lasts
            The action before of every run, -1 at the start of an episode.
        steps
            How many steps every run has done.
        """
        greedy: NDArray[np.int64] = values.argmax(axis=1)
        actions = greedy.copy()
        bonus = self.bonus(at[:, None], steps)
        if bonus is not None:
            actions = (values + bonus[:, 0]).argmax(axis=1)
        if self._options.exploration == "epsilon":
            epsilon = self._schedules.epsilon(steps)
            for run, generator in enumerate(self._generators):
                if generator.random() < epsilon:
                    actions[run] = generator.choice(np.flatnonzero(allowed[run]))
        for run, depth in enumerate(self.branch_depths):
            if lengths[run] >= depth:
                branch = self._branch(run, values[run], allowed[run], int(greedy[run]), at[run])
                if branch is not None:
                    actions[run] = branch
                    self.branch_depths[run] = self._limit
        if self.planned is not None:
            for run in filter(self.plans, range(len(actions))):
                if not self.following[run]:
                    action = self.planned.action(run, int(at[run]), lasts[run], lengths[run])
                    actions[run] = actions[run] if action is None else action
        actions = np.where(self.following, greedy, actions)
        return actions, actions == greedy

    def bonus(self, indices: NDArray[np.int64], steps: int) -> NDArray[np.float64] | None:
        """Return what is added to values for few visits; None where that is nothing.

        Parameters
        ----------
        indices
            Of observations, by run, shape (runs, n).
        steps
            How many steps every run has done.

        Returns
        -------
        ndarray or None
            Shape (runs, n, actions).
        """
        if self._options.exploration != "count":
            return None
        most = self._schedules.bonus(steps)
        if not most:
            return None
        visits = take_rows(self._counts.visits, indices)
        bonus: NDArray[np.float64] = most * _FADING.take(np.minimum(visits, len(_FADING) - 1))
        return bonus

    def notes(self) -> dict[str, Any]:
        """Return how episodes in progress go on, as JSON values."""
        return {
            "branch": list(self.branch_depths),
            "completed": self.completed.tolist(),
            "following": list(self.following),
            "plans": [] if self.planned is None else self.planned.notes(),
        }

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return what plans are made with."""
        return {} if self.planned is None else self.planned.arrays(name)

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        """Take over what `arrays` and `notes` returned; the counts have been read before.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        self.branch_depths = [int(depth) for depth in notes["branch"]]
        self.completed = np.array(notes["completed"], dtype=np.bool_)
        self.following = [bool(one) for one in notes["following"]]
        if self.planned is not None:
            self.planned.read(name, arrays, notes["plans"])

    def _branch(
        self,
        run: int,
        values: NDArray[np.float32],
        allowed: NDArray[np.bool_],
        greedy: int,
        at: np.int64,
    ) -> int | None:
        """Return the most promising action that is not the policy's; None where there is none.

        Parameters
        ----------
        run
            Whose.
        values, allowed
            Of all its actions, shape (actions,).
        greedy
            The policy's action.
        at
            Index of what the run observes.
        """
        visits = self._counts.visits[run, at]
        others = allowed.copy()
        others[greedy] = False
        if not self.completed[run]:
            others &= visits == 0
        if not others.any():
            return None
        promise = values + _TRIED_SELDOM / np.sqrt(visits + 1.0)
        return int(np.where(others, promise, -np.inf).argmax())
