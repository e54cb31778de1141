"""Worlds of MuJoCo: one model for a task, of which every world is a fresh start."""

from __future__ import annotations

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Body
from skillplan.task.task import Task
from skillplan_mujoco.arm.simulated_arm import SimulatedArm
from skillplan_mujoco.simulator.cell import Cell
from skillplan_mujoco.simulator.cell_model import cell_spec
from skillplan_mujoco.simulator.world import World
from skillplan_simulation.arm.hand_shapes import hands_of, tool_body
from skillplan_simulation.execution_settings import ExecutionSettings


class MujocoSimulator:
    """Compiles the model of a task once; see `skillplan_simulation.simulator`.

    Parameters
    ----------
    task
        With one robot.
    settings
        How it moves.
    """

    def __init__(self, task: Task, settings: ExecutionSettings) -> None:
        self.task, self.settings = task, settings
        self.robot = task.scene.robots[0]
        self._cell: Cell | None = None

    def world(self) -> World:
        """Return a world with a table and nothing else; worlds before it are none any more."""
        if self._cell is None:
            hands = hands_of(self.robot)
            spec = cell_spec(self.robot, hands, self._bodies(hands[0]), self.settings.friction)
            self._cell = Cell(spec.compile(), hands, self.settings.friction)
        return World(self._cell)

    def cell(self, hand: Hand) -> tuple[World, SimulatedArm]:
        """Return a world with a table and the task's arm, and the arm."""
        world = self.world()
        world.show_arm()
        return world, SimulatedArm(world, self.robot, self.settings, hand)

    def _bodies(self, hand: Hand) -> list[Body]:
        """Return all that can ever be in a world beside arm and table."""
        tools = (tool_body(tool, hand) for tool in self.robot.tools)
        return [*self.task.scene.bodies, *(body for body in tools if body is not None)]
