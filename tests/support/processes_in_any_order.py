"""An executor for tests whose processes are objects of this one, heard in any order."""

import pickle
import random

from skillplan.workers import Answer, Ended, Executor


class FakeProcess:
    """A process that works in this one."""

    def __init__(self, prepare, content, what):
        self._work = prepare(pickle.loads(content))
        self._said = None
        self.alive = True

    def take(self, job):
        self._said = self._work(job)

    def answer(self):
        return Answer(self._said)

    def end(self, *, gently=True):
        self.alive = False


class AnyOrder(Executor):
    """Fake processes; whoever waits hears of the answers in any order."""

    rng = random.Random(0)

    def start(self, prepare, content, what):
        return FakeProcess(prepare, content, what)

    def first_ready(self, workers, patience_s=0.0):
        workers = list(workers)
        return self.rng.sample(workers, self.rng.randint(1, len(workers)))

    def close(self):
        """Nothing is to be ended."""


class Mortal(FakeProcess):
    """Dies of the first job of every kind; another process then does it."""

    deaths: set = set()  # noqa: RUF012

    def take(self, job):
        if self.alive and job not in self.deaths:
            self.deaths.add(job)
            self.alive = False
            return
        super().take(job)

    def answer(self):
        return super().answer() if self.alive else Ended(-9, started=True)


class AnyOrderOfMortals(AnyOrder):
    """Processes of which each dies of a new job."""

    def start(self, prepare, content, what):
        return Mortal(prepare, content, what)


class Silent(AnyOrder):
    """Processes that never answer; remembers what was started."""

    started: list = []  # noqa: RUF012

    def start(self, prepare, content, what):
        self.started.append(super().start(prepare, content, what))
        return self.started[-1]

    def first_ready(self, workers, patience_s=0.0):
        return []
