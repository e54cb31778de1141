"""How many swings positions are apart."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from skillplan_swarmitfix import Bench

PAPER = Bench(rows=6, cols=13, pitch_m=0.34)
FULL = Bench(rows=6, cols=13, pitch_m=0.34, actions=13)

odd = st.integers(0, 6).map(lambda half: 2 * half + 1)
benches = st.builds(Bench, st.integers(1, 8), odd, st.just(1.0), st.sampled_from([11, 13]))


@st.composite
def goals(draw: st.DrawFn) -> tuple[Bench, int]:
    """Draw a bench and a position on it."""
    bench = draw(benches)
    return bench, draw(st.integers(0, bench.n_positions - 1))


class TestDistances:
    @pytest.mark.parametrize(("bench", "diameter"), [(PAPER, 9), (FULL, 8)], ids=["11", "13"])
    def test_the_diameter_of_the_papers_bench(self, bench, diameter):
        """Over all 6006 pairs of positions."""
        distances = np.array([bench.distances(goal) for goal in range(bench.n_positions)])
        assert np.count_nonzero(distances > 0) == 6006
        assert distances.max() == diameter
        assert_array_equal(distances, distances.T)

    @given(goals())
    def test_they_are_those_of_a_search_step_by_step(self, to):
        """Backwards along the swings that lead into a position."""
        bench, goal = to
        into: dict[int, list[int]] = {position: [] for position in range(bench.n_positions)}
        for start, end in zip(
            np.repeat(np.arange(bench.n_positions), bench.actions).tolist(),
            bench.successors.ravel().tolist(),
            strict=True,
        ):
            if end >= 0:
                into[end].append(start)
        expected, queue = {goal: 0}, deque([goal])
        while queue:
            here = queue.popleft()
            for before in into[here]:
                if before not in expected:
                    expected[before] = expected[here] + 1
                    queue.append(before)
        assert len(expected) == bench.n_positions, "all positions are connected"
        assert bench.distances(goal).tolist() == [expected[p] for p in range(bench.n_positions)]

    @given(goals())
    def test_one_swing_changes_them_by_one_at_most(self, to):
        bench, goal = to
        distances = bench.distances(goal)
        ends = bench.successors
        change = np.abs(distances[ends] - distances[:, None])[ends >= 0]
        assert change.max() <= 1
        assert np.flatnonzero(distances == 0).tolist() == [goal]

    @pytest.mark.slow(reason="the largest bench; smaller ones in every run")
    def test_a_bench_of_780600_positions_is_searched_whole(self):
        """From a corner; a swing gains two columns at most and one row at most."""
        bench = Bench(rows=600, cols=1301, pitch_m=0.34)
        distances = bench.distances(0)
        assert distances.shape == (780_600,)
        assert distances.min() == 0
        row, col = np.divmod(np.arange(bench.n_positions), bench.cols)
        assert (distances >= row).all()
        assert (2 * distances >= col).all()
        assert distances[col == 1300].min() == 650
        assert distances[row == 599].min() == 599
