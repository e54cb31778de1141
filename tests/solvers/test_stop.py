"""When a search stops, and what it knows when it does."""

import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.solvers import stop as stops
from skillplan.solvers.solution import Plan
from skillplan.solvers.stop import Progress, Stop, relative_gap


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


def test_an_incumbent_names_its_cost():
    """Or it could not be compared."""
    with pytest.raises(ValueError, match="must name its cost"):
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
