"""A triangular lattice of docking pins, its triangles, and the names of both.

Veeramani and Muthuswamy 2022, section 4.1.2 and Fig. 2: a position of the base is a triangle of
three neighbouring pins. Lines of pins run along x; the far line has y = 0 and holds P1. Rows of
positions are counted from the opposite side, C1 being the first of those with the greatest y.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.bench.swings import HEADINGS

# Pins and positions are kept in 32 bits.
_MAX_POSITIONS = 2_000_000_000


@dataclass(frozen=True)
class PinLattice:
    """Pins on the corners of equilateral triangles, in rows of any number and length.

    Positions and pins are counted from 0; their names, C1 and P1, from 1. An odd number of columns
    makes odd names the upward triangles in every row. Arrays are computed when first needed,
    and are read-only.

    Parameters
    ----------
    rows
        Rows of triangles, >= 1; the paper's bench has 6.
    cols
        Triangles in a row, odd, >= 1; the paper's bench has 13.
    pitch_m
        Distance of neighbouring pins [m], > 0.

    Raises
    ------
    ValueError
        If a parameter is out of its range.
    """

    rows: int
    cols: int
    pitch_m: float

    def __post_init__(self) -> None:
        if self.rows < 1:
            raise ValueError(f"A bench needs at least one row of triangles, not {self.rows}.")
        if self.cols < 1:
            raise ValueError(f"A bench needs at least one column of triangles, not {self.cols}.")
        if self.cols % 2 == 0:
            raise ValueError(
                f"A bench needs an odd number of columns, not {self.cols}: with an even one, odd "
                f"positions would not point up in every row. Take {self.cols - 1} or "
                f"{self.cols + 1}."
            )
        if self.n_positions > _MAX_POSITIONS:
            raise ValueError(
                f"{self.rows} x {self.cols} positions are too many; at most {_MAX_POSITIONS:,}."
            )
        if not (math.isfinite(self.pitch_m) and self.pitch_m > 0):
            raise ValueError(f"The pitch of a bench must be finite and > 0, not {self.pitch_m} m.")

    @property
    def n_positions(self) -> int:
        """Number of positions, N_b: the triangles."""
        return self.rows * self.cols

    @property
    def n_pins(self) -> int:
        """Number of docking pins, N_p."""
        return int(self._line_starts[-1])

    @property
    def n_edges(self) -> int:
        """Number of pairs of neighbouring pins, N_e.

        Each line has one less than it has pins, and each row of n triangles n + 1 between lines.
        """
        return self.n_pins - (self.rows + 1) + self.rows * (self.cols + 1)

    @cached_property
    def pins_m(self) -> NDArray[np.float64]:
        """Coordinates x, y of the pins [m], shape (pins, 2)."""
        x, y = self._pin_grid
        return read_only(
            np.stack([x * (self.pitch_m / 2), y * (self.pitch_m * math.sqrt(3) / 2)], axis=1)
        )

    @cached_property
    def legs(self) -> NDArray[np.int32]:
        """Pins of legs 1, 2, 3, shape (positions, 3).

        Of an upward triangle they are bottom-left, apex and bottom-right, of a downward one
        top-left, bottom and top-right.
        """
        row, col = np.divmod(np.arange(self.n_positions), self.cols)
        below, above = self.rows - 1 - row, self.rows - row
        outer, middle = np.where(self._up, (below, above), (above, below))
        pins = [self._pin(col, outer), self._pin(col + 1, middle), self._pin(col + 2, outer)]
        return read_only(np.stack(pins, axis=1).astype(np.int32))

    @cached_property
    def centroids_m(self) -> NDArray[np.float64]:
        """Coordinates x, y of the middle of each position [m], shape (positions, 2)."""
        return read_only(self.pins_m[self.legs].mean(axis=1))

    @cached_property
    def pin_neighbours(self) -> NDArray[np.int32]:
        """The pin next to each pin by heading, -1 where there is none; shape (pins, 6).

        Headings are those of `swings.HEADINGS`: every 60 degrees counter-clockwise from +x.
        """
        x, y = self._pin_grid
        neighbours = np.full((self.n_pins, len(HEADINGS)), -1, dtype=np.int32)
        for heading, (a, b) in enumerate(HEADINGS):
            there_x, there_y = x + 2 * a + b, y + b
            # Short lines hold only odd x, which lie within these limits as well.
            exists = (there_y >= 0) & (there_y <= self.rows)
            exists &= (there_x >= 0) & (there_x <= self.cols + 1)
            neighbours[exists, heading] = self._pin(there_x[exists], there_y[exists])
        return read_only(neighbours)

    @cached_property
    def edges(self) -> NDArray[np.int32]:
        """Pairs of neighbouring pins, the lower number first; shape (edges, 2)."""
        onward = self.pin_neighbours[:, :3]
        pins, headings = np.nonzero(onward >= 0)
        return read_only(np.stack([pins.astype(np.int32), onward[pins, headings]], axis=1))

    def name(self, position: int) -> str:
        """Return a position's name, such as ``C66``; ValueError if it is not on the bench."""
        self._check("Position", position, self.n_positions)
        return f"C{position + 1}"

    def pin_name(self, pin: int) -> str:
        """Return a pin's name, such as ``P9``; ValueError if it is not on the bench."""
        self._check("Pin", pin, self.n_pins)
        return f"P{pin + 1}"

    def position(self, name: str) -> int:
        """Return the position of a name.

        Raises
        ------
        ValueError
            If the bench has no position of that name.
        """
        found = re.fullmatch(r"[Cc]0*([0-9]{1,18})", name, re.ASCII)
        number = int(found[1]) if found else 0
        if name == f"C{number}" and 1 <= number <= self.n_positions:
            return number - 1
        hint = ""
        if found:
            hint = f" Did you mean 'C{min(max(number, 1), self.n_positions)}'?"
        raise ValueError(
            f"There is no position {name!r} on a bench of {self.rows} x {self.cols}, which has C1 "
            f"to C{self.n_positions}.{hint}"
        )

    def is_up(self, position: int) -> bool:
        """Whether a triangle points up, as those of odd names do (positions from 0: even ones)."""
        self._check("Position", position, self.n_positions)
        return bool(position % 2 == 0)

    @cached_property
    def _up(self) -> NDArray[np.bool_]:
        up: NDArray[np.bool_] = np.arange(self.n_positions) % 2 == 0
        return up

    @cached_property
    def _line_starts(self) -> NDArray[np.int64]:
        """First pin of every line from y = 0 upwards, and the number of pins at the end."""
        lines = np.arange(self.rows + 1)
        lengths = (self.cols + 3) // 2 - self._is_short(lines)
        return np.concatenate([[0], np.cumsum(lengths)])

    @cached_property
    def _pin_grid(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Coordinates of the pins: x in half pitches, y in lines."""
        lengths = np.diff(self._line_starts)
        line = np.repeat(np.arange(self.rows + 1), lengths)
        place = np.arange(self.n_pins) - self._line_starts[line]
        return 2 * place + self._is_short(line), line

    def _is_short(self, line: NDArray[np.int64]) -> NDArray[np.int64]:
        """1 for the lines that begin half a pitch further in, and so hold one pin less."""
        return (self.rows + 1 - line) % 2

    def _pin(self, x: NDArray[np.int64], line: NDArray[np.int64]) -> NDArray[np.int64]:
        return self._line_starts[line] + x // 2

    def _check(self, what: str, index: int, count: int) -> None:
        if not 0 <= index < count:
            raise ValueError(f"{what} {index} is not on the bench, which has 0 to {count - 1}.")


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array itself, which from now on refuses to be written to."""
    array.setflags(write=False)
    return array
