"""Processes beside a search of orders: each does one task at a time and says what came of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillplan.errors import SkillplanError
from skillplan.solvers.ordering.instance import Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.branch_and_cut import BranchAndCut, Seedling, Subproblem
from skillplan.solvers.ordering.search_worker import (
    Explore,
    Failure,
    Finding,
    Ground,
    Improve,
    prepare,
)
from skillplan.workers.executor import Answer, Ended, Executor, Worker, packed
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.processes import resident_bytes_of

_WHAT = "the search"
_EVERY_S = 0.02
# Memory of a process before it searches, and the least that it needs [bytes].
_PROCESS_BYTES = 400 * 1024**2
# With less memory left, processes are ended [bytes].
_KEPT_BYTES = 64 * 1024**2
# Where less time is left than so many times what starting takes, none is started.
_WORTH = 2
# Difference of the seeds of two processes.
_SEEDS = 1_000_003


@dataclass(eq=False)
class Helper:
    """A process, the task it has or is to have, and what came of its last one."""

    process: Worker
    ready: bool = False
    task: Improve | Explore | None = None
    sent: bool = False
    finding: Finding | None = None

    @property
    def resident_bytes(self) -> int:
        """The memory that it holds [B], 0 where that is unknown."""
        return resident_bytes_of(self.process.number) or 0


class Helpers:
    """Processes that do tasks for a search.

    When one ends for whatever reason, its task comes to nothing and the others continue. The same
    holds for one that is ended because memory is short.

    Parameters
    ----------
    count
        How many, >= 1.
    seed
        Governs the randomness of all.
    executor
        Where they run; processes of this machine by default.
    memory_bytes
        Returns how much memory may still be taken, or None for no limit.
    left_s
        Returns how long the search may still take [s], or None for no limit.

    Attributes
    ----------
    count
        How many are wanted.
    started
        How many processes have been started, that of the search included.
    lost
        Why each process that ended early did so, in words.
    """

    def __init__(
        self,
        count: int,
        seed: int = 0,
        executor: Executor | None = None,
        memory_bytes: Callable[[], int | None] = lambda: None,
        left_s: Callable[[], float | None] = lambda: None,
    ) -> None:
        self.count = count
        self.started = 1
        self.lost: list[str] = []
        self._executor = LocalProcesses(count) if executor is None else executor
        self._seed = seed
        self._memory_bytes = memory_bytes
        self._left_s = left_s
        self._begun = False
        self._all: list[Helper] = []
        self._due_s = 0.0

    @property
    def trace(self) -> dict[str, Any]:
        """Figures for the trace: how many processes there were, and why some were lost."""
        trace: dict[str, Any] = {"processes": self.started}
        if self.lost:
            trace["lost_processes"] = self.lost
        return trace

    @property
    def idle(self) -> list[Helper]:
        """Those that have no task, in the order in which they were started."""
        return [helper for helper in self._all if helper.task is None]

    @property
    def left_bytes(self) -> int | None:
        """How much memory all processes together may still take [B], or None for no limit."""
        left = self._memory_bytes()
        if left is None:
            return None
        return max(0, left - sum(helper.resident_bytes for helper in self._all))

    def begin(self, instance: OrderingInstance) -> None:
        """Start the processes, once; they make themselves ready on their own."""
        if self._begun:
            return
        self._begun = True
        if self._executor.refusal:
            self.lost.append(f"none was started: {self._executor.refusal}")
            return
        left_s, start_up_s = self._left_s(), self._executor.start_up_s
        if left_s is not None and left_s < _WORTH * start_up_s:
            self.lost.append(f"none was started: that takes {start_up_s:g} s; time limit")
            return
        for number in range(1, self.count + 1):
            left = self.left_bytes
            if left is not None and left < _PROCESS_BYTES * (len(self._all) + 2):
                self.lost.append("one was not started: memory limit")
                continue
            ground = packed(Ground(instance, self._seed + number * _SEEDS), _WHAT)
            try:
                process = self._executor.start(prepare, ground, _WHAT)
            except SkillplanError as error:
                self.lost.append(f"one was not started: {error}")
                return
            self._all.append(Helper(process))
            self.started += 1

    def give(self, helper: Helper, task: Improve | Explore) -> None:
        """Give a task to a process that has none; it begins once the process is ready."""
        helper.task, helper.sent, helper.finding = task, False, None
        self._send(helper)

    def result(self, helper: Helper, stop: Callable[[], bool]) -> Finding | None:
        """Wait for what comes of a task; None where the process was lost, or on a stop."""
        while helper in self._all and helper.task is not None:
            if stop():
                return None
            self._hear(_EVERY_S)
        return helper.finding

    def attend(self) -> None:
        """Hear what processes say, and end some where memory is short; does so once in a while."""
        now_s = time.monotonic()
        if self._all and now_s >= self._due_s:
            self._due_s = now_s + _EVERY_S
            self._hear(0.0)
            self._spare_memory()

    def end(self) -> None:
        """End all processes at once."""
        for helper in self._all:
            helper.process.end(gently=False)
        self._all = []

    def _send(self, helper: Helper) -> None:
        # One that is not ready would not listen, and a long task would wait to be written.
        if helper.ready and helper.task is not None and not helper.sent:
            helper.sent = True
            helper.process.take(helper.task)

    def _hear(self, patience_s: float) -> None:
        by_process = {helper.process: helper for helper in self._all}
        for process in self._executor.first_ready(by_process, patience_s):
            self._note(by_process[process])

    def _note(self, helper: Helper) -> None:
        try:
            answer = helper.process.answer()
        except SkillplanError as error:
            self._lose(helper, f"one failed: {error}")
            return
        if isinstance(answer, Ended):
            self._lose(helper, f"one was ended by {answer.how}")
        elif isinstance(answer, Answer) and isinstance(answer.content, Failure):
            self._lose(helper, f"one failed: {answer.content.words}")
        elif isinstance(answer, Answer):
            helper.finding, helper.task = answer.content, None
        else:
            helper.ready = True
            self._send(helper)

    def _lose(self, helper: Helper, words: str) -> None:
        self.lost.append(words)
        self._all.remove(helper)
        helper.process.end(gently=False)

    def _spare_memory(self) -> None:
        """End the largest process where memory is short."""
        left = self.left_bytes
        if left is not None and left < _KEPT_BYTES and self._all:
            largest = max(self._all, key=lambda helper: helper.resident_bytes)
            self._lose(largest, "one was given up: memory limit")


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
            True if to stop now.
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
