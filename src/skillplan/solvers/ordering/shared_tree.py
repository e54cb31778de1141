"""Branch and cut by subtrees: its open subproblems are dealt to several processes, time and again.

How much each may do is counted in work, not in seconds, and what they leave is dealt anew in an
order that does not depend on which was faster. So the same tree is searched in every run.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillplan.solvers.ordering.helper_processes import Helper, Helpers
from skillplan.solvers.ordering.instance import Integers
from skillplan.solvers.ordering.relaxation.branch_and_cut import BranchAndCut, Subproblem
from skillplan.solvers.ordering.relaxation.seedling import Seedling
from skillplan.solvers.ordering.search_worker import Explore

# Work of each process between two deals; and of this one alone while there is little to deal.
_TURN = 5_000_000
_ALONE = 1_000_000
# With fewer subproblems for each process there is little to deal.
_FEW = 2


class SharedTree:
    """A search tree and the processes that explore it.

    Parameters
    ----------
    branching
        The tree of this process.
    helpers
        The other processes.

    Attributes
    ----------
    parts, programs
        Subproblems bounded and linear programs solved by the others.
    """

    def __init__(self, branching: BranchAndCut, helpers: Helpers) -> None:
        self._branching = branching
        self._helpers = helpers
        self._planted: set[Helper] = set()
        self.parts = 0
        self.programs = 0

    def run(self, work: int, order: Integers | None, stop: Callable[[], bool], keep: Keep) -> None:
        """Explore until the tree is done, was stopped, or each process has done so much work.

        Parameters
        ----------
        work
            In the unit of `CutRelaxation.work`.
        order
            The best order known, or None.
        stop
            Whether to stop now.
        keep
            Called with every order that another process has found.
        """
        branching = self._branching
        while work > 0 and not branching.done and not stop():
            others = self._helpers.idle
            if others and branching.open >= _FEW * (len(others) + 1):
                turn = min(work, _TURN)
                self._explore(others, turn, order, keep, stop)
            else:
                turn = min(work, _ALONE)
                branching.run(turn)
            work -= turn

    def _explore(
        self,
        others: list[Helper],
        work: int,
        order: Integers | None,
        keep: Keep,
        stop: Callable[[], bool],
    ) -> None:
        """Explore a share of the subproblems, while others explore theirs."""
        branching = self._branching
        shares = branching.deal(len(others))
        for helper, share in zip(others, shares, strict=True):
            seedling = None
            if helper not in self._planted:
                self._planted.add(helper)
                seedling = Seedling.of(branching, order)
            self._helpers.give(helper, Explore(share, branching.cost, work, seedling))
        branching.elsewhere = _least(shares)
        branching.run(work)
        for i, helper in enumerate(others):
            finding = self._helpers.result(helper, stop)
            if finding is None:
                branching.take(shares[i])
            else:
                self.parts += finding.nodes
                self.programs += finding.programs
                if finding.order is not None:
                    keep(finding.order)
                    cost = branching.instance.cost(finding.order)
                    branching.cost = min(branching.cost, cost)
                branching.take(finding.open)
            branching.elsewhere = _least(shares[i + 1 :])


Keep = Callable[[Integers], None]


def _least(shares: list[list[Subproblem]]) -> float:
    return min((one.bound for share in shares for one in share), default=np.inf)
