"""What a network does on a model, state by state, and where that leads."""

import numpy as np
import pytest

from situations import fake_back_end, make_skill, make_task, model_of, retry_task, two_roads_task
from skillplan.env import Observation
from skillplan.solvers import NetworkChoice, NetworkPolicy, reachable_policy
from skillplan.task import Facts, Verdict


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
