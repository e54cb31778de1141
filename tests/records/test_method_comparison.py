"""Methods compared by the scores of their runs, after Agarwal et al. (2021), by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.records import (
    Estimate,
    compare_methods,
    interquartile_mean,
    mean,
    performance_profile,
    probability_of_improvement,
    stratified_iqm,
)
from skillplan.views import render_markdown
from skillplan.views.tables import tabulate_methods

scores = st.lists(st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0]), min_size=1, max_size=5)


def document(solver, costs, *, task="board", run_dir="runs", optimum=1.0, **more):
    return {
        "run_dir": run_dir,
        "task": {"name": task, "sha256": task},
        "solver": solver,
        "options": {},
        "optimum": optimum,
        "runs": [{"cost": cost} for cost in costs],
        **more,
    }


class TestProbabilityOfImprovement:
    def test_it_is_the_share_of_pairs_and_ties_count_half(self):
        """Of four pairs, one is above, two are below and one is a tie: 1.5 of 4."""
        assert Estimate(0.5) == probability_of_improvement([[1.0]], [[1.0]])
        assert probability_of_improvement([[0.5, 1.0]], [[1.0, 0.75]]).value == 0.375

    def test_it_is_the_mean_over_the_tasks(self):
        """1 on one task with nine pairs, 0 on the other with one."""
        known = probability_of_improvement([[1.0, 0.9, 0.8], [0.1]], [[0.3, 0.2, 0.1], [0.2]])
        assert known.value == 0.5

    @given(scores, scores)
    def test_both_directions_sum_to_1(self, ours, theirs):
        first = probability_of_improvement([ours], [theirs])
        second = probability_of_improvement([theirs], [ours])
        assert first.value + second.value == pytest.approx(1.0)

    def test_the_interval_is_that_of_the_bootstrap(self):
        """Of a score against 100 others, Binomial(100, 1/2) / 100: 0.40 to 0.60."""
        known = probability_of_improvement([[0.5, 0.5]], [[0.0, 1.0]])
        assert (known.value, known.low, known.high) == (0.5, None, None)
        known = probability_of_improvement([[0.5] * 3], [[0.0, 1.0] * 50])
        assert known.low == pytest.approx(0.40, abs=0.02)
        assert known.high == pytest.approx(0.60, abs=0.02)

    def test_other_tasks_are_refused(self):
        with pytest.raises(ValueError, match="same tasks"):
            probability_of_improvement([[1.0]], [[1.0], [0.5]])


class TestProfile:
    def test_it_is_the_share_of_runs_above_each_score(self):
        """Above, not at: of the scores 0, 0.5, 0.5 and 1."""
        profile = performance_profile([[0.0, 0.5], [0.5, 1.0]], [0.0, 0.25, 0.5, 0.75, 1.0])
        assert profile.shares == (0.75, 0.75, 0.25, 0.25, 0.0)

    @given(st.lists(scores, min_size=1, max_size=3))
    def test_it_falls_and_lies_in_its_band(self, strata):
        profile = performance_profile(strata, np.linspace(0, 1, 6).tolist())
        assert list(profile.shares) == sorted(profile.shares, reverse=True)
        if profile.low is not None:
            for low, value, high in zip(profile.low, profile.shares, profile.high, strict=True):
                assert low <= value <= high


class TestInterquartileMean:
    def test_it_pools_the_runs_of_all_tasks(self):
        """Of 0 to 7, 2 to 5 remain."""
        assert stratified_iqm([[0.0, 7.0, 1.0, 6.0], [2.0, 5.0, 3.0, 4.0]]).value == 3.5

    def test_resamples_stay_within_a_task(self):
        """Tasks whose runs are all alike leave nothing to chance."""
        known = stratified_iqm([[0.2] * 4, [0.8] * 4])
        assert (known.low, known.high) == (known.value, known.value)
        assert interquartile_mean([0.2] * 4 + [0.8] * 4).low < known.value


class TestMethods:
    def test_an_incomplete_run_scores_0(self):
        (method,) = compare_methods([document("dqn", [1.0, 2.0, None, 4.0])]).methods
        assert method.scores == ((1.0, 0.5, 0.0, 0.25),)

    def test_trainings_of_a_learner_on_several_tasks_are_one_method(self):
        comparison = compare_methods(
            [
                document(solver, costs, task=task, run_dir=f"{solver}-{task}")
                for solver, costs in (("dqn", [1.0, 1.0]), ("ppo", [2.0, None]))
                for task in ("board", "pc")
            ]
        )
        assert ["dqn", "ppo"] == [method.name for method in comparison.methods]
        ((_, _, probability),) = comparison.improvements
        assert probability.value == 1.0

    def test_trainings_on_one_task_are_methods_of_their_own(self):
        names = [
            method.name
            for method in compare_methods(
                [document("dqn", [1.0], run_dir=run_dir) for run_dir in ("short", "long")]
            ).methods
        ]
        assert ["short: dqn", "long: dqn"] == names

    def test_a_training_given_twice_counts_once(self):
        (method,) = compare_methods([document("dqn", [1.0, 2.0])] * 2).methods
        assert ("dqn", 2, 1) == (method.name, method.runs, len(method.tasks))

    def test_trainings_with_other_options_are_other_methods(self):
        """Their names show the difference; what the task determines is none."""

        def trained(task: str, width: int, steps: int, derived: list[str] | None):
            return document(
                "dqn",
                [1.0, 2.0],
                task=task,
                run_dir=f"{task}-{width}-{steps}",
                options={"width": width, "steps": steps, "mask": "applicable"},
                derived_options=derived,
            )

        def named(*documents) -> list[str]:
            return [method.name for method in compare_methods(documents).methods]

        derived = ["steps"]
        assert ["dqn"] == named(trained("a", 64, 10, derived), trained("b", 64, 20, derived))
        assert ["dqn (width=64)", "dqn (width=128)"] == named(
            trained("a", 64, 10, derived), trained("b", 128, 20, derived)
        )
        assert ["dqn (steps=derived)", "dqn (steps=20)"] == named(
            trained("a", 64, 10, derived), trained("a", 64, 20, [])
        )
        assert ["dqn"] == named(trained("a", 64, 10, None), trained("b", 64, 20, None))
        assert ["dqn (steps=10)", "dqn (steps=20)"] == named(
            trained("a", 64, 10, None), trained("a", 64, 20, None)
        )

    def test_the_table_says_which_pairs_have_no_probability(self):
        comparison = compare_methods(
            [document("dqn", [1.0]), document("ppo", [1.0], task="pc", run_dir="other")]
        )
        text = render_markdown(tabulate_methods(comparison))
        assert "of methods whose tasks differ: dqn and ppo" in text

    def test_a_deterministic_planner_gets_no_interval(self):
        """Its seeds are no samples; what it is compared with gets its own interval."""
        planner = document("learned-model", [1.0] * 5, deterministic=True)
        learner = document("dqn", [1.0, 1.1, 1.2, 1.3, None])
        comparison = compare_methods([planner, learner])
        first, second = comparison.methods
        assert first.score_iqm == Estimate(1.0)
        assert second.score_iqm.low is not None
        assert comparison.improvements[0][2].low is None
        assert first.profile().low is None

    def test_nothing_is_compared_without_an_optimum_or_tasks_in_common(self):
        assert compare_methods([document("dqn", [1.0], optimum=None)]) is None
        apart = compare_methods([document("dqn", [1.0]), document("ppo", [1.0], task="pc")])
        assert apart.improvements == []


# The interquartile mean of runs: the middle half, and how far resampled runs move it.


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
