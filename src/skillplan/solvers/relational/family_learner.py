"""The interface of solvers that learn one policy on many boards, to be tried on others."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.relational.relational_network import RelationalNetwork
from skillplan.solvers.solver import Solver


@dataclass(frozen=True)
class FamilyLesson:
    """What has been learned.

    Parameters
    ----------
    network
        The policy.
    trace
        Figures of the learning, JSON values only.
    """

    network: RelationalNetwork
    trace: dict[str, Any] = field(default_factory=dict)


class FamilyLearner(Solver):
    """A solver that learns one relational policy on many boards."""

    polls = True

    @property
    @abstractmethod
    def boards(self) -> int:
        """How many boards it wants to learn on, >= 1."""

    @abstractmethod
    def learn(
        self, boards: Iterable[SkillModel], seed: int, on_step: Callable[[], None]
    ) -> FamilyLesson:
        """Learn until done or stopped.

        Parameters
        ----------
        boards
            At least one; gone through once.
        seed
            Governs all randomness: the same boards and seed give the same network.
        on_step
            Called after each of the `steps` that the learning has.

        Raises
        ------
        OptionError
            If the boards cannot be learned on.
        """

    @property
    @abstractmethod
    def steps(self) -> int:
        """How often `learn` calls `on_step`."""
