"""The engine: a skill is feasible if a simulated arm executes it and senses what was promised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from skillplan.robots.arm_description import ArmDescription
from skillplan_pybullet.arm.looks import looks_of
from skillplan_pybullet.pybullet_simulator import PybulletSimulator
from skillplan_pybullet.simulation_settings import SimulationSettings
from skillplan_simulation.execution.workcell import Workcell
from skillplan_simulation.performing.performing_engine import PerformingEngine
from skillplan_simulation.simulating_engine import SimulatingEngine, versions


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
