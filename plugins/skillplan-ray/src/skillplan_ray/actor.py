"""The actor on a node: it makes itself ready, and then does one job at a time.

It yields its messages in order: that it is ready or why not, news, and answers.
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
from skillplan.workers.executor import connect, handle_stop_request
from skillplan_ray.fingerprint import fingerprint

READY, NEWS, DONE, FAILED, BROKEN = "ready", "news", "done", "failed", "broken"
# Group of methods that run during a job.
LISTENING = "listening"
# Ray would set the first one to the CPUs of the actor, which changes floating-point sums.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Said = tuple[str, Any]


class Actor:
    """An actor that does jobs on a node.

    Parameters
    ----------
    prepare
        Pickled function; returns the function that does jobs, from the content.
    content
        Pickled content to start with.
    threads
        Values of the variables `THREADS` on the head.
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
        """Yield the fingerprint of this node, or the reason why it cannot do jobs."""
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
        """Do a job; yield news, and at last the answer."""
        threading.Thread(target=self._do, args=(job,), daemon=True).start()
        while True:
            message = self._said.get()
            yield message
            if message[0] != NEWS:
                return

    def stop(self) -> None:
        """Request the end of the present job."""
        handle_stop_request()

    def _do(self, job: bytes) -> None:
        assert self._work is not None
        try:
            self._said.put((DONE, pickle.dumps(self._work(pickle.loads(job)))))
        except BaseException:
            # Like a local process, it ends with the traceback in its log.
            traceback.print_exc(file=sys.stderr)
            self._said.put((BROKEN, 1))
