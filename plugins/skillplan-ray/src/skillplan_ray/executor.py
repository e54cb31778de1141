"""The executor that has a Ray cluster do the jobs.

Moritz et al., "Ray: A distributed framework for emerging AI applications", OSDI 2018: a worker is
an actor. Ray finds nodes, places actors, moves what they start from to each node once, and notices
what is lost; nothing of that is done here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, Field

from skillplan.task import back_end
from skillplan.workers.executor import POLL_S, Executor, Prepare, Worker, is_worker
from skillplan_ray.cluster import Cluster, connected, is_connected
from skillplan_ray.worker import RayWorker

# So long a cluster takes to start here, and one that has been started to join [s].
_START_S, _JOIN_S = 10.0, 2.0


class RayExecutor(Executor):
    """Do jobs in actors of a Ray cluster: of this machine, or at ray:ADDRESS.

    Parameters
    ----------
    slots, options, address
        As for `Executor`.

    Raises
    ------
    ValueError
        If `slots` is below 1.
    """

    name = "ray"
    takes_address = True
    shares_files = False

    class Options(back_end.Options):
        """How actors are started."""

        cpus: float = Field(
            default=1.0, ge=0, le=1024, description="CPUs that Ray keeps free for each worker [-]"
        )
        start_s: float = Field(
            default=120.0,
            gt=0,
            le=86_400,
            description="so long a worker may take to be ready, and to find room [s]",
        )
        object_store_mib: int = Field(
            default=256,
            ge=80,
            le=1024 * 1024,
            description="memory for what is sent, of a cluster that is started here [MiB]",
        )

    options: Options

    def __init__(self, slots: int, options: BaseModel | None = None, address: str = "") -> None:
        super().__init__(slots, options, address)
        self._workers: list[RayWorker] = []
        # What workers start from, sent to each node once however many start from it there.
        self._contents: dict[str, Any] = {}

    @property
    def refusal(self) -> str:
        """Why none can be started from here, in words; empty where they can."""
        return "a process for jobs may not start others" if is_worker() else ""

    @property
    def start_up_s(self) -> float:
        """About so long the next worker has its starter wait: for Ray, once [s]."""
        if is_connected():
            return 0.0
        return _JOIN_S if self.address else _START_S

    def start(self, prepare: Prepare, content: bytes, what: str) -> RayWorker:
        """Start an actor; parameters and errors are those of `Executor.start`."""
        cluster = self._cluster()
        key = hashlib.sha256(content).hexdigest()
        if key not in self._contents:
            self._contents[key] = cluster.ray.put(content)
        self._workers = [worker for worker in self._workers if worker.alive]
        worker = RayWorker(
            cluster,
            prepare,
            self._contents[key],
            what,
            cpus=self.options.cpus,
            patience_s=self.options.start_s,
        )
        self._workers.append(worker)
        return worker

    def first_ready(self, workers: Iterable[Worker], patience_s: float = POLL_S) -> list[Worker]:
        """Return the actors whose next answer is there, within `patience_s` [s]."""
        mine = [worker for worker in workers if isinstance(worker, RayWorker)]
        # Who is lost or ended says so at once.
        silent: list[Worker] = [one for one in mine if not one.alive or one.overdue]
        streams = {one.stream: one for one in mine if one.stream is not None}
        if not streams:
            return silent
        ray = self._cluster().ray
        found, _ = ray.wait(list(streams), num_returns=1, timeout=0 if silent else patience_s)
        if found:
            found, _ = ray.wait(list(streams), num_returns=len(streams), timeout=0)
        ready = [streams[stream] for stream in found]
        return [*ready, *(one for one in silent if one not in ready)]

    def close(self) -> None:
        """End all actors at once; more can be started afterwards."""
        for worker in self._workers:
            worker.end(gently=False)
        self._workers.clear()
        self._contents.clear()

    def _cluster(self) -> Cluster:
        return connected(self.address, self.options.object_store_mib)
