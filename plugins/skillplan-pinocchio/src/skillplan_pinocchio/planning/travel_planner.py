"""Travels of a scene's robot in any state, and lower bounds on their heights."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.scene import Robot, Scene, name_shank
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_pinocchio.kinematics.serial_arm import compute_strokes_m
from skillplan_pinocchio.planning.arm_bodies import (
    ArmBodies,
    ArmFrames,
    MovingSolid,
    Vector,
    build_arm_solids,
    build_held_solid,
)
from skillplan_pinocchio.planning.travel import Holds, JointSpace, Travel, TravelSearch, Unfound
from skillplan_pinocchio.shapes import Obstacle, collect_obstacles

MOST_CHECKS: Final = 5_000


class TravelPlanner:
    """Finds travels of the arm, with its load, to where a motion begins.

    Parameters
    ----------
    sweeps
        Pieces at the end of the arm.
    most_checks
        Number of postures checked for one travel before it is given up, >= 1.
    check_arm
        True if the links of the arm are checked.
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
        self._links = build_arm_solids(arm) if check_arm else ()
        space = build_joint_space(arm.model, arm.low_rad, arm.high_rad)
        if arm.serial.coupling is not None:
            space = replace(space, arm=arm.description)
        self._search = TravelSearch(obstacles, space, most_checks)

    @classmethod
    def of(cls, scene: Scene, robot: Robot, clearance_m: float = 0.004) -> TravelPlanner:
        """Return the planner of a scene's robot.

        Parameters
        ----------
        clearance_m
            Clearance of open jaws on either side of a part [m], >= 0.
        """
        sweeps = HandSweeps(scene, robot, clearance_m)
        return cls(ArmModel.of(robot), sweeps, collect_obstacles(scene))

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Obstacles of all states."""
        return self._search.obstacles

    def travel(
        self, start_rad: Vector, goal_rad: Vector, motion: LinearMotion, holds: Holds
    ) -> Travel | Unfound:
        """Return the travel of the arm to where a motion begins.

        Parameters
        ----------
        start_rad
            Start posture, shape (joints,).
        goal_rad
            Posture with the tip at the motion's first point.
        motion
            Motion after the travel; its load and tool travel along.
        holds
            Returns whether a fact holds; called only for facts that the travel rests on.
            ``state.__contains__`` does for a state.

        Returns
        -------
        Travel or Unfound
            Path that `swept` checked, the same for every caller; or the reason why none was found.
        """
        ends = (np.asarray(start_rad, dtype=float), np.asarray(goal_rad, dtype=float))
        spares = frozenset() if motion.carries is None else frozenset({motion.carries})
        return self._search.find(motion, lambda: self._bodies(motion, ends[1]), ends, spares, holds)

    def _bodies(self, motion: LinearMotion, goal_rad: Vector) -> ArmBodies:
        """Return the moving solids; the load is fixed to the last joint as at the goal."""
        model = self.arm.model
        data = model.createData()
        pin.forwardKinematics(model, data, goal_rad)
        last = model.njoints - 1
        back = data.oMi[last].inverse()
        solids: list[MovingSolid] = [*self._links]
        for name, pieces in self.sweeps.held(motion, motion.above):
            load = motion.carries
            is_load = load is not None and name in (load, f"the {name_shank(load)}")
            solids += [
                build_held_solid(name, last, piece, back, is_load=is_load) for piece in pieces
            ]
        return ArmBodies(model, solids, self.arm.home_rad)


def build_joint_space(model: Any, low_rad: Vector, high_rad: Vector) -> JointSpace:
    """Return the joint space of an arm, weighted by the joints' reach.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`, with a frame `tip`.
    low_rad, high_rad
        Joint limits, shape (joints,).
    """
    frames = ArmFrames(model)
    tip = model.frames[model.getFrameId("tip")].placement.translation
    links = [*(placement.translation for placement in list(model.jointPlacements)[2:]), tip]
    strokes_m = (*frames.strokes_m[1:], 0.0)
    lengths_m = [length(link) + stroke_m for link, stroke_m in zip(links, strokes_m, strict=True)]
    reach_m = np.where(frames.slides, 1.0, np.cumsum(lengths_m[::-1])[::-1])
    # The last joint also moves what surrounds its own axis.
    return JointSpace(low_rad, high_rad, np.maximum(reach_m, 0.1))


# Number of intervals at whose ends a travel is sampled.
_INTERVALS: Final = 8
_SAG: Final = 1.5 / (8 * _INTERVALS**2)
_SLID: Final = 2 / (8 * _INTERVALS**2)


class TravelHeights:
    """Lower bounds on the heights of straight travels.

    Computed for all pairs of a task's postures at once.

    Parameters
    ----------
    width_m
        Maximum reach of hand and load from the axis of the hand [m].
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
        self._slides = np.array([joint.is_prismatic for joint in arm.description.joints])
        spans_m = [
            float(np.linalg.norm(placement.translation)) + float(stroke_m)
            for placement, stroke_m in zip(
                placements, compute_strokes_m(arm.description), strict=True
            )
        ]
        # From the first joint's axis, which does not move, to the farthest point of each link.
        self._lengths_m = np.cumsum([0.0, *spans_m[1:]])
        self._tip_length_m = float(self._lengths_m[-1] + np.linalg.norm(tip.translation))
        for number in range(len(placements)):
            self._lengths_m[number] += float(reach_m[joints == number].max(initial=0.0))
        # Turns about the vertical or about the hand's own axis do not change the tip's height;
        # strokes change it evenly.
        self._tilting = np.where(self._slides, 0.0, 1.0)
        self._tilting_tip = self._tilting.copy()
        if abs(float((placements[0].rotation @ self._axes[0])[2])) > 1 - 1e-12:
            self._tilting[0] = self._tilting_tip[0] = 0.0
        last = self._axes[-1]
        along = np.cross(last, np.column_stack([tip.rotation[:, 2], tip.translation]), axisb=0)
        if float(np.abs(along).max()) < 1e-12:
            self._tilting_tip[-1] = 0.0

    def lowest_m(self, begin_rad: Vector, end_rad: Vector, safe_height_m: float) -> float:
        """Return a lower bound on the height of arm, hand and load on a straight travel [m].

        Parameters
        ----------
        begin_rad, end_rad
            Ends of the travel, shape (joints,). Hand and load are at least at safe height there.
        safe_height_m
            Safe height [m].
        """
        key = _make_key(begin_rad, end_rad)
        if key not in self._known:
            self.prepare([begin_rad, end_rad])
        dip_m, links_m = self._known[key]
        return min(safe_height_m - dip_m, links_m)

    def prepare(self, postures_rad: Iterable[Vector]) -> None:
        """Compute all travels between some postures, each of shape (joints,)."""
        distinct = {posture.tobytes(): posture for posture in postures_rad}
        pairs = [
            (begin_rad, end_rad)
            for begin_rad, end_rad in combinations(distinct.values(), 2)
            if _make_key(begin_rad, end_rad) not in self._known
        ]
        for posture in distinct.values():
            self._known[_make_key(posture, posture)] = (0.0, math.inf)
        if not pairs:
            return
        begin = np.array([begin_rad for begin_rad, _ in pairs])[:, np.newaxis]
        turn = np.array([end_rad for _, end_rad in pairs])[:, np.newaxis] - begin
        shares = np.linspace(0.0, 1.0, _INTERVALS + 1)[:, np.newaxis]
        tips_m, axes, links_m = self._heights(begin + shares * turn)
        # The second derivative of a vector fixed to a link is at most 1.5 times its length times
        # the square of the sum of all rates; a prismatic joint adds twice its rate times that sum.
        turned = np.abs(turn[:, 0])
        rates = (turned * self._tilting_tip).sum(axis=1)
        slid_m = _SLID * np.abs(turn[:, 0, self._slides]).sum(axis=1)
        sag = _SAG * rates**2
        lower_end_m = np.minimum(tips_m[:, 0], tips_m[:, -1])
        dips_m = lower_end_m - tips_m.min(axis=1) + sag * self._tip_length_m + slid_m * rates
        # Bound on how far the hand tilts; points off its axis sink as it tilts.
        down = np.clip(-axes.max(axis=1) - sag, -1.0, 1.0)
        tilted = np.where(down > 0.5, np.sqrt(1 - down**2), np.inf)
        dips_m = np.maximum(dips_m, 0.0) + self.width_m * tilted
        rates = np.cumsum(turned * self._tilting, axis=1)
        links_sag_m = _SAG * rates**2 * self._lengths_m + slid_m[:, np.newaxis] * rates
        lows_m = (links_m.min(axis=1) - links_sag_m).min(axis=1)
        for (begin_rad, end_rad), dip_m, low_m in zip(pairs, dips_m, lows_m, strict=True):
            self._known[_make_key(begin_rad, end_rad)] = (float(dip_m), float(low_m))

    def _heights(self, joints_rad: Vector) -> tuple[Vector, Vector, Vector]:
        """Return tip heights [m], upward components of the hand's axis, and link heights [m]."""
        rotation = np.broadcast_to(np.eye(3), (*joints_rad.shape[:-1], 3, 3))
        origin = np.zeros((*joints_rad.shape[:-1], 3))
        joints, centres, halves = self.arm.boxes
        links_m = np.full(joints_rad.shape, np.inf)
        for number, (turned, moved) in enumerate(self._fixed):
            origin = origin + rotation @ moved
            rotation = rotation @ turned
            if self._slides[number]:
                strokes_m = joints_rad[..., number, np.newaxis] * self._axes[number]
                origin = origin + (rotation @ strokes_m[..., np.newaxis])[..., 0]
            else:
                rotation = rotation @ _compute_turns(self._axes[number], joints_rad[..., number])
            for piece in np.flatnonzero(joints == number).tolist():
                row = rotation[..., 2, :]
                middle_m = origin[..., 2] + row @ centres[piece]
                low_m = middle_m - np.abs(row) @ halves[piece]
                links_m[..., number] = np.minimum(links_m[..., number], low_m)
        tip_m = origin[..., 2] + rotation[..., 2, :] @ self._tip[1]
        return tip_m, rotation[..., 2, :] @ self._tip[0][:, 2], links_m


def _make_key(begin: Vector, end: Vector) -> tuple[bytes, bytes]:
    a, b = begin.tobytes(), end.tobytes()
    return (a, b) if a <= b else (b, a)


def _compute_turns(axis: Vector, angles_rad: Vector) -> Vector:
    """Return rotations about an axis, shape (..., 3, 3), by Rodrigues' formula."""
    cross = pin.skew(axis)
    sines, cosines = np.sin(angles_rad), np.cos(angles_rad)
    turned = sines[..., np.newaxis, np.newaxis] * cross
    return np.asarray(
        np.eye(3) + turned + (1 - cosines)[..., np.newaxis, np.newaxis] * (cross @ cross)
    )
