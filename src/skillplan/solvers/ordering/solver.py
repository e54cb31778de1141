"""Solvers for models that are a sequential ordering problem, one for each method.

`model.sequencing` defines jobs and recognises such models. numpy, numba and HiGHS are imported with
the first model.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Final

from pydantic import Field

from skillplan.errors import NotASequencing, SearchStopped
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.task import back_end
from skillplan.workers.processes import get_available_bytes

if TYPE_CHECKING:
    from skillplan.model.relaxed_sequencing import RelaxedSequencing
    from skillplan.model.sequencing import SequencingProblem
    from skillplan.solvers.ordering.portfolio import Method, OrderingSearch

# Methods for problems in which two kinds of jobs alternate, such as taking and filling of
# interchangeable parts. Local search moves single jobs, after which no order has a finite cost;
# tree search works, but branch and cut proves most of them at its root.
_ALTERNATING: Final[tuple[Method, ...]] = ("branch-and-cut",)

# Share of the free memory that is used without a limit.
_SHARE = 0.7

# Share of the time in which a problem is derived, if it may be relaxed instead.
_DERIVED_SHARE = 0.25
# Least expected time of a check of a slow back end [s].
_SLOW_S = 1e-3


class JobOrderSolver(Solver):
    """Base of the solvers of sequential ordering problems; refuses other models.

    Attributes
    ----------
    serves_pools
        True if it solves problems in which jobs of interchangeable parts alternate.
    relaxes
        True if it solves relaxed problems, so that a derivation that takes long is ended.
    """

    polls = True
    serves_pools: ClassVar[bool] = True
    relaxes: ClassVar[bool] = False

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason why the model is not a sequencing problem, or None.

        A model without any order is accepted: the answer is the obstacle.
        """
        try:
            problem = self.problem(model)
            if problem.assigned and not self.serves_pools:
                return f"{self.name} does not assign interchangeable parts. Take portfolio."
        except SearchStopped:
            # The search will end for the same reason and return its results.
            return None
        except NotASequencing as error:
            try:
                if self.relax(model) is not None or _find_obstacle(model) is not None:
                    return None
            except SearchStopped:
                return None
            instead = "exact" if model.task.deterministic else "value-iteration"
            return f"{self.name} puts jobs into an order, and {error} Take {instead}."
        return None

    def problem(self, model: SkillModel) -> SequencingProblem:
        """Return a model as a sequencing problem, derived once.

        Raises
        ------
        NotASequencing
            If it is none.
        """
        from skillplan.model.sequencing import SequencingProblem

        known = getattr(self, "_known", None)
        if known is None or known[0] is not model:
            derived: SequencingProblem | NotASequencing
            try:
                derived = SequencingProblem.from_model(model, self._limit_derivation(model))
            except NotASequencing as error:
                derived = error
            self._known = known = (model, derived)
        if isinstance(known[1], NotASequencing):
            raise known[1]
        sequencing_problem: SequencingProblem = known[1]
        return sequencing_problem

    def _limit_derivation(self, model: SkillModel) -> Callable[[], bool]:
        """Return a function that returns True once the time of the derivation is over.

        There is no limit if every back end is quick, as the derivation is then.
        """
        is_slow = any(end.expected_s >= _SLOW_S for end in model.feasibility.back_ends)
        left_s = self.stop.left_s if self.relaxes and is_slow else None
        if left_s is None:
            return lambda: False
        until_s = time.monotonic() + _DERIVED_SHARE * left_s
        return lambda: time.monotonic() > until_s

    def relax(self, model: SkillModel) -> RelaxedSequencing | None:
        """Return a model as a relaxed sequencing problem; None if the solver solves none."""
        return None

    def solve_relaxed(self, model: SkillModel, seed: int) -> Solution | None:
        """Search for the cheapest order that is a plan; None without a relaxed problem."""
        return None

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Search for the cheapest order, and for a proof that none is cheaper.

        Raises
        ------
        NotASequencing
            If the model is not a sequencing problem; `refuses` returns the reason before.
        """
        try:
            problem = self.problem(model)
        except NotASequencing:
            solution = self.solve_relaxed(model, seed)
            if solution is not None:
                return solution
            reason = _find_obstacle(model)
            if reason is None:
                raise
            return Solution(trace={"reason": reason, "ended": "no order"})
        if not problem.jobs:
            return Solution(Plan((), 0.0), 0.0, proved=True, trace={"bound_method": "no job"})
        return self.search(problem, seed)

    @abstractmethod
    def search(self, problem: SequencingProblem, seed: int) -> Solution:
        """Search a problem of at least one job."""


class SequencingSolver(JobOrderSolver):
    """Base of the solvers that run methods of the portfolio.

    Attributes
    ----------
    methods
        Methods in use; empty for all.
    """

    methods: ClassVar[tuple[Method, ...]] = ()
    relaxes = True

    class Options(back_end.Options):
        """Limits of the search."""

        rounds: int | None = Field(
            default=None,
            ge=1,
            le=64,
            description="greatest number of rounds, each with twice the effort of the one "
            "before; left out: until there is a proof [-]",
        )

    options: Options

    def search(self, problem: SequencingProblem, seed: int) -> Solution:
        """Search with the methods; every better plan and bound is reported at once."""
        from skillplan.solvers.ordering.instance import JobOrders
        from skillplan.solvers.ordering.portfolio import METHODS, OrderingSearch

        orders = JobOrders(problem)
        best: list[Plan] = []

        def on_order(order: Any, cost: float) -> None:
            jobs = orders.jobs(order)
            if problem.fits(jobs):
                best.append(Plan(problem.plan(jobs), problem.cost(jobs)))
                self.stop.incumbent(best[-1])

        start = None
        if self.stop.best is not None:
            jobs = problem.order(self.stop.best.skills)
            start = None if jobs is None else orders.nodes(jobs)
        helpers = None
        if self.jobs > 1:
            from skillplan.solvers.ordering.parallel_search import Helpers

            executor = None if self.make_executor is None else self.make_executor(self.jobs - 1)
            helpers = Helpers(
                self.jobs - 1, seed, executor, self._memory_bytes, lambda: self.stop.left_s
            )
        search = OrderingSearch(
            orders.instance,
            self.methods or (_ALTERNATING if problem.assigned else METHODS),
            seed=seed,
            stop=self.stop,
            on_order=on_order,
            on_bound=self.stop.bound,
            memory_bytes=self._memory_bytes,
            start=start,
            rounds=self.options.rounds,
            helpers=helpers,
        )
        search.run()
        if search.ended:
            self.stop.end(search.ended)
        solution = self._solution(search, best[-1] if best else None)
        trace = {} if helpers is None else helpers.trace
        return replace(solution, trace={**solution.trace, **trace})

    def relax(self, model: SkillModel) -> RelaxedSequencing | None:
        """Return a model as a relaxed sequencing problem, derived once; None if it is none."""
        from skillplan.model.relaxed_sequencing import RelaxedSequencing

        known = getattr(self, "_relaxed", None)
        if known is None or known[0] is not model:
            try:
                relaxed = RelaxedSequencing(model)
            except NotASequencing:
                relaxed = None
            self._relaxed = known = (model, relaxed)
        relaxation: RelaxedSequencing | None = known[1]
        return relaxation

    def solve_relaxed(self, model: SkillModel, seed: int) -> Solution | None:
        """Search for the cheapest order that is a plan; better plans are reported at once."""
        from skillplan.solvers.ordering.checked_orders import CheckedOrders
        from skillplan.solvers.ordering.portfolio import METHODS

        relaxed = self.relax(model)
        if relaxed is None:
            return None
        methods, rounds = self.methods or METHODS, self.options.rounds
        search = CheckedOrders(relaxed, methods, self.stop, self._memory_bytes, seed, rounds)
        solution = search.run()
        reason = None if solution.plan or not solution.proved else _find_obstacle(model)
        if reason is None:
            return solution
        return replace(solution, trace={**solution.trace, "reason": reason})

    def _solution(self, search: OrderingSearch, plan: Plan | None) -> Solution:
        effort = search.effort
        bound: float | None = max(0.0, search.bound)
        # The plan of the cheapest order may exceed the step limit: then its cost is only a bound.
        met = plan is not None and plan.cost is not None and plan.cost <= search.cost * (1 + 1e-12)
        proved = search.proved and met
        if proved and plan is not None and plan.cost is not None:
            bound = plan.cost
        trace: dict[str, Any] = {
            "bound_method": effort.bound_method,
            "expanded": effort.nodes,
            "jobs": search.instance.n - 1,
            "rounds": effort.rounds,
            "states": effort.states,
            "parts": effort.parts,
            "programs": effort.programs,
            "ended": "proof" if proved else self.stop.reason or "without a proof",
        }
        if search.proved and search.order is None:
            trace["reason"], bound = "there is no order of the jobs", None
        elif search.proved and not met:
            trace["reason"] = (
                "the plan of the cheapest order has more skills than the step limit allows; "
                "take exact"
            )
        return Solution(plan, bound, proved=proved, trace=trace)

    def _memory_bytes(self) -> int | None:
        left = self.stop.memory_left_bytes()
        if left is None:
            free = get_available_bytes()
            return None if free is None else int(_SHARE * free)
        return left


class PortfolioSolver(SequencingSolver):
    """All methods in turns, which share incumbents, bounds and fixed arcs."""

    name = "portfolio"


class SubsetDpSolver(SequencingSolver):
    """Bidirectional dynamic programming over feasible subsets; proves where precedence is tight."""

    name = "subset-dp"
    serves_pools = False
    methods = ("subset-dp",)


class TreeSearchSolver(SequencingSolver):
    """Beam search over feasible subsets with completion bounds; ever wider, until it is a proof."""

    name = "tree-search"
    methods = ("tree-search",)


class LocalSearchSolver(SequencingSolver):
    """Ruin and recreate (SISR) with simulated annealing; the linear relaxation is its bound."""

    name = "local-search"
    serves_pools = False
    methods = ("local-search",)

    class Options(SequencingSolver.Options):
        """Limits of the search."""

        rounds: int | None = Field(
            default=6,
            ge=1,
            le=64,
            description="greatest number of rounds, each with twice the effort of the one "
            "before; null: no limit [-]",
        )


class BranchAndCutSolver(SequencingSolver):
    """Branch and cut with precedence cuts; proves where precedence is loose."""

    name = "branch-and-cut"
    methods = ("branch-and-cut",)


def _find_obstacle(model: SkillModel) -> str | None:
    """Return the obstacle to every order of a small task in words, or None."""
    from skillplan.chart.precedence_chart import derive_chart

    task = model.task
    if not task.deterministic or len(task.operations) > 64:
        return None
    return derive_chart(model.feasibility).obstacle(task)
