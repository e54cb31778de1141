"""Automatic choice of a solver, with the reason for the choice.

Nothing heavy is imported before exact search has failed to prove its optimum quickly, so that
small boards are solved at once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

from skillplan.errors import NotASequencing
from skillplan.model.skill_model import SkillModel
from skillplan.plugins.installed import registered
from skillplan.solvers.search.exact import ExactSolver
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.task import back_end

# Maximum numbers of operations, of labels and of checks for which exact search is tried first.
_SMALL = 24
_LABELS = 6_000
_CHECKS = 600
_SMALL_POOL = 5

# Share of the time in which orders are checked without a plan, before exact search.
_CHECKED_SHARE = 0.6

# Solver for several agents that move at once.
_FLEET = "fleet"

# With too many states for tables, replanning uses plans that are found much sooner.
_WEIGHT = 1.2


class AutoSolver(Solver):
    """Choose: exact where small, the portfolio for orders, fleet for agents, else exact again."""

    name = "auto"
    polls = True
    counts_waits = True

    class Options(back_end.Options):
        """No options: name a solver to set its options."""

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Solve with a solver that suits the model; ``choice`` in the trace gives the reason."""
        if not model.task.deterministic:
            from skillplan.solvers.mdp.value_iteration import ValueIterationSolver

            chosen: Solver = ValueIterationSolver(stop=self.stop)
            refusal = chosen.refuses(model)
            if refusal is not None:
                return self._beyond_tables(model, seed, refusal)
            return self._by(chosen, model, seed, "value-iteration, as skills may fail by chance")
        if model.task.counts_waits:
            return self._by(
                ExactSolver(stop=self.stop), model, seed, "exact, as parts arrive at a time"
            )
        # With many interchangeable parts, jobs without names are proved much sooner.
        pooled = max((len(pool.places) for pool in model.task.pools), default=0)
        small = len(model.task.operations) <= _SMALL and pooled <= _SMALL_POOL
        if small:
            trial = self._try_exact(model, seed)
            if trial.proved or self.stop():
                return _because(trial, "exact, as it is small")
        else:
            trial = Solution()
        from skillplan.solvers.ordering.solver import PortfolioSolver

        portfolio = PortfolioSolver(stop=self.stop)
        portfolio.jobs, portfolio.make_executor = self.jobs, self.make_executor
        try:
            portfolio.problem(model)
        except NotASequencing as error:
            fleet = self._fleet()
            if fleet is not None and fleet.refuses(model) is None:
                solution = self._by(fleet, model, seed, "fleet, as several agents move at once")
                return _with_bound(solution, trial)
            return _with_bound(self._check_orders(model, seed, error), trial)
        unproved = f"no proof by exact within {_LABELS:,} arrows or {_CHECKS} checks"
        after = unproved if small else "many jobs"
        if pooled > _SMALL_POOL:
            after = f"{pooled} interchangeable parts"
        solution = portfolio.solve(model, seed=seed)
        solution = _with_bound(solution, trial)
        solution = _because(solution, f"portfolio, as it puts jobs into an order; {after}")
        if solution.plan is None and not solution.proved and not self.stop():
            # Every order has too many skills; only exact search knows the step limit.
            return self._by(
                ExactSolver(stop=self.stop), model, seed, "exact, as the step limit binds"
            )
        return solution

    def _check_orders(self, model: SkillModel, seed: int, error: NotASequencing) -> Solution:
        """Solve a task in which not every order is a plan, or that puts no jobs in order."""
        from skillplan.solvers.ordering.solver import PortfolioSolver

        left_s = self.stop.left_s
        until_s = math.inf if left_s is None else time.monotonic() + _CHECKED_SHARE * left_s
        trial = Trial(self.stop, lambda: trial.best is None and time.monotonic() > until_s)
        checked = PortfolioSolver(stop=trial).solve_relaxed(model, seed)
        if checked is not None and (checked.plan is not None or checked.proved or self.stop()):
            return _because(checked, f"portfolio, which checks every order, as {error}")
        exact = self._by(ExactSolver(stop=self.stop), model, seed, f"exact, as {error}")
        return exact if checked is None else _with_bound(exact, checked)

    def _beyond_tables(self, model: SkillModel, seed: int, refusal: str) -> Solution:
        """Solve a task under chance that has too many states for tables."""
        from skillplan.solvers.chance.job_values_solver import JobValuesSolver
        from skillplan.solvers.chance.replan import ReplanSolver

        values = JobValuesSolver(stop=self.stop)
        if values.refuses(model) is None:
            why = "job-values, as skills may fail and jobs are put in order"
            return self._by(values, model, seed, why)
        replan = ReplanSolver(ReplanSolver.Options(weight=_WEIGHT), self.stop)
        if replan.refuses(model) is None:
            why = "replan, as skills may fail and there are too many states for tables"
            return self._by(replan, model, seed, why)
        return Solution(trace={"reason": refusal, "choice": "none fits"})

    def _fleet(self) -> Solver | None:
        """Return the solver for several agents, which a plugin provides; None without it."""
        for entry in registered("solver").select(name=_FLEET):
            solver: Solver = entry.load()(stop=self.stop)
            return solver
        return None

    def _try_exact(self, model: SkillModel, seed: int) -> Solution:
        """Run exact search with few labels and checks; its plan and its bound count in any case."""
        most = model.stats.checks + _CHECKS
        trial = Trial(self.stop, lambda: model.stats.checks >= most)
        options = ExactSolver.Options(max_labels=_LABELS)
        return ExactSolver(options, trial).solve(model, seed=seed)

    def _by(self, solver: Solver, model: SkillModel, seed: int, why: str) -> Solution:
        solver.jobs, solver.make_executor = self.jobs, self.make_executor
        return _because(solver.solve(model, seed=seed), why)


class Trial(Stop):
    """The stop of a trial search: passes plans and bounds on, but not its own limits.

    Parameters
    ----------
    whole
        The stop of the whole search.
    is_over
        True once the trial has to end.
    """

    def __init__(self, whole: Stop, is_over: Callable[[], bool]) -> None:
        super().__init__(memory_limit_bytes=whole.memory_limit_bytes)
        self._is_over = is_over
        self._whole = whole
        self.best = whole.best

    def __call__(self) -> bool:
        """Return whether the trial has ended, or the whole search is to stop."""
        return self._is_over() or super().__call__() or self._whole()

    def incumbent(self, plan: Plan) -> None:
        """Keep a plan, and pass it on."""
        super().incumbent(plan)
        self._whole.incumbent(plan)

    def bound(self, lower_bound: float, nodes: int | None = None) -> None:
        """Keep a bound, and pass it on."""
        super().bound(lower_bound, nodes)
        self._whole.bound(lower_bound, nodes)


def _with_bound(solution: Solution, trial: Solution) -> Solution:
    """Return a solution with the better of its own bound and the bound of the trial."""
    if trial.lower_bound is None or trial.lower_bound <= (solution.lower_bound or 0.0):
        return solution
    method = {"bound_method": trial.trace["bound_method"]}
    return replace(solution, lower_bound=trial.lower_bound, trace={**solution.trace, **method})


def _because(solution: Solution, why: str) -> Solution:
    return replace(solution, trace={**solution.trace, "choice": why})
