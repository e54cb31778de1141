"""Solvers never grade themselves: what they claim is replayed and, where it can be, refuted."""

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
from skillplan.records.grading import Grade
from skillplan.records.result import Result, Status, tolerance
from skillplan.solvers.solution import Plan, Solution
from skillplan.task.skill import Skill
from skillplan.task.state import State

# The referee's own search for a counterexample ends here; small tasks are covered wholly.
AUDIT_STATES = 2_000
AUDIT_SKILLS = 20_000
# Under chance it works out the optimum itself, which takes all states.
CHANCE_STATES = 20_000


def judge(
    solution: Solution,
    model: SkillModel,
    *,
    unknown_met: bool,
    audit: bool = True,
    left_open: str = "",
) -> Grade:
    """Return what the referee grants a solution.

    Parameters
    ----------
    solution
        What the solver claims.
    model
        A fresh model, not the one that the solver has used.
    unknown_met
        Whether the solver's model left out skills because a back end could not decide.
    audit
        Whether the referee may search the model for a counterexample; not where checks are
        expensive.
    left_open
        About which skill a back end could not decide first, and why.
    """
    found = solution.found
    if isinstance(found, Plan):
        granted = _judge_plan(found, model)
    elif found is not None:
        granted = _judge_policy(found, model)
    elif solution.proved:
        granted = Grade(Status.INFEASIBLE)
    else:
        granted = Grade(Status.UNSOLVED, reason="no plan was found")
    if granted.status is not Status.WRONG:
        such_as = f": {left_open}" if left_open else ""
        unknown = f"some verdicts are unknown, so that nothing is proved{such_as}"
        granted = _judge_proof(granted, solution, model, unknown if unknown_met else "", audit)
    return granted


def _judge_plan(plan: Plan, model: SkillModel) -> Grade:
    task = model.task
    if not task.deterministic:
        return _wrong("a fixed sequence was returned for a task with chance; needs a policy")
    try:
        skills = [task.skills[task.action(name)] for name in plan.skills]
    except SkillplanError as error:
        return _wrong(f"the plan is not one of this task: {error}")
    walked = replay(model, skills)
    if walked.violations:
        fault = walked.violations[0]
        where = f"step {fault.step + 1} ({fault.skill})" if fault.skill else "the end"
        return _wrong(f"the plan fails at {where}: {fault.stage}: {fault.reason}")
    if plan.cost is not None and not abs(plan.cost - walked.cost) <= tolerance(walked.cost):
        return _wrong(f"the solver says its plan costs {plan.cost!r}; it costs {walked.cost!r}")
    return _solved(walked)


def _solved(walked: Replay) -> Grade:
    return Grade(Status.SOLVED, cost=walked.cost, steps=walked.steps, makespan_s=walked.duration_s)


def _judge_policy(policy: Mapping[State, Skill], model: SkillModel) -> Grade:
    task = model.task

    def choose(state: State) -> Skill | None:
        # By name: the task's own skill counts, not what a solver may have made of it.
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
        return _wrong(f"the policy is not one of this task: {error}")
    except ModelTooLarge as error:
        return Grade(Status.UNSOLVED, reason=f"cannot be judged: {error}")
    walked = replay(model, skills)
    if not walked.feasible or (value is not None and value.infeasible):
        problem = value.problem if value is not None and value.infeasible else _fault(walked)
        return _wrong(f"the policy takes a step that is infeasible: {problem}")
    if value is None:
        if walked.complete:
            return _solved(walked)
        reason = f"the policy does not complete the task: {_fault(walked)}"
        return Grade(Status.UNSOLVED, reason=reason)
    if value.cost is None:
        return Grade(Status.UNSOLVED, reason=value.problem or "")
    granted = _solved(walked)
    return replace(granted, cost=value.cost, makespan_s=value.duration_s)


class _NotOfThisTask(Exception):
    """Raised where a policy's answer is no skill of the task."""


def _fault(walked: Replay) -> str:
    fault = walked.violations[0]
    where = f"step {fault.step + 1} ({fault.skill}): " if fault.skill else ""
    return f"{where}{fault.stage}: {fault.reason}"


def _judge_proof(
    granted: Grade, solution: Solution, model: SkillModel, unknown: str, audit: bool
) -> Grade:
    """Grant the claimed bound and proof, or not; `unknown` says what was left open, if anything."""
    bound, cost = solution.lower_bound, granted.cost
    if cost is not None and bound is not None and bound > cost + tolerance(cost):
        return _wrong(f"the solver claims the bound {bound!r} for a plan of {cost!r}")
    if cost is not None and solution.proved and (bound is None or cost - bound > tolerance(cost)):
        return _wrong(f"the solver claims a proof with the bound {bound!r}, not {cost!r}")
    if unknown:
        status = Status.UNSOLVED if cost is None else Status.SOLVED
        return replace(granted, status=status, reason=unknown)
    # Whatever is cheaper than the claimed bound refutes it.
    claimed = math.inf if granted.status is Status.INFEASIBLE else bound
    if claimed is not None and not model.task.deterministic:
        return _judge_expectation(granted, solution, model, claimed, audit)
    if audit and claimed is not None:
        cheaper = counterexample(model, claimed)
        if cheaper is not None:
            text = ",".join(str(model.task.action(skill)) for skill in cheaper)
            return _wrong(
                f"the solver claims that no plan costs less than {claimed!r}, but: {text}"
            )
    return _proved(granted, solution)


def _proved(granted: Grade, solution: Solution) -> Grade:
    """Return a grade with a bound, and a proof if one is claimed, against which nothing stands."""
    bound, cost = solution.lower_bound, granted.cost
    if bound is None or granted.status is Status.INFEASIBLE:
        return granted
    if cost is None:
        return replace(granted, lower_bound=bound)
    if solution.proved:
        return replace(granted, status=Status.OPTIMAL, lower_bound=cost)
    return replace(granted, lower_bound=min(bound, cost))


def _judge_expectation(
    granted: Grade, solution: Solution, model: SkillModel, claimed: float, audit: bool
) -> Grade:
    """Hold what is claimed of every policy's expected cost against the least that there is.

    A sequence of skills cannot refute such a claim, only another policy can.
    """
    least, doubt = None, "where checks are expensive, a proof under chance is not audited"
    if audit:
        least, doubt = _least(model)
    if least is not None and claimed > least + tolerance(least):
        return _wrong(
            f"the solver claims that no policy costs less than {claimed!r}; the best costs "
            f"{least!r}",
        )
    if least is not None or not solution.proved:
        return _proved(granted, solution)
    if granted.status is Status.INFEASIBLE:
        return replace(granted, status=Status.UNSOLVED, reason=doubt)
    return replace(_proved(granted, replace(solution, proved=False)), reason=doubt)


def _least(model: SkillModel) -> tuple[float | None, str]:
    """Return the least expected cost, or None and why the referee cannot work it out."""
    # Takes numpy, which nothing needs that is judged without chance.
    from skillplan.model.least_expected_cost import least_expected_cost

    try:
        least = least_expected_cost(model, CHANCE_STATES)
    except ModelTooLarge:
        return None, f"a proof under chance is audited up to {CHANCE_STATES:,} states"
    if model.stats.unknown:
        return None, "some verdicts are unknown, so that nothing is proved"
    return least, "" if least is not None else "the audit of the proof did not come to an end"


def counterexample(model: SkillModel, bound: float) -> list[Skill] | None:
    """Return a plan that costs less than `bound`, by uniform-cost search of limited size.

    Parameters
    ----------
    model
        A model on which checks are cheap.
    bound
        A claimed lower bound.

    Returns
    -------
    list of Skill or None
        None where there is no such plan, or none was met within `AUDIT_STATES` states and
        `AUDIT_SKILLS` skills looked at.
    """
    limit = bound if math.isinf(bound) else bound - tolerance(bound)
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
            if total < limit and total < best.get(following, math.inf):
                best[following], came[following] = total, (state, step.skill)
                pushed += 1
                heapq.heappush(queue, (total, steps + 1, pushed, following))
    return None


def cross_examine(results: Sequence[Result]) -> list[Result]:
    """Return the results of one task with every claim that another's plan refutes marked wrong."""
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
            result = _refuted(result, reason)
        judged.append(result)
    return judged


def _wrong(reason: str) -> Grade:
    return Grade(Status.WRONG, reason=reason)


def _refuted(result: Result, reason: str) -> Result:
    cleared: dict[str, Any] = {"cost": None, "steps": (), "makespan_s": None, "lower_bound": None}
    return replace(result, status=Status.WRONG, reason=reason, **cleared)


def _path(came: Mapping[State, tuple[State, Skill]], state: State) -> list[Skill]:
    skills = []
    while state in came:
        state, skill = came[state]
        skills.append(skill)
    return list(reversed(skills))
