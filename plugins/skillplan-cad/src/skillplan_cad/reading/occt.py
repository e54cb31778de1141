"""OCCT in a process of its own: a file on which it crashes or hangs ends that process alone."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError
from skillplan.workers.executor import Answer, Ended, Prepare, Worker, packed
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.resident_memory import resident_bytes_of

_WHAT = "reading STEP"
# How sharply a chord may turn [rad]; its distance from the surface is what is asked for.
_TURN_RAD = 0.5
_REMEDY = "Save it from CAD anew as STEP (AP203, AP214 or AP242)"
_GIB = 1024**3
# Ten times what slow files take.
_LEAST_S, _S_A_MEGABYTE = 120.0, 6.0


@dataclass(frozen=True, slots=True)
class Limits:
    """What reading one file may take.

    Parameters
    ----------
    seconds
        From the start of the process to its answer.
    memory_bytes
        Resident size of the process.
    """

    seconds: float
    memory_bytes: int = 8 * _GIB


def tessellated(path: Path, content: bytes, chord_m: float) -> bytes:
    """Return the GLB that OCCT makes of a STEP file.

    Parameters
    ----------
    path
        The file, for messages.
    content
        Its content, unpacked.
    chord_m
        How far triangles may lie from curved faces.

    Raises
    ------
    OptionError
        If OCCT cannot read it, crashes on it, or takes too long or too much memory.
    """
    limits = Limits(_LEAST_S + _S_A_MEGABYTE * len(content) / 1e6)
    made = read_apart(path, prepare, (content, chord_m), limits)
    if not isinstance(made, bytes) or not made:
        raise OptionError(f"{path}: OCCT cannot read it as STEP. {_REMEDY}.")
    return made


def read_apart(path: Path, prepare: Prepare, content: Any, limits: Limits) -> Any:
    """Return the answer of a process to its only job.

    Parameters
    ----------
    path
        The file that it reads, for messages.
    prepare
        Called there with `content`; returns what does the job. Must be importable.
    content
        What it starts from.
    limits
        When it is ended.

    Raises
    ------
    OptionError
        If it ends before it answers, or is ended by the limits.
    """
    with closing(LocalProcesses(1)) as executor:
        if executor.refusal:
            return prepare(content)(None)
        worker = executor.start(prepare, packed(content, _WHAT), _WHAT)
        worker.take(None)
        until = time.monotonic() + limits.seconds
        while True:
            if executor.first_ready([worker]):
                answer = worker.answer()
                if isinstance(answer, Answer):
                    return answer.content
                if isinstance(answer, Ended):
                    raise _crashed(path, worker, answer)
            if time.monotonic() > until:
                raise OptionError(
                    f"{path}: OCCT was still at it after {limits.seconds:.0f} s and was ended. "
                    f"{_REMEDY}, or sub-assemblies one by one."
                )
            if (resident_bytes_of(worker.number) or 0) > limits.memory_bytes:
                raise OptionError(
                    f"{path}: OCCT took more than {limits.memory_bytes / _GIB:.3g} GiB of memory "
                    f"and was ended. {_REMEDY}, or sub-assemblies one by one."
                )


def _crashed(path: Path, worker: Worker, ended: Ended) -> Exception:
    if not ended.started and not ended.killed:
        return worker.not_started()
    return OptionError(
        f"{path}: OCCT crashed on it ({ended.how}), so it is damaged or beyond OCCT. {_REMEDY}."
    )


def prepare(content: tuple[bytes, float]) -> Callable[[None], bytes | None]:
    """Return what the process does: None comes of what OCCT refuses."""

    def read(_: None) -> bytes | None:
        try:
            return _read(*content)
        except (RuntimeError, ValueError, MemoryError):
            return None

    return read


def _read(content: bytes, chord_m: float) -> bytes:
    import cascadio

    with _quiet_output():
        made: bytes = cascadio.load(
            content,
            "step",
            tol_linear=chord_m * 1000,
            tol_angular=_TURN_RAD,
            merge_primitives=True,
            use_parallel=False,
            include_brep=True,
        )
    return made


@contextmanager
def _quiet_output() -> Iterator[None]:
    """Send what OCCT prints nowhere: stdout belongs to the command."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = {}
    for descriptor in (1, 2):
        try:
            kept[descriptor] = os.dup(descriptor)
        except OSError:
            # It is closed: there is nothing to be kept clean.
            continue
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in kept:
            os.dup2(nowhere, descriptor)
        yield
    finally:
        for descriptor, copy in kept.items():
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(nowhere)
