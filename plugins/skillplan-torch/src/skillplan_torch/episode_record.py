"""The episode that a run is in: what was observed and done, and what it cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.env.transition_table import COMPLETE, INFEASIBLE, OUT_OF_TIME
from skillplan.solvers.learning.learner import End, Episode

_ENDS: Mapping[int, End] = {
    COMPLETE: "complete",
    INFEASIBLE: "infeasible",
    OUT_OF_TIME: "out-of-time",
}


@dataclass
class EpisodeRecord:
    """What has happened since an episode began.

    Parameters
    ----------
    indices, actions
        Of every step, the index of what was observed, see `ObservationCounts`, and the action.
    costs, rewards
        Of every step, in the environment.
    greedy
        Whether the policy was followed so far.
    """

    indices: list[int] = field(default_factory=list)
    actions: list[int] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    greedy: bool = True

    @property
    def length(self) -> int:
        """How many actions were taken."""
        return len(self.actions)

    @property
    def last_action(self) -> int:
        """The action taken last; -1 where none was."""
        return self.actions[-1] if self.actions else -1

    def add(self, index: int, action: int, cost: float, reward: float) -> None:
        """Take note of a step.

        Parameters
        ----------
        index
            Of what was observed.
        action
            What was done.
        cost, reward
            In the environment.
        """
        self.indices.append(index)
        self.actions.append(action)
        self.costs.append(cost)
        self.rewards.append(reward)

    def ended(self, run: int, step: int, end: int) -> Episode:
        """Return the episode of a run, which ended with its step of this number."""
        return Episode(
            run,
            step,
            _ENDS[end],
            tuple(self.actions),
            sum(self.costs),
            sum(self.rewards),
            self.greedy,
        )

    def document(self) -> dict[str, Any]:
        """Return all of it as JSON values, to be read by `read`."""
        return {
            "situations": list(self.indices),
            "actions": list(self.actions),
            "costs": list(self.costs),
            "rewards": list(self.rewards),
            "greedy": self.greedy,
        }

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> EpisodeRecord:
        """Return the record that `document` returned."""
        return cls(
            indices=list(document["situations"]),
            actions=list(document["actions"]),
            costs=list(document["costs"]),
            rewards=list(document["rewards"]),
            greedy=bool(document["greedy"]),
        )
