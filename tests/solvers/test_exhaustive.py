"""Brute force, and what it counts."""

from collections import Counter

import pytest
from hypothesis import given, settings

import situations
from example_count import examples
from skillplan.collision import PrecedenceDetector
from skillplan.pipeline import Setup, make_model, solve
from skillplan.solvers import ExhaustiveSolver, Stop
from skillplan.task import Facts
from skillplan.testing import SolverSuite

CHART = Setup(collision=("precedence",))
BY_LENGTH = {15: 120, 16: 120, 17: 1080, 18: 1020, 19: 5280, 20: 4800}


class TestExhaustiveSolver(SolverSuite):
    solver = "exhaustive"


def count_by_length(model):
    """Return the number of complete sequences by length, counted over states, not sequences."""
    arrows = situations.graph_of(model)
    layer, results = Counter({model.initial: 1}), {}
    for length in range(model.step_limit + 1):
        done = sum(number for state, number in layer.items() if model.is_goal(state))
        if done:
            results[length] = done
        following = Counter()
        for state, number in layer.items():
            for _, _, target in arrows[state]:
                following[target] += number
        layer = following
    return results


@pytest.fixture(scope="module")
def walked(board_task):
    return solve(board_task, "exhaustive", CHART)


@pytest.mark.slow(reason="walks the board; its counts in the comparison of every run")
def test_the_board_has_as_many_sequences_as_were_computed_independently(walked, board_task):
    """120 of 15 skills, 12,420 of at most 20."""
    assert walked.trace["sequences_by_length"] == BY_LENGTH
    assert walked.trace["sequences"] == 12_420
    assert count_by_length(make_model(board_task, CHART)) == BY_LENGTH


@pytest.mark.slow(reason="walks all sequences; the best in every run")
def test_the_board_has_the_worst_and_best_costs_that_were_computed_independently(walked):
    """The worst of 15 skills costs 2.0586; with screws early the best of 16 costs 1.94921."""
    assert walked.status == "optimal"
    assert round(walked.cost, 5) == 1.86709
    assert round(walked.trace["worst_cost_by_length"][15], 4) == 2.0586
    assert round(walked.trace["best_cost_by_length"][16], 5) == 1.94921


def reloading(**changes):
    content = situations.config_content("inverter_board")
    content["tool_change"]["reload"] = True
    return situations.assembly(content | changes)


def test_reloading_the_tool_at_hand_multiplies_the_sequences():
    """925,020, counted over states."""
    assert sum(count_by_length(make_model(reloading(), CHART)).values()) == 925_020


@pytest.mark.slow(reason="reloads lead nowhere for long; 12,420 without them in every run")
def test_brute_force_counts_the_same_where_reloading_is_allowed():
    """One by one what is counted over states, of the shortest ones."""
    task = reloading(step_limit=15)
    counted = count_by_length(make_model(task, CHART))
    assert sum(counted.values()) >= 120
    solution = ExhaustiveSolver().solve(make_model(task, CHART))
    assert solution.trace["sequences_by_length"] == counted


@settings(max_examples=examples(40))
@given(situations.small_assemblies().filter(lambda content: len(content["parts"]) == 2))
def test_it_agrees_with_dynamic_programs_on_random_assemblies(content):
    """On the optimum, the fewest skills and the number of sequences of every length."""
    task = situations.assembly(content)

    def model():
        return situations.model_of(task, PrecedenceDetector(task))

    solution = ExhaustiveSolver().solve(model())
    expected = situations.optimum(situations.cheapest_by_length(model()))
    assert solution.proved
    assert solution.trace["sequences_by_length"] == count_by_length(model())
    if expected is None:
        assert solution.plan is None
    else:
        assert solution.plan.cost == pytest.approx(expected[0], abs=1e-9)
        assert len(solution.plan) == expected[1]


def test_a_sequence_ends_where_it_reaches_the_goal():
    """It is not continued beyond it, although skills are applicable there."""
    solution = ExhaustiveSolver().solve(
        situations.model_of(situations.two_roads_task(step_limit=9))
    )
    assert solution.trace["sequences_by_length"] == {2: 1, 3: 1}
    assert solution.plan.skills == ("to_a", "a_to_b", "finish")


def test_a_task_that_is_done_has_one_sequence(board_task):
    """The empty one."""
    done = board_task.replace(initial=board_task.initial | board_task.goal.requires)
    solution = ExhaustiveSolver().solve(make_model(done, CHART))
    assert (solution.plan.skills, solution.lower_bound, solution.proved) == ((), 0.0, True)
    assert solution.trace["sequences_by_length"] == {0: 1}


class StopAfter(Stop):
    """Stops at the n-th poll."""

    def __init__(self, polls):
        super().__init__()
        self.polls = polls

    def __call__(self):
        self.polls -= 1
        if self.polls < 0:
            self.interrupt()
        return super().__call__()


@pytest.mark.parametrize("polls", [0, 1, 10, 200, 1_000])
def test_it_can_be_stopped_at_any_time(board_task, polls):
    """What it has found and what it has not yet seen bound the optimum from both sides."""
    solution = ExhaustiveSolver(stop=StopAfter(polls)).solve(make_model(board_task, CHART))
    assert not solution.proved
    assert solution.lower_bound <= 1.86709
    if solution.plan is not None:
        assert solution.plan.cost >= 1.867086


def test_it_refuses_tasks_with_chance_in_words():
    """It counts sequences."""
    assert "one outcome each" in ExhaustiveSolver().refuses(
        situations.model_of(situations.retry_task(0.5))
    )


def test_the_bound_of_a_stopped_walk_covers_the_very_next_skill():
    """A cheap way that is next in line when the walk is stopped."""
    facts = Facts(("done",))
    costs = [5.0] * 255 + [1.0] + [5.0] * 300
    skills = [
        situations.make_skill(facts, f"way_{i}", add=("done",), cost=cost)
        for i, cost in enumerate(costs)
    ]
    task = situations.make_task(facts, skills, goal=("done",))
    solution = ExhaustiveSolver(stop=StopAfter(0)).solve(situations.model_of(task))
    assert solution.trace["visited"] == 256
    assert (solution.plan.cost, solution.lower_bound) == (5.0, 1.0)
