"""The engine `pybullet`: execute a skill with a simulated arm and check its postcondition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from skillplan.robots.arm_description import ArmDescription, Hand
from skillplan.task.scene import Robot
from skillplan_pybullet.simulated_arm import SimulatedArm, SimulationSettings
from skillplan_pybullet.world import World
from skillplan_simulation.execution.workcell import Workcell
from skillplan_simulation.simulating_engine import PerformingEngine, SimulatingEngine, get_versions


class PybulletSimulator:
    """Creates a new world for every execution; see `skillplan_simulation.simulator`."""

    def __init__(self, robot: Robot, settings: SimulationSettings) -> None:
        self.robot, self.settings = robot, settings

    def world(self) -> World:
        """Return a world with only a table."""
        return World(self.settings.friction)

    def cell(self, hand: Hand) -> tuple[World, SimulatedArm]:
        """Return a world with a table and the task's arm, and the arm."""
        world = self.world()
        return world, SimulatedArm(world, self.robot, self.settings, hand)


# Package with meshes of base and links, by name of the arm.
_MESHES = {
    "Franka Emika Panda": (
        "pybullet_data",
        tuple(f"franka_panda/meshes/visual/link{number}.obj" for number in range(8)),
    )
}


def find_meshes(description: ArmDescription) -> tuple[Path | None, ...]:
    """Return meshes of base and links in their frames; None for links drawn by their shapes."""
    none = (None,) * (len(description.joints) + 1)
    if description.name not in _MESHES:
        return none
    package, files = _MESHES[description.name]
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        return none
    paths = [Path(spec.origin).parent / name for name in files]
    return tuple(path if path.is_file() else None for path in paths)


class PybulletEngine(PerformingEngine):
    """Execute the skill with an arm in pybullet and sense its postcondition.

    The arm is built from its description: published kinematics, limits and masses. Every check has
    its own world with the bodies near the motion and their supports; the verdict rests on the facts
    that put them there. Postconditions are where parts come to rest, which part is in the hand,
    which tool is attached, and the force that drives a screw. Detectors read collisions from the
    same execution.
    """

    name = "pybullet"
    version = "17"
    expected_s = 0.6
    contact_detectors = ("contact-pairs", "contact-force")
    stands_exact = True

    class Options(SimulatingEngine.Options, SimulationSettings):
        """Options of motion, and tolerances of postconditions."""

    options: Options

    def make_workcell(self) -> Workcell:
        """Return a workcell that creates a new world for every execution."""
        settings = SimulationSettings.model_validate(
            self.options.model_dump(include=set(SimulationSettings.model_fields))
        )
        return Workcell(self.task, settings, PybulletSimulator(self.task.scene.robots[0], settings))

    @property
    def basis(self) -> Mapping[str, str]:
        """Versions of the distributions that decide a simulation, except this plugin."""
        others = [
            "numpy",
            "pin",
            "pybullet",
            "skillplan",
            "skillplan-pinocchio",
            "skillplan-simulation",
        ]
        return get_versions(*others)

    @classmethod
    def looks(cls, arm: ArmDescription) -> Sequence[Path | None]:
        """Return installed meshes of the arm, if any; see `Performer`."""
        return find_meshes(arm)
