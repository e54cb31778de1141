"""Algorithm portfolio for the sequential ordering problem; its methods share what they find.

Local search for orders; a linear relaxation with cuts for a bound and for reduced-cost fixing of
arcs; then in turns, each time with more effort, bidirectional dynamic programming over feasible
subsets (Held-Karp), beam search over the same subsets, and branch and cut. Incumbent, bound and
fixed arcs are shared. All effort is counted, not timed, so that the same seed makes the same
moves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skillplan.solvers.ordering.instance import NO_ARC, Integers, OrderingInstance
from skillplan.solvers.ordering.local_search.ruin_and_recreate import Annealing, cheapest_first
from skillplan.solvers.ordering.parallel_search import Helper, Helpers, SharedTree
from skillplan.solvers.ordering.relaxation.branch_and_cut import BranchAndCut, tighten
from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation, Duals
from skillplan.solvers.ordering.relaxation.pair_relaxation import PairRelaxation, open_pairs
from skillplan.solvers.ordering.search_worker import Improve
from skillplan.solvers.ordering.subsets.two_ended_search import TwoEndedSearch, beam


@dataclass
class Effort:
    """What the methods did, for the trace.

    Parameters
    ----------
    nodes
        Labels, subproblems and orders looked at.
    bound_method
        In words, what proved the bound.
    states
        Labels of the dynamic program and the beam.
    parts
        Subproblems of branch and cut.
    programs
        Linear programs solved.
    rounds
        Rounds of the portfolio.
    """

    nodes: int = 0
    bound_method: str = ""
    states: int = 0
    parts: int = 0
    programs: int = 0
    rounds: int = 0


Method = Literal["local-search", "subset-dp", "tree-search", "branch-and-cut"]
METHODS: tuple[Method, ...] = ("local-search", "subset-dp", "tree-search", "branch-and-cut")

# Moves of local search in the first round, and how many times as many a later one has at most.
# Where orders are kicked and so large a share of the cost is not proved, a proof is far away, and
# better orders are what can be had.
_MOVES = 1_000_000
_LONGER, _FAR_LONGER, _FAR = 2, 8, 0.05
# Work of branch and cut in the first round, of it what this process does before others join in,
# and work of the relaxation over pairs in the first round.
_WORK = 40_000_000
_FIRST_WORK = 40_000_000
_PAIRS_WORK = 75_000_000
# Where branch and cut has closed such a share of the gap, the pair relaxation is skipped.
_ENOUGH = 1 / 3
# Labels of the dynamic program in the first round.
_STATES = 1_200_000
# In so many turns the pair relaxation has to close such a share of the gap, and more than
# branch and cut does.
_TURNS = 2
_WORTH = 0.2
# With more pairs of nodes in either order, the pair relaxation takes too long to be of use.
_MOST_PAIRS = 4_000
# Where the dynamic program expects at most so many times its labels, it is worth waiting for.
_NEAR = 64
# Of one label beside the words of its set; and of its entry in the history of a beam [bytes].
_STATE_BYTES = 32
_HISTORY_BYTES = 6
# Share of the remaining memory that may be allocated.
_MEMORY_SHARE = 0.8


class OrderingSearch:
    """The portfolio search on one instance.

    Parameters
    ----------
    instance
        The ordering.
    methods
        The methods in use; the linear relaxation always is.
    seed
        Governs all randomness.
    stop
        True if to stop now.
    on_order, on_bound
        Called with every better order and bound.
    memory_bytes
        Returns how much memory may still be taken, or None for no limit.
    start
        An order that is known already.
    rounds
        The most rounds; None for as many as it takes.
    helpers
        Processes that take a part of the work; None for none.

    Attributes
    ----------
    order, cost
        The best order found, None and inf while there is none.
    bound
        No order costs less; inf where there is no order at all.
    ended
        Why the search ended without a proof; empty while it did not.
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
        # What branch and cut proved in its first turn before others joined in; alone, in its last.
        self._first_bound = -np.inf
        # Those that are improving the best order at the moment.
        self._improving: list[Helper] = []
        self.effort = Effort()
        self.order: Integers | None = None
        self.cost = np.inf
        self.bound = 0.0
        self._annealing = Annealing(instance, seed)
        # How often in a row annealing has found nothing better.
        self._stalled = 0
        self.rounds = rounds
        self.ended = ""
        self.duals: Duals | None = None
        self._branched: BranchAndCut | None = None
        self._pairs: PairRelaxation | None = None
        self._pairs_turns = 0
        # The root bound: of the relaxation before branching.
        self._root_bound = 0.0
        # The bidirectional search, and the duals that it uses: it resumes while they stay the same.
        self._ends: TwoEndedSearch | None = None
        self._searched: Duals | None = None
        self._states = 0
        if start is not None:
            self._keep(start)

    @property
    def proved(self) -> bool:
        """True if no order is cheaper than the best, or there is none."""
        return self.bound >= self.instance.cutoff(self.cost)

    def run(self) -> None:
        """Search until the best order is proved, or it was stopped; then end the helpers."""
        try:
            self._search()
        finally:
            if self.helpers is not None:
                self.helpers.end()

    def _search(self) -> None:
        self._begin = cheapest_first(self.instance) if self.order is None else self.order
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
        """How many moves the first annealing makes: some tenths of a second, less for few nodes."""
        return min(_MOVES // 6, 2_000 * self.instance.n)

    def _turn_moves(self, scale: int) -> int:
        """How many moves all processes make in a turn of annealing."""
        far = self._annealing.kicked and self.bound < (1 - _FAR) * self.cost
        if far or self.methods == ("local-search",):
            longer = min(scale, _FAR_LONGER) if far else scale
        else:
            longer = min(scale, _LONGER)
        # Half as long where it gained nothing last time; other methods gain from longer turns.
        return longer * _MOVES >> (0 if far else min(self._stalled, longer - 1))

    def _over(self) -> bool:
        """Return True if to stop."""
        if self.helpers is not None:
            self.helpers.attend()
        return self.proved or self.stop()

    def _anneal_together(self, helpers: Helpers, scale: int) -> None:
        """Anneal in all processes, each with its share of the moves.

        What the others find is gathered later, so that they may make themselves ready meanwhile;
        they are first started here, as many an instance is proved before.
        """
        helpers.begin(self.instance)
        if not self._improving:
            self._send_out(scale)
        if "local-search" in self.methods:
            self._anneal(self._turn_moves(scale) // (1 + helpers.count))

    def _send_out(self, scale: int) -> None:
        """Have the other processes improve the best order."""
        helpers = self.helpers
        if helpers is None:
            return
        moves = self._most_moves(self._turn_moves(scale) // (1 + helpers.count))
        order = self._begin if self.order is None else self.order
        self._improving = helpers.idle
        for helper in self._improving:
            helpers.give(helper, Improve(order, self.cost, moves))

    def _gather(self) -> None:
        """Take over what the other processes have found, in an order that is always the same."""
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
        """Improve the best order by annealing; in portions, so that it can be stopped."""
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

    def _most_moves(self, wanted: int) -> int:
        """Return how many of the wanted moves to make: where there are few orders, few."""
        return min(wanted, (100 << self.effort.rounds) * self.instance.n**3)

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
        """The best bound so far and what proved it."""
        assert self.duals is not None
        return self.duals

    @property
    def _over_subsets(self) -> bool:
        """True if a method is in use that the pair relaxation helps."""
        return "subset-dp" in self.methods or "tree-search" in self.methods

    def _relax_pairs(self, relaxation: CutRelaxation, work: int) -> None:
        """Continue the pair relaxation, unless branch and cut has a better bound."""
        cutoff = self.instance.cutoff(self.cost)
        if self._pairs is None:
            well_branched = self._root_bound + _ENOUGH * (cutoff - self._root_bound)
            if self.order is None or self._first_bound >= well_branched:
                return
            if open_pairs(self.instance).sum() // 2 > _MOST_PAIRS:
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
        """The bound of the pair relaxation; -inf before there is one."""
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

    def _allowed(self, wanted: int, sets: int, entries: int) -> int:
        """Return how many of the wanted labels memory allows, each of so many sets and entries."""
        left = self.memory_bytes() if self.helpers is None else self.helpers.left_bytes
        if left is None:
            return wanted
        words = (self.instance.n + 63) // 64
        each = sets * (8 * words + _STATE_BYTES) + entries * _HISTORY_BYTES
        return min(wanted, int(_MEMORY_SHARE * max(0, left) / each))

    def _two_ended(self, states: int) -> bool:
        """Search from both ends; return whether more labels would be allowed."""
        # Either end may hold twice as many, most of them in one layer that is copied to grow.
        # Two ends at once have two such layers.
        self._states = allowed = self._allowed(states, 10 if self._threads == 1 else 16, 0)
        cutoff = self.instance.cutoff(self.cost)
        search = self._ends
        if search is None or search.cutoff != cutoff or self._searched is not self.duals:
            known = self._known.without(cutoff)
            self._ends = search = TwoEndedSearch(self.instance, known, cutoff, self._threads)
            self._searched = self.duals
        made = search.made
        met = search.run(allowed, self._over)
        self.effort.nodes += search.made - made
        self.effort.states += search.made - made
        if met.order is not None:
            self._keep(met.order)
        self._raise(met.bound, "dynamic programming over feasible subsets")
        return allowed >= states

    def _beam(self, width: int) -> bool:
        """Run a beam search; return whether a wider beam would be allowed."""
        # Two layers at a time, the table and the copy of one that grows; then only its history.
        allowed = self._allowed(width, 10, self.instance.n)
        cutoff = self.instance.cutoff(self.cost)
        found = beam(
            self.instance, self._known.without(cutoff), cutoff, max(1, allowed), self._over
        )
        if found is not None:
            self.effort.nodes += found.made
            self.effort.states += found.made
            if found.order is not None:
                self._keep(found.order)
            self._raise(found.bound, "beam search over feasible subsets")
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
                # The others make themselves ready and anneal meanwhile. What is done here is not
                # to be done by all again: other methods wait for their turn.
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
    """Search a small instance by each method in turn, which compiles what any search calls."""
    instance = _instance()
    for method in METHODS:
        OrderingSearch(instance, (method,), rounds=1).run()
    # Costs of one direction only are searched by other moves.
    one_way = OrderingInstance(np.triu(instance.costs) + 1.0, instance.before)
    OrderingSearch(one_way, ("local-search",), rounds=1).run()
    # A search turns to this only where the others do not soon prove its optimum.
    relaxation = CutRelaxation(instance, instance.costs < NO_ARC)
    PairRelaxation(relaxation).run(_WORK_WARM_UP, np.inf, lambda: False, lambda duals: None)


def _instance() -> OrderingInstance:
    """Return places on a grid, some before others; the relaxation alone does not prove them."""
    nodes = np.arange(_NODES)
    x, y = 7 * nodes % 31, 11 * nodes**2 % 31
    costs = np.abs(x[:, None] - x) + np.abs(y[:, None] - y) + 0.0
    before = np.zeros((_NODES, _NODES), dtype=np.bool_)
    before[[1, 2, 3, 5, 6], [4, 4, 9, 8, 10]] = True
    return OrderingInstance(costs, before)
