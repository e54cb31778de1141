"""Where the base may stand: Eqs 1 to 4, and what is done where they leave nothing."""

import itertools
import math
import pickle
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples
from swarm_situations import shortest_way
from thinned import slow_case, thinned
from yaml_data import yaml_data

DATA = yaml_data(Path(__file__).parent / "data" / "polygonal_table3.yaml")
BENCH = swarm.Bench(6, 13, 0.34)
PAPER = swarm.ReachRules(DATA["l_arm_m"], DATA["s_d_m"], (0.333, 0.451), DATA["side"])
# No row of centroids lies in the strip of 5 cm above y = 0.9 m.
NARROW = swarm.ReachRules(0.05, 0.04, (0.333, 0.451), 1)
ARM = swarm.ReachRules(0.451, 0.333, (0.333, 0.451), 1)
SUPPORTS = [tuple(support) for support in DATA["supports_m"]]

points = st.tuples(st.floats(0.0, 2.38), st.floats(0.0, 1.77))
sides = st.sampled_from([1, -1])


def numbers(positions):
    return [position + 1 for position in positions]


def distance_m(position, point):
    return math.dist(BENCH.centroids_m[position], point)


def test_the_polygonal_trajectory_has_the_candidates_of_the_data():
    sets = swarm.goal_sets(BENCH, SUPPORTS, PAPER, True)
    assert [numbers(item.positions) for item in sets] == DATA["candidates"]
    assert {entry.how for entry in sets} == {swarm.How.EQ34}
    assert [element.index for element in sets] == list(range(16))
    assert not any(value.note for value in sets)


def test_the_last_support_is_paired_with_the_first_of_a_closed_trajectory_only():
    closed, opened = (swarm.goal_sets(BENCH, SUPPORTS, PAPER, closed) for closed in (True, False))
    assert closed[:-1] == opened
    assert (closed[-1].e1, closed[-1].e2) == (SUPPORTS[-1], SUPPORTS[0])


@given(points, points, sides)
def test_the_quadrilateral_is_a_rectangle_on_the_side_of_the_bases(e1, e2, side):
    assume(math.dist(e1, e2) > 1e-3)
    a, b, c, d = swarm.quadrilateral(e1, e2, 0.472, side)
    assert tuple(a) == e1
    assert tuple(b) == e2
    assert math.dist(b, c) == pytest.approx(0.472)
    assert np.allclose(c - b, d - a)
    assert np.dot(b - a, d - a) == pytest.approx(0.0, abs=1e-12)
    turn = (b - a)[0] * (d - a)[1] - (b - a)[1] * (d - a)[0]
    assert math.copysign(1, turn) == side


@given(points, points, sides)
def test_candidates_are_the_centroids_inside_the_rectangle_and_not_too_near(e1, e2, side):
    """Against coordinates along and across the way instead of sums of areas."""
    length_m = math.dist(e1, e2)
    assume(length_m > 0.02)
    rules = swarm.ReachRules(0.472, 0.286, (0.333, 0.451), side)
    ux, uy = (e2[0] - e1[0]) / length_m, (e2[1] - e1[1]) / length_m
    results, unclear = [], set()
    for position, (x_m, y_m) in enumerate(BENCH.centroids_m):
        along = (x_m - e1[0]) * ux + (y_m - e1[1]) * uy
        across = side * ((y_m - e1[1]) * ux - (x_m - e1[0]) * uy)
        margins = (
            along,
            length_m - along,
            across,
            0.472 - across,
            distance_m(position, e1) - 0.286,
            distance_m(position, e2) - 0.286,
        )
        if min(margins) >= 0:
            results.append(position)
        if abs(min(margins)) < 1e-7:
            unclear.add(position)
    assert set(swarm.candidates(BENCH, e1, e2, rules)) ^ set(results) <= unclear


def test_a_centroid_on_the_border_counts_as_inside():
    centroid = tuple(BENCH.centroids_m[40].tolist())
    e1, e2 = (centroid[0] - 0.3, centroid[1] - 0.45), (centroid[0] + 0.3, centroid[1] - 0.45)
    assert 40 in swarm.candidates(BENCH, e1, e2, swarm.ReachRules(0.45, 0.3, (0.3, 0.5), 1))
    assert 40 not in swarm.candidates(BENCH, e1, e2, swarm.ReachRules(0.4499, 0.3, (0.3, 0.5), 1))


def test_no_direction_leads_from_a_point_to_itself():
    with pytest.raises(ValueError, match="No direction leads"):
        swarm.quadrilateral((0.1, 0.2), (0.1, 0.2), 0.4, 1)


def test_the_inside_of_a_clockwise_trajectory_is_to_the_right():
    assert (swarm.inward_side(True), swarm.inward_side(False)) == (-1, 1)


@given(points, points, sides)
def test_relaxed_positions_are_within_the_true_reach_of_both_supports(e1, e2, side):
    rules = swarm.ReachRules(0.451, 0.333, (0.333, 0.451), side)
    positions = swarm.within_reach(BENCH, e1, e2, rules)
    everywhere = [
        position
        for position in range(BENCH.n_positions)
        if all(0.333 <= distance_m(position, point) <= 0.451 for point in (e1, e2))
    ]
    across = [
        side
        * (
            (e2[0] - e1[0]) * (BENCH.centroids_m[p][1] - e1[1])
            - (e2[1] - e1[1]) * (BENCH.centroids_m[p][0] - e1[0])
        )
        for p in everywhere
    ]
    preferred = [p for p, height in zip(everywhere, across, strict=True) if height >= 0]
    assert list(positions) == (preferred or everywhere)


def test_where_the_equations_leave_nothing_the_arms_reach_decides_and_says_so():
    e1, e2 = (1.0, 0.9), (1.1, 0.9)
    assert swarm.candidates(BENCH, e1, e2, NARROW) == ()
    (goal_set,) = swarm.goal_sets(BENCH, [e1, e2], NARROW, False)
    assert goal_set.how is swarm.How.RELAXED
    assert "Eqs 3 and 4 leave no position" in goal_set.note
    assert goal_set.positions == swarm.within_reach(BENCH, e1, e2, NARROW)


def test_a_way_too_long_for_the_arm_is_split_and_says_so():
    sets = swarm.goal_sets(BENCH, [(0.4, 0.9), (2.0, 0.9)], NARROW, False)
    assert len(sets) > 1
    assert {item.how for item in sets} == {swarm.How.SPLIT}
    assert {entry.index for entry in sets} == {0}
    assert all("of the way between supports 1 and 2" in element.note for element in sets)
    assert sets[0].e1 == (0.4, 0.9)
    assert sets[-1].e2 == (2.0, 0.9)
    assert all(a.e2 == b.e1 for a, b in itertools.pairwise(sets))


def test_a_split_follows_the_trajectory():
    def detour(index: int, share: float) -> tuple[float, float]:
        return (0.4 + 1.6 * share, 0.9 + 0.3 * math.sin(math.pi * share))

    sets = swarm.goal_sets(BENCH, [(0.4, 0.9), (2.0, 0.9)], NARROW, False, detour)
    assert any(item.e2 == pytest.approx((1.2, 1.2)) for item in sets)


def test_a_trajectory_of_one_support_is_served_from_around_it():
    (goal_set,) = swarm.goal_sets(BENCH, [(1.2, 0.9)], ARM, True)
    assert goal_set.how is swarm.How.RELAXED
    assert goal_set.centre == (1.2, 0.9)
    assert all(0.333 <= distance_m(p, (1.2, 0.9)) <= 0.451 for p in goal_set.positions)


@given(st.lists(points, min_size=3, max_size=8, unique=True), st.booleans())
def test_every_pair_is_served_or_named(supports, closed):
    faults = swarm.unreachable(BENCH, supports, ARM, closed)
    pairs = len(supports) - (not closed)
    if faults:
        with pytest.raises(swarm.UnreachableSupport) as caught:
            swarm.goal_sets(BENCH, supports, ARM, closed)
        assert (caught.value.index, str(caught.value)) == (faults[0].index, str(faults[0]))
        return
    sets = swarm.goal_sets(BENCH, supports, ARM, closed)
    assert sorted({entry.index for entry in sets}) == list(range(pairs))
    assert all(
        item.positions and bool(item.note) == (item.how is not swarm.How.EQ34) for item in sets
    )
    assert (
        max(sum(element.index == i for element in sets) for i in range(pairs))
        <= 2**swarm.MOST_SPLITS
    )


def test_a_support_off_the_bench_is_named_with_the_nearest_position():
    supports = [(1.0, 0.9), (1.2, 0.9), (9.0, 0.9)]
    (fault,) = swarm.unreachable(BENCH, supports, NARROW, False)
    assert fault.index == 1
    assert "Between supports 2 and 3 no position" in str(fault)
    assert "reaches (9, 0.9) m: C39 comes nearest" in str(fault)
    assert "the arm needs 0.333 to 0.451 m" in str(fault)
    again = pickle.loads(pickle.dumps(fault))
    assert (again.index, str(again)) == (fault.index, str(fault))


def test_supports_that_are_reached_one_by_one_but_not_together_are_named():
    e1, e2 = (0.6, 0.9), (1.8, 0.9)

    def jump(index: int, share: float) -> tuple[float, float]:
        return e2

    (fault,) = swarm.unreachable(BENCH, [e1, e2], NARROW, False, jump)
    assert "reaches both (0.6, 0.9) m and (1.8, 0.9) m" in str(fault)
    assert "Move the trajectory" in str(fault)


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ((0.0, 0.2, (0.3, 0.4), 1), "arm_length_m must be finite and > 0"),
        ((0.4, -0.1, (0.3, 0.4), 1), "safe_distance_m must be finite and >= 0"),
        ((0.4, 0.2, (0.4, 0.4), 1), "reach_m must be finite and rise"),
        ((0.4, 0.2, (0.3, 0.4), 0), "side must be 1 or -1"),
    ],
)
def test_rules_out_of_range_are_refused(figures, message):
    with pytest.raises(ValueError, match=message):
        swarm.ReachRules(*figures)


def test_a_goal_set_is_never_empty():
    with pytest.raises(ValueError, match="at least one position"):
        swarm.GoalSet(0, (0.0, 0.0), (1.0, 0.0), (), swarm.How.EQ34, "", (0.5, 0.2))


# Which positions the base goes to.


TIMINGS = swarm.Timings()
SWING_S = TIMINGS.swing_s
HOME = BENCH.position("C66")
position_sets = st.lists(
    st.lists(st.integers(0, 77), min_size=1, max_size=4, unique=True), min_size=1, max_size=5
)


def made(sets, centre=(1.2, 0.9)):
    return [
        swarm.GoalSet(i, (0.0, 0.0), (1.0, 0.0), tuple(sorted(item)), swarm.How.EQ34, "", centre)
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


@pytest.mark.parametrize("rule", list(swarm.GoalRule))
def test_the_polygonal_trajectory_has_the_goals_of_the_data_by_every_rule(rule):
    rules = swarm.ReachRules(DATA["l_arm_m"], DATA["s_d_m"], (0.333, 0.451), DATA["side"])
    supports = [tuple(support) for support in DATA["supports_m"]]
    sets = swarm.goal_sets(BENCH, supports, rules, True)
    choice = swarm.choose(BENCH, HOME, sets, rule, SWING_S)
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
    choice = swarm.choose(BENCH, HOME, made(sets), swarm.GoalRule.WHOLE_TRAJECTORY, SWING_S)
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
    best, *others = (swarm.choose(BENCH, HOME, sets, rule, SWING_S) for rule in swarm.GoalRule)
    for other in others:
        assert (best.total_steps, best.duration_s) <= (other.total_steps, other.duration_s)


@pytest.mark.slow(reason="many trajectories; the rule against trying everything in every run")
def test_greed_does_not_pay_in_general():
    totals = {
        rule: sum(
            swarm.choose(BENCH, HOME, random_sets(seed), rule, SWING_S).total_steps
            for seed in range(examples(40))
        )
        for rule in swarm.GoalRule
    }
    assert totals[swarm.GoalRule.WHOLE_TRAJECTORY] < totals[swarm.GoalRule.FEWEST_STEPS]
    assert totals[swarm.GoalRule.WHOLE_TRAJECTORY] < totals[swarm.GoalRule.NEAREST_CENTROID]


@given(position_sets)
def test_the_greedy_rule_takes_the_next_goal_of_fewest_swings(sets):
    choice = swarm.choose(BENCH, HOME, made(sets), "fewest-steps", SWING_S)
    here = HOME
    for goal, item in zip(choice.goals, sets, strict=True):
        swings = {position: int(BENCH.distances(position)[here]) for position in item}
        assert swings[goal] == min(swings.values())
        here = goal


@given(position_sets)
def test_the_nearest_rule_takes_the_next_goal_as_the_crow_flies(sets):
    choice = swarm.choose(BENCH, HOME, made(sets), "nearest-centroid", SWING_S)
    here = HOME
    for goal, item in zip(choice.goals, sets, strict=True):
        away_m = [math.dist(BENCH.centroids_m[here], BENCH.centroids_m[p]) for p in item]
        assert math.dist(BENCH.centroids_m[here], BENCH.centroids_m[goal]) <= min(away_m) + 1e-9
        here = goal


@pytest.mark.parametrize("rule", list(swarm.GoalRule))
def test_of_goals_equal_in_swings_and_time_the_one_nearer_to_the_centre_is_taken(rule):
    here = 40
    mirrored = [here - 1, here + 1]
    for target in mirrored:
        sets = made([mirrored], centre=tuple(BENCH.centroids_m[target].tolist()))
        assert swarm.choose(BENCH, here, sets, rule, SWING_S).goals == (target,)


@pytest.mark.parametrize("actions", [11, slow_case(13, reason="11 in every run")])
def test_least_swings_are_those_of_the_shortest_ways(actions):
    bench = swarm.Bench(4, 7, 0.34, actions)
    least_swings = swarm.LeastSwings(bench, SWING_S)
    for goal in range(bench.n_positions):
        steps, times_us = least_swings.to(goal)
        for start in range(bench.n_positions):
            way = shortest_way(bench, start, goal)
            time_s = sum(TIMINGS.of_swing(int(bench.swing_deg[p, a])) for a, p, _ in way)
            assert (steps[start], times_us[start] / 1e6) == (len(way), pytest.approx(time_s))


def test_a_bench_of_one_position_needs_no_swing():
    bench = swarm.Bench(1, 1, 0.34)
    choice = swarm.choose(bench, 0, made([[0], [0]]), "whole-trajectory", {})
    assert (choice.goals, choice.total_steps, choice.duration_s) == ((0, 0), 0, 0.0)


def test_nothing_to_serve_is_nothing_to_choose():
    assert swarm.choose(BENCH, HOME, [], "whole-trajectory", SWING_S).goals == ()


def test_an_unknown_rule_or_a_swing_without_time_is_refused():
    with pytest.raises(ValueError, match="'farthest' is not a valid GoalRule"):
        swarm.choose(BENCH, HOME, made([[0]]), "farthest", SWING_S)
    with pytest.raises(ValueError, match="No time is given for a swing of 120 degrees"):
        swarm.choose(BENCH, HOME, made([[0]]), "fewest-steps", {60: 7.47})
