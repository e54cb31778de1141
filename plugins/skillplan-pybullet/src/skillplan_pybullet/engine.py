"""The engine: a skill is feasible if a simulated arm executes it and senses what was promised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from skillplan.robots.arm_description import ArmDescription, Hand
from skillplan.task.scene import Robot
from skillplan_pybullet.simulated_arm import SimulatedArm, SimulationSettings
from skillplan_pybullet.world import World
from skillplan_simulation.execution.workcell import Workcell
from skillplan_simulation.simulating_engine import PerformingEngine, SimulatingEngine, versions


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


# Of an arm by name: a package, and the meshes of base and links in it.
_MESHES = {
    "Franka Emika Panda": (
        "pybullet_data",
        tuple(f"franka_panda/meshes/visual/link{number}.obj" for number in range(8)),
    )
}


def looks_of(description: ArmDescription) -> tuple[Path | None, ...]:
    """Return meshes of base and links in their frames; None for what is drawn by its shapes."""
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

    The arm is the task's, built from its description: published kinematics, limits and masses.
    Every check has a world of its own, with the bodies near the motion and their supports; the
    verdict rests on the facts that put them there. It is about sensed postconditions: where
    parts come to rest, what is in the hand, which tool is attached, the force a screw is
    driven with. Collisions are for the detectors that read the same execution.
    """

    name = "pybullet"
    version = "11"
    expected_s = 0.6
    contact_detectors = ("contact-pairs", "contact-force")
    stands_exact = True

    class Options(SimulatingEngine.Options, SimulationSettings):
        """Options of motion and of what counts as done."""

    options: Options

    def make_workcell(self) -> Workcell:
        """Return one whose every world is made anew."""
        settings = SimulationSettings.model_validate(
            self.options.model_dump(include=set(SimulationSettings.model_fields))
        )
        return Workcell(self.task, settings, PybulletSimulator(self.task.scene.robots[0], settings))

    @property
    def basis(self) -> Mapping[str, str]:
        """The versions of what decides a simulation beside this plugin."""
        others = [
            "numpy",
            "pin",
            "pybullet",
            "skillplan",
            "skillplan-pinocchio",
            "skillplan-simulation",
        ]
        return versions(*others)

    @classmethod
    def looks(cls, arm: ArmDescription) -> Sequence[Path | None]:
        """Return the meshes of an installed package, if it has the arm; see `Performer`."""
        return looks_of(arm)
