"""Policies that are networks: scores, what is allowed, what is drawn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.solvers import NetworkPolicy, allowed_scores, random_actions


def array(values):
    return np.array(values, dtype=np.float32)


def scoring(*scores):
    """Return a policy that gives these scores whatever is observed."""
    return NetworkPolicy((np.zeros((1, len(scores)), dtype=np.float32),), (array(scores),))


SEEN = np.zeros((1, 1), dtype=np.float32)


class TestScores:
    def test_one_layer_is_a_weighted_sum(self):
        policy = NetworkPolicy((array([[1, 2], [3, -4]]),), (array([0.5, 0]),))
        assert [[0.5, 0], [4.5, -2]] == policy.scores(array([[0, 0], [1, 1]])).tolist()
        assert (2, 2) == (policy.inputs, policy.actions)

    def test_all_layers_but_the_last_are_rectified(self):
        first, last = array([[1, -1], [0, 2]]), array([[1, 0, 2], [0, 1, -3]])
        policy = NetworkPolicy((first, last), (array([0, -1]), array([0, 0, -0.5])))
        # (3, 0): hidden (3, -4) -> (3, 0). (-1, 1): hidden (-1, 2) -> (0, 2).
        scores = policy.scores(array([[3, 0], [-1, 1]]))
        assert [[3, 0, 5.5], [0, 2, -6.5]] == scores.tolist()
        assert np.float32 == scores.dtype
        assert (2, 3) == (policy.inputs, policy.actions)

    def test_what_is_observed_is_not_changed(self):
        policy = NetworkPolicy((array([[1.0]]), array([[1.0]])), (array([0]), array([0])))
        seen = array([[-1.0]])
        policy.scores(seen)
        assert [[-1.0]] == seen.tolist()

    @pytest.mark.parametrize(
        ("weights", "biases", "message"),
        [
            ((), (), "at least one layer"),
            (([[1, 2]],), (), "at least one layer"),
            (([[1, 2]],), ([1],), "do not fit"),
            (([1, 2],), ([1, 2],), "do not fit"),
            (([[1, 2]], [[1]]), ([1, 2], [1]), "do not fit"),
            (([[1, float("nan")]],), ([1, 2],), "finite"),
            (([[1, 2]],), ([1, float("inf")],), "finite"),
        ],
    )
    def test_what_is_no_network_is_refused(self, weights, biases, message):
        with pytest.raises(ValueError, match=message):
            NetworkPolicy(tuple(map(array, weights)), tuple(map(array, biases)))


class TestGreedy:
    def test_the_best_is_taken_of_equals_the_first(self):
        assert [1] == scoring(1, 3, 3, 2).greedy(SEEN).tolist()

    def test_only_what_is_allowed_is_taken(self):
        masks = np.array([[True, False, False, True], [True, False, True, False]])
        seen = np.zeros((2, 1), dtype=np.float32)
        assert [3, 2] == scoring(1, 3, 3, 2).greedy(seen, masks).tolist()

    def test_where_nothing_is_allowed_all_is(self):
        masks = np.array([[False] * 4, [False, False, False, True]])
        seen = np.zeros((2, 1), dtype=np.float32)
        assert [1, 3] == scoring(1, 3, 3, 2).greedy(seen, masks).tolist()

    def test_scores_of_what_is_allowed_stay_what_they_are(self):
        scores = array([[1, 2], [3, 4]])
        masks = np.array([[True, False], [False, False]])
        assert [[1, -np.inf], [3, 4]] == allowed_scores(scores, masks).tolist()
        assert allowed_scores(scores, None) is scores


class TestSample:
    # At temperature 1 the probabilities are 0.1, 0.2, 0.3, 0.4.
    SCORES = tuple(np.log([1, 2, 3, 4]))
    QUANTILES = ((0.0, 0), (0.0999, 0), (0.1001, 1), (0.2999, 1), (0.3001, 2), (0.5999, 2))

    def draw(self, uniforms, masks=None, temperature=1.0, scores=SCORES):
        count = len(uniforms)
        seen = np.zeros((count, 1), dtype=np.float32)
        if masks is not None:
            masks = np.array([masks] * count)
        return scoring(*scores).sample(seen, masks, np.array(uniforms), temperature).tolist()

    def test_probabilities_are_those_of_the_scores(self):
        uniforms, actions = zip(*self.QUANTILES, (0.6001, 3), (1 - 2**-53, 3), strict=True)
        assert list(actions) == self.draw(uniforms)

    def test_evenly_spread_numbers_give_every_action_its_share(self):
        drawn = self.draw((np.arange(1_000) + 0.5) / 1_000)
        assert [100, 200, 300, 400] == np.bincount(drawn).tolist()

    def test_temperature_flattens_or_sharpens(self):
        # Squares and roots of the weights 1 to 4.
        for temperature, weights in ((0.5, [1, 4, 9, 16]), (2.0, np.sqrt([1, 2, 3, 4]))):
            drawn = self.draw((np.arange(3_000) + 0.5) / 3_000, temperature=temperature)
            shares = np.bincount(drawn) / 3_000
            np.testing.assert_allclose(shares, weights / np.sum(weights), atol=1e-3)

    def test_next_to_nothing_is_greedy(self):
        assert [3, 3] == self.draw([0.0, 1 - 2**-53], temperature=1e-6)

    def test_only_what_is_allowed_is_drawn(self):
        drawn = self.draw((np.arange(1_000) + 0.5) / 1_000, [True, False, False, True])
        assert [200, 0, 0, 800] == np.bincount(drawn).tolist()
        assert [0, 2] == self.draw([0.0, 1 - 2**-53], [True, False, True, False])

    def test_where_nothing_is_allowed_all_is(self):
        assert [0, 3] == self.draw([0.0, 1 - 2**-53], [False] * 4)

    def test_scores_that_are_far_apart_do_not_overflow(self):
        assert [1] == self.draw([0.5], temperature=1e-3, scores=(-3e4, 3e4))

    @pytest.mark.parametrize("temperature", [0.0, -1.0, float("nan")])
    def test_a_temperature_that_is_not_above_0_is_refused(self, temperature):
        with pytest.raises(ValueError, match="must be > 0"):
            self.draw([0.5], temperature=temperature)


class TestRandomActions:
    def test_those_allowed_are_as_likely(self):
        masks = np.array([[False, True, True, False, True]] * 6)
        uniforms = np.array([0.0, 0.33, 0.34, 0.66, 0.67, 1 - 2**-53])
        assert [1, 1, 2, 2, 4, 4] == random_actions(masks, uniforms).tolist()

    def test_where_nothing_is_allowed_all_are(self):
        masks = np.array([[False, False], [False, False], [False, True]])
        assert [0, 1, 1] == random_actions(masks, np.array([0.2, 0.7, 0.0])).tolist()

    @given(
        st.lists(st.lists(st.booleans(), min_size=3, max_size=3), min_size=1, max_size=6),
        st.floats(0, 1, exclude_max=True),
    )
    def test_nothing_else_is_ever_drawn(self, rows, uniform):
        masks = np.array(rows)
        actions = random_actions(masks, np.full(len(rows), uniform))
        for row, action in zip(rows, actions.tolist(), strict=True):
            assert 0 <= action < 3
            assert row[action] or not any(row)
