"""Travels of the arm to the motions of a skill, in a state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from skillplan.task.motion import Visit
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.gravity import GravityCheck, Overload
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion
from skillplan_pinocchio.planning.travel import Holds, Travel, Unfound
from skillplan_pinocchio.planning.travel_planner import TravelHeights, TravelPlanner


@dataclass(frozen=True)
class TravelTo:
    """The travel to a motion.

    Parameters
    ----------
    travel
        Travel, reason why there is none, or the overload on it.
    """

    visit: Visit
    travel: Travel | Unfound | Overload

    @property
    def evidence(self) -> dict[str, Any] | None:
        """A planned path as JSON values, or None."""
        if not isinstance(self.travel, Travel) or self.travel.is_straight:
            return None
        nodes = self.travel.path.nodes
        return {
            "to": self.visit.subject,
            "event": self.visit.event.value,
            "around": list(self.travel.around),
            "nodes_rad": [[round(float(angle), 6) + 0.0 for angle in node] for node in nodes],
        }


class SafeTravels:
    """Decides which travels are above all obstacles.

    Parameters
    ----------
    safe_height_m
        Height of hand and load at the ends of travels [m].
    top_m
        Height of the tallest obstacle [m].
    stands, targets
        Functions that return the postures at all places, by fact, and above targets; called at most
        once.
    """

    def __init__(
        self,
        heights: TravelHeights,
        safe_height_m: float,
        top_m: float,
        stands: Callable[[], Mapping[str, Vector]],
        targets: Callable[[], Sequence[Vector]],
    ) -> None:
        self.heights = heights
        self.safe_height_m = safe_height_m
        self.top_m = top_m
        self._stands, self._targets = stands, targets

    @property
    def any(self) -> bool:
        """Return whether safe travels are possible: no obstacle exceeds the safe height."""
        return self.top_m <= self.safe_height_m

    @cached_property
    def stands(self) -> Mapping[str, Vector]:
        """Postures at places [rad]; all travels between them and targets are prepared."""
        stands = self._stands()
        self.heights.prepare([*stands.values(), *self._targets()])
        return stands

    def is_safe(self, begin_rad: Vector, end_rad: Vector) -> bool:
        """Return whether a straight travel between two postures is above all obstacles."""
        if not self.any:
            return False
        return self.heights.lowest_m(begin_rad, end_rad, self.safe_height_m) >= self.top_m

    def needs_check(self, place: str, goal_rad: Vector, holds: Holds) -> bool:
        """Return whether the travel from a place needs a check; reads facts of places."""
        if not self.any:
            return holds(place)
        risky = [
            fact for fact, posture in self.stands.items() if not self.is_safe(posture, goal_rad)
        ]
        if place in risky:
            return holds(place)
        for fact in risky:
            holds(fact)
        return False


class SkillTravels:
    """The travels of a skill.

    Parameters
    ----------
    safe
        Check for travels above all obstacles.
    gravity
        Check of gravity torques on travels.
    """

    def __init__(
        self,
        motions: Sequence[ArmMotion],
        safe: SafeTravels,
        planner: TravelPlanner,
        gravity: GravityCheck,
    ) -> None:
        self.motions = tuple(motions)
        self.safe = safe
        self.planner = planner
        self.gravity = gravity

    def find(
        self, place: str, stand_rad: Vector | None, elbows: Mapping[int, int], holds: Holds
    ) -> list[TravelTo]:
        """Return the checked travels in order, up to the first that fails.

        Parameters
        ----------
        place
            Fact for the arm's place.
        stand_rad
            Posture there, shape (joints,); None if the arm cannot stand there.
        elbows
            Number of the elbow by number of the motion; default: the first.
        holds
            Called for every fact that the travels rest on.
        """
        travels: list[TravelTo] = []
        here = stand_rad
        for number, motion in enumerate(self.motions):
            strokes = motion.elbows[elbows.get(number, 0)].strokes
            goal = strokes.begin
            if number == 0:
                checked = here is not None and self.safe.needs_check(place, goal, holds)
            else:
                checked = here is not None and not self.safe.is_safe(here, goal)
            if checked and here is not None:
                travel = self.planner.travel(here, goal, motion.motion, holds)
                travels.append(TravelTo(motion.motion.visit, travel))
                if isinstance(travel, Unfound):
                    break
            if here is not None and not self.gravity.is_safe(motion.motion, motion.motion.carries):
                if number == 0:
                    holds(place)
                known = travels[-1].travel if checked else None
                path = known.path if isinstance(known, Travel) else JointPath([here, goal])
                overload = self.gravity.on_travel(motion.motion, path)
                if overload is not None:
                    travels.append(TravelTo(motion.motion.visit, overload))
                    break
            here = strokes.end
        return travels
