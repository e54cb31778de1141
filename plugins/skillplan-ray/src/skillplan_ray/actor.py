"""What runs on a node: an actor that makes itself ready and then does one job at a time.

Whatever it says it yields, in order: that it is ready or why not, news, and what became of a job.
"""

from __future__ import annotations

import os
import pickle
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from queue import SimpleQueue
from typing import Any

from skillplan.errors import BackEndError, SkillplanError
from skillplan.workers.executor import asked_to_stop, connect
from skillplan_ray.fingerprint import fingerprint

READY, NEWS, DONE, FAILED, BROKEN = "ready", "news", "done", "failed", "broken"
# The group of methods that are heard while a job is done.
LISTENING = "listening"
# Ray would set the first to the CPUs of the actor, and sums would come out otherwise.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Said = tuple[str, Any]


class Actor:
    """Does jobs on a node.

    Parameters
    ----------
    prepare
        A pickled function; of what `content` holds it returns what does jobs.
    content
        What it starts from, pickled.
    threads
        The variables of `THREADS` that are set on the head.
    """

    def __init__(self, prepare: bytes, content: bytes, threads: Mapping[str, str]) -> None:
        for name in THREADS:
            os.environ.pop(name, None)
        os.environ.update(threads)
        self._prepare, self._content = prepare, content
        self._work: Callable[[Any], Any] | None = None
        self._said: SimpleQueue[Said] = SimpleQueue()
        connect(lambda news: self._said.put((NEWS, pickle.dumps(news))), shares_files=False)

    def make_ready(self) -> Iterator[Said]:
        """Say what this node is like, or why no job can be done."""
        try:
            prepare = pickle.loads(self._prepare)
            self._work = prepare(pickle.loads(self._content))
        except BackEndError as error:
            yield FAILED, (BackEndError, str(error))
        except BaseException as error:
            words = f"A process could not make itself ready: {type(error).__name__}: {error}"
            yield FAILED, (SkillplanError, words)
        else:
            yield READY, fingerprint()

    def do(self, job: bytes) -> Iterator[Said]:
        """Do a job; yield news of it, and last what became of it."""
        threading.Thread(target=self._do, args=(job,), daemon=True).start()
        while True:
            said = self._said.get()
            yield said
            if said[0] != NEWS:
                return

    def stop(self) -> None:
        """Pass on that whoever gave the job wants it to end."""
        asked_to_stop()

    def _do(self, job: bytes) -> None:
        assert self._work is not None
        try:
            self._said.put((DONE, pickle.dumps(self._work(pickle.loads(job)))))
        except BaseException:
            # As a process of this machine would: it ends, with the traceback in its log.
            traceback.print_exc(file=sys.stderr)
            self._said.put((BROKEN, 1))
