"""A search in several processes: the same proofs in every run, and no process harms another."""

import json
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from example_count import examples
from ordering_instances import instance_of, least_cost, orderings
from sequencing_problems import SOP
from skillplan.model import SequencingProblem
from skillplan.pipeline import make_model, solve
from skillplan.solvers import Stop
from skillplan.solvers.ordering import (
    METHODS,
    CutRelaxation,
    Duals,
    Helpers,
    JobOrders,
    OrderingInstance,
    OrderingSearch,
    TwoEndedSearch,
    parallel_search,
    portfolio,
    run_in_parallel,
    search_worker,
)
from skillplan.workers import Answer, Ended, Executor, list_descendants
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


def children(process: int) -> set[int]:
    """Return the processes that run below a process: that of the command, and those of it."""
    return set(filter(running, list_descendants(process)))


def running(process: int) -> bool:
    """Whether there is such a process, and it is more than a remembered exit code."""
    try:
        return Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def workers(process: int) -> set[int]:
    """Return the searching processes that a process has started."""
    result = set()
    for child in children(process):
        try:
            words = Path(f"/proc/{child}/cmdline").read_text("utf-8")
        except OSError:
            continue
        if "spawn_main" in words:
            result.add(child)
    return result


def worked_s(process: int) -> float:
    """Return how long a process has used a processor [s]."""
    words = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def wait_until(holds, what: str) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.02)


class Beside:
    """A process that is an object of this one: ready at first, then done with what it takes."""

    number = None
    alive = True

    def __init__(self, prepare, content, deaths):
        self._work = prepare(pickle.loads(content))
        self._said = [None]
        self._deaths = deaths

    @property
    def speaks(self):
        return bool(self._said)

    def take(self, job):
        if self._deaths:
            self._said.append(Ended(self._deaths.pop(), started=True))
            return
        self._said.append(Answer(pickle.loads(pickle.dumps(self._work(job)))))

    def answer(self):
        return self._said.pop(0)

    def end(self, *, gently=True):
        self.alive = False


class AnyMoment(Executor):
    """Processes that are heard at any moment; so many tasks cost the process its life."""

    def __init__(self, slots, seed, deaths=0):
        super().__init__(slots)
        self._random = random.Random(seed)
        self._deaths = [-9] * deaths

    def start(self, prepare, content, what):
        return Beside(prepare, content, self._deaths)

    def first_ready(self, workers, patience_s=0.0):
        heard = [worker for worker in workers if worker.speaks]
        return [line for line in heard if self._random.random() < 0.5]

    def close(self):
        """Nothing is to be ended."""


@pytest.fixture
def small_turns():
    """Deal subtrees of small instances, too, and let no process of a test die with this one.

    Small instances are proved by cuts alone; without them there is a tree.
    """
    with_all = pytest.MonkeyPatch()
    with_all.setattr(CutRelaxation, "cut", lambda self, *limits: 0)
    with_all.setattr(search_worker, "_end_with_parent", lambda: None)
    with_all.setattr(parallel_search, "_TURN", 20_000)
    with_all.setattr(parallel_search, "_ALONE", 1_000)
    with_all.setattr(portfolio, "_FIRST_WORK", 1_000)
    with_all.setattr(portfolio, "_MOVES", 20_000)
    yield
    with_all.undo()


def errands(seed: int, pairs: int = 5) -> OrderingInstance:
    """Return places on a grid, pairs of which are ordered: much is to be branched on."""
    n = 2 * pairs + 1
    x, y = np.random.default_rng(seed).integers(0, 100, (2, n))
    before = np.zeros((n, n), dtype=np.bool_)
    for first in range(1, pairs):
        before[first, first + pairs - 1] = True
    return OrderingInstance(np.abs(x[:, None] - x) + np.abs(y[:, None] - y) + 0.0, before)


def together(given, methods=METHODS, *, others=1, timing=0, deaths=0, **more):
    """Return a search by several processes that has ended, and the processes beside it."""
    helpers = Helpers(others, 0, AnyMoment(others, timing, deaths))
    search = OrderingSearch(given, methods, helpers=helpers, **more)
    search.run()
    return search, helpers


def told(search):
    """Return all that a search says of an instance."""
    order = None if search.order is None else search.order.tolist()
    return order, search.cost, search.bound, search.ended, search.effort


def test_the_first_turn_of_branch_and_cut_is_no_more_work_than_alone(monkeypatch):
    """What one process does before others join in is not done by each of them again."""
    for name in ("_WORK", "_FIRST_WORK"):
        monkeypatch.setattr(portfolio, name, 1_000_000)
    puzzle = ordering("ft53.1")
    alone = OrderingSearch(puzzle, ("branch-and-cut",), rounds=1)
    alone.run()
    shared, _ = together(puzzle, ("branch-and-cut",), rounds=1)
    assert not alone.proved
    assert shared.effort.parts == alone.effort.parts > 0


PROVING = [*((method,) for method in METHODS if method != "local-search"), METHODS]


@pytest.mark.usefixtures("small_turns")
class TestProofs:
    @pytest.mark.parametrize("methods", PROVING)
    @settings(max_examples=examples(60), deadline=None)
    @given(instance=orderings(most=9))
    def test_two_processes_prove_the_optimum_or_that_there_is_none(self, methods, instance):
        """By any method: whole numbers and others, ties, nothing, arcs forbidden."""
        search, _ = together(instance, methods)
        assert search.proved
        assert search.cost == pytest.approx(least_cost(instance), rel=1e-9, abs=1e-9)
        if search.order is not None:
            assert search.instance.feasible(search.order)

    @pytest.mark.parametrize("methods", [("branch-and-cut",), METHODS[::3]])
    @pytest.mark.parametrize("seed", [2, 3, 5])
    def test_subtrees_are_searched_by_all_and_prove_the_cost_of_one_process(self, methods, seed):
        """Where branching is all there is, every process takes its share of the tree."""
        given = errands(seed)
        search, helpers = together(given, methods, others=2)
        assert search.proved
        assert search.cost == least_cost(given)
        assert helpers.trace == {"processes": 3}
        assert search._tree.parts > 0

    @pytest.mark.parametrize("deaths", [1, 2])
    @pytest.mark.parametrize("seed", [2, 3, 5])
    def test_a_lost_process_leaves_its_subtrees_to_the_others(self, seed, deaths):
        """No subtree counts as searched that was not."""
        given = errands(seed)
        search, helpers = together(given, ("branch-and-cut",), others=2, deaths=deaths)
        assert search.proved
        assert search.cost == least_cost(given)
        assert helpers.lost == ["one was ended by signal 9"] * deaths


@pytest.mark.usefixtures("small_turns")
class TestDeterminism:
    @pytest.mark.parametrize("others", [1, 2])
    @pytest.mark.parametrize("methods", [METHODS, ("branch-and-cut",), ("local-search",)])
    def test_what_is_found_does_not_depend_on_who_is_faster(self, methods, others):
        """Order, cost, bound and all counts are the same whenever answers are heard."""
        given = errands(3)
        results = [
            told(together(given, methods, others=others, timing=timing, rounds=2)[0])
            for timing in range(3)
        ]
        assert results[0] == results[1] == results[2]


@pytest.mark.slow(reason="real processes, twice; processes of the test itself in every run")
def test_two_processes_say_the_same_in_every_run(monkeypatch):
    """So that a result can be had once more."""
    # Subtrees are dealt before a single process would have proved the optimum.
    monkeypatch.setattr(portfolio, "_FIRST_WORK", 1_000_000)
    results = [solve(instance("ESC47").tasks[-1], "portfolio", jobs=2) for _ in range(2)]
    first, other = ({**result.trace, "cost": result.cost} for result in results)
    assert results[0].steps == results[1].steps
    assert first == other
    assert first["processes"] == 2
    assert results[0].status.value == "optimal"
    assert results[0].cost == float(BEST_KNOWN["ESC47"]["best_known"])


class TestBothEnds:
    @pytest.mark.parametrize("seed", range(4))
    def test_threads_find_what_one_thread_finds(self, seed):
        """Order, bound and labels of a dynamic program that runs to its end."""
        given = instance_of(12, seed, density=0.3)
        duals = Duals(0.0, np.where(given.costs < 1e15, given.costs, np.inf))
        results = []
        for threads in (1, 2, 3):
            search = TwoEndedSearch(given, duals, least_cost(given) + 1, threads)
            met = search.run(10**6, lambda: False)
            results.append((met.order.tolist(), met.bound, met.whole, search.generated))
        assert results[0] == results[1] == results[2]
        assert results[0][1] == least_cost(given)

    def test_what_fails_in_a_thread_fails_here(self):
        """Nothing is passed over."""

        def fail(stop):
            raise MemoryError("too many labels")

        with pytest.raises(MemoryError, match="too many labels"):
            run_in_parallel([lambda stop: 1, fail], lambda: False)

    def test_threads_hear_of_a_stop_and_only_this_one_asks(self):
        """Whoever asks may draw on what belongs to this thread."""
        asked_in = set()

        def stop():
            asked_in.add(threading.get_ident())
            return True

        def wait(stop):
            deadline_s = time.monotonic() + PATIENCE_S
            while not stop():
                assert time.monotonic() < deadline_s
                time.sleep(0.001)
            return "stopped"

        assert run_in_parallel([wait, wait], stop) == ["stopped", "stopped"]
        assert asked_in == {threading.get_ident()}


class TestLosses:
    @pytest.mark.slow(reason="a process; one of the test itself is lost in every run")
    @linux
    def test_a_process_that_is_killed_costs_its_share_only(self):
        """The search goes on, and says what happened."""
        killed: list[int] = []
        until_s = time.monotonic() + PATIENCE_S

        def stop() -> bool:
            if not killed:
                for worker in workers(os.getpid()):
                    os.kill(worker, signal.SIGKILL)
                    killed.append(worker)
            return bool(helpers.lost) or time.monotonic() > until_s

        helpers = Helpers(1)
        search = OrderingSearch(ordering("ft70.1"), ("local-search",), stop=stop, helpers=helpers)
        search.run()
        assert helpers.lost == ["one was ended by signal 9"]
        assert search.instance.feasible(search.order)
        assert search.bound <= float(BEST_KNOWN["ft70.1"]["best_known"]) <= search.cost

    @pytest.mark.slow(reason="a process; one of the test itself is lost in every run")
    def test_a_process_that_fails_costs_its_share_only(self):
        """Its words are kept."""
        # No generator of random numbers takes such a seed.
        helpers = Helpers(1, seed=2**80)
        given = ordering("ESC12")
        search = OrderingSearch(given, ("local-search",), helpers=helpers, rounds=2)
        search.stop = lambda: bool(helpers.lost)
        search.run()
        assert search.proved or len(helpers.lost) == 1
        assert all("OverflowError: " in words for words in helpers.lost)

    def test_a_task_that_fails_is_no_answer(self, small_turns, monkeypatch):
        """Whoever gave it does it itself."""

        def fail(self, task):
            raise ValueError("broken")

        monkeypatch.setattr(search_worker.Hand, "_explore", fail)
        given = errands(3)
        search, helpers = together(given, ("branch-and-cut",))
        assert search.proved
        assert search.cost == least_cost(given)
        assert helpers.lost == ["one failed: ValueError: broken"]

    def test_where_memory_is_short_no_process_is_started(self):
        """It is needed here."""
        helpers = Helpers(1, memory_bytes=lambda: 300 * MIB)
        helpers.begin(ordering("ESC12"))
        assert helpers.trace == {
            "processes": 1,
            "lost_processes": ["one was not started: memory limit"],
        }

    @pytest.mark.parametrize(("left_s", "started"), [(15.0, False), (25.0, True), (None, True)])
    def test_where_time_is_short_no_process_is_started_that_takes_long_to_start(
        self, small_turns, left_s, started
    ):
        """To wait for it would take longer than the search may."""

        class SlowToStart(AnyMoment):
            start_up_s = 10.0

        helpers = Helpers(1, 0, SlowToStart(1, 0, 0), left_s=lambda: left_s)
        helpers.begin(ordering("ESC12"))
        assert helpers.started == 1 + started
        lost = [] if started else ["none was started: that takes 10 s; time limit"]
        assert helpers.lost == lost

    @pytest.mark.slow(reason="half a second for a process; none is started in every run")
    def test_where_memory_gets_short_processes_are_given_up(self):
        """Before this one is."""
        left = [4096 * MIB]
        helpers = Helpers(1, memory_bytes=lambda: left[0])
        helpers.begin(ordering("ESC12"))
        assert helpers.started == 2
        left[0] = 32 * MIB
        helpers.attend()
        assert helpers.lost == ["one was given up: memory limit"]
        assert helpers.idle == []

    def test_no_process_is_started_for_what_is_proved_soon(self):
        """Starting one takes longer."""
        helpers = Helpers(64)
        search = OrderingSearch(ordering("ESC12"), helpers=helpers)
        search.run()
        assert search.proved
        assert helpers.trace == {"processes": 1}


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
        wait_until(lambda: all(worked_s(worker) > 1 for worker in workers(search.pid)), "no work")
        os.killpg(search.pid, signal.SIGINT)
        out, errors = search.communicate(timeout=PATIENCE_S)
        assert search.returncode == 130
        document = json.loads(out)
        assert document["lower_bound"] <= document["cost"]
        assert document["trace"]["processes"] == 2
        assert "lost_processes" not in document["trace"]
        assert errors == ""
        wait_until(lambda: not any(map(running, others)), "a process is left")

    @pytest.mark.slow(reason="the first one in every run")
    def test_a_second_ctrl_c_ends_all_at_once(self):
        """Without a traceback."""
        search = self.start()
        others = self.begun(search)
        for _ in range(2):
            os.killpg(search.pid, signal.SIGINT)
            time.sleep(0.01)
        _, errors = search.communicate(timeout=PATIENCE_S)
        assert search.returncode == 130
        assert "Traceback" not in errors
        assert "leaked" not in errors
        wait_until(lambda: not any(map(running, others)), "a process is left")

    @pytest.mark.slow(reason="starts a program and kills it; ended by Ctrl-C in every run")
    def test_no_process_outlives_one_that_is_killed(self):
        """Nor says anything about it."""
        search = self.start()
        others = self.begun(search)
        time.sleep(0.5)
        search.kill()
        _, errors = search.communicate(timeout=PATIENCE_S)
        assert errors == ""
        wait_until(lambda: not any(map(running, others)), "a process is left")

    @pytest.mark.slow(reason="two processes for two seconds; of one process in every run")
    def test_the_time_limit_holds_for_all(self):
        """It ends a moment later."""
        search = self.start("--time-limit", "2")
        out, errors = search.communicate(timeout=PATIENCE_S)
        assert search.returncode == 0
        document = json.loads(out)
        assert document["reason"] == "time limit"
        assert errors == ""


@pytest.mark.slow(
    reason="a search by two processes on a large instance; every run stops auto at a gap"
)
def test_what_all_find_counts_for_the_gap():
    """It is asked for in one process only."""
    task = instance("ft70.1").tasks[-1]
    result = solve(task, "portfolio", jobs=2, stop=Stop(gap=0.2, time_limit_s=PATIENCE_S))
    assert result.reason == "gap reached"
    assert result.gap is not None
    assert result.gap <= 0.2
