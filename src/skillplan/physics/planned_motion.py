"""A plan as it would move if everything went as planned: paths and times, nothing simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from skillplan.physics.performance import PerformedSkill, Sample
from skillplan.task.skill import Skill

MOST_PLAYED_S = 3_600
"""Length of the longest plan that is played [s], as all its frames are in memory."""


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """Where arm and parts are at every moment of a plan, by its paths.

    Parameters
    ----------
    skills
        When each begins and ends.
    samples
        One row a frame; contacts are in none of them.
    """

    skills: tuple[PerformedSkill, ...]
    samples: Sequence[Sample]


@runtime_checkable
class MotionPlans(Protocol):
    """A back end that knows the paths and times of whole plans."""

    name: str

    def planned_motion(self, skills: Sequence[Skill], frames_per_s: int) -> PlannedMotion:
        """Return how the arm moves in a plan, from the initial state on.

        Parameters
        ----------
        skills
            Each applicable when its turn comes, and with one motion at most.
        frames_per_s
            How many samples there are to a second, >= 1.

        Raises
        ------
        ValueError
            If there is no path for one of them; says in a clause for which, and why.
        """
