"""What is to be seen of a simulated cell at one moment: surfaces, where and whose they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand
from skillplan.task.pose import Pose
from skillplan.task.scene import Robot, Scene
from skillplan_simulation.arm.hand_shapes import tool_body
from skillplan_simulation.pictures.surfaces import (
    Surface,
    body_surface,
    finger_surface,
    hand_surface,
    link_surface,
)
from skillplan_simulation.simulator import FINGERS, HAND, ROBOT, Arm, World

Frame = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Part:
    """A surface where it is.

    Parameters
    ----------
    name
        Whose it is: a body or tool, or the arm, its hand or a finger.
    surface
        In its frame.
    frame
        In the world, shape (3, 4).
    """

    name: str
    surface: Surface
    frame: Frame

    @property
    def middle(self) -> NDArray[np.float64]:
        """The middle of its box, in the world [m]."""
        return np.asarray(self.frame[:, :3] @ self.surface.middle + self.frame[:, 3])


class CellParts:
    """Makes the surfaces of a scene, each when it is first seen.

    Parameters
    ----------
    scene
        With one robot.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, self._robot = scene, scene.robots[0]
        self._made: dict[str, Surface] = {}
        self._hands: dict[Hand, tuple[Surface, ...]] = {}
        self._links: list[Surface] | None = None

    def of(self, world: World, arm: Arm) -> list[Part]:
        """Return all that is to be seen now."""
        return [*self._of_bodies(world, arm.hand), *self._of_arm(arm)]

    def _of_bodies(self, world: World, hand: Hand) -> Iterator[Part]:
        for name in world.bodies:
            yield Part(name, self._of_body(name, hand), _frame(world.pose(name)))
        for tool in self._robot.tools:
            # What has not been taken yet lies in its dock, and nothing can touch it there.
            body = tool_body(tool, hand)
            if body is not None and tool.name not in world.numbers:
                place = _frame(Pose(tool.holder))
                yield Part(tool.name, self._of_body(tool.name, hand), place)

    def _of_body(self, name: str, hand: Hand) -> Surface:
        if name not in self._made:
            bodies = {body.name: body for body in self._scene.bodies}
            tools = {tool.name: tool for tool in self._robot.tools}
            body = bodies.get(name) or tool_body(tools[name], hand)
            assert body is not None
            self._made[name] = body_surface(body.exact_shapes)
        return self._made[name]

    def _of_arm(self, arm: Arm) -> Iterator[Part]:
        if self._links is None:
            self._links = [link_surface(shapes) for shapes in self._robot.model.shapes]
        joints_rad = np.array(arm.joints_rad())
        frames = [
            np.hstack([one.rotation, one.translation[:, None]])
            for one in arm.kinematics.frames(joints_rad)
        ]
        for surface, frame in zip(self._links, [_base(self._robot), *frames], strict=False):
            yield Part(ROBOT, surface, frame)
        if not arm.shows_hand:
            return
        if arm.hand not in self._hands:
            jaws = (finger_surface(arm.hand, side) for side in (1, -1))
            self._hands[arm.hand] = (hand_surface(arm.hand), *jaws)
        body, *fingers = self._hands[arm.hand]
        tip = frames[-1]
        yield Part(HAND, body, tip)
        for name, finger, side in zip(FINGERS, fingers, (1, -1), strict=True):
            moved = tip.copy()
            moved[:, 3] += side * arm.jaw_width_m() / 2 * tip[:, 1]
            yield Part(name, finger, moved)


def _base(robot: Robot) -> Frame:
    return _frame(robot.mount)


def _frame(pose: Pose) -> Frame:
    return np.hstack([np.array(pose.rotation), np.array(pose.position)[:, None]])
