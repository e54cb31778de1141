"""The engine `mujoco`: execute a skill with a simulated arm and check its postcondition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Body
from skillplan.task.task import Task
from skillplan_mujoco.cell import Cell
from skillplan_mujoco.cell_model import LEAST_KG, build_cell_spec
from skillplan_mujoco.simulated_arm import SPRING_N_PER_M, SimulatedArm
from skillplan_mujoco.world import World
from skillplan_simulation.execution.workcell import Workcell
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.robot_shapes import list_hands, make_tool_body
from skillplan_simulation.simulating_engine import PerformingEngine, SimulatingEngine, get_versions

# Number of parts that a sentence names.
_SHOWN = 4


class MujocoSimulator:
    """Compiles the model of a task once; see `skillplan_simulation.simulator`.

    Parameters
    ----------
    task
        Task with one robot.
    """

    def __init__(self, task: Task, settings: ExecutionSettings) -> None:
        self.task, self.settings = task, settings
        self.robot = task.scene.robots[0]
        self._cell: Cell | None = None

    def world(self) -> World:
        """Return a world with only a table; earlier worlds become invalid."""
        if self._cell is None:
            hands = list_hands(self.robot)
            scene = self.task.scene
            spec = build_cell_spec(
                self.robot,
                hands,
                self._bodies(hands[0]),
                self.settings.friction,
                holds=bool(scene.workholders or scene.holders),
            )
            self._cell = Cell(spec.compile(), hands, self.settings.friction)
        return World(self._cell)

    def cell(self, hand: Hand) -> tuple[World, SimulatedArm]:
        """Return a world with a table and the task's arm, and the arm."""
        world = self.world()
        world.show_arm()
        return world, SimulatedArm(world, self.robot, self.settings, hand)

    def _bodies(self, hand: Hand) -> list[Body]:
        """Return all bodies that a world can ever hold in addition to arm and table."""
        tools = (make_tool_body(tool, hand) for tool in self.robot.tools)
        return [*self.task.scene.bodies, *(body for body in tools if body is not None)]


class MujocoEngine(PerformingEngine):
    """Execute the skill with an arm in MuJoCo and sense its postcondition.

    The arm is built from its description: published kinematics, limits and masses. One model is
    compiled per task. Every check resets it and adds the bodies near the motion with their
    supports; the verdict rests on the facts that put them there. Motions and postconditions are the
    same as for ``pybullet``: where parts come to rest, which part is in the hand, which tool is
    attached, and the force that drives a screw. ``contact-pairs`` reads collisions from the same
    execution.
    """

    name = "mujoco"
    version = "20"
    expected_s = 0.3

    class Options(SimulatingEngine.Options):
        """Options of motion, and tolerances of postconditions."""

    options: Options

    def make_workcell(self) -> Workcell:
        """Return a workcell whose worlds share one model."""
        settings = ExecutionSettings.model_validate(
            self.options.model_dump(include=set(ExecutionSettings.model_fields))
        )
        return Workcell(self.task, settings, MujocoSimulator(self.task, settings))

    def not_checked(self) -> tuple[str, ...]:
        """Add masses that are raised, and the springs of the wrist in fits; see :meth:`BackEnd`."""
        sentences = super().not_checked()
        if self.refuses() is not None:
            return sentences
        bodies = self.task.scene.bodies
        light = [body.name for body in bodies if body.mass_kg < LEAST_KG and not body.fixed]
        if light:
            least = f"each has the mass of {LEAST_KG * 1e3:g} g"
            sentences = (*sentences, f"parts as light as {_list_first(light)}: {least}")
        fits = [(body.name, fit) for body in bodies for fit in body.fits]
        on_springs = list(dict.fromkeys(name for name, fit in fits if not fit.is_led))
        if not on_springs or self.options.control != "osc":
            return sentences
        stiffness = f"{SPRING_N_PER_M / 1e3:g} N/mm, as of a compliance device"
        wrist = f"how far the wrist yields in fits of {_list_first(on_springs)}: it is on"
        return (*sentences, f"{wrist} {stiffness}")

    @property
    def basis(self) -> Mapping[str, str]:
        """Versions of the distributions that decide a simulation, except this plugin."""
        others = [
            "mujoco-core",
            "numpy",
            "pin",
            "skillplan",
            "skillplan-pinocchio",
            "skillplan-simulation",
        ]
        return get_versions(*others)


def _list_first(names: Sequence[str]) -> str:
    """Return some of the names as a list."""
    return f"{', '.join(names[:_SHOWN])}{' and others' * (len(names) > _SHOWN)}"
