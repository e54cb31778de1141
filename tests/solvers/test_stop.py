"""When a search stops, and what it knows when it does."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import two_roads_task
from skillplan.solvers import Plan, Policy, Progress, Solution, Stop, relative_gap
from skillplan.solvers import stop as stops
from skillplan.workers import (
    measure_cpu_s_of,
    measure_resident_bytes,
    measure_resident_bytes_of,
    processes,
)


@pytest.mark.parametrize("time_limit_s", [0.0, -1.0, math.nan])
def test_a_time_limit_is_positive(time_limit_s):
    """Nothing can be done in no time."""
    with pytest.raises(ValueError, match="Time limit must be > 0 s"):
        Stop(time_limit_s=time_limit_s)


@pytest.mark.parametrize("gap", [-0.1, 1.1, math.nan])
def test_a_gap_is_a_fraction(gap):
    """Of the cost."""
    with pytest.raises(ValueError, match=r"Gap must be in \[0, 1\]"):
        Stop(gap=gap)


def test_a_bound_is_a_number():
    """NaN would compare with nothing."""
    with pytest.raises(ValueError, match="bound must be a number"):
        Stop().bound(math.nan)


def test_an_incumbent_has_a_cost():
    """Or it could not be compared."""
    with pytest.raises(ValueError, match="must have a cost"):
        Stop().incumbent(Plan(("a",)))


def test_it_goes_on_by_default():
    """There is no reason to stop."""
    stop = Stop()
    assert not stop()
    assert not stop.overdue()
    assert stop.reason is None


def test_an_interruption_is_final():
    """And says so."""
    stop = Stop()
    stop.interrupt()
    assert stop()
    assert stop.reason == "interrupted"
    assert not stop.overdue()


def test_the_time_limit_ends_the_search(monkeypatch):
    """After it, at the next poll; the model waits a while longer before it cuts off."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    stop = Stop(time_limit_s=5.0)
    now[0] = 104.9
    assert not stop()
    now[0] = 105.0
    assert stop()
    assert stop.reason == "time limit"
    assert not stop.overdue()
    now[0] = 105.0 + stops._GRACE_S + 0.01
    assert stop.overdue()


def test_a_solver_that_never_polls_is_overdue_all_the_same(monkeypatch):
    """The model's own questions count as polls."""
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    stop = Stop(time_limit_s=1.0)
    now[0] = 1.5
    assert not stop.overdue()
    now[0] = 3.0
    assert stop.overdue()


def test_the_gap_ends_the_search_once_it_is_reached():
    """Not before there is a plan, nor with a bound too low."""
    stop = Stop(gap=0.1)
    stop.bound(9.5)
    assert not stop()
    stop.incumbent(Plan(("a",), 11.0))
    assert not stop()
    stop.incumbent(Plan(("b",), 10.0))
    assert stop()
    assert stop.reason == "gap reached"


def test_without_a_gap_even_equal_cost_and_bound_do_not_end_it():
    """The solver itself proves its optimum."""
    stop = Stop()
    stop.bound(1.0)
    stop.incumbent(Plan(("a",), 1.0))
    assert not stop()


@given(st.lists(st.floats(0, 100)), st.lists(st.floats(0, 100)))
def test_it_keeps_the_best_plan_and_the_best_bound(costs, bounds):
    """The first of equal plans."""
    stop = Stop()
    for i, cost in enumerate(costs):
        stop.incumbent(Plan((str(i),), cost))
    for bound in bounds:
        stop.bound(bound)
    if costs:
        assert stop.best == Plan((str(costs.index(min(costs))),), min(costs))
    assert stop.lower_bound == max(bounds, default=None)


def test_it_reports_its_progress():
    """Every better plan and every bound, with the number of nodes."""
    seen = []
    stop = Stop(on_progress=seen.append)
    stop.incumbent(Plan(("a",), 5.0))
    stop.incumbent(Plan(("b",), 6.0))
    stop.bound(4.0, 17)
    assert seen == [Progress(5.0, None, 0), Progress(5.0, 4.0, 17)]


@pytest.mark.parametrize(
    ("cost", "bound", "gap"),
    [
        (2.0, 1.0, 0.5),
        (2.0, 2.0, 0.0),
        (2.0, 3.0, 0.0),
        (0.0, 0.0, 0.0),
        (None, 1.0, None),
        (1.0, None, None),
        (1.0, -math.inf, None),
    ],
)
def test_the_gap_is_a_fraction_of_the_cost(cost, bound, gap):
    """Never negative; none where either is missing."""
    assert relative_gap(cost, bound) == gap


class TestStall:
    @pytest.mark.parametrize("stall_s", [0.0, -1.0, math.nan])
    def test_it_is_positive(self, stall_s):
        """Nothing improves in no time."""
        with pytest.raises(ValueError, match="Stall must be > 0 s"):
            Stop(stall_s=stall_s)

    def test_it_ends_the_search_once_nothing_has_improved_for_so_long(self, clock):
        """Counted anew from every better plan and every better bound."""
        stop = Stop(stall_s=5.0)
        stop.incumbent(Plan(("a",), 10.0))
        clock.now = 4.9
        stop.bound(3.0)
        clock.now = 9.0
        stop.incumbent(Plan(("b",), 9.0))
        clock.now = 13.9
        assert not stop()
        clock.now = 14.0
        assert stop()
        assert stop.reason == "stalled"

    def test_without_a_plan_it_waits(self, clock):
        """There would be nothing to hand over."""
        stop = Stop(stall_s=5.0)
        stop.bound(3.0)
        clock.now = 100.0
        assert not stop()
        stop.incumbent(Plan(("a",), 10.0))
        assert not stop()

    def test_what_is_no_better_does_not_count(self, clock):
        """Nor does what rounding adds to a bound."""
        stop = Stop(stall_s=5.0)
        stop.incumbent(Plan(("a",), 10.0))
        stop.bound(3.0)
        clock.now = 4.0
        stop.incumbent(Plan(("b",), 11.0))
        stop.bound(2.0)
        stop.bound(3.0 + 1e-12)
        clock.now = 4.9
        assert not stop()
        clock.now = 5.0
        assert stop()

    def test_the_next_task_of_a_chain_has_its_own(self, clock):
        """And goes on after one that has stalled."""
        stop = Stop(stall_s=5.0)
        stop.incumbent(Plan(("a",), 10.0))
        clock.now = 6.0
        assert stop()
        stop.renew()
        assert not stop()
        stop.incumbent(Plan(("a",), 10.0))
        clock.now = 10.0
        assert not stop()


class TestMemoryLimit:
    @pytest.fixture
    def held(self, monkeypatch):
        """What the process is made to believe it holds [B]."""
        held = [100]
        monkeypatch.setattr(stops, "measure_resident_bytes", lambda: held[0])
        return held

    def test_it_is_positive(self):
        """A process always holds something."""
        with pytest.raises(ValueError, match="Memory limit must be > 0 bytes"):
            Stop(memory_limit_bytes=0)

    def test_what_is_left_is_told_and_never_below_zero(self, held):
        """A solver that reserves much at once asks before."""
        stop = Stop(memory_limit_bytes=1000)
        assert (stop.memory_limit_bytes, stop.memory_left_bytes()) == (1000, 900)
        held[0] = 1100
        assert stop.memory_left_bytes() == 0

    def test_without_a_limit_nothing_is_told(self):
        """Nor does the size of the process end anything."""
        stop = Stop()
        assert stop.memory_limit_bytes is None
        assert stop.memory_left_bytes() is None
        assert not stop()

    def test_where_the_system_does_not_tell_there_is_no_limit_to_keep(self, monkeypatch):
        """The search goes on."""
        monkeypatch.setattr(stops, "measure_resident_bytes", lambda: None)
        stop = Stop(memory_limit_bytes=1)
        assert stop.memory_left_bytes() is None
        assert not stop()

    def test_the_search_ends_shortly_before_the_limit(self, held, clock):
        """What is left is for handing over the plan."""
        stop = Stop(memory_limit_bytes=1000)
        assert not stop()
        held[0] = 980
        clock.now = 1.0
        assert stop()
        assert stop.reason == "memory limit"
        assert not stop.overdue()

    def test_a_solver_that_never_polls_is_cut_off_at_the_limit(self, held, clock):
        """Without the patience that a time limit has."""
        stop = Stop(memory_limit_bytes=1000)
        held[0] = 1001
        assert not stop.overdue()
        assert stop.overdue()
        assert stop.reason == "memory limit"

    def test_a_search_on_the_side_keeps_it_too(self, held):
        """It is the same process."""
        assert Stop(memory_limit_bytes=1000).within(1.0).memory_limit_bytes == 1000


def test_the_speed_follows_the_search(clock):
    """Measured about once a second; none before."""
    seen = []
    stop = Stop(on_progress=seen.append)
    for now_s, nodes in ((0.5, 100), (1.0, 300), (1.5, 900), (2.0, 1300)):
        clock.now = now_s
        stop.bound(1.0, nodes)
    assert [progress.nodes_per_s for progress in seen] == [None, 300.0, 300.0, 1000.0]


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand [s]."""

    class Clock:
        now = 0.0

    monkeypatch.setattr(time, "monotonic", lambda: Clock.now)
    return Clock


# How much memory the process holds.


MIB = 1024**2


def test_it_grows_with_what_is_held():
    """By about as much as was written to; in a process without threads of other tests."""
    words = (
        "from skillplan.workers import measure_resident_bytes as measure; before = measure(); "
        f"held = bytearray(b'x' * {64 * MIB}); print(measure() - before, len(held))"
    )
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    grown, held = map(int, done.stdout.split())
    assert 60 * MIB < grown < 80 * MIB
    assert held == 64 * MIB


def test_where_there_is_no_process_file_system_the_largest_size_stands_for_it(monkeypatch):
    """It is never less."""
    now = measure_resident_bytes()
    monkeypatch.setattr(processes, "_STATM", Path("no/such/file"))
    assert measure_resident_bytes() > 0.9 * now


def test_the_cpu_time_of_a_process_is_what_it_says_itself():
    """To its clock's tick; of no process it is unknown."""
    spent_s = measure_cpu_s_of(os.getpid())
    if spent_s is None:
        assert not Path("/proc/self/stat").exists()
    else:
        assert spent_s == pytest.approx(time.process_time(), abs=0.2)
    assert measure_cpu_s_of(None) is None


def test_of_another_process_it_is_what_that_process_says_itself():
    """By a few pages; of one that is gone it is unknown."""
    if not Path("/proc/self/statm").exists():
        assert measure_resident_bytes_of(os.getpid()) is None
        return
    words = "import sys; held = bytearray(b'x' * 2**27); print(flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", words], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        other.stdout.readline()
        held = measure_resident_bytes_of(other.pid)
        assert held is not None
        assert 128 * MIB < held < 192 * MIB
        other.kill()
    assert measure_resident_bytes_of(other.pid) is None


def test_where_the_system_tells_nothing_it_is_unknown(monkeypatch):
    """Not zero."""
    monkeypatch.setattr(processes, "_STATM", Path("no/such/file"))
    monkeypatch.setitem(sys.modules, "resource", None)
    assert measure_resident_bytes() is None


@pytest.mark.parametrize("text", ["", "12", "a b c"])
def test_a_process_file_that_cannot_be_read_is_left_alone(monkeypatch, tmp_path, text):
    """The largest size is taken instead."""
    (tmp_path / "statm").write_text(text)
    monkeypatch.setattr(processes, "_STATM", tmp_path / "statm")
    assert measure_resident_bytes() > 10 * MIB


# What a solver hands over.


@pytest.mark.parametrize("skills", [["a"], "a", (1,), None, (None,)])
def test_a_plan_is_a_tuple_of_names(skills):
    """Whatever else a solver might take for one."""
    with pytest.raises(ValueError, match="tuple of skill names"):
        Plan(skills)


def test_a_bound_of_a_solution_is_a_number():
    """NaN is none."""
    with pytest.raises(ValueError, match="lower bound must be a number"):
        Solution(lower_bound=math.nan)


def test_a_solution_is_a_plan_or_a_policy_or_nothing():
    """Each is shown as what it is."""
    task = two_roads_task()
    plan, policy = Plan(("to_b", "finish"), 4.0), Policy({task.initial: task.skills[0]})
    assert (Solution(plan).plan, Solution(plan).policy) == (plan, None)
    assert (Solution(policy).plan, Solution(policy).policy) == (None, policy)
    assert (Solution().plan, Solution().policy) == (None, None)
    assert len(plan) == 2


def test_a_policy_is_a_mapping_that_cannot_be_changed():
    """Not through what it was made from either."""
    task = two_roads_task()
    choices = {task.initial: task.skills[0]}
    policy = Policy(choices)
    choices.clear()
    assert list(policy.items()) == [(task.initial, task.skills[0])]
    assert repr(policy) == "Policy(1 states)"
    with pytest.raises(TypeError):
        policy[task.initial] = task.skills[1]
