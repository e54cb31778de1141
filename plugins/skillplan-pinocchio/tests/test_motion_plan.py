"""Which elbow is preferred, and what the links of the arm may meet."""

import numpy as np
import pytest

import skillplan_pinocchio as arm
from skillplan.physics import LinearMotion
from skillplan.task import DOWN, Box, Event, Pose, Visit

ARM = arm.ArmModel()
TIP, ABOVE = (0.5, 0.0, 0.02), (0.5, 0.0, 0.17)


def linear_motion(tip=TIP, above=ABOVE):
    """Return a motion that takes a part."""
    visit = Visit(Pose(tip), Event.GRASP, "part")
    orientation = Pose.of_axes(tip, (1.0, 0.0, 0.0), DOWN).orientation
    paths = (above, tip), (tip, above)
    return LinearMotion(visit, tip, 0.0, orientation, *paths, None, None, "part")


def box(name, size, centre, fact=""):
    """Return an obstacle; always there without a fact."""
    return arm.Obstacle(
        name, fact or None, (arm.ConvexPiece(arm.compute_box_corners(Box(size, centre))),)
    )


def planner(*obstacles, **changes):
    """Return a planner among obstacles."""
    settings = {"tolerance_m": 2e-4, "samples": 40, "check_arm": True, **changes}
    return arm.MotionPlanner(ARM, obstacles, **settings)


def first_path():
    """Return the way of the joints that is nearest to the ready pose."""
    return planner().plan(linear_motion()).elbows[0].strokes.down[0]


MAST = box("mast", (0.02, 0.02, 0.8), (0.25, 0.0, 0.4), "placed(mast)")
WALL = box("wall", (0.04, 1.2, 0.8), (0.25, 0.0, 0.4), "placed(wall)")


def test_where_nothing_is_met_one_elbow_is_enough():
    """The one nearest to the ready pose, over a table."""
    planned = planner(arm.Obstacle(arm.TABLE, None, (arm.make_table(),))).plan(linear_motion())
    assert len(planned.elbows) == 1
    assert planned.elbows[0].meets == ()
    assert np.array_equal(planned.elbows[0].strokes.down[0].nodes, first_path().nodes)


def test_an_elbow_that_is_free_is_preferred_to_the_nearest():
    """Past a mast that the nearest would run into."""
    touch = arm.LinkSweep(ARM, first_path()).touch(MAST, 2e-4, 40)
    assert touch is not None
    assert touch.link in range(2, 8)
    (elbow,) = planner(MAST).plan(linear_motion()).elbows
    assert elbow.meets == ()
    assert not np.allclose(elbow.strokes.down[0].nodes, first_path().nodes)
    assert arm.LinkSweep(ARM, elbow.strokes.down[0]).touch(MAST, 2e-4, 40) is None


@pytest.mark.slow(reason="plans by every elbow; the free one in every run")
def test_where_every_elbow_meets_something_all_are_kept():
    """Those that meet the least first: it depends on the state which of them is free."""
    planned = planner(WALL, MAST).plan(linear_motion())
    counts = [len(elbow.meets) for elbow in planned.elbows]
    assert len(counts) > 3
    assert counts == sorted(counts)
    assert counts[0] >= 1
    assert not any(elbow.blocked for elbow in planned.elbows)


@pytest.mark.slow(reason="plans by every elbow; the free one in every run")
def test_what_is_always_there_comes_last():
    """An elbow that runs into the table helps in no state."""
    planned = planner(WALL, box("rock", (0.02, 0.02, 0.8), (0.25, 0.0, 0.4))).plan(linear_motion())
    blocked = [elbow.blocked for elbow in planned.elbows]
    assert blocked == sorted(blocked)
    assert blocked[-1]
    assert not blocked[0]


def test_touches_come_in_the_order_of_the_motion():
    """The higher obstacle first on the way down."""
    low = box("low", (0.3, 0.3, 0.02), (0.5, 0.0, 0.14), "placed(low)")
    high = box("high", (0.3, 0.3, 0.02), (0.5, 0.0, 0.23), "placed(high)")
    (first, other) = planner(low, high).met(first_path(), frozenset())
    assert (first[0].body, other[0].body) == ("high", "low")
    assert first[1].touch.fraction < other[1].touch.fraction
    assert first[1].touch.penetration_m > 0
    assert planner(low, high).met(first_path(), frozenset({"low", "high"})) == ()


def test_links_are_not_looked_at_if_not_wanted():
    """Then any elbow will do."""
    planned = planner(WALL, check_arm=False).plan(linear_motion())
    assert len(planned.elbows) == 1
    assert planned.elbows[0].meets == ()


def test_what_is_out_of_reach_has_no_elbow():
    """And says where the nearest one ends."""
    planned = planner().plan(linear_motion((0.9, 0.0, 0.0), (0.9, 0.0, 0.15)))
    assert planned.elbows == ()
    assert planned.unreachable is not None
    assert planned.unreachable.distance_m == pytest.approx(0.1, abs=0.02)


def test_a_linear_motion_is_planned_once():
    """The same ways the second time."""
    here = planner()
    assert here.plan(linear_motion()).elbows is here.plan(linear_motion()).elbows
