"""From a loaded file and two costs to their Pareto front, judged point by point."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace

from skillplan.checks.single_check import list_not_checked
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import OptionError, SearchStopped, name_hint
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import list_expensive, make_model, solve
from skillplan.records.front import Front, FrontPoint
from skillplan.records.result import Status, tolerance
from skillplan.solvers.search.front import FrontPlan, FrontSearch, Objective, search_front
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task

# Solver that confirms the least of each cost; it shares no code with the search for the front
# except the bound, and chooses other methods for larger tasks.
_CONFIRMS = "auto"
# Least time that this may take for one cost [s]; else as long as the search for the front.
_LEAST_CONFIRMATION_S = 2.0


@dataclass(frozen=True, slots=True)
class _Question:
    """Two costs of a task and the terms of the search."""

    objectives: tuple[Objective, Objective]
    base: Task
    setup: Setup
    cache: VerdictCache
    jobs: int


def check_costs(problem: Problem, names: Sequence[str]) -> tuple[str, str]:
    """Return the names of two costs of a file.

    Raises
    ------
    OptionError
        If there are not two different ones, or the file has no such cost.
    """
    known = problem.domain.list_costs(problem.config)
    if not known:
        raise OptionError(f"--pareto: a task of kind {problem.kind!r} has a single cost.")
    if len(names) != 2 or names[0] == names[1]:
        raise OptionError(f"--pareto takes two of {', '.join(known)}, such as time,distance.")
    for name in names:
        if name not in known:
            raise OptionError(f"--pareto: unknown cost {name!r}. {name_hint(name, known)}")
    return names[0], names[1]


def solve_front(
    problem: Problem,
    names: Sequence[str],
    setup: Setup = Setup(),
    *,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    jobs: int = 1,
) -> Front:
    """Return the Pareto front of two costs, with every plan replayed by the referee.

    Parameters
    ----------
    problem
        A file with a single task.
    names
        Two of the costs that the kind of task lists, such as ``time`` and ``distance``.
    stop
        Limits of the search. If they end it, the front is complete up to the cost that it states.

    Raises
    ------
    OptionError
        If the names or the task do not fit.
    PluginError, BackEndError
        If a back end is unknown or fails.
    """
    first, second = check_costs(problem, names)
    stop, cache = stop or Stop(), VerdictCache() if cache is None else cache
    # The file chose its back ends and is valid, so its task is grounded anew for each cost.
    problem.part(None)
    objectives = tuple(
        Objective(name, problem.domain.ground(config, problem.sha256)[0])
        for name in (first, second)
        for config in [problem.domain.with_cost(problem.config, name)]
    )
    timed = [o.task for o in objectives if o.task.metric.depends_on_time]
    base = timed[0] if timed else objectives[0].task
    # An engine executes every skill: there is no sample of refused ones here.
    setup = replace(setup, screening=False)
    question = _Question((objectives[0], objectives[1]), base, setup, cache, jobs)
    ungraded = Front(
        task=problem.name,
        kind=problem.kind,
        sha256=problem.sha256,
        names=(first, second),
        metrics=(objectives[0].task.metric, objectives[1].task.metric),
        status=Status.UNSOLVED,
        physics=setup.physics_choice(base).name,
        collision=setup.detector_names(base),
        timed_by=setup.timed_by(base),
    )
    if not base.deterministic:
        reason = "a front is of sequences, and needs skills with one outcome each"
        return replace(ungraded, status=Status.REFUSED, reason=reason)
    waiting = [o.task.metric for o in objectives if o.task.counts_waits]
    if waiting and not (len(waiting) == 1 and waiting[0].is_duration):
        reason = (
            "parts arrive at a time ('arrives_s'), so a front is of the time and a cost that does "
            "not contain it: --pareto time,distance"
        )
        return replace(ungraded, status=Status.REFUSED, reason=reason)
    begin_s = time.perf_counter()
    model = make_model(base, setup, cache, stop.overdue, jobs=jobs, on_check=stop.checked)
    with closing(model.feasibility):
        try:
            outcome = search_front(model, question.objectives, stop)
        except SearchStopped:
            stop()
            outcome = FrontSearch((), complete=False)
    stats = model.stats
    front = replace(
        ungraded,
        not_checked=list_not_checked(model.feasibility.back_ends),
        interrupted=stop.interrupted,
        reached=outcome.reached,
        stats={
            "expanded": outcome.expanded,
            "labels": outcome.generated,
            "checks": stats.checks,
            "cache_hits": stats.cache_hits,
            "trajectories": stats.trajectories,
            "wall_s": time.perf_counter() - begin_s,
        },
    )
    unknown = f"some verdicts are unknown: {stats.left_open}" if stats.unknown else ""
    return _judge(front, question, outcome, stop, unknown)


def _judge(
    front: Front, question: _Question, outcome: FrontSearch, stop: Stop, unknown: str
) -> Front:
    """Replay every plan in a fresh model, and compare the ends of the front with other proofs."""
    chain = question.setup.back_ends(question.base)
    fresh = make_model(
        question.base,
        question.setup,
        question.cache.only(list_expensive(chain)),
        jobs=question.jobs,
        back_ends=chain,
    )
    points = []
    with closing(fresh.feasibility):
        for plan in outcome.plans:
            point, fault = _replay(fresh, question.objectives, plan)
            if point is None:
                return replace(front, status=Status.WRONG, reason=fault)
            points.append(replace(point, proved=not unknown))
    front = replace(front, points=tuple(points), reason=unknown)
    if not outcome.complete:
        status = Status.SOLVED if points else Status.UNSOLVED
        return replace(front, status=status, reason=stop.reason or unknown)
    if unknown:
        return replace(front, status=Status.SOLVED if points else Status.UNSOLVED)
    if not points:
        return replace(front, status=Status.INFEASIBLE)
    return _confirm(replace(front, status=Status.OPTIMAL), question, stop)


def _replay(
    model: SkillModel, objectives: tuple[Objective, Objective], plan: FrontPlan
) -> tuple[FrontPoint | None, str]:
    """Return a replayed point, or None and the fault of the plan."""
    task = model.task
    skills = [task.skill(name) for name in plan.skills]
    replayed = replay(model, skills)
    if replayed.violations:
        fault = replayed.violations[0]
        return None, f"a plan fails at step {fault.step + 1}: {fault.stage}: {fault.reason}"
    state, costs = model.initial, [0.0, 0.0]
    for skill, step in zip(skills, replayed.steps, strict=True):
        for index, objective in enumerate(objectives):
            costs[index] += objective.price(task.action(skill), state, step.duration_s)
        state = skill.prediction_in(state).apply(state)
    for cost, claimed in zip(costs, plan.costs, strict=True):
        if abs(cost - claimed) > 2 * tolerance(cost):
            return None, f"a plan costs {cost!r}, not {claimed!r} as the search claims"
    actions = tuple(task.action(skill) for skill in skills)
    point = FrontPoint((costs[0], costs[1]), True, plan.skills, actions, replayed.duration_s)
    return point, ""


def _confirm(front: Front, question: _Question, stop: Stop) -> Front:
    """Compare the least of each cost with the proof of a solver for that cost alone."""
    for index, objective in enumerate(question.objectives):
        missing = f"least {objective.name} not confirmed by {_CONFIRMS}: "
        if stop():
            return replace(front, reason=missing + (stop.reason or "no time left"))
        alone = solve(
            objective.task,
            _CONFIRMS,
            question.setup,
            stop=stop.within(max(_LEAST_CONFIRMATION_S, float(front.stats["wall_s"]))),
            cache=question.cache,
            jobs=question.jobs,
        )
        least = min(point.costs[index] for point in front.points)
        is_proved = alone.status is Status.OPTIMAL
        fault = ""
        if alone.status in (Status.WRONG, Status.INFEASIBLE):
            fault = f"{alone.solver} alone ends as {alone.status.value}: {alone.reason}"
        elif alone.cost is not None:
            excess = least - alone.cost
            if excess > 2 * tolerance(least) or (is_proved and -excess > 2 * tolerance(least)):
                has = "proves" if is_proved else "finds"
                fault = f"{alone.solver} {has} {alone.cost!r}"
        if fault:
            reason = f"the least {objective.name} of the front is {least!r}; {fault}"
            points = tuple(replace(point, proved=False) for point in front.points)
            return replace(front, status=Status.WRONG, points=points, reason=reason)
        if not is_proved:
            return replace(front, reason=missing + (alone.reason or alone.status.value))
    return replace(front, confirmed_by=_CONFIRMS)
