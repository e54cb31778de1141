"""What bears a body that is left somewhere."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import skillplan_pinocchio as arm
from situations import assembly
from skillplan.pipeline import Setup, make_feasibility
from skillplan.task import Body, Box, Cylinder, Mesh, Pose

POINTS = st.lists(st.tuples(st.floats(-1, 1, width=16), st.floats(-1, 1, width=16)), max_size=12)
# Triangles of a prism on a triangle, three corners, then three opposite; and of a tetrahedron.
PRISM = ((0, 1, 2), (3, 5, 4), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (2, 5, 3), (2, 3, 0))
CONE = ((0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2))
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


def block(size, x=0.0, y=0.0, z=0.0, yaw_rad=0.0):
    """Return the pieces of a block that stands at a place."""
    body = Body("it", (Box(size, (0.0, 0.0, size[2] / 2)),), (), 1.0)
    return arm.make_pieces(body, Pose.upright((x, y, z), yaw_rad))


def ground(pieces, *under, tolerance_m=2e-4):
    """Return what could bear a body: blocks below it, in order."""
    obstacles = [arm.Obstacle(f"block {n}", f"placed({n})", item) for n, item in enumerate(under)]
    return arm.find_supports("it", pieces, obstacles, tolerance_m)


@pytest.mark.parametrize(("overhang_m", "stays"), [(0.0, True), (0.049, True), (0.051, False)])
def test_a_block_stays_while_its_centre_is_above_what_bears_it(overhang_m, stays):
    """The one below ends 50 mm from its centre."""
    result = ground(block((0.04, 0.04, 0.02), overhang_m, z=0.02), block((0.1, 0.1, 0.02)))
    assert result.hold([True]) is stays
    assert result.hold([False]) is False


def test_two_supports_bear_what_lies_between_them():
    """Neither alone does."""
    sides = [block((0.02, 0.02, 0.02), x) for x in (-0.05, 0.05)]
    result = ground(block((0.12, 0.04, 0.02), z=0.02), *sides)
    assert result.hold([True, True])
    assert not result.hold([True, False])
    assert not result.hold([False, True])


@pytest.mark.parametrize("gap_m", [-0.0003, 0.0003])
def test_what_is_higher_or_lower_than_the_body_bears_nothing(gap_m):
    """Beyond the tolerance."""
    result = ground(block((0.04, 0.04, 0.02), z=0.02 + gap_m), block((0.1, 0.1, 0.02)))
    assert result.contacts == ()


def test_blocks_side_by_side_do_not_bear_each_other():
    """They touch in a line, which has no area."""
    result = ground(block((0.04, 0.04, 0.02), z=0.02), block((0.04, 0.04, 0.02), 0.04))
    assert result.contacts == ()


def test_the_table_bears_what_stands_on_it_but_not_what_leans_over():
    """A body whose centre is beside its foot tips on the table, too."""
    shapes = (Box((0.02, 0.02, 0.02), (0.0, 0.0, 0.01)), Box((0.2, 0.02, 0.02), (0.08, 0.0, 0.03)))
    obstacles = [arm.Obstacle("the table", None, (arm.make_table(),))]
    for body, stays in (
        (Body("it", shapes[:1], (), 1.0), True),
        (Body("it", shapes, (), 1.0), False),
    ):
        supports = arm.find_supports(
            "it", arm.make_pieces(body, Pose((0.4, 0.0, 0.0))), obstacles, 2e-4
        )
        assert supports.hold([True]) is stays


def test_a_turned_block_bears_where_it_is():
    """Under a corner that only the turned one has."""
    foot = block((0.01, 0.01, 0.02), 0.06, z=0.02)
    square = (0.1, 0.1, 0.02)
    assert ground(foot, block(square)).contacts == ()
    assert ground(foot, block(square, yaw_rad=math.pi / 4)).hold([True])


def test_a_cylinder_stands_on_its_circle():
    """Half of it beyond an edge is the limit."""
    drum = Body("it", (Cylinder(0.04, 0.04, (0.0, 0.0, 0.02)),), (), 1.0)
    for x_m, stays in ((0.049, True), (0.051, False)):
        pieces = arm.make_pieces(drum, Pose((x_m, 0.0, 0.02)))
        assert ground(pieces, block((0.1, 0.1, 0.02))).hold([True]) is stays


def test_the_centre_of_mass_is_that_of_the_volume():
    """Of a wedge: a third of the way from its upright face."""
    wedge = Mesh(
        tuple((x, y, z) for y in (-0.05, 0.05) for x, z in ((0.0, 0.0), (0.09, 0.0), (0.0, 0.1))),
        PRISM,
    )
    pieces = arm.make_pieces(Body("it", (wedge,), (), 1.0), Pose((0.0, 0.0, 0.0)))
    assert ground(pieces).centre == pytest.approx((0.03, 0.0), abs=1e-9)


def test_a_body_on_a_point_is_borne_by_nothing():
    """A cone that stands on its head falls over."""
    cone = Mesh(((0.0, 0.0, 0.0), (0.05, 0.05, 0.1), (-0.05, 0.05, 0.1), (0.0, -0.05, 0.1)), CONE)
    pieces = arm.make_pieces(Body("it", (cone,), (), 1.0), Pose((0.0, 0.0, 0.02)))
    assert not ground(pieces, block((0.2, 0.2, 0.02))).hold([])


@given(POINTS)
def test_a_hull_encloses_its_points_and_turns_left(points):
    """Every corner is one of them."""
    hull = arm.compute_planar_hull(points)
    assert set(hull) <= set(points)
    if len(hull) > 2:
        for begin, end in zip(hull, hull[1:] + hull[:1], strict=True):
            for point in points:
                cross = (end[0] - begin[0]) * (point[1] - begin[1])
                cross -= (end[1] - begin[1]) * (point[0] - begin[0])
                assert cross >= -1e-9


@given(POINTS)
def test_what_a_polygon_has_in_common_with_a_square_is_within_both(points):
    """Whichever is clipped by the other, it is the same."""
    hull = arm.compute_planar_hull(points)
    common = arm.intersect(hull, SQUARE)
    assert all(-1e-9 <= value <= 1 + 1e-9 for corner in common for value in corner)
    again = arm.intersect(SQUARE, hull)
    assert bool(common) == bool(again)
    if common:
        for axis in (0, 1):
            spans = [[corner[axis] for corner in item] for item in (common, again)]
            assert min(spans[0]) == pytest.approx(min(spans[1]), abs=1e-6)
            assert max(spans[0]) == pytest.approx(max(spans[1]), abs=1e-6)


def bar(x=0.0, z=0.0, sides=64):
    """Return the pieces of a round bar that lies along y, 10 mm in radius."""
    turns = [2 * math.pi * n / sides for n in range(sides)]
    ring = [(x + 0.01 * math.cos(t), z + 0.01 * math.sin(t)) for t in turns]
    corners = [(a, y, b) for y in (-0.05, 0.05) for a, b in ring]
    return (arm.ConvexPiece(np.array(corners)),)


def slope(side):
    """Return a prism whose upper face falls towards x = 0 by 45 degrees."""
    outline = [(0.0, 0.0), (side * 0.04, 0.0), (side * 0.04, 0.04)]
    return (arm.ConvexPiece(np.array([(x, y, z) for y in (-0.03, 0.03) for x, z in outline])),)


def test_slanted_faces_bear_a_bar_between_them_but_one_alone_does_not():
    """Their contacts are lines, which have no area; the bar is longer than its bed."""
    result = ground(bar(z=0.01 * math.sqrt(2)), slope(1.0), slope(-1.0))
    assert result.hold([True, True])
    assert not result.hold([True, False])


def test_a_bar_between_upright_walls_falls_through():
    """No preload is stated that would clamp it."""
    walls = [block((0.02, 0.1, 0.05), x) for x in (-0.02, 0.02)]
    result = ground(bar(z=0.03), *walls)
    assert not result.hold([True] * len(result.contacts))


# Grasps that hold nothing are refused: jaws on air, cups over holes and edges.


# An angle of two walls, 10 mm thick, and a ring of four bars, 12 mm wide.
ANGLE = [
    {"size_m": [0.05, 0.01, 0.08], "centre_m": [0.0, -0.025, 0.04]},
    {"size_m": [0.01, 0.05, 0.08], "centre_m": [-0.02, 0.005, 0.04]},
]
RING = [
    {"size_m": [0.012, 0.06, 0.01], "centre_m": [sign * 0.024, 0.0, 0.005]} for sign in (-1, 1)
] + [{"size_m": [0.06, 0.012, 0.01], "centre_m": [0.0, sign * 0.024, 0.005]} for sign in (-1, 1)]


def pick(boxes, grasp, tool=None):
    """Return the verdict of swept on the pick of one part."""
    content = {
        "kind": "assembly",
        "name": "one",
        "robot": {"home_m": [0.4, 0.0]},
        "tools": {"hand": {"holder_m": [0.3, 0.4], **(tool or {"opening_m": 0.08})}},
        "initial_tool": "hand",
        "parts": {
            "part": {
                "tool": "hand",
                "boxes": boxes,
                "grasp": grasp,
                "start_m": [0.5, -0.2],
                "goal_m": [0.5, 0.1],
            }
        },
    }
    task = assembly(content)
    feasibility = make_feasibility(task, Setup(collision=("swept",)))
    return feasibility.verdict(task.skill("pick(part)"), task.initial)


def test_jaws_that_meet_no_material_on_a_side_are_refused():
    """The box about the angle is 50 mm wide, and there is a wall on one side of it only."""
    on_air = pick(ANGLE, {"closing_axis": "x", "at_m": [0.0, 0.01]})
    assert not on_air.is_feasible
    assert "the jaws close on air: they meet" in on_air.reason
    at_wall = {"closing_axis": "x", "at_m": [-0.02, 0.008], "width_m": 0.01}
    assert pick(ANGLE, at_wall).is_feasible
    beside = pick(ANGLE, {**at_wall, "width_m": 0.014})
    assert "0.0 and 0.0 mm2 of part" in beside.reason


@pytest.mark.parametrize(
    ("at_m", "diameter_m", "held"),
    [([0.0, 0.0175], 0.016, False), ([0.024, 0.0], 0.016, False), ([0.024, 0.0], 0.008, True)],
    ids=["over the hole", "too wide for the rim", "on the rim"],
)
def test_a_cup_stands_on_material_all_round(at_m, diameter_m, held):
    verdict = pick(RING, {"at_m": at_m}, {"type": "suction", "cup_diameter_m": diameter_m})
    assert verdict.is_feasible == held
    if not held:
        assert "the suction cup covers a hole or an edge of part" in verdict.reason


def test_a_narrow_cup_has_a_narrow_stem():
    """A wall 10 mm beside it and 30 mm high is in the way of the shank of a wide one."""
    well = [*RING, {"size_m": [0.002, 0.06, 0.03], "centre_m": [0.0375, 0.0, 0.015]}]
    narrow = {"type": "suction", "cup_diameter_m": 0.006}
    assert pick(well, {"at_m": [0.024, 0.0]}, narrow).is_feasible
    wide = [{"size_m": [0.03, 0.06, 0.01], "centre_m": [0.02, 0.0, 0.005]}, well[-1]]
    assert "hand runs into part" in pick(wide, {"at_m": [0.02, 0.0]}, {"type": "suction"}).reason
