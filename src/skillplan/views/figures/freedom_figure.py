"""A part among the parts in place: obstacles in colour, and an arrow along each direction."""

from __future__ import annotations

import math

from skillplan.records.questions import Freedom, Way
from skillplan.task.pose import Point as Point3
from skillplan.task.pose import Pose
from skillplan.views.figures.picture import COLOURS, Note, Picture
from skillplan.views.figures.solids import (
    AZIMUTHS_DEG,
    Camera,
    SolidPainter,
    body_corners,
    fitted_height,
)
from skillplan.views.text.wording import direction_name

# Role and opacity of the part, its obstacles and all other parts, from the front to the back.
_PART, _IN_THE_WAY, _OTHER = ("blue", 0.85), ("orange", 0.5), ("grey", 0.3)
_FREE, _BLOCKED = "green", "red"
_MARGIN_PX, _NAMES_PX, _LINE_PX = 26.0, 250.0, 19.0
_MOST_HEIGHT_PX = 560.0
# Length of an arrow as a share of the size of the assembly.
_LENGTH = 0.28


def freedom_picture(freedom: Freedom, goals: dict[str, Pose], width_px: float = 760.0) -> Picture:
    """Return a part in its place, with its obstacles and its directions.

    Parameters
    ----------
    freedom
        Obstacles of the part by direction.
    goals
        Places of bodies in the finished product.
    width_px
        Width of the picture.

    Raises
    ------
    ValueError
        If the part has no body with a place.
    """
    if freedom.part not in goals:
        raise ValueError(f"{freedom.part} has no body with a place.")
    scene = freedom.task.scene
    names = [freedom.part, *(name for name in freedom.present if name in goals)]
    corners = {name: body_corners(scene.body(name), goals[name]) for name in names}
    every = [corner for points in corners.values() for corner in points]
    own = corners[freedom.part]
    x, y, z = (sum(values) / len(own) for values in zip(*own, strict=True))
    middle = (x, y, z)
    length_m = _LENGTH * max(max(values) - min(values) for values in zip(*every, strict=True))
    tips = [_tip(middle, way, length_m) for way in freedom.ways]
    points = [*every, *tips]
    room = width_px - 2 * _MARGIN_PX - _NAMES_PX
    area = (_MARGIN_PX, _MARGIN_PX, room, _MOST_HEIGHT_PX - 2 * _MARGIN_PX)
    camera = _best_camera(middle, tips).fitted(points, area)
    tall_px = fitted_height(camera, points)
    inner_px = max(tall_px, _LINE_PX * (len(freedom.ways) + 5))
    camera = camera.lowered((inner_px - tall_px) / 2)
    title = f"What is in the way of {freedom.part} of {freedom.task.name}"
    picture = Picture(width_px, inner_px + 2 * _MARGIN_PX, title)
    looks = {
        name: _PART if name == freedom.part else _IN_THE_WAY if name in freedom.blockers else _OTHER
        for name in names
    }
    for look in (_OTHER, _IN_THE_WAY, _PART):
        painter = SolidPainter(camera, picture.width_px, picture.height_px)
        for number, name in enumerate(names):
            if looks[name] == look:
                painter.add(scene.body(name), goals[name], COLOURS[look[0]], number)
        picture.image(painter.image(look[1]))
    for number, (way, tip) in enumerate(zip(freedom.ways, tips, strict=True), 1):
        role, end = _role_of(way), camera.pixel(tip)
        picture.arrow(camera.pixel(middle), end, role, 2.2, head_px=9.0)
        picture.disc(end, 8.5, "paper", role, 1.4, note=Note(direction_name(way.direction)))
        picture.label(end, str(number), role, 10.0, bold=True)
    _draw_legend(picture, freedom)
    return picture


def _tip(middle: Point3, way: Way, length_m: float) -> Point3:
    x, y, z = (a + length_m * b for a, b in zip(middle, way.direction, strict=True))
    return (x, y, z)


def _best_camera(middle: Point3, tips: list[Point3]) -> Camera:
    """Return the camera for which the shortest arrow in the picture is longest."""
    cameras = [Camera(math.radians(degrees)) for degrees in AZIMUTHS_DEG]

    def shortest(camera: Camera) -> float:
        return min(math.dist(camera.pixel(middle), camera.pixel(tip)) for tip in tips)

    return max(cameras, key=lambda camera: round(shortest(camera), 4))


def _role_of(way: Way) -> str:
    return _BLOCKED if way.obstacles else _FREE


def _draw_legend(picture: Picture, freedom: Freedom) -> None:
    """Explain the colours and the numbers of the arrows on the right."""
    x, y = picture.width_px - _NAMES_PX, _MARGIN_PX + _LINE_PX / 2
    entries = [(_PART, freedom.part)]
    if freedom.blockers:
        entries.append((_IN_THE_WAY, "in its way"))
    entries.append((_OTHER, "in place, not in its way"))
    for (role, opacity), words in entries:
        picture.disc((x, y), 6.0, role, opacity=opacity)
        picture.label((x + 14, y), words, anchor="start")
        y += _LINE_PX
    y += _LINE_PX / 2
    for number, way in enumerate(freedom.ways, 1):
        picture.disc((x, y), 8.5, "paper", _role_of(way), 1.4)
        picture.label((x, y), str(number), _role_of(way), 10.0, bold=True)
        picture.label((x + 14, y), _describe(way), anchor="start")
        y += _LINE_PX


def _describe(way: Way) -> str:
    name = direction_name(way.direction)
    if not way.obstacles:
        return f"{name} free"
    more = f" and {len(way.obstacles) - 1} more" if len(way.obstacles) > 1 else ""
    return f"{name} {way.obstacles[0].part}{more}"
