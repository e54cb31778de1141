"""Algorithm portfolio for the sequential ordering problem.

Local search finds orders. A linear relaxation with cuts gives a bound and fixes arcs by reduced
cost. Then bidirectional dynamic programming over feasible subsets (Held-Karp), beam search over
the same subsets, and branch and cut take turns, each time with more effort. They share incumbent,
bound and fixed arcs. Effort is counted, not timed, so equal seeds make equal moves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skillplan.solvers.ordering.instance import NO_ARC, Integers, OrderingInstance
from skillplan.solvers.ordering.local_search.ruin_and_recreate import Annealing, build_greedy
from skillplan.solvers.ordering.parallel_search import Helper, Helpers, SharedTree
from skillplan.solvers.ordering.relaxation.branch_and_cut import BranchAndCut, tighten
from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation, Duals
from skillplan.solvers.ordering.relaxation.pair_relaxation import PairRelaxation, find_open_pairs
from skillplan.solvers.ordering.search_worker import Improve
from skillplan.solvers.ordering.subsets.two_ended_search import TwoEndedSearch, run_beam


@dataclass
class Effort:
    """Effort of the methods, for the trace."""

    nodes: int = 0
    bound_method: str = ""
    states: int = 0
    parts: int = 0
    programs: int = 0
    rounds: int = 0


Method = Literal["local-search", "subset-dp", "tree-search", "branch-and-cut"]
METHODS: tuple[Method, ...] = ("local-search", "subset-dp", "tree-search", "branch-and-cut")

# Moves of local search in the first round, and greatest factor of later rounds. If orders can be
# kicked and this share of the cost is unproved, a proof is far away and better orders matter most.
_MOVES = 1_000_000
_LONGER, _FAR_LONGER, _FAR = 2, 8, 0.05
# Work of branch and cut in the first round, its part before other processes join, and work of the
# pair relaxation in the first round.
_WORK = 40_000_000
_FIRST_WORK = 40_000_000
_PAIRS_WORK = 75_000_000
# Share of the gap closed by branch and cut at which the pair relaxation is skipped.
_ENOUGH = 1 / 3
# Labels of the dynamic program in the first round.
_STATES = 1_200_000
# Number of turns in which the pair relaxation has to close this share of the gap, and more than
# branch and cut.
_TURNS = 2
_WORTH = 0.2
# Number of open pairs of nodes above which the pair relaxation is too slow.
_MOST_PAIRS = 4_000
# The dynamic program is worth waiting for if it expects at most this multiple of its labels.
_NEAR = 64
# Memory of one label without its set, and of its entry in the history of a beam [B].
_STATE_BYTES = 32
_HISTORY_BYTES = 6
# Share of the free memory that may be allocated.
_MEMORY_SHARE = 0.8


class OrderingSearch:
    """The portfolio search on one instance.

    Parameters
    ----------
    methods
        Methods in use; the linear relaxation is always in use.
    memory_bytes
        Returns the free memory [B], or None for no limit.
    rounds
        Greatest number of rounds; None for no limit.
    helpers
        Worker processes; None for none.

    Attributes
    ----------
    bound
        Lower bound on all orders; inf if no order exists.
    ended
        Reason of an end without proof; may be empty.
    """

    def __init__(
        self,
        instance: OrderingInstance,
        methods: tuple[Method, ...] = METHODS,
        *,
        seed: int = 0,
        stop: Callable[[], bool] = lambda: False,
        on_order: Callable[[Integers, float], None] = lambda order, cost: None,
        on_bound: Callable[[float, int], None] = lambda bound, nodes: None,
        memory_bytes: Callable[[], int | None] = lambda: None,
        start: Integers | None = None,
        rounds: int | None = None,
        helpers: Helpers | None = None,
    ) -> None:
        self.instance = instance
        self.methods = methods
        self.stop = stop
        self.on_order, self.on_bound = on_order, on_bound
        self.memory_bytes = memory_bytes
        self.helpers = helpers
        self._threads = 1 if helpers is None else 1 + helpers.count
        self._tree: SharedTree | None = None
        # Bound of branch and cut in its first turn before others joined, or in its last turn alone.
        self._first_bound = -np.inf
        # Processes that improve the best order.
        self._improving: list[Helper] = []
        self.effort = Effort()
        self.order: Integers | None = None
        self.cost = np.inf
        self.bound = 0.0
        self._annealing = Annealing(instance, seed)
        # Number of consecutive annealing turns without a better order.
        self._stalled = 0
        self.rounds = rounds
        self.ended = ""
        self.duals: Duals | None = None
        self._branched: BranchAndCut | None = None
        self._pairs: PairRelaxation | None = None
        self._pairs_turns = 0
        # Root bound: of the relaxation before branching.
        self._root_bound = 0.0
        # Bidirectional search and its duals: it resumes while they stay the same.
        self._ends: TwoEndedSearch | None = None
        self._searched: Duals | None = None
        self._states = 0
        if start is not None:
            self._keep(start)

    @property
    def proved(self) -> bool:
        """True if no order is cheaper than the best, or no order exists."""
        return self.bound >= self.instance.cutoff(self.cost)

    @property
    def is_relaxed(self) -> bool:
        """True once the linear relaxation has its bound."""
        return self.duals is not None

    def run(self) -> None:
        """Search until a proof or a stop; then end the processes."""
        try:
            self._search()
        finally:
            if self.helpers is not None:
                self.helpers.end()

    def _search(self) -> None:
        self._begin = build_greedy(self.instance) if self.order is None else self.order
        self._keep(self._begin)
        if "local-search" in self.methods:
            self._anneal(self._moves)
        if self._over():
            return
        relaxation = CutRelaxation(self.instance, self.instance.costs < NO_ARC, self.order)
        self._relax(relaxation)
        while not self._over():
            scale = 1 << self.effort.rounds
            self.effort.rounds += 1
            exhausted = "local-search" not in self.methods
            if self.helpers is None and not exhausted:
                self._anneal(self._turn_moves(scale))
            if "tree-search" in self.methods and not self._over():
                exhausted &= not self._beam(250 * (scale if len(self.methods) > 1 else scale**2))
            if "subset-dp" in self.methods and not self._over():
                exhausted &= not self._two_ended(_STATES * scale)
            if self.helpers is not None and not self._over():
                self._anneal_together(self.helpers, scale)
            if "branch-and-cut" in self.methods and not self._over():
                exhausted = False
                self._branched = self._branched or self._branching(relaxation)
                if not self._subsets_lead():
                    self._branch(self._branched, _WORK * scale)
            self._gather()
            if self.effort.rounds != self.rounds and not self._over():
                self._send_out(2 * scale)
            if self._over_subsets and not self._over():
                self._relax_pairs(relaxation, _PAIRS_WORK * scale)
            if exhausted:
                self.ended = "memory limit"
                return
            if self.effort.rounds == self.rounds:
                self.ended = f"limit of {self.rounds} rounds"
                return

    @property
    def _moves(self) -> int:
        """Moves of the first annealing: some tenths of a second, less for few nodes."""
        return min(_MOVES // 6, 2_000 * self.instance.n)

    def _turn_moves(self, scale: int) -> int:
        """Return the number of moves of all processes in a turn of annealing."""
        far = self._annealing.kicked and self.bound < (1 - _FAR) * self.cost
        if far or self.methods == ("local-search",):
            longer = min(scale, _FAR_LONGER) if far else scale
        else:
            longer = min(scale, _LONGER)
        # Half as long after a turn without gain; other methods gain from longer turns.
        return longer * _MOVES >> (0 if far else min(self._stalled, longer - 1))

    def _over(self) -> bool:
        """Return True if the search should stop."""
        if self.helpers is not None:
            self.helpers.attend()
        return self.proved or self.stop()

    def _anneal_together(self, helpers: Helpers, scale: int) -> None:
        """Anneal in all processes, each with its share of the moves.

        Results of the others are collected later. They are started here, because many instances are
        proved before.
        """
        helpers.begin(self.instance)
        if not self._improving:
            self._send_out(scale)
        if "local-search" in self.methods:
            self._anneal(self._turn_moves(scale) // (1 + helpers.count))

    def _send_out(self, scale: int) -> None:
        """Let idle processes improve the best order."""
        helpers = self.helpers
        if helpers is None:
            return
        moves = self._most_moves(self._turn_moves(scale) // (1 + helpers.count))
        order = self._begin if self.order is None else self.order
        self._improving = helpers.idle
        for helper in self._improving:
            helpers.give(helper, Improve(order, self.cost, moves))

    def _gather(self) -> None:
        """Collect the results of other processes in a fixed order."""
        known = self.cost
        improving, self._improving = self._improving, []
        for helper in improving:
            assert self.helpers is not None
            finding = self.helpers.result(helper, self._over)
            if finding is not None:
                self.effort.nodes += finding.nodes
                if finding.order is not None:
                    self._keep(finding.order)
        if self.cost < known:
            self._stalled = 0
            if self._branched is not None:
                self._branched.cost = min(self._branched.cost, self.cost)

    def _keep(self, order: Integers) -> None:
        cost = self.instance.cost(order)
        if cost < self.cost and self.instance.feasible(order):
            self.cost, self.order = cost, order.copy()
            self.on_order(self.order, cost)

    def _raise(self, bound: float, method: str) -> None:
        """Keep a bound on every order if it is the best."""
        if bound >= self.instance.cutoff(self.cost):
            bound = self.cost
        bound = min(self.cost, self.instance.rounded_up(bound))
        if bound > self.bound:
            self.bound = bound
            self.effort.bound_method = method
        self.on_bound(self.bound, self.effort.nodes)

    def _anneal(self, iterations: int) -> None:
        """Improve the best order by annealing, in portions between stop checks."""
        iterations = self._most_moves(iterations)
        order = self._begin if self.order is None else self.order
        known = self.cost
        self._stalled += 1
        for best, moves in self._annealing.portions(order, self.cost, iterations):
            self.effort.nodes += moves
            self._keep(best)
            if self.cost < known:
                self._stalled = 0
            self.on_bound(self.bound, self.effort.nodes)
            if self._over():
                return

    def _most_moves(self, moves: int) -> int:
        """Return the number of moves to make: fewer if there are few orders."""
        return min(moves, (100 << self.effort.rounds) * self.instance.n**3)

    def _relax(self, relaxation: CutRelaxation) -> None:
        def on_bound(duals: Duals) -> None:
            self._raise(duals.bound, "linear relaxation with precedence cuts")

        self.duals = tighten(relaxation, self.instance.cutoff(self.cost), self._over, on_bound)
        on_bound(self.duals)
        self._root_bound = self.duals.bound
        relaxation.fix(self.duals, self.instance.cutoff(self.cost))
        self.effort.programs = relaxation.solves

    @property
    def _known(self) -> Duals:
        """Best bound and its method."""
        assert self.duals is not None
        return self.duals

    @property
    def _over_subsets(self) -> bool:
        """True if a method in use gains from the pair relaxation."""
        return "subset-dp" in self.methods or "tree-search" in self.methods

    def _relax_pairs(self, relaxation: CutRelaxation, work: int) -> None:
        """Continue the pair relaxation, unless branch and cut has a better bound."""
        cutoff = self.instance.cutoff(self.cost)
        if self._pairs is None:
            well_branched = self._root_bound + _ENOUGH * (cutoff - self._root_bound)
            if self.order is None or self._first_bound >= well_branched:
                return
            if find_open_pairs(self.instance).sum() // 2 > _MOST_PAIRS:
                return
            self._pairs = PairRelaxation(relaxation)
        pairs = self._pairs
        if self._pairs_turns >= _TURNS:
            little = self._pairs_bound < self._root_bound + _WORTH * (cutoff - self._root_bound)
            if little or self._pairs_bound < self._branched_bound:
                pairs.exhausted = True
        if pairs.exhausted:
            return

        def on_bound(duals: Duals) -> None:
            self._raise(duals.bound, "linear relaxation over arcs and pairs")

        pairs.run(work, cutoff, self._over, on_bound)
        self._pairs_turns += 1
        if pairs.duals is not None and pairs.duals.bound > self._known.bound:
            self.duals = pairs.duals
            relaxation.fix(pairs.duals, cutoff)

    @property
    def _pairs_bound(self) -> float:
        """Bound of the pair relaxation; -inf at first."""
        duals = None if self._pairs is None else self._pairs.duals
        return -np.inf if duals is None else duals.bound

    @property
    def _branched_bound(self) -> float:
        return -np.inf if self._branched is None else self._branched.bound

    def _subsets_lead(self) -> bool:
        """Return True if the pair relaxation is ahead, and it or the subsets may gain more."""
        pairs, ends = self._pairs, self._ends
        if pairs is None or self.effort.rounds == 1 or self._pairs_bound < self._branched_bound:
            return False
        return not pairs.exhausted or (ends is not None and ends.expected <= _NEAR * self._states)

    def _allowed(self, labels: int, sets: int, entries: int) -> int:
        """Return the number of labels that memory allows."""
        left = self.memory_bytes() if self.helpers is None else self.helpers.left_bytes
        if left is None:
            return labels
        words = (self.instance.n + 63) // 64
        each = sets * (8 * words + _STATE_BYTES) + entries * _HISTORY_BYTES
        return min(labels, int(_MEMORY_SHARE * max(0, left) / each))

    def _two_ended(self, states: int) -> bool:
        """Search from both ends; return True if more labels are allowed."""
        # Either end may hold twice as many, most of them in one layer that is copied to grow. Two
        # threads have two such layers.
        self._states = allowed = self._allowed(states, 10 if self._threads == 1 else 16, 0)
        cutoff = self.instance.cutoff(self.cost)
        search = self._ends
        if search is None or search.cutoff != cutoff or self._searched is not self.duals:
            known = self._known.without(cutoff)
            self._ends = search = TwoEndedSearch(self.instance, known, cutoff, self._threads)
            self._searched = self.duals
        before = search.generated
        met = search.run(allowed, self._over)
        self.effort.nodes += search.generated - before
        self.effort.states += search.generated - before
        if met.order is not None:
            self._keep(met.order)
        self._raise(met.bound, "dynamic programming over feasible subsets")
        return allowed >= states

    def _beam(self, width: int) -> bool:
        """Run a beam search; return True if a wider beam is allowed."""
        # Two layers at a time, the table and the copy of a growing layer; then only its history.
        allowed = self._allowed(width, 10, self.instance.n)
        cutoff = self.instance.cutoff(self.cost)
        beam_result = run_beam(
            self.instance, self._known.without(cutoff), cutoff, max(1, allowed), self._over
        )
        if beam_result is not None:
            self.effort.nodes += beam_result.generated
            self.effort.states += beam_result.generated
            if beam_result.order is not None:
                self._keep(beam_result.order)
            self._raise(beam_result.bound, "beam search over feasible subsets")
        return allowed >= width

    def _branching(self, relaxation: CutRelaxation) -> BranchAndCut:
        relaxation.fix(self._known, self.instance.cutoff(self.cost))
        return BranchAndCut(
            relaxation,
            self.cost,
            self._over,
            self._keep,
            lambda bound, subproblems: self._raise(bound, "branch and cut"),
        )

    def _branch(self, branching: BranchAndCut, work: int) -> None:
        branching.cost = min(branching.cost, self.cost)
        subproblems = branching.subproblems
        helpers, tree = self.helpers, self._tree
        if helpers is None:
            branching.run(work)
            self._first_bound = branching.bound
        else:
            if tree is None:
                self._tree = tree = SharedTree(branching, helpers)
                # Other processes start and anneal meanwhile. Other methods wait for their turn,
                # because all processes would repeat this work.
                first = min(work, _FIRST_WORK)
                branching.run(first)
                work -= first
                self._first_bound = branching.bound
            self._gather()
            parts = tree.parts
            tree.run(work // (1 + helpers.count), self.order, self._over, self._keep)
            self.effort.nodes += tree.parts - parts
        self.effort.nodes += branching.subproblems - subproblems
        self.effort.parts, self.effort.programs = branching.subproblems, branching.relaxation.solves
        if tree is not None:
            self.effort.parts += tree.parts
            self.effort.programs += tree.programs
        root = branching.root
        if root is not None and root.bound > self._known.bound:
            self.duals = root
        self._raise(branching.bound, "branch and cut")


_NODES = 16
_WORK_WARM_UP = 1_000_000


def warm_up() -> None:
    """Search a small instance by each method, which compiles all kernels."""
    instance = _build_instance()
    for method in METHODS:
        OrderingSearch(instance, (method,), rounds=1).run()
    # Other moves search instances with costs in one direction.
    one_way = OrderingInstance(np.triu(instance.costs) + 1.0, instance.before)
    OrderingSearch(one_way, ("local-search",), rounds=1).run()
    # Runs only if the other methods do not soon prove the optimum.
    relaxation = CutRelaxation(instance, instance.costs < NO_ARC)
    PairRelaxation(relaxation).run(_WORK_WARM_UP, np.inf, lambda: False, lambda duals: None)


def _build_instance() -> OrderingInstance:
    """Return places on a grid with precedence, which the relaxation alone does not prove."""
    nodes = np.arange(_NODES)
    x, y = 7 * nodes % 31, 11 * nodes**2 % 31
    costs = np.abs(x[:, None] - x) + np.abs(y[:, None] - y) + 0.0
    before = np.zeros((_NODES, _NODES), dtype=np.bool_)
    before[[1, 2, 3, 5, 6], [4, 4, 9, 8, 10]] = True
    return OrderingInstance(costs, before)
