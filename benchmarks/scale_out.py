"""How far more slots help: recorded checks replayed over 2 to 256 simulated slots.

All checks that `cache fill` makes of a board are made once, in this process, and their durations
recorded. Then the same code hands them to simulated workers, which answer what was recorded, after
as long as it took, by a clock of their own. The head handles one answer after another.

Run from the repository: ``python benchmarks/scale_out.py [BOARD] [--physics NAME] [--collision
NAMES] [--head-s S] [--start-s S]``.
"""

from __future__ import annotations

import argparse
import heapq
import pickle
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

from skillplan.checks.feasibility import Feasibility
from skillplan.model.enumeration import enumerate_feasibility
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.task.task import Task
from skillplan.workers.executor import POLL_S, Answer, Executor, MakeExecutor, Prepare, Worker

SLOTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
# A gain in speed below this is none.
GAIN = 0.05


@dataclass
class Recording:
    """What was answered to each job, and how long that took [s]; what does jobs, to ask further."""

    answers: dict[Any, tuple[Any, float]] = field(default_factory=dict)
    work: Callable[[Any], Any] | None = None

    def record(self, job: Any) -> tuple[Any, float]:
        """Return what is answered to a job, and how long that takes [s]; it is done only once."""
        if job not in self.answers:
            assert self.work is not None
            begin_s = time.perf_counter()
            said = self.work(job)
            self.answers[job] = (said, time.perf_counter() - begin_s)
        return self.answers[job]

    @property
    def busy_s(self) -> float:
        """Seconds of all checks, one after another."""
        return sum(took_s for _, took_s in self.answers.values())


class _AtOnce(Worker):
    """A worker of this process."""

    def __init__(self, what: str) -> None:
        super().__init__(what)
        self.job: Any = None

    number = None
    alive = True

    def take(self, job: Any) -> None:
        self.job = job

    def ask_to_stop(self) -> None:
        """Nobody asks."""

    def end(self, *, gently: bool = True) -> None:
        """Nothing is left behind."""


class _Recorded(_AtOnce):
    """Does its job in this process and records it."""

    def __init__(self, what: str, recording: Recording) -> None:
        super().__init__(what)
        self.recording = recording

    def answer(self) -> Answer:
        return Answer(self.recording.record(self.job)[0])


class Recorder(Executor):
    """Does all jobs in this process and records them."""

    name = "recorder"

    def __init__(self, slots: int, recording: Recording) -> None:
        super().__init__(slots)
        self.recording = recording

    def start(self, prepare: Prepare, content: bytes, what: str) -> Worker:
        """Start what does jobs in this process."""
        self.recording.work = prepare(pickle.loads(content))
        return _Recorded(what, self.recording)

    def first_ready(self, workers: Iterable[Worker], patience_s: float = POLL_S) -> list[Worker]:
        """Return the first."""
        return list(workers)[:1]

    def close(self) -> None:
        """Nothing is left behind."""


class _Simulated(_AtOnce):
    """Answers what was recorded, as late as it was; what is asked in vain is recorded then."""

    def __init__(self, what: str, place: Simulator, ready_s: float) -> None:
        super().__init__(what)
        self.place, self.ready_s = place, ready_s

    def take(self, job: Any) -> None:
        self.job = job
        begin_s = max(self.ready_s, self.place.now_s)
        self.ready_s = begin_s + self.place.recording.record(job)[1]

    def answer(self) -> Answer:
        return Answer(self.place.recording.record(self.job)[0])


class Simulator(Executor):
    """Simulated slots with a clock of their own.

    Parameters
    ----------
    slots
        How many.
    recording
        What they answer, and when.
    head_s
        So long the head is at each answer [s].
    start_s
        So long a worker takes to be ready [s].

    Attributes
    ----------
    now_s
        The clock [s].
    """

    name = "simulator"

    def __init__(self, slots: int, recording: Recording, head_s: float, start_s: float) -> None:
        super().__init__(slots)
        self.recording, self.head_s, self.start_s = recording, head_s, start_s
        self.now_s = 0.0

    def start(self, prepare: Prepare, content: bytes, what: str) -> Worker:
        """Start a worker that is ready after `start_s`."""
        return _Simulated(what, self, self.now_s + self.start_s)

    def first_ready(self, workers: Iterable[Worker], patience_s: float = POLL_S) -> list[Worker]:
        """Return the worker that answers first, by then."""
        busy = [one for one in workers if isinstance(one, _Simulated)]
        first = heapq.nsmallest(1, busy, key=lambda one: one.ready_s)
        for one in first:
            self.now_s = max(self.now_s, one.ready_s) + self.head_s
        return list(first)

    def close(self) -> None:
        """Nothing is left behind."""


def fill(task: Task, setup: Setup, slots: int, make: MakeExecutor) -> int:
    """Check all that can be reached; return how many checks were made."""
    feasibility = Feasibility(task, setup.back_ends(task), jobs=slots, make_executor=make)
    with closing(feasibility):
        enumerate_feasibility(feasibility, lambda: False)
    return feasibility.executions


def main() -> None:
    """Record, replay, and print the speed-up by slots."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("board", nargs="?", default="configs/inverter_board.yaml")
    parser.add_argument("--physics", default="pybullet")
    parser.add_argument("--collision", default="contact-pairs")
    parser.add_argument("--head-s", type=float, default=0.004, help="a message and its answer [s]")
    parser.add_argument("--start-s", type=float, default=3.0, help="until a worker is ready [s]")
    words = parser.parse_args()
    task = load_problem(words.board).tasks[-1]
    setup = Setup(words.physics, tuple(words.collision.split(",")), with_chart=False)
    recording = Recording()
    checks = fill(task, setup, 1, lambda slots: Recorder(slots, recording))
    if not recording.answers:
        parser.error("no back end of these is worth a process")
    # Of one slot, which checks nothing in vain.
    busy_s = recording.busy_s
    mean_s = busy_s / len(recording.answers)
    print(f"{task.name}: {checks} checks, {busy_s:.1f} s, {1000 * mean_s:.0f} ms each")
    print(f"{'slots':>5} {'s':>8} {'speed-up':>9} {'of ideal':>9}   with start-up: s, speed-up")
    speed_ups = {}
    for slots in SLOTS:
        seconds = []
        for start_s in (0.0, words.start_s):
            place = Simulator(slots, recording, words.head_s, start_s)
            fill(task, setup, slots, lambda _, place=place: place)  # type: ignore[misc]
            seconds.append(place.now_s)
        alone, started = (busy_s / one for one in seconds)
        speed_ups[slots] = alone
        print(
            f"{slots:>5} {seconds[0]:>8.1f} {alone:>9.2f} {alone / slots:>9.0%}"
            f"   {seconds[1]:>16.1f} {started:>9.2f}"
        )
    level = levels_off(speed_ups)
    print(f"levels off at {level} slots: more make it at most {GAIN:.0%} faster")


def levels_off(speed_ups: Mapping[int, float]) -> int:
    """Return the least number of slots beyond which no more of them help, by their speed-ups."""
    best = max(speed_ups.values())
    return min(slots for slots, one in speed_ups.items() if best <= one * (1 + GAIN))


if __name__ == "__main__":
    main()
