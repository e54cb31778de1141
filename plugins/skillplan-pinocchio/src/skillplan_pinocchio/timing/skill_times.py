"""Durations of skills from travels, motions and dwells, and lower bounds on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from skillplan.task.pose import Point
from skillplan.task.scene import Robot, Tool
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion
from skillplan_pinocchio.stands import Stand, Stands
from skillplan_pinocchio.timing.slow_zones import SlowZones
from skillplan_pinocchio.timing.trajectory import JointLimits, find_fastest_trajectory


class SkillTimes:
    """Durations of linear motions and of the travels between them.

    Parameters
    ----------
    slow_zones
        Zones with a limit on the speed of the tool's tip; None for none.
    """

    def __init__(self, limits: JointLimits, slow_zones: SlowZones | None = None) -> None:
        self.limits = limits
        self.slow_zones = slow_zones
        self._transfers: dict[tuple[bytes, bytes], JointPath] = {}
        self._paths_s: dict[tuple[bytes, Point], float] = {}

    def duration_s(self, planned: tuple[ArmMotion, ...], stand: Stand) -> float | None:
        """Return the duration of some motions in order [s]; None if the arm cannot make them.

        Parameters
        ----------
        planned
            At least one motion.
        """
        here = stand.joints_rad
        total_s = 0.0
        if stand.came_from_rad is not None and here is not None:
            total_s = self._path_s(self.transfer(stand.came_from_rad, here), planned[0].motion.tool)
        for motion in planned:
            if not motion.elbows or here is None:
                return None
            strokes = motion.elbows[0].strokes
            before, after = motion.motion.tool, motion.motion.tool_after
            total_s += self._path_s(self.transfer(here, strokes.begin), before)
            doubled = strokes.mirrored and self._beyond_m(before) == self._beyond_m(after)
            down_s = zip(strokes.down, motion.motion.least_times_s, strict=True)
            stretches_s = sum(max(self._path_s(path, before), least_s) for path, least_s in down_s)
            if not doubled:
                stretches_s += sum(self._path_s(path, after) for path in strokes.up)
            if doubled:
                # The way back has the same speeds and opposite accelerations.
                stretches_s *= 2
            total_s += stretches_s + motion.motion.visit.dwell_s
            here = strokes.end
        # Rounded to a nanosecond, which is equal on every machine.
        return round(total_s, 9)

    def _beyond_m(self, tool: Tool | None) -> Point:
        """Return where the speed is limited, in the frame of the arm's tip [m]."""
        still = self.slow_zones is None or tool is None
        return (0.0, 0.0, 0.0) if still or tool is None else tool.tip_on_arm.position

    def _path_s(self, path: JointPath, tool: Tool | None) -> float:
        """Return the duration of a path from rest to rest with a tool [s]."""
        key = path.nodes.tobytes(), self._beyond_m(tool)
        if key not in self._paths_s:
            zones = None if self.slow_zones is None else self.slow_zones.with_tool(tool)
            run = find_fastest_trajectory(path, self.limits, zones)
            self._paths_s[key] = run.duration_s
        return self._paths_s[key]

    def transfer(self, start: Vector, end: Vector) -> JointPath:
        """Return the straight travel in joint space between two postures above targets.

        Obstacles are ignored: the duration of a skill depends on places only.
        """
        key = (start.tobytes(), end.tobytes())
        if key not in self._transfers:
            self._transfers[key] = JointPath([start, end])
        return self._transfers[key]


# Durations are rounded to a nanosecond, and neither sum is exact.
_SLACK_S = 2e-9


@dataclass(frozen=True, eq=False)
class _Course:
    """A skill's motions, for any place where it starts.

    Parameters
    ----------
    begins
        Posture above the first target [rad].
    rest_s
        Lower bound on the time from there on [s].
    """

    begins: Vector
    rest_s: float


class LeastTimes:
    """Lower bounds on durations of skills if only some facts of the start are known.

    Parameters
    ----------
    plan
        Returns the planned motions of a skill in a state.
    """

    def __init__(
        self,
        task: Task,
        robot: Robot,
        times: SkillTimes,
        stands: Stands,
        plan: Callable[[Skill, State], tuple[ArmMotion, ...]],
    ) -> None:
        self.task = task
        self.robot = robot
        self.times = times
        self.stands = stands
        self.plan = plan
        self._places = {task.facts.bit(fact): fact for fact in robot.places}
        self._tools = [*dict.fromkeys(task.facts.bit(tool.fact) for tool in robot.tools)]
        self._courses: dict[tuple[str, int], _Course | None] = {}

    def least_s(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the duration of a skill [s]; inf if it has none.

        Parameters
        ----------
        true_bits, false_bits
            Bits of the facts known to hold, and not to hold, where it starts.
        """
        if skill.motion is None:
            return math.inf
        courses = [
            course
            for bits in self._circumstances(skill, true_bits, false_bits)
            if (course := self._course(skill, bits)) is not None
        ]
        return min(
            (
                max(0.0, self._to(fact, course.begins) + course.rest_s - _SLACK_S)
                for fact in self._open_places(true_bits, false_bits)
                for course in courses
            ),
            default=math.inf,
        )

    def _open_places(self, true_bits: int, false_bits: int) -> Iterator[str]:
        """Yield the possible places of the arm."""
        known = [fact for bit, fact in self._places.items() if bit & true_bits]
        if known:
            yield from known
            return
        yield from (fact for bit, fact in self._places.items() if not bit & false_bits)

    def _circumstances(self, skill: Skill, true_bits: int, false_bits: int) -> Iterator[int]:
        """Yield the bits of possible tools and routes of a skill."""
        assert skill.motion is not None
        every = sum(self._tools)
        for route in skill.motion.routes:
            if route.when.bits & false_bits:
                continue
            attached = (true_bits | route.when.bits) & every
            if attached & (attached - 1):
                continue  # Two tools are never attached at once.
            if attached:
                yield attached | route.when.bits
                continue
            yield route.when.bits
            yield from (bit | route.when.bits for bit in self._tools if not bit & false_bits)

    def _course(self, skill: Skill, bits: int) -> _Course | None:
        """Return the motions of a skill, or None if the arm cannot make them."""
        key = (skill.name, bits)
        if key not in self._courses:
            self._courses[key] = self._compute_course(self.plan(skill, self.task.facts.state(bits)))
        return self._courses[key]

    def _compute_course(self, planned: tuple[ArmMotion, ...]) -> _Course | None:
        begins: Vector | None = None
        here: Vector | None = None
        rest_s = 0.0
        for motion in planned:
            if not motion.elbows:
                return None
            strokes = motion.elbows[0].strokes
            if here is None:
                begins = strokes.begin
            else:
                rest_s += self._between(here, strokes.begin)
            least_times_s = (*motion.motion.least_times_s, *(0.0 for _ in strokes.up))
            for path, least_s in zip((*strokes.down, *strokes.up), least_times_s, strict=True):
                rest_s += max(self._between(path.nodes[0], path.nodes[-1]), least_s)
            rest_s += motion.motion.visit.dwell_s
            here = strokes.end
        return None if begins is None else _Course(begins, rest_s)

    def _to(self, fact: str, begins: Vector) -> float:
        """Return a lower bound on the time from a place to above a skill's first target [s]."""
        stand = self.stands.at(fact, self.robot.places[fact])
        if stand.joints_rad is None:
            return 0.0
        behind_s = 0.0
        if stand.came_from_rad is not None:
            behind_s = self._between(stand.came_from_rad, stand.joints_rad)
        return behind_s + self._between(stand.joints_rad, begins)

    def _between(self, start: Vector, end: Vector) -> float:
        return bound_duration_s(start, end, self.times.limits)


def bound_duration_s(start: Vector, end: Vector, limits: JointLimits) -> float:
    """Return the minimum time from rest to rest between two postures [s].

    Parameters
    ----------
    start, end
        Joint angles [rad], shape (joints,).
    """
    speed, gain = np.array(limits.speed_rad_per_s), np.array(limits.acceleration_rad_per_s2)
    way = np.abs(np.asarray(end) - np.asarray(start))
    coasting = way / speed + speed / gain
    return float(np.where(way * gain >= speed**2, coasting, 2 * np.sqrt(way / gain)).max())
