"""The executor for Ray clusters.

Moritz et al., "Ray: A distributed framework for emerging AI applications", OSDI 2018: a worker is
an actor. Ray finds nodes, places actors, sends their content to each node once, and detects losses.
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

# Expected time to start a local cluster, and to join another one [s].
_START_S, _JOIN_S = 10.0, 2.0


class RayExecutor(Executor):
    """Runs jobs in actors of a Ray cluster: on this machine, or at ray:ADDRESS.

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
        """Options of the executor."""

        cpus: float = Field(
            default=1.0, ge=0, le=1024, description="CPUs that Ray keeps free for each worker [-]"
        )
        start_s: float = Field(
            default=120.0,
            gt=0,
            le=86_400,
            description="time limit until a worker is ready, waiting for CPUs included [s]",
        )
        object_store_mib: int = Field(
            default=256,
            ge=80,
            le=1024 * 1024,
            description="memory for sent objects of a local cluster [MiB]",
        )

    options: Options

    def __init__(self, slots: int, options: BaseModel | None = None, address: str = "") -> None:
        super().__init__(slots, options, address)
        self._workers: list[RayWorker] = []
        # Content of workers, sent to each node once.
        self._contents: dict[str, Any] = {}

    @property
    def refusal(self) -> str:
        """Reason why workers cannot be started here; else empty."""
        return "a process for jobs may not start others" if is_worker() else ""

    @property
    def start_up_s(self) -> float:
        """Expected delay of the next worker [s]: the start of Ray, once."""
        if is_connected():
            return 0.0
        return _JOIN_S if self.address else _START_S

    def start(self, prepare: Prepare, content: bytes, what: str) -> RayWorker:
        """Start an actor; parameters and errors as for `Executor.start`."""
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
        """Return the actors with a message, within `patience_s` [s]."""
        mine = [worker for worker in workers if isinstance(worker, RayWorker)]
        # Lost and ended actors count at once.
        silent: list[Worker] = [worker for worker in mine if not worker.alive or worker.overdue]
        streams = {worker.stream: worker for worker in mine if worker.stream is not None}
        if not streams:
            return silent
        ray = self._cluster().ray
        ready_streams, _ = ray.wait(
            list(streams), num_returns=1, timeout=0 if silent else patience_s
        )
        if ready_streams:
            ready_streams, _ = ray.wait(list(streams), num_returns=len(streams), timeout=0)
        ready = [streams[stream] for stream in ready_streams]
        return [*ready, *(worker for worker in silent if worker not in ready)]

    def close(self) -> None:
        """End all actors at once; new ones can be started."""
        for worker in self._workers:
            worker.end(gently=False)
        self._workers.clear()
        self._contents.clear()

    def _cluster(self) -> Cluster:
        return connected(self.address, self.options.object_store_mib)
