"""A worker on the head: the handle of an actor, and its messages."""

from __future__ import annotations

import pickle
import time
from collections import deque
from functools import partial
from typing import Any

from skillplan.errors import SkillplanError
from skillplan.workers.executor import Answer, Ended, News, Prepare, Worker
from skillplan_ray.actor import BROKEN, DONE, FAILED, NEWS, READY
from skillplan_ray.cluster import Cluster

# Ray's message for a lost machine, in contrast to a lost process.
_NODE_LOST = ("node has died", "node died", "node was terminated", "node failure")


class RayWorker(Worker):
    """A worker in an actor.

    Parameters
    ----------
    cluster
        Cluster of the actor.
    prepare, what
        As for `Executor.start`.
    content
        A reference to what it starts from.
    cpus
        Reserved CPUs, >= 0.
    patience_s
        Time limit until it is ready [s].
    """

    def __init__(
        self,
        cluster: Cluster,
        prepare: Prepare,
        content: Any,
        what: str,
        *,
        cpus: float,
        patience_s: float,
    ) -> None:
        super().__init__(what)
        self._cluster = cluster
        self._make_actor = partial(cluster.actor, prepare, content, cpus)
        self._job: bytes | None = None
        # Expected messages, one stream per call, in order.
        self._streams: deque[Any] = deque()
        self._begin()
        self._due_s = time.monotonic() + patience_s
        self._started = False
        self._lost = False
        self._ended = False

    @property
    def number(self) -> int | None:
        """None, because it runs elsewhere."""
        return None

    @property
    def alive(self) -> bool:
        """True if it can take a job, as known here."""
        return not (self._ended or self._lost)

    @property
    def stream(self) -> Any:
        """Reference to wait for, or None."""
        return self._streams[0] if self._streams and self.alive else None

    @property
    def overdue(self) -> bool:
        """True if it has exceeded the time limit for its start."""
        return not self._started and self.alive and time.monotonic() > self._due_s

    def take(self, job: Any) -> None:
        """Start a job; the worker must be idle."""
        if self.alive:
            self._job = pickle.dumps(job)
            self._do()

    def answer(self) -> Answer | News | Ended | None:
        """Return the answer, news, or the end of the worker; None if there is nothing yet.

        Raises
        ------
        SkillplanError
            If it could not become ready, with its message; or if its node differs from this
            machine.
        """
        if self._lost or self._ended:
            return Ended(None, self._started)
        ray = self._cluster.ray
        if self.overdue and not ray.wait([self.stream], timeout=0)[0]:
            raise self.not_started()
        try:
            kind, content = ray.get(next(self._streams[0]))
        except StopIteration:
            self._streams.popleft()
            return None
        except ray.exceptions.RayTaskError as error:
            self.end(gently=False)
            raise SkillplanError(
                f"A process for {self.what} could not be started on the cluster: "
                f"{type(error.cause).__name__}: {error.cause}"
            ) from None
        except ray.exceptions.RayError as error:
            return self._lose(error)
        return self._meaning(kind, content)

    def _begin(self) -> None:
        """Start an actor, and start its pending job."""
        self._actor, self._cpus = self._make_actor()
        self._streams.clear()
        self._streams.append(self._actor.make_ready.options(num_returns="streaming").remote())
        if self._job is not None:
            self._do()

    def _do(self) -> None:
        self._streams.append(self._actor.do.options(num_returns="streaming").remote(self._job))

    def _meaning(self, kind: str, content: Any) -> Answer | News | Ended | None:
        if kind == READY:
            self._started = True
            self._cluster.check("a node that joined later", content)
            self._streams.popleft()
            return None
        if kind == FAILED:
            error_class, words = content
            raise error_class(words)
        if kind == NEWS:
            return News(pickle.loads(content))
        self._streams.popleft()
        if kind == BROKEN:
            self.end(gently=False)
            return Ended(content, self._started)
        assert kind == DONE
        return Answer(pickle.loads(content))

    def _lose(self, error: Exception) -> Ended | None:
        words = str(error)
        node = any(sign in words for sign in _NODE_LOST)
        if node and not self._started and time.monotonic() < self._due_s:
            # For a moment, Ray places actors on a machine that is being lost; no job has begun
            # there.
            self._cluster.give_back(self._cpus)
            self._begin()
            return None
        self._lost = True
        address = next(
            (line.partition("ip:")[2].strip() for line in words.splitlines() if "ip:" in line), ""
        )
        cause = f"the loss of its {'machine' if node else 'process'}"
        return Ended(None, self._started, f"{cause} on {address}" if address else cause)

    def ask_to_stop(self) -> None:
        """Request a stop, while its job runs."""
        if self.alive:
            self._actor.stop.remote()

    def end(self, *, gently: bool = True) -> None:
        """End the worker, once it is idle or at once; no effect if it has ended."""
        if self._ended:
            return
        self._ended = True
        self._cluster.give_back(self._cpus)
        if self._cluster.alive:
            if gently and self._streams and not self._lost:
                self._actor.__ray_terminate__.remote()
            else:
                self._cluster.ray.kill(self._actor, no_restart=True)
        self._streams.clear()

    def not_started(self) -> SkillplanError:
        """Return the error for a worker that was not ready in time, or was lost before."""
        ray = self._cluster.ray
        free, total = (
            float(resources().get("CPU", 0.0))
            for resources in (ray.available_resources, ray.cluster_resources)
        )
        return SkillplanError(
            f"A process for {self.what} could not be started on the cluster, of whose {total:g} "
            f"CPUs {free:g} are free. -O ray.start_s=S waits longer, -O ray.cpus=0 shares them."
        )
