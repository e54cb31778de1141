"""Networks carried over to another task: what has the same name is taken over."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.solvers import NamedNetwork, NetworkPolicy


def a_network(features: tuple[str, ...], actions: tuple[str, ...], seed: int) -> NamedNetwork:
    chance = np.random.default_rng(seed)
    sizes = (len(features), 5, len(actions))
    pairs = list(itertools.pairwise(sizes))
    weights = tuple(chance.normal(size=pair).astype(np.float32) for pair in pairs)
    biases = tuple(chance.normal(size=after).astype(np.float32) for _, after in pairs)
    return NamedNetwork(NetworkPolicy(weights, biases), features, actions)


names = st.lists(st.sampled_from("abcdefgh"), min_size=1, max_size=6, unique=True)


@given(names, names, st.permutations("abcdefgh"), st.permutations("abcdefgh"), st.integers(0, 99))
def test_known_skills_score_what_they_did_whatever_is_new(features, actions, more, others, seed):
    """In any order, and whatever features of unknown names are."""
    earlier = a_network(tuple(features), tuple(actions), seed)
    later = earlier.carried_over(more, others)
    seen = np.random.default_rng(seed).normal(size=(3, len(more))).astype(np.float32)
    there = seen[:, [more.index(name) for name in features]]
    scores = later.scores(seen)[:, [others.index(name) for name in actions]]
    assert np.allclose(scores, earlier.network.scores(there), atol=1e-5)


def test_a_skill_of_an_unknown_name_scores_the_average_of_the_known():
    earlier = a_network(("a", "b"), ("p", "q", "r"), 0)
    later = earlier.carried_over(("a", "b"), ("q", "new", "r"))
    seen = np.array([[0.3, -1.0]], dtype=np.float32)
    q, new, r = later.scores(seen)[0]
    assert (q + r) / 2 == pytest.approx(new, abs=1e-6)


@pytest.mark.parametrize(("features", "actions"), [(("x",), ("p",)), (("a",), ("x",))])
def test_where_no_name_is_known_there_is_nothing_to_carry_over(features, actions):
    with pytest.raises(ValueError, match="Nothing of the network"):
        a_network(("a", "b"), ("p", "q"), 0).carried_over(features, actions)
