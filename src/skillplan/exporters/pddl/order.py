"""What back ends demand, as facts that skills need or forbid: the precedence relation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.precedence_chart import DerivedChart, derive_chart
from skillplan.exporters.handover import Handover
from skillplan.exporters.pddl.whole_state import whole_state
from skillplan.model.skill_model import SkillModel
from skillplan.quick_dataclass import dataclass

_MOST_NAMED = 4


@dataclass(frozen=True)
class Order:
    """The order that verdicts come to.

    Parameters
    ----------
    origin
        Where it is from, in words.
    needs, forbids
        Facts by skill that must hold, and must not, beyond its precondition.
    impossible
        Skills that are never feasible, with the reason.
    beyond
        What the order leaves out of the verdicts, in words; empty where it is all of them.
    obstacle
        Why there is no order at all, in words; empty where there may be one.
    """

    origin: str
    needs: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    forbids: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    impossible: Mapping[str, str] = field(default_factory=dict)
    beyond: str = ""
    obstacle: str = ""


def order_of(handover: Handover) -> Order:
    """Return the order that the verdicts of a task come to; back ends are queried for it."""
    model, task = handover.model, handover.task
    if all(skill.motion is None for skill in task.skills):
        return Order("the preconditions of the skills; no back end judges them")
    chart = derive_chart(model.feasibility)
    needs: dict[str, list[str]] = {}
    forbids: dict[str, list[str]] = {}
    for demand in chart.demands:
        skill = str(demand.evidence["skill"])
        if demand.component == demand.after:
            needs.setdefault(skill, []).append(task.operations[demand.before])
        else:
            forbids.setdefault(skill, []).append(task.operations[demand.after])
    names = ", ".join(one.name for one in model.feasibility.back_ends)
    origin = f"derived from the verdicts of {names}"
    if handover.charted:
        origin = "the task's hand-made chart"
    return Order(
        origin,
        {skill: tuple(dict.fromkeys(facts)) for skill, facts in needs.items()},
        {skill: tuple(dict.fromkeys(facts)) for skill, facts in forbids.items()},
        {**_out_of_reach(model), **chart.impossible},
        _beyond(chart),
        chart.obstacle(task) or "",
    )


def _out_of_reach(model: SkillModel) -> dict[str, str]:
    """Return the skills of no component, such as tool changes, that are refused at once."""
    states = HypotheticalStates(model.task)
    charted = {one.name for name in model.task.operations for one in states.chain(name)}
    found = {}
    for skill in model.task.skills:
        if skill.name in charted or skill.cases:
            continue
        state = whole_state(states.before(skill, ()), skill.precondition.forbids)
        if skill.applicable(state) and not (verdict := model.verdict(state, skill)).is_feasible:
            found[skill.name] = f"{verdict.stage}: {verdict.reason}"
    return found


def _beyond(chart: DerivedChart) -> str:
    names = [*chart.conditional, *chart.undecided]
    if not names:
        return ""
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"{', '.join(names[:_MOST_NAMED])}{more} depend on more than an order"
