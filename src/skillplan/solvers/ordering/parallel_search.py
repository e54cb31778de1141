"""A search with others beside it, in processes of their own.

This process searches as it would alone. The others stress one or the other method, each with a
seed of its own, and whatever one finds or proves all know a moment later. So the cost that is
proved does not depend on the number of processes; which of several equally cheap orders is found,
and after how many nodes, does.
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
from skillplan.solvers.ordering.search_worker import Finding, Share, Word, prepare
from skillplan.workers.executor import Ended, Executor, Worker, packed
from skillplan.workers.resident_memory import resident_bytes_of
from skillplan.workers.worker_processes import LocalProcesses

_WHAT = "the search"
# What is proved sooner is not worth a process.
_PATIENCE_S = 1.0
_EVERY_S = 0.02
# What a process takes before it searches, and what it needs to be of use [bytes].
_PROCESS_BYTES = 400 * 1024**2
# With less left, processes are given up [bytes].
_KEPT_BYTES = 64 * 1024**2
# Between one process's seed and the next one's.
_SEEDS = 1_000_003
_EMPHASES: tuple[tuple[Method, ...], ...] = (
    ("local-search", "branch-and-cut"),
    ("local-search", "subset-dp", "tree-search"),
    ("local-search",),
)
# These take as much memory as they are given; they are given more than others.
_HUNGRY = frozenset({"subset-dp", "tree-search"})
_APPETITE = 4


@dataclass(eq=False)
class _Other:
    """A search beside this one, and what it was told and has told last."""

    process: Worker
    methods: tuple[Method, ...]
    seed: int
    told_cost: float = np.inf
    finding: Finding | None = None

    @property
    def resident_bytes(self) -> int:
        held = resident_bytes_of(self.process.number)
        if held is None and self.finding is not None:
            held = self.finding.resident_bytes
        return held or 0


class ParallelSearch:
    """A search and those beside it.

    A process that ends, whatever ends it, costs its share only: the others go on. So does one
    that is given up because memory is short.

    Parameters
    ----------
    search
        The search of this process; not begun. Its hooks are put through this one.
    processes
        How many there are, this one counted, >= 2.
    seed
        Governs the randomness of all.
    executor
        Where the others run; processes of this machine by default.

    Attributes
    ----------
    started
        How many processes have been at work, this one counted.
    lost
        In words, what ended those that ended before their time.
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
        search.on_bound = self._tell_bound

    @property
    def trace(self) -> dict[str, Any]:
        """What to put on record: how many processes there were, and what became of some."""
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
        """Hear and tell what is new, once in a while."""
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
        """Hear what a process has to say, and answer."""
        try:
            said = other.process.answer()
        except SkillplanError as error:
            self._lose(other, f"one failed: {error}")
            return
        if isinstance(said, Ended):
            self._lose(other, f"one was ended by {said.how}")
            return
        search = self.search
        order = search.order if search.cost < other.told_cost else None
        other.told_cost = search.cost
        memory_bytes = self._memory_of(other.methods)
        if said is None:
            other.process.take(
                Share(
                    search.instance, other.methods, other.seed, search.rounds, order, memory_bytes
                )
            )
            return
        finding: Finding = said.content
        self._note(finding)
        other.finding = finding
        if finding.ended:
            if finding.ended != "proof":
                self.lost.append(f"one ended: {finding.ended}")
            self._give_up(other)
            return
        other.process.take(Word(order, search.bound, search.effort.bound_method, memory_bytes))

    def _note(self, finding: Finding) -> None:
        if finding.order is not None:
            cost = self.search.instance.cost(finding.order)
            if cost < self._best[0]:
                self._best = (cost, finding.order)
        if finding.bound > self._proved[0]:
            self._proved = (finding.bound, finding.bound_method)

    def _lose(self, other: _Other, words: str) -> None:
        self.lost.append(words)
        self._give_up(other)

    def _give_up(self, other: _Other) -> None:
        self._others.remove(other)
        self._gone.append(other)
        other.process.end(gently=False)

    def _spare_memory(self) -> None:
        """Give up the largest process where memory is short; this one needs it more."""
        left = self._left_bytes()
        if left is not None and left < _KEPT_BYTES and self._others:
            largest = max(self._others, key=lambda other: other.resident_bytes)
            self._lose(largest, "one was given up: memory limit")

    def _left_bytes(self) -> int | None:
        """Return how much memory all processes together may still take, or None."""
        left = self._memory_bytes()
        if left is None:
            return None
        return max(0, left - sum(other.resident_bytes for other in self._others))

    def _own_memory_bytes(self) -> int | None:
        return self._memory_of(self.search.methods)

    def _memory_of(self, methods: tuple[Method, ...]) -> int | None:
        """Return one process's part of what is left."""
        left = self._left_bytes()
        if left is None:
            return None
        everyone = [self.search.methods, *(other.methods for other in self._others)]
        return int(left * _appetite(methods) / sum(map(_appetite, everyone)))

    def _tell_bound(self, bound: float, nodes: int) -> None:
        findings = [other.finding for other in (*self._others, *self._gone)]
        theirs = sum(found.effort.nodes for found in findings if found is not None)
        self._on_bound(bound, nodes + theirs)


def emphases(methods: tuple[Method, ...], count: int) -> list[tuple[Method, ...]]:
    """Return the methods of so many processes beside one that uses some methods.

    Beside one that uses all, each stresses some of them, and later ones use all again. Beside one
    that uses methods without randomness, which would do the same twice, they look for orders.
    """
    if set(methods) == set(METHODS):
        return [_EMPHASES[i] if i < len(_EMPHASES) else METHODS for i in range(count)]
    return [methods if "local-search" in methods else ("local-search",)] * count


def _appetite(methods: tuple[Method, ...]) -> int:
    return _APPETITE if _HUNGRY.intersection(methods) else 1
