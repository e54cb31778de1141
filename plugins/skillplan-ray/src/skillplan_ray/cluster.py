"""The connection to a cluster: one for this process, however many executors there are."""

from __future__ import annotations

import importlib
import logging
import os
import pickle
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any

from skillplan.errors import SkillplanError
from skillplan.workers.supervised import requests
from skillplan_ray import fingerprint as fingerprints
from skillplan_ray.access import on_loopback, refuse_open_cluster, require_token, session_folder
from skillplan_ray.actor import LISTENING, THREADS, Actor
from skillplan_ray.fingerprint import differences, fingerprint

# So long a node may take to say what it is like [s].
_ANSWER_S = 60.0


class Cluster:
    """A Ray cluster that this process is connected to.

    Parameters
    ----------
    address
        As `ray.init` takes it; empty for a cluster of this machine alone, which is started.
    object_store_mib
        Memory for what is sent, of a cluster that is started here [MiB].

    Attributes
    ----------
    address
        As given.
    ray
        The module; imported here and nowhere before.

    Raises
    ------
    SkillplanError
        If no cluster answers or can be started, or its nodes differ from this machine.
    """

    def __init__(self, address: str, object_store_mib: int) -> None:
        # Nothing is reported to anybody, and nobody is asked anything on the way.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        if not address:
            require_token()
        self.ray: Any = importlib.import_module("ray")
        self.address = address
        self._here = fingerprint()
        self._known: set[str] = set()
        self._taken_cpus = 0.0
        words: dict[str, Any] = {"address": address or "local"}
        if not address:
            words["object_store_memory"] = object_store_mib * 1024**2
            words["include_dashboard"] = False
            words["_temp_dir"] = session_folder()
        try:
            with signals_held(), _stdout_kept(), nullcontext() if address else on_loopback():
                self.ray.init(log_to_driver=False, logging_level=logging.ERROR, **words)
        except Exception as error:
            raise SkillplanError(_no_cluster(address, error)) from error
        if not address:
            refuse_open_cluster(self.ray)
        _keep_stdout_clean()
        self._class = self.ray.remote(concurrency_groups={LISTENING: 1})(_listening(self.ray))
        self.ray.cloudpickle.register_pickle_by_value(fingerprints)
        self._refuse_mixed()

    @property
    def alive(self) -> bool:
        """Whether this process is still connected."""
        return bool(self.ray.is_initialized())

    def actor(self, prepare: Any, content: Any, cpus: float) -> tuple[Any, float]:
        """Return the handle of a new actor and the CPUs that are kept free for it.

        Where all CPUs of the cluster are taken by this process already, further actors get none of
        their own: as with processes of one machine, the user says how many there are.

        Parameters
        ----------
        prepare
            The function that makes it ready.
        content
            A reference to what it starts from.
        cpus
            That it is to have, >= 0.
        """
        total = float(self.ray.cluster_resources().get("CPU", 0.0))
        kept = cpus if self._taken_cpus + cpus <= total else 0.0
        self._taken_cpus += kept
        threads = {name: os.environ[name] for name in THREADS if name in os.environ}
        options = self._class.options(num_cpus=kept, scheduling_strategy="SPREAD", max_restarts=0)
        return options.remote(pickle.dumps(prepare), content, threads), kept

    def give_back(self, cpus: float) -> None:
        """Note that an actor with so many CPUs of its own has been ended."""
        self._taken_cpus -= cpus

    def check(self, place: str, there: Mapping[str, str]) -> None:
        """Refuse a machine that differs from this one.

        Parameters
        ----------
        place
            What it is called in a message.
        there
            Its fingerprint.

        Raises
        ------
        SkillplanError
            If anything differs on which a verdict may depend, naming it.
        """
        found = differences(self._here, there)
        if found:
            raise SkillplanError(_mixed([f"{place}: {', '.join(found)}"]))

    def _refuse_mixed(self) -> None:
        """Ask every node what it is like, before anything is done."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        probe = self.ray.remote(num_cpus=0, max_retries=0)(fingerprint)
        asked = {
            node["NodeManagerAddress"] + f" ({node['NodeID'][:8]})": probe.options(
                scheduling_strategy=NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
            ).remote()
            for node in self.ray.nodes()
            if node["Alive"]
        }
        odd = []
        for place, answer in asked.items():
            try:
                found = differences(self._here, self.ray.get(answer, timeout=_ANSWER_S))
            except self.ray.exceptions.RayError as error:
                found = [f"does not answer: {first_line(error)}"]
            if found:
                odd.append(f"{place}: {', '.join(found)}")
        if odd:
            self.ray.shutdown()
            raise SkillplanError(_mixed(odd))


_connected: list[Cluster] = []


def connected(address: str, object_store_mib: int) -> Cluster:
    """Return the connection of this process; made when first needed.

    Parameters
    ----------
    address, object_store_mib
        As for `Cluster`.

    Raises
    ------
    SkillplanError
        If there is none to be had, or one to another cluster.
    """
    if not is_connected():
        _connected.clear()
        _connected.append(Cluster(address, object_store_mib))
    if _connected[0].address != address:
        there = _connected[0].address or "of its own"
        raise SkillplanError(
            f"This process is connected to the Ray cluster {there!r} already, and cannot use "
            f"{address or 'one of its own'!r} besides."
        )
    return _connected[0]


def is_connected() -> bool:
    """Whether this process is connected to a cluster."""
    return bool(_connected) and _connected[0].alive


def first_line(error: BaseException) -> str:
    """Return the first line of what an error says, or its class."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def _listening(ray: Any) -> type[Actor]:
    """Return the class of actors, one method of which is heard while a job is done."""

    class ListeningActor(Actor):
        @ray.method(concurrency_group=LISTENING)  # type: ignore[untyped-decorator]
        def stop(self) -> None:
            super().stop()

    return ListeningActor


def _no_cluster(address: str, error: Exception) -> str:
    where = f"No Ray cluster can be used at {address!r}" if address else "Ray could not be started"
    return (
        f"{where}: {first_line(error)} Where a cluster asks for a token, RAY_AUTH_MODE=token must "
        "be set, and RAY_AUTH_TOKEN or ~/.ray/auth_token hold the one of its head."
    )


def _mixed(places: list[str]) -> str:
    return (
        "The cluster is mixed, and verdicts hold for one installation on one kind of processor. "
        f"{'; '.join(places)}. Install the same everywhere, or leave such nodes out."
    )


@contextmanager
def signals_held() -> Iterator[None]:
    """Hold requests to stop back, and pass them on afterwards to their handlers.

    A start that is broken off leaves processes of Ray that nobody ends, and Ray puts a handler of
    its own in the place of ours.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    numbers = requests()
    before = {one: signal.signal(one, lambda number, _: held.append(number)) for one in numbers}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
        for number in held:
            signal.raise_signal(number)


@contextmanager
def _stdout_kept() -> Iterator[None]:
    """Send to stderr what is printed meanwhile: stdout is for one document."""
    before, sys.stdout = sys.stdout, sys.stderr
    try:
        yield
    finally:
        sys.stdout = before


def _keep_stdout_clean() -> None:
    """Send to stderr what Ray says of nodes and actors that are lost, from a thread of its own."""
    inner: Any = importlib.import_module("ray._private.worker")
    known = inner.print_to_stdstream

    def to_stderr(batch: dict[str, Any], *args: Any, **kwargs: Any) -> Any:
        if os.environ.get("SKILLPLAN_DEBUG"):
            known({**batch, "is_err": True}, *args, **kwargs)

    inner.print_to_stdstream = to_stderr
