"""Table 1 of the paper as printed, and what in it cannot be, found by rotating every row.

Veeramani and Muthuswamy 2022, Table 1 ("Actions and locomotion mapping"), gives each action twice:
as a swing (leg, direction, angle), for even and for odd positions, and as an offset of the
position's number, which both are to lead to. Rotating the triangle says where a swing really leads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.bench.swings import ALL_TURNS, Direction, Turn

Parity = Literal["even", "odd"]
PARITIES: tuple[Parity, Parity] = ("even", "odd")

PRINTED_BENCH = Bench(rows=6, cols=13, pitch_m=0.34)
"""The bench that the table is for; its pitch does not matter here."""

_CW, _CCW = Direction.CW, Direction.CCW


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row of Table 1.

    Parameters
    ----------
    action
        Its name, B1 to B10; B0 stays and has no swing.
    even, odd
        The swing of a downward (even) and of an upward (odd) triangle.
    offset
        What is added to the position's number, from -14 to 14 and not 0.

    Raises
    ------
    ValueError
        If the offset is out of range.
    """

    action: str
    even: Turn
    odd: Turn
    offset: int

    def __post_init__(self) -> None:
        if not 1 <= abs(self.offset) <= PRINTED_BENCH.cols + 1:
            raise ValueError(f"{self.action} leads to a neighbour, not to {shown(self.offset)}.")

    def turn(self, parity: Parity) -> Turn:
        """Return the swing of even or odd positions."""
        return self.even if parity == "even" else self.odd


PRINTED_TABLE: tuple[TableRow, ...] = (
    TableRow("B1", Turn(1, _CCW, 60), Turn(2, _CCW, 180), +13),
    TableRow("B2", Turn(3, _CW, 120), Turn(2, _CCW, 120), +14),
    TableRow("B3", Turn(2, _CW, 60), Turn(2, _CCW, 60), +1),
    TableRow("B4", Turn(2, _CW, 120), Turn(3, _CCW, 120), -12),
    TableRow("B5", Turn(2, _CCW, 180), Turn(1, _CW, 60), -13),
    TableRow("B6", Turn(2, _CCW, 120), Turn(1, _CW, 120), -14),
    TableRow("B7", Turn(1, _CW, 60), Turn(1, _CCW, 60), -1),
    TableRow("B8", Turn(1, _CCW, 120), Turn(2, _CW, 120), +12),
    TableRow("B9", Turn(1, _CW, 60), Turn(1, _CCW, 120), -2),
    TableRow("B10", Turn(3, _CCW, 120), Turn(3, _CW, 120), +2),
)
"""The table's rows B1 to B10, errors and all."""


@dataclass(frozen=True, slots=True)
class Erratum:
    """A cell of the table that disagrees with the rest of its row.

    Parameters
    ----------
    action
        Name of the row, such as ``B9``.
    parity
        Whose swing it is, ``even`` or ``odd``; ``both`` for the shared column.
    column
        ``next position``, ``leg``, ``direction`` or ``angle``; ``swing`` where the disagreement
        is not that of a single cell.
    printed
        What stands there.
    geometric
        What makes the row agree; never the same as printed.
    note
        How that is known, in words.

    Raises
    ------
    ValueError
        If there is nothing to correct.
    """

    action: str
    parity: Literal["even", "odd", "both"]
    column: Literal["next position", "leg", "direction", "angle", "swing"]
    printed: str
    geometric: str
    note: str

    def __post_init__(self) -> None:
        if self.printed == self.geometric:
            raise ValueError(f"{self.action} is printed as it is by geometry: {self.printed}.")


def shown(offset: int) -> str:
    """Return an offset as the table prints it, such as ``b_curr+13``."""
    return f"b_curr{offset:+d}" if offset else "b_curr"


def rotated_offset(bench: Bench, turn: Turn, parity: Parity) -> int:
    """Return what a swing really adds to a position's number.

    It is rotated in every position of the parity in which it stays on the bench.

    Raises
    ------
    ValueError
        If it leaves the bench everywhere.
    """
    first = 1 if parity == "even" else 0
    ends = ((at, bench.turned(at, turn)) for at in range(first, bench.n_positions, 2))
    offsets = {end - start for start, end in ends if end is not None}
    if not offsets:
        raise ValueError(
            f"From every {parity} position {turn} leaves a bench of {bench.rows} x {bench.cols}; "
            "take a larger one."
        )
    (offset,) = offsets
    return offset


def table_errata(
    table: Sequence[TableRow] = PRINTED_TABLE, bench: Bench = PRINTED_BENCH
) -> tuple[Erratum, ...]:
    """Return every cell of a table like Table 1 that rotation refutes.

    Where the swings of both parities lead to the same offset, it is the printed one that is
    wrong if it is another. Where they do not, a swing that does not lead to the printed offset is
    wrong, and the cell is named whose change alone puts it right; swings are of half a turn at
    most.

    Parameters
    ----------
    table
        Rows B1 to B10; the paper's by default.
    bench
        Of at least 2 rows and of 13 columns, for which the offsets are printed.

    Raises
    ------
    ValueError
        If the bench has other columns, or a single row.
    """
    if bench.cols != PRINTED_BENCH.cols:
        raise ValueError(f"Table 1 is for benches of 13 columns, not of {bench.cols}.")
    errata: list[Erratum] = []
    for row in table:
        leads_to = {parity: rotated_offset(bench, row.turn(parity), parity) for parity in PARITIES}
        if leads_to["even"] == leads_to["odd"]:
            if leads_to["even"] != row.offset:
                errata.append(_wrong_offset(row, leads_to["even"], bench.cols))
            continue
        errata += (
            _wrong_swing(table, row, parity, bench)
            for parity in PARITIES
            if leads_to[parity] != row.offset
        )
    return tuple(errata)


def _wrong_offset(row: TableRow, offset: int, cols: int) -> Erratum:
    """Return what is wrong with a next position that both swings contradict."""
    # Columns change by at most 2, so that the nearest multiple of the columns is the rows.
    rows = round(row.offset / cols)
    flipped = rows != 0 and offset == row.offset - 2 * rows * cols
    note = f"Both printed swings lead to {shown(offset)}."
    if flipped:
        note += (
            " The printed offset has its row direction flipped; numbers fall by 13 from a row to "
            "the one above, as in Fig. 2 from C54 to C41 to C28."
        )
    return Erratum(row.action, "both", "next position", shown(row.offset), shown(offset), note)


def _wrong_swing(table: Sequence[TableRow], row: TableRow, parity: Parity, bench: Bench) -> Erratum:
    """Return what is wrong with a swing that does not lead where the row says."""
    printed = row.turn(parity)
    leads_to = rotated_offset(bench, printed, parity)
    note = f"The printed swing leads to {shown(leads_to)}, not to {shown(row.offset)}."
    twins = [
        other.action
        for other in table
        if other.action != row.action and other.turn(parity) == printed
    ]
    if twins:
        note = f"The printed swing equals that of {', '.join(twins)}. " + note
    # The table never turns by more than half a turn: a smaller one reaches the same.
    others = [
        turn
        for turn in ALL_TURNS
        if turn.angle_deg <= 180 and rotated_offset(bench, turn, parity) == row.offset
    ]
    near = [turn for turn in others if _differing(turn, printed) == 1]
    if len(near) != 1:
        fitting = " or ".join(map(str, near or others)) or "none"
        return Erratum(row.action, parity, "swing", str(printed), fitting, note)
    (right,) = near
    if right.leg != printed.leg:
        return Erratum(row.action, parity, "leg", str(printed.leg), str(right.leg), note)
    if right.direction != printed.direction:
        return Erratum(
            row.action, parity, "direction", str(printed.direction), str(right.direction), note
        )
    return Erratum(
        row.action, parity, "angle", f"{printed.angle_deg} deg", f"{right.angle_deg} deg", note
    )


def _differing(one: Turn, other: Turn) -> int:
    """Return in how many cells two swings differ."""
    return (
        (one.leg != other.leg)
        + (one.direction != other.direction)
        + (one.angle_deg != other.angle_deg)
    )
