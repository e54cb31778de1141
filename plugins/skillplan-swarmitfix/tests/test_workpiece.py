"""Trajectories split into segments, their vertices, and what is wrong with bad ones."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from skillplan_swarmitfix import MAX_CHORDS
from skillplan_swarmitfix.trajectory.workpiece import faults

BENCH = (0.0, 0.0, 4.0, 2.0)
CIRCLE = [swarm.Arc((-1, 0), (0, 1)), swarm.Arc((1, 0), (0, -1))]


def polygon(*corners: swarm.Point2, closed: bool = True) -> swarm.Workpiece:
    return swarm.Workpiece.from_elements(
        corners[0],
        [swarm.Line(corner) for corner in corners[1:]],
        closed=closed,
        chord_tolerance_m=1e-3,
    )


def told(
    start: swarm.Point2,
    *elements: swarm.Element,
    closed: bool = False,
    outline: tuple[float, float, float, float] | None = None,
) -> list[tuple[str, tuple[str | int, ...]]]:
    return faults(start, elements, closed, 1e-3, outline)


@st.composite
def simple_polygons(draw: st.DrawFn) -> list[swarm.Point2]:
    """Draw a star-shaped polygon, of either sense, with convex and reflex vertices."""
    count = draw(st.integers(3, 12))
    radii = draw(st.lists(st.floats(0.2, 2.0), min_size=count, max_size=count))
    corners = [
        (radius * math.cos(math.tau * i / count), radius * math.sin(math.tau * i / count))
        for i, radius in enumerate(radii)
    ]
    return corners[:: draw(st.sampled_from([1, -1]))]


class TestVertices:
    @given(simple_polygons())
    def test_interior_angles_of_a_closed_polygon_sum_to_n_minus_2_straight_angles(self, corners):
        whole = polygon(*corners)
        angles = [vertex.angle_rad for vertex in whole.vertices]
        assert math.fsum(angles) == pytest.approx((len(corners) - 2) * math.pi)
        assert len(whole.segments) == len(whole.vertices) == len(corners)

    @given(simple_polygons())
    def test_turning_a_polygon_round_changes_its_sense_and_no_angle(self, corners):
        there, back = polygon(*corners), polygon(*reversed(corners))
        assert there.clockwise is not back.clockwise
        angles = [vertex.angle_rad for vertex in back.vertices]
        assert [v.angle_rad for v in there.vertices] == pytest.approx(angles[::-1])

    def test_convex_reflex_and_straight_vertices_are_told_apart(self):
        arrow = polygon((0, 0), (1, 0), (2, 0), (1, 1), (0.9, 0.2))
        kinds = ["convex", "smooth", "convex", "convex", "reflex"]
        assert [vertex.kind for vertex in arrow.vertices] == kinds
        assert arrow.vertex_counts == {"smooth": 1, "convex": 3, "reflex": 1}

    def test_an_open_trajectory_has_ends_and_turns_left_or_right(self):
        stairs = polygon((0, 0), (1, 0), (1, 1), (2, 1), closed=False)
        assert [vertex.kind for vertex in stairs.vertices] == ["end", "left", "right", "end"]
        angles = [vertex.angle_rad for vertex in stairs.vertices]
        assert angles == pytest.approx([math.pi, math.pi / 2, 3 * math.pi / 2, math.pi])
        assert stairs.clockwise is None

    @pytest.mark.parametrize(
        ("degrees", "corner"),
        [
            (30, swarm.Corner.ACUTE),
            (89.8, swarm.Corner.ACUTE),
            (90.05, swarm.Corner.RIGHT),
            (270, swarm.Corner.RIGHT),
            (91, swarm.Corner.OBTUSE),
            (180.05, swarm.Corner.STRAIGHT),
            (225, swarm.Corner.OBTUSE),
            (300, swarm.Corner.ACUTE),
        ],
    )
    def test_a_corner_is_named_by_its_narrower_side(self, degrees, corner):
        assert corner is swarm.Vertex((0, 0), math.radians(degrees), swarm.VertexKind.CONVEX).corner

    @pytest.mark.parametrize("angle_rad", [0.0, math.tau, -1.0, math.nan])
    def test_an_angle_is_within_a_full_turn(self, angle_rad):
        with pytest.raises(ValueError, match=r"within \(0, 2 pi\)"):
            swarm.Vertex((0, 0), angle_rad, swarm.VertexKind.CONVEX)

    def test_a_curve_that_goes_on_along_its_tangent_has_a_smooth_vertex(self):
        """By the tangents of the arc, however coarse its chords."""
        slot = swarm.Workpiece.from_elements(
            (0, 0),
            [
                swarm.Line((1, 0)),
                swarm.Arc((1, 1), (1.5, 0.5)),
                swarm.Line((0, 1)),
                swarm.Arc((0, 0), (-0.5, 0.5)),
            ],
            closed=True,
            chord_tolerance_m=0.1,
        )
        assert [vertex.angle_rad for vertex in slot.vertices] == pytest.approx([math.pi] * 4)
        assert slot.vertex_counts == {"smooth": 4}

    def test_the_tip_of_a_cusp_has_its_angle_on_the_inside(self):
        """Two arcs share a tangent at the start and lead back along it."""
        out = swarm.Arc((2, 2), (math.sqrt(2), 2 - math.sqrt(2)))
        back = swarm.Arc((0, 0), (math.sqrt(0.5), 1 - math.sqrt(0.5)))
        within = [out, swarm.Line((1, 1)), back]
        around = [
            swarm.Line((2, -2)),
            swarm.Line((-2, -2)),
            swarm.Line((-2, 2)),
            swarm.Line((1, 2)),
            swarm.Line((1, 1)),
        ]
        for elements, angle_rad in ((within, 0.0), ([out, *around, back], math.tau)):
            whole = swarm.Workpiece.from_elements(
                (0, 0), elements, closed=True, chord_tolerance_m=1e-4
            )
            assert whole.vertices[0].angle_rad == pytest.approx(angle_rad, abs=0.05)


class TestSegments:
    @given(simple_polygons(), st.booleans())
    def test_their_lengths_sum_to_that_of_the_trajectory(self, corners, closed):
        whole = polygon(*corners, closed=closed)
        around = [*corners, corners[0]] if closed else corners
        length_m = sum(math.dist(a, b) for a, b in itertools.pairwise(around))
        assert whole.length_m == pytest.approx(length_m)

    @given(st.lists(st.integers(1, 9), min_size=1, max_size=8), st.floats(0, 1))
    def test_a_point_is_as_far_along_the_chords_as_asked_for(self, steps, share):
        xs = [float(x) for x in itertools.accumulate(steps, initial=0)]
        segment = swarm.Segment(0, tuple((x, float(i % 2)) for i, x in enumerate(xs)))
        assert segment.point_at(0.0) == segment.start
        assert segment.point_at(segment.length_m) == segment.end
        place = segment.point_at(share * segment.length_m)
        before = [point for point in segment.points if point[0] < place[0]]
        along = [*before, place] if before else [segment.start, place]
        travelled_m = sum(math.dist(a, b) for a, b in itertools.pairwise(along))
        assert travelled_m == pytest.approx(share * segment.length_m, abs=1e-9)

    def test_its_direction_is_that_of_the_chord_ahead(self):
        segment = swarm.Segment(0, ((0, 0), (1, 0), (1, 1)))
        assert segment.direction_at(0.5) == 0.0
        assert segment.direction_at(1.0) == segment.direction_at(2.0) == math.pi / 2

    @pytest.mark.parametrize("distance_m", [-0.1, 2.1, math.nan])
    def test_there_is_no_point_beyond_its_ends(self, distance_m):
        segment = swarm.Segment(3, ((0, 0), (1, 0), (1, 1)))
        with pytest.raises(ValueError, match="Segment 3 is 2 m long; it has no point"):
            segment.point_at(distance_m)
        with pytest.raises(ValueError, match="it has no point"):
            segment.direction_at(distance_m)

    def test_it_has_two_points_or_more(self):
        with pytest.raises(ValueError, match="two points or more"):
            swarm.Segment(0, ((0, 0),))

    def test_its_consecutive_points_differ(self):
        with pytest.raises(ValueError, match="two consecutive points that are equal"):
            swarm.Segment(0, ((0, 0), (1, 0), (1, 0)))


class TestWorkpiece:
    def test_a_full_circle_is_two_curved_segments(self):
        whole = swarm.Workpiece.from_elements((1, 0), CIRCLE, closed=True, chord_tolerance_m=1e-5)
        assert [segment.is_curved for segment in whole.segments] == [True, True]
        assert whole.length_m == pytest.approx(math.tau, rel=1e-4)
        assert whole.bounds == pytest.approx((-1, -1, 1, 1))
        assert whole.vertex_counts == {"smooth": 2}
        assert whole.clockwise is False

    def test_an_s_curve_of_arcs_or_of_a_spline_is_split_at_its_elements_only(self):
        arcs = [swarm.Arc((2, 0), (1, 1)), swarm.Arc((4, 0), (3, -1))]
        whole = swarm.Workpiece.from_elements((0, 0), arcs, closed=False, chord_tolerance_m=1e-3)
        assert [vertex.kind for vertex in whole.vertices] == ["end", "smooth", "end"]
        spline = [swarm.Spline(((1, 1), (2, 0), (3, -1), (4, 0)))]
        whole = swarm.Workpiece.from_elements((0, 0), spline, closed=False, chord_tolerance_m=1e-3)
        assert len(whole.segments) == 1
        assert (3, -1) in whole.segments[0].points

    def test_one_closed_spline_is_a_loop_with_one_vertex(self):
        loop = [swarm.Spline(((0, 1), (-1, 0), (0, -1), (1, 0)))]
        whole = swarm.Workpiece.from_elements((1, 0), loop, closed=True, chord_tolerance_m=1e-3)
        assert [vertex.kind for vertex in whole.vertices] == ["smooth"]

    def test_a_closed_one_is_led_back_to_its_start_unless_it_is_there(self):
        open_end = polygon((0, 0), (1, 0), (0, 1))
        assert open_end.segments[-1].points == ((0, 1), (0, 0))
        assert polygon((0, 0), (1, 0), (0, 1), (0, 0)) == open_end
        assert polygon((0, 0), (1, 0), (0, 1), (0, 5e-7)) == open_end

    def test_all_faults_are_told_at_once(self):
        elements = [swarm.Line((0, 0)), swarm.Line((1, 0)), swarm.Arc((3, 0), (2, 0))]
        with pytest.raises(ValueError, match=r"(?s)^elements\[0\]: Two .*\nelements\[2\]: The arc"):
            swarm.Workpiece.from_elements((0, 0), elements, closed=False, chord_tolerance_m=1e-3)

    def test_a_fault_of_the_whole_names_no_element(self):
        with pytest.raises(ValueError, match=r"^The trajectory has no segment"):
            swarm.Workpiece.from_elements((0, 0), [], closed=False, chord_tolerance_m=1e-3)

    def test_its_parts_have_to_fit(self):
        whole = polygon((0, 0), (1, 0), (0, 1))
        with pytest.raises(ValueError, match="3 segments do not fit 2 vertices"):
            replace(whole, vertices=whole.vertices[:2])
        with pytest.raises(ValueError, match="has a sense"):
            replace(whole, clockwise=None)
        with pytest.raises(ValueError, match="Segment 1 does not join its vertices"):
            replace(whole, segments=(whole.segments[0], whole.segments[1], *whole.segments[1:2]))
        with pytest.raises(ValueError, match="0 segments do not fit"):
            swarm.Workpiece(True, (), (), True)


class TestCorners:
    """Heads are placed from corner to corner, however a path between them is written."""

    @staticmethod
    def half_circle(parts: int) -> list[swarm.Element]:
        """Return a half circle of radius 1 about the origin as chords, or as one arc."""
        if parts == 0:
            return [swarm.Arc((-1, 0), (0, 1))]
        turned = [math.pi * i / parts for i in range(1, parts + 1)]
        return [swarm.Line((math.cos(angle), math.sin(angle))) for angle in turned]

    def corners(self, elements: list[swarm.Element], *, closed: bool) -> swarm.Workpiece:
        return swarm.Workpiece.from_elements(
            (1, 0), elements, closed=closed, chord_tolerance_m=1e-4, corner_rad=swarm.CORNER_RAD
        )

    @pytest.mark.parametrize("parts", [0, 10, 60])
    def test_an_arc_is_one_segment_as_an_arc_or_as_chords(self, parts):
        whole = self.corners(self.half_circle(parts), closed=False)
        (segment,) = whole.segments
        assert [vertex.kind for vertex in whole.vertices] == ["end", "end"]
        middle = segment.point_at(segment.length_m / 2)
        assert middle == pytest.approx((0, 1), abs=1e-2)
        assert segment.heading_at(0.0, 0.1) == pytest.approx(math.pi / 2, abs=0.2)

    @pytest.mark.parametrize("parts", [0, 40])
    def test_a_circle_has_a_vertex_at_its_start_and_one_opposite(self, parts):
        lower = [
            swarm.Arc((1, 0), (0, -1))
            if isinstance(e, swarm.Arc)
            else swarm.Line((-e.end[0], -e.end[1]))
            for e in self.half_circle(parts)
        ]
        whole = self.corners([*self.half_circle(parts), *lower], closed=True)
        assert [vertex.position for vertex in whole.vertices] == [
            (1, 0),
            pytest.approx((-1, 0), abs=1e-9),
        ]
        lengths = [segment.true_length_m for segment in whole.segments]
        assert lengths[0] == pytest.approx(lengths[1])

    def test_corners_stay_vertices(self):
        whole = self.corners(
            [swarm.Line((2, 0)), swarm.Line((2, 1)), swarm.Line((1, 1))], closed=True
        )
        assert len(whole.vertices) == 4

    @given(st.floats(0.1, 3.0), st.floats(0.3, 1.4))
    def test_the_length_is_that_of_the_curve(self, radius, half):
        """Not of its chords."""
        ends = [(radius * math.cos(w), radius * math.sin(w)) for w in (0.0, half, 2 * half)]
        arc = swarm.Arc(ends[2], ends[1])
        coarse = swarm.Workpiece.from_elements(ends[0], [arc], closed=False, chord_tolerance_m=0.1)
        assert coarse.length_m == pytest.approx(2 * half * radius, rel=1e-9)
        spline = swarm.Spline((ends[1], ends[2]))
        fine = swarm.Workpiece.from_elements(
            ends[0], [spline], closed=False, chord_tolerance_m=1e-7
        )
        chords = fine.segments[0].length_m
        assert swarm.measure_m(ends[0], spline) == pytest.approx(chords, rel=1e-5)


class TestFaults:
    def test_a_good_trajectory_has_none(self):
        assert (
            told((1, 1), swarm.Line((2, 1)), swarm.Line((2, 2)), closed=True, outline=BENCH) == []
        )

    def test_a_segment_of_zero_length(self):
        ((message, path),) = told(
            (0, 0), swarm.Line((1, 0)), swarm.Line((1, 0)), swarm.Line((2, 0))
        )
        assert path == (1,)
        assert "(1, 0) m, which makes a segment of zero length; leave one" in message

    @pytest.mark.parametrize(
        ("elements", "closed", "places"),
        [
            ([swarm.Line((1, 1)), swarm.Line((1, 0)), swarm.Line((0, 1))], True, [(0.5, 0.5)]),
            ([swarm.Line((1, 0)), swarm.Line((0, 1)), swarm.Line((1, 1))], True, [(0.5, 0.5)]),
            ([swarm.Line((2, 0)), swarm.Line((2, 1)), swarm.Line((1, 0))], False, [(1, 0)]),
            ([swarm.Line((1, 0)), swarm.Line((1, 1))], True, []),
        ],
    )
    def test_a_tool_may_cross_its_path_and_the_place_is_known(self, elements, closed, places):
        assert told((0, 0), *elements, closed=closed) == []
        assert swarm.find_meetings((0, 0), elements, 1e-3, closed=closed) == [
            pytest.approx(place) for place in places
        ]

    def test_leading_back_along_itself_is_a_fold(self):
        ((message, path),) = told((0, 0), swarm.Line((2, 0)), swarm.Line((1, 0)))
        assert path == (1,)
        assert "Segment 2 folds back onto segment 1 at (2, 0) m" in message

    def test_a_curve_may_cross_a_line_or_itself(self):
        line_and_arc = [swarm.Line((2, 0)), swarm.Arc((1, 0.5), (1.5, -0.5))]
        assert told((0, 0), *line_and_arc) == []
        assert len(swarm.find_meetings((0, 0), line_and_arc, 1e-3, closed=False)) == 1
        loop = swarm.Spline(((2, 0), (2, 1), (1, 1), (1, -1)))
        ((x, _),) = swarm.find_meetings((0, 0), [loop], 1e-3, closed=False)
        assert x == pytest.approx(0.95, abs=0.05)

    def test_an_open_one_that_ends_at_its_start_is_told_to_be_closed(self):
        ((message, path),) = told((1, 0), *CIRCLE)
        assert path == ()
        assert "ends at its start, (1, 0) m, but is declared open" in message

    def test_of_many_folds_some_are_told_and_the_rest_counted(self):
        ruler = [swarm.Line((x, 0.0)) for i in range(15) for x in (i + 2.0, i + 1.0)]
        messages = told((0, 0), *ruler)
        assert len(messages) == 11
        assert re.fullmatch(r"The trajectory folds back \d+ times more at least\.", messages[-1][0])

    def test_a_point_off_the_bench_is_told_with_the_outline(self):
        messages = told((-1, 1), swarm.Line((3, 1)), swarm.Arc((3, 0), (4.5, 0.5)), outline=BENCH)
        assert [path for _, path in messages] == [("start",), (1,)]
        assert (
            "The point (-1, 1) m is off the bench, whose outline is x 0 to 4 m, y 0 to 2 m"
            in (messages[0][0])
        )
        assert re.search(r"The point \(4\.\d+, 0\.\d+\) m is off", messages[1][0])

    def test_a_closed_trajectory_of_lines_has_three_vertices(self):
        ((message, path),) = told((0, 0), swarm.Line((1, 0)), closed=True)
        assert path == ()
        assert "needs 3 vertices, but this one has 2" in message

    def test_a_trajectory_has_an_element(self):
        ((message, path),) = told((0, 0))
        assert path == ()
        assert message.startswith("The trajectory has no segment; give at least one element")

    def test_what_is_not_finite_is_told_once_and_where(self):
        messages = told(
            (math.nan, 0),
            swarm.Line((1, 0)),
            swarm.Line((2, math.inf)),
            swarm.Line((3, 0)),
            outline=BENCH,
        )
        assert [path for _, path in messages] == [("start",), (1,)]

    def test_a_bad_tolerance_is_told_alone(self):
        ((message, path),) = faults((0, 0), [swarm.Line((0, 0))], False, 0.0, None)
        assert path == ("chord_tolerance_m",)
        assert "cannot be used" in message

    def test_too_many_chords_in_all_are_refused(self):
        circles = [
            swarm.Arc((i + 1.0, 0), (i + 0.5, 0.5 if i % 2 else -0.5))
            for i in range(MAX_CHORDS // 500)
        ]
        issues = faults((0, 0), circles, False, 1e-6, None)
        assert [path for _, path in issues] == [()]
        assert f"{MAX_CHORDS} are the most; give a coarser chord tolerance" in issues[0][0]


def reference_crosses(points: Sequence[swarm.Point2], closed: bool) -> bool:
    """Whether any two chords meet, by whole numbers and every pair."""
    count = len(points)
    chords = [(points[i], points[(i + 1) % count]) for i in range(count if closed else count - 1)]

    def side(a: swarm.Point2, b: swarm.Point2, c: swarm.Point2) -> float:
        cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        return (cross > 0) - (cross < 0)

    def on(p: swarm.Point2, a: swarm.Point2, b: swarm.Point2) -> bool:
        within = all(min(a[k], b[k]) <= p[k] <= max(a[k], b[k]) for k in (0, 1))
        return side(a, b, p) == 0 and within

    for (i, (a, b)), (j, (c, d)) in itertools.combinations(enumerate(chords), 2):
        if j == i + 1:
            if on(d, a, b) or on(a, c, d):
                return True
        elif closed and i == 0 and j == count - 1:
            if on(c, a, b) or on(b, c, d):
                return True
        elif side(a, b, c) != side(a, b, d) and side(c, d, a) != side(c, d, b):
            if side(a, b, c) * side(a, b, d) <= 0 and side(c, d, a) * side(c, d, b) <= 0:
                return True
        elif any((on(c, a, b), on(d, a, b), on(a, c, d), on(b, c, d))):
            return True
    return False


grid = st.tuples(st.integers(0, 6), st.integers(0, 6))


class TestCrossings:
    @given(st.lists(grid, min_size=3, max_size=9), st.booleans())
    def test_they_are_found_exactly_where_whole_numbers_say_so(self, corners, closed):
        assume(all(a != b for a, b in itertools.pairwise([*corners, *corners[:closed]])))
        crossing_points = swarm.crossings(np.array(corners, dtype=np.float64), closed=closed)
        assert bool(crossing_points) is reference_crosses(corners, closed)

    @given(st.lists(grid, min_size=3, max_size=9))
    def test_a_common_point_is_on_both_chords(self, corners):
        assume(all(a != b for a, b in itertools.pairwise(corners)))
        for crossing in swarm.crossings(np.array(corners, dtype=np.float64), closed=False):
            for i in (crossing.first, crossing.second):
                a, b = corners[i], corners[i + 1]
                detour = math.dist(a, crossing.point) + math.dist(crossing.point, b)
                assert detour == pytest.approx(math.dist(a, b), abs=1e-7)

    def test_one_crossing_among_ten_thousand_chords_is_found(self):
        turns = np.linspace(1.0, 60.0, 10_000)
        spiral = np.column_stack((turns * np.cos(turns), turns * np.sin(turns)))
        assert swarm.crossings(spiral, closed=False) == []
        spiral[-1] = spiral[-120] * 0.9
        assert {9_998} == {crossing.second for crossing in swarm.crossings(spiral, closed=False)}
