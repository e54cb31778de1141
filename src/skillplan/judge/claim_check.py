"""The claims of one plan, checked: the plan replayed, the costs added up, the proof repeated.

Nothing here trusts the solver that made the claims or shares code with it. Claims about all plans
are checked by the two plainest methods, without bounds, pruning or compiled code: a dynamic program
over orders of jobs (Held and Karp, "A dynamic programming approach to sequencing problems", 1962;
restricted to sets closed under the precedence relation, as by Escudero, 1988), and uniform-cost
search over the lazy model (Dijkstra, 1959). Both are given up beyond a limit. Then a bound may
follow from a linear relaxation of the orders: every job is entered and left once, and every set of
jobs is entered (Dantzig, Fulkerson and Johnson, 1954). The program that solves it need not be
trusted, because any multipliers prove a bound.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skillplan.domains.domain import Domain
from skillplan.errors import ModelTooLarge, NotASequencing, OptionError, SearchStopped
from skillplan.model.policy_value import PolicyValue
from skillplan.model.replay import Replay, replay
from skillplan.model.skill_model import SkillModel, Transition
from skillplan.records.certificate import Claim, Outcome
from skillplan.records.result import Status, tolerance
from skillplan.records.stored.result_file import StoredClaims
from skillplan.solvers.solution import relative_gap
from skillplan.solvers.stop import Stop
from skillplan.task.state import State

if TYPE_CHECKING:
    from skillplan.model.sequencing import SequencingProblem


MOST_SUBSETS = 1_000_000
MOST_STATES = 200_000
ORDERS = "dynamic program over orders of jobs"
STATES = "uniform-cost search over all states"
RELAXATION = "linear relaxation of orders"
_STOPPED = "stopped before it was done"
_POLL_EVERY = 1_024


@dataclass(frozen=True, slots=True)
class LeastCost:
    """The least cost that a method has found.

    Parameters
    ----------
    method
        Name of the method, for messages.
    cost
        The least cost of any plan, infinite without a plan; None if the method was given up.
    skills
        A plan of that cost; empty without one.
    why_not
        Reason why the method was given up; empty if it was not.
    is_bound
        True if `cost` is a lower bound only.
    """

    method: str
    cost: float | None = None
    skills: tuple[str, ...] = ()
    why_not: str = ""
    is_bound: bool = False


def find_least_cost_of_orders(
    problem: SequencingProblem,
    over: Callable[[], bool] = lambda: False,
    most_subsets: int = MOST_SUBSETS,
) -> LeastCost:
    """Return the least cost of doing all jobs, from the sets of jobs done and the last job.

    Parameters
    ----------
    problem
        n jobs, costs between them and their precedence.
    over
        Polled; the method is given up once it returns True.
    most_subsets
        Maximum number of pairs of a set of jobs and its last job.
    """
    n = len(problem.jobs)
    if n == 0:
        return LeastCost(ORDERS, 0.0)
    before = [0] * n
    for earlier, later in problem.precedence:
        before[later] |= 1 << earlier
    costs = [[float(cost) for cost in row] for row in problem.costs]
    # For each set of jobs and its last job: the least cost, and the job before the last.
    layer = {(1 << j, j): (float(problem.first[j]), -1) for j in range(n) if before[j] == 0}
    layers = [layer]
    kept = len(layer)
    for _ in range(n - 1):
        following: dict[tuple[int, int], tuple[float, int]] = {}
        for count, ((done, last), (cost, _)) in enumerate(layer.items()):
            if count % _POLL_EVERY == 0 and over():
                return LeastCost(ORDERS, why_not=_STOPPED)
            for job in range(n):
                if done >> job & 1 or before[job] & ~done:
                    continue
                total, key = cost + costs[last][job], (done | 1 << job, job)
                if total < following.get(key, (math.inf, -1))[0]:
                    following[key] = (total, last)
            if kept + len(following) > most_subsets:
                why = f"too large, more than {most_subsets:,} sets of jobs"
                return LeastCost(ORDERS, why_not=why)
        layer = following
        layers.append(layer)
        kept += len(layer)
    if not layer:
        return LeastCost(ORDERS, math.inf)
    (done, last), (least_cost, _) = min(layer.items(), key=lambda entry: entry[1][0])
    if math.isinf(least_cost):
        return LeastCost(ORDERS, math.inf)
    order: list[int] = []
    for layer in reversed(layers):
        order.append(last)
        done, last = done & ~(1 << last), layer[done, last][1]
    skills = problem.plan(order[::-1])
    if len(skills) > problem.step_limit:
        why = f"the cheapest order takes {len(skills)} skills, the limit is {problem.step_limit}"
        return LeastCost(ORDERS, why_not=why)
    return LeastCost(ORDERS, least_cost, skills)


def find_least_cost_of_states(
    model: SkillModel, over: Callable[[], bool] = lambda: False, most_states: int = MOST_STATES
) -> LeastCost:
    """Return the least cost of a plan within the step limit, state by state in order of cost.

    All paths to a state are kept that no other path beats in both cost and length.

    Parameters
    ----------
    model
        A deterministic model; it is queried in each state that costs less than the goal.
    over
        Polled; the method is given up once it returns True.
    most_states
        Maximum number of paths to states.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    counts_waits = model.task.counts_waits
    if counts_waits and not model.task.metric.is_duration:
        why = "parts arrive at a time, and the cost of a path does not say when it ends"
        return LeastCost(STATES, why_not=why)
    # A path is its last step and the path before that; None at the initial state.
    start: _Path | None = None
    queue: list[tuple[float, int, int, State, _Path | None]] = [(0.0, 0, 0, model.initial, start)]
    shortest: dict[State, int] = {}
    pushed = looked_at = 0
    try:
        while queue and not model.stats.unknown:
            cost, steps, _, state, path = heapq.heappop(queue)
            if shortest.get(state, model.step_limit + 1) <= steps:
                continue
            shortest[state] = steps
            if model.is_goal(state):
                return LeastCost(STATES, cost, _skills(path))
            looked_at += 1
            if looked_at > most_states:
                return LeastCost(STATES, why_not=f"too large, more than {most_states:,} states")
            if looked_at % _POLL_EVERY == 0 and over():
                return LeastCost(STATES, why_not=_STOPPED)
            if steps == model.step_limit:
                continue
            for step in model.transitions(state):
                if shortest.get(step.next_state, model.step_limit + 1) <= steps + 1:
                    continue
                pushed += 1
                total = cost + step.cost
                if counts_waits:
                    total += step.skill.compute_wait_s(cost)
                entry = (total, steps + 1, pushed, step.next_state, (step, path))
                heapq.heappush(queue, entry)
    except SearchStopped:
        return LeastCost(STATES, why_not=_STOPPED)
    if model.stats.unknown:
        return LeastCost(STATES, why_not="some verdicts are unknown")
    return LeastCost(STATES, math.inf)


def find_bound_of_orders(
    problem: SequencingProblem, over: Callable[[], bool] = lambda: False, most_rounds: int = 200
) -> float | None:
    """Return a lower bound on the cost of doing all jobs, by linear programming with cuts.

    Parameters
    ----------
    problem
        Jobs, costs between them and their precedence.
    over
        Polled; the bound so far is returned once it returns True.
    most_rounds
        Greatest number of rounds of cuts.

    Returns
    -------
    float or None
        None without a bound.
    """
    import numpy as np
    from scipy.optimize import linprog
    from scipy.sparse import csr_matrix

    costs = _list_arcs(problem)
    begins, ends = np.array([*costs]).T
    values, size = np.array([*costs.values()]), len(problem.jobs) + 1
    numbers = np.arange(len(values))
    rows = np.concatenate([begins, size + ends])
    visits = csr_matrix((np.ones(2 * len(values)), (rows, np.tile(numbers, 2))))
    best: float | None = None
    cuts: list[Any] = []
    for _ in range(most_rounds):
        if over():
            break
        entered = {"A_ub": -np.array(cuts), "b_ub": -np.ones(len(cuts))} if cuts else {}
        answer = linprog(values, A_eq=visits, b_eq=np.ones(2 * size), method="highs", **entered)
        if answer.x is None:
            break
        # Any multipliers prove a bound: shares of arcs are 0 to 1, and a cut is at least 1.
        once = answer.eqlin.marginals
        weights = np.maximum(0.0, -answer.ineqlin.marginals) if cuts else np.zeros(0)
        reduced = values - visits.T @ once - (weights @ np.array(cuts) if cuts else 0.0)
        bound = float(once.sum() + weights.sum() + np.minimum(reduced, 0.0).sum())
        best = bound if best is None else max(best, bound)
        sets = _find_sets_not_entered(answer.x, begins, ends, size)
        if not sets:
            break
        cuts += [(inside[begins] & ~inside[ends]).astype(float) for inside in sets]
    return best


def _list_arcs(problem: SequencingProblem) -> dict[tuple[int, int], float]:
    """Return the costs of going from job to job; 0 is the beginning and the end."""
    jobs = range(len(problem.jobs))
    after: dict[int, set[int]] = {job: set() for job in jobs}
    for earlier, later in problem.precedence:
        after[earlier].add(later)
    for middle in jobs:
        for job in jobs:
            if middle in after[job]:
                after[job] |= after[middle]
    arcs = {
        (0, j + 1): float(problem.first[j]) for j in jobs if not any(j in s for s in after.values())
    }
    arcs |= {(i + 1, 0): 0.0 for i in jobs if not after[i]}
    for i in jobs:
        between = {k for j in after[i] for k in after[j]}
        arcs |= {
            (i + 1, j + 1): float(problem.costs[i][j])
            for j in jobs
            if j != i and i not in after[j] and j not in between
        }
    return {arc: cost for arc, cost in arcs.items() if math.isfinite(cost)}


def _find_sets_not_entered(shares: Any, begins: Any, ends: Any, size: int) -> list[Any]:
    """Return sets with the beginning that the shares of arcs leave less than once, as masks."""
    import numpy as np
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    whole = 1_000_000
    capacity = csr_matrix((np.round(shares * whole).astype(np.int32), (begins, ends)), (size, size))
    sets: dict[bytes, Any] = {}
    for job in range(1, size):
        flow = maximum_flow(capacity, 0, job)
        if flow.flow_value < whole - size:
            rest = (capacity - flow.flow).maximum(0)
            rest.eliminate_zeros()
            inside = np.zeros(size, dtype=bool)
            inside[breadth_first_order(rest, 0, return_predecessors=False)] = True
            sets[inside.tobytes()] = inside
    return list(sets.values())


_Path = tuple[Transition, "_Path | None"]


def _skills(path: _Path | None) -> tuple[str, ...]:
    names = []
    while path is not None:
        step, path = path
        names.append(step.skill.name)
    return tuple(reversed(names))


REPLAY = "replay"
ARITHMETIC = "arithmetic"
EXPECTATION = "values of all states"
_PROVED = (Status.OPTIMAL, Status.INFEASIBLE)
# Tolerance of durations [s], whose last digits differ between runs of an engine.
SAME_TIME_S = 1e-6
# Maximum number of states that the check enumerates under chance.
_CHANCE_STATES = 20_000


def replay_plan(stored: StoredClaims, model: SkillModel) -> Replay | None:
    """Replay a stored plan; return None if there is none, or it is for another task.

    Raises
    ------
    BackEndError
        If a back end fails.
    SearchStopped
        If the time limit is long over.
    """
    if not stored.skills and stored.cost is None:
        return None
    try:
        return replay(model, [model.task.skill(name) for name in stored.skills])
    except OptionError:
        return None


def check_claims(
    stored: StoredClaims,
    walked: Replay | None,
    model: SkillModel,
    stop: Stop,
    expected: PolicyValue | None = None,
    domain: Domain | None = None,
) -> Iterator[Claim]:
    """Yield the claims of a result, each with the outcome of its check.

    Parameters
    ----------
    stored
        The claims.
    walked
        The replayed plan, from `replay_plan`.
    model
        A fresh model of the task.
    stop
        Limits of the second proof.
    expected
        Under chance, the value of the stored policy; None without one.
    domain
        The domain of the task, for its second bound; None for no such bound.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    if stored.skills or stored.cost is not None:
        yield from _check_plan(stored, walked, model, expected)
    yield from check_arithmetic(stored)
    # Under chance the cost of a plan without its policy follows from the values of all states.
    unpriced = bool(walked and walked.complete and not model.task.deterministic and not expected)
    try:
        yield from _check_proofs(stored, model, stop, domain, unpriced=unpriced)
    except SearchStopped:
        least_cost = LeastCost("second proof", why_not=explain_stop(stop))
        yield _make_unproved(stored, least_cost)
        if unpriced:
            yield _check_cost_without_policy(stored, least_cost)


def explain_stop(stop: Stop) -> str:
    """Return the reason why a check was given up."""
    return stop.reason or "stopped before it was done"


def check_arithmetic(stored: StoredClaims) -> Iterator[Claim]:
    """Check bound, gap and status against each other, which needs no model."""
    cost, bound, status = stored.cost, stored.lower_bound, stored.status
    if bound is not None and cost is not None:
        yield _make_claim(
            "bound",
            bound <= cost + tolerance(cost),
            f"{_format_figure(bound)} is not above the cost {_format_figure(cost)}",
            f"{_format_figure(bound)} is above the cost {_format_figure(cost)}",
            ARITHMETIC,
        )
    gap = relative_gap(cost, bound)
    same = (gap is None) == (stored.gap is None) and abs((gap or 0) - (stored.gap or 0)) <= 1e-9
    if gap is not None or stored.gap is not None:
        good, claimed = _format_figure(gap), _format_figure(stored.gap)
        yield _make_claim("gap", same, good, f"is {good}, claimed {claimed}", ARITHMETIC)
    yield _check_status(status, cost, bound)


def _make_claim(name: str, holds: bool, good: str, bad: str, method: str) -> Claim:
    return Claim(name, Outcome.HOLDS if holds else Outcome.FAILS, good if holds else bad, method)


def _format_figure(value: float | None) -> str:
    """Return a figure with the digits that matter in a proof."""
    return "none" if value is None else f"{value:.10g}"


def _check_status(status: Status, cost: float | None, bound: float | None) -> Claim:
    planned = status in (Status.OPTIMAL, Status.SOLVED)
    if planned != (cost is not None):
        words = f"{status} {'needs' if planned else 'does not go with'} a plan and its cost"
        return Claim("status", Outcome.FAILS, words, ARITHMETIC)
    if status is Status.OPTIMAL and cost is not None:
        meets = bound is not None and cost - bound <= tolerance(cost)
        words = "optimal, and the bound does not meet the cost"
        return _make_claim("status", meets, "optimal: the bound meets the cost", words, ARITHMETIC)
    return Claim("status", Outcome.HOLDS, str(status), ARITHMETIC)


def _check_plan(
    stored: StoredClaims, walked: Replay | None, model: SkillModel, expected: PolicyValue | None
) -> Iterator[Claim]:
    task = model.task
    if walked is None:
        try:
            for name in stored.skills:
                task.skill(name)
        except OptionError as error:
            yield Claim("plan", Outcome.FAILS, f"is not one of this task: {error}", REPLAY)
        return
    detail = f"{len(stored.skills)} skills lead to the goal"
    if walked.violations:
        fault = walked.violations[0]
        where = f"step {fault.step + 1} ({fault.skill})" if fault.skill else "the end"
        detail = f"fails at {where}: {fault.stage}: {fault.reason}"
    yield _make_claim("plan", not walked.violations, detail, detail, REPLAY)
    yield _check_steps(stored, walked)
    if walked.violations or stored.cost is None:
        return
    if not task.deterministic:
        if expected is None:
            return
        same = expected.cost is not None and abs(stored.cost - expected.cost) <= 1e-9 * max(
            1.0, expected.cost
        )
        words = (
            expected.problem or f"the policy is expected to cost {_format_figure(expected.cost)}"
        )
        bad = f"{words}, claimed {_format_figure(stored.cost)}"
        yield _make_claim(
            "cost", same, f"{_format_figure(expected.cost)} {stored.cost_unit}", bad, EXPECTATION
        )
        return
    same = abs(stored.cost - walked.cost) <= tolerance(walked.cost)
    good = f"{_format_figure(walked.cost)} {stored.cost_unit}".rstrip()
    bad = f"the plan costs {_format_figure(walked.cost)}, claimed {_format_figure(stored.cost)}"
    yield _make_claim("cost", same, good, bad, REPLAY)


def _check_steps(stored: StoredClaims, walked: Replay) -> Claim:
    """Check that the places of a document that repeat a figure agree."""
    n = len(stored.skills)
    fault = ""
    if not len(stored.actions) == len(stored.steps) == stored.makespan == n:
        fault = "skills, actions, steps and makespan are not as many"
    for claimed, step in zip(stored.steps, walked.steps, strict=False):
        place = f"step {step.index + 1}: "
        action = stored.actions[step.index] if step.index < len(stored.actions) else None
        if (claimed.index, claimed.skill) != (step.index, step.skill):
            fault = fault or f"{place}is {step.skill} among skills, {claimed.skill} among steps"
        elif not claimed.action == action == step.action:
            fault = fault or f"{place}{step.skill} is action {step.action}, not {claimed.action}"
        elif abs(claimed.cost - step.cost) > tolerance(step.cost):
            figures = f"{_format_figure(step.cost)}, not {_format_figure(claimed.cost)}"
            fault = fault or f"{place}{step.skill} costs {figures}"
        elif abs(claimed.duration_s - step.duration_s) > SAME_TIME_S:
            figures = (
                f"{_format_figure(step.duration_s)} s, not {_format_figure(claimed.duration_s)} s"
            )
            fault = fault or f"{place}{step.skill} takes {figures}"
        elif abs(claimed.wait_s - step.wait_s) > SAME_TIME_S:
            figures = f"{_format_figure(step.wait_s)} s, not {_format_figure(claimed.wait_s)} s"
            fault = fault or f"{place}{step.skill} waits {figures}"
        elif claimed.way != step.way:
            ways = f"{step.way or 'its only way'}, not {claimed.way or 'its only way'}"
            fault = fault or f"{place}{step.skill} goes {ways}"
    return _make_claim("steps", not fault, "as replayed, one by one", fault, REPLAY)


def _check_proofs(
    stored: StoredClaims, model: SkillModel, stop: Stop, domain: Domain | None, *, unpriced: bool
) -> Iterator[Claim]:
    """Yield the claims about all plans, compared with the least cost if a method finds it.

    Parameters
    ----------
    stored, model, stop, domain
        As in `check_claims`.
    unpriced
        True if the cost is an expectation whose policy is missing.
    """
    bound = math.inf if stored.status is Status.INFEASIBLE else stored.lower_bound
    if bound is None and not unpriced:
        return
    second = None
    if bound is not None and domain is not None:
        second = domain.second_bound(model.task)
    if bound is not None and second is not None:
        cost, method = second
        if bound <= cost + tolerance(min(cost, bound)):
            words = f"no plan costs less than {_format_figure(cost)}"
            words = "there is no plan" if math.isinf(cost) else words
            yield Claim(_name_proof(stored), Outcome.HOLDS, words, method)
            return
    least_cost = _find_least_cost(stored, model, stop)
    if bound is not None:
        yield _check_bound(stored, bound, least_cost, model)
    if unpriced:
        yield _check_cost_without_policy(stored, least_cost)


def _make_unproved(stored: StoredClaims, least_cost: LeastCost) -> Claim:
    """Return the claim of a proof that was not repeated."""
    name = _name_proof(stored)
    return Claim(name, Outcome.NOT_CHECKED, least_cost.why_not, least_cost.method, open=False)


def _check_cost_without_policy(stored: StoredClaims, least_cost: LeastCost) -> Claim:
    """Return the claim of an expected cost, compared with the least expected cost."""
    claimed = stored.cost
    assert claimed is not None
    if least_cost.cost is None:
        words = f"is expected over all outcomes, and the policy is missing; {least_cost.why_not}"
        return Claim("cost", Outcome.NOT_CHECKED, words, least_cost.method, open=False)
    optimum, stated = _format_figure(least_cost.cost), _format_figure(claimed)
    figures = f"the least expected cost is {optimum}, claimed {stated}"
    allowed = tolerance(min(least_cost.cost, claimed))
    optimal = stored.status is Status.OPTIMAL
    if claimed < least_cost.cost - allowed or (optimal and claimed > least_cost.cost + allowed):
        return Claim("cost", Outcome.FAILS, figures, least_cost.method)
    if optimal:
        return Claim("cost", Outcome.HOLDS, figures, least_cost.method)
    words = f"is expected over all outcomes, and the policy is missing; {figures}"
    return Claim("cost", Outcome.NOT_CHECKED, words, least_cost.method, open=False)


def _check_bound(
    stored: StoredClaims, bound: float, least_cost: LeastCost, model: SkillModel
) -> Claim:
    """Return the claim that no plan costs less than a bound; infinite if there is none."""
    if least_cost.cost is None:
        return _make_unproved(stored, least_cost)
    holds = bound <= least_cost.cost + tolerance(min(least_cost.cost, bound))
    good = "there is no plan"
    if not math.isinf(least_cost.cost):
        words = "no plan costs less than" if least_cost.is_bound else "the least cost is"
        good = f"{words} {_format_figure(least_cost.cost)}"
    claimed = "that there is no plan" if math.isinf(bound) else f"at least {_format_figure(bound)}"
    bad = f"claimed is {claimed}; {good}"
    if least_cost.skills:
        bad += f": {','.join(str(model.task.action(skill)) for skill in least_cost.skills)}"
    return _make_claim(_name_proof(stored), holds, good, bad, least_cost.method)


def _name_proof(stored: StoredClaims) -> str:
    return str(stored.status) if stored.status in _PROVED else "lower bound"


def _find_least_cost(stored: StoredClaims, model: SkillModel, stop: Stop) -> LeastCost:
    """Return the least cost by another method than the claimed one, if one fits.

    The same method in other code is the last resort.
    """
    if not model.task.deterministic:
        return _find_least_expected_cost(model, stop)
    by_orders = "dynamic program" in stored.bound_method or stored.solver == "subset-dp"
    expensive = any(back_end.expensive for back_end in model.feasibility.back_ends)
    if expensive:
        # Jobs are recognised from verdicts on all orders, which may exceed the time limit.
        return find_least_cost_of_states(model, stop)
    first, second = (
        (_search_states, _search_orders) if by_orders else (_search_orders, _search_states)
    )
    first_answer = first(model, stop)
    if first_answer.cost is not None:
        return first_answer
    relaxed = _relax_orders(model, stop)
    if relaxed is not None and stored.lower_bound is not None:
        allowed = tolerance(min(relaxed, stored.lower_bound))
        if stored.lower_bound <= relaxed + allowed:
            return LeastCost(RELAXATION, relaxed, is_bound=True)
    other = second(model, stop)
    if other.cost is not None:
        return other
    why = f"{first_answer.why_not}; {other.method}: {other.why_not}"
    return LeastCost(first_answer.method, why_not=why)


def _search_states(model: SkillModel, stop: Stop) -> LeastCost:
    return find_least_cost_of_states(model, stop)


def _search_orders(model: SkillModel, stop: Stop) -> LeastCost:
    """Return the least cost over orders of jobs; the plan must also hold on the model."""
    from skillplan.model.sequencing import SequencingProblem

    if model.task.counts_waits:
        return LeastCost(ORDERS, why_not="waits for arriving parts depend on more than two jobs")
    try:
        problem = SequencingProblem.from_model(model)
    except (NotASequencing, SearchStopped) as error:
        return LeastCost(ORDERS, why_not=f"{error}".rstrip("."))
    answer = find_least_cost_of_orders(problem, stop)
    if answer.cost is None or math.isinf(answer.cost):
        return answer
    walked = replay(model, [model.task.skill(name) for name in answer.skills])
    if not walked.complete or abs(walked.cost - answer.cost) > tolerance(walked.cost):
        return LeastCost(ORDERS, why_not="its plan does not hold on the model")
    return answer


def _relax_orders(model: SkillModel, stop: Stop) -> float | None:
    """Return a lower bound from the orders of jobs, or None."""
    from skillplan.model.sequencing import SequencingProblem

    if model.task.counts_waits:
        return None
    try:
        problem = SequencingProblem.from_model(model)
    except (NotASequencing, SearchStopped):
        return None
    return find_bound_of_orders(problem, stop) if problem.jobs else None


def _find_least_expected_cost(model: SkillModel, stop: Stop) -> LeastCost:
    from skillplan.model.tabular_mdp import compute_least_expected_cost

    try:
        least_cost = compute_least_expected_cost(model, _CHANCE_STATES, stop)
    except ModelTooLarge:
        return LeastCost(EXPECTATION, why_not=f"too large, more than {_CHANCE_STATES:,} states")
    if model.stats.unknown:
        return LeastCost(EXPECTATION, why_not="some verdicts are unknown")
    if least_cost is None:
        return LeastCost(EXPECTATION, why_not="did not come to an end")
    return LeastCost(EXPECTATION, least_cost)
