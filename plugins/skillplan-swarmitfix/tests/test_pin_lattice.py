"""The lattice of pins and triangles, against a table of the real bench and against geometry."""

import math
from collections.abc import Iterator
from dataclasses import FrozenInstanceError
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from skillplan_swarmitfix import HEADINGS, PinLattice
from yaml_data import yaml_data

TABLE: dict[str, Any] = yaml_data(Path(__file__).parent / "data" / "bench.yaml")
LATTICE = PinLattice(rows=6, cols=13, pitch_m=0.34)
# The table is rounded to 0.01 mm.
ROUNDED_M = 5.1e-6

odd = st.integers(0, 7).map(lambda half: 2 * half + 1)
lattices = st.builds(PinLattice, st.integers(1, 9), odd, st.floats(0.01, 10.0))


def triangles_of(lattice: PinLattice) -> Iterator[frozenset[int]]:
    """Yield every three pins that are neighbours of each other."""
    edges = {frozenset(edge) for edge in lattice.edges.tolist()}
    for pin in range(lattice.n_pins):
        beside = [other for other in lattice.pin_neighbours[pin].tolist() if other >= 0]
        for first, other in combinations(beside, 2):
            if frozenset((first, other)) in edges:
                yield frozenset((pin, first, other))


class TestPaperBench:
    def test_it_has_52_pins_129_edges_and_78_positions(self):
        assert (LATTICE.n_pins, LATTICE.n_edges, LATTICE.n_positions) == (52, 129, 78)
        assert (TABLE["pins"], TABLE["edges"], TABLE["states"]) == (52, 129, 78)

    def test_its_lines_hold_7_and_8_pins_in_turn(self):
        _, counts = np.unique(LATTICE.pins_m[:, 1].round(6), return_counts=True)
        assert counts[::-1].tolist() == TABLE["lines_top_to_bottom"]

    def test_every_pin_is_where_the_table_says(self):
        names = [LATTICE.pin_name(pin) for pin in range(LATTICE.n_pins)]
        assert names == list(TABLE["pin_xy_m"])
        assert_allclose(LATTICE.pins_m, list(TABLE["pin_xy_m"].values()), atol=ROUNDED_M, rtol=0)

    def test_every_position_is_as_the_table_says(self):
        """Its row, column, kind, legs in their order, and centroid."""
        assert len(TABLE["states_table"]) == LATTICE.n_positions
        for position, (name, facts) in enumerate(TABLE["states_table"].items()):
            assert name == LATTICE.name(position)
            assert divmod(position, LATTICE.cols) == (facts["row"] - 1, facts["col"] - 1)
            assert LATTICE.is_up(position) == (facts["kind"] == "up")
            assert [LATTICE.pin_name(pin) for pin in LATTICE.legs[position]] == facts["legs"]
            assert_allclose(
                LATTICE.centroids_m[position], facts["centroid_m"], atol=ROUNDED_M, rtol=0
            )

    def test_every_name_gives_its_position_back(self):
        for position in range(LATTICE.n_positions):
            assert LATTICE.position(LATTICE.name(position)) == position


class TestAnySize:
    @given(lattices)
    def test_eulers_relation_holds(self, lattice):
        """Eq. 5 of the paper: N_p - N_e + N_b = 1."""
        assert lattice.n_pins - lattice.n_edges + lattice.n_positions == 1

    @given(lattices)
    def test_the_numbers_are_those_of_the_arrays(self, lattice):
        assert lattice.pins_m.shape == (lattice.n_pins, 2)
        assert lattice.edges.shape == (lattice.n_edges, 2)
        assert lattice.legs.shape == (lattice.n_positions, 3)
        assert lattice.centroids_m.shape == (lattice.n_positions, 2)

    @given(lattices)
    def test_edges_are_the_pairs_of_pins_one_pitch_apart(self, lattice):
        between = lattice.pins_m[:, None] - lattice.pins_m
        length = np.hypot(between[..., 0], between[..., 1]) / lattice.pitch_m
        pairs = {(a, b) for a, b in np.argwhere(np.abs(length - 1) < 1e-9).tolist() if a < b}
        assert pairs == {(a, b) for a, b in lattice.edges.tolist()}

    @given(lattices)
    def test_positions_are_all_triangles_and_each_once(self, lattice):
        positions = [frozenset(legs) for legs in lattice.legs.tolist()]
        assert len(set(positions)) == len(positions)
        assert set(positions) == set(triangles_of(lattice))

    @given(lattices)
    def test_legs_stand_in_their_order(self, lattice):
        """From left to right, the middle one above of odd names and below of even ones."""
        for position, legs in enumerate(lattice.legs):
            (x1, y1), (x2, y2), (x3, y3) = lattice.pins_m[legs]
            assert x1 < x2 < x3
            assert y1 == y3
            assert lattice.is_up(position) == (y2 > y1) == (position % 2 == 0)

    @given(lattices)
    def test_neighbours_lie_one_pitch_off_in_their_heading(self, lattice):
        """And there is none only where no pin is."""
        assert len(HEADINGS) == 6
        for pin, (x_m, y_m) in enumerate(lattice.pins_m):
            for heading, other in enumerate(lattice.pin_neighbours[pin].tolist()):
                angle = math.radians(60 * heading)
                there = (
                    x_m + lattice.pitch_m * math.cos(angle),
                    y_m + lattice.pitch_m * math.sin(angle),
                )
                off_m = np.hypot(*(lattice.pins_m - there).T)
                if other >= 0:
                    assert off_m[other] < 1e-9
                else:
                    assert off_m.min() > 0.9 * lattice.pitch_m

    @given(lattices)
    def test_pins_are_numbered_by_lines_from_the_far_one_on(self, lattice):
        points = lattice.pins_m.tolist()
        assert points[0][1] == 0.0
        assert points == sorted(points, key=lambda point: (point[1], point[0]))
        assert min(x_m for x_m, _ in points) == 0.0

    @given(lattices)
    def test_the_pitch_only_scales(self, lattice):
        unit = PinLattice(lattice.rows, lattice.cols, 1.0)
        assert_array_equal(unit.legs, lattice.legs)
        assert_allclose(unit.pins_m * lattice.pitch_m, lattice.pins_m)


class TestArrays:
    @pytest.mark.parametrize("name", ["pins_m", "centroids_m", "legs", "edges", "pin_neighbours"])
    def test_they_are_computed_once_and_cannot_be_written_to(self, name):
        array = getattr(LATTICE, name)
        assert array is getattr(LATTICE, name)
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1

    def test_lattices_of_one_size_are_equal_and_fixed(self):
        same = PinLattice(6, 13, 0.34)
        assert same == LATTICE
        assert hash(same) == hash(LATTICE)
        with pytest.raises(FrozenInstanceError):
            same.rows = 7  # type: ignore[misc]


class TestRefusals:
    @pytest.mark.parametrize(
        ("rows", "cols", "pitch_m", "message"),
        [
            (0, 13, 0.34, "at least one row of triangles, not 0"),
            (6, -1, 0.34, "at least one column of triangles, not -1"),
            (6, 12, 0.34, "an odd number of columns, not 12: .* Take 11 or 13"),
            (100_001, 100_001, 0.34, "too many; at most 2,000,000,000"),
            (6, 13, 0.0, "finite and > 0, not 0.0 m"),
            (6, 13, math.inf, "finite and > 0, not inf m"),
            (6, 13, math.nan, "finite and > 0, not nan m"),
        ],
    )
    def test_a_size_out_of_range_is_refused(self, rows, cols, pitch_m, message):
        with pytest.raises(ValueError, match=message):
            PinLattice(rows, cols, pitch_m)

    @pytest.mark.parametrize(
        ("name", "hint"),
        [
            ("C0", "'C1'"),
            ("C79", "'C78'"),
            ("C99999999999", "'C78'"),
            ("c5", "'C5'"),
            ("C05", "'C5'"),
        ],
    )
    def test_a_name_near_one_on_the_bench_is_set_right(self, name, hint):
        with pytest.raises(ValueError, match=f"bench of 6 x 13, .* Did you mean {hint}") as raised:
            LATTICE.position(name)
        assert repr(name) in str(raised.value)

    @pytest.mark.parametrize("name", ["", "P9", "C", "C1.0", "C-1", "C1 ", "C\u0661", "home"])
    def test_any_other_name_is_told_which_there_are(self, name):
        with pytest.raises(ValueError, match=r"which has C1 to C78\.$"):
            LATTICE.position(name)

    @pytest.mark.parametrize("position", [-1, 78])
    def test_a_number_off_the_bench_is_refused(self, position):
        with pytest.raises(ValueError, match=f"Position {position} is not on .* has 0 to 77"):
            LATTICE.name(position)
        with pytest.raises(ValueError, match=f"Position {position} is not on .* has 0 to 77"):
            LATTICE.is_up(position)
        with pytest.raises(ValueError, match="Pin 52 is not on the bench, which has 0 to 51"):
            LATTICE.pin_name(52)
