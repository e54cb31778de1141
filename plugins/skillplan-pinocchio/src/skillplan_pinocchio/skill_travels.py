"""How the arm travels to where each motion of a skill begins, in a state."""

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
    """The travel to where the hand goes down to a target.

    Parameters
    ----------
    visit
        What is done there.
    travel
        The way, why there is none, or what it overloads.
    """

    visit: Visit
    travel: Travel | Unfound | Overload

    @property
    def evidence(self) -> dict[str, Any] | None:
        """A planned way as JSON values, None for any other."""
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
    """Which travels are so high that nothing can be met on them.

    Parameters
    ----------
    heights
        Of straight travels.
    safe_height_m
        At which hand and load are where travels end [m].
    top_m
        Of the tallest obstacle [m].
    stands
        Return how the arm stands at every place, by the fact that it is there, and how it stands
        above targets: they are asked for once, if it depends on them.
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
        """Whether there may be some: nothing is as tall as the height at which they end."""
        return self.top_m <= self.safe_height_m

    @cached_property
    def stands(self) -> Mapping[str, Vector]:
        """How the arm stands at places [rad]; all travels between them and targets are known."""
        found = self._stands()
        self.heights.prepare([*found.values(), *self._targets()])
        return found

    def is_safe(self, one_rad: Vector, other_rad: Vector) -> bool:
        """Whether nothing can be met on a straight travel between two postures."""
        if not self.any:
            return False
        return self.heights.lowest_m(one_rad, other_rad, self.safe_height_m) >= self.top_m

    def needs_check(self, place: str, goal_rad: Vector, holds: Holds) -> bool:
        """Whether the travel from a place has to be checked; asks for places it depends on."""
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
    motions
        As the arm makes them; all of them can be reached.
    safe
        Which travels need no check.
    planner
        Finds the others.
    gravity
        Holds the torques of travels to the limits of the joints.
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

    def found(
        self, place: str, stand_rad: Vector | None, elbows: Mapping[int, int], holds: Holds
    ) -> list[TravelTo]:
        """Return the travels that had to be checked, in order, up to one that is not found.

        Parameters
        ----------
        place
            The fact that says where the arm stands.
        stand_rad
            How it stands there, shape (joints,); None where it cannot.
        elbows
            Which of a motion's elbows is taken, by the number of the motion; else the first.
        holds
            Asked for every fact that they rest on.
        """
        found: list[TravelTo] = []
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
                found.append(TravelTo(motion.motion.visit, travel))
                if isinstance(travel, Unfound):
                    break
            if here is not None and not self.gravity.is_safe(motion.motion, motion.motion.carries):
                if number == 0:
                    holds(place)
                known = found[-1].travel if checked else None
                path = known.path if isinstance(known, Travel) else JointPath([here, goal])
                overload = self.gravity.on_travel(motion.motion, path)
                if overload is not None:
                    found.append(TravelTo(motion.motion.visit, overload))
                    break
            here = strokes.end
        return found
