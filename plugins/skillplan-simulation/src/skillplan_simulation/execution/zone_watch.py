"""Watch over the keep-out zones of a scene during an execution."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from skillplan.task.scene import Robot, Scene
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.hand_sweeps import build_hand_parts
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.arm_bodies import (
    ArmBodies,
    MovingSolid,
    build_arm_solids,
    build_held_solid,
)
from skillplan_pinocchio.planning.continuous_check import ContinuousCheck
from skillplan_pinocchio.shapes import (
    ConvexPiece,
    make_pieces,
    make_shank_pieces,
    make_zone_obstacle,
    place_at,
)

if TYPE_CHECKING:
    from skillplan_simulation.execution.controlled_robot import ControlledRobot

# Decimals to which an opening of the jaws is rounded [m].
_OPENING_DECIMALS = 3


class ZoneWatch:
    """Checks the arm, its tool and its load against keep-out zones.

    Zones are no bodies of the world. Shapes are the same as in ``swept``, in the
    measured postures. Between two looks the joints are taken to move straight, without gaps.

    Parameters
    ----------
    scene
        Scene with a keep-out zone.
    """

    def __init__(self, scene: Scene, robot: Robot) -> None:
        self.scene, self.robot = scene, robot
        self._arm = ArmModel.of(robot)
        self._data = self._arm.model.createData()
        self._links = build_arm_solids(self._arm)
        self._zones = [make_zone_obstacle(zone) for zone in scene.zones if zone.keeps_out]
        self._checks: dict[tuple[str | None, float, str | None], ContinuousCheck] = {}
        self._carried: str | None = None
        self._before_rad: np.ndarray | None = None

    @classmethod
    def of(cls, scene: Scene, robot: Robot) -> ZoneWatch | None:
        """Return the watch of a scene, or None if nothing is kept out of it."""
        return cls(scene, robot) if any(zone.keeps_out for zone in scene.zones) else None

    def look(self, robot: ControlledRobot) -> str | None:
        """Return a clause on the first solid in a zone since the last look, or None."""
        now_rad = np.array(robot.arm.joints_rad())
        before_rad = now_rad if self._before_rad is None else self._before_rad
        self._before_rad = now_rad
        hits = self._check(robot, now_rad).hits(JointPath([before_rad, now_rad]))
        return f"{hits[0].mover} enters {hits[0].body}" if hits else None

    def _check(self, robot: ControlledRobot, now_rad: np.ndarray) -> ContinuousCheck:
        """Return the check of the links with what they hold now."""
        if robot.carried != self._carried:
            # The same part may lie differently in the hand from now on.
            self._checks = {key: known for key, known in self._checks.items() if key[2] is None}
            self._carried = robot.carried
        tool = robot.tools.tool
        opening_m = 0.0
        if robot.tools.has_jaws:
            opening_m = max(0.0, round(robot.arm.jaw_width_m(), _OPENING_DECIMALS))
        key = (None if tool is None else tool.name, opening_m, robot.carried)
        if key not in self._checks:
            pin.forwardKinematics(self._arm.model, self._data, now_rad)
            back = self._data.oMi[self._arm.joints].inverse()
            held = self._hold(robot, opening_m, back)
            bodies = ArmBodies(
                self._arm.model, [*self._links, *held], self._arm.home_rad, checks_itself=False
            )
            self._checks[key] = ContinuousCheck(bodies, self._zones)
        return self._checks[key]

    def _hold(self, robot: ControlledRobot, opening_m: float, back: Any) -> Iterator[MovingSolid]:
        """Yield hand, tool and load as solids of the last joint."""
        last = self._arm.joints
        pose = robot.tools.hand_pose()
        for part in build_hand_parts(self.robot, robot.tools.tool, opening_m):
            for corners in part.corners:
                yield build_held_solid(part.name, last, ConvexPiece(place_at(corners, pose)), back)
        if robot.carried is not None:
            measured = robot.world.pose(robot.carried)
            body = self.scene.body(robot.carried)
            pieces = (*make_pieces(body, measured), *make_shank_pieces(body, measured))
            for piece in pieces:
                yield build_held_solid(robot.carried, last, piece, back, is_load=True)
