"""Worker processes of an ordering search, and a search tree that they share."""

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
from skillplan.workers.executor import Answer, Ended, Executor, Worker, pack_content
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.processes import measure_resident_bytes_of

_WHAT = "the search"
_EVERY_S = 0.02
# Memory of a process before it searches, and least memory that it needs [B].
_PROCESS_BYTES = 400 * 1024**2
# Free memory below which processes are ended [B].
_KEPT_BYTES = 64 * 1024**2
# A process is started only if the time left exceeds its start-up time by this factor.
_WORTH = 2
# Difference of the seeds of two processes.
_SEEDS = 1_000_003


@dataclass(eq=False)
class Helper:
    """A process with its current task and the result of its last one."""

    process: Worker
    ready: bool = False
    task: Improve | Explore | None = None
    sent: bool = False
    finding: Finding | None = None

    @property
    def resident_bytes(self) -> int:
        """Memory of the process [B], 0 if unknown."""
        return measure_resident_bytes_of(self.process.number) or 0


class Helpers:
    """Processes that work for a search.

    If a process ends for any reason, or is ended for lack of memory, its task has no result and the
    others continue.

    Parameters
    ----------
    count
        Number of processes, >= 1.
    executor
        Executor of the processes; None for this machine.
    memory_bytes
        Returns the free memory [B], or None for no limit.
    left_s
        Returns the remaining time [s], or None for no limit.
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
        """Figures for the trace: number of processes, and reasons of losses."""
        trace: dict[str, Any] = {"processes": self.started}
        if self.lost:
            trace["lost_processes"] = self.lost
        return trace

    @property
    def idle(self) -> list[Helper]:
        """Idle processes in the order of their start."""
        return [helper for helper in self._all if helper.task is None]

    @property
    def left_bytes(self) -> int | None:
        """Free memory for all processes [B], or None for no limit."""
        left = self._memory_bytes()
        if left is None:
            return None
        return max(0, left - sum(helper.resident_bytes for helper in self._all))

    def begin(self, instance: OrderingInstance) -> None:
        """Start the processes once; they initialise on their own."""
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
            ground = pack_content(Ground(instance, self._seed + number * _SEEDS), _WHAT)
            try:
                process = self._executor.start(prepare, ground, _WHAT)
            except SkillplanError as error:
                self.lost.append(f"one was not started: {error}")
                return
            self._all.append(Helper(process))
            self.started += 1

    def give(self, helper: Helper, task: Improve | Explore) -> None:
        """Give a task to an idle process; it begins once the process is ready."""
        helper.task, helper.sent, helper.finding = task, False, None
        self._send(helper)

    def result(self, helper: Helper, stop: Callable[[], bool]) -> Finding | None:
        """Wait for the result of a task; None if the process was lost or the search was stopped."""
        while helper in self._all and helper.task is not None:
            if stop():
                return None
            self._hear(_EVERY_S)
        return helper.finding

    def attend(self) -> None:
        """Read messages of processes, and end some if memory is short; rate-limited."""
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
        # A process that is starting does not read messages, and a large task would block.
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
        """End the largest process if memory is short."""
        left = self.left_bytes
        if left is not None and left < _KEPT_BYTES and self._all:
            largest = max(self._all, key=lambda helper: helper.resident_bytes)
            self._lose(largest, "one was given up: memory limit")


# Work of each process between two deals, and of this process alone while there is little to deal.
_TURN = 5_000_000
_ALONE = 1_000_000
# Least number of subproblems for each process that are worth a deal.
_FEW = 2


class SharedTree:
    """A search tree and the processes that explore it."""

    def __init__(self, branching: BranchAndCut, helpers: Helpers) -> None:
        self._branching = branching
        self._helpers = helpers
        self._planted: set[Helper] = set()
        self.parts = 0
        self.programs = 0

    def run(self, work: int, order: Integers | None, stop: Callable[[], bool], keep: Keep) -> None:
        """Explore until the tree is done, stopped, or each process has done its work.

        Parameters
        ----------
        work
            Work in the unit of `CutRelaxation.work`.
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
        """Explore a share of the subproblems while others explore theirs."""
        branching = self._branching
        shares = branching.deal(len(others))
        for helper, share in zip(others, shares, strict=True):
            seedling = None
            if helper not in self._planted:
                self._planted.add(helper)
                seedling = Seedling.of(branching, order)
            self._helpers.give(helper, Explore(share, branching.cost, work, seedling))
        branching.elsewhere = _find_least(shares)
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
            branching.elsewhere = _find_least(shares[i + 1 :])


Keep = Callable[[Integers], None]


def _find_least(shares: list[list[Subproblem]]) -> float:
    return min((helper.bound for share in shares for helper in share), default=np.inf)
