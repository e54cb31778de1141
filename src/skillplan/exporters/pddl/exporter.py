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
        """Options of what costs are written as."""

        accept_rounding: bool = Field(
            default=False,
            description="whether costs are handed over that are no larger than what rounding to "
            "whole micrometres or microseconds may come to over a plan [-]",
        )

    options: Options
    _made: PlanningTask | None = None

    def refuses(self, handover: Handover) -> str | None:
        """Refuse chance, verdicts that are more than an order, and costs that rounding hides."""
        refusal = refused_chance(handover)
        if refusal:
            return refusal
        judged = any(skill.motion is not None for skill in handover.task.skills)
        if judged and not (handover.charted or handover.derived):
            names = ", ".join(one.name for one in handover.model.feasibility.back_ends)
            return (
                f"{names} judge each skill in each state, and PDDL is given an order. Go by the "
                "hand-made chart with --collision precedence, or hand over the order that the "
                "verdicts come to with --derived"
            )
        made = self.planning_task(handover)
        if made.order.obstacle:
            return f"no order is left: {'; '.join(made.order.obstacle.splitlines())}"
        if made.order.beyond and not handover.derived:
            return (
                f"{made.order.beyond}. Hand over the order alone with --derived, and replay plans"
            )
        try:
            made.scale  # noqa: B018
        except NoActionCosts as error:
            return str(error)
        return None

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return what the order leaves out."""
        beyond = self.planning_task(handover).order.beyond
        return (f"{beyond}: replay plans before use",) if beyond else ()

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return domain and problem, and the plan as planners write it where there is one."""
        made = self.planning_task(handover)
        files = {DOMAIN: made.domain(), PROBLEM: made.problem()}
        return {PLAN: made.plan(), **files} if handover.plan is not None else files

    def planning_task(self, handover: Handover) -> PlanningTask:
        """Return the task as PDDL has it, made once."""
        if self._made is None or self._made.handover is not handover:
            accepted = self.options.accept_rounding
            self._made = PlanningTask(handover, accept_rounding=accepted)
        return self._made
