"""Motions in via points."""

import math

import pytest

from skillplan.task import Event, Facts, Motion, Pose, Route, Visit

FACTS = Facts(("tool(a)", "tool(b)", "hand_free"))
HERE = Visit(Pose((0.1, 0.2, 0.3)), Event.LOAD, "a")
THERE = Visit(Pose((0.4, 0.5, 0.6)), Event.LOAD, "b")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_visit_is_at_a_finite_place(value):
    """Every coordinate is checked."""
    for axis in range(3):
        position = [0.0, 0.0, 0.0]
        position[axis] = value
        with pytest.raises(ValueError, match="must be finite"):
            Visit(Pose(tuple(position)), Event.GRASP, "part")


@pytest.mark.parametrize("routes", [(), (Route(FACTS.none, (HERE,)), Route(FACTS.none, ()))])
def test_a_motion_goes_somewhere(routes):
    """No motion is without routes, no route without visits."""
    with pytest.raises(ValueError, match="at least one visit"):
        Motion("arm", routes)


def test_the_first_route_that_fits_counts():
    """Later ones are for other states; where none fits that is said."""
    motion = Motion(
        "arm", (Route(FACTS.of("tool(a)"), (THERE,)), Route(FACTS.of("hand_free"), (HERE,)))
    )
    assert motion.visits(FACTS.of("tool(a)", "hand_free")) == (THERE,)
    assert motion.visits(FACTS.of("hand_free")) == (HERE,)
    with pytest.raises(ValueError, match=r"No route of 'arm' fits the state \{tool\(b\)\}"):
        motion.visits(FACTS.of("tool(b)"))
