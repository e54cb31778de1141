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
        The task, or one in which something stands that should not.
    skill, state
        What is executed, and where it starts.
    truth
        Legitimate; a collision; or nothing touches, but what is set down ends elsewhere.
    kind
        How it goes wrong, in a word or two; empty where it does not.
    staged
        How it goes wrong, in words; empty where it does not.
    """

    task: Task
    skill: Skill
    state: State
    truth: Truth
    kind: str = ""
    staged: str = ""
