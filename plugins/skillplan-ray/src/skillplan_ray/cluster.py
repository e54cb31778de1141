"""The connection of this process to a cluster, shared by all executors."""

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
from skillplan_ray.access import (
    on_loopback,
    refuse_open_cluster,
    reload_token_mode,
    require_token,
    session_folder,
)
from skillplan_ray.actor import LISTENING, THREADS, Actor
from skillplan_ray.fingerprint import differences, fingerprint

# Time limit for the fingerprint of a node [s].
_ANSWER_S = 60.0


class Cluster:
    """A Ray cluster that this process is connected to.

    Parameters
    ----------
    address
        Address for `ray.init`; empty to start a cluster on this machine.
    object_store_mib
        Memory for sent objects of a started cluster [MiB].

    Attributes
    ----------
    address
        Address of the cluster.
    ray
        The module, imported only here.

    Raises
    ------
    SkillplanError
        If no cluster answers or starts, or its nodes differ from this machine.
    """

    def __init__(self, address: str, object_store_mib: int) -> None:
        # No usage statistics, and no prompts.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        if not address:
            require_token()
        self.ray: Any = importlib.import_module("ray")
        if not address and not self.ray.is_initialized():
            reload_token_mode()
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
        """True if this process is still connected."""
        return bool(self.ray.is_initialized())

    def actor(self, prepare: Any, content: Any, cpus: float) -> tuple[Any, float]:
        """Return the handle of a new actor and its reserved CPUs.

        If this process already uses all CPUs of the cluster, further actors reserve none: as for
        local processes, the user sets the number of workers.

        Parameters
        ----------
        prepare
            Function that makes the actor ready.
        content
            Reference to its content.
        cpus
            Reserved CPUs, >= 0.
        """
        total = float(self.ray.cluster_resources().get("CPU", 0.0))
        kept = cpus if self._taken_cpus + cpus <= total else 0.0
        self._taken_cpus += kept
        threads = {name: os.environ[name] for name in THREADS if name in os.environ}
        options = self._class.options(num_cpus=kept, scheduling_strategy="SPREAD", max_restarts=0)
        return options.remote(pickle.dumps(prepare), content, threads), kept

    def give_back(self, cpus: float) -> None:
        """Release the CPUs of an actor that has ended."""
        self._taken_cpus -= cpus

    def check(self, place: str, there: Mapping[str, str]) -> None:
        """Refuse a machine that differs from this one.

        Parameters
        ----------
        place
            Name in messages.
        there
            Fingerprint of the machine.

        Raises
        ------
        SkillplanError
            If a difference could change a verdict; the message names it.
        """
        different = differences(self._here, there)
        if different:
            raise SkillplanError(_mixed([f"{place}: {', '.join(different)}"]))

    def _refuse_mixed(self) -> None:
        """Compare the fingerprints of all nodes with this machine."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        probe = self.ray.remote(num_cpus=0, max_retries=0)(fingerprint)
        answers = {
            node["NodeManagerAddress"] + f" ({node['NodeID'][:8]})": probe.options(
                scheduling_strategy=NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
            ).remote()
            for node in self.ray.nodes()
            if node["Alive"]
        }
        odd = []
        for place, answer in answers.items():
            try:
                different = differences(self._here, self.ray.get(answer, timeout=_ANSWER_S))
            except self.ray.exceptions.RayError as error:
                different = [f"does not answer: {first_line(error)}"]
            if different:
                odd.append(f"{place}: {', '.join(different)}")
        if odd:
            self.ray.shutdown()
            raise SkillplanError(_mixed(odd))


_connected: list[Cluster] = []


def connected(address: str, object_store_mib: int) -> Cluster:
    """Return the connection of this process, created when first needed.

    Parameters
    ----------
    address, object_store_mib
        As for `Cluster`.

    Raises
    ------
    SkillplanError
        If it cannot be created, or is to another cluster.
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
    """Return whether this process is connected to a cluster."""
    return bool(_connected) and _connected[0].alive


def first_line(error: BaseException) -> str:
    """Return the first line of an error message, or its class."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def _listening(ray: Any) -> type[Actor]:
    """Return the class of actors; one of its methods runs during a job."""

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
    """Delay signals that request a stop, and pass them to their handlers afterwards.

    An interrupted start would leave processes of Ray running, and Ray replaces our signal handler.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    numbers = requests()
    before = {
        signal_number: signal.signal(signal_number, lambda number, _: held.append(number))
        for signal_number in numbers
    }
    try:
        yield
    finally:
        for signal_number, handler in before.items():
            signal.signal(signal_number, handler)
        for number in held:
            signal.raise_signal(number)


@contextmanager
def _stdout_kept() -> Iterator[None]:
    """Redirect prints to stderr: stdout is reserved for a document."""
    before, sys.stdout = sys.stdout, sys.stderr
    try:
        yield
    finally:
        sys.stdout = before


def _keep_stdout_clean() -> None:
    """Redirect Ray's messages about lost nodes and actors, from a thread of its own, to stderr."""
    inner: Any = importlib.import_module("ray._private.worker")
    known = inner.print_to_stdstream

    def to_stderr(batch: dict[str, Any], *args: Any, **kwargs: Any) -> Any:
        if os.environ.get("SKILLPLAN_DEBUG"):
            known({**batch, "is_err": True}, *args, **kwargs)

    inner.print_to_stdstream = to_stderr
