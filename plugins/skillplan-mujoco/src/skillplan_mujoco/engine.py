"""The engine: a skill is feasible if an arm in MuJoCo executes it and senses what was promised."""

from __future__ import annotations

from collections.abc import Mapping

from skillplan_mujoco.mujoco_simulator import MujocoSimulator
from skillplan_simulation.execution.workcell import Workcell
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.performing.performing_engine import PerformingEngine
from skillplan_simulation.simulating_engine import SimulatingEngine, versions


class MujocoEngine(PerformingEngine):
    """Execute the skill with an arm in MuJoCo and sense its postcondition.

    The arm is the task's, built from its description: published kinematics, limits and masses.
    One model is compiled for a task, and every check starts it afresh, with the bodies near the
    motion and their supports; the verdict rests on the facts that put them there. It asks the
    same of the same motions as ``pybullet``: where parts come to rest, what is in the hand, which
    tool is attached, the force a screw is driven with. Collisions are for ``contact-pairs``,
    which reads the same execution.
    """

    name = "mujoco"
    version = "5"
    expected_s = 0.3

    class Options(SimulatingEngine.Options):
        """Options of motion and of what counts as done."""

    options: Options

    def make_workcell(self) -> Workcell:
        """Return one whose worlds share a model."""
        settings = ExecutionSettings.model_validate(
            self.options.model_dump(include=set(ExecutionSettings.model_fields))
        )
        return Workcell(self.task, settings, MujocoSimulator(self.task, settings))

    @property
    def basis(self) -> Mapping[str, str]:
        """The versions of what decides a simulation beside this plugin."""
        others = [
            "mujoco-core",
            "numpy",
            "pin",
            "skillplan",
            "skillplan-pinocchio",
            "skillplan-simulation",
        ]
        return versions(*others)
