"""The engine: a skill is feasible if an arm in MuJoCo executes it and senses what was promised."""

from __future__ import annotations

from collections.abc import Mapping

from skillplan.task.motion import Event
from skillplan.task.pose import DOWN, same_direction
from skillplan.task.scene import ToolKind
from skillplan_mujoco.mujoco_simulator import MujocoSimulator
from skillplan_pinocchio.simulation.arm.hand_shapes import hand_of
from skillplan_pinocchio.simulation.execution.workcell import Workcell
from skillplan_pinocchio.simulation.execution_settings import ExecutionSettings
from skillplan_pinocchio.simulation.simulating_engine import SimulatingEngine, versions


class MujocoEngine(SimulatingEngine):
    """Execute the skill with an arm in MuJoCo and sense its postcondition.

    The arm is the task's, built from its description: published kinematics, limits and masses.
    One model is compiled for a task, and every check starts it afresh, with the bodies near the
    motion and their supports; the verdict rests on the facts that put them there. It asks the
    same of the same motions as ``pybullet``: where parts come to rest, what is in the hand, which
    tool is attached, the force a screw is driven with. Collisions are for ``contact-pairs``,
    which reads the same execution.
    """

    name = "mujoco"
    version = "2"
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
        others = ["mujoco-core", "numpy", "pin", "skillplan", "skillplan-pinocchio"]
        return versions(*others)

    def refuses(self) -> str | None:
        """Refuse what it does not simulate yet, beside what no engine does."""
        refused = super().refuses()
        if refused is not None:
            return refused
        if self.options.control != "osc":
            return "it controls the arm by operational space only: control=osc"
        robot = self.task.scene.robots[0]
        grippers = [tool for tool in robot.tools if tool.kind is ToolKind.GRIPPER]
        if len({hand_of(robot, tool) for tool in grippers}) > 1:
            return "it does not simulate grippers with different jaws in one task yet"
        hollow = next((body.name for body in self.task.scene.bodies if body.surfaces), None)
        if hollow is not None:
            return f"it does not simulate bodies that are not convex yet, such as {hollow}"
        for skill in self.task.skills:
            motions = (skill.motion, *(way.motion for way in skill.ways))
            for motion in motions:
                for route in () if motion is None else motion.routes:
                    for visit in route.visits:
                        if visit.event is Event.DRIVE and not same_direction(visit.along, DOWN):
                            return (
                                "it does not simulate screws that are not driven downwards yet, "
                                f"such as {visit.subject}"
                            )
        return None
