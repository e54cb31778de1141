"""Costs that depend on the state."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import assembly, crowded_assemblies, imagined_state
from skillplan.task import (
    ConstantCost,
    Cost,
    DistanceCost,
    Event,
    Facts,
    Motion,
    Pose,
    Route,
    Visit,
    compute_planar_distance,
)

FACTS = Facts(("at(home)", "at(bin)", "tool(a)", "tool(b)", "other"), (("at(home)", "at(bin)"),))
PLACES = {FACTS.bit("at(home)"): (0.0, 0.0, 0.5), FACTS.bit("at(bin)"): (3.0, 4.0, 0.1)}


def visit(x_m, y_m, z_m=0.0, dwell_s=0.0):
    return Visit(Pose((x_m, y_m, z_m)), Event.GRASP, "part", dwell_s=dwell_s)


def motion(*routes):
    return Motion("arm", tuple(Route(FACTS.of(*when), visits) for when, visits in routes))


STRAIGHT = motion(((), (visit(3.0, 0.0, 9.0),)))
BRANCHED = motion(
    (("tool(a)",), (visit(3.0, 0.0), visit(3.0, 4.0))), (("tool(b)",), (visit(0.0, 1.0),))
)


@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf])
def test_a_cost_is_finite_and_not_negative(value):
    """So is everything it is made of."""
    with pytest.raises(ValueError, match="must be finite and >= 0"):
        ConstantCost(value)
    with pytest.raises(ValueError, match="per_m must be finite and >= 0"):
        DistanceCost(PLACES, STRAIGHT, per_m=value)
    with pytest.raises(ValueError, match="dwell_s must be >= 0"):
        visit(3.0, 0.0, dwell_s=value)
    with pytest.raises(ValueError, match="behind_m must be finite and >= 0"):
        DistanceCost(PLACES, STRAIGHT, behind_m={FACTS.bit("at(bin)"): value})


def test_travel_starts_somewhere():
    """A cost without places cannot say from where."""
    with pytest.raises(ValueError, match="at least one place"):
        DistanceCost({}, STRAIGHT)


def test_a_constant_cost_is_the_same_everywhere():
    """Its least value, too; both kinds are costs."""
    cost = ConstantCost(2.5)
    assert cost.at(FACTS.none) == cost.at(FACTS.of("other")) == cost.least(0, 1) == 2.5
    assert isinstance(cost, Cost)
    assert isinstance(DistanceCost(PLACES, STRAIGHT), Cost)


def test_travel_is_planar_from_where_the_arm_stands():
    """Height does not count."""
    cost = DistanceCost(PLACES, STRAIGHT)
    assert cost.at(FACTS.of("at(home)")) == 3.0
    assert cost.at(FACTS.of("at(bin)", "other")) == 4.0
    assert compute_planar_distance((0, 0, 0), (3, 4, 12)) == 5.0


def test_what_was_travelled_to_a_place_uncounted_counts_when_it_is_left():
    """There only; in a time as well, and in the least value."""
    behind_m = {FACTS.bit("at(bin)"): 0.5}
    cost = DistanceCost(PLACES, STRAIGHT, per_m=2.0, behind_m=behind_m)
    assert cost.at(FACTS.of("at(home)")) == 6.0
    assert cost.at(FACTS.of("at(bin)")) == 9.0
    assert cost.least(FACTS.bit("at(bin)"), 0) == 9.0
    assert cost.least(0, FACTS.bit("at(home)")) == 9.0
    assert cost.least(0, 0) == 6.0


def test_travel_runs_through_all_visits_of_the_route_that_fits():
    """The way beyond the first visit counts as well."""
    cost = DistanceCost(PLACES, BRANCHED)
    assert cost.at(FACTS.of("at(home)", "tool(a)")) == 3.0 + 4.0
    assert cost.at(FACTS.of("at(home)", "tool(b)")) == 1.0


def test_a_time_is_a_scaled_distance_and_the_dwells_of_the_route_that_fits():
    """At 0.25 m/s, 3 m take 12 s; the hand acts for 8 s at one target and 5 s at another."""
    routes = (
        (("tool(a)",), (visit(3.0, 0.0, dwell_s=8.0), visit(3.0, 4.0, dwell_s=5.0))),
        (("tool(b)",), (visit(0.0, 1.0, dwell_s=0.5),)),
    )
    cost = DistanceCost(PLACES, motion(*routes), per_m=1 / 0.25, dwells=True)
    assert cost.at(FACTS.of("at(home)", "tool(a)")) == 12.0 + 16.0 + 8.0 + 5.0
    assert cost.at(FACTS.of("at(home)", "tool(b)")) == 4.0 + 0.5
    assert cost.least(FACTS.bit("at(home)"), FACTS.bit("tool(b)")) == 41.0
    assert cost.least(FACTS.bit("at(home)"), 0) == 4.5
    assert DistanceCost(PLACES, motion(*routes)).at(FACTS.of("at(home)", "tool(a)")) == 7.0


def test_a_state_that_does_not_say_where_the_arm_stands_has_no_cost():
    """Nor one that no route fits."""
    with pytest.raises(ValueError, match="gives no place of the arm"):
        DistanceCost(PLACES, STRAIGHT).at(FACTS.of("other"))
    with pytest.raises(ValueError, match="No route of 'arm'"):
        DistanceCost(PLACES, BRANCHED).at(FACTS.of("at(home)"))


def test_the_least_cost_is_infinite_where_nothing_is_left_open():
    """No route, or no place."""
    cost = DistanceCost(PLACES, BRANCHED)
    assert cost.least(0, FACTS.of("tool(a)", "tool(b)").bits) == math.inf
    assert cost.least(0, FACTS.of("at(home)", "at(bin)").bits) == math.inf


@given(crowded_assemblies(), st.integers(0, 2**32))
def test_the_least_cost_bounds_the_cost_in_every_state_that_fits_what_is_known(content, seed):
    """Whatever is known of a state, its cost is no lower; with all known it is the cost."""
    task, rng = assembly(content), random.Random(seed)
    for skill in task.skills:
        state = imagined_state(task, skill, rng)
        if state is None:
            continue
        for cost in (skill.cost, skill.duration_s):
            for _ in range(4):
                mask = rng.getrandbits(len(task.facts))
                true_bits, false_bits = state.bits & mask, state.complement().bits & mask
                assert cost.least(true_bits, false_bits) <= cost.at(state) + 1e-12
            all_known = cost.least(state.bits, state.complement().bits)
            assert all_known == pytest.approx(cost.at(state), abs=1e-12)
