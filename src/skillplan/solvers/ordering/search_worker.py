"""A worker of the parallel search: searches in a thread and reports its findings.

Nothing heavy is imported with this module, so that the process answers soon after its start.
"""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skillplan.workers.resident_memory import resident_bytes

if TYPE_CHECKING:
    from skillplan.solvers.ordering.incumbents import Effort, SharedIncumbent
    from skillplan.solvers.ordering.instance import Integers, OrderingInstance
    from skillplan.solvers.ordering.portfolio import Method, OrderingSearch

# How long a process waits for a new finding [s]; how often it reads its own memory [s].
_EVERY_S = 0.02
_MEMORY_EVERY_S = 0.01
_MEMORY_LIMIT = "memory limit"
# Linux: option of prctl that sets the signal for when the parent process ends.
_SET_PARENT_DEATH_SIGNAL = 1


@dataclass(frozen=True, slots=True)
class Share:
    """The search that a process is to run.

    Parameters
    ----------
    instance, methods, seed, rounds, start
        As for `OrderingSearch`.
    memory_bytes
        How much memory it may take [B], or None for no limit.
    """

    instance: OrderingInstance
    methods: tuple[Method, ...]
    seed: int
    rounds: int | None
    start: Integers | None
    memory_bytes: int | None


@dataclass(frozen=True, slots=True)
class Update:
    """What is sent to a process while it searches.

    Parameters
    ----------
    order, bound, bound_method
        Incumbent and bound of all processes; None where the order is not new.
    memory_bytes
        How much more memory it may take from now on [B], or None for no limit.
    """

    order: Integers | None
    bound: float
    bound_method: str
    memory_bytes: int | None


@dataclass(frozen=True, slots=True)
class Finding:
    """What a process reports.

    Parameters
    ----------
    order, bound, bound_method
        Its incumbent and bound; None where the order is not new.
    effort
        What it has done so far.
    resident_bytes
        The memory that it holds [B], or None where the system does not report it.
    ended
        Why its search is over; empty while it is not.
    """

    order: Integers | None
    bound: float
    bound_method: str
    effort: Effort
    resident_bytes: int | None
    ended: str


def prepare(content: None) -> Callable[[Share | Update], Finding]:
    """Return the job handler: a share begins the search, every update is answered by a finding."""
    _end_with_parent()
    # Imported before the first share is requested, so that the search begins at once.
    import skillplan.solvers.ordering.portfolio

    assert skillplan.solvers.ordering.portfolio is not None
    search: ShareSearch | None = None

    def respond(message: Share | Update) -> Finding:
        nonlocal search
        if isinstance(message, Share):
            search = ShareSearch(message)
        else:
            assert search is not None
            search.receive(message)
        return search.finding()

    return respond


def _end_with_parent() -> None:
    """Have the system end this process with its parent, even amid a long compiled call."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


class ShareSearch:
    """A search in a thread of its own.

    Parameters
    ----------
    share
        What to search; it begins at once.
    """

    def __init__(self, share: Share) -> None:
        self._changed = threading.Event()
        self._updates: deque[Update] = deque()
        self._best: Integers | None = None
        self._reported: Integers | None = None
        self._bound = (0.0, "")
        self._ended = ""
        self._search: OrderingSearch | None = None
        self._most_bytes: int | None = None
        self._look_s = 0.0
        self._was_short = False
        self._allow(share.memory_bytes)
        threading.Thread(target=self._run, args=(share,), daemon=True).start()

    def receive(self, update: Update) -> None:
        """Hand the incumbent and bound of other processes to the search."""
        self._allow(update.memory_bytes)
        self._updates.append(update)

    def finding(self) -> Finding:
        """Return the present finding, as soon as there is anything new or after a while."""
        from skillplan.solvers.ordering.incumbents import Effort

        self._changed.wait(_EVERY_S)
        self._changed.clear()
        # The order is read last: a proof must never be reported before the order that it is of.
        ended, (bound, method), order = self._ended, self._bound, self._best
        effort = Effort() if self._search is None else replace(self._search.effort)
        fresh = order is not self._reported
        self._reported = order
        return Finding(
            order if fresh else None,
            bound,
            method,
            effort,
            resident_bytes(),
            ended,
        )

    def _run(self, share: Share) -> None:
        from skillplan.solvers.ordering.portfolio import OrderingSearch

        try:
            self._search = search = OrderingSearch(
                share.instance,
                share.methods,
                seed=share.seed,
                stop=self._short,
                on_order=self._on_order,
                on_bound=self._on_bound,
                memory_bytes=self._left_bytes,
                start=share.start,
                rounds=share.rounds,
                shared=self._shared,
            )
            search.run()
            ended = "proof" if search.proved else search.ended or _MEMORY_LIMIT
        except MemoryError:
            ended = _MEMORY_LIMIT
        except Exception as error:
            ended = f"{type(error).__name__}: {error}"
        self._ended = ended
        self._changed.set()

    def _on_order(self, order: Integers, cost: float) -> None:
        self._best = order
        self._changed.set()

    def _on_bound(self, bound: float, nodes: int) -> None:
        assert self._search is not None
        if bound > self._bound[0]:
            self._bound = (bound, self._search.effort.bound_method)
            self._changed.set()

    def _shared(self) -> SharedIncumbent | None:
        """Return what was received since the last call, as one; None where nothing was."""
        from skillplan.solvers.ordering.incumbents import SharedIncumbent

        shared = None
        while self._updates:
            update = self._updates.popleft()
            order = update.order
            if order is None and shared is not None:
                order = shared.order
            shared = SharedIncumbent(order, update.bound, update.bound_method)
        return shared

    def _allow(self, more_bytes: int | None) -> None:
        held = resident_bytes()
        self._most_bytes = None if more_bytes is None or held is None else held + more_bytes

    def _left_bytes(self) -> int | None:
        most, held = self._most_bytes, resident_bytes()
        return None if most is None or held is None else max(0, most - held)

    def _short(self) -> bool:
        """Whether more memory was held than is allowed; measured once in a while only."""
        now_s = time.monotonic()
        if not self._was_short and now_s >= self._look_s:
            self._look_s = now_s + _MEMORY_EVERY_S
            self._was_short = self._left_bytes() == 0
        return self._was_short
