"""What runs note: lines that come back as they were, and damage that is named."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.errors import OptionError
from skillplan.records import (
    FiguresRecord,
    RunMetrics,
    format_metrics_line,
    parse_metrics,
    read_metrics,
)
from skillplan.solvers import Episode

FINITE = st.floats(allow_nan=False, allow_infinity=False)
EPISODES = st.builds(
    Episode,
    run=st.just(3),
    step=st.integers(1, 10**9),
    end=st.sampled_from(["complete", "infeasible", "out-of-time"]),
    actions=st.lists(st.integers(0, 500), max_size=30).map(tuple),
    cost=FINITE,
    reward=FINITE,
    greedy=st.booleans(),
)
GOOD = format_metrics_line(Episode(0, 7, "complete", (0, 1), 1.5, 10.0, True))


@given(st.lists(EPISODES, max_size=8), st.dictionaries(st.text(min_size=1), FINITE, max_size=4))
def test_every_line_comes_back_as_it_was(episodes, figures):
    episodes.sort(key=lambda first: first.step)
    figures = {name: value for name, value in figures.items() if name not in ("kind", "step")}
    record = FiguresRecord(10**9, figures)
    lines = [format_metrics_line(episode) for episode in (*episodes, record)]
    assert all("\n" not in line for line in lines)
    assert RunMetrics(tuple(episodes), (record,)) == parse_metrics(lines, Path("a"), 3)


def test_figures_that_are_not_finite_are_left_out():
    line = format_metrics_line(
        FiguresRecord(5, {"loss": float("nan"), "q": 1.0, "far": float("inf")})
    )
    (result,) = parse_metrics([line], Path("a"), 0).figures
    assert FiguresRecord(5, {"q": 1.0}) == result


def test_an_episode_whose_cost_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        format_metrics_line(Episode(0, 7, "complete", (0, 1), float("nan"), 10.0, True))


def test_a_run_that_has_noted_nothing_has_no_metrics(tmp_path):
    assert RunMetrics() == read_metrics(tmp_path / "metrics.jsonl", 0)


def test_a_piece_of_a_line_at_the_end_is_left_out(tmp_path):
    """Wherever the line is cut, and where only its end is missing."""
    for length in range(1, len(GOOD) + 1):
        path = tmp_path / f"{length}.jsonl"
        path.write_text(f"{GOOD}\n{GOOD[:length]}")
        assert parse_metrics([GOOD], path, 0) == read_metrics(path, 0), length


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("{", "["),
        ('"episode"', '"epsiode"'),
        ('"complete"', '"lost"'),
        ('"step":7', '"step":0'),
        ('"step":7', '"step":3'),
        ('"step":7', '"step":"7"'),
        ('"length":2', '"length":3'),
        ('"actions":[0,1]', '"actions":[0,-1]'),
        ('"actions":[0,1]', '"actions":[0,1.5]'),
        ('"actions":[0,1]', '"actions":null'),
        ('"cost":1.5', '"cost":NaN'),
        ('"cost":1.5', '"cost":true'),
        ('"reward":10.0', '"reword":10.0'),
        ('"greedy":true', '"greedy":1'),
        (GOOD, "7"),
        (GOOD, "[" * 5_000),
    ],
)
def test_another_damaged_line_is_named(tmp_path, old, new):
    path = tmp_path / "metrics.jsonl"
    bad = GOOD.replace(old, new)
    assert bad != GOOD
    before = GOOD.replace('"step":7', '"step":5')
    path.write_text(f"{before}\n{bad}\n{GOOD}\n")
    with pytest.raises(OptionError) as caught:
        read_metrics(path, 0)
    assert str(caught.value).startswith(f"{path}:2: is damaged: ")
    assert "\n" not in str(caught.value)
