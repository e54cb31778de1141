"""Policies that are networks: scores, what is allowed, what is drawn."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import fake_back_end, make_skill, make_task, model_of, retry_task, two_roads_task
from skillplan.env import Observation
from skillplan.solvers import (
    NamedNetwork,
    NetworkChoice,
    NetworkPolicy,
    allowed_scores,
    random_actions,
    reachable_policy,
)
from skillplan.task import Facts, Verdict


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


# Networks carried over to another task: what has the same name is taken over.


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


# What a network does on a model, state by state, and where that leads.


def preferring(task, *names):
    """Return a network that scores skills in this order, whatever is observed; others last."""
    scores = [-names.index(s.name) if s.name in names else -len(names) for s in task.skills]
    weight = np.zeros((Observation.of(task, "markov").width, len(scores)), dtype=np.float32)
    return NetworkPolicy((weight,), (np.array(scores, dtype=np.float32),))


def forbidding(task, *names):
    """Return a back end that forbids some skills."""

    def answer(skill, state):
        facts = (task.facts.none, task.facts.none)
        if skill.name in names:
            return Verdict.infeasible("in the way", *facts)
        return Verdict.feasible(*facts)

    return fake_back_end(task, answer)


def named(policy):
    """Return names of skills by the facts that hold."""
    return {tuple(state): skill.name for state, skill in policy.items()}


@pytest.fixture
def task():
    """Two roads, the cheap one by way of a."""
    return two_roads_task()


class TestNetworkChoice:
    def choose(self, task, mask, *names, back_end=None, state=None):
        model = model_of(task, *([back_end] if back_end else []))
        choice = NetworkChoice(preferring(task, *names), model, "markov", mask)
        return choice(task.initial if state is None else state).name

    def test_without_a_mask_the_best_score_is_taken_also_where_it_does_not_apply(self, task):
        assert "finish" == self.choose(task, "none", "finish", "to_b")

    def test_a_mask_limits_it_to_what_applies(self, task):
        back_end = forbidding(task, "to_b")
        assert "to_b" == self.choose(task, "applicable", "finish", "to_b", back_end=back_end)
        assert [] == back_end.asked

    def test_or_to_what_back_ends_allow_which_are_asked_then(self, task):
        back_end = forbidding(task, "to_b")
        assert "to_a" == self.choose(task, "feasible", "finish", "to_b", back_end=back_end)
        assert {"to_a", "to_b"} == {name for name, _ in back_end.asked}

    def test_what_is_observed_decides(self, task):
        observation = Observation.of(task, "paper")
        weight = np.zeros((observation.width, 4), dtype=np.float32)
        weight[observation.features.index("a")] = [0, 2, 0, 0]
        network = NetworkPolicy((weight,), (np.array([0, 0, 1, 0], dtype=np.float32),))
        choice = NetworkChoice(network, model_of(task), "paper", "none")
        assert ["to_b", "a_to_b"] == [choice(task.facts.of(*now)).name for now in ((), ("a",))]

    def test_where_nothing_is_allowed_all_is(self, task):
        back_end = forbidding(task, "to_a", "to_b")
        assert "finish" == self.choose(task, "feasible", "finish", back_end=back_end)


class TestPolicyOnItsWay:
    def follow(self, task, *names, mask="applicable", back_end=None):
        model = model_of(task, *([back_end] if back_end else []))
        network = preferring(task, *names)
        return named(reachable_policy(model, NetworkChoice(network, model, "markov", mask)))

    def test_it_knows_what_to_do_up_to_the_goal_and_nothing_off_its_way(self, task):
        assert {(): "to_a", ("a",): "a_to_b", ("b",): "finish"} == self.follow(task, "to_a")
        assert {(): "to_b", ("b",): "finish"} == self.follow(task, "to_b")

    def test_a_skill_that_is_not_feasible_is_left_out(self, task):
        back_end = forbidding(task, "a_to_b")
        assert {(): "to_a"} == self.follow(task, "to_a", back_end=back_end)

    def test_one_that_does_not_apply_is_left_out_and_no_back_end_is_asked_about_it(self, task):
        back_end = forbidding(task)
        assert {} == self.follow(task, "finish", mask="none", back_end=back_end)
        assert [] == back_end.asked

    def test_it_is_followed_no_longer_than_the_step_limit(self):
        short = two_roads_task(step_limit=2)
        assert {(): "to_a", ("a",): "a_to_b"} == self.follow(short, "to_a")

    def test_a_circle_is_left_where_it_closes(self):
        facts = Facts(("a", "done"))
        skills = [
            make_skill(facts, "there", forbids=("a",), add=("a",)),
            make_skill(facts, "back", requires=("a",), delete=("a",)),
            make_skill(facts, "finish", requires=("a",), add=("done",)),
        ]
        task = make_task(facts, skills, goal=("done",), step_limit=1_000)
        assert {(): "there", ("a",): "back"} == self.follow(task, "there", "back")

    def test_under_chance_every_outcome_is_followed(self):
        facts = Facts(("dropped", "held", "done"))
        grasp = make_skill(
            facts,
            "grasp",
            forbids=("dropped", "held"),
            outcomes=[(0.9, ("held",), ()), (0.1, ("dropped",), ())],
        )
        skills = [
            grasp,
            make_skill(facts, "lift", requires=("dropped",), add=("held",), delete=("dropped",)),
            make_skill(facts, "place", requires=("held",), add=("done",), delete=("held",)),
        ]
        task = make_task(facts, skills, goal=("done",))
        assert {(): "grasp", ("dropped",): "lift", ("held",): "place"} == self.follow(task)
        assert {(): "try"} == self.follow(retry_task(0.5))

    def test_one_who_stands_at_the_goal_does_nothing(self):
        facts = Facts(("done",))
        skill = make_skill(facts, "try", add=("done",))
        assert {} == self.follow(make_task(facts, [skill], initial=("done",), goal=("done",)))
