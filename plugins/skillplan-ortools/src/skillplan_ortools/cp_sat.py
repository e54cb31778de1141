"""The order of jobs by constraint programming: OR-Tools' CP-SAT.

Perron, Didier and Gay, "The CP-SAT-LP solver", CP 2023: lazy clause generation, with linear
relaxations and large neighbourhood search. It shares only the sequencing problem with skillplan's
own solvers.
"""

from __future__ import annotations

from typing import Any

from pydantic import Field

from skillplan.model.sequencing import SequencingProblem
from skillplan.solvers.ordering.solver import JobOrderSolver
from skillplan.solvers.solution import Plan, Solution
from skillplan.task import back_end
from skillplan_ortools.order_circuit import OrderCircuit
from skillplan_ortools.watched_search import SearchOutcome, WatchedSearch
from skillplan_ortools.whole_costs import WholeCosts

_METHOD = "constraint programming (CP-SAT)"
# Tolerance between cost and bound of a proof, as a fraction of the cost or of 1.
_PROOF_TOLERANCE = 1e-9


class CpSatSolver(JobOrderSolver):
    """Prove the cheapest order of jobs by constraint programming (OR-Tools' CP-SAT); anytime."""

    name = "cp-sat"

    class Options(back_end.Options):
        """Options of the solver."""

        workers: int | None = Field(
            default=None,
            ge=1,
            le=256,
            description="threads; deterministic with 1; default: the number of jobs [-]",
        )
        interleave: bool = Field(
            default=True,
            description="interleave many strategies in one worker: tighter bounds, often more "
            "expensive plans [-]",
        )
        start: bool = Field(
            default=True,
            description="start with an order that always takes the cheapest next job [-]",
        )

    options: Options

    def search(self, problem: SequencingProblem, seed: int) -> Solution:
        """Search for the cheapest order, and report every improvement at once."""
        return _OrderSearch(self, problem, seed).solution()


class _OrderSearch:
    """A search: the problem, and its best order so far."""

    def __init__(self, solver: CpSatSolver, problem: SequencingProblem, seed: int) -> None:
        self._problem = problem
        self._network = WholeCosts(problem)
        self._stop = solver.stop
        self._start = solver.options.start
        self._workers = solver.options.workers or solver.jobs
        self._interleave = solver.options.interleave
        self._seed = seed % (1 << 31)
        self._order: tuple[int, ...] | None = None
        self._plan: Plan | None = None
        self._bound: float | None = None
        self._branches = 0
        self._conflicts = 0

    def solution(self) -> Solution:
        """Search without the step limit first, which is a relaxation.

        If the cheapest order exceeds the step limit, the limit becomes a constraint. Proofs then
        hold only for the cheapest paths between jobs, so the bound is kept.
        """
        self._begin()
        outcome = self._search(None)
        complete = outcome.complete
        if complete and outcome.order is not None and not self._problem.fits(outcome.order):
            outcome = self._search(self._problem.step_limit)
        plan, bound = self._plan, self._bound
        proved = (
            complete
            and plan is not None
            and plan.cost is not None
            and bound is not None
            and plan.cost - bound <= _PROOF_TOLERANCE * max(1.0, abs(plan.cost))
        )
        trace = self._trace("proof" if proved else self._stop.reason or "without a proof")
        if outcome.impossible:
            within = f" whose plan has {self._problem.step_limit} skills at most"
            trace["reason"] = f"there is no order of the jobs{within if complete else ''}"
        return Solution(plan, bound, proved=proved, trace=trace)

    def _begin(self) -> None:
        """Use the cheaper one of the present plan and the nearest-job order."""
        if self._stop.best is not None:
            self._take(self._problem.order(self._stop.best.skills))
        if self._start:
            self._take(self._network.nearest_order())

    def _search(self, most_skills: int | None) -> SearchOutcome:
        circuit = OrderCircuit(self._network, most_skills)
        if self._order is not None:
            circuit.suggest(self._order)
        search = WatchedSearch(
            circuit, workers=self._workers, seed=self._seed, interleave=self._interleave
        )
        relaxed = most_skills is None
        outcome = search.run(self._stop, self._take, self._prove if relaxed else _ignore)
        self._branches += outcome.branches
        self._conflicts += outcome.conflicts
        return outcome

    def _take(self, order: tuple[int, ...] | None) -> None:
        """Keep an order if its plan is the cheapest so far and within the step limit."""
        if order is None or not self._network.allows(order) or not self._problem.fits(order):
            return
        cost = self._problem.cost(order)
        if self._plan is None or self._plan.cost is None or cost < self._plan.cost:
            self._order = order
            self._plan = Plan(self._problem.plan(order), cost)
            self._stop.incumbent(self._plan)

    def _prove(self, bound: float) -> None:
        """Keep a bound on the whole cost."""
        self._bound = max(0.0, self._network.in_problem_units(bound))
        self._stop.bound(self._bound)

    def _trace(self, ended: str) -> dict[str, Any]:
        return {
            "bound_method": _METHOD,
            "expanded": self._branches,
            "conflicts": self._conflicts,
            "jobs": self._network.n,
            "arcs": len(self._network.arcs),
            "workers": self._workers,
            "ended": ended,
        }


def _ignore(bound: float) -> None:
    """Drop a bound that holds only under an additional constraint."""
