"""The expected cost of a policy, against closed forms and a simulation."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import fake_back_end, make_skill, make_task, model_of, retry_task, two_roads_task
from skillplan.errors import ModelTooLarge
from skillplan.model import evaluate_policy, policy_value, sample_policy
from skillplan.task import Facts, Verdict


@given(st.floats(0.01, 1.0), st.floats(0.0, 10.0))
def test_trying_until_it_works_costs_the_inverse_of_the_probability(probability, cost):
    """A geometric distribution: cost / p, and 1 / p steps."""
    task = retry_task(probability, cost)
    value = evaluate_policy(model_of(task), lambda state: task.skills[0])
    assert value.problem is None
    assert value.cost == pytest.approx(cost / probability)
    assert value.steps == value.duration_s == pytest.approx(1 / probability)


def test_a_chain_that_may_fall_back_costs_what_its_equations_say():
    """Two rungs, and at the second a fall to the ground with probability 1/4.

    x0 = 1 + x1 and x1 = 2 + x0 / 4, so that x0 = 4.
    """
    facts = Facts(("one", "done"))
    skills = [
        make_skill(facts, "first", forbids=("one", "done"), add=("one",)),
        make_skill(
            facts,
            "second",
            requires=("one",),
            outcomes=[(0.75, ("done",), ("one",)), (0.25, (), ("one",))],
            cost=2.0,
            duration_s=5.0,
        ),
    ]
    model = model_of(make_task(facts, skills, goal=("done",)))
    value = evaluate_policy(model, lambda state: skills["one" in state])
    assert value.cost == pytest.approx(4.0)
    # t0 = 1 + t1, t1 = 5 + t0 / 4; n0 = 1 + n1, n1 = 1 + n0 / 4.
    assert value.duration_s == pytest.approx(8.0)
    assert value.steps == pytest.approx(8 / 3)


@given(st.integers(0, 2**32))
def test_the_expected_cost_is_what_a_simulation_comes_to(seed):
    """On random chains, within the error of 3,000 runs."""
    rng = random.Random(seed)
    facts = Facts(("s0", "s1", "s2", "s3", "done"))
    names = [*facts.names]
    skills = {}
    for i in range(4):
        here = names[i]
        targets = [names[rng.randrange(i + 1)], names[i + 1]]
        chance = rng.uniform(0.3, 1.0)
        outcomes = [
            (p, (target,), () if target == here else (here,))
            for p, target in ((chance, targets[1]), (1 - chance, targets[0]))
        ]
        skills[here] = make_skill(
            facts, f"go_{i}", requires=(here,), outcomes=outcomes, cost=rng.uniform(0, 2)
        )
    task = make_task(facts, skills.values(), initial=("s0",), goal=("done",))

    def choose(state):
        return skills[next(iter(state))]

    value = evaluate_policy(model_of(task), choose)
    costs = []
    for _ in range(300):
        state, total = task.initial, 0.0
        while not task.goal.holds(state):
            skill = choose(state)
            total += skill.cost.at(state)
            weights = [outcome.probability for outcome in skill.outcomes]
            state = rng.choices(skill.outcomes, weights)[0].apply(state)
        costs.append(total)
    mean = sum(costs) / len(costs)
    spread = (sum((cost - mean) ** 2 for cost in costs) / len(costs)) ** 0.5
    assert abs(value.cost - mean) <= 6 * spread / len(costs) ** 0.5 + 1e-9


def test_a_policy_that_runs_in_a_circle_never_reaches_the_goal():
    """It has no finite value, and says from where it is stuck."""
    facts = Facts(("a", "done"))
    skills = [
        make_skill(facts, "there", forbids=("a",), add=("a",)),
        make_skill(facts, "back", requires=("a",), delete=("a",)),
        make_skill(facts, "finish", requires=("a",), add=("done",)),
    ]
    model = model_of(make_task(facts, skills, goal=("done",)))
    value = evaluate_policy(model, lambda state: skills["a" in state])
    assert value.cost is None
    assert "never reaches the goal" in value.problem
    assert not value.infeasible


def test_a_policy_that_may_be_trapped_does_not_reach_the_goal_with_certainty():
    """A chance of 1 % is enough."""
    facts = Facts(("trapped", "done"))
    skills = [
        make_skill(facts, "try", outcomes=[(0.99, ("done",), ()), (0.01, ("trapped",), ())]),
        make_skill(facts, "wait", requires=("trapped",)),
    ]
    model = model_of(make_task(facts, skills, goal=("done",)))
    value = evaluate_policy(model, lambda state: skills["trapped" in state])
    assert value.problem == "the policy never reaches the goal from {trapped}"


def test_a_policy_that_says_nothing_in_some_state_has_no_value():
    """The state is named."""
    task = two_roads_task()
    value = evaluate_policy(model_of(task), lambda state: task.skills[0] if not state else None)
    assert value.problem == "the policy says nothing in {a}"
    assert not value.infeasible


@pytest.mark.parametrize(
    ("verdict", "infeasible"),
    [(Verdict.infeasible("blocked"), True), (Verdict.unknown("too slow"), False)],
)
def test_a_policy_with_a_step_that_cannot_be_executed_has_no_value(verdict, infeasible):
    """It matters whether that is known or only not known to be possible."""
    task = retry_task(0.5)
    value = evaluate_policy(model_of(task, fake_back_end(task, verdict)), lambda s: task.skills[0])
    assert (value.cost, value.infeasible) == (None, infeasible)
    assert value.problem == f"try in {{}}: fake: {verdict.reason}"


def test_a_policy_that_reaches_too_many_states_is_refused(monkeypatch):
    """In words."""
    monkeypatch.setattr(policy_value, "MAX_STATES", 2)
    task = two_roads_task()
    names = iter(("to_a", "a_to_b", "finish"))
    with pytest.raises(ModelTooLarge, match="more than 2 states"):
        evaluate_policy(model_of(task), lambda state: task.skill(next(names)))


# The expected cost of a policy from roll-outs, against closed forms.


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
