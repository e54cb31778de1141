"""Replanning: plan as if skills succeeded, follow the plan, plan anew after a failure.

FF-Replan (Yoon, Fern and Givan, "FF-Replan: a baseline for probabilistic planning", 2007). Here a
skill that may fail has its average cost until it succeeds, if it is tried again at once. So a plan
has the expected cost of following it without replanning, and planning anew can only save (a step of
policy improvement: Bertsekas, Tsitsiklis and Wu, "Rollout algorithms for combinatorial
optimization", 1997). A second plan, whose failures cost no more than the least detour, is a lower
bound for every policy.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import Field

from skillplan.model.policy_value import PolicySample, sample_policy
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.chance.adaptive_search import AdaptiveSearch
from skillplan.solvers.chance.retries import (
    assume_retries,
    collect_touched,
    query_everywhere,
    refuse_retries,
    relax,
)
from skillplan.solvers.solution import Solution
from skillplan.solvers.solver import Solver
from skillplan.task import back_end
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

if TYPE_CHECKING:
    from skillplan.solvers.chance.job_sets import OrdersAhead

# Savings up to this sum of rounding errors do not count.
_ROUNDING = 1e-12


class Replanning(Mapping[State, Skill]):
    """A policy that plans anew in every state outside earlier plans.

    Parameters
    ----------
    lookahead
        True to weigh skills that may fail by the cost of a new plan after the failure.
    """

    def __init__(self, search: AdaptiveSearch, model: SkillModel, *, lookahead: bool) -> None:
        self._search, self._model, self._lookahead = search, model, lookahead
        self._said: dict[State, Skill] = {}

    def __getitem__(self, state: State) -> Skill:
        skill = self._said.get(state)
        if skill is None:
            skill = None if self._model.is_goal(state) else self._search.skill(state)
            if skill is None:
                raise KeyError(state)
            skill = self._said[state] = self._weighed(state, skill) if self._lookahead else skill
        return skill

    def _weighed(self, state: State, planned: Skill) -> Skill:
        """Return the skill with the least cost if plans are made anew after it.

        Certain skills followed by a plan cost no less than the present plan, so only the plan's own
        skill
        is considered among them.
        """
        best = planned
        lowest = self._value(state, planned, math.inf)
        for skill in self._model.applicable(state):
            if skill is not planned and not skill.deterministic:
                value = self._value(state, skill, lowest)
                if value < lowest - _ROUNDING:
                    best, lowest = skill, value
        return best

    def _value(self, state: State, skill: Skill, most: float) -> float:
        """Return the cost of a skill and new plans after it; inf if it is at least `most`."""
        search, model = self._search, self._model
        cost = model.cost(state, skill)
        following = [
            (outcome.probability, outcome.apply(state)) for outcome in skill.outcomes_in(state)
        ]
        if cost + sum(share * search.bound(after) for share, after in following) >= most:
            return math.inf
        if not search.feasible(state, skill):
            return math.inf
        for share, after in following:
            to_go = search.cost(after)
            if to_go is None:
                return math.inf
            cost += share * to_go
        return cost

    def __iter__(self) -> Iterator[State]:
        return iter(list(self._said))

    def __len__(self) -> int:
        return len(self._said)


class ReplanSolver(Solver):
    """Plan as if skills were tried until they succeed; plan anew after a failure."""

    name = "replan"
    polls = True

    class Options(back_end.Options):
        """Limits of the searches, and number of roll-outs."""

        roll_outs: int = Field(
            default=2_000,
            ge=2,
            le=1_000_000,
            description="number of roll-outs to estimate the expected cost with its 95 % "
            "interval [-]",
        )
        policy_states: int = Field(
            default=5_000,
            ge=0,
            le=1_000_000,
            description="greatest number of states in which the policy is computed in advance; "
            "beyond, plans are made on demand [-]",
        )
        lookahead: bool = Field(
            default=True,
            description="weigh a skill that may fail by the costs of new plans after success "
            "and failure, instead of following the plan [-]",
        )
        max_labels: int = Field(
            default=2_000_000,
            ge=1,
            description="greatest number of labels of one search: 0.6 to 1 kB of memory each [-]",
        )
        weight: float = Field(
            default=1.0,
            ge=1.0,
            le=100.0,
            description="factor on the bound of the search; above 1, a first plan may cost this"
            " multiple of the least and is found much sooner; used only if `sets` "
            "is exceeded: 1.2 with more than 100,000 states [-]",
        )
        sets: int = Field(
            default=1_200_000,
            ge=0,
            le=100_000_000,
            description="greatest number of feasible sets of jobs for which costs to go are "
            "computed in advance, which finds plans at once; 8 bytes each for every"
            " job; 0 for none [-]",
        )
        bound_labels: int = Field(
            default=200_000,
            ge=0,
            description="greatest number of labels of the search for a lower bound on every "
            "policy; beyond, the least open cost is the bound; 0 for none [-]",
        )

    options: Options

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason why skills cannot be tried again or costs are unknown, or None."""
        if model.asks_costs:
            return "costs that back ends tell are not known before a search; take value-iteration"
        why = refuse_retries(model.task)
        return None if why is None else f"{why}: it cannot be tried again; take value-iteration"

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Plan from the initial state, then from all reachable states of the policy."""
        begin_s = time.perf_counter()
        bound, trace = self._bound(model)
        bound_s = time.perf_counter() - begin_s
        options, certain = self.options, assume_retries(model.task)
        ahead = self._ahead(model, certain)
        weight = options.weight if ahead is None else 1.0
        search = AdaptiveSearch(model, certain, self.stop, options.max_labels, weight, ahead)
        planned = search.cost(model.initial)
        if planned is None:
            why = (
                "no plan was found" if self.stop() else "no plan exists, or none within max_labels"
            )
            return Solution(None, bound, trace={**trace, "reason": why})
        plan_s = time.perf_counter() - begin_s - bound_s
        policy = Replanning(search, model, lookahead=self.options.lookahead)
        whole = query_everywhere(model, policy, options.policy_states, self.stop)
        sample = sample_policy(model, policy.get, seed, self.options.roll_outs, self.stop)
        trace |= {
            "planned_cost": planned,
            "determinisation": "every skill costs what it does on average until it succeeds",
            "expected_cost": None if sample is None else _build_document(sample),
            "policy_states": len(policy),
            "policy_complete": whole,
            "sets": None if ahead is None else ahead.sets,
            "searches": search.searches,
            "expanded": search.expanded,
            "states": search.expanded,
            "bound_s": bound_s,
            "plan_s": plan_s,
            "replan_s": time.perf_counter() - begin_s - bound_s - plan_s,
        }
        # Without chance the plan is the policy, and the two searches are the same.
        proved = (
            model.task.deterministic
            and whole
            and bound is not None
            and bound >= planned - _ROUNDING
            and len(policy) <= model.step_limit
        )
        return Solution(policy, planned if proved else bound, proved=proved, trace=trace)

    def _bound(self, model: SkillModel) -> tuple[float | None, dict[str, Any]]:
        """Return a lower bound on the expected cost of every policy, or None and the reason."""
        labels = self.options.bound_labels
        task = relax(model.task) if labels else None
        if task is None:
            why = "a failure might save something" if labels else "not asked for"
            return None, {"no_bound": why}
        ahead = self._ahead(model, task)
        search = AdaptiveSearch(model, task, self.stop, labels, ahead=ahead)
        cost = search.cost(model.initial)
        if cost is None and not search.floor:
            return None, {"no_bound": "there is no plan"}
        cost = search.floor if cost is None else cost
        bits = search.questions | (0 if ahead is None else ahead.questions)
        if bits & collect_touched(model.task):
            return None, {"no_bound": "verdicts rest on what a failure changes"}
        self.stop.bound(cost)
        return cost, {
            "bound_method": "search with every failure at its least detour",
            "bound_expanded": search.expanded,
        }

    def _ahead(self, model: SkillModel, certain: Task) -> OrdersAhead | None:
        """Return the costs to go of every state, if they can be computed."""
        # Imported here because it imports numpy.
        from skillplan.solvers.chance.job_sets import find_orders_ahead

        return find_orders_ahead(model, certain, self.options.sets, self.stop)


def _build_document(sample: PolicySample) -> dict[str, Any]:
    """Return the figures of roll-outs as JSON values."""
    if sample.problem is not None:
        return {"problem": sample.problem}
    low, high = sample.cost - sample.half_width, sample.cost + sample.half_width
    return {
        "value": sample.cost,
        "ci95": [low, high],
        "roll_outs": sample.roll_outs,
        "steps": sample.steps,
    }
