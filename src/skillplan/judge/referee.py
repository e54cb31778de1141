"""The referee: it replays the plans of solvers and tries to refute their claims."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from skillplan.errors import ModelTooLarge, SkillplanError
from skillplan.model.policy_value import evaluate_policy, roll_out
from skillplan.model.replay import Replay, replay
from skillplan.model.skill_model import SkillModel
from skillplan.plugins.blame import ends_program
from skillplan.records.result import Result, Status, tolerance
from skillplan.solvers.solution import Plan, Solution
from skillplan.task.skill import Skill
from skillplan.task.state import State

# Limits of the search for a counterexample, which covers small tasks completely.
AUDIT_STATES = 2_000
AUDIT_SKILLS = 20_000
# Under chance the referee calculates the optimum, which needs all states.
CHANCE_STATES = 20_000


def judge(
    ungraded: Result,
    solution: Solution,
    model: SkillModel,
    *,
    unknown_met: bool,
    audit: bool = True,
    left_open: str = "",
) -> Result:
    """Grade a solution: replay its plan or policy, and try to refute its claims.

    Parameters
    ----------
    ungraded
        An unsolved result that names task and solver.
    solution
        The claims of the solver.
    model
        A fresh model that the solver has not used.
    unknown_met
        True if the solver left out skills because a back end could not decide.
    audit
        True to search the model for a counterexample; not if checks are expensive.
    left_open
        The first skill that a back end could not decide, and why.
    """
    answer = solution.found
    if isinstance(answer, Plan):
        result = _judge_plan(ungraded, answer, model)
    elif answer is not None:
        result = _judge_policy(ungraded, answer, model)
    elif solution.proved:
        result = replace(ungraded, status=Status.INFEASIBLE)
    else:
        result = replace(ungraded, reason="no plan was found")
    if result.status is not Status.WRONG:
        such_as = f": {left_open}" if left_open else ""
        unknown = f"some verdicts are unknown, so that nothing is proved{such_as}"
        result = _judge_proof(result, solution, model, unknown if unknown_met else "", audit)
    return result


def _judge_plan(ungraded: Result, plan: Plan, model: SkillModel) -> Result:
    task = model.task
    if not task.deterministic:
        reason = "a fixed sequence was returned for a task with chance; needs a policy"
        return _refute(ungraded, reason)
    try:
        skills = [task.skills[task.action(name)] for name in plan.skills]
    except SkillplanError as error:
        return _refute(ungraded, f"the plan is not one of this task: {error}")
    replayed = replay(model, skills)
    if replayed.violations:
        fault = replayed.violations[0]
        where = f"step {fault.step + 1} ({fault.skill})" if fault.skill else "the end"
        return _refute(ungraded, f"the plan fails at {where}: {fault.stage}: {fault.reason}")
    if plan.cost is not None and not abs(plan.cost - replayed.cost) <= tolerance(replayed.cost):
        reason = f"the solver says its plan costs {plan.cost!r}; it costs {replayed.cost!r}"
        return _refute(ungraded, reason)
    return _accept(ungraded, replayed)


def _accept(ungraded: Result, replayed: Replay) -> Result:
    return replace(
        ungraded,
        status=Status.SOLVED,
        cost=replayed.cost,
        steps=replayed.steps,
        makespan_s=replayed.duration_s,
    )


def _judge_policy(ungraded: Result, policy: Mapping[State, Skill], model: SkillModel) -> Result:
    task = model.task

    def choose(state: State) -> Skill | None:
        # By name, as the solver may return skills of its own making.
        try:
            skill = policy.get(state)
            return None if skill is None else task.skills[task.action(skill)]
        except SkillplanError as error:
            raise _NotOfThisTask(str(error)) from error
        except BaseException as error:
            if ends_program(error):
                raise
            raise _NotOfThisTask(f"{type(error).__name__}: {error}") from error

    try:
        skills = roll_out(model, choose)
        value = None if task.deterministic else evaluate_policy(model, choose)
    except _NotOfThisTask as error:
        return _refute(ungraded, f"the policy is not one of this task: {error}")
    except ModelTooLarge as error:
        return replace(ungraded, reason=f"cannot be judged: {error}")
    replayed = replay(model, skills)
    if not replayed.feasible or (value is not None and value.infeasible):
        problem = value.problem if value is not None and value.infeasible else _fault(replayed)
        return _refute(ungraded, f"the policy takes a step that is infeasible: {problem}")
    if value is None:
        if replayed.complete:
            return _accept(ungraded, replayed)
        reason = f"the policy does not complete the task: {_fault(replayed)}"
        return replace(ungraded, reason=reason)
    if value.cost is None:
        return replace(ungraded, reason=value.problem or "")
    return replace(_accept(ungraded, replayed), cost=value.cost, makespan_s=value.duration_s)


class _NotOfThisTask(Exception):
    """A policy chose something that is not a skill of the task."""


def _fault(replayed: Replay) -> str:
    fault = replayed.violations[0]
    where = f"step {fault.step + 1} ({fault.skill}): " if fault.skill else ""
    return f"{where}{fault.stage}: {fault.reason}"


def _judge_proof(
    result: Result, solution: Solution, model: SkillModel, unknown: str, audit: bool
) -> Result:
    """Check the claimed bound and proof; `unknown` names the verdicts left open, if any."""
    bound, cost = solution.lower_bound, result.cost
    if cost is not None and bound is not None and bound > cost + tolerance(cost):
        return _refute(result, f"the solver claims the bound {bound!r} for a plan of {cost!r}")
    if cost is not None and solution.proved and (bound is None or cost - bound > tolerance(cost)):
        return _refute(result, f"the solver claims a proof with the bound {bound!r}, not {cost!r}")
    if unknown:
        status = Status.UNSOLVED if cost is None else Status.SOLVED
        return replace(result, status=status, reason=unknown)
    # Any plan that is cheaper than the claimed bound refutes it.
    claimed = math.inf if result.status is Status.INFEASIBLE else bound
    if claimed is not None and not model.task.deterministic:
        return _judge_expectation(result, solution, model, claimed, audit)
    if audit and claimed is not None:
        cheaper = find_counterexample(model, claimed)
        if cheaper is not None:
            actions = ",".join(str(model.task.action(skill)) for skill in cheaper)
            reason = f"the solver claims that no plan costs less than {claimed!r}, but: {actions}"
            return _refute(result, reason)
    return _accept_proof(result, solution)


def _accept_proof(result: Result, solution: Solution) -> Result:
    """Return a result with the claimed bound, and with the proof if one is claimed."""
    bound, cost = solution.lower_bound, result.cost
    if bound is None or result.status is Status.INFEASIBLE:
        return result
    if cost is None:
        return replace(result, lower_bound=bound)
    if solution.proved:
        return replace(result, status=Status.OPTIMAL, lower_bound=cost)
    return replace(result, lower_bound=min(bound, cost))


def _judge_expectation(
    result: Result, solution: Solution, model: SkillModel, claimed: float, audit: bool
) -> Result:
    """Compare a claimed bound on expected costs with the least expected cost.

    Only another policy can refute such a claim, a sequence of skills cannot.
    """
    least_cost, doubt = None, "where checks are expensive, a proof under chance is not audited"
    if audit:
        least_cost, doubt = _find_least_cost(model)
    if least_cost is not None and claimed > least_cost + tolerance(least_cost):
        return _refute(
            result,
            f"the solver claims that no policy costs less than {claimed!r}; the best costs "
            f"{least_cost!r}",
        )
    if least_cost is not None or not solution.proved:
        return _accept_proof(result, solution)
    if result.status is Status.INFEASIBLE:
        return replace(result, status=Status.UNSOLVED, reason=doubt)
    return replace(_accept_proof(result, replace(solution, proved=False)), reason=doubt)


def _find_least_cost(model: SkillModel) -> tuple[float | None, str]:
    """Return the least expected cost, or None and why the referee cannot calculate it."""
    # Imports numpy, which a task without chance does not need.
    from skillplan.model.tabular_mdp import compute_least_expected_cost

    try:
        least_cost = compute_least_expected_cost(model, CHANCE_STATES)
    except ModelTooLarge:
        return None, f"a proof under chance is audited up to {CHANCE_STATES:,} states"
    if model.stats.unknown:
        return None, "some verdicts are unknown, so that nothing is proved"
    return (
        least_cost,
        "" if least_cost is not None else "the audit of the proof did not come to an end",
    )


def find_counterexample(model: SkillModel, bound: float) -> list[Skill] | None:
    """Return a plan that costs less than `bound`, by uniform-cost search of limited size.

    Parameters
    ----------
    model
        A model with cheap checks.
    bound
        A claimed lower bound.

    Returns
    -------
    list of Skill or None
        None if there is no such plan, or none was found within `AUDIT_STATES` states and
        `AUDIT_SKILLS` checked skills.
    """
    limit = bound if math.isinf(bound) else bound - tolerance(bound)
    counts_waits = model.task.counts_waits
    if counts_waits and not model.task.metric.is_duration:
        # The cost of a path does not say when it ends.
        return None
    best: dict[State, float] = {model.initial: 0.0}
    came: dict[State, tuple[State, Skill]] = {}
    queue: list[tuple[float, int, int, State]] = [(0.0, 0, 0, model.initial)] if limit > 0 else []
    pushed, looked_at, done = 0, 0, set[State]()
    while queue and len(done) < AUDIT_STATES and looked_at < AUDIT_SKILLS:
        cost, steps, _, state = heapq.heappop(queue)
        if state in done:
            continue
        done.add(state)
        if model.is_goal(state):
            return _path(came, state)
        if steps == model.step_limit:
            continue
        looked_at += len(model.task.skills)
        for step in model.transitions(state):
            total, following = cost + step.cost, step.next_state
            if counts_waits:
                total += step.skill.compute_wait_s(cost)
            if total < limit and total < best.get(following, math.inf):
                best[following], came[following] = total, (state, step.skill)
                pushed += 1
                heapq.heappush(queue, (total, steps + 1, pushed, following))
    return None


def cross_examine(results: Sequence[Result]) -> list[Result]:
    """Mark claims wrong that another solver's plan for the same task refutes."""
    valid = [r for r in results if r.status in (Status.OPTIMAL, Status.SOLVED)]
    if not valid:
        return list(results)
    best = min(valid, key=lambda r: r.cost if r.cost is not None else math.inf)
    assert best.cost is not None
    judged = []
    for result in results:
        claimed = math.inf if result.status is Status.INFEASIBLE else result.lower_bound
        if claimed is not None and best.cost < claimed - tolerance(best.cost):
            reason = (
                f"claims that no plan costs less than {claimed!r}; {best.solver} found one of "
                f"{best.cost!r}"
            )
            result = _refute(result, reason)
        judged.append(result)
    return judged


def _refute(result: Result, reason: str) -> Result:
    cleared: dict[str, Any] = {"cost": None, "steps": (), "makespan_s": None, "lower_bound": None}
    return replace(result, status=Status.WRONG, reason=reason, **cleared)


def _path(came: Mapping[State, tuple[State, Skill]], state: State) -> list[Skill]:
    skills = []
    while state in came:
        state, skill = came[state]
        skills.append(skill)
    return list(reversed(skills))
