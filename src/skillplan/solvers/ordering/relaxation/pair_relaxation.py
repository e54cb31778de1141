"""An extended formulation: a linear relaxation with a precedence variable for every open pair.

Stronger than `cut_relaxation` where precedence is dense, and costlier: there is a variable for
every arc, and one for every pair of nodes that may come in either order. Cuts by maximum flow hold
between any two nodes then, as far as one comes before the other (after Gouveia and Pesneau, "On
extended formulations for the precedence constrained asymmetric traveling salesman problem",
2006).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillplan.solvers.ordering.instance import Floats, Integers
from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation
from skillplan.solvers.ordering.relaxation.pair_program import PairProgram, terms_of
from skillplan.solvers.ordering.relaxation.precedence_cuts import pairs_of, separate_between
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals
from skillplan.solvers.ordering.relaxation.transitivity_cuts import violated_triples

# Cuts of a kind that are added in a round, and pairs of nodes separated for at a time.
_MOST = 150
_LOOK = 1500
_VIOLATION = 0.03
_TIE_VIOLATION = 0.02
# The relaxation ends where so many rounds gain less than this share of the gap.
_PATIENCE = 20
_GAIN = 0.01
# Work per arc of a separation, in the unit of the program's work.
_FLOW_WORK = 4


class PairRelaxation:
    """The relaxation of an instance; it resumes with more work than before.

    Parameters
    ----------
    relaxation
        Its arcs and cuts are the first ones.

    Attributes
    ----------
    duals
        The best bound so far, None before there is one.
    exhausted
        Whether more work would gain nothing.
    """

    def __init__(self, relaxation: CutRelaxation) -> None:
        self.instance = instance = relaxation.instance
        self._program = PairProgram(instance, relaxation.arcs, relaxation.scale)
        ones = np.ones(len(relaxation.leave))
        self._program.add_cuts(relaxation.leave, relaxation.reach, ones, terms_of())
        for cut in relaxation.set_ups:
            self._program.add_sum(cut.arcs, cut.least)
        possible = ~instance.before.T
        np.fill_diagonal(possible, False)
        rest = np.argwhere(possible[1:-1, 1:-1]) + 1
        self._core, _ = pairs_of(instance.before)
        self._rest = np.random.default_rng(0).permutation(rest)
        self._next = 0
        self._bounds: list[float] = []
        self.duals: Duals | None = None
        self._flow_work = 0
        self.exhausted = False

    @property
    def work(self) -> int:
        """Simplex steps and flows times their sizes: proportional to the time."""
        return self._program.work + self._flow_work

    def run(
        self,
        work: int,
        cutoff: float,
        stop: Callable[[], bool],
        on_bound: Callable[[Duals], None],
    ) -> None:
        """Add cuts until the work is done, the bound reaches the cutoff or nothing is gained."""
        most = self.work + work
        while not self.exhausted and self.work < most and not stop():
            values = self._program.solve(stop)
            if values is None or stop():
                self.exhausted = values is None
                return
            duals = self._program.proved()
            if self.duals is None or duals.bound > self.duals.bound:
                self.duals = duals
                on_bound(duals)
            if self.duals.bound >= cutoff:
                return
            self._bounds.append(self.duals.bound)
            if len(self._bounds) > _PATIENCE:
                gained = self.duals.bound - self._bounds[-1 - _PATIENCE]
                if gained < _GAIN * (cutoff - self.duals.bound):
                    self.exhausted = True
                    return
            self._program.forbid(duals, cutoff)
            self._program.drop()
            self.exhausted = not self._cut(values)

    def _cut(self, values: Floats) -> bool:
        """Separate violated cuts and add them; return whether there were any."""
        program = self._program
        before = program.rows
        taken, earlier = program.taken(values), program.earlier(values)
        self._tie(taken, earlier)
        tails, heads = np.nonzero(taken > 1e-7)
        flow = tails, heads, taken[tails, heads]
        found = self._cut_between(flow, earlier, self._core, _MOST)
        # Where no other cut was found, all pairs are separated for.
        wanted = 4 * _LOOK if program.rows > before else len(self._rest)
        looked = 0
        while found < _MOST and looked < min(wanted, len(self._rest)):
            chosen = (self._next + np.arange(min(_LOOK, len(self._rest)))) % len(self._rest)
            self._next = int((self._next + _LOOK) % len(self._rest))
            found += self._cut_between(flow, earlier, self._rest[chosen], _MOST - found)
            looked += len(chosen)
        return program.rows > before

    def _tie(self, taken: Floats, earlier: Floats) -> None:
        """Add rows that link arcs to pairs, and violated transitivity cuts."""
        program = self._program
        untied = (taken - earlier > _TIE_VIOLATION) & program.varies & (program.arc >= 0)
        i, j = np.nonzero(untied)
        row = np.arange(len(i))
        program.add(
            np.zeros(len(i)), (row, program.arc[i, j], -np.ones(len(i))), terms_of((row, i, j, 1.0))
        )
        first, between, last, amount = violated_triples(earlier, taken, _TIE_VIOLATION)
        worst = np.argsort(-amount, kind="stable")[: 4 * _MOST]
        first, between, last = first[worst], between[worst], last[worst]
        row = np.arange(len(first))
        has = program.arc[first, last] >= 0
        program.add(
            -np.ones(len(first)),
            (row[has], program.arc[first, last][has], -np.ones(int(has.sum()))),
            terms_of(
                (row, first, last, 1.0), (row, first, between, -1.0), (row, between, last, -1.0)
            ),
            np.stack((first, between, last), axis=1),
        )

    def _cut_between(
        self, flow: tuple[Integers, Integers, Floats], earlier: Floats, pairs: Integers, most: int
    ) -> int:
        """Add the most violated cuts between pairs of nodes; return how many."""
        self._flow_work += _FLOW_WORK * len(pairs) * (len(flow[0]) + self.instance.n)
        arrive, depart, violated = separate_between(*flow, earlier, pairs, _VIOLATION)
        worst = np.argsort(-violated, kind="stable")[:most]
        worst = worst[violated[worst] > 0]
        many = len(worst)
        if not many:
            return 0
        arrive, depart = arrive[worst], depart[worst]
        i, j = pairs[worst].T
        row = np.arange(many)
        before = self.instance.before
        barred = before[:, i].T | before[j]
        leave, reach = depart & ~barred, ~arrive & ~barred
        leave[row, j] = reach[row, i] = False
        through = arrive & ~depart & ~barred
        through[row, i] = through[row, j] = False
        cut, node = np.nonzero(through)
        early = earlier[i[cut], node] <= earlier[node, j[cut]]
        late = ~early
        self._program.add_cuts(
            leave,
            reach,
            np.zeros(many),
            terms_of(
                (row, i, j, -1.0),
                (cut[early], i[cut[early]], node[early], 1.0),
                (cut[late], node[late], j[cut[late]], 1.0),
            ),
        )
        return many
