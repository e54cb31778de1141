"""The expected cost of a policy from roll-outs, against closed forms."""

import pytest

from situations import fake_back_end, make_skill, make_task, model_of, retry_task
from skillplan.model import evaluate_policy, policy_value, sample_policy
from skillplan.task import Facts, Verdict


def test_the_mean_of_roll_outs_comes_with_its_interval():
    """Of a geometric distribution: mean 8, standard deviation 2 * 12 ** 0.5."""
    task = retry_task(0.25, 2.0)
    sample = sample_policy(model_of(task), lambda state: task.skills[0], seed=3)
    assert sample is not None
    assert sample.roll_outs == 2_000
    assert abs(sample.cost - 8.0) < 1.5 * sample.half_width
    assert sample.half_width == pytest.approx(1.96 * 2 * 12**0.5 / 2_000**0.5, rel=0.15)
    assert sample.steps == sample.duration_s == pytest.approx(sample.cost / 2)


def test_the_same_seed_gives_the_same_roll_outs():
    task = retry_task(0.5)
    first, two, other = (
        sample_policy(model_of(task), lambda state: task.skills[0], seed) for seed in (1, 1, 2)
    )
    assert first == two
    assert first != other


def test_a_policy_that_says_nothing_or_what_is_infeasible_is_told_so():
    task = retry_task(0.5)
    silent = sample_policy(model_of(task), lambda state: None)
    assert silent is not None
    assert silent.problem is not None
    assert "says nothing" in silent.problem
    facts = Facts(("done",))
    shut = make_task(facts, [make_skill(facts, "go", add=("done",))], goal=("done",))
    never = fake_back_end(shut, Verdict.infeasible("it is shut"))
    failed = sample_policy(model_of(shut, never), lambda state: shut.skills[0])
    assert failed is not None
    assert failed.infeasible
    assert "it is shut" in (failed.problem or "")


def test_a_policy_that_never_arrives_is_given_up():
    facts = Facts(("done",))
    task = make_task(facts, [make_skill(facts, "wait")], goal=("done",))
    sample = sample_policy(model_of(task), lambda state: task.skills[0], roll_outs=2)
    assert sample is not None
    assert sample.problem == "the policy takes more than 400 skills"


def test_sweeps_give_what_equations_do(monkeypatch):
    """Of a chain too large for them."""
    task = retry_task(0.3, 1.5)
    solved = evaluate_policy(model_of(task), lambda state: task.skills[0])
    monkeypatch.setattr(policy_value, "_MOST_EQUATIONS", 0)
    swept = evaluate_policy(model_of(task), lambda state: task.skills[0])
    assert swept.cost == pytest.approx(solved.cost)
    assert swept.steps == pytest.approx(solved.steps)
