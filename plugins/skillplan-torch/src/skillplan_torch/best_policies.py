"""The best evaluated policy of every run: the cheapest of those that an episode has followed.

Moller et al., section 5, evaluate the best performing model of every session.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learning.learner import Learned
from skillplan.solvers.learning.network_policy import NetworkPolicy

# Costs that differ by less are the same.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class CompletedEpisode:
    """An episode that completed the task, with what was observed and allowed in it.

    Parameters
    ----------
    cost
        What it cost.
    observations, masks
        Before every action, shapes (n, features) and (n, actions).
    actions
        Shape (n,).
    """

    cost: float
    observations: NDArray[np.float32]
    masks: NDArray[np.bool_]
    actions: NDArray[np.int64]

    def follows_from(self, policy: NetworkPolicy) -> bool:
        """Whether a policy takes the same actions throughout."""
        # Of a run that breaks scores overflow; it is named where its network is seen to.
        with np.errstate(over="ignore", invalid="ignore"):
            chosen = policy.greedy(self.observations, self.masks)
        return bool((chosen == self.actions).all())


class CheapestSteps(NamedTuple):
    """Steps of the cheapest episodes, by run.

    Parameters
    ----------
    observations, masks, actions
        Shapes (runs, rows, features), (runs, rows, actions) and (runs, rows, 1).
    shares
        How much each step counts, shape (runs, rows): 1 over a run's steps; 0 in what is left
        over, and of runs without such an episode.
    """

    observations: NDArray[np.float32]
    masks: NDArray[np.bool_]
    actions: NDArray[np.int64]
    shares: NDArray[np.float32]


class BestPolicies:
    """The policies that complete the task at least cost, as far as episodes have shown.

    Where every skill has one outcome, a policy that would take the actions of an episode costs
    what the episode cost. So every policy is compared with the cheapest episode so far and the
    one that has just ended, at the end of every episode.

    Parameters
    ----------
    runs
        How many.
    keeps
        Whether one episode shows what a policy costs; otherwise no policy is kept.
    """

    def __init__(self, runs: int, *, keeps: bool) -> None:
        self._keeps = keeps
        self._best: list[tuple[float, int, NetworkPolicy] | None] = [None] * runs
        self._cheapest: list[CompletedEpisode | None] = [None] * runs

    def ended(
        self, run: int, step: int, episode: CompletedEpisode | None, policy: NetworkPolicy
    ) -> None:
        """Take note of the end of an episode.

        Parameters
        ----------
        run, step
            Whose, and after how many steps.
        episode
            It, if it completed the task.
        policy
            The run's policy as it is.
        """
        if not self._keeps:
            return
        cheapest = self._cheapest[run]
        if episode is not None and (cheapest is None or episode.cost < cheapest.cost - _TOLERANCE):
            self._cheapest[run] = cheapest = episode
        best = self._best[run]
        for one in (cheapest, episode):
            if one is None or (best is not None and one.cost >= best[0] - _TOLERANCE):
                continue
            if one.follows_from(policy):
                self._best[run] = (one.cost, step, policy)
                return

    def cheapest(self, run: int) -> CompletedEpisode | None:
        """Return the cheapest episode of a run that completed the task; None without one."""
        return self._cheapest[run]

    def cheapest_steps(self, rows: int, actions: int) -> CheapestSteps:
        """Return the cheapest episodes of all runs, for so many rows and actions.

        All runs have as many rows, so that none depends on the episodes of the others.
        """
        runs = len(self._cheapest)
        width = max((len(one.observations[0]) for one in self._cheapest if one), default=0)
        found = CheapestSteps(
            np.zeros((runs, rows, width), dtype=np.float32),
            np.zeros((runs, rows, actions), dtype=np.bool_),
            np.zeros((runs, rows, 1), dtype=np.int64),
            np.zeros((runs, rows), dtype=np.float32),
        )
        for run, episode in enumerate(self._cheapest):
            if episode is not None:
                many, known = episode.masks.shape
                found.observations[run, :many] = episode.observations
                found.masks[run, :many, :known] = episode.masks
                found.actions[run, :many, 0] = episode.actions
                found.shares[run, :many] = 1.0 / many
        return found

    def learned(self, run: int, last: NetworkPolicy) -> Learned:
        """Return what a run has learned, given its policy as it is."""
        best = self._best[run]
        return Learned(last) if best is None else Learned(last, best[2], best[0], best[1])

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return copies of the layers, to be read by `read`."""
        found: dict[str, NDArray[Any]] = {}
        for run, best in enumerate(self._best):
            if best is not None:
                for i, weight in enumerate(best[2].weights):
                    found[f"{name}.{run}.{i}.weight"] = weight.copy()
                    found[f"{name}.{run}.{i}.bias"] = best[2].biases[i].copy()
            episode = self._cheapest[run]
            if episode is not None:
                found[f"{name}.{run}.observations"] = episode.observations
                found[f"{name}.{run}.masks"] = episode.masks
                found[f"{name}.{run}.actions"] = episode.actions
        return found

    def document(self) -> list[dict[str, Any]]:
        """Return the rest as JSON values."""
        return [
            {
                "best": None if best is None else {"cost": best[0], "step": best[1]},
                "cheapest": None if episode is None else episode.cost,
            }
            for best, episode in zip(self._best, self._cheapest, strict=True)
        ]

    def read(
        self,
        name: str,
        arrays: Mapping[str, NDArray[Any]],
        documents: Sequence[Mapping[str, Any]],
    ) -> None:
        """Take over what `arrays` and `document` returned.

        Raises
        ------
        ValueError
            If they are of other runs.
        """
        if len(documents) != len(self._best):
            raise ValueError("The snapshot's kept policies are of other runs.")
        try:
            for run, document in enumerate(documents):
                self._read(f"{name}.{run}", run, arrays, document)
        except KeyError as error:
            raise ValueError(f"The snapshot's {error} is missing.") from None

    def _read(
        self,
        name: str,
        run: int,
        arrays: Mapping[str, NDArray[Any]],
        document: Mapping[str, Any],
    ) -> None:
        self._best[run], self._cheapest[run] = None, None
        best, cost = document["best"], document["cheapest"]
        if best is not None:
            layers = sum(key.startswith(f"{name}.") and key.endswith(".bias") for key in arrays)
            policy = NetworkPolicy(
                tuple(np.array(arrays[f"{name}.{i}.weight"]) for i in range(layers)),
                tuple(np.array(arrays[f"{name}.{i}.bias"]) for i in range(layers)),
            )
            self._best[run] = (float(best["cost"]), int(best["step"]), policy)
        if cost is not None:
            self._cheapest[run] = CompletedEpisode(
                float(cost),
                *(
                    np.array(arrays[f"{name}.{key}"])
                    for key in ("observations", "masks", "actions")
                ),
            )
