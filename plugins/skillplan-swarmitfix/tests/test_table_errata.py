"""The paper's Table 1 as printed, against rotation."""

import cmath
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.bench.swings import ALL_TURNS, SWING_ACTIONS, Direction, Turn
from skillplan_swarmitfix.bench.table_errata import (
    PARITIES,
    PRINTED_BENCH,
    PRINTED_TABLE,
    Erratum,
    Parity,
    TableRow,
    rotated_offset,
    shown,
    table_errata,
)
from yaml_data import yaml_data

FACTS: dict[str, Any] = yaml_data(Path(__file__).parent / "data" / "bench.yaml")["actions"]
CORRECT = tuple(
    TableRow(f"B{action.number}", action.even, action.odd, FACTS[f"B{action.number}"]["offset"])
    for action in SWING_ACTIONS[:10]
)
INTERIOR = [row * 13 + col for row in range(1, 5) for col in range(2, 11)]


def offset_in_the_plane(turn: Turn, position: int) -> int:
    """Rotate the triangle about its leg in floating point, and see whose centroid it has."""
    bench = PRINTED_BENCH
    x_m, y_m = bench.pins_m[bench.legs[position, turn.leg - 1]]
    pivot = complex(x_m, y_m)
    sign = 1 if turn.direction is Direction.CCW else -1
    centroid = complex(*bench.centroids_m[position]) - pivot
    there = pivot + centroid * cmath.exp(1j * sign * math.radians(turn.angle_deg))
    off_m = np.hypot(*(bench.centroids_m - [there.real, there.imag]).T)
    assert off_m.min() < 1e-9
    return int(off_m.argmin()) - position


class TestPrintedTable:
    def test_the_row_direction_of_six_offsets_is_flipped_and_one_angle_is_wrong(self) -> None:
        """Exactly these, and no others."""
        found = {(e.action, e.parity, e.column, e.printed, e.geometric) for e in table_errata()}
        assert found == {
            ("B1", "both", "next position", "b_curr+13", "b_curr-13"),
            ("B2", "both", "next position", "b_curr+14", "b_curr-12"),
            ("B4", "both", "next position", "b_curr-12", "b_curr+14"),
            ("B5", "both", "next position", "b_curr-13", "b_curr+13"),
            ("B6", "both", "next position", "b_curr-14", "b_curr+12"),
            ("B8", "both", "next position", "b_curr+12", "b_curr-14"),
            ("B9", "even", "angle", "60 deg", "120 deg"),
        }
        assert len(table_errata()) == 7

    def test_the_notes_say_how_it_is_known(self) -> None:
        notes = {erratum.action: erratum.note for erratum in table_errata()}
        assert all("row direction flipped" in notes[f"B{n}"] for n in (1, 2, 4, 5, 6, 8))
        assert "Both printed swings lead to b_curr-12" in notes["B2"]
        assert "equals that of B7" in notes["B9"]
        assert "leads to b_curr-1, not to b_curr-2" in notes["B9"]

    @pytest.mark.parametrize("parity", PARITIES)
    def test_every_printed_swing_has_its_offset_at_every_interior_position(
        self, parity: Parity
    ) -> None:
        """Rotated in floating point as well; only B9's even swing is not as corrected."""
        starts = [at for at in INTERIOR if PRINTED_BENCH.is_up(at) == (parity == "odd")]
        assert len(starts) == 18
        for row in PRINTED_TABLE:
            turn = row.turn(parity)
            (offset,) = {offset_in_the_plane(turn, at) for at in starts}
            assert offset == rotated_offset(PRINTED_BENCH, turn, parity)
            wrong = (row.action, parity) == ("B9", "even")
            assert offset == (-1 if wrong else FACTS[row.action]["offset"])

    def test_other_rows_agree_with_the_actions_in_use(self) -> None:
        differing = [
            (printed.action, parity)
            for printed, correct in zip(PRINTED_TABLE, CORRECT, strict=True)
            for parity in PARITIES
            if printed.turn(parity) != correct.turn(parity)
        ]
        assert differing == [("B9", "even")]

    def test_b2_as_printed_would_lead_from_home_beyond_the_bench(self) -> None:
        """Though Fig. 7a finds it the best action in C66: there is no C80."""
        (b2,) = (row for row in PRINTED_TABLE if row.action == "B2")
        home = PRINTED_BENCH.position("C66")
        assert home + b2.offset >= PRINTED_BENCH.n_positions
        assert PRINTED_BENCH.turned(home, b2.even) == PRINTED_BENCH.position("C54")

    @pytest.mark.parametrize("rows", [2, 3, 40])
    def test_the_number_of_rows_does_not_matter(self, rows: int) -> None:
        assert table_errata(bench=Bench(rows, 13, 1.0)) == table_errata()


class TestOtherTables:
    def test_the_corrected_table_has_no_errata(self) -> None:
        assert table_errata(CORRECT) == ()

    @given(st.integers(0, 9), st.integers(-14, 14).filter(bool))
    def test_a_changed_offset_is_found(self, index: int, offset: int) -> None:
        row = CORRECT[index]
        errata = table_errata([replace(row, offset=offset)])
        if offset == row.offset:
            assert errata == ()
            return
        (erratum,) = errata
        assert (erratum.parity, erratum.column) == ("both", "next position")
        assert (erratum.printed, erratum.geometric) == (shown(offset), shown(row.offset))

    @given(st.integers(0, 9), st.sampled_from(ALL_TURNS))
    def test_a_changed_swing_is_found_and_what_puts_it_right_is_told(
        self, index: int, turn: Turn
    ) -> None:
        row = CORRECT[index]
        errata = table_errata([replace(row, even=turn)])
        if rotated_offset(PRINTED_BENCH, turn, "even") == row.offset:
            assert errata == ()
            return
        (erratum,) = errata
        assert erratum.parity == "even"
        cells = {
            "leg": (str(turn.leg), {"leg": int}),
            "direction": (str(turn.direction), {"direction": Direction}),
            "angle": (f"{turn.angle_deg} deg", {"angle_deg": lambda text: int(text[:-4])}),
            "swing": (str(turn), {}),
        }
        printed, field = cells[erratum.column]
        assert erratum.printed == printed
        for name, read in field.items():
            right = replace(turn, **{name: read(erratum.geometric)})
            assert table_errata([replace(row, even=right)]) == ()
        if erratum.column == "swing":
            texts = {str(one): one for one in ALL_TURNS}
            for text in erratum.geometric.split(" or "):
                assert table_errata([replace(row, even=texts[text])]) == ()

    def test_each_column_of_a_swing_can_be_to_blame(self) -> None:
        b2, b3 = CORRECT[1], CORRECT[2]
        turns = {
            "leg": replace(b2.even, leg=2),
            "direction": replace(b2.even, direction=Direction.CCW),
            "angle": replace(b2.even, angle_deg=180),
        }
        for column, turn in turns.items():
            (erratum,) = table_errata([replace(b2, even=turn)])
            assert erratum.column == column
        (erratum,) = table_errata([replace(b3, even=Turn(1, Direction.CCW, 120))])
        assert erratum.column == "swing"

    def test_a_row_that_agrees_with_no_neighbour_has_no_remedy(self) -> None:
        """Both swings are at odds with the printed offset and with each other."""
        b9 = PRINTED_TABLE[8]
        errata = table_errata([replace(b9, offset=5)])
        assert [(e.parity, e.column, e.geometric) for e in errata] == [
            ("even", "swing", "none"),
            ("odd", "swing", "none"),
        ]


class TestRefusals:
    def test_the_offsets_are_for_13_columns(self) -> None:
        with pytest.raises(ValueError, match="benches of 13 columns, not of 15"):
            table_errata(bench=Bench(6, 15, 0.34))

    def test_one_row_is_too_few_to_rotate_every_swing(self) -> None:
        with pytest.raises(ValueError, match="leaves a bench of 1 x 13; take a larger one"):
            table_errata(bench=Bench(1, 13, 0.34))

    @pytest.mark.parametrize("offset", [0, 15, -15])
    def test_a_row_leads_to_a_neighbour(self, offset: int) -> None:
        with pytest.raises(ValueError, match="B1 leads to a neighbour"):
            replace(PRINTED_TABLE[0], offset=offset)

    def test_an_erratum_corrects_something(self) -> None:
        with pytest.raises(ValueError, match="B9 is printed as it is by geometry: 60 deg"):
            Erratum("B9", "even", "angle", "60 deg", "60 deg", "")

    def test_staying_is_shown_without_a_number(self) -> None:
        assert (shown(0), shown(2), shown(-14)) == ("b_curr", "b_curr+2", "b_curr-14")
