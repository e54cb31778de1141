"""The cell from above: starts and goals of parts, the path of the plan, the reach of the arm.

x is to the right and y up, as in the task file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from matplotlib.figure import Figure

from skillplan.task.pose import Pose
from skillplan.task.scene import Robot, Zone
from skillplan.task.task import Task
from skillplan.task.zone import list_slow_zones
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run, get_requested_task
from skillplan.views.figures.figure_style import Heading
from skillplan.views.figures.label_placement import LabelPlacer
from skillplan.views.figures.picture import (
    NUMBER_PX,
    PIXELS_PER_IN,
    SERIES,
    SMALL_PX,
    Note,
    Picture,
    make_rectangle,
    measure_text_px,
    place_number_rows,
)
from skillplan.views.figures.solids import Point, find_outlines

SOLVER = "auto"

_MARGIN_PX = 34.0
_TICK_PX = 8.0
# Distance of grid lines [px], at least.
_GRID_PX = 70.0
_LEGEND_PX, _LEGEND_ROW_PX = 44.0, 18.0
_WIDTH_PX, _MOST_HEIGHT_PX = 960.0, 900.0
# The base and the rim of the reach are shown unless they shrink the cell below this share.
_LEAST_SHARE = 0.65
_STATION_PX = 13.0
_NAME_PX = 11.0
_PIVOT_PX = 20.0
_FIXTURE_OPACITY = 0.22
_ZONE_OPACITY = 0.14


@dataclass(frozen=True, slots=True)
class PathStep:
    """A step of a plan on its way over the table.

    Parameters
    ----------
    number
        Number in the plan, from 1.
    stops
        Start, visited places such as feeders, and end, in the plane [m].
    """

    number: int
    stops: tuple[Point, ...]


def list_path_steps(task: Task, skills: Sequence[str]) -> list[PathStep]:
    """Return the steps of a plan that move the arm."""
    state, steps = task.initial, []
    for number, name in enumerate(skills, start=1):
        skill = task.skill(name)
        after = skill.prediction_in(state).apply(state)
        if skill.motion is not None:
            robot = task.scene.robot(skill.motion.robot)
            (_, begin), (_, end) = robot.place(state), robot.place(after)
            visits = [
                point
                for visit in skill.motion.visits(state)
                for point in (*visit.path, visit.position)
            ]
            stops = [point[:2] for point in (begin, *visits, end)]
            steps.append(PathStep(number, tuple(point for point, _ in groupby(stops))))
        state = after
    return steps


def draw_layout(task: Task, skills: Sequence[str]) -> Picture:
    """Return the cell of a task from above, with the path of a plan.

    Raises
    ------
    ValueError
        If the task has no robot.
    """
    if not task.scene.robots:
        raise ValueError("A layout needs a robot.")
    return _Layout(task, skills).draw()


class _Layout:
    """The layers of a picture and their common scale."""

    def __init__(self, task: Task, skills: Sequence[str]) -> None:
        self.scene = task.scene
        self.robot: Robot = task.scene.robots[0]
        self.steps = list_path_steps(task, skills)
        self.skills = skills
        self.starts = task.scene.at(task.initial)
        self.goals = task.scene.at(task.find_finished_state(skills))
        self.fixtures = [body.name for body in task.scene.bodies if body.fixed]
        self.zones = {zone.name: zone for zone in task.scene.zones}
        self.low, self.high = self._extent()
        wide_m, tall_m = self.high[0] - self.low[0], self.high[1] - self.low[1]
        room = _WIDTH_PX - 2 * _MARGIN_PX
        self.scale = min(room / wide_m, (_MOST_HEIGHT_PX - 2 * _MARGIN_PX) / tall_m)
        self.left = (_WIDTH_PX - self.scale * wide_m) / 2
        height_px = self.scale * tall_m + 2 * _MARGIN_PX + _LEGEND_PX
        self.picture = Picture(_WIDTH_PX, height_px, f"Cell of {task.name} from above")
        self.placer = LabelPlacer(_WIDTH_PX / PIXELS_PER_IN, height_px / PIXELS_PER_IN)

    def draw(self) -> Picture:
        """Return the picture."""
        self._draw_grid()
        self._draw_zones()
        reached = self._draw_reach()
        self._draw_fixtures()
        self._draw_footprints(self.starts, dashed=True)
        self._draw_footprints(self.goals, dashed=False)
        for name, position in self.scene.stations.items():
            x, y = self._pixels(position)
            box = make_rectangle(x - _STATION_PX, y - _STATION_PX, x + _STATION_PX, y + _STATION_PX)
            self.picture.polygon(box, "paper", "ink", 1.4, note=Note(name))
        self._draw_holding()
        for step in self.steps:
            for begin, end in pairwise(map(self._pixels, step.stops)):
                self.picture.arrow(begin, end, "ink", 1.1, short_px=NUMBER_PX + 1)
        self._draw_numbers()
        self._write_names()
        self._draw_legend(reached=reached)
        return self.picture

    def _pixels(self, point: Sequence[float]) -> Point:
        x = self.left + self.scale * (point[0] - self.low[0])
        return (x, _MARGIN_PX + self.scale * (self.high[1] - point[1]))

    def _extent(self) -> tuple[Point, Point]:
        """Return the corners of the visible area [m]."""
        points: list[Point] = []
        for poses in (self.starts, self.goals):
            for name, pose in poses.items():
                points += [
                    p for outline in find_outlines(self.scene.body(name), pose) for p in outline
                ]
        points += [(x, y) for x, y, _ in self.scene.stations.values()]
        points += [stop for step in self.steps for stop in step.stops]
        if not points:
            points = [(x, y) for x, y, _ in self.robot.places.values()]
        low, high = _find_bounds(points)
        base = (self.robot.base[0], self.robot.base[1])
        middle = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
        away = math.dist(base, middle) or 1.0
        rim = tuple(
            b + (m - b) * self.robot.reach_m / away for b, m in zip(base, middle, strict=True)
        )
        longest = max(high[0] - low[0], high[1] - low[1])
        zones = [list(zone.corners) for zone in self.zones.values()]
        for extra in ([base], [(rim[0], rim[1])], *zones):
            wider = _find_bounds([*points, *extra])
            if longest >= _LEAST_SHARE * max(wider[1][0] - wider[0][0], wider[1][1] - wider[0][1]):
                points += extra
        low, high = _find_bounds(points)
        pad = 0.05 * max(high[0] - low[0], high[1] - low[1], 0.1)
        return (low[0] - pad, low[1] - pad), (high[0] + pad, high[1] + pad)

    def _draw_grid(self) -> None:
        """Draw lines of equal x and of equal y, with their values in metres at the edges."""
        step_m = _round_down(2.5 * _GRID_PX / self.scale)
        left, bottom = self._pixels(self.low)
        right, top = self._pixels(self.high)
        for axis, name in enumerate("xy"):
            first, last = (math.floor(end[axis] / step_m) for end in (self.low, self.high))
            for number in range(first + 1, last + 1):
                x, y = self._pixels((number * step_m, number * step_m))
                text = f"{number * step_m:.6g}"
                if axis == 0:
                    self.picture.line(((x, top), (x, bottom)), "faint", 0.6)
                    self.picture.label((x, bottom + _TICK_PX), text, "muted", SMALL_PX)
                else:
                    self.picture.line(((left, y), (right, y)), "faint", 0.6)
                    self.picture.label((left - 3, y), text, "muted", SMALL_PX, "end")
            at = (right + 4, bottom) if axis == 0 else (left, top - _TICK_PX)
            self.picture.label(at, f"{name} [m]", "muted", SMALL_PX, "start")

    def _draw_reach(self) -> bool:
        """Draw the visible rim of the reach and the base; return whether some rim is visible."""
        x, y = self.robot.base[0], self.robot.base[1]
        rim = [
            (
                x + self.robot.reach_m * math.cos(math.pi * turn / 360),
                y + self.robot.reach_m * math.sin(math.pi * turn / 360),
            )
            for turn in range(721)
        ]
        arcs = [list(points) for shown, points in groupby(rim, self._shows) if shown]
        arcs = [arc for arc in arcs if len(arc) > 1]
        for arc in arcs:
            self.picture.line([*map(self._pixels, arc)], "muted", 1.2, dashed=True)
        shows_base = self._shows((x, y))
        if shows_base:
            centre, note = self._pixels((x, y)), Note(f"base of {self.robot.name}")
            self.picture.disc(centre, 15, "faint", "muted", note=note)
            self.picture.disc(centre, 5, "muted")
        return bool(arcs) or shows_base

    def _shows(self, point: Point) -> bool:
        inside = zip(self.low, point, self.high, strict=True)
        return all(low <= value <= high for low, value, high in inside)

    def _draw_zones(self) -> None:
        """Draw the visible parts of zones: hatched if they keep something out."""
        for zone in self.scene.zones:
            role = "red" if zone.keeps_out else "orange"
            note = Note(f"{zone.label}: {_describe_zone(zone)}")
            for outline in self._show_zone(zone.name):
                points = [*map(self._pixels, outline)]
                self.picture.polygon(points, role, role, 1.2, opacity=_ZONE_OPACITY, note=note)
                if zone.keeps_out:
                    for stroke in _hatch(points):
                        self.picture.line(stroke, role, 0.6)

    def _show_zone(self, name: str) -> list[list[Point]]:
        """Return the outlines of a zone within the picture [m]."""
        return self.zones[name].cut(self.low, self.high)

    def _draw_fixtures(self) -> None:
        """Draw fixtures from above, lower ones first."""
        for name in sorted(self.fixtures, key=lambda name: self._top(name, self.starts[name])):
            for outline in find_outlines(self.scene.body(name), self.starts[name]):
                points = [*map(self._pixels, outline)]
                self.picture.polygon(
                    points, "muted", "muted", 1.2, opacity=_FIXTURE_OPACITY, note=Note(name)
                )

    def _draw_holding(self) -> None:
        """Draw the pivots of workholders as rings, and outline parts that holders may hold."""
        for workholder in self.scene.workholders:
            note = Note(f"pivot of {workholder.name}")
            centre = self._pixels(workholder.pivot)
            self.picture.disc(centre, _PIVOT_PX, None, "ink", 1.4, note=note)
        for holder in self.scene.holders:
            for part in holder.facts.keys() & self.goals.keys():
                note = Note(f"{holder.name} holds {part}")
                for outline in find_outlines(self.scene.body(part), self.goals[part]):
                    points = [*map(self._pixels, outline)]
                    self.picture.polygon(points, None, "ink", 2.0, note=note)

    def _draw_footprints(self, poses: Mapping[str, Pose], *, dashed: bool) -> None:
        """Draw bodies from above, lower ones first."""
        names = [body.name for body in self.scene.bodies]
        for name, pose in sorted(poses.items(), key=lambda entry: self._top(*entry)):
            if name in self.fixtures:
                continue
            role = SERIES[names.index(name) % len(SERIES)]
            opacity, note = (
                0.08 if dashed else 0.3,
                Note(f"{name}: {'starts' if dashed else 'goal'}"),
            )
            for outline in find_outlines(self.scene.body(name), pose):
                points = [*map(self._pixels, outline)]
                self.picture.polygon(
                    points, role, role, 1.2, dashed=dashed, opacity=opacity, note=note
                )

    def _top(self, name: str, pose: Pose) -> float:
        return pose.position[2] + self.scene.body(name).height_m

    def _draw_numbers(self) -> None:
        """Write the numbers of the steps at the places where they end."""
        ends: dict[Point, list[int]] = {}
        for step in self.steps:
            x, y = self._pixels(step.stops[-1])
            ends.setdefault((round(x, 1), round(y, 1)), []).append(step.number)
        rows = place_number_rows(ends, (self.picture.width_px, self.picture.height_px - _LEGEND_PX))
        for row in rows:
            row.draw_leader(self.picture)
        for row in rows:
            size = (2 * row.half_px / PIXELS_PER_IN, 2 * NUMBER_PX / PIXELS_PER_IN)
            self.placer.avoid_box(self._on_paper(row.centre), *size)
            names = (f"{number}. {self.skills[number - 1]}" for number in row.numbers)
            row.draw(self.picture, "; ".join(names))

    def _write_names(self) -> None:
        """Write the names of parts near their starts, and of stations."""
        for step in self.steps:
            self.placer.avoid_disc(self._inches(step.stops[-1]), (NUMBER_PX + 3) / PIXELS_PER_IN)
            self.placer.avoid_line([*map(self._inches, step.stops)])
        side_in = 2 * _STATION_PX / PIXELS_PER_IN
        for station in self.scene.stations.values():
            self.placer.avoid_box(self._inches(station), side_in, side_in)
        places: dict[str, Sequence[float]] = {
            name: pose.position for name, pose in self.starts.items()
        }
        # The order of the bodies counts: names that are placed later have less room.
        without = [body.name for body in self.scene.bodies if body.name not in self.starts]
        places |= {name: self.goals[name].position for name in without if name in self.goals}
        shared: dict[tuple[float, ...], list[str]] = {}
        for name, place in self.scene.stations.items():
            shared.setdefault(tuple(place), []).append(name)
        places |= {", ".join(sorted(together)): place for place, together in shared.items()}
        for name in self.zones:
            outlines = self._show_zone(name)
            if outlines:
                low, high = _find_bounds(outlines[0])
                places[name] = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
        if self._shows(self.robot.base[:2]):
            places[self.robot.name] = self.robot.base
        for name, point in places.items():
            near = self._distance_px(name) / PIXELS_PER_IN
            distances = [near + extra for extra in (0.06, 0.12, 0.2, 0.32)]
            if self._has_room(name):
                distances.insert(0, (NUMBER_PX + 3) / PIXELS_PER_IN)
            at = self.placer.place(self._inches(point), name, 8.25, distances)
            # Numbers matter more than names of screws where both are crowded.
            if name in without and self.placer.covers_label(at, name, 8.25):
                continue
            x, y = at[0] * PIXELS_PER_IN, self.picture.height_px - at[1] * PIXELS_PER_IN
            self.picture.label((x, y), name, "muted", _NAME_PX, halo=True)

    def _has_room(self, name: str) -> bool:
        """Return whether the name of a body and a number at its origin fit into its footprint."""
        if name not in self.starts:
            return False
        shapes = find_outlines(self.scene.body(name), self.starts[name])
        low, high = _find_bounds([self._pixels(point) for outline in shapes for point in outline])
        at = self._pixels(self.starts[name].position)
        half_px = measure_text_px(name, _NAME_PX) / 2 + 5
        tall_px = NUMBER_PX + 2 * _NAME_PX
        return (
            min(at[0] - low[0], high[0] - at[0]) >= half_px
            and min(at[1] - low[1], high[1] - at[1]) >= tall_px
        )

    def _distance_px(self, name: str) -> float:
        """Return the distance of a name from the origin of its body."""
        if name in self.starts:
            corners = find_outlines(self.scene.body(name), Pose((0.0, 0.0, 0.0)))
            spread = max((math.hypot(*p) for outline in corners for p in outline), default=0.0)
            return min(self.scale * spread * 0.8, 60.0)
        return NUMBER_PX + 4

    def _inches(self, point: Sequence[float]) -> Point:
        return self._on_paper(self._pixels(point))

    def _on_paper(self, point: Point) -> Point:
        return (point[0] / PIXELS_PER_IN, (self.picture.height_px - point[1]) / PIXELS_PER_IN)

    def _list_zone_keys(self) -> Iterator[tuple[str, str, float, float, str]]:
        """Yield the entries of the legend for zones: colours, width, opacity and words."""
        if any(zone.keeps_out for zone in self.scene.zones):
            yield "red", "red", 1.2, _ZONE_OPACITY, "keep-out zone"
        slow = [zone.speed_m_per_s for zone in list_slow_zones(self.scene)]
        if slow:
            limits = ", ".join(f"{speed:g}" for speed in sorted({s for s in slow if s is not None}))
            yield "orange", "orange", 1.2, _ZONE_OPACITY, f"slow, {limits} m/s"

    def _draw_legend(self, *, reached: bool) -> None:
        top, left = self.picture.height_px - _LEGEND_PX + 12, 14.0

        def write(words: str) -> None:
            self.picture.label((left, top), words, "muted", SMALL_PX, "start")

        def wrap(wide_px: float) -> None:
            """Begin a second row if an entry does not fit into the first."""
            nonlocal left, top
            if left + wide_px > self.picture.width_px - 14:
                left, top = 14.0, top + _LEGEND_ROW_PX

        length_m = _round_down(140 / self.scale)
        self.picture.line(((left, top), (left + self.scale * length_m, top)), "ink", 2)
        left += self.scale * length_m + 8
        words = f"{1000 * length_m:g} mm"
        write(words)
        left += 16 + measure_text_px(words, SMALL_PX)
        for fill, stroke, width_px, opacity, words in (
            ("blue", "blue", 1.2, 0.08, "where a part starts"),
            ("blue", "blue", 1.2, 0.3, "its goal"),
            ("paper", "ink", 1.4, 1.0, "tool holder or feeder"),
            *([("muted", "muted", 1.2, _FIXTURE_OPACITY, "fixed")] if self.fixtures else []),
            *([(None, "ink", 2.0, 1.0, "part with a holder")] if self.scene.holders else []),
            *self._list_zone_keys(),
        ):
            wrap(20 + measure_text_px(words, SMALL_PX))
            box = make_rectangle(left, top - 5, left + 14, top + 5)
            dashed = opacity < 0.1
            if fill == "red":
                for stroke_px in _hatch(box, 5.0):
                    self.picture.line(stroke_px, fill, 0.6)
            self.picture.polygon(box, fill, stroke, width_px, dashed=dashed, opacity=opacity)
            left += 20
            write(words)
            left += 18 + measure_text_px(words, SMALL_PX)
        words = f"reach, {self.robot.reach_m:g} m from the base of {self.robot.name}"
        if not reached:
            words += ": beyond the picture"
        wrap((24 if reached else 0) + measure_text_px(words, SMALL_PX))
        if reached:
            self.picture.line(((left, top), (left + 18, top)), "muted", 1.2, dashed=True)
            left += 24
        write(words)


def _describe_zone(zone: Zone) -> str:
    words = [f"keeps out {' and '.join(zone.keeps_out)}"] if zone.keeps_out else []
    if zone.speed_m_per_s is not None:
        words.append(f"{zone.speed_m_per_s:g} m/s at most")
    return ", ".join(words)


def _hatch(outline: Sequence[Point], step_px: float = 11.0) -> Iterator[tuple[Point, Point]]:
    """Yield diagonal strokes in a polygon [px]."""
    import shapely

    (left, top), (right, bottom) = _find_bounds(outline)
    tall = bottom - top
    area = shapely.Polygon(outline)
    for number in range(1, math.ceil((right - left + tall) / step_px)):
        x = left + number * step_px
        line = shapely.LineString([(x, top), (x - tall, bottom)])
        inside = shapely.intersection(line, area)
        for piece in getattr(inside, "geoms", [inside]):
            if piece.length > 0:
                begin, end = piece.coords
                yield begin, end


def _find_bounds(points: Sequence[Point]) -> tuple[Point, Point]:
    xs, ys = [x for x, _ in points], [y for _, y in points]
    return (min(xs), min(ys)), (max(xs), max(ys))


def _round_down(most_m: float) -> float:
    """Return the largest length of 1, 2 or 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(step * power for step in (1, 2, 5) if step * power <= most_m * (1 + 1e-9))


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the task."""
    return [Run(get_requested_task(request))]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the cell of a solved task."""
    task, result = get_requested_task(request), outcomes[0].result
    skills = [step.skill for step in result.steps]
    title = f"{task.name} from above: {len(skills)} skills, {task.cost_text(result.cost)}"
    heading = Heading(title, request.details(outcomes[0].run))
    return draw_layout(task, skills).with_heading(heading)
