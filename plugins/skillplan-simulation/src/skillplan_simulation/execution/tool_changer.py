"""Which tool is at the end of the arm: coupled from its dock, returned to it, or there already.

A dock is a place and no body: a tool exists while it is attached, and hangs untouchable in its
dock otherwise. A gripper is the hand of the robot itself, each with jaws of its own; with another
tool, or none, the hand is out of collision and out of sight.
"""

from __future__ import annotations

import numpy as np

from skillplan.task.motion import Point
from skillplan.task.scene import Pose, Scene, Tool, ToolKind
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_simulation.arm.hand_shapes import hand_of, tool_body
from skillplan_simulation.arm.rotations import pose_of
from skillplan_simulation.simulator import ROBOT, Arm, World

# Couplings that are farther apart do not engage [m].
_MISALIGNED_M = 0.002
# A tool's z is against the hand's.
_BACKWARDS = np.array([1.0, 1.0, -1.0])


class ToolChanger:
    """The tools of an arm.

    Parameters
    ----------
    world, arm
        Where, and whose.
    scene
        What tools there are.
    tool
        The one attached at the start, or None.
    """

    def __init__(self, world: World, arm: Arm, scene: Scene, tool: Tool | None) -> None:
        self.world, self.arm, self.scene = world, arm, scene
        self.tool = tool
        # What the arm has to carry of it beside the hand [kg].
        self.load_kg = 0.0
        self._bond: int | None = None
        self._docked: dict[str, int] = {}
        self.arm.show_hand(self.has_jaws)
        if tool is not None:
            self._attach(tool)

    @property
    def has_jaws(self) -> bool:
        """Whether the gripper is attached."""
        return self.tool is not None and self.tool.kind is ToolKind.GRIPPER

    @property
    def robot_parts(self) -> list[str]:
        """Names of the bodies that make up the robot, the tool included."""
        names = [ROBOT]
        if self.tool is not None and self.tool.name in self.world.numbers:
            names.append(self.tool.name)
        return names

    def tool_pose(self) -> Pose:
        """Return the pose of a body whose origin is the tip and whose z leads back to the flange.

        It stands upright where the hand points down; its x is along the closing axis.
        """
        tip = self.arm.tip()
        return pose_of(tip.position, tip.rotation[:, [1, 0, 2]] * _BACKWARDS)

    def detach(self) -> None:
        """Leave the tool in its dock."""
        assert self.tool is not None
        if self._bond is not None:
            self.world.release(self._bond)
            self._bond = None
            self.world.withdraw(self.tool.name, [-1])
            self._docked[self.tool.name] = self.world.hold(self.tool.name)
        self.load_kg = 0.0
        self.tool = None
        self.arm.show_hand(False)

    def couple(self, name: str, dock: Point) -> float:
        """Take a tool from its dock; return how far off the coupling is [m].

        Nothing is attached where it is too far off.
        """
        apart_m = length(self.arm.tip().position - np.array(dock))
        if apart_m <= _MISALIGNED_M:
            tools = [item for robot in self.scene.robots for item in robot.tools]
            self.tool = next(item for item in tools if item.name == name)
            self.arm.fit(hand_of(self.arm.robot, self.tool))
            self.arm.show_hand(self.has_jaws)
            self._attach(self.tool)
        return apart_m

    def _attach(self, tool: Tool) -> None:
        body = tool_body(tool, self.arm.hand)
        if body is None:
            return
        if tool.name in self._docked:
            self.world.release(self._docked.pop(tool.name))
            self.world.withdraw(tool.name, [])
        else:
            self.world.add(body, self.tool_pose())
        self.world.part(tool.name, [ROBOT])
        self._bond = self.arm.grip(tool.name)
        self.load_kg = body.mass_kg
