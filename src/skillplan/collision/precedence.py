"""The detector ``precedence``: the hand-made chart of the task file.

Moller et al. used such a chart in their experiments (section 5): the PCB first, the transformer
before the brace, the brace before the screws.
"""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from skillplan.collision.detector import Detector
from skillplan.task import back_end
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Precedence, Task
from skillplan.task.verdict import Verdict


class PrecedenceDetector(Detector):
    """Rule out operations that the chart orders otherwise."""

    name = "precedence"
    expected_s = 1e-6

    class Options(back_end.Options):
        """Options of the chart."""

        hold_back_picks: bool = Field(
            default=False, description="forbid picking a part up before it may be placed [-]"
        )

    options: Options

    def __init__(self, task: Task, options: Options | None = None) -> None:
        super().__init__(task, options)
        self._lines: dict[str, list[Precedence]] = {}
        for line in task.chart:
            for component in (line.before, line.after):
                self._lines.setdefault(component, []).append(line)
        self._elements: dict[str, str | None] = {}
        self._is_alone = True

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Check for another back end that checks geometry."""
        self._is_alone = not any(other.expensive or isinstance(other, Detector) for other in others)

    def not_checked(self) -> tuple[str, ...]:
        """Return that geometry is not checked, if there is only the chart."""
        if not self._is_alone or not self.task.scene.bodies:
            return ()
        return ("geometry (collisions, support, the arm's motion): only the chart is checked",)

    def refuses(self) -> str | None:
        """Refuse tasks without a chart."""
        if not self.task.chart:
            return "the task file has no 'chart:'. Add one, or use --collision aabb."
        return None

    def check(self, skill: Skill, state: State) -> Verdict:
        """Check the operation that `skill` performs; see :meth:`BackEnd.check`."""
        facts = self.task.facts
        if skill.name not in self._elements:
            self._elements[skill.name] = self._element(skill)
        component = self._elements[skill.name]
        needed, blocked = facts.none, facts.none
        if component is not None:
            for line in self._lines.get(component, ()):
                if line.instead:
                    if line.after != component:
                        continue
                    firsts = (line.before, *line.instead)
                    done = [self.task.operations[first] for first in firsts]
                    holding = next((fact for fact in done if fact in state), None)
                    if holding is None:
                        return Verdict.infeasible(
                            f"the chart puts one of {', '.join(firsts)} before {component}, and "
                            "none is done",
                            needed,
                            blocked | facts.of(*done),
                            {"any_of": list(firsts), "after": component},
                        )
                    needed |= facts.of(holding)
                elif line.after == component:
                    fact = self.task.operations[line.before]
                    needed |= facts.of(fact)
                    if fact not in state:
                        return Verdict.infeasible(
                            f"the chart puts {line.before} before {component}, and {fact} "
                            "does not hold",
                            needed - facts.of(fact),
                            blocked | facts.of(fact),
                            {"before": line.before, "after": component},
                        )
                elif line.before == component:
                    fact = self.task.operations[line.after]
                    if fact in state:
                        return Verdict.infeasible(
                            f"the chart puts {component} before {line.after}, and {fact} "
                            "holds already",
                            needed | facts.of(fact),
                            blocked,
                            {"before": component, "after": line.after},
                        )
                    blocked |= facts.of(fact)
        return Verdict.feasible(needed, blocked)

    def _element(self, skill: Skill) -> str | None:
        """Return the component of the chart whose operation `skill` completes."""
        added = skill.prediction.add
        for component, fact in self.task.operations.items():
            if fact in added:
                return component
        if self.options.hold_back_picks and skill.kind == "pick":
            return skill.parameters["part"]
        return None
