"""Orders that are checked: branch and bound over the conflicts of a relaxed problem.

The cost of the cheapest order of a relaxed sequencing problem is a bound. If the order is no plan,
its conflicts say what plans do otherwise: one job comes before another, or the arm takes another
path between two. What holds in all plans is kept; where there is a choice, each is a node of its
own. The portfolio searches the nodes, the one with the least bound first. This is the scheme of
clause learning, with orders from a relaxation in place of assignments (Ohrimenko, Stuckey and
Codish, 2009, Propagation via lazy clause generation).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from skillplan.chart.precedence_query import Undecided
from skillplan.model.relaxed_sequencing import Arc, Conflict, Pair, RelaxedSequencing
from skillplan.model.sequencing import SequencingProblem
from skillplan.solvers.ordering.instance import Integers, JobOrders, close_relation
from skillplan.solvers.ordering.portfolio import Method, OrderingSearch
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.stop import Stop

# Number of jobs from which a first plan is looked for part by part.
_FIRST_PLAN = 15


@dataclass(frozen=True, order=True)
class _Node:
    """A part of all plans: they keep more precedence, and avoid some paths.

    Parameters
    ----------
    bound
        Lower bound on the cost of its plans.
    number
        Negative, so that of nodes with the same bound the newest is searched first.
    precedence
        Further pairs of jobs, the first before the second.
    refused
        Numbers of the paths that are not taken, by connection.
    """

    bound: float
    number: int
    precedence: frozenset[Pair] = field(default=frozenset(), compare=False)
    refused: Mapping[Arc, frozenset[int]] = field(default_factory=dict, compare=False)


class CheckedOrders:
    """The search for the cheapest order that is a plan.

    Parameters
    ----------
    methods
        Methods of the portfolio in use.
    memory_bytes
        Returns the free memory [B], or None for no limit.
    rounds
        Greatest number of rounds of the portfolio in each node; None for no limit.
    """

    def __init__(
        self,
        relaxed: RelaxedSequencing,
        methods: tuple[Method, ...],
        stop: Stop,
        memory_bytes: Callable[[], int | None],
        seed: int,
        rounds: int | None,
    ) -> None:
        self._relaxed, self._methods, self._stop = relaxed, methods, stop
        self._memory_bytes, self._seed, self._rounds = memory_bytes, seed, rounds
        self._best: Plan | None = stop.best
        self._queue = [_Node(0.0, 0)]
        self._count = 1
        # Precedence and refused paths of all plans, and pairs one of which every plan keeps.
        self._precedence: set[Pair] = set()
        self._refused: dict[Arc, frozenset[int]] = {}
        self._either: dict[tuple[Pair, ...], None] = {}
        # Least bound of the nodes that are searched without a proof.
        self._unproved = math.inf
        self._method, self._expanded = "", 0
        # True once an order of a node was a plan.
        self._has_checked = False

    def run(self) -> Solution:
        """Search until a proof or a stop."""
        if self._best is None and len(self._relaxed.problem.jobs) >= _FIRST_PLAN:
            first = self._relaxed.find_plan(self._stop)
            if first is not None:
                cost, skills = first
                self._keep(Plan(skills, cost))
        while self._queue and not self._stop():
            if self._queue[0].bound >= self._cutoff:
                break
            self._search(heapq.heappop(self._queue))
            self._tell(self._bound)
        bound = self._bound
        proved = bound >= self._cutoff and (self._best is not None or bound == math.inf)
        trace: dict[str, Any] = {
            "bound_method": self._method,
            "expanded": self._expanded,
            "jobs": len(self._relaxed.problem.jobs),
            "parts": self._count,
            "ended": "proof" if proved else self._stop.reason or "without a proof",
        }
        if proved and self._best is None:
            return Solution(None, None, proved=True, trace=trace | {"reason": "no order is a plan"})
        return Solution(self._best, min(bound, self._cost), proved=proved, trace=trace)

    @property
    def _cost(self) -> float:
        best = self._best
        return math.inf if best is None or best.cost is None else best.cost

    @property
    def _cutoff(self) -> float:
        """Bound from which on no better plan is looked for; costs are sums with rounding errors."""
        return self._cost if self._cost == math.inf else self._cost - 1e-9 * max(1.0, self._cost)

    @property
    def _bound(self) -> float:
        left = self._queue[0].bound if self._queue else math.inf
        return min(left, self._unproved)

    def _search(self, node: _Node) -> None:
        """Search a node; its parts follow if its best order is no plan."""
        precedence = self._propagate(node)
        if precedence is None:
            return
        refused = dict(node.refused)
        for arc, numbers in self._refused.items():
            refused[arc] = refused.get(arc, frozenset()) | numbers
        try:
            problem, taken = self._relaxed.divert(refused)
        except Undecided:
            self._unproved = min(self._unproved, node.bound)
            return
        problem = replace(problem, precedence=precedence)
        orders = JobOrders(problem)
        conflicts: list[Conflict] = []

        def on_order(order: Any, cost: float) -> None:
            conflicts[:] = self._check(problem, taken, orders.jobs(order))

        def must_stop() -> bool:
            # Until an order is a plan, bounds matter less than what each order tells of all.
            is_enough = search.effort.rounds > 0 or (not self._has_checked and node.bound > 0)
            is_refused = bool(conflicts) and is_enough
            return is_refused or search.bound >= self._cutoff or self._stop()

        search = OrderingSearch(
            orders.instance,
            self._methods,
            seed=self._seed,
            stop=must_stop,
            on_order=on_order,
            on_bound=lambda bound, nodes: self._tell(max(node.bound, bound)),
            memory_bytes=self._memory_bytes,
            start=self._begin(problem, orders),
            rounds=self._rounds,
        )
        search.run()
        self._method = self._method or search.effort.bound_method
        self._expanded += search.effort.nodes
        bound = max(node.bound, search.bound)
        if bound >= self._cutoff or (search.proved and search.order is None):
            return
        if conflicts:
            self._learn(replace(node, bound=bound), conflicts)
        elif not search.proved:
            self._unproved = min(self._unproved, bound)

    def _begin(self, problem: SequencingProblem, orders: JobOrders) -> Integers | None:
        """Return the order of the best plan if it is one of a node."""
        jobs = None if self._best is None else problem.order(self._best.skills)
        nodes = None if jobs is None else orders.nodes(jobs)
        return nodes if nodes is not None and orders.instance.feasible(nodes) else None

    def _propagate(self, node: _Node) -> frozenset[Pair] | None:
        """Return the precedence of a node with its consequences; None for no order."""
        pairs = self._relaxed.problem.precedence | self._precedence | node.precedence
        before = np.zeros((len(self._relaxed.problem.jobs),) * 2, dtype=np.bool_)
        grows = True
        while grows:
            for pair in pairs:
                before[pair] = True
            before = close_relation(before)
            if before.diagonal().any():
                return None
            grows = False
            for either in self._either:
                open_pairs = [pair for pair in either if not before[pair[::-1]]]
                if not open_pairs:
                    return None
                if len(open_pairs) == 1 and not before[open_pairs[0]]:
                    pairs |= {open_pairs[0]}
                    grows = True
        return pairs

    def _tell(self, bound: float) -> None:
        """Report the bound of the node that is searched, as far as it holds for all plans."""
        bound = min(bound, self._bound, self._cost)
        if bound < math.inf:
            self._stop.bound(bound, self._count)

    def _check(
        self, problem: SequencingProblem, taken: Mapping[Arc, int], jobs: tuple[int, ...]
    ) -> list[Conflict]:
        """Return the conflicts of an order; keep the plan of one without."""
        if not problem.fits(jobs):
            return [Conflict((), is_whole=False)]
        conflicts = self._relaxed.find_conflicts(problem, taken, jobs, self._stop)
        cost = problem.cost(jobs)
        if not conflicts and cost < self._cost:
            self._has_checked = True
            self._keep(Plan(problem.plan(jobs), cost))
        return conflicts

    def _keep(self, plan: Plan) -> None:
        self._best = plan
        self._stop.incumbent(plan)

    def _learn(self, node: _Node, conflicts: Iterable[Conflict]) -> None:
        """Keep what conflicts say of all plans, and queue the node again, or its parts."""
        open_conflict, learned = None, False
        for conflict in conflicts:
            if conflict.is_whole and conflict.arc is None and len(conflict.pairs) == 1:
                self._precedence |= {*conflict.pairs}
                learned = True
            elif conflict.is_whole and conflict.arc is not None and not conflict.pairs:
                numbers = self._refused.get(conflict.arc, frozenset())
                self._refused[conflict.arc] = numbers | {conflict.way}
                learned = True
            else:
                if conflict.is_whole and conflict.arc is None:
                    self._either[conflict.pairs] = None
                if open_conflict is None or len(conflict.pairs) < len(open_conflict.pairs):
                    open_conflict = conflict
        if learned:
            self._push(node)
        elif open_conflict is not None and open_conflict.is_whole:
            self._branch(node, open_conflict)
        else:
            self._unproved = min(self._unproved, node.bound)

    def _branch(self, node: _Node, conflict: Conflict) -> None:
        """Queue the parts of a node in which a conflict is avoided, each without the others."""
        reverse = node.precedence
        parts = []
        for pair in conflict.pairs:
            parts.append(replace(node, precedence=reverse | {pair}))
            reverse |= {pair[::-1]}
        if conflict.arc is not None:
            numbers = node.refused.get(conflict.arc, frozenset()) | {conflict.way}
            refused = {**node.refused, conflict.arc: numbers}
            parts.append(replace(node, precedence=reverse, refused=refused))
        for part in reversed(parts):
            self._push(part)

    def _push(self, node: _Node) -> None:
        heapq.heappush(self._queue, replace(node, number=-self._count))
        self._count += 1
