"""Lines, arcs and splines, against the curves they stand for."""

from __future__ import annotations

import contextlib
import itertools
import math

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from skillplan_swarmitfix import MAX_CHORDS

coordinates = st.floats(-3, 3, allow_subnormal=False)
points = st.tuples(coordinates, coordinates)
tolerances_m = st.sampled_from([1e-5, 1e-4, 1e-3, 1e-2, 0.3, 10.0])


def distance_m(point: swarm.Point2, a: swarm.Point2, b: swarm.Point2) -> float:
    """Return how far a point is from a chord."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    share = ((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / (dx * dx + dy * dy)
    share = min(1.0, max(0.0, share))
    return math.dist(point, (a[0] + share * dx, a[1] + share * dy))


def apart(*those: swarm.Point2, by_m: float = 1e-2) -> bool:
    return all(math.dist(a, b) > by_m for a, b in itertools.pairwise(those))


@st.composite
def arcs(draw: st.DrawFn) -> tuple[swarm.Point2, swarm.Arc, swarm.Point2, float, float, float]:
    """Draw an arc by its circle: start, arc, centre, radius, first angle, sweep."""
    centre, radius = draw(points), draw(st.floats(0.01, 3))
    first = draw(st.floats(0, math.tau))
    sweep = draw(st.floats(0.05, 6.2)) * draw(st.sampled_from([-1, 1]))

    def at(angle: float) -> swarm.Point2:
        return (centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle))

    between = draw(st.floats(0.2, 0.8))
    arc = swarm.Arc(end=at(first + sweep), through=at(first + between * sweep))
    return at(first), arc, centre, radius, first, sweep


class TestArc:
    @given(arcs(), tolerances_m)
    def test_chords_stay_within_the_tolerance_of_the_arc(self, drawn, tolerance_m):
        start, arc, centre, radius, first, sweep = drawn
        chords = [start, *swarm.sample(start, arc, tolerance_m)]
        count = len(chords) - 1
        stated_m = swarm.sampling_error_m(start, arc, tolerance_m)
        assert stated_m <= tolerance_m * (1 + 1e-9)
        assert stated_m == pytest.approx(radius * (1 - math.cos(sweep / count / 2)), abs=1e-7)
        for i, (a, b) in enumerate(itertools.pairwise(chords)):
            for share in (0.25, 0.5, 0.75):
                angle = first + (i + share) / count * sweep
                on_arc = (
                    centre[0] + radius * math.cos(angle),
                    centre[1] + radius * math.sin(angle),
                )
                assert distance_m(on_arc, a, b) <= stated_m + 1e-7

    @given(arcs())
    def test_its_circle_is_found_from_three_points(self, drawn):
        start, arc, centre, radius, _, sweep = drawn
        circle = swarm.circle_of(start, arc)
        assert circle.centre == pytest.approx(centre, abs=1e-7)
        assert circle.radius_m == pytest.approx(radius, abs=1e-7)
        assert circle.sweep_rad == pytest.approx(sweep, abs=1e-6)

    @given(arcs())
    def test_its_directions_are_at_right_angles_to_its_radii(self, drawn):
        start, arc, _, _, first, sweep = drawn
        turned = math.copysign(math.pi / 2, sweep)
        for end_direction, angle in zip(
            swarm.end_directions(start, arc), (first, first + sweep), strict=True
        ):
            assert math.remainder(end_direction - angle - turned, math.tau) == pytest.approx(
                0, abs=1e-6
            )

    def test_three_points_on_a_line_are_no_arc(self):
        with pytest.raises(ValueError, match=r"lie on a line.*or write a line"):
            swarm.sample((0, 0), swarm.Arc((2, 2), (1, 1)), 1e-3)

    @pytest.mark.parametrize(
        "arc", [swarm.Arc((0, 0), (1, 1)), swarm.Arc((1, 1), (0, 0)), swarm.Arc((1, 1), (1, 1))]
    )
    def test_an_arc_needs_three_different_points(self, arc):
        with pytest.raises(ValueError, match="full circle as two arcs"):
            swarm.sample((0, 0), arc, 1e-3)

    def test_what_is_too_flat_for_an_arc_becomes_a_line(self):
        assert swarm.Line((1, 0)) == swarm.arc_or_line((0, 0), (1, 0), (0.5, 1e-8))
        assert swarm.Arc((1, 0), (0.5, 0.1)) == swarm.arc_or_line((0, 0), (1, 0), (0.5, 0.1))


def catmull_rom(p: list[swarm.Point2], share: float) -> swarm.Point2:
    """Return a point between p[1] and p[2] by the pyramid of Barry and Goldman (1988)."""
    t = [0.0]
    for a, b in itertools.pairwise(p):
        t.append(t[-1] + math.sqrt(math.dist(a, b)))
    at = t[1] + share * (t[2] - t[1])

    def mix(a: swarm.Point2, b: swarm.Point2, low: float, high: float) -> swarm.Point2:
        w = (at - low) / (high - low)
        return ((1 - w) * a[0] + w * b[0], (1 - w) * a[1] + w * b[1])

    a1, a2, a3 = (mix(p[i], p[i + 1], t[i], t[i + 1]) for i in range(3))
    b1, b2 = mix(a1, a2, t[0], t[2]), mix(a2, a3, t[1], t[3])
    return mix(b1, b2, t[1], t[2])


class TestSpline:
    @given(st.lists(points, min_size=4, max_size=4), tolerances_m)
    def test_chords_stay_within_the_tolerance_of_the_catmull_rom_curve(self, p, tolerance_m):
        """The middle span has the four points themselves for its neighbours."""
        assume(apart(*p) and math.dist(p[0], p[3]) > swarm.SAME_POINT_M)
        chords = [p[0], *swarm.sample(p[0], swarm.Spline(tuple(p[1:])), tolerance_m)]
        stated_m = swarm.sampling_error_m(p[0], swarm.Spline(tuple(p[1:])), tolerance_m)
        assert stated_m <= tolerance_m * (1 + 1e-9)
        span = chords[chords.index(p[1]) : len(chords) - chords[::-1].index(p[2])]
        for i in range(1, 40):
            on_curve = catmull_rom(p, i / 40)
            off_m = min(distance_m(on_curve, a, b) for a, b in itertools.pairwise(span))
            assert off_m <= stated_m + 1e-9

    @given(st.lists(points, min_size=2, max_size=7))
    def test_a_spline_passes_through_its_points_in_turn(self, p):
        assume(apart(*p))
        sampled = iter(swarm.sample(p[0], swarm.Spline(tuple(p[1:])), 1e-3))
        assert all(point in sampled for point in p[1:])

    def test_one_that_ends_where_it_starts_is_closed_smoothly(self):
        first, last = swarm.end_directions((1, 0), swarm.Spline(((0, 1), (-1, 0), (0, -1), (1, 0))))
        assert first == pytest.approx(last)
        assert first == pytest.approx(math.pi / 2)

    def test_one_through_its_end_only_is_straight(self):
        assert swarm.sample((0, 0), swarm.Spline(((2, 0),)), 1e-3) == [
            pytest.approx((1, 0)),
            (2, 0),
        ]

    def test_a_spline_needs_a_point(self):
        with pytest.raises(ValueError, match="at least one point"):
            swarm.Spline(())

    def test_two_consecutive_points_have_to_differ(self):
        with pytest.raises(ValueError, match=r"the same, \(1, 1\) m, .* zero length"):
            swarm.sample((0, 0), swarm.Spline(((1, 1), (1, 1), (2, 0))), 1e-3)


@pytest.mark.parametrize(
    "element",
    [swarm.Line((1, 2)), swarm.Arc((1, 2), (2, 0)), swarm.Spline(((2, 0), (3, 1), (1, 2)))],
)
class TestAnyElement:
    def test_sampling_ends_at_its_end_exactly(self, element):
        assert swarm.sample((0, 0), element, 1e-4)[-1] == (1, 2)

    def test_its_reverse_leads_back_the_same_way(self, element):
        there = [(0.0, 0.0), *swarm.sample((0, 0), element, 1e-4)]
        back = [(1.0, 2.0), *swarm.sample((1, 2), swarm.reversed_element((0, 0), element), 1e-4)]
        for first, other in zip(there, reversed(back), strict=True):
            assert first == pytest.approx(other, abs=1e-9)

    def test_it_can_be_led_to_another_end(self, element):
        assert swarm.ending_at(element, (1, 2.001)).end == (1, 2.001)
        assert swarm.ending_at(element, (1, 2)) == element

    @pytest.mark.parametrize("start", [(math.nan, 0), (0, math.inf), (2e6, 0)])
    def test_coordinates_are_finite_and_within_bounds(self, element, start):
        with pytest.raises(ValueError, match="give finite coordinates within"):
            swarm.sample(start, element, 1e-4)

    @pytest.mark.parametrize("tolerance_m", [0.0, -1.0, math.nan, math.inf, 1e-8])
    def test_the_tolerance_is_within_bounds(self, element, tolerance_m):
        with pytest.raises(ValueError, match=r"chord tolerance of .* give 1e-07 m or more"):
            swarm.sample((0, 0), element, tolerance_m)


def test_a_line_of_no_length_is_refused():
    with pytest.raises(ValueError, match="zero length"):
        swarm.sample((1, 1), swarm.Line((1, 1 + 1e-7)), 1e-3)


@pytest.mark.parametrize(
    "element", [swarm.Arc((9e5, 0), (0, 9e5)), swarm.Spline(((0, 9e5), (9e5, 0), (0, -9e5)))]
)
def test_a_curve_that_needs_too_many_chords_is_refused(element):
    with pytest.raises(ValueError, match=f"{MAX_CHORDS} are the most; give a coarser"):
        swarm.sample((-9e5, 0), element, 1e-7)


@given(points, st.floats(-7, 1))
@example((0.0, 0.0), -6.0)
def test_a_small_element_is_sampled_or_refused_in_words(start, exponent):
    size_m = 10.0**exponent
    through = (start[0] + size_m, start[1])
    end = (start[0] + size_m, start[1] + size_m)
    for element in (swarm.Line(end), swarm.Arc(end, through), swarm.Spline((through, end))):
        if size_m < 2e-6:
            with contextlib.suppress(ValueError):
                swarm.sample(start, element, 1e-5)
        else:
            assert swarm.sample(start, element, 1e-5)[-1] == end
