"""What an executor costs: 100 jobs of 50 ms in two workers, by each executor that is installed.

A job only waits, so that the figures are of the executor alone, and other programs hardly change
them. Start-up, until both workers have done a first job, stands apart. The executors take turns.

Run from the repository: ``python benchmarks/executors.py [--rounds N] [--jobs N] [--seconds S]``.
"""

from __future__ import annotations

import argparse
import statistics
import time
from contextlib import closing
from functools import partial

from skillplan.pipeline import registry
from skillplan.pipeline.setup import make_executor
from skillplan.workers.executor import Answer, Executor, ExecutorChoice, Worker, pack_content

SLOTS = 2
BASELINE = "local"


def done(executor: Executor, workers: list[Worker], jobs: int, seconds: float) -> None:
    """Have workers do jobs that take so long [s]; each has one at a time."""
    to_do, busy, idle = jobs, set(), list(workers)
    while to_do or busy:
        while to_do and idle:
            worker = idle.pop()
            worker.take(seconds)
            busy.add(worker)
            to_do -= 1
        for worker in executor.first_ready(busy):
            said = worker.answer()
            if said is None:
                continue
            assert isinstance(said, Answer), said
            busy.remove(worker)
            idle.append(worker)


def measured(name: str, jobs: int, seconds: float) -> tuple[float, float]:
    """Return how long an executor takes to start, and then for jobs [s]."""
    begin_s = time.perf_counter()
    with closing(make_executor(ExecutorChoice(name), SLOTS)) as executor:
        content = pack_content(time.sleep, "the benchmark")
        workers = [executor.start(partial, content, "the benchmark") for _ in range(SLOTS)]
        done(executor, workers, SLOTS, 0.0)
        ready_s = time.perf_counter()
        done(executor, workers, jobs, seconds)
        return ready_s - begin_s, time.perf_counter() - ready_s


def main() -> None:
    """Print a row for every executor."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3, help="how often they take turns")
    parser.add_argument("--jobs", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=0.05, help="that each job takes [s]")
    words = parser.parse_args()
    others = [name for name in registry.names("executor") if name != BASELINE]
    names = [BASELINE, *others]
    rounds = [
        {name: measured(name, words.jobs, words.seconds) for name in names}
        for _ in range(words.rounds)
    ]
    what = f"{words.jobs} jobs of {1000 * words.seconds:g} ms"
    print(f"{what}, {SLOTS} workers, medians of {words.rounds} rounds")
    print(f"{'executor':<10} {'start-up s':>10} {'jobs s':>8} {'ms a job':>9} {'of local':>9}")
    for name in names:
        # Later rounds find a cluster that has been started.
        start_s = rounds[0][name][0]
        took_s = statistics.median(one[name][1] for one in rounds)
        ratio = statistics.median(one[name][1] / one[BASELINE][1] for one in rounds)
        each_ms = 1000 * (took_s * SLOTS / words.jobs - words.seconds)
        print(f"{name:<10} {start_s:>10.2f} {took_s:>8.2f} {each_ms:>9.2f} {ratio:>9.2f}")


if __name__ == "__main__":
    main()
