"""A state of a task as an image of a fixed size, for the environments.

Parts and the tip of the arm are seen from above; robots that walk stand at their places; any other
state is a grid of its facts. `skillplan.env.rendering` loads this module by its name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

from skillplan.task.pose import Pose
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.views.figures.picture import SERIES, SMALL_PX, Picture, make_rectangle, shorten
from skillplan.views.figures.solids import Bytes, Point, find_outlines

WIDTH_PX, HEIGHT_PX = 640, 480
"""Size of every image: even, as video codecs need it."""

_MARGIN_PX = 14.0
_HEAD_PX = 52.0
_FOOT_PX = 24.0
_TIP_PX = 7.0
_NAME_PX = 9.0
# Height of a fact in the grid: with its name, and the most.
_NAMED_PX, _TALLEST_PX = 12.0, 26.0


def paint_state(task: Task, state: State, caption: str) -> Bytes:
    """Return a state as pixels, shape (480, 640, 3).

    Parameters
    ----------
    caption
        One line above the picture, such as the last step; cut if it is too long.
    """
    picture = Picture(WIDTH_PX, HEIGHT_PX, f"A state of {task.name}")
    room_px = WIDTH_PX - 2 * _MARGIN_PX
    picture.label((_MARGIN_PX, 17.0), shorten(caption, room_px / 1.12), anchor="start", bold=True)
    goals = list(task.goal.requires)
    holding = sum(fact in state for fact in goals)
    line = f"{task.name}: {holding} of {len(goals)} {'goal' if len(goals) == 1 else 'goals'}"
    tools = [robot.tool(state) for robot in task.scene.robots]
    names = [tool.name for tool in tools if tool is not None]
    line += f", tool {', '.join(names)}" if names else ""
    picture.label((_MARGIN_PX, 37.0), shorten(line, room_px), "muted", anchor="start")
    if task.scene.bodies and task.scene.robots:
        _draw_cell(picture, task, state)
    elif any(fact in task.places for fact in state):
        _draw_places(picture, task, state)
    else:
        _draw_facts(picture, task, state)
    return picture.pixels()[..., :3].copy()


class _Area:
    """Maps points of the table [m] to pixels below the caption, x to the right and y up."""

    def __init__(self, points: Sequence[Point], pad_m: float) -> None:
        xs, ys = [x for x, _ in points], [y for _, y in points]
        low = (min(xs) - pad_m, min(ys) - pad_m)
        wide_m, tall_m = max(xs) + pad_m - low[0], max(ys) + pad_m - low[1]
        room = (WIDTH_PX - 2 * _MARGIN_PX, HEIGHT_PX - _HEAD_PX - _FOOT_PX - _MARGIN_PX)
        self.scale = min(room[0] / wide_m, room[1] / tall_m)
        self.low, self.high = low, (low[0] + wide_m, low[1] + tall_m)
        self._left = (WIDTH_PX - self.scale * wide_m) / 2
        self._bottom = _HEAD_PX + (room[1] + self.scale * tall_m) / 2

    def pixels(self, point: Sequence[float]) -> Point:
        """Return the pixels of a point [m]."""
        x, y = point[0] - self.low[0], point[1] - self.low[1]
        return (self._left + self.scale * x, self._bottom - self.scale * y)


def _draw_cell(picture: Picture, task: Task, state: State) -> None:
    scene = task.scene
    goals, poses = scene.at(task.find_finished_state()), scene.at(state)
    outlines = {
        name: [find_outlines(scene.body(name), pose) for pose in _list_poses(task, name)]
        for name in (body.name for body in scene.bodies)
    }
    points = [point for some in outlines.values() for shapes in some for o in shapes for point in o]
    points += [(x, y) for x, y, _ in scene.stations.values()]
    points += [(x, y) for robot in scene.robots for x, y, _ in robot.places.values()]
    area = _Area(points, 0.02)
    for zone in scene.zones:
        role = "red" if zone.keeps_out else "orange"
        for visible in zone.cut(area.low, area.high):
            picture.polygon([*map(area.pixels, visible)], role, role, 1.0, opacity=0.1)
    for x, y in map(area.pixels, scene.stations.values()):
        picture.polygon(make_rectangle(x - 8, y - 8, x + 8, y + 8), "paper", "muted", 1.0)
    roles = {
        body.name: "muted" if body.fixed else SERIES[i % len(SERIES)]
        for i, body in enumerate(scene.bodies)
    }

    def draw(name: str, pose: Pose, opacity: float, *, dashed: bool) -> None:
        for outline in find_outlines(scene.body(name), pose):
            pixels = [*map(area.pixels, outline)]
            fill = None if dashed else roles[name]
            picture.polygon(pixels, fill, roles[name], 1.2, dashed=dashed, opacity=opacity)

    for name, pose in goals.items():
        if poses.get(name) != pose:
            draw(name, pose, 0.0, dashed=True)
    tops = {name: pose.position[2] + scene.body(name).height_m for name, pose in poses.items()}
    for name in sorted(poses, key=tops.__getitem__):
        draw(name, poses[name], 0.75 if poses[name] == goals.get(name) else 0.3, dashed=False)
    standing = [robot for robot in scene.robots if any(fact in state for fact in robot.places)]
    tips = [area.pixels(robot.place(state)[1]) for robot in standing]
    for x, y in tips:
        picture.disc((x, y), _TIP_PX, None, "ink", 2.0)
        for dx, dy in ((_TIP_PX + 4, 0.0), (0.0, _TIP_PX + 4)):
            picture.line(((x - dx, y - dy), (x + dx, y + dy)), "ink", 1.2)
    for name, pose in poses.items():
        if poses[name] != goals.get(name):
            x, y = area.pixels(pose.position)
            hidden = any(math.dist((x, y), tip) < 2 * _TIP_PX for tip in tips)
            picture.label((x, y + 3 * _TIP_PX * hidden), name, "ink", _NAME_PX, halo=True)
    _write_foot(picture, "dashed: goals; filled: parts, dark at their goals; cross: tip of the arm")


def _list_poses(task: Task, name: str) -> list[Pose]:
    """Return the poses of a body on the table, at the start and at the goal."""
    known = (task.scene.at(state) for state in (task.initial, task.find_finished_state()))
    return [poses[name] for poses in known if name in poses]


def _draw_places(picture: Picture, task: Task, state: State) -> None:
    points = {fact: (place.position[0], place.position[1]) for fact, place in task.places.items()}
    distinct = sorted(set(points.values()))
    apart_m = min((math.dist(a, b) for a, b in pairwise(distinct)), default=1.0)
    area = _Area(distinct, 0.6 * apart_m)
    names = {points[fact]: place.name for fact, place in task.places.items()}
    # Names fit if neighbours are some 20 px apart.
    size_px = min(_NAME_PX, 0.36 * area.scale * apart_m)
    agents = _number_agents(task)
    for skill in task.skills:
        if skill.applicable(state):
            after = skill.prediction_in(state).apply(state)
            for end in set(after) - set(state):
                starts = [fact for fact in state if agents.get(fact) == agents.get(end)]
                if end in points and starts and starts[0] in points:
                    ends = area.pixels(points[starts[0]]), area.pixels(points[end])
                    picture.line(ends, SERIES[agents[end] % len(SERIES)], 1.4)
    for point in distinct:
        picture.disc(area.pixels(point), max(2.0, 0.9 * size_px), "paper", "faint")
        if size_px >= 5:
            picture.label(area.pixels(point), names[point], "muted", size_px)
    for facts, is_goal in ((task.goal.requires, True), (state, False)):
        for fact in facts:
            if fact in points:
                role, (x, y) = SERIES[agents[fact] % len(SERIES)], area.pixels(points[fact])
                radius = max(5.0, 1.3 * size_px)
                if is_goal:
                    box = make_rectangle(x - radius, y - radius, x + radius, y + radius)
                    picture.polygon(box, None, role, 2.0)
                else:
                    picture.disc((x, y), radius, role, "ink")
                    picture.label((x, y), names[points[fact]], "paper", size_px, bold=True)
    _write_foot(picture, "disc: where a robot stands; square: its goal; lines: its moves now")


def _number_agents(task: Task) -> Mapping[str, int]:
    """Return the number of the robot that each place belongs to: of its exclusive group."""
    groups = [group for group in task.facts.exclusive if set(group) & set(task.places)]
    numbers = {fact: number for number, group in enumerate(groups) for fact in group}
    return {fact: numbers.get(fact, 0) for fact in task.places}


def _draw_facts(picture: Picture, task: Task, state: State) -> None:
    names, goals = task.facts.names, set(task.goal.requires)
    wide, tall = WIDTH_PX - 2 * _MARGIN_PX, HEIGHT_PX - _HEAD_PX - _FOOT_PX - _MARGIN_PX
    columns = 1
    while (
        columns < len(names) and tall / math.ceil(len(names) / columns) < _NAMED_PX and columns < 8
    ):
        columns += 1
    step = (wide / columns, min(_TALLEST_PX, tall / math.ceil(len(names) / columns)))
    box_px = max(1.0, min(step[1] - 2, 10.0))
    rows = math.ceil(len(names) / columns)
    for number, name in enumerate(names):
        left = _MARGIN_PX + step[0] * (number // rows)
        middle = _HEAD_PX + step[1] * (number % rows + 0.5)
        box = make_rectangle(left, middle - box_px / 2, left + box_px, middle + box_px / 2)
        role = "green" if name in goals else "blue"
        picture.polygon(box, role if name in state else "paper", role, 1.0)
        if step[1] >= _NAMED_PX - 1:
            text = shorten(name, step[0] - box_px - 8, SMALL_PX)
            role = "ink" if name in state else "muted"
            picture.label((left + box_px + 4, middle), text, role, SMALL_PX, "start")
    _write_foot(picture, "filled: facts that hold; green: facts of the goal")


def _write_foot(picture: Picture, text: str) -> None:
    """Write the legend."""
    picture.label((_MARGIN_PX, HEIGHT_PX - 14.0), text, "muted", SMALL_PX, "start")
