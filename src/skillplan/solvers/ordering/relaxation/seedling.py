"""What a process needs to explore subtrees of a search tree that another one has begun."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from skillplan.solvers.ordering.instance import Booleans, Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.branch_and_cut import BranchAndCut
from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation


@dataclass(frozen=True)
class Seedling:
    """What another process needs to explore subtrees: what this one knows of the root.

    Parameters
    ----------
    arcs
        The arcs that a better order may take, shape (n, n).
    leave, reach
        The cuts, shape (cuts, n) each.
    start
        An order whose arcs are among the first columns, or None.
    gains, trials
        Pseudocosts so far, shape (2, n, n) each.
    """

    arcs: Booleans
    leave: Booleans
    reach: Booleans
    start: Integers | None
    gains: Floats
    trials: Floats

    @classmethod
    def of(cls, tree: BranchAndCut, start: Integers | None) -> Seedling:
        """Return what is known of a tree; `start` is the best order, or None."""
        relaxation = tree.relaxation
        cuts = relaxation.leave, relaxation.reach
        return cls(relaxation.arcs, *cuts, start, *tree.pseudocosts)

    def grown(
        self, instance: OrderingInstance, cost: float, on_order: Callable[[Integers], None]
    ) -> BranchAndCut:
        """Return a tree without any subproblem; `cost` is that of the best order known."""
        relaxation = CutRelaxation(instance, self.arcs, self.start)
        relaxation.add_cuts(self.leave, self.reach)
        tree = BranchAndCut(relaxation, cost, lambda: False, on_order, lambda bound, parts: None)
        tree.give_all()
        tree.learn(self.gains, self.trials)
        return tree
