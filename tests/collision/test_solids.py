"""True shapes at poses: how far one falls, how deep two overlap, by what area they touch."""

import math
import time

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from skillplan.collision import TOUCH_M, Solid, measure_union
from skillplan.task import Box, Cylinder, Mesh, Pose

ORIGIN = (0.0, 0.0, 0.0)
QUARTER = math.pi / 2

lengths = st.floats(0.005, 0.06)
places = st.floats(-0.03, 0.03)
angles = st.floats(-3.1, 3.1)
boxes = st.builds(Box, st.tuples(lengths, lengths, lengths), st.just(ORIGIN))
cylinders = st.builds(Cylinder, lengths, lengths, st.just(ORIGIN))
turns = st.one_of(st.tuples(st.just(0.0), st.just(0.0), angles), st.tuples(angles, angles, angles))


TOUCHING = (
    Box((0.03125, 0.03125, 0.01953125), ORIGIN),
    Pose(ORIGIN),
    Box((0.03125, 0.03125, 0.029296875), ORIGIN),
    Pose((0.0, 0.0, 0.0243)),
    0,
)
"""Two boxes that share 0.11 mm, which is touch."""


def poses(heights):
    return st.builds(Pose.turned, st.tuples(places, places, heights), turns)


def columns(shape, pose, plan):
    """Return between which heights vertical lines are in a shape: lows and highs, by clipping."""
    back = pose.inverse()
    rotation = np.array(back.rotation)
    begins = np.column_stack([plan, np.zeros(len(plan))]) @ rotation.T + np.array(back.position)
    up = rotation[:, 2]
    lows, highs = np.full(len(plan), -np.inf), np.full(len(plan), np.inf)
    half = [extent / 2 for extent in shape.box.size]
    for axis in (0, 1, 2) if isinstance(shape, Box) else (2,):
        if abs(up[axis]) < 1e-12:
            highs[np.abs(begins[:, axis]) > half[axis]] = -np.inf
            continue
        a, b = ((sign * half[axis] - begins[:, axis]) / up[axis] for sign in (-1, 1))
        lows, highs = np.maximum(lows, np.minimum(a, b)), np.minimum(highs, np.maximum(a, b))
    if isinstance(shape, Cylinder):
        a = up[0] ** 2 + up[1] ** 2
        b = begins[:, 0] * up[0] + begins[:, 1] * up[1]
        c = begins[:, 0] ** 2 + begins[:, 1] ** 2 - half[0] ** 2
        if a < 1e-18:
            highs[c > 0] = -np.inf
        else:
            root = np.sqrt(np.maximum(b * b - a * c, 0))
            lows, highs = np.maximum(lows, (-b - root) / a), np.minimum(highs, (-b + root) / a)
            highs[b * b < a * c] = -np.inf
    return lows, highs


@given(boxes | cylinders, poses(st.just(0.0)), boxes | cylinders, poses(st.just(0.1)))
@settings(max_examples=25, deadline=None)
def test_how_far_a_shape_falls_is_what_vertical_lines_say(lower, at, upper, above):
    """To what a grid of 0.5 mm can see, and never further; but for grazing edges of 0.2 mm."""
    grid = np.linspace(-0.08, 0.08, 320)
    plan = np.column_stack([axis.ravel() for axis in np.meshgrid(grid, grid)])
    _, tops = columns(lower, at, plan)
    bottoms, ends = columns(upper, above, plan)
    shared = (tops > -np.inf) & (ends >= bottoms) & (tops >= columns(lower, at, plan)[0])
    fall_m = Solid((upper,), above).fall_m(Solid((lower,), at))
    if shared.sum() < 20:
        return
    sampled_m = (bottoms - tops)[shared].min()
    assert -1e-4 < sampled_m - fall_m < 4e-3


def eroded(shape):
    """Return a shape less what is within the tolerance of touch of its surface."""
    less = 2 * TOUCH_M
    if isinstance(shape, Box):
        return Box(tuple(size - less for size in shape.size), ORIGIN)
    return Cylinder(shape.diameter_m - less, shape.height_m - less, ORIGIN)


@given(boxes | cylinders, poses(st.just(0.0)), boxes | cylinders, poses(places), st.integers(0))
@settings(max_examples=40, deadline=None)
@example(*TOUCHING)
def test_shapes_overlap_where_points_lie_in_both(one, at, other, there, seed):
    """Whatever 20,000 random points find to be shared, beyond touch, overlaps, and nothing else."""
    first, second = Solid((one,), at), Solid((other,), there)
    depth_m = first.depth_m(second)
    assert second.depth_m(first) == pytest.approx(depth_m)
    low = np.maximum(first.box.low, second.box.low)
    high = np.minimum(first.box.high, second.box.high)
    if (low >= high).any():
        assert depth_m == 0
        return
    points = np.random.default_rng(seed % 2**32).uniform(low, high, (20_000, 3))

    def inside(shape, pose):
        lows, highs = columns(shape, pose, points[:, :2])
        return (lows <= points[:, 2]) & (points[:, 2] <= highs)

    if depth_m == 0:
        assert not (inside(eroded(one), at) & inside(other, there)).any()
    elif depth_m > 3e-3:
        assert (inside(one, at) & inside(other, there)).any()


def test_what_stands_on_a_box_overlaps_by_what_it_is_lowered():
    """Upright, and turned on its side, by the same depth."""
    floor = Solid((Box((0.1, 0.1, 0.02), (0, 0, 0.01)),), Pose(ORIGIN))
    for shape, turn, reach_m in (
        (Box((0.02, 0.03, 0.04), ORIGIN), (0.0, 0.0, 0.3), 0.02),
        (Box((0.02, 0.03, 0.04), ORIGIN), (0.0, QUARTER, 0.0), 0.01),
        (Cylinder(0.03, 0.05, ORIGIN), (0.0, QUARTER, 0.7), 0.015),
    ):
        lowered = Solid((shape,), Pose.turned((0.0, 0.0, 0.02 + reach_m - 0.0032), turn))
        assert lowered.depth_m(floor) == pytest.approx(0.0032, abs=1e-9)
        assert lowered.fall_m(floor) == pytest.approx(-0.0032, abs=1e-9)
        assert lowered.gap_m(floor) is None


def wedge(side):
    """Return one side of a groove along x: a slope of 45 degrees that rises along +y or -y."""
    corners = [(x, y, z) for x in (-0.05, 0.05) for y, z in ((0, 0), (0.03, 0), (0.03, 0.03))]
    faces = [(0, 2, 1), (3, 4, 5), (0, 4, 3), (0, 1, 4), (1, 5, 4), (1, 2, 5), (0, 5, 2), (0, 3, 5)]
    if side < 0:
        corners = [(x, -y, z) for x, y, z in corners]
        faces = [(a, c, b) for a, b, c in faces]
    return Mesh(tuple(corners), tuple(faces))


def test_a_shaft_in_a_groove_rests_on_both_its_sides():
    """Of a right angle: the axis is the root of two radii above its bottom."""
    shaft = Solid(
        (Cylinder(0.02, 0.08, ORIGIN),), Pose.turned((0.0, 0.0, 0.1), (0.0, QUARTER, 0.0))
    )
    fall_m = shaft.fall_m(Solid((wedge(1), wedge(-1)), Pose(ORIGIN)))
    assert 0.1 - fall_m == pytest.approx(math.sqrt(2) * 0.01, abs=6e-6)


def test_a_part_that_fits_exactly_comes_down_between_walls():
    """Walls that touch it carry nothing, nor do those that are 0.1 mm too near."""
    for inner_m in (0.1, 0.0998):
        walls = [
            Box((0.01, 0.2, 0.05), (sign * (inner_m / 2 + 0.005), 0, 0.025)) for sign in (-1, 1)
        ]
        case = Solid((Box((0.2, 0.2, 0.003), (0, 0, 0.0015)), *walls), Pose(ORIGIN))
        board = Solid((Box((0.1, 0.08, 0.002), (0, 0, 0.001)),), Pose((0.0, 0.0, 0.2)))
        assert board.fall_m(case) == pytest.approx(0.197)


def test_contact_is_measured_where_shapes_touch():
    """Half of a box, a circle, a shaft's line, and the two feet of a bridge."""
    floor = Solid((Box((0.1, 0.1, 0.02), (0, 0, 0.01)),), Pose(ORIGIN))
    box, cylinder = Box((0.02, 0.02, 0.02), (0, 0, 0.01)), Cylinder(0.02, 0.03, (0, 0, 0.015))
    at_edge = Solid((box,), Pose((0.05, 0.0, 0.02)))
    upright = Solid((cylinder,), Pose((0.0, 0.0, 0.02)))
    lying = Solid((cylinder,), Pose.turned((0.0, 0.0, 0.03), (0.0, QUARTER, 0.3)))
    turned = Solid((box,), Pose.turned((0.0, 0.0, 0.03), (0.0, QUARTER, 0.3)))
    legs = [Box((0.01, 0.02, 0.01), (x, 0, 0.005)) for x in (-0.03, 0.03)]
    bridge = Solid((*legs, Box((0.07, 0.02, 0.01), (0, 0, 0.015))), Pose((0.0, 0.0, 0.02)))
    areas_mm2 = [
        solid.contact_m2(floor) * 1e6 for solid in (at_edge, upright, lying, turned, bridge)
    ]
    assert areas_mm2 == pytest.approx([200, 100 * math.pi, 0, 400, 400], rel=1e-6)


def test_an_area_that_two_shapes_cover_counts_once():
    """Two squares that overlap, one that touches, one apart."""
    square = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
    moved = [tuple((x + dx, y + dy) for x, y in square) for dx, dy in ((1, 1), (2, 0), (9, 9))]
    assert measure_union([square, moved[0]]) == pytest.approx(7)
    assert measure_union([square, moved[1]]) == pytest.approx(8)
    assert measure_union([square, moved[2]]) == pytest.approx(8)


def test_a_corner_that_comes_twice_but_for_rounding_changes_no_area():
    corners = (
        (0.48575, 0.2116125),
        (0.48575, 0.21021255),
        (0.4862650677874647, 0.2102641347012559),
    )
    again = (0.48575, 0.21161250000000004)
    beside = tuple((x + 1, y) for x, y in corners)
    both = measure_union([(again, *corners[1:], corners[0]), beside])
    assert both == pytest.approx(2 * measure_union([corners]))


def test_the_area_of_a_thousand_polygons_is_measured_at_once():
    """A ring of overlapping hexagons, as a round face of many convex pieces is; cubic no more."""
    turns = [math.pi * side / 3 for side in range(6)]
    ring = [
        tuple(
            (math.cos(at) + math.cos(turn) / 10, math.sin(at) + math.sin(turn) / 10)
            for turn in turns
        )
        for at in (2 * math.pi * number / 1000 for number in range(1000))
    ]
    began = time.process_time()
    assert 2 * math.pi * 0.17 < measure_union(ring) < 2 * math.pi * 0.2
    assert time.process_time() - began < 2


def test_touching_within_the_tolerance_is_no_overlap():
    """Side by side, and 0.1 mm in each other."""
    box = Box((0.02, 0.02, 0.02), ORIGIN)
    solid = Solid((box,), Pose(ORIGIN))
    assert solid.depth_m(Solid((box,), Pose((0.02, 0.0, 0.0)))) == 0
    assert solid.depth_m(Solid((box,), Pose((0.0199, 0.0, 0.0)))) <= TOUCH_M
    assert solid.depth_m(Solid((box,), Pose((0.0195, 0.0, 0.0)))) == pytest.approx(0.0005)
