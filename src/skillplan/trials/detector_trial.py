"""One execution that detectors are tried on, and what is true of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task


class Truth(StrEnum):
    """What is true of an execution, whatever a detector says of it."""

    LEGITIMATE = "legitimate"
    COLLISION = "collision"
    OUTCOME = "outcome"


@dataclass(frozen=True, slots=True)
class Trial:
    """An execution with a known truth.

    Parameters
    ----------
    task
        The task, or one with an injected fault.
    skill, state
        What is executed, and where it starts.
    truth
        Legitimate; a collision; or nothing touches, but what is set down ends elsewhere.
    kind
        How it goes wrong, in a word or two, or that it is a near miss; else empty.
    fault
        What goes wrong, in words, or where the obstacle of a near miss stands; else empty.
    """

    task: Task
    skill: Skill
    state: State
    truth: Truth
    kind: str = ""
    fault: str = ""
