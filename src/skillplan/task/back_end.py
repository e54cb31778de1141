"""What physics engines and collision detectors have in common.

The two kinds are siblings that must not know each other, so that what they share stands here.
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
    """Options of a plugin: unknown ones are refused, values are not coerced from other types."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


@dataclass(frozen=True, slots=True)
class RemovedDwell:
    """An option that was a dwell time before the task had all of them.

    Parameters
    ----------
    event
        Act of the hand in that time.
    default_s
        Its default [s].
    key
        The key of a task file that replaces it.
    owners
        Objects that have the key, in words.
    """

    event: Event
    default_s: float
    key: str
    owners: str


class BackEnd(ABC):
    """Decides about whether a skill can be executed in a state.

    Parameters
    ----------
    task
        The task whose skills are checked.
    options
        An instance of `Options`; None for the defaults.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    version
        Changes whenever an answer may; part of the key of verdicts kept on disk.
    expected_s
        Order of magnitude of the time one check takes [s]: cheaper back ends are queried first.
    expensive
        Whether its verdicts are worth keeping on disk.
    removed_options
        Options of earlier versions, by name. A task file or command that gives one is refused
        with the key that replaces it; stored results that name one are still verified.
    screens
        Whether it is queried only to rule out what expensive ones need not execute; set where it
        is put before them. How long skills take is then left to them.
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
        """Return in words why this back end cannot serve its task; None if it can."""
        return None

    def faults(self) -> Mapping[str, str]:
        """Return what is wrong with single bodies or skills, in words, by a fact about them.

        The task's domain finds the line of the file that the fact comes from: a part too wide
        for the hand is reported under ``placed(part)``. Unlike `refuses`, it may name several.
        """
        return {}

    def warnings(self) -> Mapping[str, str]:
        """Return warnings on single bodies or skills, by a fact about them, as in `faults`.

        Only ``check`` prints them: the file is valid, and a plan may exist.
        """
        return {}

    def not_checked(self) -> tuple[str, ...]:
        """Return sentences that name what this back end leaves unchecked of its task.

        For example "torque limit of joint_3: not in the robot description". Results print them.
        Called after `beside`.
        """
        return ()

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Learn which back ends are queried besides; called once, before the first check."""
        return

    @property
    def basis(self) -> Mapping[str, Any]:
        """What its answers depend on besides task and options, as JSON values.

        A detector that reads an engine's simulation depends on the engine's options.
        """
        return {}

    def duration_s(self, skill: Skill, state: State) -> float | None:
        """Return how long `skill` takes from `state` [s], or None where the task's figure counts.

        May depend on where robots stand and which tools they hold, on nothing else.
        """
        return None

    def least_duration_s(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on `duration_s`, without working out any trajectory [s].

        Where cycle time is what is minimised, searches ask for times only where this bound does
        not do. A time below it is refused as a contradiction.

        Parameters
        ----------
        skill
            A skill of the task.
        true_bits, false_bits
            Bits of the facts that are known to hold, and not to hold, where it starts.

        Returns
        -------
        float
            At most what `duration_s` says in any such state, >= 0; inf where it says None in all
            of them.
        """
        return 0.0

    @abstractmethod
    def check(self, skill: Skill, state: State) -> Verdict:
        """Decide about one execution.

        Parameters
        ----------
        skill
            A skill of the task, applicable in `state`; one that has several ways by one of them,
            under a name of its own.
        state
            Where it starts.

        Returns
        -------
        Verdict
            With the facts it rests on, where the back end can say. The same for the same
            arguments, whatever was queried before.
        """
