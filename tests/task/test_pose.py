"""Poses: how they are turned, put together and undone."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.task import (
    DOWN,
    Box,
    Cylinder,
    Event,
    Facts,
    Mesh,
    Motion,
    Point,
    Pose,
    Route,
    Visit,
    cross,
    dot,
    plus,
    unit,
)

angles = st.floats(-math.pi, math.pi)
lengths = st.floats(-2, 2)
points = st.tuples(lengths, lengths, lengths)
poses = st.builds(Pose.turned, points, st.tuples(angles, angles, angles))


def close(point: Point) -> object:
    return pytest.approx(point, abs=1e-9)


def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_this_order():
    quarter = math.pi / 2
    assert Pose.turned((0, 0, 0), (quarter, 0, 0)).rotate((0, 1, 0)) == close((0, 0, 1))
    assert Pose.turned((0, 0, 0), (0, quarter, 0)).rotate((1, 0, 0)) == close((0, 0, -1))
    assert Pose.turned((0, 0, 0), (0, 0, quarter)).rotate((1, 0, 0)) == close((0, 1, 0))
    rolled_then_yawed = Pose.turned((0, 0, 0), (quarter, 0, quarter))
    assert rolled_then_yawed.rotate((0, 1, 0)) == close((0, 0, 1))
    assert rolled_then_yawed.rotate((0, 0, 1)) == close((1, 0, 0))


def test_without_roll_and_pitch_a_pose_is_upright():
    assert Pose.turned((1, 2, 3), (0, 0, 0.7)) == Pose.upright((1, 2, 3), 0.7)
    assert Pose.upright((1, 2, 3), 0.7).is_upright
    assert not Pose.turned((1, 2, 3), (0.01, 0, 0)).is_upright


@given(poses, points)
def test_the_inverse_undoes_a_pose(pose, point):
    assert pose.inverse().apply(pose.apply(point)) == close(point)
    assert pose.then(pose.inverse()).apply(point) == close(point)


@given(poses, poses, points)
def test_one_pose_in_another_is_both_in_turn(one, other, point):
    assert one.then(other).apply(point) == close(one.apply(other.apply(point)))


@given(poses, points, points)
def test_turning_keeps_lengths_and_angles(pose, a, b):
    assert dot(pose.rotate(a), pose.rotate(b)) == pytest.approx(dot(a, b), abs=1e-9)
    assert pose.rotate(cross(a, b)) == close(cross(pose.rotate(a), pose.rotate(b)))


@given(poses)
def test_a_pose_is_found_again_from_its_axes(pose):
    y, z = pose.rotate((0, 1, 0)), pose.rotate((0, 0, 1))
    again = Pose.of_axes(pose.position, unit(y), unit(z))
    assert again.rotate((1, 2, 3)) == pytest.approx(pose.rotate((1, 2, 3)), abs=1e-6)


def test_what_has_no_direction_is_refused():
    with pytest.raises(ValueError, match="no direction"):
        unit((0, 0, 0))


def test_vectors_are_added():
    assert plus((1, 2, 3), DOWN, 2.0) == (1, 2, 1)


# Motions in via points.


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


# Shapes of bodies: boxes, cylinders and convex meshes.


# A wedge 2 m long, 1 m wide and, where it is highest, 1 m high.
WEDGE = Mesh(
    ((0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)),
    ((3, 2, 1), (3, 1, 0), (0, 1, 4), (1, 2, 5), (1, 5, 4), (2, 3, 5), (3, 0, 4), (3, 4, 5)),
)
CYLINDER = Cylinder(0.04, 0.1, (1.0, 2.0, 0.05))
BOX = Box((0.1, 0.2, 0.3), (1.0, 2.0, 0.15))
SHAPES = {"box": BOX, "cylinder": CYLINDER, "wedge": WEDGE}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_cylinder_has_a_positive_diameter_and_height(value):
    """Both checks of its constructor."""
    with pytest.raises(ValueError, match="diameter_m must be > 0"):
        Cylinder(value, 1.0, (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="height_m must be > 0"):
        Cylinder(1.0, value, (0.0, 0.0, 0.0))


def test_a_mesh_has_finite_corners_with_a_volume():
    """The four checks of its constructor."""
    corners = WEDGE.corners
    with pytest.raises(ValueError, match="at least 4 corners, not 3"):
        Mesh(corners[:3], ())
    with pytest.raises(ValueError, match="must name corners 0 to 5"):
        Mesh(corners, ((0, 1, 6),))
    with pytest.raises(ValueError, match="must be finite"):
        Mesh(((math.nan, 0, 0), *corners[1:]), ())
    with pytest.raises(ValueError, match="extent along every axis"):
        Mesh(corners[:4], ())


def test_the_box_about_a_shape_touches_its_ends():
    """Figures by hand."""
    assert BOX.box == BOX
    assert CYLINDER.box == Box((0.04, 0.04, 0.1), (1.0, 2.0, 0.05))
    assert WEDGE.box == Box((2, 1, 1), (1.0, 0.5, 0.5))


def test_the_core_of_a_cylinder_has_its_corners_on_the_rim():
    """Of a box it is the box itself."""
    core = CYLINDER.core
    assert math.hypot(core.size[0] / 2, core.size[1] / 2) == pytest.approx(0.02)
    assert (core.size[2], core.centre) == (0.1, CYLINDER.centre)
    assert BOX.core == BOX


@every_shape
def test_the_core_of_a_shape_lies_inside_it(shape):
    """Each of its corners is below the surface; and it is no speck."""
    core = shape.core
    for x_sign in (-1, 1):
        for y_sign in (-1, 1):
            x_m = core.centre[0] + x_sign * core.size[0] / 2 * (1 - 1e-9)
            y_m = core.centre[1] + y_sign * core.size[1] / 2 * (1 - 1e-9)
            top_m = shape.top_m(x_m, y_m)
            assert top_m is not None
            assert core.centre[2] + core.size[2] / 2 <= top_m + 1e-9
    assert min(core.size) > 0.3 * min(shape.box.size)


def test_the_core_of_a_surface_that_is_not_closed_is_a_speck():
    """Nothing is known to be inside."""
    inside_out = Mesh(WEDGE.corners, tuple(face[::-1] for face in WEDGE.faces))
    assert max(inside_out.core.size) < 1e-8


def test_the_top_of_a_shape_is_its_surface():
    """At a point of its plan, the rim included; there is none beside it."""
    assert BOX.top_m(1.05, 2.1) == pytest.approx(0.3)
    assert BOX.top_m(1.051, 2.0) is None
    assert CYLINDER.top_m(1.0, 2.02) == pytest.approx(0.1)
    # In the corner of the box about it.
    assert CYLINDER.top_m(1.019, 2.019) is None
    assert WEDGE.top_m(2.001, 0.5) is None


@given(x_m=st.floats(0, 2), y_m=st.floats(0, 1))
def test_a_wedge_falls_away_evenly(x_m, y_m):
    """By a metre over two."""
    assert WEDGE.top_m(x_m, y_m) == pytest.approx(1 - x_m / 2, abs=1e-9)
