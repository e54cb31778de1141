"""The bench: where the base gets to on a lattice of pins by swings about a docked leg.

Veeramani and Muthuswamy 2022, section 4.1.2, Fig. 5 and Table 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.bench.pin_lattice import PinLattice, read_only
from skillplan_swarmitfix.bench.swings import ALL_TURNS, SWING_ACTIONS, Swing, Turn


@dataclass(frozen=True)
class Bench(PinLattice):
    """A lattice of docking pins of any size, and the base's actions on it.

    Parameters
    ----------
    rows, cols, pitch_m
        As in `PinLattice`: rows of triangles, triangles in a row (odd), distance of pins [m].
    actions
        11 for B0 to B10, or 13 for B11 and B12 besides.

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
        """Where each action leads, -1 where it leaves the bench; shape (positions, actions).

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

        0 where there is no swing: of B0, and where the action leaves the bench.
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
        """Return where a turn leads, be it an action or not; None if it leaves the bench.

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
            raise ValueError(f"There is no action {action}; there are B0 to B{self.actions - 1}.")
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
            The pivot and those of its neighbours that the two free legs pass, from where they
            were docked to where they will be; those of the position itself for B0.

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
            found = self.successors[frontier, 1:].ravel()
            found = found[found >= 0]
            found = found[distances[found] < 0]
            distances[found] = swings
            # Of several swings into a position the last one counts, which needs no sorting.
            order = np.arange(found.size, dtype=np.int32)
            last_found_as[found] = order
            frontier = found[last_found_as[found] == order]
        return distances

    def _swing(self, action: int, turn: Turn, start: int, end: int) -> Swing:
        pivot = int(self.legs[start, turn.leg - 1])
        return Swing(
            int(action), turn.leg, pivot, turn.direction, turn.angle_deg, int(start), int(end)
        )


def _overlap(size: int, shift: int) -> tuple[slice, slice]:
    """Return from where and to where a shift stays within a size."""
    stay = max(0, size - abs(shift))
    first, then = max(0, -shift), max(0, shift)
    return slice(first, first + stay), slice(then, then + stay)
