"""Base of physics engines and collision detectors.

The two kinds do not import each other, so their common part is here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from skillplan.task.motion import Event
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


class Options(BaseModel):
    """Options of a plugin; unknown names and values of other types are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


@dataclass(frozen=True, slots=True)
class RemovedDwell:
    """A former option for a dwell time, which the task file holds now.

    Parameters
    ----------
    event
        Action of the hand during the dwell.
    key
        Key in the task file that replaces it.
    owners
        Description of the objects that have the key.
    """

    event: Event
    default_s: float
    key: str
    owners: str


class BackEnd(ABC):
    """Checks whether skills can be executed.

    Parameters
    ----------
    task
        The task whose skills are checked.
    options
        Options; None for the defaults.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    version
        Changes whenever verdicts may change; part of the key of kept verdicts.
    expected_s
        Order of magnitude of the duration of a check [s]; cheaper back ends check first.
    expensive
        True if verdicts are kept on disk.
    removed_options
        Former options, by name. A task file or command that sets one is refused; stored results
        that name one can still be verified.
    screens
        True if it only rules out skills before an expensive back end executes them. Such a back end
        times no skills.
    """

    name: ClassVar[str]
    version: ClassVar[str] = "1"
    expected_s: ClassVar[float] = 1e-5
    expensive: ClassVar[bool] = False
    Options: ClassVar[type[BaseModel]] = Options
    removed_options: ClassVar[Mapping[str, RemovedDwell]] = {}

    def __init__(self, task: Task, options: BaseModel | None = None) -> None:
        self.task = task
        self.options = self.Options() if options is None else options
        self.screens = False

    def refuses(self) -> str | None:
        """Return the reason why this back end cannot serve its task, or None."""
        return None

    def faults(self) -> Mapping[str, str]:
        """Return faults of single bodies or skills, as messages by a fact about them.

        The domain finds the line of the task file for the fact: a part too wide for the hand is
        reported under ``placed(part)``.
        """
        return {}

    def warnings(self) -> Mapping[str, str]:
        """Return warnings about single bodies or skills, by a fact about them.

        Only ``check`` prints them: the file is valid, and a plan may exist.
        """
        return {}

    def not_checked(self) -> tuple[str, ...]:
        """Return sentences about aspects that are not checked.

        For example "torque limit of joint_3: not in the robot description". Results print them.
        Called after `beside`.
        """
        return ()

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Receive the other back ends of the chain; called once, before the first check."""
        return

    def take_over(self, other: BackEnd) -> None:
        """Reuse what a back end with the same name and task has computed; verdicts stay the same.

        Called before the first check.
        """
        return

    @property
    def basis(self) -> Mapping[str, Any]:
        """JSON values that verdicts depend on in addition to task and options.

        A detector that reads an engine's simulation depends on the engine's options.
        """
        return {}

    def duration_s(self, skill: Skill, state: State) -> float | None:
        """Return the execution time of `skill` from `state` [s], or None for the task's figure.

        May depend only on the places of robots and the tools they hold.
        """
        return None

    def least_duration_s(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on `duration_s`, without computing a trajectory [s].

        Searches for the shortest cycle time compute a time only if this bound does not exclude the
        skill. A time below the bound is an error.

        Parameters
        ----------
        true_bits, false_bits
            Bits of the facts that are known to hold, and not to hold.

        Returns
        -------
        float
            Lower bound over all such states, >= 0; inf if `duration_s` returns None in all of them.
        """
        return 0.0

    def refuse_early(self, skill: Skill, state: State) -> Verdict | None:
        """Return the refusal of `check` if it is found in a fraction of its time, else None."""
        return None

    @abstractmethod
    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict on an execution.

        Parameters
        ----------
        skill
            A skill of the task, applicable in `state`; for a skill with several motions, one
            variant under a name of its own.

        Returns
        -------
        Verdict
            Verdict with the facts it rests on, if the back end knows them. It must be equal for
            equal arguments, in any order of queries.
        """
