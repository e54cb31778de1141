"""What a result should say, worked out again from its plans: all but what only the search knew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillplan.domains.domain import Account
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, OptionError, PluginError
from skillplan.model.policy_value import PolicyValue
from skillplan.model.replay import Replay
from skillplan.pipeline.chain import Chain, policy_key
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import SearchRequest
from skillplan.records.chain_result import ChainPart, ChainResult
from skillplan.records.origin import Origin
from skillplan.records.result import Result, Status
from skillplan.records.stored.result_file import StoredClaims, StoredPart, StoredResult
from skillplan.task.task import Task

UNCHECKED = {
    "solver": "who searched leaves no trace in a plan; of a chain, who took which stage is checked",
    "seed": "of the search; the parts of a chain must have the same one",
    "bound_method": "what proved the bound; the bound itself is proved again where it can be",
    "reason": "words, where the status is not optimal; those of a chain are checked",
    "stats": "wall time and counters of the search; of a chain their sums are checked",
    "trace": "figures of the search",
    "origin": "which file, changes and options were given: they are used, and what was queried is "
    "listed; the task must have the hash that the result names",
}
"""What cannot be told from a plan, by key, and why."""
UNDER_CHANCE = "steps and time are those of the nominal outcomes; expected time is not worked out"


@dataclass(frozen=True, slots=True)
class Replayed:
    """A task of a result, with what is claimed of it.

    Parameters
    ----------
    task
        As it was grounded.
    stored
        What is claimed.
    walked
        The plan, replayed; None without one.
    expected
        Under chance, what the policy that was stored beside is worth; None without one.
    not_checked
        Sentences of the back ends about what they leave unchecked of the task.
    """

    task: Task
    stored: StoredClaims
    walked: Replay | None
    expected: PolicyValue | None = None
    not_checked: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether there is no plan, or it leads to the goal at the claimed cost."""
        planned = self.stored.cost is not None
        return planned == (self.walked is not None and self.walked.complete)


def derived_result(replayed: Replayed, setup: Setup, solver: str, origin: Origin | None) -> Result:
    """Return the row of one task as it should be.

    Parameters
    ----------
    replayed
        The task; its plan must be sound.
    setup
        Back ends that were queried.
    solver
        Who solved it.
    origin
        Where the task is from; None for a part of a chain.

    Raises
    ------
    ValueError
        If what is claimed does not go together.
    """
    task, stored, walked = replayed.task, replayed.stored, replayed.walked
    cost, makespan_s = stored.cost, stored.makespan_s
    if walked is not None and task.deterministic:
        cost, makespan_s = walked.cost, walked.duration_s
    elif replayed.expected is not None and replayed.expected.cost is not None:
        cost, makespan_s = replayed.expected.cost, replayed.expected.duration_s
    bound = stored.lower_bound
    if cost is not None and bound is not None:
        # By rounding the bound may lie above the cost.
        bound = cost if 0 < bound - cost <= 1e-9 * max(1.0, cost) else bound
    return Result(
        task=task.name,
        kind=task.kind,
        sha256=task.sha256,
        solver=solver,
        seed=stored.seed,
        physics=setup.physics_choice(task).name,
        collision=setup.detector_names(task),
        status=stored.status,
        cost=cost,
        cost_unit=task.metric.unit,
        timed_by=setup.timed_by(task),
        lower_bound=bound,
        bound_method=stored.bound_method,
        steps=() if walked is None else walked.steps,
        makespan_s=makespan_s,
        reason="" if stored.status is Status.OPTIMAL else stored.reason,
        states=stored.stats.states,
        expanded=stored.stats.expanded,
        checks=stored.stats.checks,
        cache_hits=stored.stats.cache_hits,
        trajectories=stored.stats.trajectories,
        wall_s=stored.stats.wall_s,
        trace=stored.trace,
        origin=origin,
        not_checked=replayed.not_checked,
        dwells_from=task.dwells_from,
    )


def derived_chain(
    problem: Problem,
    stored: StoredResult,
    replayed: Sequence[Replayed],
    setup: Setup,
    origin: Origin | None,
) -> ChainResult:
    """Return the rows of a chain as they should be.

    Parameters
    ----------
    problem
        What the file describes.
    stored
        What is claimed.
    replayed
        Its parts, whose plans must be sound.
    setup
        Back ends that were queried.
    origin
        Where the tasks are from.

    Raises
    ------
    ValueError
        If what is claimed does not go together.
    """
    solvers = _solvers(problem, stored, setup)
    parts = []
    kept_policies = set()
    for one in replayed:
        claims = one.stored
        assert isinstance(claims, StoredPart)
        solver = solvers(one.task) if solvers is not None else claims.solver
        claims = claims.model_copy(update={"seed": stored.seed})
        result = derived_result(replace(one, stored=claims), setup, solver, None)
        optimum = _optimum(claims, result)
        key = policy_key(one.task)
        # A policy can only be reused after an earlier task with the same goal and skills.
        reused = claims.reused_policy and key in kept_policies
        kept_policies.add(key)
        parts.append(ChainPart(one.task, result, optimum, reused))
    plans = {one.task.name: tuple(one.stored.skills) for one in replayed if one.walked is not None}
    tasks = problem.follow({}, stored.replans) if stored.replans else problem.tasks
    broken = ""
    account: Any
    try:
        if len(plans) == len(replayed):
            tasks = problem.follow(plans, stored.replans)
        account = problem.account(plans, stored.replans)
    except ChainBroken as error:
        broken, account = str(error), Account()
    return ChainResult(
        problem.name,
        problem.kind,
        problem.sha256,
        stored.solver,
        stored.seed,
        tuple(parts),
        max(len(tasks), len(parts)),
        account,
        stored.replans,
        broken,
        origin,
    )


def _solvers(problem: Problem, stored: StoredResult, setup: Setup) -> Any:
    """Return who solves a task of a chain by the name of the whole; None where that is unknown."""
    try:
        request = SearchRequest(problem.tasks[0], stored.solver, setup, stored.seed)
        chain = Chain(problem, request, spare=[])
    except (PluginError, OptionError):
        return None

    def solver_of(task: Task) -> str:
        by_rule = chain.rule_solution(task) is not None
        return "rule" if by_rule else chain.solvers[task.stage]

    return solver_of


def _optimum(claims: StoredPart, result: Result) -> float | None:
    """Return what must stand beside a part as its optimum: it is its cost, or gave its bound."""
    if result.status is Status.OPTIMAL:
        return result.cost
    if claims.optimum is None or result.cost is None or result.lower_bound is None:
        return None
    # By rounding alone the proved optimum lies above the cost of a plan.
    close = abs(claims.optimum - result.lower_bound) <= 1e-9 * max(1.0, abs(claims.optimum))
    return claims.optimum if close else result.lower_bound
