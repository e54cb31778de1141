import pybullet as pybullet

from .contact_force import ContactForceDetector as ContactForceDetector
from .control import PinocchioDynamics as PinocchioDynamics
from .engine import PybulletEngine as PybulletEngine
from .engine import PybulletSimulator as PybulletSimulator
from .robot_file import JAW_LINKS as JAW_LINKS
from .simulated_arm import SimulatedArm as SimulatedArm
from .simulated_arm import SimulationSettings as SimulationSettings
from .world import World as World

__all__ = [
    "JAW_LINKS",
    "ContactForceDetector",
    "PinocchioDynamics",
    "PybulletEngine",
    "PybulletSimulator",
    "SimulatedArm",
    "SimulationSettings",
    "World",
]
