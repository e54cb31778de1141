"""Convex pieces on a straight way: nothing is missed, and it is said where it touches first."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import skillplan_pinocchio as arm
from skillplan.collision import WorldBox, sweep_hits
from skillplan.task import Body, Box, Cylinder, Mesh, Placement, Pose, Scene

LENGTHS = st.floats(0.005, 0.2)
PLACES = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
NONE = frozenset()
# Triangles of a prism on a triangle: three corners, then three opposite.
PRISM = ((0, 1, 2), (3, 5, 4), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (2, 5, 3), (2, 3, 0))


def piece(size, centre):
    """Return a box."""
    return arm.ConvexPiece(arm.compute_box_corners(Box(size, centre)))


def wall(size, centre):
    """Return a box in the way."""
    return arm.Obstacle("wall", "placed(wall)", (piece(size, centre),))


@given(st.tuples(LENGTHS, LENGTHS, LENGTHS), PLACES, PLACES, st.tuples(LENGTHS, LENGTHS, LENGTHS))
def test_boxes_hit_as_the_slab_method_says(size, start, by, other):
    """The exact answer for upright boxes, whatever their ways."""
    sweep = arm.Sweep("", "it", (piece(size, start),), by, NONE)
    low = tuple(c - s / 2 for c, s in zip(start, size, strict=True))
    high = tuple(c + s / 2 for c, s in zip(start, size, strict=True))
    obstacle = WorldBox(tuple(-s / 2 for s in other), tuple(s / 2 for s in other))

    def expected(tolerance_m):
        return sweep_hits(WorldBox(low, high), by, obstacle, tolerance_m)

    touch = sweep.touch(wall(other, (0.0, 0.0, 0.0)), 2e-4, 20)
    if expected(2.1e-4):
        assert touch is not None
    if not expected(0.0):
        assert touch is None


def test_a_thin_wall_between_two_samples_is_not_missed():
    """A leaf of 0.5 mm on a way of 0.4 m, looked at in five places."""
    sweep = arm.Sweep("", "it", (piece((0.01, 0.01, 0.01), (0.0, 0.0, 0.4)),), (0, 0, -0.4), NONE)
    touch = sweep.touch(wall((0.1, 0.1, 0.0005), (0.0, 0.0, 0.13)), 2e-4, 4)
    assert touch is not None
    assert touch.penetration_m > 2e-4
    # At 0.75 of the way it is 30 mm below the leaf, at 0.5 of it 70 mm above.
    assert touch.fraction == 0.75


@pytest.mark.parametrize(("overlap_m", "hits"), [(-0.001, False), (0.0001, False), (0.0003, True)])
def test_what_only_touches_is_no_collision(overlap_m, hits):
    """Sliding along a wall, up to the tolerance of 0.2 mm."""
    sweep = arm.Sweep("", "it", (piece((0.02, 0.02, 0.02), (0.0, 0.0, 0.2)),), (0, 0, -0.19), NONE)
    touch = sweep.touch(wall((0.02, 0.02, 0.1), (0.02 - overlap_m, 0.0, 0.05)), 2e-4, 40)
    assert (touch is not None) is hits
    if touch is not None:
        assert touch.penetration_m == pytest.approx(overlap_m, abs=1e-6)


def test_what_ends_just_below_the_underside_of_a_mesh_is_as_deep_as_its_way_out():
    """A block through a roof of 5 mm, whose least triangle it passes by 0.1 mm only."""
    corners = arm.compute_box_corners(Box((0.06, 0.06, 0.005), (0.0, 0.0, 0.0025)))
    triangles = arm.ConvexPiece(corners).surface
    roof = arm.Obstacle("roof", "placed(roof)", (arm.SurfacePiece(*triangles),))
    block = piece((0.03, 0.03, 0.03), (0.03, 0.0, 0.0149))
    touch = arm.Sweep("", "it", (block,), (0.0, 0.0, 0.0), NONE).touch(roof, 2e-4, 4)
    assert touch is not None
    assert touch.penetration_m == pytest.approx(0.0051, abs=2e-4)
    # Turns and fits measure the same.
    assert arm.measure_distance(block, *roof.pieces).distance_m == pytest.approx(
        -touch.penetration_m
    )


def test_the_first_touch_is_said():
    """Half-way down, at the top of the wall."""
    sweep = arm.Sweep("", "it", (piece((0.02, 0.02, 0.02), (0.0, 0.0, 0.21)),), (0, 0, -0.2), NONE)
    touch = sweep.touch(wall((0.1, 0.1, 0.1), (0.0, 0.0, 0.05)), 2e-4, 100)
    assert touch.fraction == pytest.approx(0.51)
    assert touch.position[2] == pytest.approx(0.1, abs=0.002)


def test_cylinders_are_round():
    """A box passes the corner that a square would have; and hits beside it."""
    scene_body = Body("drum", (Cylinder(0.1, 0.1, (0, 0, 0.05)),), (), 1.0)
    (drum,) = arm.make_pieces(scene_body, Pose((0.0, 0.0, 0.0)))
    obstacle = arm.Obstacle("drum", "placed(drum)", (drum,))
    for away_m, hits in ((0.046, False), (0.044, True)):
        start = piece((0.02, 0.02, 0.02), (away_m, away_m, 0.3))
        touch = arm.Sweep("", "it", (start,), (0, 0, -0.27), NONE).touch(obstacle, 2e-4, 40)
        assert (touch is not None) is hits


def test_a_cylinder_is_as_wide_as_it_should_be():
    """Its polygon neither stands out nor falls short by more than 0.06 % of the radius."""
    corners = arm.get_corners(Cylinder(0.2, 0.1, (0.0, 0.0, 0.05)))[:, :2]
    ring = corners[:64]
    middles = (ring + np.roll(ring, 1, axis=0)) / 2
    assert np.abs(np.linalg.norm(ring, axis=1) / 0.1 - 1).max() < 6.1e-4
    assert np.abs(np.linalg.norm(middles, axis=1) / 0.1 - 1).max() < 6.1e-4


def test_a_mesh_is_its_convex_hull():
    """A wedge: above its slope there is room, above its edge there is none."""
    wedge = Mesh(
        tuple(
            (x, y, z) for y in (-0.05, 0.05) for x, z in ((-0.05, 0.0), (0.05, 0.0), (-0.05, 0.1))
        ),
        PRISM,
    )
    (piece_,) = arm.make_pieces(Body("wedge", (wedge,), (), 1.0), Pose((0.0, 0.0, 0.0)))
    obstacle = arm.Obstacle("wedge", "placed(wedge)", (piece_,))
    for x_m, hits in ((-0.03, True), (0.03, False)):
        start = piece((0.01, 0.01, 0.01), (x_m, 0.0, 0.3))
        touch = arm.Sweep("", "it", (start,), (0, 0, -0.25), NONE).touch(obstacle, 2e-4, 40)
        assert (touch is not None) is hits


def test_a_turned_body_takes_its_turned_room():
    """By an eighth of a turn."""
    body = Body("bar", (Box((0.1, 0.02, 0.02), (0.0, 0.0, 0.01)),), (), 1.0)
    (turned,) = arm.make_pieces(body, Pose.upright((0.0, 0.0, 0.0), np.pi / 4))
    assert (
        arm.measure_distance(turned, piece((0.01, 0.01, 0.01), (0.03, 0.03, 0.01))).distance_m < 0
    )
    assert arm.measure_distance(turned, piece((0.01, 0.01, 0.01), (0.04, 0.0, 0.01))).distance_m > 0


def test_obstacles_are_the_table_and_what_can_be_touched_in_the_world():
    """Not what is in a hand or inside a feeder."""
    body = Body(
        "part",
        (Box((0.1, 0.1, 0.1), (0.0, 0.0, 0.05)),),
        (
            Placement("at_start(part)", Pose((0.5, 0.0, 0.0)), solid=False),
            Placement("held(part)", Pose((0.0, 0.0, 0.0)), frame="panda"),
            Placement("placed(part)", Pose((0.5, 0.2, 0.0))),
        ),
        1.0,
    )
    obstacles = arm.collect_obstacles(Scene((body,), ()))
    assert [(obstacle.body, obstacle.fact) for obstacle in obstacles] == [
        (arm.TABLE, None),
        ("part", "placed(part)"),
    ]
    assert obstacles[1].top_m == pytest.approx(0.1)
