"""An engine that executes skills, and can also show them: pictures, films and whole plans."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from skillplan.physics.performance import Angle, Image, Performance, Performer, Sample
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan_simulation.performing.footage import footage, picture
from skillplan_simulation.performing.plan_execution import (
    Observers,
    Rules,
    execute_plan,
)
from skillplan_simulation.simulating_engine import SimulatingEngine


class PerformingEngine(SimulatingEngine, Performer):
    """Shows what an engine executes; see :class:`skillplan.physics.performance.Performer`."""

    def picture(self, skill: Skill, state: State) -> Image:
        """Return the moment of failure, or the end; see :class:`Performer`."""
        failed = not self.check(skill, state).is_feasible
        return picture(self.workcell, skill, state, self._judges, blamed=failed)

    def footage(self, skill: Skill, state: State, frames_per_s: float) -> Iterator[Image]:
        """Yield pictures of the whole skill; see :class:`Performer`."""
        return footage(self.workcell, skill, state, frames_per_s)

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
    ) -> Performance:
        """Execute a plan in one continuous world; see :meth:`Performer.perform`."""
        observers = Observers(frames_per_s, show, note, angle, labels)
        rules = Rules(self.tolerances, self._judges)
        return execute_plan(self.workcell, rules, skills, observers, stopped)
