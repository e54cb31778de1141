"""The solver `job-values`: the least expected cost of ordering jobs, with proof."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from pydantic import Field

from skillplan.errors import NotASequencing
from skillplan.model.policy_value import evaluate_policy
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.chance.retries import (
    collect_touched,
    list_failures,
    query_everywhere,
    refuse_retries,
)
from skillplan.solvers.solution import Solution
from skillplan.solvers.solver import Solver
from skillplan.task import back_end

if TYPE_CHECKING:
    from skillplan.solvers.chance.job_values import JobValues

# Failure probability up to which a thousand tries multiply the rounding error: 1e-13 at most.
_CERTAIN_DIGITS = 0.999
_SAME_COST = 5e-10


class JobValuesSolver(Solver):
    """Work out the least expected cost over the sets of jobs that may be done; proves it."""

    name = "job-values"
    polls = True
    seeded = False

    class Options(back_end.Options):
        """Limits."""

        sets: int = Field(
            default=1_200_000,
            ge=1,
            le=100_000_000,
            description="greatest number of feasible sets of jobs: 8 bytes each for every job [-]",
        )
        policy_states: int = Field(
            default=5_000,
            ge=0,
            le=1_000_000,
            description="greatest number of states in which the policy is stored [-]",
        )

    options: Options

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason why the task does not order jobs that can be tried again, or None."""
        from skillplan.solvers.chance.job_sets import CertainModel, JobSets
        from skillplan.solvers.chance.job_values import relax_to_one_try

        if model.asks_costs:
            return "costs that back ends tell are not known before a search; take value-iteration"
        why = refuse_retries(model.task)
        if why is not None:
            return f"{why}: it cannot be tried again; take value-iteration"
        try:
            certain = CertainModel(model, relax_to_one_try(model.task))
            JobSets(certain, self.options.sets, self.stop)
        except NotASequencing as error:
            if self.stop() or _find_obstacle(model) is not None:
                return None
            return f"{str(error).rstrip('.')}; take replan"
        if certain.questions & collect_touched(model.task):
            return "verdicts rest on what a failure changes; take replan"
        return None

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Compute all values, and follow the policy through its reachable states."""
        from skillplan.solvers.chance.job_values import find_job_values

        begin_s = time.perf_counter()
        values = find_job_values(model, self.options.sets, self.stop)
        if values is None:
            why = (
                _find_obstacle(model)
                or "values were not worked out in time, or did not come to rest"
            )
            return Solution(trace={"reason": why})
        trace: dict[str, Any] = {
            "values_s": time.perf_counter() - begin_s,
            "sets": values.sets,
            "states": values.sets,
        }
        if values.cost == float("inf"):
            return Solution(trace={**trace, "reason": "there is no order of the jobs"})
        trace["policy_complete"] = query_everywhere(
            model, values, self.options.policy_states, self.stop
        )
        trace["policy_states"] = len(values)
        trace["bound_method"] = "Bellman's equations over all sets of jobs"
        self.stop.bound(values.cost)
        # Values ignore the step limit, which applies to a plan only.
        short = not model.task.deterministic or len(values) <= model.step_limit
        same = _has_least_cost(model, values, complete=bool(trace["policy_complete"]))
        return Solution(values, values.cost, proved=short and same, trace=trace)


def _has_least_cost(model: SkillModel, values: JobValues, *, complete: bool) -> bool:
    """Return True if the policy has the least cost, although rounding may hide it.

    Choices that differ by less than rounding differ by much once they are repeated.
    """
    shares = [
        failure.probability for skill in model.task.skills for failure in list_failures(skill)
    ]
    if max(shares, default=0.0) <= _CERTAIN_DIGITS:
        return True
    if not complete:
        return False
    own = evaluate_policy(model, values.get).cost
    return own is not None and abs(own - values.cost) <= _SAME_COST * max(1.0, values.cost)


def _find_obstacle(model: SkillModel) -> str | None:
    """Return the obstacle to every order of a task without chance, or None."""
    from skillplan.chart.precedence_chart import derive_chart

    task = model.task
    return derive_chart(model.feasibility).obstacle(task) if task.deterministic else None
