"""Axis-aligned boxes against references that sample instead of calculating."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.collision import WorldBox, centroid, contact_area, sweep_hits, world_box, world_boxes
from skillplan.task import Body, Box, Pose

# Coordinates on a grid, so that faces meet exactly often enough to matter.
coordinates = st.integers(-4, 4)
points = st.tuples(coordinates, coordinates, coordinates)
boxes = st.tuples(points, st.tuples(*[st.integers(1, 4)] * 3)).map(
    lambda drawn: WorldBox(
        tuple(float(low) for low in drawn[0]),
        tuple(float(low + size) for low, size in zip(*drawn, strict=True)),
    )
)


def depth(first, other):
    """Return how deep two boxes overlap along the axis where they do so least; < 0 if apart."""
    return min(
        min(first.high[axis], other.high[axis]) - max(first.low[axis], other.low[axis])
        for axis in range(3)
    )


def sampled_depth(moving, by, obstacle, samples=2_000):
    """Return the greatest overlap depth met at many moments of a displacement."""
    moments = (i / samples for i in range(samples + 1))
    return max(
        depth(moving.moved(tuple(moment * step for step in by)), obstacle) for moment in moments
    )


@given(boxes, points, boxes, st.sampled_from([0.0, 0.01, 0.3]))
def test_a_sweep_hits_exactly_where_sampling_finds_an_overlap(moving, by, obstacle, tolerance_m):
    """Except within what the samples may miss."""
    resolution_m = max(map(abs, by)) / 2_000 + 1e-9
    found_m = sampled_depth(moving, tuple(map(float, by)), obstacle)
    hit = sweep_hits(moving, tuple(map(float, by)), obstacle, tolerance_m)
    # Along one axis at a time the overlap that must be passed is the tolerance on each side.
    if found_m > tolerance_m + resolution_m:
        assert hit
    if found_m < tolerance_m - resolution_m or found_m <= 0:
        assert not hit


@given(boxes, points, boxes)
def test_a_sweep_hits_the_same_backwards(moving, by, obstacle):
    """From its end to its start."""
    there = tuple(map(float, by))
    back = tuple(-step for step in there)
    assert sweep_hits(moving, there, obstacle, 0.0) == sweep_hits(
        moving.moved(there), back, obstacle, 0.0
    )


def test_boxes_that_only_touch_do_not_hit():
    """Standing on, sliding along, and stopping at a face."""
    box = WorldBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    above, beside = box.moved((0.0, 0.0, 1.0)), box.moved((1.0, 0.0, 0.0))
    assert not sweep_hits(above, (0.0, 0.0, 0.0), box, 0.0)
    assert not sweep_hits(above, (5.0, 0.0, 0.0), box, 0.0)
    assert not sweep_hits(box.moved((0.0, 0.0, 3.0)), (0.0, 0.0, -2.0), box, 0.0)
    assert not sweep_hits(beside, (0.0, 0.0, 2.0), box, 0.0)
    assert sweep_hits(box.moved((0.0, 0.0, 3.0)), (0.0, 0.0, -2.001), box, 0.0)
    assert not sweep_hits(box.moved((0.0, 0.0, 3.0)), (0.0, 0.0, -2.001), box, 0.01)


def test_a_thin_obstacle_in_the_middle_of_the_way_is_hit():
    """However fast it would be passed."""
    wall = WorldBox((5.0, -1.0, 0.0), (5.001, 1.0, 1.0))
    box = WorldBox((0.0, -0.1, 0.0), (0.2, 0.1, 0.2))
    assert sweep_hits(box, (100.0, 0.0, 0.0), wall, 0.0)
    assert not sweep_hits(box, (100.0, 0.0, 50.0), wall, 0.0)
    assert not sweep_hits(box, (-100.0, 0.0, 0.0), wall, 0.0)


@given(boxes, boxes)
def test_a_contact_is_the_overlap_of_foot_and_top(foot, top):
    """Counted in cells of the grid; none unless the faces are level."""
    area = contact_area(foot, top, 1e-6)

    def cells(box):
        spans = [range(int(box.low[axis]), int(box.high[axis])) for axis in range(2)]
        return set(itertools.product(*spans))

    shared = cells(foot) & cells(top) if foot.low[2] == top.high[2] else set()
    if area is None:
        assert not shared
    else:
        assert shared == set(
            itertools.product(range(int(area[0]), int(area[2])), range(int(area[1]), int(area[3])))
        )


def test_a_gap_within_the_tolerance_still_is_a_contact():
    """Above and below; not beyond."""
    top = WorldBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    for gap_m, touches in ((0.009, True), (-0.009, True), (0.011, False), (-0.011, False)):
        foot = top.moved((0.5, 0.5, 1.0 + gap_m))
        assert (contact_area(foot, top, 0.01) == (0.5, 0.5, 1.0, 1.0)) is touches


@given(st.floats(0.01, 1), st.floats(0.01, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4))
def test_a_turned_box_is_the_hull_of_its_turned_corners(x_m, y_m, shift_x_m, shift_y_m, yaw_rad):
    """About the origin of its body."""
    box = Box((x_m, y_m, 0.2), (shift_x_m, shift_y_m, 0.3))
    world = world_box(box, (1.0, 2.0, 3.0), yaw_rad)
    corners = [
        (shift_x_m + side * x_m / 2, shift_y_m + other * y_m / 2)
        for side, other in itertools.product((-1, 1), repeat=2)
    ]
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turned = [(1 + cos * x - sin * y, 2 + sin * x + cos * y) for x, y in corners]
    for axis in range(2):
        assert world.low[axis] == pytest.approx(min(corner[axis] for corner in turned))
        assert world.high[axis] == pytest.approx(max(corner[axis] for corner in turned))
    assert (world.low[2], world.high[2]) == pytest.approx((3.2, 3.4))


def test_the_boxes_of_a_body_follow_its_pose():
    """Position and yaw."""
    body = Body("a", (Box((0.2, 0.1, 0.1), (0.1, 0.0, 0.05)),), (), 1.0)
    (box,) = world_boxes(body, Pose.upright((1.0, 1.0, 0.0), math.pi / 2))
    assert box.low == pytest.approx((0.95, 1.0, 0.0))
    assert box.high == pytest.approx((1.05, 1.2, 0.1))


def test_the_centroid_is_weighed_by_volume():
    """A box of three times the volume pulls three times as much."""
    small = WorldBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    large = WorldBox((4.0, 0.0, 0.0), (5.0, 1.0, 3.0))
    assert centroid([small, large]) == pytest.approx((0.25 * 0.5 + 0.75 * 4.5, 0.5))
