"""Proofs of the optima of the benchmark, by two codes that share nothing but the model of the task.

The first code is a solver of skillplan. The second one is Fast Downward, which gets PDDL; CP-SAT;
or value iteration over all states.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

from skillplan.benchmark.agents import find_version, is_learner, make_agent
from skillplan.benchmark.instances import PROOF_GAP, Instance, Proof, Spread
from skillplan.errors import OptionError, SkillplanError
from skillplan.pipeline import registry
from skillplan.pipeline.solving import SearchRequest, grade, search
from skillplan.records.result import Result, Status
from skillplan.solvers.solution import relative_gap
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task

# Solvers that prove a task first, without and with chance.
_FIRST = (("auto",), ("job-values", "policy-iteration"))
# Codes that prove it again, the most independent first.
_SECOND = (("fast-downward", "cp-sat", "value-iteration"), ("value-iteration",))
# Solvers that share the sweep over all states with value iteration.
_SAME_CODE = {"policy-iteration": "value-iteration"}
# Fast Downward proves few tasks with more skills within a minute.
_MOST_SKILLS_IN_PDDL = 40
NOISE_LEARNERS = ("random", "q-learning")
"""Learners whose spread over seeds is the noise floor of a learning task."""
_NOISE_RUNS = 10
# Steps end a run of the random agent, so that its result does not depend on the machine.
_NOISE_LIMIT_S = 30.0
_NOISE_STEPS = 2_000


def prove(instance: Instance, limit_s: float) -> Instance:
    """Return an instance with its optimum, as far as it is proved.

    Parameters
    ----------
    limit_s
        Time limit of every code [s], > 0.

    Raises
    ------
    SkillplanError
        If two codes contradict each other.
    OptionError, TaskError
        If the instance has faults.
    """
    known: dict[str, object] = {"sha256": "", "status": "open", "optimum": None, "proofs": []}
    fresh = instance.model_copy(update=known)
    task = fresh.load()
    proofs: list[tuple[Proof, Result]] = []
    chance = not task.deterministic
    for name in (*_FIRST[chance], *_SECOND[chance]):
        is_second = bool(proofs) and _SAME_CODE.get(proofs[0][0].by) != name
        if is_second != (name in _SECOND[chance]) or not _is_useful(name, task):
            continue
        result = run(fresh, task, name, limit_s)
        if not is_proved(result):
            continue
        proof = Proof(
            by=name,
            version=find_version(name),
            method="" if result.bound_method == name else result.bound_method,
            cost=result.cost or 0.0,
            wall_s=round(result.wall_s, 3),
        )
        proofs.append((proof, result))
        if len(proofs) == 2:
            break
    update: dict[str, object] = {"sha256": task.sha256, "unit": task.metric.unit}
    if proofs:
        _check_agreement(instance.name, [result for _, result in proofs])
        first = proofs[0][1]
        is_infeasible = first.status is Status.INFEASIBLE
        costs = [result.cost for _, result in proofs if result.cost is not None]
        update |= {
            "status": "infeasible" if is_infeasible else "optimal",
            "optimum": min(costs, default=None),
            "proofs": [proof for proof, _ in proofs],
        }
    return fresh.model_copy(update=update)


def measure_noise(instance: Instance, tick: Callable[[], None] = lambda: None) -> Instance:
    """Return a learning task with the spread that seeds alone give to a learner's result.

    Parameters
    ----------
    tick
        Called after every run.
    """
    spreads = []
    task = instance.load()
    for name in NOISE_LEARNERS:
        results = []
        for seed in range(_NOISE_RUNS):
            results.append(run(instance, task, name, _NOISE_LIMIT_S, seed, _NOISE_STEPS))
            tick()
        if all(result.status is Status.REFUSED for result in results):
            continue
        gaps = [measure_gap(result.cost, instance.optimum) for result in results]
        spreads.append(
            Spread(
                agent=name,
                runs=len(results),
                solved=statistics.fmean(result.cost is not None for result in results),
                gap=statistics.fmean(gaps),
                gap_sd=statistics.stdev(gaps),
                time_limit_s=_NOISE_LIMIT_S,
            )
        )
    return instance.model_copy(update={"noise": spreads})


def run(
    instance: Instance, task: Task, agent: str, limit_s: float, seed: int = 0, steps: int = 10_000
) -> Result:
    """Run an agent on a task and have its answer judged; a failure is a failed result."""
    # Made before the clock starts, because imports are not part of a run.
    ready = make_agent(agent, steps)
    solver = agent if agent in registry.names("solver") else ready
    stop = Stop(time_limit_s=limit_s)
    request = SearchRequest(task, solver, instance.setup, seed, stop)
    return grade(request, search(request))


def measure_gap(cost: float | None, optimum: float | None) -> float:
    """Return the gap of a cost to the optimum as a fraction of the cost; 1 without a plan."""
    gap = relative_gap(cost, optimum)
    return 1.0 if gap is None else gap if gap > PROOF_GAP else 0.0


def is_proved(result: Result) -> bool:
    """Return whether the gap of a result is closed, up to the rounding of a planner."""
    if result.status is Status.INFEASIBLE:
        return True
    return result.gap is not None and result.gap <= PROOF_GAP


def _is_useful(name: str, task: Task) -> bool:
    if name == "fast-downward":
        return len(task.skills) <= _MOST_SKILLS_IN_PDDL
    return name in registry.names("solver") and not is_learner(name)


def _check_agreement(name: str, results: Sequence[Result]) -> None:
    costs = [result.cost for result in results]
    known = [cost for cost in costs if cost is not None]
    agree = len(known) in (0, len(costs))
    if agree and (not known or max(known) - min(known) <= PROOF_GAP * max(1.0, max(known))):
        return
    words = " and ".join(f"{result.solver} proves {result.cost}" for result in results)
    raise SkillplanError(f"{name}: two codes contradict each other: {words}.")


def check_provers() -> None:
    """Check that the codes of a second proof are installed.

    Raises
    ------
    OptionError
        If one is missing.
    """
    make_agent("fast-downward", 1)
    if "cp-sat" not in registry.names("solver"):
        raise OptionError("cp-sat is missing. Install it with: pip install skillplan-ortools.")
