"""Walking a sequence through a model."""

import pytest

from situations import fake_back_end, model_of, two_roads_task
from skillplan.model import replay
from skillplan.pipeline import Setup, make_model
from skillplan.task import RewardScheme, Verdict


def walk(task, text, *back_ends):
    return replay(model_of(task, *back_ends), task.parse_sequence(text))


def test_a_sound_sequence_has_no_violation():
    """Its steps, its cost and its time add up."""
    walked = walk(two_roads_task(), "to_b,finish")
    assert (walked.feasible, walked.complete, walked.violations) == (True, True, ())
    assert [step.skill for step in walked.steps] == ["to_b", "finish"]
    assert [step.index for step in walked.steps] == [0, 1]
    assert (walked.cost, walked.duration_s) == (4.0, 2.0)
    assert walked.total_reward is None


def test_a_missing_precondition_is_named_at_its_step():
    """And nothing is executed beyond it."""
    walked = walk(two_roads_task(), "to_a,finish,a_to_b")
    (violation,) = walked.violations
    assert (violation.step, violation.skill, violation.stage) == (1, "finish", "precondition")
    assert (violation.reason, violation.facts) == ("needs b", ("not b",))
    assert [step.skill for step in walked.steps] == ["to_a"]
    assert (walked.feasible, walked.complete) == (False, False)
    assert str(walked.state) == "{a}"


def test_a_collision_is_named_with_its_detector():
    """And the facts it rests on."""
    task = two_roads_task()

    def answer(skill, state):
        if skill.name == "finish":
            return Verdict.infeasible("hits the wall", task.facts.of("b"), task.facts.none)
        return Verdict.feasible(task.facts.none, task.facts.none)

    (violation,) = walk(task, "to_b,finish", fake_back_end(task, answer)).violations
    assert (violation.stage, violation.reason, violation.facts) == ("fake", "hits the wall", ("b",))


def test_a_verdict_that_is_unknown_is_said_to_be_undecided():
    """Not to be infeasible."""
    task = two_roads_task()
    (violation,) = walk(task, "to_b", fake_back_end(task, Verdict.unknown("too slow"))).violations
    assert violation.reason == "could not be decided: too slow"


def test_a_sequence_over_the_step_limit_ends_there():
    """The skill that is one too many is named."""
    walked = walk(two_roads_task(step_limit=2), "to_a,a_to_b,finish")
    (violation,) = walked.violations
    assert (violation.step, violation.skill, violation.stage) == (2, "finish", "step-limit")
    assert violation.reason == "the sequence has 3 skills, the limit is 2"
    assert len(walked.steps) == 2


def test_a_sequence_that_ends_early_says_what_is_missing():
    """It is feasible, but not complete."""
    walked = walk(two_roads_task(), "to_b")
    (violation,) = walked.violations
    assert (violation.step, violation.skill, violation.stage) == (1, None, "goal")
    assert violation.reason == "the goal is not reached: done"
    assert (walked.feasible, walked.complete) == (True, False)


def test_the_empty_sequence_is_complete_at_the_goal_only():
    """There is nothing to do there."""
    task = two_roads_task()
    assert replay(model_of(task), ()).violations[0].stage == "goal"
    assert replay(model_of(task.replace(initial=task.facts.of("done"))), ()).complete


@pytest.mark.parametrize(
    ("text", "rewards", "penalty", "total"),
    [
        ("to_b,finish", [-0.3, 10.0], 0.0, 9.7),
        ("to_a,finish", [-0.1], -10.0, -10.1),
        ("finish", [], -10.0, -10.0),
        ("to_b", [-0.3], 0.0, -0.3),
    ],
)
def test_rewards_add_up_with_the_penalty_of_what_fails(text, rewards, penalty, total):
    """Also where the first skill fails."""
    task = two_roads_task(reward=RewardScheme(-10.0, 10.0, -0.1, -10.0))
    walked = walk(task, text)
    assert [step.reward for step in walked.steps] == pytest.approx(rewards)
    assert walked.penalty == penalty
    assert walked.total_reward == pytest.approx(total)


def test_steps_say_from_where_to_where_the_arm_goes(board_task):
    """Each starts where the one before ended, at safe height."""
    model = make_model(board_task, Setup(collision=("precedence",)))
    walked = replay(model, board_task.parse_sequence("0,1,13"))
    assert [step.start[:2] for step in walked.steps] == [(0.307, 0.0), (0.345, 0.0), (0.489, 0.0)]
    assert walked.steps[1].goal == (0.489, 0.0, 0.0)
    assert walked.steps[0].cost == pytest.approx(0.345 - 0.307)
    # 3 s at the place and the way at 0.25 m/s.
    assert walked.steps[0].duration_s == pytest.approx(3.0 + 0.038 / 0.25)


@pytest.mark.parametrize(
    ("text", "cost", "deviation"),
    [
        ("0,1,2,3,4,5,8,9,10,11,6,7,13,14,15", 1.86709, 0.0),
        ("0,1,2,3,4,5,8,9,6,7,10,11,13,14,15", 1.86711, 0.0),
        ("0,1,4,5,2,3,8,9,10,11,6,7,13,14,15", 1.880, 0.0070),
        ("0,1,2,3,4,5,6,7,8,9,10,11,13,14,15", 1.885, 0.0096),
        ("0,1,6,7,2,3,8,9,4,5,10,11,13,14,15", 1.939, 0.0386),
    ],
)
def test_the_sequences_of_table_3_cost_what_the_paper_prints(board_task, text, cost, deviation):
    """To the digits printed, with their deviation from the optimum."""
    model = make_model(board_task, Setup(collision=("precedence",)))
    walked = replay(model, board_task.parse_sequence(text))
    assert walked.complete
    digits = 5 if cost in (1.86709, 1.86711) else 3
    assert cost == round(walked.cost, digits)
    assert deviation == round(walked.cost / 1.8670860 - 1, 4)


def test_nothing_is_paid_after_the_goal(board_task):
    """The episode is over: skills after it cost, and neither earn nor lose."""
    model = make_model(board_task)
    optimal = board_task.parse_sequence("0,1,2,3,4,5,8,9,10,11,6,7,13,14,15")
    whole = replay(model, optimal)
    longer = replay(model, (*optimal, *board_task.parse_sequence("12,13")))
    assert whole.total_reward == longer.total_reward
    assert longer.cost > whole.cost
