"""Which positions the base goes to."""

import itertools
import math
import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan_swarmitfix import (
    Bench,
    GoalRule,
    GoalSet,
    How,
    LeastSwings,
    ReachRules,
    Timings,
    choose,
    goal_sets,
)
from swarm_situations import shortest_way
from thinned import slow_case, thinned
from yaml_data import yaml_data

DATA = yaml_data(Path(__file__).parent / "data" / "polygonal_table3.yaml")
BENCH = Bench(6, 13, 0.34)
TIMINGS = Timings()
SWING_S = TIMINGS.swing_s
HOME = BENCH.position("C66")
position_sets = st.lists(
    st.lists(st.integers(0, 77), min_size=1, max_size=4, unique=True), min_size=1, max_size=5
)


def made(sets, centre=(1.2, 0.9)):
    return [
        GoalSet(i, (0.0, 0.0), (1.0, 0.0), tuple(sorted(item)), How.EQ34, "", centre)
        for i, item in enumerate(sets)
    ]


def random_sets(seed, n_sets=12):
    """Return goal sets whose positions are near each other, as those of a trajectory are."""
    rng = random.Random(seed)
    sets = []
    for _ in range(n_sets):
        x_m, y_m = rng.uniform(0.2, 2.2), rng.uniform(0.2, 1.5)
        near = sorted(range(78), key=lambda p: math.dist(BENCH.centroids_m[p], (x_m, y_m)))
        sets.append(near[: rng.randint(2, 7)])
    return made(sets)


@pytest.mark.parametrize("rule", list(GoalRule))
def test_the_polygonal_trajectory_has_the_goals_of_the_data_by_every_rule(rule):
    rules = ReachRules(DATA["l_arm_m"], DATA["s_d_m"], (0.333, 0.451), DATA["side"])
    supports = [tuple(support) for support in DATA["supports_m"]]
    sets = goal_sets(BENCH, supports, rules, True)
    choice = choose(BENCH, HOME, sets, rule, SWING_S)
    assert [goal + 1 for goal in choice.goals] == DATA["goals"]
    assert list(choice.steps) == DATA["target_makespans"]
    assert choice.total_steps == 17
    assert choice.rule is rule


def walk(goals):
    """Return swings and swing time of going from goal to goal, by the ways themselves."""
    ways = [shortest_way(BENCH, a, b) for a, b in itertools.pairwise([HOME, *goals])]
    times = [
        TIMINGS.of_swing(int(BENCH.swing_deg[here, action]))
        for way in ways
        for action, here, _ in way
    ]
    return sum(map(len, ways)), round(sum(times), 6)


@settings(max_examples=examples(25))
@given(position_sets)
def test_the_whole_trajectory_rule_is_as_good_as_trying_everything(sets):
    choice = choose(BENCH, HOME, made(sets), GoalRule.WHOLE_TRAJECTORY, SWING_S)
    swings = {
        (a, b): walk_between(a, b)
        for first, other in itertools.pairwise([[HOME], *sets])
        for a in first
        for b in other
    }
    best = min(
        tuple(
            sum(column)
            for column in zip(
                *(swings[pair] for pair in itertools.pairwise([HOME, *goals])), strict=True
            )
        )
        for goals in itertools.product(*sets)
    )
    assert (choice.total_steps, pytest.approx(choice.duration_s)) == (best[0], best[1])
    assert walk(choice.goals) == (best[0], pytest.approx(best[1]))


def walk_between(start, goal):
    way = shortest_way(BENCH, start, goal)
    time_s = sum(TIMINGS.of_swing(int(BENCH.swing_deg[here, action])) for action, here, _ in way)
    return len(way), round(time_s, 6)


@pytest.mark.parametrize("seed", thinned(range(20), *range(5), why="five in every run"))
def test_no_rule_beats_the_whole_trajectory_rule(seed):
    sets = random_sets(seed)
    best, *others = (choose(BENCH, HOME, sets, rule, SWING_S) for rule in GoalRule)
    for other in others:
        assert (best.total_steps, best.duration_s) <= (other.total_steps, other.duration_s)


@pytest.mark.slow(reason="many trajectories; the rule against trying everything in every run")
def test_greed_does_not_pay_in_general():
    totals = {
        rule: sum(
            choose(BENCH, HOME, random_sets(seed), rule, SWING_S).total_steps
            for seed in range(examples(40))
        )
        for rule in GoalRule
    }
    assert totals[GoalRule.WHOLE_TRAJECTORY] < totals[GoalRule.FEWEST_STEPS]
    assert totals[GoalRule.WHOLE_TRAJECTORY] < totals[GoalRule.NEAREST_CENTROID]


@given(position_sets)
def test_the_greedy_rule_takes_the_next_goal_of_fewest_swings(sets):
    choice = choose(BENCH, HOME, made(sets), "fewest-steps", SWING_S)
    here = HOME
    for goal, item in zip(choice.goals, sets, strict=True):
        swings = {position: int(BENCH.distances(position)[here]) for position in item}
        assert swings[goal] == min(swings.values())
        here = goal


@given(position_sets)
def test_the_nearest_rule_takes_the_next_goal_as_the_crow_flies(sets):
    choice = choose(BENCH, HOME, made(sets), "nearest-centroid", SWING_S)
    here = HOME
    for goal, item in zip(choice.goals, sets, strict=True):
        away_m = [math.dist(BENCH.centroids_m[here], BENCH.centroids_m[p]) for p in item]
        assert math.dist(BENCH.centroids_m[here], BENCH.centroids_m[goal]) <= min(away_m) + 1e-9
        here = goal


@pytest.mark.parametrize("rule", list(GoalRule))
def test_of_goals_equal_in_swings_and_time_the_one_nearer_to_the_centre_is_taken(rule):
    here = 40
    mirrored = [here - 1, here + 1]
    for target in mirrored:
        sets = made([mirrored], centre=tuple(BENCH.centroids_m[target].tolist()))
        assert choose(BENCH, here, sets, rule, SWING_S).goals == (target,)


@pytest.mark.parametrize("actions", [11, slow_case(13, reason="11 in every run")])
def test_least_swings_are_those_of_the_shortest_ways(actions):
    bench = Bench(4, 7, 0.34, actions)
    least_swings = LeastSwings(bench, SWING_S)
    for goal in range(bench.n_positions):
        steps, times_us = least_swings.to(goal)
        for start in range(bench.n_positions):
            way = shortest_way(bench, start, goal)
            time_s = sum(TIMINGS.of_swing(int(bench.swing_deg[p, a])) for a, p, _ in way)
            assert (steps[start], times_us[start] / 1e6) == (len(way), pytest.approx(time_s))


def test_a_bench_of_one_position_needs_no_swing():
    bench = Bench(1, 1, 0.34)
    choice = choose(bench, 0, made([[0], [0]]), "whole-trajectory", {})
    assert (choice.goals, choice.total_steps, choice.duration_s) == ((0, 0), 0, 0.0)


def test_nothing_to_serve_is_nothing_to_choose():
    assert choose(BENCH, HOME, [], "whole-trajectory", SWING_S).goals == ()


def test_an_unknown_rule_or_a_swing_without_time_is_refused():
    with pytest.raises(ValueError, match="'farthest' is not a valid GoalRule"):
        choose(BENCH, HOME, made([[0]]), "farthest", SWING_S)
    with pytest.raises(ValueError, match="No time is given for a swing of 120 degrees"):
        choose(BENCH, HOME, made([[0]]), "fewest-steps", {60: 7.47})
