"""Interface of solvers that learn one policy on many boards and apply it to others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.solver import Solver
from skillplan.task.skill import Skill
from skillplan.task.state import State


class FamilyPolicy(ABC):
    """A policy for any board of a family.

    Attributes
    ----------
    element_features, pair_features
        Names of the features of an element and of a pair of elements, in order.
    """

    element_features: ClassVar[tuple[str, ...]]
    pair_features: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def weights(self) -> Mapping[str, NDArray[np.float32]]:
        """Weights by name, float32."""

    @property
    @abstractmethod
    def dimensions(self) -> dict[str, int]:
        """Dimensions of the network by name, from which `build` restores it."""

    @classmethod
    @abstractmethod
    def build(
        cls, dimensions: Mapping[str, int], arrays: Mapping[str, NDArray[np.float32]]
    ) -> FamilyPolicy:
        """Return a stored policy.

        Raises
        ------
        ValueError
            If the arrays do not fit the dimensions.
        """

    @abstractmethod
    def choice_on(self, model: SkillModel) -> Callable[[State], Skill]:
        """Return the greedy choice on a task.

        Raises
        ------
        OptionError
            If the policy cannot act on the task.
        BackEndError
            If a back end fails.
        """


@dataclass(frozen=True)
class FamilyLesson:
    """Result of a training on many boards.

    Parameters
    ----------
    policy
        The learned policy.
    trace
        Figures of the training, JSON values only.
    """

    policy: FamilyPolicy
    trace: dict[str, Any] = field(default_factory=dict)


class FamilyLearner(Solver):
    """A solver that learns one policy on many boards.

    Attributes
    ----------
    Policy
        Class of its policies.
    """

    Policy: ClassVar[type[FamilyPolicy]]
    polls = True

    @property
    @abstractmethod
    def boards(self) -> int:
        """Number of boards to learn on, >= 1."""

    @property
    @abstractmethod
    def steps(self) -> int:
        """Number of calls of `on_step` in one training."""

    @abstractmethod
    def learn(
        self, boards: Iterable[SkillModel], seed: int, on_step: Callable[[], None]
    ) -> FamilyLesson:
        """Learn until done or stopped.

        Parameters
        ----------
        boards
            At least one board; iterated once.
        seed
            Seed of all randomness: equal boards and seeds give equal policies.
        on_step
            Called after each of the `steps`.

        Raises
        ------
        OptionError
            If the boards cannot be learned on.
        """
