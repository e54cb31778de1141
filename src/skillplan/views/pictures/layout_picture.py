"""The cell from above: where parts lie and go, the path of the plan, and how far the arm reaches.

x is to the right and y up, as a reader of the task file expects.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

from skillplan.task.pose import Pose
from skillplan.task.scene import Robot
from skillplan.task.task import Task
from skillplan.views.figures.label_placement import LabelPlacer
from skillplan.views.pictures.drawing import (
    PIXELS_PER_IN,
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
from skillplan.views.pictures.outlines import outlines
from skillplan.views.pictures.plan_places import path_steps
from skillplan.views.pictures.step_numbers import NUMBER_PX, number_rows

_MARGIN_PX = 26.0
_LEGEND_PX = 44.0
_MOST_HEIGHT_PX = 900.0
# The base, and the rim of the reach, are shown where that makes the cell no smaller than this.
_LEAST_SHARE = 0.65
_STATION_PX = 13.0
_NAME_PX = 11.0


def layout_picture(task: Task, skills: Sequence[str], width_px: float = 960.0) -> Drawing:
    """Return the cell of a task from above, with the path of a plan.

    Parameters
    ----------
    task
        With a robot and bodies.
    skills
        Of the plan; none for the cell alone.
    width_px
        How wide the picture is.

    Raises
    ------
    ValueError
        If the task has no robot.
    """
    if not task.scene.robots:
        raise ValueError("A layout needs a robot.")
    return _Layout(task, skills, width_px).drawing()


class _Layout:
    """What the layers of one picture share."""

    def __init__(self, task: Task, skills: Sequence[str], width_px: float) -> None:
        self.task, self.scene = task, task.scene
        self.robot: Robot = task.scene.robots[0]
        self.steps = path_steps(task, skills)
        self.skills = skills
        self.starts = task.scene.at(task.initial)
        self.goals = task.scene.at(task.goal.requires)
        self.low, self.high = self._extent()
        wide_m, tall_m = self.high[0] - self.low[0], self.high[1] - self.low[1]
        room = width_px - 2 * _MARGIN_PX
        self.scale = min(room / wide_m, (_MOST_HEIGHT_PX - 2 * _MARGIN_PX) / tall_m)
        self.width_px = width_px
        self.height_px = self.scale * tall_m + 2 * _MARGIN_PX + _LEGEND_PX
        self.left = (width_px - self.scale * wide_m) / 2
        self.placer = LabelPlacer(width_px / PIXELS_PER_IN, self.height_px / PIXELS_PER_IN)

    def drawing(self) -> Drawing:
        """Return the whole picture."""
        numbers = [*self._numbers()]
        labels = [*self._names()]
        items: list[Item] = [
            *self._reach(),
            *self._footprints(self.starts, dashed=True),
            *self._footprints(self.goals, dashed=False),
            *self._stations(),
            *self._path(),
            *numbers,
            *labels,
            *self._legend(),
        ]
        title = f"Cell of {self.task.name} from above"
        return Drawing(self.width_px, self.height_px, title, tuple(items))

    def _pixels(self, point: Sequence[float]) -> Point:
        x = self.left + self.scale * (point[0] - self.low[0])
        return (x, _MARGIN_PX + self.scale * (self.high[1] - point[1]))

    def _extent(self) -> tuple[Point, Point]:
        """Return the corners of what is shown [m]."""
        points: list[Point] = []
        for poses in (self.starts, self.goals):
            for name, pose in poses.items():
                points += [p for one in outlines(self.scene.body(name), pose) for p in one]
        points += [(x, y) for x, y, _ in self.scene.stations.values()]
        points += [stop for step in self.steps for stop in step.stops]
        if not points:
            points = [(x, y) for x, y, _ in self.robot.places.values()]
        low, high = _bounds(points)
        base = (self.robot.base[0], self.robot.base[1])
        middle = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
        away = math.dist(base, middle) or 1.0
        rim = tuple(
            b + (m - b) * self.robot.reach_m / away for b, m in zip(base, middle, strict=True)
        )
        longest = max(high[0] - low[0], high[1] - low[1])
        for extra in (base, (rim[0], rim[1])):
            wider = _bounds([*points, extra])
            if longest >= _LEAST_SHARE * max(wider[1][0] - wider[0][0], wider[1][1] - wider[0][1]):
                points.append(extra)
        low, high = _bounds(points)
        pad = 0.05 * max(high[0] - low[0], high[1] - low[1], 0.1)
        return (low[0] - pad, low[1] - pad), (high[0] + pad, high[1] + pad)

    def _reach(self) -> Iterator[Item]:
        """Yield the rim of the reach where it is in the picture, and the base."""
        x, y = self.robot.base[0], self.robot.base[1]
        piece: list[Point] = []
        look = Look(stroke="muted", dashed=True, width_px=1.2)
        for turn in range(721):
            angle = math.pi * turn / 360
            point = (
                x + self.robot.reach_m * math.cos(angle),
                y + self.robot.reach_m * math.sin(angle),
            )
            if self._shows(point):
                piece.append(self._pixels(point))
            elif piece:
                if len(piece) > 1:
                    yield Shape(tuple(piece), look, closed=False)
                piece = []
        if len(piece) > 1:
            yield Shape(tuple(piece), look, closed=False)
        if self._shows((x, y)):
            centre = self._pixels((x, y))
            yield Disc(centre, 15, Look("faint", "muted"), f"base of {self.robot.name}")
            yield Disc(centre, 5, Look("muted"))

    def _shows(self, point: Point) -> bool:
        inside = zip(self.low, point, self.high, strict=True)
        return all(low <= value <= high for low, value, high in inside)

    def _role(self, name: str) -> str:
        bodies = [body.name for body in self.scene.bodies]
        return SERIES[bodies.index(name) % len(SERIES)]

    def _footprints(self, poses: Mapping[str, Pose], *, dashed: bool) -> Iterator[Item]:
        """Yield bodies from above, lower ones first."""
        for name, pose in sorted(poses.items(), key=lambda entry: self._top(*entry)):
            where = "starts" if dashed else "goal"
            for outline in outlines(self.scene.body(name), pose):
                look = Look(
                    self._role(name), self._role(name), 1.2, dashed, 0.08 if dashed else 0.3
                )
                yield Shape(tuple(map(self._pixels, outline)), look, title=f"{name}: {where}")

    def _top(self, name: str, pose: Pose) -> float:
        return pose.position[2] + self.scene.body(name).height_m

    def _stations(self) -> Iterator[Item]:
        for name, position in self.scene.stations.items():
            x, y = self._pixels(position)
            box = rectangle(x - _STATION_PX, y - _STATION_PX, x + _STATION_PX, y + _STATION_PX)
            yield Shape(box, Look("paper", "ink", 1.4), title=name)

    def _path(self) -> Iterator[Item]:
        look = Look(stroke="ink", width_px=1.1)
        for step in self.steps:
            for begin, end in pairwise(map(self._pixels, step.stops)):
                yield from arrow(begin, end, look, short_px=NUMBER_PX + 1)

    def _numbers(self) -> Iterator[Item]:
        """Yield the numbers of the steps that end at each place."""
        ends: dict[Point, list[int]] = {}
        for step in self.steps:
            x, y = self._pixels(step.stops[-1])
            ends.setdefault((round(x, 1), round(y, 1)), []).append(step.number)
        rows = number_rows(ends, (self.width_px, self.height_px - _LEGEND_PX))
        for row in rows:
            yield from row.leader()
        for row in rows:
            size = (2 * row.half_px / PIXELS_PER_IN, 2 * NUMBER_PX / PIXELS_PER_IN)
            self.placer.avoid_box(self._on_paper(row.centre), *size)
            names = (f"{number}. {self.skills[number - 1]}" for number in row.numbers)
            yield from row.items("; ".join(names))

    def _names(self) -> Iterator[Item]:
        """Yield names of parts beside where they start, and of stations."""
        for step in self.steps:
            self.placer.avoid_disc(self._inches(step.stops[-1]), (NUMBER_PX + 3) / PIXELS_PER_IN)
            self.placer.avoid_line([*map(self._inches, step.stops)])
        names: dict[str, Sequence[float]] = {
            name: pose.position for name, pose in self.starts.items()
        }
        # Bodies in their order: the later a name is placed, the less room is left.
        once = [body.name for body in self.scene.bodies if body.name not in self.starts]
        names |= {name: self.goals[name].position for name in once if name in self.goals}
        shared: dict[tuple[float, ...], list[str]] = {}
        for name, place in self.scene.stations.items():
            shared.setdefault(tuple(place), []).append(name)
        names |= {", ".join(sorted(together)): place for place, together in shared.items()}
        if self._shows(self.robot.base[:2]):
            names[self.robot.name] = self.robot.base
        for name, where in names.items():
            near = self._half_px(name) / PIXELS_PER_IN
            distances = [near + extra for extra in (0.06, 0.12, 0.2, 0.32)]
            if self._has_room(name):
                distances.insert(0, (NUMBER_PX + 3) / PIXELS_PER_IN)
            at = self.placer.place(self._inches(where), name, 8.25, distances)
            x, y = at[0] * PIXELS_PER_IN, self.height_px - at[1] * PIXELS_PER_IN
            yield Label((x, y), name, "muted", _NAME_PX, halo=True)

    def _has_room(self, name: str) -> bool:
        """Whether a body's name fits into its footprint beside a number at its origin."""
        if name not in self.starts:
            return False
        seen = outlines(self.scene.body(name), self.starts[name])
        low, high = _bounds([self._pixels(point) for one in seen for point in one])
        at = self._pixels(self.starts[name].position)
        half_px = text_width_px(name, _NAME_PX) / 2 + 5
        tall_px = NUMBER_PX + 2 * _NAME_PX
        return (
            min(at[0] - low[0], high[0] - at[0]) >= half_px
            and min(at[1] - low[1], high[1] - at[1]) >= tall_px
        )

    def _half_px(self, name: str) -> float:
        """Return how far from its origin a body's name should stand."""
        if name in self.starts:
            corners = outlines(self.scene.body(name), Pose((0.0, 0.0, 0.0)))
            spread = max((math.hypot(*p) for one in corners for p in one), default=0.0)
            return min(self.scale * spread * 0.8, 60.0)
        return NUMBER_PX + 4

    def _inches(self, point: Sequence[float]) -> Point:
        return self._on_paper(self._pixels(point))

    def _on_paper(self, point: Point) -> Point:
        return (point[0] / PIXELS_PER_IN, (self.height_px - point[1]) / PIXELS_PER_IN)

    def _legend(self) -> Iterator[Item]:
        top = self.height_px - _LEGEND_PX + 12
        left = 14.0
        length_m = _round_length(140 / self.scale)
        wide = self.scale * length_m
        yield Shape(((left, top), (left + wide, top)), Look(stroke="ink", width_px=2), closed=False)
        text = f"{1000 * length_m:g} mm"
        yield Label((left + wide + 8, top), text, "muted", SMALL_PX, "start")
        left += wide + 24 + text_width_px(text, SMALL_PX)
        entries = (
            (Look("blue", "blue", 1.2, True, 0.08), "where a part starts"),
            (Look("blue", "blue", 1.2, False, 0.3), "its goal"),
            (Look("paper", "ink", 1.4), "tool holder or feeder"),
        )
        for look, words in entries:
            yield Shape(rectangle(left, top - 5, left + 14, top + 5), look)
            yield Label((left + 20, top), words, "muted", SMALL_PX, "start")
            left += 38 + text_width_px(words, SMALL_PX)
        words = f"reach, {self.robot.reach_m:g} m from the base of {self.robot.name}"
        if any(self._reach()):
            line = ((left, top), (left + 18, top))
            yield Shape(line, Look(stroke="muted", dashed=True, width_px=1.2), closed=False)
            left += 24
        else:
            words += ": beyond the picture"
        yield Label((left, top), words, "muted", SMALL_PX, "start")


def _bounds(points: Sequence[Point]) -> tuple[Point, Point]:
    xs, ys = [x for x, _ in points], [y for _, y in points]
    return (min(xs), min(ys)), (max(xs), max(ys))


def _round_length(most_m: float) -> float:
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(step * power for step in (1, 2, 5) if step * power <= most_m * (1 + 1e-9))
