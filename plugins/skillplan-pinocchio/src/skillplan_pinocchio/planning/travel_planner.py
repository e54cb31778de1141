"""Travels of a scene's robot, in any state: what swept checks, engines track and toppra times."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.scene import Robot, Scene
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_pinocchio.planning.arm_bodies import (
    ArmBodies,
    MovingSolid,
    Vector,
    arm_solids,
    held_solid,
)
from skillplan_pinocchio.planning.travel import Holds, JointSpace, Travel, TravelSearch, Unfound
from skillplan_pinocchio.shapes import Obstacle, obstacles_of

MOST_CHECKS: Final = 5_000


class TravelPlanner:
    """Finds how the arm travels to where a motion begins, with what it holds there.

    Parameters
    ----------
    arm
        The arm.
    sweeps
        Say what is at its end.
    obstacles
        All that there may be in any state.
    most_checks
        Postures that are checked for one travel before it is given up, >= 1.
    check_arm
        Whether the links of the arm are checked.
    """

    def __init__(
        self,
        arm: ArmModel,
        sweeps: HandSweeps,
        obstacles: Sequence[Obstacle],
        *,
        most_checks: int = MOST_CHECKS,
        check_arm: bool = True,
    ) -> None:
        self.arm = arm
        self.sweeps = sweeps
        self._links = arm_solids(arm) if check_arm else ()
        space = joint_space(arm.model, arm.low_rad, arm.high_rad)
        self._search = TravelSearch(obstacles, space, most_checks)

    @classmethod
    def of(cls, scene: Scene, robot: Robot, clearance_m: float = 0.004) -> TravelPlanner:
        """Return the planner of a scene's robot, for whoever tracks the paths that it finds.

        Parameters
        ----------
        scene
            The task's scene.
        robot
            One of its robots.
        clearance_m
            How far open jaws are from the part on either side [m], >= 0.
        """
        sweeps = HandSweeps(scene, robot, clearance_m)
        return cls(ArmModel.of(robot), sweeps, obstacles_of(scene))

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """All that there may be in any state."""
        return self._search.obstacles

    def travel(
        self, start_rad: Vector, goal_rad: Vector, motion: LinearMotion, holds: Holds
    ) -> Travel | Unfound:
        """Return how the arm gets to where a motion begins.

        Parameters
        ----------
        start_rad
            Where the joints are, shape (joints,).
        goal_rad
            Where they are with the tip at the motion's first point.
        motion
            What follows; what it carries and the tool that it uses travel along.
        holds
            Says of a fact whether it holds. It is asked only for those that the answer rests on:
            in every state that agrees about them, the travel is the same. Of a state,
            ``state.__contains__`` does.

        Returns
        -------
        Travel
            With the path that `swept` checked, the same for whoever asks; or why none was found.
        """
        ends = (np.asarray(start_rad, dtype=float), np.asarray(goal_rad, dtype=float))
        spares = frozenset() if motion.carries is None else frozenset({motion.carries})
        return self._search.find(motion, lambda: self._bodies(motion, ends[1]), ends, spares, holds)

    def _bodies(self, motion: LinearMotion, goal_rad: Vector) -> ArmBodies:
        """Return what moves: what is held is fixed to the last joint as it is at the goal."""
        model = self.arm.model
        data = model.createData()
        pin.forwardKinematics(model, data, goal_rad)
        last = model.njoints - 1
        back = data.oMi[last].inverse()
        solids: list[MovingSolid] = [*self._links]
        for name, pieces in self.sweeps.held(motion, motion.above):
            solids += [held_solid(name, last, piece, back) for piece in pieces]
        return ArmBodies(model, solids, self.arm.home_rad)


def joint_space(model: Any, low_rad: Vector, high_rad: Vector) -> JointSpace:
    """Return the joints of an arm with how far each moves anything at most.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`, with a frame `tip`.
    low_rad, high_rad
        Limits of the joints, shape (joints,).
    """
    tip = model.frames[model.getFrameId("tip")].placement.translation
    links = [*(placement.translation for placement in list(model.jointPlacements)[2:]), tip]
    lengths_m = [length(link) for link in links]
    reach_m = np.cumsum(lengths_m[::-1])[::-1]
    # What is about the last joint's own axis is moved by it, too.
    return JointSpace(low_rad, high_rad, np.maximum(reach_m, 0.1))


# A travel is sampled at the ends of so many intervals.
_INTERVALS: Final = 8
_SAG: Final = 1.5 / (8 * _INTERVALS**2)


class TravelHeights:
    """Lowest heights of straight travels.

    Parameters
    ----------
    arm
        The arm.
    width_m
        How far hand and load reach from the axis of the hand, at most [m].
    """

    def __init__(self, arm: ArmModel, width_m: float) -> None:
        self.arm = arm
        self.width_m = width_m
        self._known: dict[tuple[bytes, bytes], tuple[float, float]] = {}
        model = arm.model
        placements = list(model.jointPlacements)[1:]
        tip = model.frames[model.getFrameId("tip")].placement
        self._fixed = [(placement.rotation, placement.translation) for placement in placements]
        self._tip = (tip.rotation, tip.translation)
        self._axes = [np.array(joint.axis) for joint in arm.description.joints]
        _, centres, halves = arm.boxes
        joints, reach_m = arm.boxes[0], np.linalg.norm(np.abs(centres) + halves, axis=1)
        spans_m = [float(np.linalg.norm(one.translation)) for one in placements]
        # From the first joint's axis, which does not move, to any point of each link.
        self._lengths_m = np.cumsum([0.0, *spans_m[1:]])
        self._tip_length_m = float(self._lengths_m[-1] + np.linalg.norm(tip.translation))
        for number in range(len(placements)):
            self._lengths_m[number] += float(reach_m[joints == number].max(initial=0.0))
        # Turning about the vertical, or about the hand's own axis, changes no height of its tip.
        self._tilting = np.ones(len(placements))
        self._tilting_tip = np.ones(len(placements))
        if abs(float((placements[0].rotation @ self._axes[0])[2])) > 1 - 1e-12:
            self._tilting[0] = self._tilting_tip[0] = 0.0
        last = self._axes[-1]
        along = np.cross(last, np.column_stack([tip.rotation[:, 2], tip.translation]), axisb=0)
        if float(np.abs(along).max()) < 1e-12:
            self._tilting_tip[-1] = 0.0

    def lowest_m(self, one_rad: Vector, other_rad: Vector, safe_height_m: float) -> float:
        """Return below which height nothing of arm, hand and load is on a straight travel [m].

        Parameters
        ----------
        one_rad, other_rad
            Its ends, shape (joints,). Hand and load are at safe height there at least.
        safe_height_m
            That height [m].
        """
        key = _key(one_rad, other_rad)
        if key not in self._known:
            self.prepare([one_rad, other_rad])
        dip_m, links_m = self._known[key]
        return min(safe_height_m - dip_m, links_m)

    def prepare(self, postures_rad: Iterable[Vector]) -> None:
        """Work out all travels between some postures, each of shape (joints,)."""
        distinct = {posture.tobytes(): posture for posture in postures_rad}
        pairs = [
            (one, other)
            for one, other in combinations(distinct.values(), 2)
            if _key(one, other) not in self._known
        ]
        for posture in distinct.values():
            self._known[_key(posture, posture)] = (0.0, math.inf)
        if not pairs:
            return
        begin = np.array([one for one, _ in pairs])[:, np.newaxis]
        turn = np.array([other for _, other in pairs])[:, np.newaxis] - begin
        shares = np.linspace(0.0, 1.0, _INTERVALS + 1)[:, np.newaxis]
        tips_m, axes, links_m = self._heights(begin + shares * turn)
        # A vector fixed to a link turns about axes that turn themselves: its second derivative is
        # at most 1.5 times its length times the square of the sum of all rates.
        turned = np.abs(turn[:, 0])
        sag = _SAG * (turned * self._tilting_tip).sum(axis=1) ** 2
        lower_end_m = np.minimum(tips_m[:, 0], tips_m[:, -1])
        dips_m = lower_end_m - tips_m.min(axis=1) + sag * self._tip_length_m
        # The hand's axis points down by so much at least; what is beside it sinks as it tilts.
        down = np.clip(-axes.max(axis=1) - sag, -1.0, 1.0)
        tilted = np.where(down > 0.5, np.sqrt(1 - down**2), np.inf)
        dips_m = np.maximum(dips_m, 0.0) + self.width_m * tilted
        links_sag_m = _SAG * np.cumsum(turned * self._tilting, axis=1) ** 2 * self._lengths_m
        lows_m = (links_m.min(axis=1) - links_sag_m).min(axis=1)
        for (one, other), dip_m, low_m in zip(pairs, dips_m, lows_m, strict=True):
            self._known[_key(one, other)] = (float(dip_m), float(low_m))

    def _heights(self, joints_rad: Vector) -> tuple[Vector, Vector, Vector]:
        """Return heights of the tip [m], how far the hand points up, and heights of links [m]."""
        rotation = np.broadcast_to(np.eye(3), (*joints_rad.shape[:-1], 3, 3))
        origin = np.zeros((*joints_rad.shape[:-1], 3))
        joints, centres, halves = self.arm.boxes
        links_m = np.full(joints_rad.shape, np.inf)
        for number, (turned, moved) in enumerate(self._fixed):
            origin = origin + rotation @ moved
            rotation = rotation @ turned @ _turns(self._axes[number], joints_rad[..., number])
            for piece in np.flatnonzero(joints == number).tolist():
                row = rotation[..., 2, :]
                middle_m = origin[..., 2] + row @ centres[piece]
                low_m = middle_m - np.abs(row) @ halves[piece]
                links_m[..., number] = np.minimum(links_m[..., number], low_m)
        tip_m = origin[..., 2] + rotation[..., 2, :] @ self._tip[1]
        return tip_m, rotation[..., 2, :] @ self._tip[0][:, 2], links_m


def _key(one: Vector, other: Vector) -> tuple[bytes, bytes]:
    a, b = one.tobytes(), other.tobytes()
    return (a, b) if a <= b else (b, a)


def _turns(axis: Vector, angles_rad: Vector) -> Vector:
    """Return rotations about an axis, shape (..., 3, 3), by Rodrigues' formula."""
    cross = pin.skew(axis)
    sines, cosines = np.sin(angles_rad), np.cos(angles_rad)
    turned = sines[..., np.newaxis, np.newaxis] * cross
    return np.asarray(
        np.eye(3) + turned + (1 - cosines)[..., np.newaxis, np.newaxis] * (cross @ cross)
    )
