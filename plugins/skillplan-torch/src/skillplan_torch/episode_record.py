"""The episode that a run is in."""

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
    situations, actions
        Where what was done.
    paid
        What a learner makes of the reward of every step.
    costs, rewards
        Of every step.
    slots
        Where the transitions that begin with the first steps are remembered.
    greedy
        Whether the policy was followed so far.
    """

    situations: list[int] = field(default_factory=list)
    actions: list[int] = field(default_factory=list)
    paid: list[float] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    slots: list[int] = field(default_factory=list)
    greedy: bool = True

    @property
    def length(self) -> int:
        """How many actions were taken."""
        return len(self.actions)

    @property
    def last_action(self) -> int:
        """The action taken last; -1 where none was."""
        return self.actions[-1] if self.actions else -1

    def add(self, situation: int, action: int, paid: float, cost: float, reward: float) -> None:
        """Take note of a step."""
        self.situations.append(situation)
        self.actions.append(action)
        self.paid.append(paid)
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
            "situations": list(self.situations),
            "actions": list(self.actions),
            "paid": list(self.paid),
            "costs": list(self.costs),
            "rewards": list(self.rewards),
            "slots": list(self.slots),
            "greedy": self.greedy,
        }

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> EpisodeRecord:
        """Return the record that `document` returned."""
        lists = {key: list(value) for key, value in document.items() if key != "greedy"}
        return cls(**lists, greedy=bool(document["greedy"]))
