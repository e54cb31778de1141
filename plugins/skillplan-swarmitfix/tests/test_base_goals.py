"""Where the base may stand: Eqs 1 to 4, and what is done where they leave nothing."""

import itertools
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from skillplan_swarmitfix import (
    MOST_SPLITS,
    Bench,
    GoalSet,
    How,
    ReachRules,
    UnreachableSupport,
    candidates,
    goal_sets,
    inward_side,
    quadrilateral,
    unreachable,
    within_reach,
)
from yaml_data import yaml_data

DATA = yaml_data(Path(__file__).parent / "data" / "polygonal_table3.yaml")
BENCH = Bench(6, 13, 0.34)
PAPER = ReachRules(DATA["l_arm_m"], DATA["s_d_m"], (0.333, 0.451), DATA["side"])
# No row of centroids lies in the strip of 5 cm above y = 0.9 m.
NARROW = ReachRules(0.05, 0.04, (0.333, 0.451), 1)
ARM = ReachRules(0.451, 0.333, (0.333, 0.451), 1)
SUPPORTS = [tuple(support) for support in DATA["supports_m"]]

points = st.tuples(st.floats(0.0, 2.38), st.floats(0.0, 1.77))
sides = st.sampled_from([1, -1])


def numbers(positions):
    return [position + 1 for position in positions]


def distance_m(position, point):
    return math.dist(BENCH.centroids_m[position], point)


def test_the_polygonal_trajectory_has_the_candidates_of_the_data():
    sets = goal_sets(BENCH, SUPPORTS, PAPER, True)
    assert [numbers(item.positions) for item in sets] == DATA["candidates"]
    assert {entry.how for entry in sets} == {How.EQ34}
    assert [element.index for element in sets] == list(range(16))
    assert not any(value.note for value in sets)


def test_the_last_support_is_paired_with_the_first_of_a_closed_trajectory_only():
    closed, opened = (goal_sets(BENCH, SUPPORTS, PAPER, closed) for closed in (True, False))
    assert closed[:-1] == opened
    assert (closed[-1].e1, closed[-1].e2) == (SUPPORTS[-1], SUPPORTS[0])


@given(points, points, sides)
def test_the_quadrilateral_is_a_rectangle_on_the_side_of_the_bases(e1, e2, side):
    assume(math.dist(e1, e2) > 1e-3)
    a, b, c, d = quadrilateral(e1, e2, 0.472, side)
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
    rules = ReachRules(0.472, 0.286, (0.333, 0.451), side)
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
    assert set(candidates(BENCH, e1, e2, rules)) ^ set(results) <= unclear


def test_a_centroid_on_the_border_counts_as_inside():
    centroid = tuple(BENCH.centroids_m[40].tolist())
    e1, e2 = (centroid[0] - 0.3, centroid[1] - 0.45), (centroid[0] + 0.3, centroid[1] - 0.45)
    assert 40 in candidates(BENCH, e1, e2, ReachRules(0.45, 0.3, (0.3, 0.5), 1))
    assert 40 not in candidates(BENCH, e1, e2, ReachRules(0.4499, 0.3, (0.3, 0.5), 1))


def test_no_direction_leads_from_a_point_to_itself():
    with pytest.raises(ValueError, match="No direction leads"):
        quadrilateral((0.1, 0.2), (0.1, 0.2), 0.4, 1)


def test_the_inside_of_a_clockwise_trajectory_is_to_the_right():
    assert (inward_side(True), inward_side(False)) == (-1, 1)


@given(points, points, sides)
def test_relaxed_positions_are_within_the_true_reach_of_both_supports(e1, e2, side):
    rules = ReachRules(0.451, 0.333, (0.333, 0.451), side)
    positions = within_reach(BENCH, e1, e2, rules)
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
    assert candidates(BENCH, e1, e2, NARROW) == ()
    (goal_set,) = goal_sets(BENCH, [e1, e2], NARROW, False)
    assert goal_set.how is How.RELAXED
    assert "Eqs 3 and 4 leave no position" in goal_set.note
    assert goal_set.positions == within_reach(BENCH, e1, e2, NARROW)


def test_a_way_too_long_for_the_arm_is_split_and_says_so():
    sets = goal_sets(BENCH, [(0.4, 0.9), (2.0, 0.9)], NARROW, False)
    assert len(sets) > 1
    assert {item.how for item in sets} == {How.SPLIT}
    assert {entry.index for entry in sets} == {0}
    assert all("of the way between supports 1 and 2" in element.note for element in sets)
    assert sets[0].e1 == (0.4, 0.9)
    assert sets[-1].e2 == (2.0, 0.9)
    assert all(a.e2 == b.e1 for a, b in itertools.pairwise(sets))


def test_a_split_follows_the_trajectory():
    def detour(index: int, share: float) -> tuple[float, float]:
        return (0.4 + 1.6 * share, 0.9 + 0.3 * math.sin(math.pi * share))

    sets = goal_sets(BENCH, [(0.4, 0.9), (2.0, 0.9)], NARROW, False, detour)
    assert any(item.e2 == pytest.approx((1.2, 1.2)) for item in sets)


def test_a_trajectory_of_one_support_is_served_from_around_it():
    (goal_set,) = goal_sets(BENCH, [(1.2, 0.9)], ARM, True)
    assert goal_set.how is How.RELAXED
    assert goal_set.centre == (1.2, 0.9)
    assert all(0.333 <= distance_m(p, (1.2, 0.9)) <= 0.451 for p in goal_set.positions)


@given(st.lists(points, min_size=3, max_size=8, unique=True), st.booleans())
def test_every_pair_is_served_or_named(supports, closed):
    faults = unreachable(BENCH, supports, ARM, closed)
    pairs = len(supports) - (not closed)
    if faults:
        with pytest.raises(UnreachableSupport) as caught:
            goal_sets(BENCH, supports, ARM, closed)
        assert (caught.value.index, str(caught.value)) == (faults[0].index, str(faults[0]))
        return
    sets = goal_sets(BENCH, supports, ARM, closed)
    assert sorted({entry.index for entry in sets}) == list(range(pairs))
    assert all(item.positions and bool(item.note) == (item.how is not How.EQ34) for item in sets)
    assert max(sum(element.index == i for element in sets) for i in range(pairs)) <= 2**MOST_SPLITS


def test_a_support_off_the_bench_is_named_with_the_nearest_position():
    supports = [(1.0, 0.9), (1.2, 0.9), (9.0, 0.9)]
    (fault,) = unreachable(BENCH, supports, NARROW, False)
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

    (fault,) = unreachable(BENCH, [e1, e2], NARROW, False, jump)
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
        ReachRules(*figures)


def test_a_goal_set_is_never_empty():
    with pytest.raises(ValueError, match="at least one position"):
        GoalSet(0, (0.0, 0.0), (1.0, 0.0), (), How.EQ34, "", (0.5, 0.2))
