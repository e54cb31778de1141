"""Orders that are checked: branch and bound over the conflicts of a relaxed problem.

The cost of the cheapest order of a relaxed sequencing problem is a bound. If the order is no plan,
its conflicts say what plans do otherwise: one job comes before another, or the arm takes another
path between two. What holds in all plans is kept; where there is a choice, each is a node of its
own. The portfolio searches the nodes, the one with the least bound first. This is the scheme of
clause learning, with orders from a relaxation in place of assignments (Ohrimenko, Stuckey and
Codish, 2009, Propagation via lazy clause generation).

Local search improves the best plan: among the orders that avoid every known conflict in a way in
which this plan does, too, the cheapest ones are checked. Each is a better plan, or has a new
conflict.
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
from skillplan.solvers.ordering.instance import Booleans, Integers, JobOrders, close_relation
from skillplan.solvers.ordering.local_search.ruin_and_recreate import Annealing
from skillplan.solvers.ordering.portfolio import Method, OrderingSearch
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.stop import Stop

# Number of jobs from which a first plan is looked for part by part.
_FIRST_PLAN = 15
# Number of consecutive orders without gain that ends the improvement of a plan, and moves of local
# search for each of them, by job.
_IDLE, _MOVES = 5, 2_000


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
        # Precedence and refused paths of all plans, and other conflicts that every plan avoids.
        self._precedence: set[Pair] = set()
        self._refused: dict[Arc, frozenset[int]] = {}
        self._known: dict[Conflict, None] = {}
        self._random = np.random.default_rng(seed)
        # Least bound of the nodes that are searched without a proof.
        self._unproved = math.inf
        self._method, self._expanded = "", 0

    def run(self) -> Solution:
        """Search until a proof or a stop."""
        if self._best is None and len(self._relaxed.problem.jobs) >= _FIRST_PLAN:
            first = self._relaxed.find_plan(self._stop)
            if first is not None:
                cost, skills = first
                self._keep(Plan(skills, cost))
        searched = 0
        while self._queue and not self._stop():
            # Conflicts of later nodes show other plans, but ever fewer of them.
            if "local-search" in self._methods and searched & (searched - 1) == 0:
                self._improve()
            if self._queue[0].bound >= self._cutoff:
                break
            self._search(heapq.heappop(self._queue))
            self._tell(self._bound)
            searched += 1
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
        try:
            problem, taken = self._divert(node.refused, precedence)
        except Undecided:
            self._unproved = min(self._unproved, node.bound)
            return
        orders = JobOrders(problem)
        unchecked: list[Integers] = []
        conflicts: list[Conflict] = []

        def on_order(order: Any, cost: float) -> None:
            unchecked[:] = [order]
            conflicts.clear()

        def must_stop() -> bool:
            if search.bound >= self._cutoff or self._stop():
                return True
            # Without a plan, the conflicts of each order matter more than bounds.
            if not (search.is_relaxed or (self._best is None and node.bound > 0)):
                return False
            if unchecked:
                conflicts[:] = self._check(problem, taken, orders.jobs(unchecked.pop()))
            return bool(conflicts)

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
        if unchecked and search.bound < self._cutoff:
            # Also after a stop: an order that is not checked to its end proves nothing.
            conflicts[:] = self._check(problem, taken, orders.jobs(unchecked.pop()))
        self._method = self._method or search.effort.bound_method
        self._expanded += search.effort.nodes
        bound = max(node.bound, search.bound)
        if bound >= self._cutoff or (search.proved and search.order is None):
            return
        if conflicts:
            self._learn(replace(node, bound=bound), precedence, conflicts)
        elif not search.proved:
            self._unproved = min(self._unproved, bound)

    def _begin(self, problem: SequencingProblem, orders: JobOrders) -> Integers | None:
        """Return the order of the best plan if it is one of a node."""
        jobs = None if self._best is None else problem.order(self._best.skills)
        nodes = None if jobs is None else orders.nodes(jobs)
        return nodes if nodes is not None and orders.instance.feasible(nodes) else None

    def _improve(self) -> None:
        """Improve the best plan until several orders in a row are no gain.

        An order is a gain if it is a better plan, or has a new conflict.
        """
        idle = 0
        while idle < _IDLE and not self._stop():
            before = self._progress
            if not self._try_similar():
                return
            idle = idle + 1 if self._progress == before else 0

    @property
    def _progress(self) -> tuple[float, int, int, int]:
        """Cost of the best plan, and numbers of known conflicts of each kind."""
        refused = sum(map(len, self._refused.values()))
        return self._cost, len(self._precedence), len(self._known), refused

    def _try_similar(self) -> bool:
        """Check a cheap order that avoids known conflicts as the best plan; False without one."""
        jobs = None if self._best is None else self._relaxed.problem.order(self._best.skills)
        if jobs is None:
            return False
        precedence, refused = self._avoid_alike(jobs)
        try:
            problem, taken = self._divert(refused, precedence)
        except Undecided:
            return False
        orders = JobOrders(problem)
        instance, start = orders.instance, self._begin(problem, orders)
        if start is None:
            return False
        annealing = Annealing(instance, int(self._random.integers(1 << 32)))
        cheapest = start
        for order, _ in annealing.portions(start, instance.cost(start), _MOVES * instance.n):
            cheapest = order
            if self._stop():
                return False
        if instance.cost(cheapest) < self._cutoff:
            self._check(problem, taken, orders.jobs(cheapest))
        return True

    def _avoid_alike(
        self, jobs: tuple[int, ...]
    ) -> tuple[frozenset[Pair], dict[Arc, frozenset[int]]]:
        """Return precedence and refused paths that avoid known conflicts as an order does.

        If it avoids one in several ways, one of them is drawn.
        """
        rank = {job: place for place, job in enumerate(jobs)}
        before = self._close(self._relaxed.problem.precedence | self._precedence)
        refused: dict[Arc, frozenset[int]] = {}
        known = list(self._known)
        for number in self._random.permutation(len(known)):
            conflict = known[number]
            kept = [pair for pair in conflict.pairs if rank[pair[0]] < rank[pair[1]]]
            if any(before[pair] for pair in kept):
                continue
            if kept:
                _add_pair(before, kept[self._random.integers(len(kept))])
            elif conflict.arc is not None:
                _refuse(refused, conflict)
        return _list_pairs(before), refused

    def _divert(
        self, refused: Mapping[Arc, frozenset[int]], precedence: frozenset[Pair]
    ) -> tuple[SequencingProblem, dict[Arc, int]]:
        """Return the problem with this precedence, without these and all impossible paths.

        Raises
        ------
        Undecided
            If there are too many paths.
        """
        united = dict(refused)
        for arc, numbers in self._refused.items():
            united[arc] = united.get(arc, frozenset()) | numbers
        problem, taken = self._relaxed.divert(united)
        return replace(problem, precedence=precedence), taken

    def _close(self, pairs: Iterable[Pair]) -> Booleans:
        """Return the transitive closure of pairs of jobs."""
        before = np.zeros((len(self._relaxed.problem.jobs),) * 2, dtype=np.bool_)
        for pair in pairs:
            before[pair] = True
        return close_relation(before)

    def _propagate(self, node: _Node) -> frozenset[Pair] | None:
        """Return the precedence of a node with its consequences; None for no order."""
        pairs = self._relaxed.problem.precedence | self._precedence | node.precedence
        before = self._close(pairs)
        grows = True
        while grows:
            if before.diagonal().any():
                return None
            grows = False
            for conflict in self._known:
                if conflict.arc is not None:
                    continue
                open_pairs = [pair for pair in conflict.pairs if not before[pair[::-1]]]
                if not open_pairs:
                    return None
                if len(open_pairs) == 1 and not before[open_pairs[0]]:
                    _add_pair(before, open_pairs[0])
                    grows = True
        return _list_pairs(before)

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
        for conflict in conflicts:
            self._note(conflict)
        cost = problem.cost(jobs)
        if not conflicts and cost < self._cost:
            self._keep(Plan(problem.plan(jobs), cost))
        return conflicts

    def _note(self, conflict: Conflict) -> None:
        """Keep what a conflict says of all plans."""
        if not conflict.is_whole:
            return
        if conflict.arc is None and len(conflict.pairs) == 1:
            self._precedence |= {*conflict.pairs}
        elif conflict.arc is not None and not conflict.pairs:
            _refuse(self._refused, conflict)
        else:
            self._known[conflict] = None

    def _keep(self, plan: Plan) -> None:
        self._best = plan
        self._stop.incumbent(plan)

    def _learn(
        self, node: _Node, precedence: frozenset[Pair], conflicts: Iterable[Conflict]
    ) -> None:
        """Queue a node again if conflicts add to its precedence or refused paths, or its parts.

        Parameters
        ----------
        precedence
            Precedence of the node in its search.
        """
        open_conflict = None
        for conflict in conflicts:
            if conflict.is_whole and conflict.arc is not None and not conflict.pairs:
                self._push(node)
                return
            if open_conflict is None or len(conflict.pairs) < len(open_conflict.pairs):
                open_conflict = conflict
        if self._propagate(node) != precedence:
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
            refused = dict(node.refused)
            _refuse(refused, conflict)
            parts.append(replace(node, precedence=reverse, refused=refused))
        for part in reversed(parts):
            self._push(part)

    def _push(self, node: _Node) -> None:
        heapq.heappush(self._queue, replace(node, number=-self._count))
        self._count += 1


def _refuse(refused: dict[Arc, frozenset[int]], conflict: Conflict) -> None:
    """Add the path of a conflict to the paths that are not taken."""
    assert conflict.arc is not None
    refused[conflict.arc] = refused.get(conflict.arc, frozenset()) | {conflict.way}


def _add_pair(before: Booleans, pair: Pair) -> None:
    """Add a pair of jobs to a closed relation, and close it again."""
    first, second = pair
    up, down = before[:, first].copy(), before[second].copy()
    up[first] = down[second] = True
    before |= np.outer(up, down)


def _list_pairs(before: Booleans) -> frozenset[Pair]:
    return frozenset((int(first), int(second)) for first, second in np.argwhere(before))
