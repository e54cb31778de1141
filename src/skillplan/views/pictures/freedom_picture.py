"""A part among those in place, what is in its way, and an arrow along each direction."""

from __future__ import annotations

import math
from collections.abc import Iterator

from skillplan.records.freedom import Freedom, Way
from skillplan.task.pose import Point as Point3
from skillplan.task.pose import Pose
from skillplan.task.scene import Body
from skillplan.views.pictures.drawing import Disc, Drawing, Item, Label, Look, Point, Shape
from skillplan.views.pictures.outlines import corners_of
from skillplan.views.pictures.solid_view import View, body_items
from skillplan.views.text.wording import direction_name

_AZIMUTHS_DEG = (-58, -32, -122, -148, 32, 58, 122, 148)
_PART, _IN_THE_WAY, _OTHER = "blue", "orange", "grey"
_FREE, _BLOCKED = "green", "red"
_PALE = 0.22
_SEEN_THROUGH, _SOLID = 0.4, 0.85
_MARGIN_PX, _NAMES_PX, _LINE_PX = 26.0, 250.0, 19.0
_MOST_HEIGHT_PX = 560.0
# Of an arrow, as shares of the size of what is drawn.
_LENGTH, _HEAD_PX = 0.28, 9.0


def freedom_picture(freedom: Freedom, goals: dict[str, Pose], width_px: float = 760.0) -> Drawing:
    """Return a part in its place, what blocks it coloured, and its directions.

    Parameters
    ----------
    freedom
        Of the part.
    goals
        Where bodies are once they are in place.
    width_px
        How wide the picture is.

    Raises
    ------
    ValueError
        If the part has no body with a place.
    """
    if freedom.part not in goals:
        raise ValueError(f"{freedom.part} has no body with a place.")
    return _Freedom(freedom, goals, width_px).drawing()


class _Freedom:
    """What the layers of one picture share."""

    def __init__(self, freedom: Freedom, goals: dict[str, Pose], width_px: float) -> None:
        self.freedom, self.width_px = freedom, width_px
        scene = freedom.task.scene
        shown = [freedom.part, *(name for name in freedom.present if name in goals)]
        self.bodies = [(scene.body(name), goals[name]) for name in shown]
        own = _corners(*self.bodies[0])
        middle = [sum(values) / len(own) for values in zip(*own, strict=True)]
        self.middle = (middle[0], middle[1], middle[2])
        corners = [corner for body, pose in self.bodies for corner in _corners(body, pose)]
        size_m = max(max(v) - min(v) for v in zip(*corners, strict=True))
        self.arrow_m = _LENGTH * size_m
        self.view = self._best_view()
        seen = [self.view.seen(point) for point in (*corners, *map(self._tip, freedom.ways))]
        self.low = (min(x for x, _ in seen), min(y for _, y in seen))
        self.high = (max(x for x, _ in seen), max(y for _, y in seen))
        wide, tall = self.high[0] - self.low[0], self.high[1] - self.low[1]
        room = width_px - 2 * _MARGIN_PX - _NAMES_PX
        self.scale = min(room / wide, (_MOST_HEIGHT_PX - 2 * _MARGIN_PX) / tall)
        lines = len(freedom.ways) + 5
        self.height_px = max(self.scale * tall, _LINE_PX * lines) + 2 * _MARGIN_PX
        self.top = (self.height_px - self.scale * tall) / 2
        self.left = _MARGIN_PX + (room - self.scale * wide) / 2

    def drawing(self) -> Drawing:
        """Return the picture."""
        items: list[Item] = []
        others = self.bodies[1:]
        order = self.view.back_to_front([_corners(body, pose) for body, pose in others])
        # The part comes last: it is what the picture is about, and others stand before it.
        for body, pose in (*(others[index] for index in order), self.bodies[0]):
            items += body_items(self.view, self._pixels, body, pose, self._look(body), body.name)
        for number, way in enumerate(self.freedom.ways, 1):
            items += self._arrow(number, way)
        items += self._legend()
        title = f"What is in the way of {self.freedom.part} of {self.freedom.task.name}"
        return Drawing(self.width_px, self.height_px, title, tuple(items))

    def _look(self, body: Body) -> Look:
        if body.name == self.freedom.part:
            return Look(_PART, opacity=_SOLID)
        if body.name in self.freedom.blockers:
            return Look(_IN_THE_WAY, opacity=_SEEN_THROUGH)
        return Look(_OTHER, opacity=_PALE)

    def _best_view(self) -> View:
        """Return from where the fewest directions point at the eye or away from it."""
        views = [View(math.radians(degrees)) for degrees in _AZIMUTHS_DEG]
        start = self.middle

        def shortest(view: View) -> float:
            return min(
                math.dist(view.seen(start), view.seen(self._tip(way))) for way in self.freedom.ways
            )

        return max(views, key=lambda view: round(shortest(view), 4))

    def _tip(self, way: Way) -> Point3:
        x, y, z = (a + self.arrow_m * b for a, b in zip(self.middle, way.direction, strict=True))
        return (x, y, z)

    def _pixels(self, point: Point3) -> Point:
        x, y = self.view.seen(point)
        return (
            self.left + self.scale * (x - self.low[0]),
            self.top + self.scale * (self.high[1] - y),
        )

    def _arrow(self, number: int, way: Way) -> Iterator[Item]:
        role = _BLOCKED if way.obstacles else _FREE
        start, tip = self._pixels(self.middle), self._pixels(self._tip(way))
        yield Shape((start, tip), Look(stroke=role, width_px=2.2), closed=False)
        length = math.dist(start, tip)
        if length > _HEAD_PX:
            along = ((tip[0] - start[0]) / length, (tip[1] - start[1]) / length)
            back = (tip[0] - _HEAD_PX * along[0], tip[1] - _HEAD_PX * along[1])
            half = _HEAD_PX / 2.2
            left = (back[0] - half * along[1], back[1] + half * along[0])
            right = (back[0] + half * along[1], back[1] - half * along[0])
            yield Shape((tip, left, right), Look(role))
        yield Disc(tip, 8.5, Look("paper", role, 1.4), title=direction_name(way.direction))
        yield Label(tip, str(number), role=role, size_px=10.0, bold=True)

    def _legend(self) -> Iterator[Item]:
        """Yield what the colours and the numbers of arrows mean, on the right."""
        x, y = self.width_px - _NAMES_PX, _MARGIN_PX + _LINE_PX / 2
        colours = [(_PART, _SOLID, self.freedom.part)]
        if self.freedom.blockers:
            colours.append((_IN_THE_WAY, _SEEN_THROUGH, "in its way"))
        colours.append((_OTHER, _PALE, "in place, not in its way"))
        for role, opacity, words in colours:
            yield Disc((x, y), 6.0, Look(role, opacity=opacity))
            yield Label((x + 14, y), words, anchor="start")
            y += _LINE_PX
        y += _LINE_PX / 2
        for number, way in enumerate(self.freedom.ways, 1):
            role = _BLOCKED if way.obstacles else _FREE
            yield Disc((x, y), 8.5, Look("paper", role, 1.4))
            yield Label((x, y), str(number), role=role, size_px=10.0, bold=True)
            yield Label((x + 14, y), _words(way), anchor="start")
            y += _LINE_PX


def _words(way: Way) -> str:
    name = direction_name(way.direction)
    if not way.obstacles:
        return f"{name} free"
    more = f" and {len(way.obstacles) - 1} more" if len(way.obstacles) > 1 else ""
    return f"{name} {way.obstacles[0].part}{more}"


def _corners(body: Body, pose: Pose) -> list[Point3]:
    return [pose.apply(corner) for shape in body.exact_shapes for corner in corners_of(shape)]
