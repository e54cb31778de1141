"""A search in several processes: the same proofs, and no process harms another or outlives it."""

import json
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from sequencing_problems import SOP
from skillplan.model.sequencing import SequencingProblem
from skillplan.pipeline.run import make_model, solve
from skillplan.solvers.ordering import parallel_search
from skillplan.solvers.ordering.incumbents import SharedIncumbent
from skillplan.solvers.ordering.instance import OrderingInstance
from skillplan.solvers.ordering.job_orders import JobOrders
from skillplan.solvers.ordering.parallel_search import ParallelSearch, emphases
from skillplan.solvers.ordering.portfolio import METHODS, OrderingSearch
from skillplan.solvers.ordering.search_worker import Share, ShareSearch, Update
from skillplan.solvers.stop import Stop
from sop_instances import BEST_KNOWN, instance

PATIENCE_S = 120
MIB = 1024**2
DP = "dynamic programming over feasible subsets"

linux = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="children are looked up in the process files"
)


def ordering(name: str) -> OrderingInstance:
    """Return an instance of the benchmark as arrays."""
    model = make_model(instance(name).tasks[-1])
    return JobOrders(SequencingProblem.from_model(model)).instance


def random_instance(seed: int, n: int = 9) -> OrderingInstance:
    """Return an instance of whole costs that has an order."""
    rng = np.random.default_rng(seed)
    before = np.triu(rng.random((n, n)) < 0.15, 1)
    return OrderingInstance(rng.integers(0, 30, (n, n)).astype(float), before)


def children(process: int) -> set[int]:
    """Return the numbers of the processes that a process has started and that still run."""
    try:
        listed = Path(f"/proc/{process}/task/{process}/children").read_text("utf-8").split()
        return {int(child) for child in listed if running(int(child))}
    except OSError:
        return set()


def running(process: int) -> bool:
    """Whether there is such a process, and it is more than a remembered exit code."""
    try:
        return Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def workers(process: int) -> set[int]:
    """Return the searching processes that a process has started."""
    found = set()
    for child in children(process):
        try:
            words = Path(f"/proc/{child}/cmdline").read_text("utf-8")
        except OSError:
            continue
        if "spawn_main" in words:
            found.add(child)
    return found


def worked_s(process: int) -> float:
    """Return how long a process has used a processor [s]."""
    words = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def wait_until(holds, what: str) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.02)


class Patience:
    """A stop for searches that others are to end; it tires."""

    def __init__(self) -> None:
        self.until_s = time.monotonic() + PATIENCE_S

    def __call__(self) -> bool:
        return time.monotonic() > self.until_s


@pytest.fixture
def at_once(monkeypatch):
    """Start the processes at the first poll."""
    monkeypatch.setattr(parallel_search, "_PATIENCE_S", 0.0)


@pytest.fixture
def beside(monkeypatch, at_once):
    """Return a function that says which methods the processes beside this one use."""

    def use(*methods):
        monkeypatch.setattr(parallel_search, "emphases", lambda own, count: [methods] * count)

    return use


class TestNews:
    def test_an_order_known_elsewhere_is_taken_over(self):
        """As if it had been found here."""
        known = OrderingSearch(ordering("ESC12"), seed=1)
        known.run()
        shared = [SharedIncumbent(known.order)]
        orders = []
        search = OrderingSearch(
            known.instance,
            ("subset-dp",),
            on_order=lambda order, cost: orders.append(cost),
            shared=lambda: shared.pop() if shared else None,
        )
        search.run()
        assert search.proved
        assert orders[-1] == search.cost == known.cost == 1675

    def test_a_bound_known_elsewhere_ends_the_search(self):
        """With the name of what proved it."""
        known = OrderingSearch(ordering("ESC12"), seed=1)
        known.run()
        shared = SharedIncumbent(known.order, known.bound, "word of mouth")
        search = OrderingSearch(known.instance, ("local-search",), shared=lambda: shared)
        search.run()
        assert search.proved
        assert search.effort.bound_method == "word of mouth"
        assert search.effort.rounds == 0

    def test_an_order_that_is_none_is_not_believed(self):
        """One that breaks the precedence is left alone."""
        given = ordering("ESC12")
        wrong = np.concatenate(([0], np.arange(given.n - 2, 0, -1), [given.n - 1]))
        assert not given.feasible(wrong)
        search = OrderingSearch(given, shared=lambda: SharedIncumbent(wrong))
        search.run()
        assert search.proved
        assert given.feasible(search.order)


class TestEmphases:
    def test_beside_all_methods_each_process_stresses_some_and_later_ones_use_all(self):
        """No two of the first are the same."""
        found = emphases(METHODS, 5)
        assert len(found) == 5
        assert len(set(found[:3])) == 3
        assert all(methods != METHODS for methods in found[:3])
        assert found[3:] == [METHODS, METHODS]

    @pytest.mark.parametrize("method", ["subset-dp", "tree-search", "branch-and-cut"])
    def test_beside_a_method_without_randomness_orders_are_looked_for(self, method):
        """It would do the same once more."""
        assert emphases((method,), 2) == [("local-search",)] * 2

    def test_beside_local_search_the_others_do_it_too(self):
        """From seeds of their own."""
        assert emphases(("local-search",), 1) == [("local-search",)]


class TestProofs:
    @pytest.mark.parametrize("seed", range(4))
    def test_the_proved_cost_is_the_same_for_any_number_of_processes(self, seed, at_once):
        """And so is that it is proved."""
        given = random_instance(seed)
        costs = []
        for processes in (2, 3):
            search = OrderingSearch(given, seed=seed, stop=Patience())
            ParallelSearch(search, processes, seed).run()
            assert search.proved
            assert given.feasible(search.order)
            costs.append(search.cost)
        alone = OrderingSearch(given, seed=seed)
        alone.run()
        assert costs == [alone.cost, alone.cost]

    @pytest.mark.slow(
        reason="an instance that two processes work at; an order told to another in every run"
    )
    def test_what_another_process_proves_ends_the_search(self, beside):
        """Local search itself would go on for ever."""
        beside("local-search", "subset-dp")
        bounds, orders = [], []
        search = OrderingSearch(
            ordering("br17.10"),
            ("local-search",),
            stop=Patience(),
            on_bound=lambda bound, nodes: bounds.append((bound, nodes)),
            on_order=lambda order, cost: orders.append(cost),
        )
        parallel = ParallelSearch(search, 2)
        parallel.run()
        assert search.proved
        assert (search.cost, search.bound) == (55, 55)
        assert search.effort.bound_method == DP
        assert search.effort.states > 0
        assert bounds[-1][0] == orders[-1] == 55
        assert all(one <= other for (one, _), (other, _) in pairwise(bounds))
        assert parallel.trace == {"processes": 2}

    def test_what_this_process_finds_the_others_build_on(self, beside):
        """A process that only bounds proves the order that it was told."""
        beside("subset-dp")
        search = OrderingSearch(ordering("ESC12"), ("local-search",), stop=Patience())
        ParallelSearch(search, 2).run()
        assert search.proved
        assert search.cost == 1675

    def test_no_process_is_started_for_what_is_proved_soon(self):
        """Starting one takes longer."""
        search = OrderingSearch(random_instance(0, n=5))
        parallel = ParallelSearch(search, 64)
        parallel.run()
        assert search.proved
        assert parallel.trace == {"processes": 1}

    def test_jobs_of_a_solver_are_its_processes(self, at_once):
        """The result says how many there were; a proof in one process ends all."""
        result = solve(instance("ESC12").tasks[-1], "portfolio", jobs=2)
        assert (result.cost, result.status.value) == (1675, "optimal")
        assert result.trace["processes"] == 2
        assert not workers(os.getpid())


class TestLosses:
    @linux
    def test_a_process_that_is_killed_costs_its_share_only(self, at_once):
        """The search goes on with the others, and says what happened."""
        killed: list[int] = []
        until_s = time.monotonic() + PATIENCE_S

        def stop() -> bool:
            if not killed:
                for worker in workers(os.getpid()):
                    os.kill(worker, signal.SIGKILL)
                    killed.append(worker)
            return bool(parallel.lost) or time.monotonic() > until_s

        search = OrderingSearch(ordering("ft70.1"), ("local-search",), stop=stop)
        parallel = ParallelSearch(search, 2)
        parallel.run()
        assert parallel.lost == ["one was ended by signal 9"]
        assert search.instance.feasible(search.order)
        assert search.bound <= float(BEST_KNOWN["ft70.1"]["best_known"]) <= search.cost

    @linux
    def test_with_all_others_killed_the_search_is_proved_by_this_process(self, at_once):
        """However often that happens."""
        begin_s = time.monotonic()

        def stop() -> bool:
            for worker in workers(os.getpid()):
                os.kill(worker, signal.SIGKILL)
            return time.monotonic() > begin_s + PATIENCE_S

        search = OrderingSearch(ordering("ESC12"), stop=stop)
        parallel = ParallelSearch(search, 3)
        parallel.run()
        assert search.proved
        assert search.cost == 1675
        assert set(parallel.lost) <= {"one was ended by signal 9"}

    @pytest.mark.slow(reason="a process; lost checks of processes in every run")
    def test_a_process_that_fails_costs_its_share_only(self, beside):
        """Its words are kept."""
        beside("local-search")
        until_s = time.monotonic() + PATIENCE_S

        def stop() -> bool:
            return bool(parallel.lost) or time.monotonic() > until_s

        search = OrderingSearch(ordering("ft70.1"), ("local-search",), stop=stop)
        # No generator of random numbers takes such a seed.
        parallel = ParallelSearch(search, 2, seed=2**80)
        parallel.run()
        assert len(parallel.lost) == 1
        assert parallel.lost[0].startswith("one ended: OverflowError: ")
        assert search.instance.feasible(search.order)

    def test_where_memory_is_short_no_process_is_started(self, at_once):
        """It is needed here."""
        search = OrderingSearch(ordering("ESC12"), memory_bytes=lambda: 300 * MIB)
        parallel = ParallelSearch(search, 2)
        parallel.run()
        assert search.proved
        assert parallel.trace == {
            "processes": 1,
            "lost_processes": ["one was not started: memory limit"],
        }

    def test_where_memory_gets_short_processes_are_given_up(self, at_once):
        """Before this one is."""
        left = [4096 * MIB]
        until_s = time.monotonic() + PATIENCE_S

        def stop() -> bool:
            if parallel.started == 2:
                left[0] = 32 * MIB
            return bool(parallel.lost) or time.monotonic() > until_s

        search = OrderingSearch(
            ordering("ft70.1"), ("local-search",), stop=stop, memory_bytes=lambda: left[0]
        )
        parallel = ParallelSearch(search, 2)
        parallel.run()
        assert parallel.lost == ["one was given up: memory limit"]
        assert search.order is not None

    def test_what_is_left_is_shared(self, beside):
        """All of it is this process's until there are others."""
        beside("local-search", "subset-dp")
        shares = []
        until_s = time.monotonic() + PATIENCE_S

        def stop() -> bool:
            shares.append(search.memory_bytes())
            return parallel.started == 3 or time.monotonic() > until_s

        search = OrderingSearch(ordering("ft70.1"), stop=stop, memory_bytes=lambda: 6000 * MIB)
        parallel = ParallelSearch(search, 3)
        assert search.memory_bytes() == 6000 * MIB
        parallel.run()
        assert 1000 * MIB < shares[-1] <= 2000 * MIB


class TestShares:
    @pytest.mark.slow(reason="half a second; what it tells in every run")
    def test_a_share_that_holds_more_than_it_may_ends(self):
        """Because of the memory limit."""
        share = ShareSearch(Share(ordering("ESC25"), ("local-search",), 0, None, None, 64 * MIB))
        assert share.finding().ended == ""
        held = bytearray(b"x" * (256 * MIB))
        deadline_s = time.monotonic() + PATIENCE_S
        while not (found := share.finding()).ended:
            assert time.monotonic() < deadline_s
        assert found.ended == "memory limit"
        assert len(held) == 256 * MIB

    def test_a_share_tells_what_it_finds_and_takes_what_it_is_told(self):
        """It proves an order that it did not find."""
        known = OrderingSearch(ordering("ESC25"), seed=1)
        known.run()
        share = ShareSearch(Share(known.instance, ("subset-dp",), 0, None, None, None))
        share.receive(Update(known.order, 0.0, "", None))
        deadline_s = time.monotonic() + PATIENCE_S
        while not (found := share.finding()).ended:
            assert time.monotonic() < deadline_s
        assert (found.ended, found.bound) == ("proof", known.cost)
        assert found.effort.states > 0


@linux
class TestEndings:
    """Of the command line: whatever ends it, no process is left and nothing is said in vain."""

    def start(self, *words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [
                *(sys.executable, "-m", "skillplan", "search-optimal", str(SOP / "kro124p.1.sop")),
                *("--solver", "portfolio", "--jobs", "2", "--format", "json", *words),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def begun(self, search: subprocess.Popen[str]) -> set[int]:
        """Return all processes that a search has started, once the one beside it runs."""
        wait_until(lambda: len(workers(search.pid)) == 1, "no processes")
        return children(search.pid)

    @pytest.mark.slow(
        reason="a search by two processes; every run interrupts one of a single process"
    )
    def test_ctrl_c_in_the_terminal_ends_all_with_the_best_so_far(self):
        """The whole group gets the signal; only this process heeds it."""
        search = self.start()
        others = self.begun(search)
        # So that they are at work, not starting.
        wait_until(lambda: all(worked_s(one) > 1 for one in workers(search.pid)), "no work")
        os.killpg(search.pid, signal.SIGINT)
        out, said = search.communicate(timeout=PATIENCE_S)
        assert search.returncode == 130
        document = json.loads(out)
        assert document["lower_bound"] <= document["cost"]
        assert document["trace"]["processes"] == 2
        assert "lost_processes" not in document["trace"]
        assert said == ""
        wait_until(lambda: not any(map(running, others)), "a process is left")

    @pytest.mark.slow(reason="the first one in every run")
    def test_a_second_ctrl_c_ends_all_at_once(self):
        """Without a traceback."""
        search = self.start()
        others = self.begun(search)
        for _ in range(2):
            os.killpg(search.pid, signal.SIGINT)
            time.sleep(0.01)
        _, said = search.communicate(timeout=PATIENCE_S)
        assert search.returncode == 130
        assert "Traceback" not in said
        assert "leaked" not in said
        wait_until(lambda: not any(map(running, others)), "a process is left")

    @pytest.mark.slow(reason="starts a program and kills it; ended by Ctrl-C in every run")
    def test_no_process_outlives_one_that_is_killed(self):
        """Nor says anything about it."""
        search = self.start()
        others = self.begun(search)
        time.sleep(0.5)
        search.kill()
        _, said = search.communicate(timeout=PATIENCE_S)
        assert said == ""
        wait_until(lambda: not any(map(running, others)), "a process is left")

    @pytest.mark.slow(reason="two processes for three seconds; of one process in every run")
    def test_the_time_limit_holds_for_all(self):
        """It ends a moment later."""
        search = self.start("--time-limit", "3")
        out, said = search.communicate(timeout=PATIENCE_S)
        assert search.returncode == 0
        document = json.loads(out)
        assert document["reason"] == "time limit"
        assert said == ""


@pytest.mark.slow(
    reason="a search by two processes on a large instance; every run stops auto at a gap"
)
def test_what_others_find_counts_for_the_gap(at_once):
    """It is asked for in one process only."""
    task = instance("ft70.1").tasks[-1]
    result = solve(task, "portfolio", jobs=2, stop=Stop(gap=0.2, time_limit_s=PATIENCE_S))
    assert result.reason == "gap reached"
    assert result.gap is not None
    assert result.gap <= 0.2
