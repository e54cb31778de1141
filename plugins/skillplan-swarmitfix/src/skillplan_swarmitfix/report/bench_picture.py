"""The bench from above as a picture that stands without a script: who stands where, in order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from skillplan.views.pictures.drawing import (
    SERIES,
    SMALL_PX,
    Disc,
    Drawing,
    Item,
    Label,
    Look,
    Point,
    Shape,
    arrow,
    rectangle,
    text_width_px,
)
from skillplan.views.pictures.step_numbers import NUMBER_PX, number_rows
from skillplan_swarmitfix.bench.bench import Bench

_WIDTH_PX, _MARGIN_PX, _LEGEND_PX = 960.0, 20.0, 40.0
# What is shown round the outermost pins [m].
_RIM_M = 0.12
_HEAD_PX, _NAME_PX = 5.0, 9.5


def bench_picture(name: str, bench: Bench, known: Mapping[str, Any]) -> tuple[Drawing, str]:
    """Return the bench with what moves on it, and its caption.

    Parameters
    ----------
    name
        Of the task.
    bench
        The lattice.
    known
        What the domain says of the solved file.
    """
    picture = _BenchPicture(bench, known)
    if known.get("robots"):
        items, words = picture.fleet(known["robots"]), "The path of each base, from dot to arrow."
    else:
        items = picture.walk(known.get("goals") or (), known.get("timeline") or ())
        words = "The bench from above; a number stands where the base holds that support."
    drawn = (*picture.ground(), *items)
    return Drawing(_WIDTH_PX, picture.height_px, f"Bench of {name} from above", drawn), words


class _BenchPicture:
    def __init__(self, bench: Bench, known: Mapping[str, Any]) -> None:
        self.bench = bench
        self.points_m = [
            (float(x), float(y)) for x, y in (known.get("workpiece") or {}).get("points_m", ())
        ]
        shown = [*bench.pins_m.tolist(), *self.points_m]
        self.low = [min(point[axis] for point in shown) - _RIM_M for axis in (0, 1)]
        self.high = [max(point[axis] for point in shown) + _RIM_M for axis in (0, 1)]
        self.scale = (_WIDTH_PX - 2 * _MARGIN_PX) / (self.high[0] - self.low[0])
        self.foot_px = 2 * _MARGIN_PX + self.scale * (self.high[1] - self.low[1])
        self.height_px = self.foot_px + _LEGEND_PX

    def ground(self) -> Iterator[Item]:
        """Yield the pins and the trajectory."""
        for number, (x, y) in enumerate(self.bench.pins_m.tolist(), start=1):
            yield Disc(self._pixels((x, y)), 3.0, Look("faint", "muted", 0.8), f"P{number}")
        if len(self.points_m) > 1:
            line = tuple(map(self._pixels, self.points_m))
            yield Shape(line, Look(stroke="ink", width_px=2.0), closed=False, title="trajectory")

    def walk(
        self, goals: Sequence[Mapping[str, Any]], timeline: Sequence[Mapping[str, Any]]
    ) -> Iterator[Item]:
        """Yield the way of a base, its heads, and which of them it holds from where."""
        for phase in timeline:
            swing = phase.get("swing")
            if swing:
                ends = self._at(swing["start"]), self._at(swing["end"])
                yield Shape(ends, Look(stroke="muted", dashed=True), closed=False)
        stands: dict[str, list[int]] = {}
        for goal in goals:
            stands.setdefault(goal["goal"], []).append(int(goal["sequence"]))
            yield from self._held(goal, SERIES[list(stands).index(goal["goal"]) % len(SERIES)])
        ends_at = {self._at(stand): numbers for stand, numbers in stands.items()}
        names = {self._at(stand): stand for stand in stands}
        rows = number_rows(ends_at, (_WIDTH_PX, self.foot_px))
        for row in rows:
            yield from row.leader()
        for row in rows:
            yield from row.items(f"{names[row.at]}: supports {', '.join(map(str, row.numbers))}")
            below = (row.centre[0], row.centre[1] + NUMBER_PX + 7)
            yield Label(below, names[row.at], "muted", _NAME_PX, halo=True)
        yield from self._legend()

    def _held(self, goal: Mapping[str, Any], role: str) -> Iterator[Item]:
        """Yield the head of a support, with a line from where the base holds it."""
        spots = goal.get("support_m")
        if not spots:
            return
        x, y = self._pixels(spots[0])
        reach = goal.get("pkm") or {}
        beyond = reach.get("status") == "infeasible"
        look = Look(stroke=role, width_px=1.4, dashed=beyond)
        yield Shape((self._at(goal["goal"]), (x, y)), look, closed=False)
        box = rectangle(x - _HEAD_PX, y - _HEAD_PX, x + _HEAD_PX, y + _HEAD_PX)
        why = f": {reach['reason']}" if beyond else ""
        words = f"support {goal['sequence']} from {goal['goal']}{why}"
        yield Shape(box, Look("paper" if beyond else role, role, 1.4), title=words)

    def fleet(self, robots: Sequence[Mapping[str, Any]]) -> Iterator[Item]:
        """Yield the path of every base, a little beside those of the others."""
        for number, robot in enumerate(robots):
            role = SERIES[number % len(SERIES)]
            aside_px = 3.0 * (number - (len(robots) - 1) / 2)
            points = [self._at(stand) for stand in robot["path"]] or [self._at(robot["start"])]
            points = [(x + aside_px, y + aside_px) for x, y in points]
            title = f"{robot['robot']}: {' '.join(robot['path'])}"
            yield Disc(points[0], 5.0, Look(role), title)
            look = Look(stroke=role, width_px=2.0)
            for begin, end in pairwise(points):
                yield from arrow(begin, end, look, short_px=3.0)
            words = f"{robot['robot']}, {robot['start']} to {robot['goal']}"
            x, y = points[0]
            half_px = text_width_px(words, SMALL_PX) / 2 + 8
            middle = min(max(x, half_px), _WIDTH_PX - half_px)
            beside = y - 15 if y < self.foot_px / 2 else y + 15
            yield Label((middle, beside), words, role, SMALL_PX, bold=True, halo=True)

    def _legend(self) -> Iterator[Item]:
        left, top = _MARGIN_PX, self.foot_px + 10
        box = rectangle(left, top - _HEAD_PX, left + 2 * _HEAD_PX, top + _HEAD_PX)
        for look, words in (
            (Look("blue", "blue", 1.4), "head, held from the number that its line leads to"),
            (Look("paper", "blue", 1.4), "beyond the legs of the machine"),
        ):
            yield Shape(tuple((x + left - _MARGIN_PX, y) for x, y in box), look)
            yield Label((left + 16, top), words, "muted", SMALL_PX, "start")
            left += 36 + text_width_px(words, SMALL_PX)
        line = ((left, top), (left + 18, top))
        yield Shape(line, Look(stroke="muted", dashed=True), closed=False)
        yield Label((left + 24, top), "way of the base", "muted", SMALL_PX, "start")

    def _at(self, stand: str) -> Point:
        x, y = self.bench.centroids_m[self.bench.position(stand)].tolist()
        return self._pixels((x, y))

    def _pixels(self, point: Sequence[float]) -> Point:
        x = _MARGIN_PX + self.scale * (point[0] - self.low[0])
        return (round(x, 2), round(_MARGIN_PX + self.scale * (self.high[1] - point[1]), 2))
