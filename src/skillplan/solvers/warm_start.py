"""Warm start: a known plan is replayed first, and never given up for a worse one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from skillplan.errors import OptionError
from skillplan.model.policy_value import roll_out
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State

# Two orders of summation may make a cost differ by so much, as a fraction of it.
_ROUNDING = 1e-9


def search_from(
    start: Plan, model: SkillModel, search: Callable[[], Solution], stop: Stop
) -> Solution:
    """Replay a plan, hand it to a solver as its incumbent, and return nothing that costs more.

    The solver's claims are kept: if the start plan refutes them, the referee reports that. The
    trace says under ``start`` what became of the plan.

    Parameters
    ----------
    start
        The plan. One that fails on the model or does not end at the goal is not used.
    model
        A model to replay plans on, not the one that the solver uses.
    search
        Runs the solver.
    stop
        The stop of the solver.

    Raises
    ------
    OptionError
        If the plan names a skill that the task does not have, or the task is stochastic: no
        fixed sequence is a plan then.
    BackEndError
        If a back end fails.
    """
    task = model.task
    if not task.deterministic:
        raise OptionError(f"A plan to start from is of no use under chance, as in {task.name}.")
    replayed = replay(model, [task.skill(name) for name in start.skills])
    if replayed.violations:
        fault = replayed.violations[0]
        where = f"step {fault.step + 1} ({fault.skill})" if fault.skill else "the end"
        words = f"the plan given is not used, it fails at {where}: {fault.stage}: {fault.reason}"
        solution = search()
    else:
        words = f"from a plan of {task.cost_text(replayed.cost)}"
        known = Plan(start.skills, replayed.cost)
        stop.incumbent(known)
        solution = search()
        if _costs_less(replayed.cost, solution, model):
            solution = replace(solution, found=known)
    return replace(solution, trace={**solution.trace, "start": words})


def _costs_less(known: float, solution: Solution, model: SkillModel) -> bool:
    """Whether a known cost is below a solution's, or the solution is no complete plan."""
    found = solution.found
    if found is None:
        return True
    cost = found.cost if isinstance(found, Plan) else None
    if cost is None:
        try:
            replayed = replay(model, _skills(found, model))
        except OptionError:
            # A plan that is none of this task is rejected by the referee.
            return False
        if not replayed.complete:
            return True
        cost = replayed.cost
    return known < cost - _ROUNDING * max(1.0, abs(cost))


def _skills(found: Plan | Mapping[State, Skill], model: SkillModel) -> list[Skill]:
    task = model.task
    if isinstance(found, Plan):
        return [task.skill(name) for name in found.skills]

    def choose(state: State) -> Skill | None:
        skill = found.get(state)
        return None if skill is None else task.skills[task.action(skill)]

    return roll_out(model, choose)
