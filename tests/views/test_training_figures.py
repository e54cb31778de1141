"""Figures of training: what a curve is of, and what is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from skillplan.task import Metric
from skillplan.views import figures
from thinned import slow_case

HEADING, METRIC = figures.Heading("A title", "task t"), Metric("distance", "m")


def a_curve(
    success: list[int], *, run: int = 0, length: int = 10, done: int | None = None
) -> figures.RunCurve:
    """Return a run whose episodes all take as many steps."""
    count = len(success)
    return figures.RunCurve(
        f"run {run}, seed {run}",
        count * length if done is None else done,
        np.arange(1, count + 1) * length,
        np.array(success, dtype=np.bool_),
        2.0 + 0.01 * np.arange(count),
    )


def line(figure: Figure, gid: str) -> Any:
    """Return the one line or text of a figure that has an id."""
    (results,) = [
        get_child
        for get_child in figure.axes[0].get_children()
        if (get_child.get_gid() or "").startswith(gid)
    ]
    return results


class TestCurve:
    def test_a_point_is_the_mean_of_the_last_100_episodes(self):
        """Before there are so many, of those there are."""
        curve = a_curve([0] * 100 + [1] * 150)
        at = np.array([50.0, 100.0, 150.0, 200.0, 250.0])
        rates = curve.success_rate(at, "episodes")
        np.testing.assert_allclose([0.0, 0.0, 0.5, 1.0, 1.0], rates)

    def test_against_steps_an_episode_counts_once_it_has_ended(self):
        curve = a_curve([1, 0], length=10)
        rates = curve.success_rate(np.array([9.0, 10.0, 19.0, 20.0]), "steps")
        np.testing.assert_allclose([np.nan, 1.0, 1.0, 0.5], rates)

    def test_beyond_its_end_a_run_says_nothing(self):
        curve = a_curve([1, 1], done=25)
        assert np.isnan(curve.success_rate(np.array([26.0]), "steps")).all()
        assert 1.0 == curve.success_rate(np.array([25.0]), "steps")[0]
        assert np.isnan(curve.success_rate(np.array([3.0]), "episodes")).all()

    @given(st.lists(st.integers(0, 1), min_size=1, max_size=300))
    def test_a_rate_is_the_share_that_counting_gives(self, success):
        at = np.arange(1.0, len(success) + 1)
        rates = a_curve(success).success_rate(at, "episodes")
        counted = [np.mean(success[max(0, n - 100) : n]) for n in range(1, len(success) + 1)]
        np.testing.assert_allclose(counted, rates, atol=1e-12)

    def test_successes_are_placed_by_step_or_by_episode(self):
        curve = a_curve([0, 1, 1])
        for against, places in (("steps", [20, 30]), ("episodes", [2, 3])):
            result, costs, smooth = curve.successes(against)  # type: ignore[arg-type]
            assert (places, [2.01, 2.02], [2.01, 2.015]) == (
                result.tolist(),
                costs.tolist(),
                pytest.approx(smooth.tolist()),
            )

    def test_mean_and_deviation_are_of_the_runs_that_have_got_so_far(self):
        curves = [a_curve([1, 1]), a_curve([0, 0], run=1), a_curve([0], run=2)]
        _, mean, spread = figures.average_runs(curves, np.array([1.0, 2.0, 3.0]), "episodes")
        np.testing.assert_allclose([1 / 3, 0.5, np.nan], mean)
        np.testing.assert_allclose([np.sqrt(2 / 9), 0.5, np.nan], spread)

    @pytest.mark.parametrize(
        ("ends", "done"), [([2, 1], 5), ([1, 6], 5)], ids=["backwards", "after its end"]
    )
    def test_episodes_end_one_after_another(self, ends, done):
        with pytest.raises(ValueError, match="one after another"):
            figures.RunCurve("run 0", done, np.array(ends), np.ones(2, dtype=np.bool_), np.ones(2))


class TestSuccess:
    def test_the_thick_line_is_the_mean_over_runs(self):
        figure = figures.draw_success([a_curve([1] * 200), a_curve([0] * 200, run=1)], HEADING)
        heights = line(figure, "mean").get_ydata()
        np.testing.assert_allclose(50.0, heights[np.isfinite(heights)])

    def test_the_paper_is_a_line_with_a_name_where_it_is_asked_for(self):
        curves = [a_curve([0, 1] * 50)]
        label = line(figures.draw_success(curves, HEADING, published=0.4), "published").get_text()
        assert "Moller et al.: about 40 %" == label
        assert not [
            get_child
            for get_child in figures.draw_success(curves, HEADING).axes[0].get_children()
            if get_child.get_gid() == "published"
        ]

    @pytest.mark.parametrize(
        ("against", "label"), [("steps", "environment step [-]"), ("episodes", "episode [-]")]
    )
    def test_the_axis_says_what_it_counts(self, against, label):
        axes = figures.draw_success([a_curve([0, 1])], HEADING, against=against).axes[0]
        assert label == axes.get_xlabel()

    def test_where_runs_end_early_a_line_says_so(self):
        curves = [a_curve([1] * 20), a_curve([1] * 40, run=1)]
        texts = [text.get_text() for text in figures.draw_success(curves, HEADING).axes[0].texts]
        assert ["beyond, of the runs that went on"] == texts
        assert not figures.draw_success([curves[0], curves[0]], HEADING).axes[0].texts

    def test_without_an_episode_there_is_nothing_to_draw(self):
        with pytest.raises(ValueError, match="No episode"):
            figures.draw_success([a_curve([], done=100)], HEADING)


class TestDistances:
    def test_every_run_has_a_look_of_its_own(self):
        """A colour, and from the ninth on a dash."""
        curves = [a_curve([1] * 5, run=run) for run in range(20)]
        legend = figures.draw_distances(curves, METRIC, HEADING).legends[0]
        looks = {
            (
                get_line.get_color(),
                str(get_line.get_linestyle()),
                str(getattr(get_line, "_dash_pattern", "")),
            )
            for get_line in legend.get_lines()
        }
        assert 20 == len(looks)
        assert [curve.label for curve in curves] == [
            get_text.get_text() for get_text in legend.get_texts()
        ]

    def test_a_run_that_never_completes_is_named_as_such(self):
        curves = [a_curve([1, 1]), a_curve([0, 0], run=1)]
        legend = figures.draw_distances(curves, METRIC, HEADING).legends[0]
        assert ["run 0, seed 0", "run 1, seed 1: none"] == [
            get_text.get_text() for get_text in legend.get_texts()
        ]

    def test_the_line_is_the_mean_of_the_last_100_sequences(self):
        figure = figures.draw_distances([a_curve([1] * 150)], METRIC, HEADING)
        smooth = line(figure, "smoothed run 0").get_ydata()
        assert pytest.approx(2.0 + 0.01 * np.mean(range(50, 150))) == smooth[-1]

    def test_the_optimum_is_a_line_in_sight(self):
        figure = figures.draw_distances([a_curve([1, 1])], METRIC, HEADING, optimum=1.5)
        assert {1.5} == set(line(figure, "optimum").get_ydata())
        low, _ = figure.axes[0].get_ylim()
        assert low < 1.5
        assert ["proved optimum 1.50000 m"] == [text.get_text() for text in figure.axes[0].texts]

    def test_without_a_completed_sequence_there_is_nothing_to_draw(self):
        with pytest.raises(ValueError, match="No completed sequence"):
            figures.draw_distances([a_curve([0, 0])], METRIC, HEADING)


@pytest.mark.parametrize(
    "suffix", [slow_case(".png", reason="another format in every run"), ".svg"]
)
def test_equal_figures_are_equal_files(suffix):
    curves = [a_curve([0, 1, 1] * 50, run=run) for run in range(3)]
    for draw in (
        lambda: figures.draw_success(curves, HEADING, published=0.4),
        lambda: figures.draw_distances(curves, METRIC, HEADING, optimum=2.0),
    ):
        assert figures.render_figure(draw(), suffix) == figures.render_figure(draw(), suffix)
