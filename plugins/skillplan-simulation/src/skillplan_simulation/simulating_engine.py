"""Base classes of engines that execute skills with a simulated arm."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from typing import ClassVar

from pydantic import Field

from skillplan.physics.engine import Engine
from skillplan.physics.linear_motions import find_jaw_faults
from skillplan.physics.performance import Angle, Image, Performance, Performer, Sample
from skillplan.task import back_end
from skillplan.task.back_end import BackEnd
from skillplan.task.scene import Scene, describe_unchecked_joins
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.task.zone import describe_unchecked_speeds
from skillplan_pinocchio.tight_fits import (
    describe_unchecked_fits,
    find_blocked_fits,
    find_tight_fits,
)
from skillplan_simulation.execution.plan_execution import (
    Observers,
    Rules,
    execute_plan,
    film_skill,
    take_picture,
)
from skillplan_simulation.execution.workcell import Workcell
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.record import Record
from skillplan_simulation.verdicts import Tolerances, check_postcondition, select_judges

# Engine and detectors are queried in turn about the same skill and state.
_KEPT_RECORDS = 8


class SimulatingEngine(Engine):
    """Execute the skill with a simulated arm and sense its postcondition.

    The verdict rests on the facts that put bodies near the motion. Postconditions are where parts
    come to rest, which part is in the hand, which tool is attached, and the force that drives a
    screw. Detectors read collisions from the same execution.
    """

    expensive = True
    # Detectors of its contacts, the default first.
    contact_detectors: ClassVar[tuple[str, ...]] = ("contact-pairs",)
    # True if fixed meshes that are not convex are exact instead of convex pieces.
    stands_exact: ClassVar[bool] = False

    class Options(ExecutionSettings):
        """Options of motion, and tolerances of postconditions."""

        position_tolerance_m: float = Field(
            default=0.0005,
            gt=0,
            le=0.05,
            description="maximum distance of a part at rest from its goal [m]",
        )
        tilt_tolerance_rad: float = Field(
            default=math.radians(1.5),
            gt=0,
            le=1.0,
            description="maximum rotation of a part at rest from its goal [rad]",
        )
        held_tolerance_m: float = Field(
            default=0.003, gt=0, le=0.05, description="maximum slip of a part in the hand [m]"
        )
        min_fastening_force_n: float = Field(
            default=3.0,
            gt=0,
            le=60.0,
            description="minimum force with which a screw counts as driven [N]",
        )

        max_insertion_force_n: float = Field(
            default=20.0,
            gt=0,
            le=200.0,
            description="maximum force that pushes a part into place [N]",
        )

    options: Options

    def __init__(self, task: Task, options: back_end.Options | None = None) -> None:
        super().__init__(task, options)
        self._workcell: Workcell | None = None
        self._judges = select_judges((), self._parts())
        self._records: OrderedDict[tuple[str, int], Record] = OrderedDict()

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Let the detectors in use decide about contacts of whole plans and of pictures.

        Without a detector, the default limits of ``contact-pairs`` apply.
        """
        self._judges = select_judges(others, self._parts())

    def _parts(self) -> list[str]:
        return [body.name for body in self.task.scene.bodies]

    @property
    def workcell(self) -> Workcell:
        """The workcell, created when first needed."""
        if self._workcell is None:
            self._workcell = self.make_workcell()
        return self._workcell

    @abstractmethod
    def make_workcell(self) -> Workcell:
        """Return the engine's own workcell."""

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances of predictions."""
        options = self.options
        return Tolerances(
            options.position_tolerance_m,
            options.tilt_tolerance_rad,
            options.held_tolerance_m,
            options.min_fastening_force_n,
            options.max_insertion_force_n,
        )

    def refuses(self) -> str | None:
        """Refuse tasks without bodies, and several robots."""
        scene = self.task.scene
        if len(scene.robots) != 1:
            return f"it simulates one arm, and the task has {len(scene.robots)} robots"
        if not scene.bodies:
            return "the task has no bodies to simulate"
        return None

    def faults(self) -> Mapping[str, str]:
        """Return parts that the hand cannot hold, and fits that convex pieces block."""
        if self.refuses() is not None:
            return {}
        return {
            **find_blocked_fits(self.task, as_pieces=not self.stands_exact),
            **find_jaw_faults(self.task),
        }

    def warnings(self) -> Mapping[str, str]:
        """Return fits that convex pieces narrow; see :meth:`BackEnd.warnings`."""
        if self.refuses() is not None:
            return {}
        return find_tight_fits(self.task, as_pieces=not self.stands_exact)

    def not_checked(self) -> tuple[str, ...]:
        """Return limits that the arm's description lacks, and what of fits, speeds and joins."""
        if self.refuses() is not None:
            return ()
        scene = self.task.scene
        return (
            *scene.robots[0].model.not_checked,
            *describe_unchecked_fits(scene.bodies, simulated=True),
            *describe_unchecked_speeds(scene),
            *describe_unchecked_joins(scene.bodies),
            *_describe_holders(scene),
        )

    def record(self, skill: Skill, state: State) -> Record:
        """Return the execution of a skill, shared by all back ends with the same query."""
        key = (skill.name, state.bits)
        known = self._records.get(key)
        if known is None:
            known = self._records[key] = self.workcell.execute(skill, state)
            if len(self._records) > _KEPT_RECORDS:
                self._records.popitem(last=False)
        return known

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict on the sensed postcondition; see :meth:`BackEnd.check`."""
        if skill.motion is None and not self.workcell.frees(skill, state):
            return Verdict.feasible(self.task.facts.none, self.task.facts.none)
        return check_postcondition(skill, self.record(skill, state), self.tolerances)


def _describe_holders(scene: Scene) -> tuple[str, ...]:
    """Return that held parts do not slip, by the names of the holders."""
    if not scene.holders:
        return ()
    names = ", ".join(holder.name for holder in scene.holders)
    return (f"how holders close, and whether a part slips under their force_n: {names}",)


@cache
def get_versions(*distributions: str) -> Mapping[str, str]:
    """Return the installed versions of distributions, read once per process."""
    return {name: version(name) for name in distributions}


class PerformingEngine(SimulatingEngine, Performer):
    """An engine that can show executions; see :class:`skillplan.physics.performance.Performer`."""

    def picture(self, skill: Skill, state: State) -> Image:
        """Return the moment of failure, or the end; see :class:`Performer`."""
        failed = not self.check(skill, state).is_feasible
        return take_picture(self.workcell, skill, state, self._judges, blamed=failed)

    def footage(self, skill: Skill, state: State, frames_per_s: float) -> Iterator[Image]:
        """Yield pictures of the whole skill; see :class:`Performer`."""
        return film_skill(self.workcell, skill, state, frames_per_s)

    def perform(
        self,
        skills: Sequence[Skill],
        *,
        frames_per_s: float | None = None,
        show: Callable[[Image], None] | None = None,
        note: Callable[[Sample], None] | None = None,
        stopped: Callable[[], bool] = lambda: False,
        angle: Angle | None = None,
        labels: bool = False,
        keeps_going: bool = False,
    ) -> Performance:
        """Execute a plan in one continuous world; see :meth:`Performer.perform`."""
        observers = Observers(frames_per_s, show, note, angle, labels)
        rules = Rules(self.tolerances, self._judges)
        return execute_plan(
            self.workcell, rules, skills, observers, stopped, keeps_going=keeps_going
        )
