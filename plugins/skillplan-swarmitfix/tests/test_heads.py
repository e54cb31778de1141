"""Triangular heads along a trajectory."""

import itertools
import math
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from yaml_data import yaml_data

DATA = yaml_data(Path(__file__).parent / "data" / "polygonal_table3.yaml")
RULES = swarm.HeadRules()
SIDE_M = RULES.side_m
STRAIGHT = swarm.Segment(0, ((0.0, 0.0), (1.0, 0.0)))
yaws = st.floats(0, swarm.THIRD_RAD - 1e-6)


def polyline(*points, closed=False):
    elements = [swarm.Line(point) for point in points[1:]]
    return swarm.Workpiece.from_elements(points[0], elements, closed=closed, chord_tolerance_m=1e-3)


def corners_of(position, yaw_rad, side_m=SIDE_M):
    radius_m = side_m / math.sqrt(3)
    angles = (yaw_rad + k * swarm.THIRD_RAD for k in range(3))
    return [
        (position[0] + radius_m * math.cos(a), position[1] + radius_m * math.sin(a)) for a in angles
    ]


def contains(corners, point, slack=0.0):
    """Whether a triangle, corners counter-clockwise, holds a point."""
    return all(
        (bx - ax) * (point[1] - ay) - (by - ay) * (point[0] - ax) >= -slack
        for (ax, ay), (bx, by) in itertools.pairwise([*corners, corners[0]])
    )


def head_at(x_m, y_m, yaw_rad):
    return swarm.Head((x_m, y_m), swarm.normal_yaw(yaw_rad), swarm.HeadKind.INTERMEDIATE, 0, 0.0)


def borne(segment, distance_m, yaw_rad):
    begin_m, end_m = swarm.SupportedStretch(segment, RULES).at(distance_m, yaw_rad)
    return distance_m - begin_m, end_m - distance_m


@pytest.mark.parametrize(
    ("yaw_deg", "back_m", "ahead_m"),
    [
        (0, SIDE_M / (2 * math.sqrt(3)), SIDE_M / math.sqrt(3)),
        (60, SIDE_M / math.sqrt(3), SIDE_M / (2 * math.sqrt(3))),
        (30, SIDE_M / 3, SIDE_M / 3),
        (90, SIDE_M / 3, SIDE_M / 3),
    ],
)
def test_a_head_bears_more_ahead_where_a_corner_points_ahead(yaw_deg, back_m, ahead_m):
    assert borne(STRAIGHT, 0.5, math.radians(yaw_deg)) == pytest.approx((back_m, ahead_m))


@given(yaws, st.floats(0, 1), st.floats(-math.pi, math.pi))
def test_a_head_bears_what_lies_within_its_triangle(yaw_rad, share, direction):
    segment = swarm.Segment(0, ((0.2, 0.1), (0.2 + math.cos(direction), 0.1 + math.sin(direction))))
    begin_m, end_m = swarm.SupportedStretch(segment, RULES).at(share * segment.length_m, yaw_rad)
    corners = corners_of(segment.point_at(share * segment.length_m), yaw_rad)
    for i in range(201):
        distance_m = min(segment.length_m, i / 200)
        inside = contains(corners, segment.point_at(distance_m))
        if min(abs(distance_m - begin_m), abs(distance_m - end_m)) > 1e-9:
            assert inside == (begin_m < distance_m < end_m)


@given(yaws, st.floats(0.2, 0.8))
def test_of_a_curve_a_head_bears_the_piece_around_its_centre(yaw_rad, share):
    bend = [(0.06 * math.cos(a / 20), 0.06 * math.sin(a / 20)) for a in range(70)]
    segment = swarm.Segment(0, tuple(bend))
    at_m = share * segment.length_m
    begin_m, end_m = swarm.SupportedStretch(segment, RULES).at(at_m, yaw_rad)
    corners = corners_of(segment.point_at(at_m), yaw_rad)
    assert begin_m <= at_m <= end_m
    for i in range(101):
        within_m = begin_m + (end_m - begin_m) * i / 100
        assert contains(corners, segment.point_at(within_m), slack=1e-9)
    for out_m in (begin_m - 1e-6, end_m + 1e-6):
        if 0 <= out_m <= segment.length_m:
            assert not contains(corners, segment.point_at(out_m))


@given(yaws)
def test_a_third_of_a_turn_leaves_a_head_as_it_was(yaw_rad):
    assert swarm.same_yaw(yaw_rad, yaw_rad + swarm.THIRD_RAD)
    assert borne(STRAIGHT, 0.5, yaw_rad + swarm.THIRD_RAD) == pytest.approx(
        borne(STRAIGHT, 0.5, yaw_rad), abs=1e-12
    )
    assert swarm.normal_yaw(yaw_rad - swarm.THIRD_RAD) == pytest.approx(yaw_rad, abs=1e-9)


@given(st.floats(-math.pi, math.pi), st.floats(0.2, 2 * math.pi - 0.2))
def test_a_vertex_head_bears_as_much_of_either_segment_and_never_less_than_turned_round(
    ahead, angle
):
    assume(abs(angle - math.pi) > 0.01)
    first, other = (
        (math.cos(ahead), math.sin(ahead)),
        (math.cos(ahead + angle), math.sin(ahead + angle)),
    )
    workpiece = polyline(first, (0.0, 0.0), other)
    head = swarm.vertex_heads(workpiece, RULES)[1]
    before, after = workpiece.segments
    mine = borne(before, before.length_m, head.yaw_rad)[0], borne(after, 0.0, head.yaw_rad)[1]
    round_rad = head.yaw_rad + math.pi
    theirs = borne(before, before.length_m, round_rad)[0], borne(after, 0.0, round_rad)[1]
    assert mine[0] == pytest.approx(mine[1])
    assert mine[0] >= theirs[0] - 1e-9


def test_a_head_at_an_end_points_a_corner_along_the_trajectory():
    workpiece = polyline((0.0, 0.0), (0.6, 0.8))
    first, last = swarm.vertex_heads(workpiece, RULES)
    (segment,) = workpiece.segments
    assert borne(segment, 0.0, first.yaw_rad)[1] == pytest.approx(SIDE_M / math.sqrt(3))
    assert borne(segment, 1.0, last.yaw_rad)[0] == pytest.approx(SIDE_M / math.sqrt(3))
    assert (first.kind, last.kind) == (swarm.HeadKind.VERTEX, swarm.HeadKind.VERTEX)
    assert (last.segment, last.distance_m) == (0, pytest.approx(1.0))


def test_where_a_trajectory_goes_straight_on_rounding_does_not_turn_the_head():
    yaws_rad = [
        swarm.vertex_heads(polyline((0.0, 0.0), (1.0, y_m), (2.0, 0.0)), RULES)[1].yaw_rad
        for y_m in (1e-9, 0.0, -1e-9)
    ]
    assert yaws_rad == pytest.approx([yaws_rad[0]] * 3, abs=1e-6)


def test_a_closed_trajectory_has_a_head_at_every_vertex():
    corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)]
    heads = swarm.vertex_heads(polyline(*corners, closed=True), RULES)
    assert [head.position for head in heads] == corners
    assert [head.segment for head in heads] == [0, 1, 2, 3]


def test_even_heads_are_the_supports_of_the_polygonal_trajectory():
    vertices = [tuple(vertex) for vertex in DATA["vertices_m"]]
    workpiece = polyline(*vertices, closed=True)
    supports = []
    for segment, parts in zip(workpiece.segments, DATA["subdivisions_per_edge"], strict=True):
        supports += [segment.start, *(head.position for head in swarm.even_heads(segment, parts))]
    # The data are rounded to a tenth of a millimetre.
    assert [coordinate for point in supports for coordinate in point] == pytest.approx(
        [coordinate for point in DATA["supports_m"] for coordinate in point], abs=5.1e-5
    )


def test_no_segment_has_no_parts():
    with pytest.raises(ValueError, match="at least 1 subdivision, not 0"):
        swarm.even_heads(STRAIGHT, 0)


def test_the_path_between_heads_follows_the_trajectory():
    arc = swarm.Workpiece.from_elements(
        (0.0, 0.0),
        [swarm.Arc(end=(2.0, 0.0), through=(1.0, 1.0))],
        closed=True,
        chord_tolerance_m=1e-4,
    )
    corners = swarm.vertex_heads(arc, RULES)
    middle = swarm.even_heads(arc.segments[0], 2)
    way = swarm.path_between(arc, [corners[0], *middle, *corners[1:]])
    assert way(0, 0.0) == (0.0, 0.0)
    assert way(0, 0.5) == pytest.approx(
        (1 - math.cos(math.pi / 4), math.sin(math.pi / 4)), abs=1e-3
    )
    assert way(1, 1.0) == pytest.approx((2.0, 0.0))
    assert way(2, 0.5) == pytest.approx((1.0, 0.0))


offsets = st.floats(-0.13, 0.13)


@given(offsets, offsets, yaws, yaws)
def test_heads_overlap_exactly_where_their_triangles_share_area(x_m, y_m, one_rad, other_rad):
    first, other = head_at(0.0, 0.0, one_rad), head_at(x_m, y_m, other_rad)
    area = shared_area(
        corners_of(first.position, first.yaw_rad), corners_of(other.position, other.yaw_rad)
    )
    assume(not 0 < area < 1e-9)
    assert swarm.overlap(first, other, RULES) == (area > 0)
    assert swarm.overlap(other, first, RULES) == swarm.overlap(first, other, RULES)


def shared_area(first, other):
    """Return the area of the intersection of two triangles: Sutherland and Hodgman's clipping."""
    shape = first
    for (ax, ay), (bx, by) in itertools.pairwise([*other, other[0]]):
        clipped = []
        for p, q in itertools.pairwise([*shape, *shape[:1]]):
            hp = (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax)
            hq = (bx - ax) * (q[1] - ay) - (by - ay) * (q[0] - ax)
            if hp >= 0:
                clipped.append(p)
            if hp * hq < 0:
                t = hp / (hp - hq)
                clipped.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
        shape = clipped
    pairs = itertools.pairwise([*shape, *shape[:1]])
    return max(0.0, sum(px * qy - qx * py for (px, py), (qx, qy) in pairs) / 2)


def test_heads_that_touch_do_not_overlap():
    height_m = SIDE_M * math.sqrt(3) / 2
    assert not swarm.overlap(head_at(0, 0, 0), head_at(height_m, 0, 0), RULES)
    assert swarm.overlap(head_at(0, 0, 0), head_at(height_m - 1e-6, 0, 0), RULES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"side_m": 0.0}, "side_m must be finite and > 0"),
        ({"step_m": math.inf}, "step_m must be finite and > 0"),
        ({"max_gap_m": -0.1}, "max_gap_m must be finite and >= 0"),
        ({"orientations": 0}, "orientations must be >= 1"),
        ({"reorientation_cost": 1.0}, r"reorientation_cost must be in \[0, 1\)"),
    ],
)
def test_rules_out_of_range_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        swarm.HeadRules(**change)


@pytest.mark.parametrize(
    ("yaw_rad", "distance_m", "message"),
    [(swarm.THIRD_RAD, 0.0, "yaw_rad"), (-0.1, 0.0, "yaw_rad"), (0.0, -1.0, "distance_m")],
)
def test_a_head_out_of_range_is_refused(yaw_rad, distance_m, message):
    with pytest.raises(ValueError, match=message):
        swarm.Head((0.0, 0.0), yaw_rad, swarm.HeadKind.VERTEX, 0, distance_m)
