"""Swings on the bench, against rotation in the plane."""

import cmath
import math
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from skillplan_swarmitfix import ALL_TURNS, SWING_ACTIONS, Bench, Direction, Swing, Turn

PAPER = Bench(rows=6, cols=13, pitch_m=0.34)
FULL = Bench(rows=6, cols=13, pitch_m=0.34, actions=13)

odd = st.integers(0, 6).map(lambda half: 2 * half + 1)
benches = st.builds(Bench, st.integers(1, 8), odd, st.floats(0.01, 10.0), st.sampled_from([11, 13]))


@st.composite
def standing(draw: st.DrawFn) -> tuple[Bench, int]:
    """Draw a bench and a position on it."""
    bench = draw(benches)
    return bench, draw(st.integers(0, bench.n_positions - 1))


def plane(bench: Bench, pin: int) -> complex:
    """Return a pin's place in pitches."""
    return complex(*bench.pins_m[pin]) / bench.pitch_m


def pins_near(bench: Bench, point: complex) -> list[int]:
    """Return the pin at a point, given in pitches, or none."""
    x_m, y_m = point.real * bench.pitch_m, point.imag * bench.pitch_m
    off_m = np.hypot(bench.pins_m[:, 0] - x_m, bench.pins_m[:, 1] - y_m)
    return [int(pin) for pin in np.flatnonzero(off_m < 1e-6 * bench.pitch_m)]


def rotated_pins(bench: Bench, position: int, turn: Turn, sixths: int) -> list[int]:
    """Return the pins below the legs after some sixths of a turn, by floating point rotation."""
    pivot = plane(bench, bench.legs[position, turn.leg - 1])
    step = 1 if turn.direction is Direction.CCW else -1
    turned = cmath.exp(1j * math.pi / 3 * step * sixths)
    return [
        pin
        for leg in bench.legs[position]
        for pin in pins_near(bench, pivot + (plane(bench, leg) - pivot) * turned)
    ]


def position_on(bench: Bench, pins: list[int]) -> int | None:
    """Return the position whose legs stand on these pins; None if there is none."""
    standing_on = np.sort(bench.legs, axis=1)
    if len(pins) < 3:
        return None
    (result,) = np.flatnonzero((standing_on == sorted(pins)).all(axis=1)).tolist()
    return int(result)


def turn_of(bench: Bench, position: int, action: int) -> Turn:
    return SWING_ACTIONS[action - 1].turn(bench.is_up(position))


class TestSuccessors:
    @given(standing())
    def test_an_action_leads_where_the_rotated_triangle_is(self, at):
        """And nowhere if a leg would stand beside the bench."""
        bench, position = at
        for action in range(1, bench.actions):
            turn = turn_of(bench, position, action)
            pins = rotated_pins(bench, position, turn, turn.angle_deg // 60)
            end = position_on(bench, pins)
            assert bench.successors[position, action] == (-1 if end is None else end)

    @given(benches)
    def test_b0_stays_everywhere(self, bench):
        assert_array_equal(bench.successors[:, 0], np.arange(bench.n_positions))
        assert not bench.swing_deg[:, 0].any()

    @given(standing())
    def test_the_arrays_say_the_same_as_the_swings(self, at):
        bench, position = at
        for action in range(bench.actions):
            swing = bench.swing(position, action)
            if swing is None:
                assert action == 0 or bench.successors[position, action] == -1
                assert bench.swing_deg[position, action] == 0
            else:
                assert bench.successors[position, action] == swing.end
                assert bench.swing_deg[position, action] == swing.angle_deg
                assert (swing.start, swing.action) == (position, action)
                assert swing.turn == turn_of(bench, position, action)

    @given(standing())
    def test_a_swing_keeps_its_pivot_docked(self, at):
        bench, position = at
        for action in range(1, bench.actions):
            swing = bench.swing(position, action)
            if swing is not None:
                assert bench.legs[position, swing.leg - 1] == swing.pivot
                assert swing.pivot in bench.legs[swing.end]

    @given(standing())
    def test_the_twelve_swings_reach_exactly_what_shares_a_pin(self, at):
        """Not 13 others, as the paper's section 4.1.2 has it: the thirteenth action is to stay."""
        bench, position = at
        full = Bench(bench.rows, bench.cols, bench.pitch_m, actions=13)
        ends = [end for end in full.successors[position, 1:].tolist() if end >= 0]
        sharing = np.isin(full.legs, full.legs[position]).any(axis=1)
        assert sorted(ends) == [p for p in np.flatnonzero(sharing).tolist() if p != position]

    @given(standing())
    def test_every_swing_can_be_undone_by_an_action(self, at):
        bench, position = at
        for end in bench.successors[position, 1:].tolist():
            assert end < 0 or position in bench.successors[end, 1:].tolist()

    def test_adding_offsets_to_numbers_would_be_wrong_fifty_times(self):
        """At the ends of rows, where the sum is a position that the base cannot swing to."""
        wrong = 0
        inside = PAPER.position("C33"), PAPER.position("C34")
        for position in range(PAPER.n_positions):
            like = inside[position % 2]
            for action in range(1, PAPER.actions):
                added = position + int(PAPER.successors[like, action]) - like
                if 0 <= added < PAPER.n_positions:
                    wrong += PAPER.successors[position, action] != added
        assert wrong == 50

    @pytest.mark.parametrize("name", ["successors", "swing_deg"])
    def test_the_arrays_cannot_be_written_to(self, name):
        assert getattr(PAPER, name) is getattr(PAPER, name)
        with pytest.raises(ValueError, match="read-only"):
            getattr(PAPER, name)[0, 0] = 1

    def test_eleven_actions_are_the_first_of_thirteen(self):
        assert_array_equal(PAPER.successors, FULL.successors[:, :11])
        assert_array_equal(PAPER.swing_deg, FULL.swing_deg[:, :11])

    def test_b11_and_b12_can_be_had_by_two_other_actions(self):
        """The paper's reason to leave them out (section 4.1.2); it holds at the borders as well."""
        for position in range(FULL.n_positions):
            for end in FULL.successors[position, 11:].tolist():
                assert end < 0 or PAPER.distances(end)[position] == 2


class TestSwingsBetween:
    @given(standing(), st.data())
    def test_they_are_all_swings_that_lead_there(self, at, data):
        """Two for each shared pin: one in either direction, together a full turn."""
        bench, start = at
        end = data.draw(st.integers(0, bench.n_positions - 1))
        swings = bench.swings_between(start, end)
        shared = set(bench.legs[start].tolist()) & set(bench.legs[end].tolist())
        if start == end:
            assert swings == ()
            return
        assert sorted(swing.pivot for swing in swings) == sorted([*shared, *shared])
        for swing in swings:
            pins = rotated_pins(bench, start, swing.turn, swing.angle_deg // 60)
            assert position_on(bench, pins) == end == swing.end
        for pin in shared:
            first, other = (swing for swing in swings if swing.pivot == pin)
            assert first.direction != other.direction
            assert first.angle_deg + other.angle_deg == 360
        angles = [swing.angle_deg for swing in swings]
        assert angles == sorted(angles)

    @given(standing())
    def test_an_action_is_among_them_and_gives_them_its_number(self, at):
        bench, position = at
        for action in range(1, bench.actions):
            swing = bench.swing(position, action)
            if swing is not None:
                between = bench.swings_between(position, swing.end)
                assert swing in between
                assert {other.action for other in between} == {action}

    @given(standing())
    def test_every_swing_has_an_inverse(self, at):
        """About the same pin by the same angle in the other direction."""
        bench, position = at
        for turn in ALL_TURNS:
            end = bench.turned(position, turn)
            if end is None:
                continue
            pivot = bench.legs[position, turn.leg - 1]
            (back,) = (
                swing
                for swing in bench.swings_between(end, position)
                if (swing.pivot, swing.angle_deg) == (pivot, turn.angle_deg)
                and swing.direction != turn.direction
            )
            assert bench.turned(end, back.turn) == position

    def test_actions_beyond_the_eleven_are_named_all_the_same(self):
        swings = PAPER.swings_between(PAPER.position("C33"), PAPER.position("C44"))
        assert {swing.action for swing in swings} == {11}

    def test_figure_2_is_walked_by_swings_about_its_pins(self):
        """Table 1's B1 turns about P16 from C54 to C41, Fig. 2 about P17; both are swings."""
        way = [PAPER.position(name) for name in ("C66", "C54", "C41", "C28", "C16")]
        pivots = ["P9", "P17", "P24", "P32"]
        actions, docked = [], []
        for (start, end), pivot in zip(pairwise(way), pivots, strict=True):
            swings = PAPER.swings_between(start, end)
            assert pivot in {PAPER.pin_name(swing.pivot) for swing in swings}
            actions.append(swings[0].action)
            own = PAPER.swing(start, swings[0].action)
            assert own is not None
            assert own.end == end
            docked.append(PAPER.pin_name(own.pivot))
        assert actions == [2, 1, 1, 2]
        assert docked == ["P9", "P16", "P24", "P32"]
        about_p17 = Swing(
            action=1,
            leg=3,
            pivot=16,
            direction=Direction.CW,
            angle_deg=60,
            start=PAPER.position("C54"),
            end=PAPER.position("C41"),
        )
        assert about_p17 in PAPER.swings_between(about_p17.start, about_p17.end)


class TestSweptPins:
    @given(standing())
    def test_they_are_the_pins_below_the_legs_on_the_way(self, at):
        """Of every position between, in the direction of the swing, on the bench or half off it."""
        bench, position = at
        for action in range(1, bench.actions):
            swing = bench.swing(position, action)
            if swing is None:
                continue
            below = {
                pin
                for sixths in range(swing.angle_deg // 60 + 1)
                for pin in rotated_pins(bench, position, swing.turn, sixths)
            }
            assert bench.swept_pins(position, action) == below

    @given(standing(), st.sampled_from(ALL_TURNS))
    def test_both_ways_round_sweep_all_around_the_pivot(self, at, turn):
        bench, position = at
        end = bench.turned(position, turn)
        if end is None:
            return
        pivot = int(bench.legs[position, turn.leg - 1])
        swept = frozenset[int]().union(
            *(bench.swept_by(s) for s in bench.swings_between(position, end) if s.pivot == pivot)
        )
        around = [pin for pin in bench.pin_neighbours[pivot].tolist() if pin >= 0]
        assert swept == {pivot, *around}

    @given(standing())
    def test_b0_sweeps_exactly_its_three_docked_pins(self, at):
        bench, position = at
        assert bench.swept_pins(position, 0) == set(bench.legs[position].tolist())
        assert len(bench.swept_pins(position, 0)) == 3

    def test_a_swing_of_the_paper_sweeps_what_it_passes(self):
        """B2 from C66 about P9 clockwise: its legs pass from P8 and P1 to P16 and P17."""
        swept = PAPER.swept_pins(PAPER.position("C66"), 2)
        assert {PAPER.pin_name(pin) for pin in swept} == {"P9", "P1", "P8", "P16", "P17"}

    def test_an_action_that_leaves_the_bench_has_no_swept_pins(self):
        with pytest.raises(ValueError, match="B1 leaves the bench in C1"):
            PAPER.swept_pins(PAPER.position("C1"), 1)


class TestRefusals:
    @pytest.mark.parametrize("actions", [0, 10, 12, 14])
    def test_a_base_has_11_or_13_actions(self, actions):
        with pytest.raises(ValueError, match=f"B11 and B12, 13; not {actions}"):
            Bench(6, 13, 0.34, actions)

    def test_a_bench_is_checked_as_its_lattice_is(self):
        with pytest.raises(ValueError, match="odd number of columns, not 12"):
            Bench(6, 12, 0.34)

    @pytest.mark.parametrize("position", [-1, 78])
    def test_a_position_off_the_bench_is_refused(self, position):
        match = f"Position {position} is not on the bench, which has 0 to 77"
        with pytest.raises(ValueError, match=match):
            PAPER.swing(position, 1)
        with pytest.raises(ValueError, match=match):
            PAPER.swept_pins(position, 0)
        with pytest.raises(ValueError, match=match):
            PAPER.turned(position, ALL_TURNS[0])
        with pytest.raises(ValueError, match=match):
            PAPER.distances(position)
        with pytest.raises(ValueError, match=match):
            PAPER.swings_between(0, position)
        with pytest.raises(ValueError, match=match):
            PAPER.swings_between(position, 0)

    @pytest.mark.parametrize("action", [-1, 11])
    def test_an_action_that_the_base_does_not_have_is_refused(self, action):
        with pytest.raises(
            ValueError, match=f"Action {action} does not exist; the actions are B0 to B10"
        ):
            PAPER.swing(0, action)
        with pytest.raises(
            ValueError, match=f"Action {action} does not exist; the actions are B0 to B10"
        ):
            PAPER.swept_pins(0, action)


# How many swings positions are apart.


odd_benches = st.builds(Bench, st.integers(1, 8), odd, st.just(1.0), st.sampled_from([11, 13]))


@st.composite
def goals(draw: st.DrawFn) -> tuple[Bench, int]:
    """Draw a bench and a position on it."""
    bench = draw(odd_benches)
    return bench, draw(st.integers(0, bench.n_positions - 1))


class TestDistances:
    @pytest.mark.parametrize(("bench", "diameter"), [(PAPER, 9), (FULL, 8)], ids=["11", "13"])
    def test_the_diameter_of_the_papers_bench(self, bench, diameter):
        """Over all 6006 pairs of positions."""
        distances = np.array([bench.distances(goal) for goal in range(bench.n_positions)])
        assert np.count_nonzero(distances > 0) == 6006
        assert distances.max() == diameter
        assert_array_equal(distances, distances.T)

    @given(goals())
    def test_they_are_those_of_a_search_step_by_step(self, to):
        """Backwards along the swings that lead into a position."""
        bench, goal = to
        into: dict[int, list[int]] = {position: [] for position in range(bench.n_positions)}
        for start, end in zip(
            np.repeat(np.arange(bench.n_positions), bench.actions).tolist(),
            bench.successors.ravel().tolist(),
            strict=True,
        ):
            if end >= 0:
                into[end].append(start)
        expected, queue = {goal: 0}, deque([goal])
        while queue:
            here = queue.popleft()
            for before in into[here]:
                if before not in expected:
                    expected[before] = expected[here] + 1
                    queue.append(before)
        assert len(expected) == bench.n_positions, "all positions are connected"
        assert bench.distances(goal).tolist() == [expected[p] for p in range(bench.n_positions)]

    @given(goals())
    def test_one_swing_changes_them_by_one_at_most(self, to):
        bench, goal = to
        distances = bench.distances(goal)
        ends = bench.successors
        change = np.abs(distances[ends] - distances[:, None])[ends >= 0]
        assert change.max() <= 1
        assert np.flatnonzero(distances == 0).tolist() == [goal]

    @pytest.mark.slow(reason="the largest bench; smaller ones in every run")
    def test_a_bench_of_780600_positions_is_searched_whole(self):
        """From a corner; a swing gains two columns at most and one row at most."""
        bench = Bench(rows=600, cols=1301, pitch_m=0.34)
        distances = bench.distances(0)
        assert distances.shape == (780_600,)
        assert distances.min() == 0
        row, col = np.divmod(np.arange(bench.n_positions), bench.cols)
        assert (distances >= row).all()
        assert (2 * distances >= col).all()
        assert distances[col == 1300].min() == 650
        assert distances[row == 599].min() == 599
