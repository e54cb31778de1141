"""A process beside a search of orders: improves orders and explores subtrees that it is given.

Each task says how much effort it is worth, so that what comes of it does not depend on how fast
the process is. Nothing heavy is imported with this module, so that the process answers soon after
its start.
"""

from __future__ import annotations

import ctypes
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skillplan.solvers.ordering.instance import Integers, OrderingInstance
    from skillplan.solvers.ordering.local_search.ruin_and_recreate import Annealing
    from skillplan.solvers.ordering.relaxation.branch_and_cut import (
        BranchAndCut,
        Seedling,
        Subproblem,
    )

# Linux: option of prctl that sets the signal for when the parent process ends.
_SET_PARENT_DEATH_SIGNAL = 1


@dataclass(frozen=True, slots=True)
class Ground:
    """What a process starts from: the ordering, and the seed of its randomness."""

    instance: OrderingInstance
    seed: int


@dataclass(frozen=True, slots=True)
class Improve:
    """Improve an order by so many moves of annealing; `cost` is inf where it is not feasible."""

    order: Integers
    cost: float
    moves: int


@dataclass(frozen=True, slots=True)
class Explore:
    """Explore some subtrees of branch and cut.

    Parameters
    ----------
    subproblems
        The roots of the subtrees.
    cost
        Of the best order known.
    work
        How much work to do at most, in the unit of `CutRelaxation.work`.
    seedling
        What the tree grows from; None where the process has had it before.
    """

    subproblems: list[Subproblem]
    cost: float
    work: int
    seedling: Seedling | None


@dataclass(frozen=True, slots=True)
class Finding:
    """What came of a task.

    Parameters
    ----------
    order
        The best order found, or None.
    open
        Subproblems that are left to explore.
    nodes, programs
        Moves made or subproblems bounded; linear programs solved.
    """

    order: Integers | None
    open: list[Subproblem]
    nodes: int
    programs: int


@dataclass(frozen=True, slots=True)
class Failure:
    """Nothing came of a task: why, in words."""

    words: str


def prepare(ground: Ground) -> Callable[[Improve | Explore], Finding | Failure]:
    """Return the function that does tasks, all on one instance."""
    _end_with_parent()
    # Imported before the first task is requested, so that it begins at once.
    from skillplan.solvers.ordering.local_search.ruin_and_recreate import Annealing
    from skillplan.solvers.ordering.relaxation import branch_and_cut

    assert branch_and_cut is not None
    return Hand(ground, Annealing(ground.instance, ground.seed))


def _end_with_parent() -> None:
    """Have the system end this process with its parent, even amid a long compiled call."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


class Hand:
    """Does tasks; its random numbers, cuts and pseudocosts go on from task to task.

    Parameters
    ----------
    ground
        The ordering.
    annealing
        What improves orders.
    """

    def __init__(self, ground: Ground, annealing: Annealing) -> None:
        self._instance = ground.instance
        self._annealing = annealing
        self._tree: BranchAndCut | None = None
        self._found: Integers | None = None

    def __call__(self, task: Improve | Explore) -> Finding | Failure:
        """Do a task."""
        self._found = None
        try:
            return self._improve(task) if isinstance(task, Improve) else self._explore(task)
        except Exception as error:
            return Failure(f"{type(error).__name__}: {error}")

    def _improve(self, task: Improve) -> Finding:
        best, least, nodes = None, task.cost, 0
        for order, moves in self._annealing.portions(task.order, task.cost, task.moves):
            nodes += moves
            cost = self._instance.cost(order)
            if cost < least and self._instance.feasible(order):
                best, least = order.copy(), cost
        return Finding(best, [], nodes, 0)

    def _explore(self, task: Explore) -> Finding:
        if task.seedling is not None:
            self._tree = task.seedling.grown(self._instance, task.cost, self._keep)
        tree = self._tree
        assert tree is not None
        tree.cost = task.cost
        before, programs = tree.subproblems, tree.relaxation.solves
        tree.take(task.subproblems)
        tree.run(task.work)
        return Finding(
            self._found,
            tree.give_all(),
            tree.subproblems - before,
            tree.relaxation.solves - programs,
        )

    def _keep(self, order: Integers) -> None:
        self._found = order.copy()
