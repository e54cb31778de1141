"""In which directions a part can be moved away: a row for each, with what is in its way."""

from __future__ import annotations

from skillplan.records.freedom import Freedom, Way
from skillplan.records.stored.product_relation import Obstacle
from skillplan.views.text.direction_name import direction_name
from skillplan.views.text.table import Column, Table

_MM_PER_M = 1000.0


def freedom_tables(freedom: Freedom) -> list[Table]:
    """Return the directions as a table, and below it what is in place."""
    rows = [_row(way) for way in freedom.ways]
    columns = [
        Column("direction"),
        Column("blocked by"),
        Column("after [mm]", right=True),
        Column("width [mm]", right=True),
        Column("at x y z [mm]"),
    ]
    free = [direction_name(way.direction) for way in freedom.ways if not way.obstacles]
    outcome = f"free along {', '.join(free)}" if free else "blocked in all directions"
    notes = [f"in place   {', '.join(freedom.present) or 'no other part'}"]
    if any(one.sensitive for way in freedom.ways for one in way.obstacles):
        tolerance_mm = freedom.tolerance_m * _MM_PER_M
        notes.append(f"* half or double the tolerance of {tolerance_mm:g} mm says otherwise")
    notes += [f"{what:<10} {path}" for what, path in freedom.files.items()]
    return [Table(f"{freedom.task.name}: {freedom.part} is {outcome}", columns, rows, notes)]


def _row(way: Way) -> tuple[str, ...]:
    name = direction_name(way.direction)
    if not way.obstacles:
        return (name, "nothing: free", "-", "-", "-")
    first = way.obstacles[0]
    parts = ", ".join(f"{one.part}{'*' if one.sensitive else ''}" for one in way.obstacles)
    return (name, parts, _mm(first.distance_m), _mm(first.width_m), _place(first))


def _place(obstacle: Obstacle) -> str:
    return " ".join(_mm(value) for value in obstacle.point_m)


def _mm(length_m: float) -> str:
    return f"{length_m * _MM_PER_M:.1f}"
