"""The interquartile mean of runs: the middle half, and how far resampled runs move it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.records import interquartile_mean, mean

figures = st.floats(-1e6, 1e6, allow_nan=False)


def test_nothing_has_no_mean():
    assert interquartile_mean([]) is None


def test_one_run_gives_no_interval():
    item = interquartile_mean([0.25])
    assert item is not None
    assert (0.25, None, None) == (item.value, item.low, item.high)


def test_a_quarter_of_the_runs_is_left_out_at_either_end():
    """Of ten runs two; the figure of the middle six."""
    item = interquartile_mean([100.0, -50.0, 3.0, 1.0, 2.0, 4.0, 5.0, 6.0, -9.0, 77.0])
    assert item is not None
    assert 3.5 == item.value


def test_one_run_that_went_astray_does_not_decide():
    """As it does for the mean."""
    runs = [0.0] * 9
    steady, moved = interquartile_mean([*runs, 1e6]), mean([*runs, 1e6])
    assert steady is not None
    assert moved is not None
    assert 0.0 == steady.value
    assert 1e5 == moved.value


def test_fewer_than_four_runs_all_count():
    item = interquartile_mean([0.0, 3.0, 6.0])
    assert item is not None
    assert 3.0 == item.value


@given(st.lists(figures, min_size=3, max_size=12))
def test_the_interval_lies_among_the_runs_and_holds_the_figure(runs):
    item = interquartile_mean(runs)
    assert item is not None
    assert item.low is not None
    assert item.high is not None
    slack = 1e-9 * max(map(abs, runs))
    assert min(runs) - slack <= item.low <= item.value <= item.high <= max(runs) + slack


@given(
    st.lists(figures, min_size=2, max_size=8).flatmap(
        lambda x: st.permutations(x).map(lambda y: (x, y))
    )
)
def test_neither_order_nor_repetition_changes_it(pair):
    """The resamples are always the same."""
    assert interquartile_mean(pair[0]) == interquartile_mean(pair[1])


@pytest.mark.slow(reason="300 bootstraps; single intervals in every run")
def test_the_interval_holds_the_true_figure_as_often_as_it_says():
    """Of 300 sets of ten normal runs at least 85 %: a bootstrap of ten runs is a bit narrow."""
    draws = np.random.default_rng(5).normal(size=(300, 10))
    results = [interquartile_mean(runs) for runs in draws.tolist()]
    inside = sum(result.low <= 0 <= result.high for result in results)  # type: ignore[union-attr,operator]
    assert 0.85 == pytest.approx(inside / 300, abs=0.11)
    assert inside >= 0.85 * 300
