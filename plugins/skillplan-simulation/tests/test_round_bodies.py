"""The spin of bodies of revolution is no tilt."""

from __future__ import annotations

import math

import pytest

from skillplan.task import Body, Box, Cylinder, Pose
from skillplan_simulation import undo_spin

HALF_RAD = 0.4
SPUN = Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.sin(HALF_RAD), math.cos(HALF_RAD)))
GOAL = Pose.turned((0.3, 0.1, 0.2), (0.5, 0.0, 0.0))


@pytest.mark.parametrize(
    ("shapes", "is_round"),
    [
        ((Cylinder(0.02, 0.05, (0.0, 0.0, 0.025)),), True),
        (
            (Cylinder(0.02, 0.05, (0.0, 0.0, 0.025)), Box((0.004, 0.03, 0.01), (0.0, 0.0, 0.005))),
            False,
        ),
        ((Box((0.02, 0.02, 0.05), (0.0, 0.0, 0.025)),), False),
    ],
)
def test_only_a_body_of_revolution_may_spin(shapes, is_round):
    """Its tilt stays."""
    body = Body("part", shapes, (), 0.1)
    spun = undo_spin(body, GOAL.then(SPUN), GOAL)
    assert (spun.orientation == pytest.approx(GOAL.orientation, abs=1e-9)) is is_round
    tilted = Pose.turned((0.3, 0.1, 0.2), (0.6, 0.0, 0.0))
    kept = undo_spin(body, tilted, GOAL).orientation
    assert kept == pytest.approx(tilted.orientation, abs=1e-9)
