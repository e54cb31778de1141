"""The bench: positions on a lattice of pins that a base reaches by swings about a docked leg.

Veeramani and Muthuswamy 2022, section 4.1.2, Fig. 5 and Table 1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.bench.swings import ALL_TURNS, HEADINGS, SWING_ACTIONS, Swing, Turn

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

        In an upward triangle they are bottom-left, apex and bottom-right, in a downward one
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

        `swings.HEADINGS` defines headings: every 60 degrees counter-clockwise from +x.
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
        match = re.fullmatch(r"[Cc]0*([0-9]{1,18})", name, re.ASCII)
        number = int(match[1]) if match else 0
        if name == f"C{number}" and 1 <= number <= self.n_positions:
            return number - 1
        hint = ""
        if match:
            hint = f" Did you mean 'C{min(max(number, 1), self.n_positions)}'?"
        raise ValueError(
            f"Position {name!r} is not on a bench of {self.rows} x {self.cols}, which has C1 "
            f"to C{self.n_positions}.{hint}"
        )

    def is_up(self, position: int) -> bool:
        """Return whether a triangle points up: odd names, even positions counted from 0."""
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


@dataclass(frozen=True)
class Bench(PinLattice):
    """A lattice of docking pins of any size, and the base's actions on it.

    Parameters
    ----------
    rows, cols, pitch_m
        As in `PinLattice`: rows of triangles, triangles in a row (odd), distance of pins [m].
    actions
        11 for B0 to B10, or 13 to include B11 and B12.

    Raises
    ------
    ValueError
        If a parameter is out of its range.
    """

    actions: int = 11

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.actions not in (11, 13):
            raise ValueError(f"A base has 11 actions or, with B11 and B12, 13; not {self.actions}.")

    @cached_property
    def successors(self) -> NDArray[np.int32]:
        """Successor of each position and action, -1 off the bench; shape (positions, actions).

        The triangle is rotated about its docked leg in lattice coordinates. That moves all
        triangles of a kind by the same rows and columns, so that one of each kind is rotated, and
        what remains is which of them stay on the bench. Adding an offset to the position's number
        instead is wrong at the borders, where the sum is a position at the other end of a row.
        """
        rows, cols = self.rows, self.cols
        positions = np.arange(self.n_positions, dtype=np.int32).reshape(rows, cols)
        is_up = self._up.reshape(rows, cols)
        ends = np.full((rows, cols, self.actions), -1, dtype=np.int32)
        ends[..., 0] = positions
        for action in SWING_ACTIONS[: self.actions - 1]:
            for up in (True, False):
                down, right = action.turn(up).shift(up)
                from_rows, to_rows = _overlap(rows, down)
                from_cols, to_cols = _overlap(cols, right)
                np.copyto(
                    ends[from_rows, from_cols, action.number],
                    positions[to_rows, to_cols],
                    where=is_up[from_rows, from_cols] == up,
                )
        return read_only(ends.reshape(self.n_positions, self.actions))

    @cached_property
    def swing_deg(self) -> NDArray[np.int16]:
        """Angle of each action's swing [deg], shape (positions, actions).

        0 without a swing: for B0, and for actions that leave the bench.
        """
        swinging = SWING_ACTIONS[: self.actions - 1]
        by_kind = np.array(
            [[0, *(action.turn(up).angle_deg for action in swinging)] for up in (False, True)],
            dtype=np.int16,
        )
        angles = by_kind[self._up.astype(np.intp)]
        angles[self.successors < 0] = 0
        return read_only(angles)

    def turned(self, position: int, turn: Turn) -> int | None:
        """Return the position after any turn; None if it leaves the bench.

        Raises
        ------
        ValueError
            If the position is not on the bench.
        """
        down, right = turn.shift(self.is_up(position))
        row, col = divmod(int(position), self.cols)
        row, col = row + down, col + right
        on_bench = 0 <= row < self.rows and 0 <= col < self.cols
        return row * self.cols + col if on_bench else None

    def swing(self, position: int, action: int) -> Swing | None:
        """Return the swing that an action makes; None for B0, or if it leaves the bench.

        Raises
        ------
        ValueError
            If position or action do not exist.
        """
        up = self.is_up(position)
        if not 0 <= action < self.actions:
            raise ValueError(
                f"Action {action} does not exist; the actions are B0 to B{self.actions - 1}."
            )
        if action == 0:
            return None
        turn = SWING_ACTIONS[action - 1].turn(up)
        end = self.turned(position, turn)
        return None if end is None else self._swing(action, turn, position, end)

    def swings_between(self, start: int, end: int) -> tuple[Swing, ...]:
        """Return every swing from one position to another, actions or not.

        Two for each pin that the positions share, one in either direction. Table 1 makes one of
        them its action: from C54 to C41 B1 turns about P16, whereas Fig. 2 shows the one about P17.

        Returns
        -------
        tuple
            The smaller angles first; empty if the positions are one or share no pin.

        Raises
        ------
        ValueError
            If a position is not on the bench.
        """
        self._check("Position", end, self.n_positions)
        turns = [turn for turn in ALL_TURNS if self.turned(start, turn) == end]
        if not turns:
            return ()
        up = self.is_up(start)
        (number,) = (
            action.number for action in SWING_ACTIONS if self.turned(start, action.turn(up)) == end
        )
        return tuple(self._swing(number, turn, start, end) for turn in turns)

    def swept_pins(self, position: int, action: int) -> frozenset[int]:
        """Return the pins that an action passes over, which no other base may use meanwhile.

        Returns
        -------
        frozenset
            The pivot and the neighbours that the two free legs pass between their old
            and new pins; for B0 the pins of the position itself.

        Raises
        ------
        ValueError
            If position or action do not exist, or the action leaves the bench.
        """
        swing = self.swing(position, action)
        if swing is None:
            if action:
                raise ValueError(f"B{action} leaves the bench in {self.name(position)}.")
            return frozenset(self.legs[position].tolist())
        return self.swept_by(swing)

    def swept_by(self, swing: Swing) -> frozenset[int]:
        """Return the pins that a swing passes over, as `swept_pins` does of an action."""
        neighbours = self.pin_neighbours[swing.pivot].tolist()
        headings = swing.turn.swept_headings(self.is_up(swing.start))
        passed = (neighbours[heading] for heading in headings)
        return frozenset([swing.pivot, *(pin for pin in passed if pin >= 0)])

    def distances(self, goal: int) -> NDArray[np.int32]:
        """Return the fewest swings from every position to a goal, shape (positions,).

        Breadth-first search from the goal, a whole frontier at a time. Every swing can be undone
        by one action, so that paths from the goal are as long as paths to it; and all positions are
        connected. The cost grows linearly with the number of positions.

        Raises
        ------
        ValueError
            If the goal is not on the bench.
        """
        self._check("Position", goal, self.n_positions)
        distances = np.full(self.n_positions, -1, dtype=np.int32)
        last_found_as = np.empty(self.n_positions, dtype=np.int32)
        distances[goal] = swings = 0
        frontier = np.array([goal], dtype=np.int32)
        while frontier.size:
            swings += 1
            successors = self.successors[frontier, 1:].ravel()
            successors = successors[successors >= 0]
            successors = successors[distances[successors] < 0]
            distances[successors] = swings
            # Of several swings into a position the last one counts, which needs no sorting.
            order = np.arange(successors.size, dtype=np.int32)
            last_found_as[successors] = order
            frontier = successors[last_found_as[successors] == order]
        return distances

    def _swing(self, action: int, turn: Turn, start: int, end: int) -> Swing:
        pivot = int(self.legs[start, turn.leg - 1])
        return Swing(
            int(action), turn.leg, pivot, turn.direction, turn.angle_deg, int(start), int(end)
        )


def _overlap(size: int, shift: int) -> tuple[slice, slice]:
    """Return the source and target slices of a shift that stays within a size."""
    stay = max(0, size - abs(shift))
    first, then = max(0, -shift), max(0, shift)
    return slice(first, first + stay), slice(then, then + stay)


_SWING_S = MappingProxyType({60: 7.47, 120: 11.63, 180: 15.80, 240: 19.97, 300: 24.13})


@dataclass(frozen=True, slots=True)
class Timings:
    """Durations of the five steps.

    The durations of swings come from the real machine's plans (2012). For the PKM these give
    only 0.75 to 1.62 s for a whole reposition; the shares of its steps are our choice, such that
    a reposition lies in that range both without parking (1.05 s) and with it (1.50 s).

    Parameters
    ----------
    swing_s
        Duration by the angle of the swing [deg] [s], each > 0.
    retract_s, park_s, approach_s, support_s
        Durations of the other steps [s], each >= 0.

    Raises
    ------
    ValueError
        If a duration is out of range or not finite, or the swing is missing.
    """

    swing_s: Mapping[int, float] = field(default_factory=lambda: _SWING_S, hash=False)
    retract_s: float = 0.30
    park_s: float = 0.45
    approach_s: float = 0.45
    support_s: float = 0.30

    def __post_init__(self) -> None:
        if not self.swing_s:
            raise ValueError("Timings swing_s needs at least one angle.")
        for angle_deg, duration_s in self.swing_s.items():
            if not (math.isfinite(duration_s) and duration_s > 0):
                raise ValueError(
                    f"Timings swing_s of {angle_deg} degrees must be finite and > 0, "
                    f"not {duration_s}."
                )
        for name in ("retract_s", "park_s", "approach_s", "support_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"Timings {name} must be finite and >= 0, not {value}.")

    def of_swing(self, angle_deg: int) -> float:
        """Return the duration of a swing by an angle [deg] in seconds.

        Raises
        ------
        ValueError
            If no duration is given for the angle.
        """
        if angle_deg not in self.swing_s:
            known = ", ".join(map(str, sorted(self.swing_s)))
            raise ValueError(f"Timings know no swing of {angle_deg} degrees; they know {known}.")
        return self.swing_s[angle_deg]
