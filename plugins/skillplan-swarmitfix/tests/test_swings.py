"""Turns about a docked leg in whole numbers, and the actions that are made of them."""

import cmath
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan_swarmitfix import (
    ALL_TURNS,
    ANGLES_DEG,
    HEADINGS,
    LEGS,
    SWING_ACTIONS,
    Axial,
    Direction,
    Swing,
    SwingAction,
    Turn,
    corners,
    rotated,
    triangle_at,
)
from yaml_data import yaml_data

TABLE: dict[str, Any] = yaml_data(Path(__file__).parent / "data" / "bench.yaml")
COLS = 13

numbers = st.integers(-1000, 1000)
points = st.tuples(numbers, numbers)
turns = st.sampled_from(ALL_TURNS)
opposite = {Direction.CW: Direction.CCW, Direction.CCW: Direction.CW}


def plane(point: Axial) -> complex:
    """Return where axial coordinates lie in the plane, in pitches."""
    return point[0] + point[1] * cmath.exp(1j * math.pi / 3)


class TestRotation:
    @given(points, st.integers(-12, 12))
    def test_it_is_that_of_the_plane(self, point, sixths):
        turned = plane(point) * cmath.exp(1j * sixths * math.pi / 3)
        assert plane(rotated(point, sixths)) == pytest.approx(turned, abs=1e-9)

    @given(points, st.integers(-12, 12))
    def test_the_same_back_leads_back(self, point, sixths):
        assert rotated(rotated(point, sixths), -sixths) == point

    def test_headings_follow_each_other_counter_clockwise(self):
        assert [rotated((1, 0), sixths) for sixths in range(6)] == list(HEADINGS)


class TestTriangles:
    @given(points, st.booleans(), st.permutations(range(3)))
    def test_a_triangle_is_known_wherever_it_lies(self, by, up, order):
        """One line up is one row less; half a pitch is one column."""
        given_ = [(a + by[0], b + by[1]) for a, b in (corners(up)[leg] for leg in order)]
        row, col, points_up = triangle_at(given_)
        left = min(plane(point).real for point in given_)
        assert (row, points_up) == (-by[1], up)
        assert col == round(2 * left)

    @pytest.mark.parametrize(
        "wrong", [[(0, 0), (1, 0), (2, 0)], [(0, 0), (0, 2), (2, 0)], [(0, 0), (1, 0)], []]
    )
    def test_other_points_are_no_triangle(self, wrong):
        with pytest.raises(ValueError, match="not the corners of a triangle of side 1"):
            triangle_at(wrong)


class TestTurns:
    def test_all_turns_are_each_leg_direction_and_angle_once(self):
        assert len(set(ALL_TURNS)) == len(ALL_TURNS) == len(LEGS) * 2 * len(ANGLES_DEG) == 30
        assert [turn.angle_deg for turn in ALL_TURNS] == sorted(
            turn.angle_deg for turn in ALL_TURNS
        )

    @given(turns, st.booleans())
    def test_turning_on_to_a_full_turn_leads_to_the_same_place(self, turn, up):
        other = Turn(turn.leg, opposite[turn.direction], 360 - turn.angle_deg)
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
        assert str(Turn(3, Direction.CW, 120)) == "leg 3 CW 120"

    def test_counter_clockwise_is_positive(self):
        assert Turn(1, Direction.CCW, 120).sixths == 2
        assert Turn(1, Direction.CW, 300).sixths == -5

    @pytest.mark.parametrize("leg", [0, 4])
    def test_a_base_has_three_legs(self, leg):
        with pytest.raises(ValueError, match=f"legs 1, 2 and 3, not {leg}"):
            Turn(leg, Direction.CW, 60)

    @pytest.mark.parametrize("angle_deg", [0, -60, 90, 360])
    def test_legs_only_dock_after_multiples_of_60_degrees(self, angle_deg):
        with pytest.raises(ValueError, match=f"60, 120, 180, 240, 300 degrees, not by {angle_deg}"):
            Turn(1, Direction.CW, angle_deg)


class TestActions:
    def test_b1_to_b10_are_those_of_the_corrected_table(self):
        assert [action.number for action in SWING_ACTIONS] == list(range(1, 13))
        for action in SWING_ACTIONS[:10]:
            facts = TABLE["actions"][f"B{action.number}"]
            for parity, turn in (("even", action.even), ("odd", action.odd)):
                printed = facts[parity]
                assert turn == Turn(printed["leg"], Direction(printed["dir"]), printed["deg"])
                rows, cols = turn.shift(parity == "odd")
                assert rows * COLS + cols == facts["offset"]

    @pytest.mark.parametrize("number", [11, 12])
    @pytest.mark.parametrize("up", [False, True], ids=["even", "odd"])
    def test_b11_and_b12_lead_where_the_paper_says_by_the_least_angle(self, number, up):
        """It is 180 degrees about the one pin that both positions share, in either direction."""
        turn = SWING_ACTIONS[number - 1].turn(up)
        rows, cols = turn.shift(up)
        offset = TABLE["actions"][f"B{number}"]["offset_odd" if up else "offset_even"]
        assert rows * COLS + cols == offset
        leading_there = [other for other in ALL_TURNS if other.shift(up) == (rows, cols)]
        assert {other.angle_deg for other in leading_there} == {180}
        assert {other.leg for other in leading_there} == {turn.leg}
        assert turn in leading_there

    @pytest.mark.parametrize("up", [False, True], ids=["even", "odd"])
    def test_no_two_actions_lead_to_the_same_position(self, up):
        shifts = {action.turn(up).shift(up) for action in SWING_ACTIONS}
        assert len(shifts) == 12
        assert shifts == {turn.shift(up) for turn in ALL_TURNS}

    @pytest.mark.parametrize("action", SWING_ACTIONS, ids=lambda action: f"B{action.number}")
    def test_each_action_swings_by_the_least_angle_that_leads_there(self, action):
        for up in (False, True):
            turn = action.turn(up)
            minimum = min(
                other.angle_deg for other in ALL_TURNS if other.shift(up) == turn.shift(up)
            )
            assert turn.angle_deg == minimum

    @pytest.mark.parametrize("number", [0, 13])
    def test_there_is_no_other_action_that_swings(self, number):
        turn = Turn(1, Direction.CW, 60)
        with pytest.raises(ValueError, match=f"B1 to B12, not B{number}"):
            SwingAction(number, turn, turn)


class TestSwing:
    def test_it_knows_its_turn(self):
        swing = Swing(2, 3, 8, Direction.CW, 120, 65, 53)
        assert swing.turn == Turn(3, Direction.CW, 120)

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
            "direction": Direction.CW,
            "angle_deg": 120,
            "start": 65,
            "end": 53,
        }
        with pytest.raises(ValueError, match=message):
            Swing(**{**values, **changed})
