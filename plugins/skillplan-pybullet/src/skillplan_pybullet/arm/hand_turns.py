"""How the hand is turned at every target: jaws close alike when it is turned by half.

A part keeps the turn that it was picked up with, so that one turn is chosen for all that is done
with it by one grasp, as near as can be to the posture in which the wrist has most room. It depends
on the task alone: a check of one skill and a whole plan agree on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.task.grasp import Grasp
from skillplan.task.motion import Point
from skillplan.task.scene import Robot
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pybullet.arm.kinematics import UnreachableError, Vector, kinematics_of
from skillplan_pybullet.arm.rotations import (
    by_half_a_turn,
    of_quaternion,
    pointing_down,
    points_down,
)


@dataclass(frozen=True, slots=True)
class ArmMotion:
    """A motion of the hand with how the arm follows it.

    Parameters
    ----------
    motion
        Of the task.
    rotation
        How the hand is turned in it, shape (3, 3).
    approach
        Postures at the points of the approach [rad], shape (joints,) each.
    retreat
        The same of the retreat.
    """

    motion: LinearMotion
    rotation: Vector
    approach: tuple[Vector, ...]
    retreat: tuple[Vector, ...]

    @property
    def points_down(self) -> bool:
        """Whether the hand points straight down."""
        return points_down(self.rotation)


@dataclass(frozen=True, slots=True)
class HandPose:
    """Where the tip is at a place, and how the hand is turned there, shape (3, 3)."""

    position: Point
    rotation: Vector


# A subject, and how it is held where that is a matter of choice.
_Held = tuple[str, Grasp | None]


def _held(motion: LinearMotion) -> _Held:
    return motion.visit.subject, motion.visit.grasp


class HandTurns:
    """Knows the turns of a task's targets, and the postures of the arm there.

    Parameters
    ----------
    task
        With one robot.
    drop_height_m
        From how high parts are let go [m].
    """

    def __init__(self, task: Task, drop_height_m: float) -> None:
        self.robot: Robot = task.scene.robots[0]
        self.kinematics = kinematics_of(self.robot)
        self._motions: dict[_Held, list[LinearMotion]] = {}
        self._chosen: set[str] = set()
        self._ends: dict[str, LinearMotion] = {}
        for skill in task.skills:
            for way in skill.ways:
                self._chosen |= {
                    visit.subject for route in way.motion.routes for visit in route.visits
                }
            for one in [skill.by(way) for way in skill.ways] or [skill]:
                self._note(task, one, drop_height_m)
        self._is_turned: dict[_Held, bool] = {}
        self._known: dict[tuple[LinearMotion, bool], ArmMotion | UnreachableError] = {}

    def _note(self, task: Task, skill: Skill, drop_height_m: float) -> None:
        """Note where a skill with one motion brings the hand."""
        for route in skill.motion.routes if skill.motion is not None else ():
            state: State = skill.precondition.requires | route.when
            motions = linear_motions(task, skill, state, drop_height_m)
            for motion in motions:
                self._motions.setdefault(_held(motion), []).append(motion)
            for fact in skill.prediction.add:
                if fact in self.robot.places:
                    before = self._ends.get(fact, motions[-1])
                    highest = max(before, motions[-1], key=lambda one: one.ends_at[2])
                    self._ends[fact] = highest

    def arm_motion(self, motion: LinearMotion) -> ArmMotion:
        """Return how the arm follows a motion of the task.

        Raises
        ------
        UnreachableError
            If a point of it is out of reach.
        """
        return self._followed(motion, self._turned(_held(motion)))

    def at(self, place_fact: str, place: Point, least_m: float) -> HandPose:
        """Return where the hand is after what ends at a place.

        Parameters
        ----------
        place_fact, place
            The place, by its fact and its position [m].
        least_m
            Height of the tip where nothing ends there [m]; it is never lower.
        """
        x_m, y_m, _ = place
        last = self._ends.get(place_fact)
        if last is None:
            return HandPose((x_m, y_m, least_m), pointing_down(0.0))
        if last.points_down:
            return HandPose((x_m, y_m, max(last.ends_at[2], least_m)), self.rotation(last))
        return HandPose(last.ends_at, self.rotation(last))

    def rotation(self, motion: LinearMotion) -> Vector:
        """Return how the hand is turned in a motion, shape (3, 3)."""
        return _rotation(motion, turned=self._turned(_held(motion)))

    def _turned(self, held: _Held) -> bool:
        """Whether the hand is turned by half for a subject that is held in some way."""
        if held not in self._is_turned:
            self._is_turned[held] = self._effort(held, turned=True) < self._effort(
                held, turned=False
            )
        return self._is_turned[held]

    def _effort(self, held: _Held, *, turned: bool) -> tuple[int, float]:
        """Return how far a turn takes a joint from its home at worst [rad].

        Before that, how much is out of reach: of several directions one may be.
        """
        home, worst_rad, out_of_reach = self.kinematics.home_rad, 0.0, 0
        for motion in self._motions[held]:
            try:
                postures = self._followed(motion, turned).approach
            except UnreachableError:
                out_of_reach += 1
                continue
            worst_rad = max(worst_rad, *(float(np.abs(one - home).max()) for one in postures))
        if out_of_reach and held[0] not in self._chosen:
            return 1, math.inf
        return out_of_reach, worst_rad

    def _followed(self, motion: LinearMotion, turned: bool) -> ArmMotion:
        key = (motion, turned)
        if key not in self._known:
            self._known[key] = self._follow(motion, _rotation(motion, turned=turned))
        found = self._known[key]
        if isinstance(found, UnreachableError):
            raise found
        return found

    def _follow(self, motion: LinearMotion, rotation: Vector) -> ArmMotion | UnreachableError:
        """Return how the arm follows a motion; or, as a value to be kept, why it cannot."""
        points: Sequence[Point] = (*motion.approach, *motion.retreat[1:])
        try:
            postures = self.kinematics.along(points, rotation)
        except UnreachableError as error:
            return error
        there = len(motion.approach)
        return ArmMotion(motion, rotation, tuple(postures[:there]), tuple(postures[there - 1 :]))


def _rotation(motion: LinearMotion, *, turned: bool) -> Vector:
    if motion.points_down:
        rotation = pointing_down(motion.closing_yaw_rad)
    else:
        rotation = of_quaternion(motion.orientation)
    return by_half_a_turn(rotation) if turned else rotation
