"""Joint torques that hold an arm, its tool and its load against gravity, compared with limits.

Torques are static: the time scaling accounts for acceleration. The tool counts as a point halfway
between flange and tip, a load at its centre of mass.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.pose import Pose
from skillplan.task.scene import Body, Robot, Scene
from skillplan_pinocchio.arm_model import ArmModel, Vector
from skillplan_pinocchio.inverse_kinematics import Strokes
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.kinematics.serial_arm import compute_strokes_m
from skillplan_pinocchio.mass_properties import compute_mass_properties

_GRAVITY_M_PER_S2 = 9.80665
# Minimum number of postures checked along a path; torques change slowly along it.
_PLACES = 9

Load = tuple[float, Vector]
"""A mass [kg] and where it is in the frame of the tip [m], shape (3,)."""


@dataclass(frozen=True)
class Overload:
    """A joint whose gravity torque exceeds its limit.

    Parameters
    ----------
    torque_nm, limit_nm
        Torque that holds the arm still, and the joint's limit [Nm].
    carried
        Name of the carried body or tool.
    is_force
        True for a prismatic joint, whose figures are forces [N].
    """

    joint: str
    torque_nm: float
    limit_nm: float
    carried: str
    is_force: bool = False

    @property
    def reason(self) -> str:
        """The reason as one clause."""
        unit = "N" if self.is_force else "Nm"
        return (
            f"{self.joint} would bear {self.torque_nm:.1f} {unit} of gravity with {self.carried}, "
            f"and its limit is {self.limit_nm:g} {unit}"
        )

    def evidence(self, during: str) -> Mapping[str, Any]:
        """Return the figures as JSON values."""
        return {
            "joint": self.joint,
            "torque_nm": round(self.torque_nm, 6),
            "limit_nm": self.limit_nm,
            "bodies": [],
            "during": during,
        }


class GravityCheck:
    """Compares gravity torques in a motion's postures with the joint limits.

    Parameters
    ----------
    arm
        Arm with the masses of its links.
    robot
        Robot of the scene with its tools.
    """

    def __init__(self, arm: ArmModel, scene: Scene, robot: Robot) -> None:
        self.arm = arm
        self.scene = scene
        self.robot = robot
        self.limits_nm = np.array(arm.description.torque_nm)
        model = arm.model
        self._levers = np.array([inertia.lever for inertia in model.inertias[1:]])
        self._masses_kg = np.array([inertia.mass for inertia in model.inertias[1:]])
        self._axes = np.array([joint.axis for joint in arm.description.joints])
        self._slides = np.array([joint.is_prismatic for joint in arm.description.joints])
        self._strokes_m = compute_strokes_m(arm.description)
        self._tip = model.frames[model.getFrameId("tip")].placement
        self._centres: dict[str, Vector] = {}

    def on_strokes(self, motion: LinearMotion, strokes: Strokes) -> Overload | None:
        """Return the first overloaded joint on the way to a target or back, or None."""
        ways = [(motion.carries, strokes.down)]
        # The same path back with a lighter hand needs no second check.
        if not strokes.mirrored or motion.leaves_with not in (None, motion.carries):
            ways.append((motion.leaves_with, strokes.up))
        for carried, paths in ways:
            for path in paths:
                overload = self._on(motion, carried, path)
                if overload is not None:
                    return overload
        return self._on_press(motion, strokes) if motion.visit.press_n else None

    def _on_press(self, motion: LinearMotion, strokes: Strokes) -> Overload | None:
        """Return the joint that the force of a press overloads at its target, or None.

        The part pushes back at the tip of the tool; the hand points down.
        """
        at_tip = (0.0, 0.0, 0.0) if motion.tool is None else motion.tool.tip_on_arm.position
        back_kg = -motion.visit.press_n / _GRAVITY_M_PER_S2
        loads = [*self._loads(motion, None), (back_kg, np.array(at_tip))]
        torques_nm = np.abs(self.torques_nm([strokes.down[-1].nodes[-1]], loads))[0]
        index = int(np.argmax(torques_nm / self.limits_nm))
        if torques_nm[index] <= self.limits_nm[index]:
            return None
        joint = self.arm.description.joints[index]
        pressed = f"a press with {motion.visit.press_n:g} N"
        return Overload(
            joint.name,
            float(torques_nm[index]),
            float(self.limits_nm[index]),
            pressed,
            joint.is_prismatic,
        )

    def on_travel(self, motion: LinearMotion, path: JointPath) -> Overload | None:
        """Return the overloaded joint on the travel to a motion, or None."""
        return self._on(motion, motion.carries, path)

    def is_safe(self, motion: LinearMotion, carried: str | None) -> bool:
        """Return whether a bound on the torques, for the arm stretched out, respects the limits."""
        loads = [*self._loads(motion, carried)]
        hand_m = [float(np.linalg.norm(self._tip.act(where))) for _, where in loads]
        loaded_kg_m = sum(kg * far_m for (kg, _), far_m in zip(loads, hand_m, strict=True))
        loaded_kg = sum(kg for kg, _ in loads)
        moments = loaded_kg * self._beyond_m + loaded_kg_m
        bears = np.where(self._slides, loaded_kg, moments)
        bound_nm = self.most_nm + _GRAVITY_M_PER_S2 * bears
        return bool((bound_nm <= self.limits_nm).all())

    @cached_property
    def _beyond_m(self) -> Vector:
        """Greatest distance from each joint to the last one [m], shape (joints,)."""
        placements = self.arm.model.jointPlacements
        lengths_m = [
            float(np.linalg.norm(placement.translation)) + stroke_m
            for placement, stroke_m in zip(placements[1:], self._strokes_m, strict=True)
        ]
        return np.array([sum(lengths_m[index + 1 :]) for index in range(len(lengths_m))])

    @cached_property
    def most_nm(self) -> Vector:
        """Bound on the torques of the links alone in any posture [Nm], shape (joints,)."""
        far_m = self._beyond_m
        own_m = np.linalg.norm(self._levers, axis=1)
        moments = [
            float((self._masses_kg[index:] * (far_m[index] - far_m[index:] + own_m[index:])).sum())
            for index in range(len(far_m))
        ]
        weights = [float(self._masses_kg[index:].sum()) for index in range(len(far_m))]
        return _GRAVITY_M_PER_S2 * np.where(self._slides, weights, moments)

    def _on(self, motion: LinearMotion, carried: str | None, path: JointPath) -> Overload | None:
        if self.is_safe(motion, carried):
            return None
        places = np.linspace(0.0, 1.0, max(_PLACES, len(path.nodes))).tolist()
        postures = [path.at(place) for place in places]
        torques_nm = np.abs(self.torques_nm(postures, [*self._loads(motion, carried)]))
        worst_nm = torques_nm.max(axis=0)
        over = np.flatnonzero(worst_nm > self.limits_nm)
        if not over.size:
            return None
        index = int(over[np.argmax(worst_nm[over] / self.limits_nm[over])])
        tool = "nothing attached" if motion.tool is None else motion.tool.name
        return Overload(
            self.arm.description.joints[index].name,
            float(worst_nm[index]),
            float(self.limits_nm[index]),
            carried or tool,
            self.arm.description.joints[index].is_prismatic,
        )

    def torques_nm(self, postures_rad: Sequence[Vector], loads: Sequence[Load]) -> Vector:
        """Return the torques that hold the arm still [Nm], shape (postures, joints).

        Parameters
        ----------
        postures_rad
            Joint angles [rad], each of shape (joints,).
        """
        rotations, origins = self.arm.frames(postures_rad)
        centres = np.einsum("njab,jb->nja", rotations, self._levers) + origins
        at_tip = np.array([self._tip.act(where) for _, where in loads]).reshape(-1, 3)
        loaded = np.einsum("nab,lb->nla", rotations[:, -1], at_tip) + origins[:, -1:]
        points = np.concatenate([centres, loaded], axis=1)
        forces_n = _GRAVITY_M_PER_S2 * np.array([*self._masses_kg, *(kg for kg, _ in loads)])
        axes = np.einsum("njab,jb->nja", rotations, self._axes)
        arms = points[:, np.newaxis] - origins[:, :, np.newaxis]
        # Moment about each axis of an upward unit force at each point.
        moments = (
            axes[:, :, np.newaxis, 0] * arms[..., 1] - axes[:, :, np.newaxis, 1] * arms[..., 0]
        )
        # A prismatic joint bears the part of the force along its axis.
        moments = np.where(self._slides[:, np.newaxis], axes[:, :, np.newaxis, 2], moments)
        joints, count = len(self._masses_kg), len(forces_n)
        bears = np.arange(count)[np.newaxis] >= np.arange(joints)[:, np.newaxis]
        return np.asarray((moments * bears * forces_n).sum(axis=2))

    def _loads(self, motion: LinearMotion, carried: str | None) -> Iterator[Load]:
        """Yield the loads at the tip: tool and carried body."""
        for tool in (motion.tool, *self.robot.list_companions(motion.tool)):
            tool_kg = self.robot.tool_kg(tool)
            if tool_kg:
                x_m, y_m, z_m = (0.0, 0.0, 0.0) if tool is None else tool.tip_on_arm.position
                # Halfway between flange and tip.
                yield tool_kg, np.array([x_m / 2, y_m / 2, (z_m - self.arm.hand.tip_m) / 2])
        if carried is not None:
            body = self.scene.body(carried)
            yield body.mass_kg, self._centre(motion, body)

    def _centre(self, motion: LinearMotion, body: Body) -> Vector:
        """Return the centre of mass of a body in the hand, in the frame of the tip [m]."""
        if body.name != motion.visit.subject:
            return np.array(
                (0.0, 0.0, 0.0) if motion.tool is None else motion.tool.tip_on_arm.position
            )
        if body.name not in self._centres:
            self._centres[body.name] = compute_mass_properties(body).centre
        centre = self._centres[body.name]
        in_world = np.array(motion.visit.pose.rotation) @ centre + motion.visit.pose.position
        tip = Pose(motion.tip, motion.orientation)
        return np.asarray(np.array(tip.rotation).T @ (in_world - np.array(motion.tip)))
