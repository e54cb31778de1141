"""A run of CP-SAT that can be stopped at any time, with sound results."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from ortools.sat.python import cp_model

from skillplan.solvers.stop import MEMORY_LIMIT, Stop
from skillplan_ortools.order_circuit import OrderCircuit

# Interval of checks of the run [s].
_WATCH_S = 0.02
# Free part of the memory limit: the next allocation may be large.
_FREE_MEMORY = 10


@dataclass(frozen=True, slots=True)
class SearchOutcome:
    """Result of a run.

    Parameters
    ----------
    order
        Best order, or None.
    bound
        Lower bound on the costs of all orders [integer units], or None.
    complete
        True if the run ended with a proof that the order is optimal.
    impossible
        True if the run ended with a proof that no order exists.
    branches, conflicts
        Effort of the run.
    """

    order: tuple[int, ...] | None
    bound: float | None
    complete: bool
    impossible: bool
    branches: int
    conflicts: int


class WatchedSearch:
    """Runs CP-SAT in a thread, watched by the calling thread.

    So signals reach the caller at once, all reports come from its thread, and it can repeat the
    request to stop: a run that has not begun to search ignores it. A stopped run may call itself
    optimal; only its earlier proofs count.

    Parameters
    ----------
    workers
        Number of threads, >= 1; deterministic with one.
    seed
        Seed, in [0, 2 ** 31).
    interleave
        True if one worker interleaves several strategies.
    """

    def __init__(
        self, circuit: OrderCircuit, *, workers: int, seed: int, interleave: bool = True
    ) -> None:
        self._circuit = circuit
        self._solver = cp_model.CpSolver()
        parameters = self._solver.parameters
        parameters.num_workers = workers
        parameters.random_seed = seed
        parameters.interleave_search = interleave and workers == 1
        # Probing takes seconds with many arcs, and fixes almost none.
        parameters.cp_model_probing_level = 0
        parameters.catch_sigint_signal = False
        self._orders: deque[tuple[int, ...]] = deque()
        self._proved_bound: float | None = None
        self._failure: BaseException | None = None
        self._status = cp_model.UNKNOWN
        self._stopped = False

    def run(
        self,
        stop: Stop,
        on_order: Callable[[tuple[int, ...]], None],
        on_bound: Callable[[float], None],
    ) -> SearchOutcome:
        """Search until the end or a stop.

        Parameters
        ----------
        stop
            Returns True to stop; called repeatedly.
        on_order
            Called with every better order.
        on_bound
            Called with every better bound [integer units].

        Raises
        ------
        RuntimeError
            If CP-SAT rejects the model.
        """
        thread = threading.Thread(target=self._solve, name="cp-sat", daemon=True)
        thread.start()
        best: tuple[int, ...] | None = None
        bound: float | None = None
        try:
            while True:
                thread.join(_WATCH_S)
                ended = not thread.is_alive()
                while self._orders:
                    best = self._orders.popleft()
                    on_order(best)
                proved = self._proved_bound
                if not self._stopped and proved is not None and (bound is None or proved > bound):
                    bound = proved
                    on_bound(bound)
                if ended:
                    break
                self._heed(stop)
        finally:
            while thread.is_alive():
                self._solver.stop_search()
                thread.join(_WATCH_S)
        if self._failure is not None:
            raise self._failure
        return self._outcome(best, bound, on_bound)

    def _solve(self) -> None:
        self._solver.best_bound_callback = self._take_bound
        try:
            collector = _Collector(self._circuit, self._orders)
            self._status = self._solver.solve(self._circuit.model, collector)
        except BaseException as error:  # handed over to the caller's thread
            self._failure = error

    def _take_bound(self, bound: float) -> None:
        if not self._stopped:
            self._proved_bound = bound

    def _heed(self, stop: Stop) -> None:
        """Stop the run on request, or if it uses too much memory."""
        left, limit = stop.memory_left_bytes(), stop.memory_limit_bytes
        if left is not None and limit is not None and left < limit // _FREE_MEMORY:
            stop.end(MEMORY_LIMIT)
        if stop():
            self._stopped = True
            self._solver.stop_search()

    def _outcome(
        self, order: tuple[int, ...] | None, bound: float | None, on_bound: Callable[[float], None]
    ) -> SearchOutcome:
        solver = self._solver
        if self._status == cp_model.MODEL_INVALID:
            raise RuntimeError(f"CP-SAT: {self._circuit.model.validate()}")
        complete = impossible = False
        if not self._stopped:
            if self._status in (cp_model.OPTIMAL, cp_model.FEASIBLE):
                own = solver.best_objective_bound
                complete = self._status == cp_model.OPTIMAL and own >= solver.objective_value
                if bound is None or own > bound:
                    bound = own
                    on_bound(bound)
            impossible = self._status == cp_model.INFEASIBLE and order is None
        return SearchOutcome(
            order, bound, complete, impossible, solver.num_branches, solver.num_conflicts
        )


class _Collector(cp_model.CpSolverSolutionCallback):
    """Passes every better order to the caller's thread."""

    def __init__(self, circuit: OrderCircuit, orders: deque[tuple[int, ...]]) -> None:
        super().__init__()
        self._circuit = circuit
        self._orders = orders

    def on_solution_callback(self) -> None:
        """Keep the order of a solution."""
        self._orders.append(self._circuit.order(self.value))
