"""Placing the heads of a segment, as a task."""

import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples
from skillplan.model import TabularMDP
from skillplan.pipeline import make_model, solve

RULES = swarm.HeadRules()
lengths = st.floats(0.02, 0.9)
angles = st.floats(0.5, 2.6)
gaps = st.sampled_from([0.03, 0.06, 0.1, 0.2, 0.4])


def situation(length_m, start_rad=math.pi / 2, end_rad=2.0):
    """Return a segment between two others that leave it at the given angles, and its heads."""
    before = (0.3 * math.cos(start_rad), 0.3 * math.sin(start_rad))
    back = math.pi + end_rad
    after = (length_m + 0.3 * math.cos(back), 0.3 * math.sin(back))
    workpiece = swarm.Workpiece.from_elements(
        before,
        [swarm.Line((0.0, 0.0)), swarm.Line((length_m, 0.0)), swarm.Line(after)],
        closed=False,
        chord_tolerance_m=1e-3,
    )
    heads = swarm.vertex_heads(workpiece, RULES)
    return workpiece.segments[1], heads[1], heads[2]


def arc_situation():
    workpiece = swarm.Workpiece.from_elements(
        (0.0, 0.0),
        [swarm.Arc(end=(1.0, 0.0), through=(0.5, 0.5))],
        closed=False,
        chord_tolerance_m=1e-3,
    )
    return workpiece.segments[0], *swarm.vertex_heads(workpiece, RULES)


def reach_m(yaw_rad, direction):
    """Return how far a head extends from its centre in a direction, by trigonometry."""
    off = math.remainder(direction - yaw_rad - math.pi / 3, 2 * math.pi / 3)
    return RULES.inradius_m / math.cos(off)


def cheapest(segment, first, last, rules):
    """Return the least cost by relaxing every pair of heads until nothing changes."""
    cells = max(1, math.ceil(segment.length_m / rules.step_m - 1e-9))
    grid = [segment.length_m * k / cells for k in range(1, cells)]
    tried = [2 * math.pi / 3 * o / rules.orientations for o in range(rules.orientations)]
    yaws = [*tried, first.yaw_rad, last.yaw_rad]
    nodes = [(0.0, first), *((d, y) for d in grid for y in yaws), (segment.length_m, last)]

    def yaw(node):
        return node[1] if isinstance(node[1], float) else node[1].yaw_rad

    def head(node):
        point = segment.point_at(node[0])
        return type(first)(point, yaw(node) % (2 * math.pi / 3), first.kind, 0, node[0])

    cost = [0.0] + [math.inf] * (len(nodes) - 1)
    for (i, left), (j, other) in itertools.combinations(enumerate(nodes), 2):
        if other[0] <= left[0] or cost[i] == math.inf:
            continue
        bare_m = other[0] - reach_m(yaw(other), math.pi) - left[0] - reach_m(yaw(left), 0.0)
        if bare_m > rules.max_gap_m + 1e-9:
            continue
        ends = i == 0 and j == len(nodes) - 1
        if not ends and swarm.overlap(head(left), head(other), rules):
            continue
        turned = 0.0 if swarm.same_yaw(yaw(left), yaw(other)) else rules.reorientation_cost
        cost[j] = min(cost[j], cost[i] + turned + (j != len(nodes) - 1))
    return cost[-1]


@settings(max_examples=examples(40))
@given(lengths, angles, angles, gaps, st.integers(1, 3), st.sampled_from([0.0, 0.1, 0.7]))
def test_exact_search_and_the_dynamic_program_agree_with_trying_every_pair(
    length_m, start, end, gap_m, headings, turn
):
    segment, first, last = situation(length_m, start, end)
    rules = swarm.HeadRules(
        max_gap_m=gap_m, step_m=0.04, orientations=headings, reorientation_cost=turn
    )
    best = cheapest(segment, first, last, rules)
    if best == math.inf:
        assert swarm.segment_fault(segment, first, last, rules) is not None
        return
    task = swarm.head_task(segment, first, last, rules, name="heads-1")
    result = solve(task, "exact")
    assert result.status == "optimal"
    assert result.cost == pytest.approx(best)
    model = make_model(task)
    state, total = task.initial, 0.0
    for name in swarm.fewest(segment, first, last, rules):
        step = model.transition(state, task.skill(name))
        state, total = step.next_state, total + step.cost
    assert model.is_goal(state)
    assert total == pytest.approx(best)


@settings(max_examples=examples(40))
@given(lengths, angles, angles, gaps)
def test_no_stretch_lies_bare_for_longer_than_the_limit_and_no_heads_overlap(
    length_m, start, end, gap_m
):
    segment, first, last = situation(length_m, start, end)
    rules = swarm.HeadRules(max_gap_m=gap_m)
    if swarm.segment_fault(segment, first, last, rules) is not None:
        return
    plan = swarm.fewest(segment, first, last, rules)
    between = swarm.heads_of(segment, first, last, rules, plan)
    assert len(between) == len(plan) - 1
    for left, other in itertools.pairwise([first, *between, last]):
        if between:
            assert not swarm.overlap(left, other, rules)
    borne = swarm.SupportedStretch(segment, rules)
    stretches = [
        borne.at(0.0, first.yaw_rad),
        *(borne.at(head.distance_m, head.yaw_rad) for head in between),
        borne.at(segment.length_m, last.yaw_rad),
    ]
    for (_, end_m), (begin_m, _) in itertools.pairwise(stretches):
        assert begin_m - end_m <= gap_m + 1e-9


def test_a_curved_segment_is_supported_along_its_arc():
    segment, first, last = arc_situation()
    task = swarm.head_task(segment, first, last, RULES, name="heads-1")
    result = solve(task, "exact")
    between = swarm.heads_of(segment, first, last, RULES, [step.skill for step in result.steps])
    assert result.status == "optimal"
    assert len(between) == 5
    for head in between:
        assert math.dist(head.position, (0.5, 0.0)) == pytest.approx(0.5, abs=2e-3)


def test_a_short_segment_needs_no_head_between_its_vertices():
    segment, first, last = situation(0.1)
    task = swarm.head_task(segment, first, last, RULES, name="heads-1")
    result = solve(task, "exact")
    assert [step.skill for step in result.steps] == ["finish"]
    assert result.cost in (0.0, pytest.approx(RULES.reorientation_cost))


def test_every_state_leads_to_the_goal_so_that_learners_may_start_anywhere():
    segment, first, last = situation(0.8)
    task = swarm.head_task(segment, first, last, RULES, name="heads-1")
    arrays = TabularMDP.from_model(make_model(task))
    assert len(arrays.states) < 300
    assert set(task.starts) <= set(arrays.states)
    solvable = arrays.goal.copy()
    for i in reversed(np.argsort([_distance(task, state) for state in arrays.states])):
        ahead = arrays.successors[arrays.rows[i] : arrays.rows[i + 1]]
        solvable[i] |= solvable[ahead].any()
    assert solvable.all()


def _distance(task, state):
    return max((task.places[fact].position[0] for fact in state if fact in task.places), default=9)


def test_turning_is_avoided_where_it_costs_more():
    segment, first, last = situation(0.7, 1.0, 1.2)

    def turns(weight):
        rules = swarm.HeadRules(reorientation_cost=weight, orientations=4)
        plan = swarm.fewest(segment, first, last, rules)
        heads = [first, *swarm.heads_of(segment, first, last, rules, plan), last]
        return sum(not swarm.same_yaw(a.yaw_rad, b.yaw_rad) for a, b in itertools.pairwise(heads))

    assert turns(0.9) <= turns(0.1) <= turns(0.0)
    assert turns(0.1) == 1


def test_of_equally_many_heads_the_dynamic_program_spreads_them_evenly():
    segment, first, last = situation(0.7)
    plan = swarm.fewest(segment, first, last, RULES)
    distances_m = [h.distance_m for h in swarm.heads_of(segment, first, last, RULES, plan)]
    steps_m = [b - a for a, b in itertools.pairwise([0.0, *distances_m, segment.length_m])]
    assert max(steps_m) - min(steps_m) <= 0.08


def test_a_segment_that_cannot_be_supported_is_refused_with_the_gap_that_could_be():
    segment, first, last = situation(0.5)
    tight = swarm.HeadRules(max_gap_m=0.001, step_m=0.05)
    fault = swarm.segment_fault(segment, first, last, tight)
    assert fault is not None
    assert "segment 2, 0.500 m long, cannot be supported" in fault
    (least_m,) = re.findall(r"leave ([\d.]+) m bare", fault)
    enough = swarm.HeadRules(max_gap_m=float(least_m), step_m=0.05)
    short = swarm.HeadRules(max_gap_m=float(least_m) - 2e-4, step_m=0.05)
    assert swarm.segment_fault(segment, first, last, enough) is None
    assert swarm.segment_fault(segment, first, last, short) is not None
    for refused in (swarm.fewest, lambda *given: swarm.head_task(*given, name="heads-2")):
        with pytest.raises(ValueError, match="cannot be supported"):
            refused(segment, first, last, tight)


def test_a_grid_too_fine_for_a_task_is_refused():
    segment, first, last = situation(0.9)
    fault = swarm.segment_fault(segment, first, last, swarm.HeadRules(step_m=1e-4))
    assert fault is not None
    assert "make step_m longer than 0.0001 m" in fault


def test_a_plan_for_another_segment_is_refused():
    segment, first, last = situation(0.3)
    with pytest.raises(ValueError, match=r"no head for 'support\(99:0\)'"):
        swarm.heads_of(segment, first, last, RULES, ["support(99:0)", "finish"])


def test_a_placement_takes_the_time_it_is_given():
    segment, first, last = situation(0.3)
    task = swarm.head_task(segment, first, last, RULES, name="heads-2", sha256="ab", place_s=2.5)
    assert {skill.duration_s.at(task.initial) for skill in task.skills} == {2.5}
    assert (task.sha256, task.stage, task.kind) == ("ab", "heads", "swarmitfix")
