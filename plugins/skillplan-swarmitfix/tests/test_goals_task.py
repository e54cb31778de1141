"""Choosing goals of the base, as a task."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples
from skillplan.pipeline import make_model, solve
from skillplan.task import DistanceReward, Task
from swarm_situations import SWING_S, base_task, grounding

BENCH = swarm.Bench(6, 13, 0.34)
HOME = BENCH.position("C66")


def made(sets):
    return [
        swarm.GoalSet(
            i, (0.0, 0.0), (1.0, 0.0), tuple(sorted(item)), swarm.How.EQ34, "", (0.5, 0.2)
        )
        for i, item in enumerate(sets)
    ]


def random_sets(seed):
    rng = random.Random(seed)
    return made([rng.sample(range(78), rng.randint(1, 6)) for _ in range(rng.randint(1, 9))])


@settings(max_examples=examples(25))
@given(st.integers(0, 10_000))
def test_exact_search_finds_what_the_dynamic_program_finds(seed):
    sets = random_sets(seed)
    choice = swarm.choose(BENCH, HOME, sets, swarm.GoalRule.WHOLE_TRAJECTORY, SWING_S)
    task = swarm.goals_task(BENCH, HOME, sets, SWING_S, choice.goals, name="goals")
    result = solve(task, "exact")
    assert result.status == "optimal"
    assert result.cost == choice.total_steps
    duration_s = sum(step.duration_s for step in result.steps)
    assert duration_s == pytest.approx(choice.duration_s)


@pytest.mark.parametrize("rule", list(swarm.GoalRule))
def test_the_preset_is_the_plan_of_the_choice(rule):
    sets = random_sets(3)
    choice = swarm.choose(BENCH, HOME, sets, rule, SWING_S)
    task = swarm.goals_task(BENCH, HOME, sets, SWING_S, choice.goals, name="goals", sha256="ab")
    assert task.preset is not None
    assert tuple(BENCH.position(swarm.goal_of(name)) for name in task.preset) == choice.goals
    model, state, total = make_model(task), task.initial, 0.0
    for name in task.preset:
        assert task.skill(name).applicable(state)
        step = model.transition(state, task.skill(name))
        state, total = step.next_state, total + step.cost
    assert model.is_goal(state)
    assert total == choice.total_steps
    assert (task.sha256, task.stage, task.metric.unit) == ("ab", "goals", "steps")


def test_a_goal_occupies_the_pins_that_the_base_is_docked_on():
    task = swarm.goals_task(BENCH, HOME, made([[16]]), SWING_S, None, name="goals")
    (skill,) = task.skills
    case = skill.case(task.initial)
    assert case is not None
    assert case.occupies == {BENCH.pin_name(int(pin)) for pin in BENCH.legs[16]}
    assert task.preset is None


def test_sets_are_served_in_their_order_and_once():
    task = swarm.goals_task(BENCH, HOME, made([[16, 17], [16], [30]]), SWING_S, None, name="goals")
    model, state = make_model(task), task.initial
    for number, position in ((1, "C17"), (2, "C17"), (3, "C31")):
        applicable = {skill.name for skill in model.applicable(state)}
        assert {name.partition(":")[0] for name in applicable} == {f"serve({number}"}
        step = model.transition(state, task.skill(swarm.serve(number, position)))
        state = step.next_state
        assert task.places_in(state)[0].name == position
    assert model.is_goal(state)
    assert not model.applicable(state)


def test_a_plan_can_be_given_by_names():
    task = swarm.goals_task(BENCH, HOME, made([[16], [30]]), SWING_S, None, name="goals")
    names = [skill.name for skill in task.parse_sequence("serve(1:C17), serve(2:C31)")]
    assert names == ["serve(1:C17)", "serve(2:C31)"]
    assert swarm.goal_of(names[1]) == "C31"


def test_a_preset_that_is_no_choice_is_refused():
    for goals in ((16,), (16, 16)):
        with pytest.raises(ValueError, match="one position of every goal set"):
            swarm.goals_task(BENCH, HOME, made([[16], [30]]), SWING_S, goals, name="goals")


def test_without_sets_there_is_no_task():
    with pytest.raises(ValueError, match="at least one goal set"):
        swarm.goals_task(BENCH, HOME, [], SWING_S, None, name="goals")


# Walking the base: states, swings, times and rewards of the task, against the bench itself.


positions = st.integers(1, 78)


def standing(task: Task, position: int) -> Task:
    return task.replace(initial=task.facts.of(swarm.at(f"C{position}")))


class TestStatesAndActions:
    def test_a_state_for_every_position_and_one_holds_at_a_time(self):
        task = base_task(66, 42)
        assert [swarm.at(f"C{i}") for i in range(1, 79)] == list(task.facts.names)
        assert (task.facts.names,) == task.facts.exclusive
        assert (task.stage, task.kind) == ("base", "swarmitfix")

    def test_the_actions_are_b0_to_b10(self):
        task = base_task(66, 42)
        assert [f"B{i}" for i in range(11)] == [skill.name for skill in task.skills]
        assert [skill.kind for skill in task.skills] == ["stay"] + ["swing"] * 10

    def test_with_13_actions_there_are_b11_and_b12(self):
        task = swarm.BaseGrounding(swarm.Bench(6, 13, 0.34, 13), SWING_S).task("any", 0, 1)
        assert task.skills[-1].name == "B12"

    @given(position=positions, action=st.integers(0, 10))
    def test_an_action_leads_where_the_bench_says_or_is_not_applicable(self, position, action):
        """Off the bench there is no swing, for the model and for the task alike."""
        task = standing(base_task(66, 42), position)
        skill = task.skills[action]
        end = int(BENCH.successors[position - 1, action])
        assert skill.applicable(task.initial) == (end >= 0)
        if end >= 0:
            (step,) = [
                step
                for step in make_model(task).transitions(task.initial)
                if step.skill is skill or step.skill.name == skill.name
            ]
            assert task.facts.of(swarm.at(f"C{end + 1}")) == step.next_state
            assert step.cost == 1.0

    @given(position=positions, action=st.integers(1, 10))
    def test_a_swing_takes_the_time_of_its_angle_and_keeps_its_pins(self, position, action):
        task = standing(base_task(66, 42), position)
        skill = task.skills[action]
        case = skill.case(task.initial)
        if case is None:
            assert BENCH.successors[position - 1, action] < 0
            return
        angle_deg = int(BENCH.swing_deg[position - 1, action])
        assert SWING_S[angle_deg] == skill.duration_s.at(task.initial)
        pins = BENCH.swept_pins(position - 1, action)
        assert {BENCH.pin_name(pin) for pin in pins} == case.occupies

    def test_staying_takes_no_time_but_counts_as_a_step(self):
        task = base_task(66, 42)
        assert (
            task.skills[0].duration_s.at(task.initial),
            task.skills[0].cost.at(task.initial),
        ) == (0.0, 1.0)

    def test_every_position_may_be_a_start(self):
        """Exploring starts, and policies for all of them."""
        task = base_task(66, 42)
        assert {(swarm.at(f"C{i}"),) for i in range(1, 79)} == {
            tuple(start) for start in task.starts
        }

    def test_places_are_the_centroids(self):
        task = base_task(66, 42)
        for i, (x_m, y_m) in enumerate(BENCH.centroids_m.tolist(), start=1):
            place = task.places[swarm.at(f"C{i}")]
            assert (f"C{i}", pytest.approx((x_m, y_m, 0.0))) == (place.name, place.position)


class TestReward:
    @given(start=positions, goal=positions)
    def test_a_step_is_paid_by_eqs_6_and_7(self, start, goal):
        """Minus the distance of where it begins, and 1 more where it ends at the goal."""
        reward = base_task(start, goal).reward
        assert isinstance(reward, DistanceReward)
        here = grounding().states[start - 1]
        distance_m = math.dist(BENCH.centroids_m[start - 1], BENCH.centroids_m[goal - 1])
        for at_goal in (False, True):
            paid = reward.of_step(here, "B1", 1.0, goal=at_goal, out_of_time=False)
            assert paid == pytest.approx(at_goal - distance_m)

    @given(start=positions, goal=positions)
    def test_leaving_the_bench_is_paid_less_than_any_step(self, start, goal):
        reward = base_task(start, goal).reward
        assert isinstance(reward, DistanceReward)
        assert all(-d > reward.infeasible for d in reward.distances.values())


class TestPlans:
    @settings(max_examples=examples(100))
    @given(start=positions, goal=positions)
    def test_exact_search_takes_as_many_swings_as_the_bench_says(self, start, goal):
        """None at all where the base is there already."""
        result = solve(base_task(start, goal))
        assert result.status == "optimal"
        assert BENCH.distances(goal - 1)[start - 1] == result.cost == result.makespan

    def test_the_step_limit_grows_with_the_bench(self):
        """So that a way round it is never too long; the file may set another."""
        assert base_task(1, 2).step_limit == 100
        assert swarm.BaseGrounding(swarm.Bench(3, 201, 0.34), SWING_S).step_limit == 2 * (3 + 201)
        assert swarm.BaseGrounding(BENCH, SWING_S, 7).task("any", 0, 1).step_limit == 7

    def test_a_bench_of_one_position_is_a_task_that_is_solved(self):
        """Every swing leaves it."""
        task = swarm.BaseGrounding(swarm.Bench(1, 1, 0.34), SWING_S).task("tiny", 0, 0)
        assert [skill.name for skill in task.skills if skill.applicable(task.initial)] == ["B0"]
        result = solve(task)
        assert (result.status, result.cost) == ("optimal", 0.0)
