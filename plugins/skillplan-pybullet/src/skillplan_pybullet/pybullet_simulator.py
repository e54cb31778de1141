"""Worlds of pybullet, and the task's arm in them."""

from __future__ import annotations

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Robot
from skillplan_pybullet.arm.simulated_arm import SimulatedArm
from skillplan_pybullet.simulation_settings import SimulationSettings
from skillplan_pybullet.simulator.world import World


class PybulletSimulator:
    """Makes a world anew every time; see `skillplan_simulation.simulator`.

    Parameters
    ----------
    robot
        The task's.
    settings
        How it moves.
    """

    def __init__(self, robot: Robot, settings: SimulationSettings) -> None:
        self.robot, self.settings = robot, settings

    def world(self) -> World:
        """Return a world with a table and nothing else."""
        return World(self.settings.friction)

    def cell(self, hand: Hand) -> tuple[World, SimulatedArm]:
        """Return a world with a table and the task's arm, and the arm."""
        world = self.world()
        return world, SimulatedArm(world, self.robot, self.settings, hand)
