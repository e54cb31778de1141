"""Table 1 of Veeramani and Muthuswamy (2022) as printed, against rotated triangles."""

import cmath
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skillplan_swarmitfix import SWING_ACTIONS, Bench, Direction, Turn
from yaml_data import yaml_data

PAGE = Path(__file__).parents[3] / "docs" / "explanation" / "reproduction.md"
FACTS: dict[str, Any] = yaml_data(Path(__file__).parent / "data" / "bench.yaml")["actions"]
BENCH = Bench(rows=6, cols=13, pitch_m=0.34)
CW, CCW = Direction.CW, Direction.CCW
PRINTED = {
    "B1": (Turn(1, CCW, 60), Turn(2, CCW, 180), +13),
    "B2": (Turn(3, CW, 120), Turn(2, CCW, 120), +14),
    "B3": (Turn(2, CW, 60), Turn(2, CCW, 60), +1),
    "B4": (Turn(2, CW, 120), Turn(3, CCW, 120), -12),
    "B5": (Turn(2, CCW, 180), Turn(1, CW, 60), -13),
    "B6": (Turn(2, CCW, 120), Turn(1, CW, 120), -14),
    "B7": (Turn(1, CW, 60), Turn(1, CCW, 60), -1),
    "B8": (Turn(1, CCW, 120), Turn(2, CW, 120), +12),
    "B9": (Turn(1, CW, 60), Turn(1, CCW, 120), -2),
    "B10": (Turn(3, CCW, 120), Turn(3, CW, 120), +2),
}
"""Rows of the table: swings of even and of odd positions, and the offset of the number."""


def rotate_in_the_plane(turn: Turn, position: int) -> int:
    """Rotate the triangle about its leg in floating point; return the offset of its number."""
    x_m, y_m = BENCH.pins_m[BENCH.legs[position, turn.leg - 1]]
    pivot = complex(x_m, y_m)
    sign = 1 if turn.direction is CCW else -1
    arm = complex(*BENCH.centroids_m[position]) - pivot
    end = pivot + arm * cmath.exp(1j * sign * math.radians(turn.angle_deg))
    off_m = np.hypot(*(BENCH.centroids_m - [end.real, end.imag]).T)
    assert off_m.min() < 1e-9
    return int(off_m.argmin()) - position


def rotated_offsets(turn: Turn, *, odd: bool) -> set[int]:
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
        assert rotated_offsets(Turn(even.leg, even.direction, 120), odd=False) == {offset}

    @pytest.mark.parametrize("action", SWING_ACTIONS[:10], ids=lambda action: f"B{action.number}")
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
