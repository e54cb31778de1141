"""A worker process of an ordering search: improves orders and explores subtrees.

Each task has an amount of effort, so its result does not depend on speed. This module imports
nothing heavy, so that a process answers soon after its start.
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

# Linux: option of prctl that sets the signal at the end of the parent process.
_SET_PARENT_DEATH_SIGNAL = 1


@dataclass(frozen=True, slots=True)
class Ground:
    """Initial data of a process: the ordering and its seed."""

    instance: OrderingInstance
    seed: int


@dataclass(frozen=True, slots=True)
class Improve:
    """Improve an order by a number of annealing moves; `cost` is inf for an infeasible order."""

    order: Integers
    cost: float
    moves: int


@dataclass(frozen=True, slots=True)
class Explore:
    """Explore subtrees of branch and cut.

    Parameters
    ----------
    work
        Greatest work, in the unit of `CutRelaxation.work`.
    seedling
        Data of the root node; None if the process has it already.
    """

    subproblems: list[Subproblem]
    cost: float
    work: int
    seedling: Seedling | None


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of a task.

    Parameters
    ----------
    nodes, programs
        Moves or subproblems; linear programs solved.
    """

    order: Integers | None
    open: list[Subproblem]
    nodes: int
    programs: int


@dataclass(frozen=True, slots=True)
class Failure:
    """Reason why a task has no result."""

    words: str


def prepare(ground: Ground) -> Callable[[Improve | Explore], Finding | Failure]:
    """Return the function that runs tasks on one instance."""
    _end_with_parent()
    # Imported before the first task, which then starts at once.
    from skillplan.solvers.ordering.local_search.ruin_and_recreate import Annealing
    from skillplan.solvers.ordering.relaxation import branch_and_cut

    assert branch_and_cut is not None
    return Hand(ground, Annealing(ground.instance, ground.seed))


def _end_with_parent() -> None:
    """Let the system end this process with its parent, even during a long compiled call."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


class Hand:
    """Runs tasks; random numbers, cuts and pseudocosts continue from task to task."""

    def __init__(self, ground: Ground, annealing: Annealing) -> None:
        self._instance = ground.instance
        self._annealing = annealing
        self._tree: BranchAndCut | None = None
        self._found: Integers | None = None

    def __call__(self, task: Improve | Explore) -> Finding | Failure:
        """Run a task."""
        self._found = None
        try:
            return self._improve(task) if isinstance(task, Improve) else self._explore(task)
        except Exception as error:
            return Failure(f"{type(error).__name__}: {error}")

    def _improve(self, task: Improve) -> Finding:
        best, lowest, nodes = None, task.cost, 0
        for order, moves in self._annealing.portions(task.order, task.cost, task.moves):
            nodes += moves
            cost = self._instance.cost(order)
            if cost < lowest and self._instance.feasible(order):
                best, lowest = order.copy(), cost
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
