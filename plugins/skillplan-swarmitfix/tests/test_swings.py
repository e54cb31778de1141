"""Turns about a docked leg in whole numbers, and the actions that are made of them."""

import cmath
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from yaml_data import yaml_data

TABLE: dict[str, Any] = yaml_data(Path(__file__).parent / "data" / "bench.yaml")
COLS = 13

numbers = st.integers(-1000, 1000)
points = st.tuples(numbers, numbers)
turns = st.sampled_from(swarm.ALL_TURNS)
opposite = {swarm.Direction.CW: swarm.Direction.CCW, swarm.Direction.CCW: swarm.Direction.CW}


def plane(point: swarm.Axial) -> complex:
    """Return where axial coordinates lie in the plane, in pitches."""
    return point[0] + point[1] * cmath.exp(1j * math.pi / 3)


class TestRotation:
    @given(points, st.integers(-12, 12))
    def test_it_is_that_of_the_plane(self, point, sixths):
        turned = plane(point) * cmath.exp(1j * sixths * math.pi / 3)
        assert plane(swarm.rotated(point, sixths)) == pytest.approx(turned, abs=1e-9)

    @given(points, st.integers(-12, 12))
    def test_the_same_back_leads_back(self, point, sixths):
        assert swarm.rotated(swarm.rotated(point, sixths), -sixths) == point

    def test_headings_follow_each_other_counter_clockwise(self):
        assert [swarm.rotated((1, 0), sixths) for sixths in range(6)] == list(swarm.HEADINGS)


class TestTriangles:
    @given(points, st.booleans(), st.permutations(range(3)))
    def test_a_triangle_is_known_wherever_it_lies(self, by, up, order):
        """One line up is one row less; half a pitch is one column."""
        given_ = [(a + by[0], b + by[1]) for a, b in (swarm.corners(up)[leg] for leg in order)]
        row, col, points_up = swarm.triangle_at(given_)
        left = min(plane(point).real for point in given_)
        assert (row, points_up) == (-by[1], up)
        assert col == round(2 * left)

    @pytest.mark.parametrize(
        "wrong", [[(0, 0), (1, 0), (2, 0)], [(0, 0), (0, 2), (2, 0)], [(0, 0), (1, 0)], []]
    )
    def test_other_points_are_no_triangle(self, wrong):
        with pytest.raises(ValueError, match="not the corners of a triangle of side 1"):
            swarm.triangle_at(wrong)


class TestTurns:
    def test_all_turns_are_each_leg_direction_and_angle_once(self):
        assert (
            len(set(swarm.ALL_TURNS))
            == len(swarm.ALL_TURNS)
            == len(swarm.LEGS) * 2 * len(swarm.ANGLES_DEG)
            == 30
        )
        assert [turn.angle_deg for turn in swarm.ALL_TURNS] == sorted(
            turn.angle_deg for turn in swarm.ALL_TURNS
        )

    @given(turns, st.booleans())
    def test_turning_on_to_a_full_turn_leads_to_the_same_place(self, turn, up):
        other = swarm.Turn(turn.leg, opposite[turn.direction], 360 - turn.angle_deg)
        assert turn.shift(up) == other.shift(up)

    @given(turns, st.booleans())
    def test_an_odd_number_of_sixths_turns_the_triangle_over(self, turn, up):
        """So that a position's parity changes with 60, 180 and 300 degrees."""
        rows, cols = turn.shift(up)
        assert (rows + cols) % 2 == turn.sixths % 2
        assert (rows, cols) != (0, 0)

    @given(turns, st.booleans())
    def test_free_legs_sweep_one_heading_more_than_they_are_apart(self, turn, up):
        swept = turn.swept_headings(up)
        assert len(swept) == min(6, abs(turn.sixths) + 2)
        assert list(swept) == sorted(set(swept))

    def test_it_reads_as_in_the_table(self):
        assert str(swarm.Turn(3, swarm.Direction.CW, 120)) == "leg 3 CW 120"

    def test_counter_clockwise_is_positive(self):
        assert swarm.Turn(1, swarm.Direction.CCW, 120).sixths == 2
        assert swarm.Turn(1, swarm.Direction.CW, 300).sixths == -5

    @pytest.mark.parametrize("leg", [0, 4])
    def test_a_base_has_three_legs(self, leg):
        with pytest.raises(ValueError, match=f"legs 1, 2 and 3, not {leg}"):
            swarm.Turn(leg, swarm.Direction.CW, 60)

    @pytest.mark.parametrize("angle_deg", [0, -60, 90, 360])
    def test_legs_only_dock_after_multiples_of_60_degrees(self, angle_deg):
        with pytest.raises(ValueError, match=f"60, 120, 180, 240, 300 degrees, not by {angle_deg}"):
            swarm.Turn(1, swarm.Direction.CW, angle_deg)


class TestActions:
    def test_b1_to_b10_are_those_of_the_corrected_table(self):
        assert [action.number for action in swarm.SWING_ACTIONS] == list(range(1, 13))
        for action in swarm.SWING_ACTIONS[:10]:
            facts = TABLE["actions"][f"B{action.number}"]
            for parity, turn in (("even", action.even), ("odd", action.odd)):
                printed = facts[parity]
                assert turn == swarm.Turn(
                    printed["leg"], swarm.Direction(printed["dir"]), printed["deg"]
                )
                rows, cols = turn.shift(parity == "odd")
                assert rows * COLS + cols == facts["offset"]

    @pytest.mark.parametrize("number", [11, 12])
    @pytest.mark.parametrize("up", [False, True], ids=["even", "odd"])
    def test_b11_and_b12_lead_where_the_paper_says_by_the_least_angle(self, number, up):
        """It is 180 degrees about the one pin that both positions share, in either direction."""
        turn = swarm.SWING_ACTIONS[number - 1].turn(up)
        rows, cols = turn.shift(up)
        offset = TABLE["actions"][f"B{number}"]["offset_odd" if up else "offset_even"]
        assert rows * COLS + cols == offset
        leading_there = [other for other in swarm.ALL_TURNS if other.shift(up) == (rows, cols)]
        assert {other.angle_deg for other in leading_there} == {180}
        assert {other.leg for other in leading_there} == {turn.leg}
        assert turn in leading_there

    @pytest.mark.parametrize("up", [False, True], ids=["even", "odd"])
    def test_no_two_actions_lead_to_the_same_position(self, up):
        shifts = {action.turn(up).shift(up) for action in swarm.SWING_ACTIONS}
        assert len(shifts) == 12
        assert shifts == {turn.shift(up) for turn in swarm.ALL_TURNS}

    @pytest.mark.parametrize("action", swarm.SWING_ACTIONS, ids=lambda action: f"B{action.number}")
    def test_each_action_swings_by_the_least_angle_that_leads_there(self, action):
        for up in (False, True):
            turn = action.turn(up)
            minimum = min(
                other.angle_deg for other in swarm.ALL_TURNS if other.shift(up) == turn.shift(up)
            )
            assert turn.angle_deg == minimum

    @pytest.mark.parametrize("number", [0, 13])
    def test_there_is_no_other_action_that_swings(self, number):
        turn = swarm.Turn(1, swarm.Direction.CW, 60)
        with pytest.raises(ValueError, match=f"B1 to B12, not B{number}"):
            swarm.SwingAction(number, turn, turn)


class TestSwing:
    def test_it_knows_its_turn(self):
        swing = swarm.Swing(2, 3, 8, swarm.Direction.CW, 120, 65, 53)
        assert swing.turn == swarm.Turn(3, swarm.Direction.CW, 120)

    @pytest.mark.parametrize(
        ("changed", "message"),
        [
            ({"action": 0}, "B1 to B12, not B0"),
            ({"action": 13}, "B1 to B12, not B13"),
            ({"leg": 4}, "legs 1, 2 and 3, not 4"),
            ({"angle_deg": 90}, "not by 90"),
            ({"pivot": -1}, "counted from 0"),
            ({"start": -1}, "counted from 0"),
            ({"end": -1}, "counted from 0"),
            ({"end": 65}, "leads to another position"),
        ],
    )
    def test_what_is_no_swing_is_refused(self, changed, message):
        values: dict[str, Any] = {
            "action": 2,
            "leg": 3,
            "pivot": 8,
            "direction": swarm.Direction.CW,
            "angle_deg": 120,
            "start": 65,
            "end": 53,
        }
        with pytest.raises(ValueError, match=message):
            swarm.Swing(**{**values, **changed})


# Table 1 of Veeramani and Muthuswamy (2022) as printed, against rotated triangles.


PAGE = Path(__file__).parents[3] / "docs" / "explanation" / "reproduction.md"
FACTS: dict[str, Any] = yaml_data(Path(__file__).parent / "data" / "bench.yaml")["actions"]
BENCH = swarm.Bench(rows=6, cols=13, pitch_m=0.34)
CW, CCW = swarm.Direction.CW, swarm.Direction.CCW
PRINTED = {
    "B1": (swarm.Turn(1, CCW, 60), swarm.Turn(2, CCW, 180), +13),
    "B2": (swarm.Turn(3, CW, 120), swarm.Turn(2, CCW, 120), +14),
    "B3": (swarm.Turn(2, CW, 60), swarm.Turn(2, CCW, 60), +1),
    "B4": (swarm.Turn(2, CW, 120), swarm.Turn(3, CCW, 120), -12),
    "B5": (swarm.Turn(2, CCW, 180), swarm.Turn(1, CW, 60), -13),
    "B6": (swarm.Turn(2, CCW, 120), swarm.Turn(1, CW, 120), -14),
    "B7": (swarm.Turn(1, CW, 60), swarm.Turn(1, CCW, 60), -1),
    "B8": (swarm.Turn(1, CCW, 120), swarm.Turn(2, CW, 120), +12),
    "B9": (swarm.Turn(1, CW, 60), swarm.Turn(1, CCW, 120), -2),
    "B10": (swarm.Turn(3, CCW, 120), swarm.Turn(3, CW, 120), +2),
}
"""Rows of the table: swings of even and of odd positions, and the offset of the number."""


def rotate_in_the_plane(turn: swarm.Turn, position: int) -> int:
    """Rotate the triangle about its leg in floating point; return the offset of its number."""
    x_m, y_m = BENCH.pins_m[BENCH.legs[position, turn.leg - 1]]
    pivot = complex(x_m, y_m)
    sign = 1 if turn.direction is CCW else -1
    arm = complex(*BENCH.centroids_m[position]) - pivot
    end = pivot + arm * cmath.exp(1j * sign * math.radians(turn.angle_deg))
    off_m = np.hypot(*(BENCH.centroids_m - [end.real, end.imag]).T)
    assert off_m.min() < 1e-9
    return int(off_m.argmin()) - position


def rotated_offsets(turn: swarm.Turn, *, odd: bool) -> set[int]:
    """Collect the offsets of a swing over all interior positions, by both ways of rotating."""
    interior = [row * 13 + col for row in range(1, 5) for col in range(2, 11)]
    starts = [position for position in interior if BENCH.is_up(position) == odd]
    assert len(starts) == 18
    ends = [BENCH.turned(start, turn) for start in starts]
    offsets = {end - start for start, end in zip(starts, ends, strict=True) if end is not None}
    assert offsets == {rotate_in_the_plane(turn, start) for start in starts}
    return offsets


def errata_of_the_page() -> dict[str, tuple[str, str, str, str]]:
    rows = re.findall(
        r"^\| (B\d+) \| (.*) \| (.*) \| (.*) \| (.*) \|$", PAGE.read_text("utf-8"), re.M
    )
    return {action: tuple(cells) for action, *cells in rows}  # type: ignore[misc]


class TestPrintedTable:
    def test_the_page_lists_every_offset_that_both_swings_contradict(self):
        wrong = {}
        for action, (even, odd, printed) in PRINTED.items():
            leads_to = rotated_offsets(even, odd=False), rotated_offsets(odd, odd=True)
            (geometric,) = leads_to[1]
            if geometric != printed:
                assert leads_to == ({geometric}, {geometric})
                cells = f"b_curr{printed:+d}", f"b_curr{geometric:+d}"
                wrong[action] = ("both", "next position", *cells)
        assert wrong | {"B9": ("even", "angle", "60 deg", "120 deg")} == errata_of_the_page()

    def test_the_even_swing_of_b9_is_that_of_b7_and_right_with_120_degrees(self):
        even, _, offset = PRINTED["B9"]
        assert even == PRINTED["B7"][0]
        assert rotated_offsets(even, odd=False) == {-1}
        assert rotated_offsets(swarm.Turn(even.leg, even.direction, 120), odd=False) == {offset}

    @pytest.mark.parametrize(
        "action", swarm.SWING_ACTIONS[:10], ids=lambda action: f"B{action.number}"
    )
    def test_the_actions_in_use_are_the_printed_swings_except_b9(self, action):
        even, odd, _ = PRINTED[f"B{action.number}"]
        assert action.odd == odd
        assert (action.even == even) == (action.number != 9)
        assert rotated_offsets(action.even, odd=False) == {FACTS[f"B{action.number}"]["offset"]}

    def test_b2_as_printed_would_lead_from_home_beyond_the_bench(self):
        """Fig. 7a finds it the best action in C66, but there is no C80."""
        even, _, offset = PRINTED["B2"]
        home = BENCH.position("C66")
        assert home + offset >= BENCH.n_positions
        assert BENCH.turned(home, even) == BENCH.position("C54")
