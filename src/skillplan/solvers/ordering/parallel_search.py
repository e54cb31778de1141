"""Parallel portfolio: concurrent searches in processes that share incumbents and bounds.

This process searches as it would alone. The others emphasise one method or another, each with a
seed of its own, and all learn a moment later what one of them finds or proves. So the proved cost
does not depend on the number of processes; which of several equally cheap orders is found, and
after how many nodes, does.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillplan.errors import SkillplanError
from skillplan.solvers.ordering.incumbents import SharedIncumbent
from skillplan.solvers.ordering.instance import Integers
from skillplan.solvers.ordering.portfolio import METHODS, Method, OrderingSearch
from skillplan.solvers.ordering.search_worker import Finding, Share, Update, prepare
from skillplan.workers.executor import Ended, Executor, Worker, packed
from skillplan.workers.resident_memory import resident_bytes_of
from skillplan.workers.worker_processes import LocalProcesses

_WHAT = "the search"
# A search that is proved sooner is not worth a process [s].
_PATIENCE_S = 1.0
_EVERY_S = 0.02
# Memory of a process before it searches, and the least that it needs [bytes].
_PROCESS_BYTES = 400 * 1024**2
# With less memory left, processes are ended [bytes].
_KEPT_BYTES = 64 * 1024**2
# Difference of the seeds of two processes.
_SEEDS = 1_000_003
_EMPHASES: tuple[tuple[Method, ...], ...] = (
    ("local-search", "branch-and-cut"),
    ("local-search", "subset-dp", "tree-search"),
    ("local-search",),
)
# Methods that use all memory that they may; they get a larger share than others.
_MEMORY_BOUND = frozenset({"subset-dp", "tree-search"})
_MEMORY_WEIGHT = 4


@dataclass(eq=False)
class _Other:
    """A concurrent search: the last cost sent to it, and the last finding received."""

    process: Worker
    methods: tuple[Method, ...]
    seed: int
    sent_cost: float = np.inf
    finding: Finding | None = None

    @property
    def resident_bytes(self) -> int:
        held = resident_bytes_of(self.process.number)
        if held is None and self.finding is not None:
            held = self.finding.resident_bytes
        return held or 0


class ParallelSearch:
    """A search and those that run concurrently.

    When a process ends for whatever reason, only its own share is lost, and the others continue.
    The same holds for one that is ended because memory is short.

    Parameters
    ----------
    search
        The search of this process, not begun. Its callbacks are replaced by those of this class.
    processes
        How many processes there are, this one included, >= 2.
    seed
        Governs the randomness of all.
    executor
        Where the others run; processes of this machine by default.

    Attributes
    ----------
    started
        How many processes have been started, this one included.
    lost
        Why each process that ended early did so, in words.
    """

    def __init__(
        self,
        search: OrderingSearch,
        processes: int,
        seed: int = 0,
        executor: Executor | None = None,
    ) -> None:
        self.search = search
        self._executor = LocalProcesses(processes - 1) if executor is None else executor
        self.started = 1
        self.lost: list[str] = []
        self._wanted = emphases(search.methods, processes - 1)
        self._seed = seed
        self._others: list[_Other] = []
        self._gone: list[_Other] = []
        self._due_s = np.inf
        self._begun = False
        self._best: tuple[float, Integers | None] = (np.inf, None)
        self._proved = (0.0, "")
        self._memory_bytes = search.memory_bytes
        self._on_bound = search.on_bound
        search.shared = self._shared
        search.memory_bytes = self._own_memory_bytes
        search.on_bound = self._report_bound

    @property
    def trace(self) -> dict[str, Any]:
        """Figures for the trace: how many processes there were, and why some were lost."""
        trace: dict[str, Any] = {"processes": self.started}
        if self.lost:
            trace["lost_processes"] = self.lost
        return trace

    def run(self) -> None:
        """Search until the best order is proved, or it was stopped; then end all processes."""
        self._due_s = time.monotonic() + _PATIENCE_S
        try:
            self.search.run()
        finally:
            effort = self.search.effort
            for other in (*self._others, *self._gone):
                if other.finding is not None:
                    effort.nodes += other.finding.effort.nodes
                    effort.states += other.finding.effort.states
                    effort.parts += other.finding.effort.parts
                    effort.programs += other.finding.effort.programs
            for other in self._others:
                other.process.end(gently=False)
            self._others = []

    def _shared(self) -> SharedIncumbent | None:
        """Exchange incumbents and bounds with the others, once in a while."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return None
        self._due_s = now_s + _EVERY_S
        if not self._begun:
            self._begun = True
            self._start()
        if not self._others:
            return None
        by_process = {other.process: other for other in self._others}
        for process in self._executor.first_ready(by_process, 0.0):
            self._attend(by_process[process])
        self._spare_memory()
        cost, order = self._best
        bound, method = self._proved
        if cost < self.search.cost or bound > self.search.bound:
            return SharedIncumbent(order if cost < self.search.cost else None, bound, method)
        return None

    def _start(self) -> None:
        if self._executor.refusal:
            self.lost.append(f"none was started: {self._executor.refusal}")
            return
        content = packed(None, _WHAT)
        for number, methods in enumerate(self._wanted, start=1):
            left = self._left_bytes()
            if left is not None and left < _PROCESS_BYTES * (len(self._others) + 2):
                self.lost.append("one was not started: memory limit")
                continue
            try:
                process = self._executor.start(prepare, content, _WHAT)
            except SkillplanError as error:
                self.lost.append(f"one was not started: {error}")
                return
            self._others.append(_Other(process, methods, self._seed + number * _SEEDS))
            self.started += 1

    def _attend(self, other: _Other) -> None:
        """Receive the answer of a process, and reply."""
        try:
            answer = other.process.answer()
        except SkillplanError as error:
            self._lose(other, f"one failed: {error}")
            return
        if isinstance(answer, Ended):
            self._lose(other, f"one was ended by {answer.how}")
            return
        search = self.search
        order = search.order if search.cost < other.sent_cost else None
        other.sent_cost = search.cost
        memory_bytes = self._memory_of(other.methods)
        if answer is None:
            other.process.take(
                Share(
                    search.instance, other.methods, other.seed, search.rounds, order, memory_bytes
                )
            )
            return
        finding: Finding = answer.content
        self._note(finding)
        other.finding = finding
        if finding.ended:
            if finding.ended != "proof":
                self.lost.append(f"one ended: {finding.ended}")
            self._end(other)
            return
        other.process.take(Update(order, search.bound, search.effort.bound_method, memory_bytes))

    def _note(self, finding: Finding) -> None:
        if finding.order is not None:
            cost = self.search.instance.cost(finding.order)
            if cost < self._best[0]:
                self._best = (cost, finding.order)
        if finding.bound > self._proved[0]:
            self._proved = (finding.bound, finding.bound_method)

    def _lose(self, other: _Other, words: str) -> None:
        self.lost.append(words)
        self._end(other)

    def _end(self, other: _Other) -> None:
        self._others.remove(other)
        self._gone.append(other)
        other.process.end(gently=False)

    def _spare_memory(self) -> None:
        """End the largest process where memory is short."""
        left = self._left_bytes()
        if left is not None and left < _KEPT_BYTES and self._others:
            largest = max(self._others, key=lambda other: other.resident_bytes)
            self._lose(largest, "one was given up: memory limit")

    def _left_bytes(self) -> int | None:
        """Return how much memory all processes together may still take [B], or None."""
        left = self._memory_bytes()
        if left is None:
            return None
        return max(0, left - sum(other.resident_bytes for other in self._others))

    def _own_memory_bytes(self) -> int | None:
        return self._memory_of(self.search.methods)

    def _memory_of(self, methods: tuple[Method, ...]) -> int | None:
        """Return one process's share of the memory left [B], or None."""
        left = self._left_bytes()
        if left is None:
            return None
        everyone = [self.search.methods, *(other.methods for other in self._others)]
        return int(left * _memory_weight(methods) / sum(map(_memory_weight, everyone)))

    def _report_bound(self, bound: float, nodes: int) -> None:
        findings = [other.finding for other in (*self._others, *self._gone)]
        theirs = sum(found.effort.nodes for found in findings if found is not None)
        self._on_bound(bound, nodes + theirs)


def emphases(methods: tuple[Method, ...], count: int) -> list[tuple[Method, ...]]:
    """Return the methods of further processes, one entry for each.

    Where the first process uses all methods, each further one emphasises some of them, and later
    ones use all again. Where it uses deterministic methods only, which would do the same work
    twice, the others search for orders.

    Parameters
    ----------
    methods
        Those of the first process.
    count
        How many further processes there are, >= 0.
    """
    if set(methods) == set(METHODS):
        return [_EMPHASES[i] if i < len(_EMPHASES) else METHODS for i in range(count)]
    return [methods if "local-search" in methods else ("local-search",)] * count


def _memory_weight(methods: tuple[Method, ...]) -> int:
    return _MEMORY_WEIGHT if _MEMORY_BOUND.intersection(methods) else 1
