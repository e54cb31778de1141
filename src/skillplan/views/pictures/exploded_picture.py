"""The product taken apart along the directions in which a plan puts it together."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from skillplan.task.pose import DOWN, Pose
from skillplan.task.pose import Point as Point3
from skillplan.task.scene import Body
from skillplan.task.task import Task
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
    hull,
)
from skillplan.views.pictures.layout_picture import reached_state, releases
from skillplan.views.pictures.outlines import corners_of, faces_of

# Looked at from above, and from that side of several from which most is seen.
_AZIMUTHS_DEG = (-58, -32, -122, -148, 32, 58, 122, 148)
_ELEVATION = math.radians(26)
_GAP_M = 0.018
_MARGIN_PX, _NAMES_PX, _MOST_HEIGHT_PX = 20.0, 210.0, 980.0
_LEAST_PITCH_PX = 21.0
# A shape with more faces is drawn by its outline.
_MOST_FACES = 300
# Where the light is: towards the eye, to its right, and up.
_LIGHT = (0.5, -0.3, 0.81)


@dataclass(frozen=True, slots=True)
class _Piece:
    """A body, moved away from its place."""

    number: int
    body: Body
    goal: Pose
    pose: Pose

    @property
    def corners(self) -> list[Point3]:
        """Corners of all its shapes in the world [m]."""
        return [
            self.pose.apply(corner) for shape in self.body.shapes for corner in corners_of(shape)
        ]


def exploded_picture(task: Task, skills: Sequence[str], width_px: float = 760.0) -> Drawing:
    """Return the parts of a product in the order in which a plan adds them.

    Parameters
    ----------
    task
        Whose bodies have goals.
    skills
        Of the plan.
    width_px
        How wide the picture is.

    Raises
    ------
    ValueError
        If the plan brings no body to a place.
    """
    pieces = _pieces(task, skills)
    if not pieces:
        raise ValueError("The plan brings no body to a place.")
    return _Exploded(task, pieces, width_px).drawing()


@dataclass(frozen=True, slots=True)
class _View:
    """From where it is looked at: an angle about the vertical [rad]."""

    azimuth: float

    def seen(self, point: Point3) -> Point:
        """Return a point on paper [m], x to the right and y up."""
        x, y, z = point
        right = y * math.cos(self.azimuth) - x * math.sin(self.azimuth)
        return (right, z * math.cos(_ELEVATION) - self.near(point) * math.sin(_ELEVATION))

    def near(self, point: Point3) -> float:
        """Return how near to the eye a point is in the plan [m]."""
        return point[0] * math.cos(self.azimuth) + point[1] * math.sin(self.azimuth)

    def depth(self, point: Point3) -> float:
        """Return how near to the eye a point is [m]."""
        return self.near(point) * math.cos(_ELEVATION) + point[2] * math.sin(_ELEVATION)

    def lit(self, normal: Point3) -> float:
        """Return how much light falls on a face, up to 1."""
        right = normal[1] * math.cos(self.azimuth) - normal[0] * math.sin(self.azimuth)
        along = (self.near(normal), right, normal[2])
        return sum(a * b for a, b in zip(along, _LIGHT, strict=True))

    def outline(self, piece: _Piece) -> tuple[Point, ...]:
        """Return the outline of a body on paper [m]."""
        return hull([self.seen(corner) for corner in piece.corners])

    def back_to_front(self, solids: Sequence[Sequence[Point3]]) -> list[int]:
        """Return solids, by their corners, in the order in which they are drawn."""
        spans = [(_span(one, lambda p: p[2]), _span(one, self.near)) for one in solids]
        depths = [max(self.depth(corner) for corner in one) for one in solids]
        left = sorted(range(len(solids)), key=lambda index: depths[index])
        found = []
        while left:
            free = (
                one
                for one in left
                if not any(_hides(spans[one], spans[other]) for other in left if other != one)
            )
            found.append(next(free, left[0]))
            left.remove(found[-1])
        return found

    def hidden(self, pieces: Sequence[_Piece]) -> float:
        """Return how much of the bodies is behind others, about."""
        order = self.back_to_front([one.corners for one in pieces])
        shapes = [self.outline(pieces[index]) for index in order]
        total = 0.0
        for index, shape in enumerate(shapes):
            points = [*shape, tuple(sum(v) / len(shape) for v in zip(*shape, strict=True))]
            covered = [any(_inside(p, front) for front in shapes[index + 1 :]) for p in points]
            total += (sum(covered) / len(points)) ** 2
        return total


class _Exploded:
    """What the layers of one picture share."""

    def __init__(self, task: Task, pieces: Sequence[_Piece], width_px: float) -> None:
        self.task, self.pieces, self.width_px = task, pieces, width_px
        views = [_View(math.radians(degrees)) for degrees in _AZIMUTHS_DEG]
        self.view = min(views, key=lambda view: round(view.hidden(pieces), 2))
        seen = [
            self.view.seen(one.pose.apply(corner))
            for one in pieces
            for shape in one.body.exact_shapes
            for corner in corners_of(shape)
        ]
        seen += [self.view.seen(one.goal.position) for one in pieces]
        self.low = (min(x for x, _ in seen), min(y for _, y in seen))
        self.high = (max(x for x, _ in seen), max(y for _, y in seen))
        wide, tall = self.high[0] - self.low[0], self.high[1] - self.low[1]
        room = width_px - 2 * _MARGIN_PX - _NAMES_PX
        self.scale = min(room / wide, (_MOST_HEIGHT_PX - 2 * _MARGIN_PX) / tall)
        least_px = _LEAST_PITCH_PX * len(pieces)
        self.height_px = max(self.scale * tall, least_px) + 2 * _MARGIN_PX
        self.top = (self.height_px - self.scale * tall) / 2
        self.left = _MARGIN_PX + (room - self.scale * wide) / 2

    def drawing(self) -> Drawing:
        """Return the picture."""
        items: list[Item] = []
        for piece in self.pieces:
            ends = (self._pixels(piece.goal.position), self._pixels(piece.pose.position))
            items.append(Shape(ends, Look(stroke="muted", dashed=True), closed=False))
        for index in self.view.back_to_front([one.corners for one in self.pieces]):
            items += self._body(self.pieces[index])
        items += self._names()
        title = f"Exploded view of {self.task.name}, in the order of the plan"
        return Drawing(self.width_px, self.height_px, title, tuple(items))

    def _pixels(self, point: Point3) -> Point:
        x, y = self.view.seen(point)
        return (
            self.left + self.scale * (x - self.low[0]),
            self.top + self.scale * (self.high[1] - y),
        )

    def _body(self, piece: _Piece) -> Iterator[Item]:
        names = [body.name for body in self.task.scene.bodies]
        role = SERIES[names.index(piece.body.name) % len(SERIES)]
        title = f"{piece.number}. {piece.body.name}"
        shapes = piece.body.exact_shapes
        solids = [[piece.pose.apply(corner) for corner in corners_of(one)] for one in shapes]
        for index in self.view.back_to_front(solids):
            shape, corners = shapes[index], solids[index]
            if len(faces_of(shape)) > _MOST_FACES:
                outline = hull([self._pixels(corner) for corner in corners])
                yield Shape(outline, Look(role, "ink", 0.8, opacity=0.9), title=title)
                continue
            faces = [[corners[index] for index in face] for face in faces_of(shape)]
            seen = [(face, _normal(face)) for face in faces]
            towards = [(face, normal) for face, normal in seen if self.view.depth(normal) > 1e-9]
            for face, normal in sorted(towards, key=lambda one: self._mean_depth(one[0])):
                shade = round(0.5 * (1 - max(0.0, self.view.lit(normal))), 1)
                look = Look(role, "ink" if len(faces) < 24 else None, 0.5, shade=shade)
                yield Shape(tuple(map(self._pixels, face)), look, title=title)

    def _mean_depth(self, face: Sequence[Point3]) -> float:
        return sum(self.view.depth(point) for point in face) / len(face)

    def _names(self) -> Iterator[Item]:
        """Yield numbers and names on the right, each with a line to its part."""
        order = self.view.back_to_front([one.corners for one in self.pieces])
        outlines = [self.view.outline(self.pieces[index]) for index in order]
        anchors = {
            self.pieces[index].number: self._anchor(self.pieces[index], outlines[place + 1 :])
            for place, index in enumerate(order)
        }
        wanted = sorted(self.pieces, key=lambda one: anchors[one.number][1])
        pitch = max(_LEAST_PITCH_PX, 0.0)
        ys: list[float] = []
        for one in wanted:
            y = anchors[one.number][1]
            ys.append(max(y, ys[-1] + pitch) if ys else max(y, _MARGIN_PX))
        over = ys[-1] - (self.height_px - _MARGIN_PX)
        for index in reversed(range(len(ys))):
            if over > 0:
                most = (
                    self.height_px - _MARGIN_PX if index == len(ys) - 1 else ys[index + 1] - pitch
                )
                ys[index] = min(ys[index], most)
        x = self.width_px - _NAMES_PX
        for one, y in zip(wanted, ys, strict=True):
            line = (anchors[one.number], (x - 26, y), (x - 10, y))
            yield Shape(line, Look(stroke="faint", width_px=0.9), closed=False)
            yield Disc(anchors[one.number], 1.8, Look("ink"))
            yield Disc((x, y), 9.5, Look("paper", "ink", 1.1))
            yield Label((x, y), str(one.number), size_px=SMALL_PX, bold=True)
            yield Label((x + 16, y), one.body.name, anchor="start")

    def _anchor(self, piece: _Piece, fronts: Sequence[Sequence[Point]]) -> Point:
        """Return the rightmost corner of a body on paper, if it can be one that is seen."""
        corners = [
            piece.pose.apply(corner)
            for shape in piece.body.exact_shapes
            for corner in corners_of(shape)
        ]
        seen = [
            corner
            for corner in corners
            if not any(_inside(self.view.seen(corner), front) for front in fronts)
        ]
        return max(map(self._pixels, seen or corners))


def _pieces(task: Task, skills: Sequence[str]) -> list[_Piece]:
    """Return the bodies in the order of the plan, each clear of those before it."""
    goals = task.scene.at(reached_state(task, skills))
    directions = releases(task, skills)
    pieces: list[_Piece] = []
    for name in directions:
        if name not in goals:
            continue
        body, goal = task.scene.body(name), goals[name]
        out = tuple(-value for value in directions.get(name, DOWN))
        away = (out[0], out[1], out[2])
        least = -body.reach_m(goal, (-away[0], -away[1], -away[2]))
        over = [
            one.body.reach_m(one.pose, away) + _GAP_M
            for one in pieces
            if _share_plan(one, body, goal, away)
        ]
        lift = max([0.0, *(reach - least for reach in over)])
        moved = goal.moved((lift * away[0], lift * away[1], lift * away[2]))
        pieces.append(_Piece(len(pieces) + 1, body, goal, moved))
    return pieces


def _share_plan(one: _Piece, body: Body, goal: Pose, away: Point3) -> bool:
    """Whether a body would pass another one on its way out."""
    across = (away[1], away[2], away[0]), (away[2], away[0], away[1])
    for axis in across:
        back = (-axis[0], -axis[1], -axis[2])
        a = (-one.body.reach_m(one.goal, back), one.body.reach_m(one.goal, axis))
        b = (-body.reach_m(goal, back), body.reach_m(goal, axis))
        if a[1] <= b[0] + 1e-6 or b[1] <= a[0] + 1e-6:
            return False
    return True


_Span = tuple[float, float]


def _span(corners: Sequence[Point3], along: Callable[[Point3], float]) -> _Span:
    """Return the least and greatest value of a coordinate."""
    values = [along(corner) for corner in corners]
    return min(values), max(values)


def _hides(one: tuple[_Span, _Span], other: tuple[_Span, _Span]) -> bool:
    """Whether a solid is in front of another one for sure, by its heights and nearness."""
    (low, high), (near, _) = one
    (floor, top), (_, far) = other
    if top <= low + 1e-6 or high <= floor + 1e-6:
        return top <= low + 1e-6
    return far <= near + 1e-6


def _inside(point: Sequence[float], outline: Sequence[Point]) -> bool:
    """Whether a point is within a convex outline, whose corners go round anticlockwise."""
    ends = zip(outline, [*outline[1:], *outline[:1]], strict=True)
    x, y = point
    return all((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 1e-12 for a, b in ends)


def _normal(face: Sequence[Point3]) -> Point3:
    a, b, c = face[0], face[1], face[2]
    u, v = [q - p for p, q in zip(a, b, strict=True)], [q - p for p, q in zip(a, c, strict=True)]
    n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    length = math.hypot(*n) or 1.0
    return (n[0] / length, n[1] / length, n[2] / length)
