"""Domain, problem and plan in a folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from skillplan.exporters.exporter import Exporter, refused_chance
from skillplan.exporters.handover import Handover
from skillplan.exporters.pddl.action_costs import NoActionCosts
from skillplan.exporters.pddl.planning_task import PlanningTask
from skillplan.task import back_end

DOMAIN, PROBLEM, PLAN = "domain.pddl", "problem.pddl", "plan.txt"


class PddlExporter(Exporter):
    """A folder with domain and problem in PDDL 2.1, typed, with action costs, and the plan."""

    name: ClassVar[str] = "pddl"
    suffix: ClassVar[str] = ""
    needs_plan: ClassVar[bool] = False

    class Options(back_end.Options):
        """Options of costs and of the step limit."""

        accept_rounding: bool = Field(
            default=False,
            description="whether costs are handed over that are no larger than what rounding to "
            "whole micrometres or microseconds may come to over a plan [-]",
        )
        count_steps: bool = Field(
            default=False,
            description="whether the step limit is part of the task; planners take longer [-]",
        )

    options: Options
    _made: PlanningTask | None = None

    def refuses(self, handover: Handover) -> str | None:
        """Refuse chance, and costs that are not those of actions or that rounding hides."""
        refusal = refused_chance(handover)
        if refusal:
            return refusal
        try:
            self.planning_task(handover).scale  # noqa: B018
        except NoActionCosts as error:
            return str(error)
        return None

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return the skills that are left out where their verdicts are not known."""
        left_out = self.planning_task(handover).left_out
        return (f"never done where no verdict is known: {left_out}",) if left_out else ()

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return domain and problem, and the plan as planners write it if there is one."""
        task = self.planning_task(handover)
        files = {DOMAIN: task.domain(), PROBLEM: task.problem()}
        return {PLAN: task.plan(), **files} if handover.plan is not None else files

    def planning_task(self, handover: Handover) -> PlanningTask:
        """Return the task as PDDL has it, made once."""
        if self._made is None or self._made.handover is not handover:
            self._made = PlanningTask(
                handover,
                accept_rounding=self.options.accept_rounding,
                count_steps=self.options.count_steps,
            )
        return self._made
