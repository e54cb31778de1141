"""Views of a product: exploded, assembled in a film, and one part among its obstacles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image as PillowImage

from skillplan.physics.performance import Image
from skillplan.records.questions import Freedom, Way
from skillplan.task.motion import Event
from skillplan.task.pose import DOWN, Pose
from skillplan.task.pose import Point as Point3
from skillplan.task.scene import Body
from skillplan.task.task import Task
from skillplan.views.figures.exploded_labels import (
    LEGEND_NAME_PX,
    MARGIN_PX,
    MOST_NAMED,
    NAMES_PX,
    PITCH_PX,
    measure_legend_px,
    write_legend,
    write_names,
    write_numbers,
)
from skillplan.views.figures.figure_file import render_figure
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run, get_requested_task
from skillplan.views.figures.figure_style import Heading
from skillplan.views.figures.picture import (
    COLOURS,
    PIXELS_PER_IN,
    SERIES,
    SMALL_PX,
    TEXT_PX,
    Note,
    Picture,
    measure_text_px,
    shorten,
    shorten_middle,
)
from skillplan.views.figures.solids import (
    AZIMUTHS_DEG,
    OVERSAMPLING,
    Bytes,
    Camera,
    Point,
    Points,
    SolidPainter,
    choose_camera,
    find_hull,
    place_corners,
)
from skillplan.views.text.wording import name_direction, shorten_names

SOLVER = "auto"
FILM_FRAMES_PER_S = 12.5

_NOTHING = "The plan brings no body to a place."
_GAP_M = 0.018
_PNG_SCALE = 1.6
_WIDTH_PX, _MOST_HEIGHT_PX, _NUMBERED_WIDTH_PX = 760.0, 980.0, 1100.0
# Frames in which a part moves, rests, and rests at the end of the film.
_MOVING, _RESTING, _END = 10, 4, 25
# Distance at which parts appear, as a share of the size of the product.
_AWAY = 0.55
_FILM_MARGIN_PX, _FILM_NAMES_PX, _HEAD_PX, _FILM_HEIGHT_PX = 18.0, 200.0, 34.0, 460.0
# Largest number of names beside a picture of the film.
_FILM_ROWS = 22


@dataclass(frozen=True, slots=True)
class AddedPart:
    """A part that a plan brings to its place.

    Parameters
    ----------
    along
        Unit vector in which it comes.
    """

    body: Body
    goal: Pose
    along: Point3
    role: str


@dataclass(frozen=True, slots=True)
class Piece:
    """A part at a distance from its place.

    Parameters
    ----------
    number
        Number in the order in which parts are added, from 1.
    """

    number: int
    part: AddedPart
    pose: Pose

    @property
    def corners(self) -> Points:
        """Corners of its true shapes in the world [m], shape (n, 3)."""
        return place_corners(self.part.body, self.pose)

    def moved(self, length_m: float) -> Piece:
        """Return it at a distance from its goal, against the direction in which it comes."""
        x, y, z = (-length_m * value for value in self.part.along)
        return Piece(self.number, self.part, self.part.goal.moved((x, y, z)))


def find_added_parts(task: Task, skills: Sequence[str]) -> list[AddedPart]:
    """Return the parts that a plan brings to a place, in its order."""
    state, directions = task.initial, {}
    for name in skills:
        skill = task.skill(name)
        for visit in () if skill.motion is None else skill.motion.visits(state):
            if visit.event in (Event.RELEASE, Event.DRIVE):
                directions[visit.subject] = visit.along
            elif visit.event is Event.TURN:
                # Placed parts turn with the directions in which they came.
                workholder = task.scene.find_workholder(visit.subject)
                begin, end = workholder.find_orientation(state), f"turned({visit.subject})"
                turned = workholder.turn(begin, end, 1.0)
                for body in task.scene.list_carried(workholder, state) & directions.keys():
                    directions[body] = turned.rotate(directions[body])
        state = skill.prediction_in(state).apply(state)
    goals = task.scene.at(state)
    names = [body.name for body in task.scene.bodies]
    return [
        AddedPart(
            task.scene.body(name), goals[name], along or DOWN, _choose_role(names.index(name))
        )
        for name, along in directions.items()
        if name in goals
    ]


def _choose_role(number: int) -> str:
    return SERIES[number % len(SERIES)]


def take_apart(parts: Iterable[AddedPart]) -> list[Piece]:
    """Return parts as pieces, each clear of the pieces before it."""
    pieces: list[Piece] = []
    for part in parts:
        x, y, z = part.along
        away = (-x, -y, -z)
        low = -part.body.reach_m(part.goal, part.along)
        tops = [
            piece.part.body.reach_m(piece.pose, away) + _GAP_M
            for piece in pieces
            if _share_plan(piece.part, part)
        ]
        lift = max([0.0, *(top - low for top in tops)])
        pieces.append(Piece(len(pieces) + 1, part, part.goal).moved(lift))
    return pieces


def _share_plan(part: AddedPart, other: AddedPart) -> bool:
    """Return whether a part would pass another part on its way."""
    x, y, z = (-value for value in other.along)
    for axis in ((y, z, x), (z, x, y)):
        back = (-axis[0], -axis[1], -axis[2])
        a = (-part.body.reach_m(part.goal, back), part.body.reach_m(part.goal, axis))
        b = (-other.body.reach_m(other.goal, back), other.body.reach_m(other.goal, axis))
        if a[1] <= b[0] + 1e-6 or b[1] <= a[0] + 1e-6:
            return False
    return True


def draw_exploded_view(task: Task, skills: Sequence[str]) -> Picture:
    """Return the parts of a product in the order in which a plan adds them.

    Raises
    ------
    ValueError
        If the plan brings no body to a place.
    """
    parts = find_added_parts(task, skills)
    if not parts:
        raise ValueError(_NOTHING)
    return _draw_exploded(task.name, take_apart(parts))


AddedBody = tuple[Body, Pose, Point3]
"""A body with its goal and the unit vector in which it comes."""


def draw_product(name: str, added: Sequence[AddedBody]) -> Picture:
    """Return the exploded view of a product.

    Parameters
    ----------
    added
        Bodies in the order in which they are added, at least one.
    """
    return _draw_exploded(name, take_apart(list_added_parts(added)))


def list_added_parts(added: Iterable[AddedBody]) -> list[AddedPart]:
    """Return bodies as parts, each in the colour of its place in the order."""
    return [
        AddedPart(body, goal, along, _choose_role(number))
        for number, (body, goal, along) in enumerate(added)
    ]


def render_exploded_png(picture: Picture) -> bytes:
    """Return an exploded view as PNG; equal pictures make equal bytes."""
    return render_figure(picture.figure, ".png", round(PIXELS_PER_IN * _PNG_SCALE))


def _draw_exploded(name: str, pieces: Sequence[Piece]) -> Picture:
    """Return an exploded view: with names at the side, or with numbers if there are too many."""
    numbered = len(pieces) > MOST_NAMED
    name_px = LEGEND_NAME_PX if numbered else NAMES_PX - 20
    names = _shorten_names(pieces, name_px, SMALL_PX if numbered else TEXT_PX)
    width_px = _NUMBERED_WIDTH_PX if numbered else _WIDTH_PX
    solids = [(piece.part.body, piece.pose) for piece in pieces]
    goals = np.array([piece.part.goal.position for piece in pieces])
    points = np.concatenate([goals, *(piece.corners for piece in pieces)])
    room = width_px - 2 * MARGIN_PX - (0.0 if numbered else NAMES_PX)
    area = (MARGIN_PX, MARGIN_PX, room, _MOST_HEIGHT_PX - 2 * MARGIN_PX)
    least_px = 0.0 if numbered else PITCH_PX * len(pieces)
    camera, inner_px = choose_camera(solids).fitted(points, area, least_px)
    drawn_px = inner_px + 2 * MARGIN_PX
    legend_px = measure_legend_px(len(pieces), width_px) if numbered else 0.0
    title = f"Exploded view of {name}, in the order of the plan"
    picture = Picture(width_px, drawn_px + legend_px, title)
    painter = SolidPainter(camera, picture.width_px, picture.height_px)
    for piece in pieces:
        ends = (camera.pixel(piece.part.goal.position), camera.pixel(piece.pose.position))
        picture.line(ends, "muted", dashed=True)
        painter.add(piece.part.body, piece.pose, COLOURS[piece.part.role], piece.number)
    picture.image(painter.image())
    for piece in sorted(pieces, key=lambda piece: camera.project(piece.corners)[:, 2].max()):
        outline = find_hull([(x, y) for x, y, _ in camera.project(piece.corners).tolist()])
        note = Note(f"{piece.number}. {piece.part.body.name}")
        picture.polygon(outline, "paper", opacity=0.0, note=note)
    bodies = painter.bodies
    find = _find_middle if numbered else _find_anchor
    anchors = {piece.number: find(painter, bodies, piece) for piece in pieces}
    if numbered:
        write_numbers(picture, anchors, bodies, drawn_px)
        roles = {piece.number: piece.part.role for piece in pieces}
        write_legend(picture, names, roles, drawn_px)
    else:
        write_names(picture, names, anchors)
    return picture


def _shorten_names(pieces: Sequence[Piece], width_px: float, size_px: float) -> dict[int, str]:
    """Return names that fit a width, by number, in order."""
    names = [piece.part.body.name for piece in pieces]
    short = shorten_names(names, lambda name: measure_text_px(name, size_px) <= width_px)
    return {
        piece.number: shorten_middle(name, width_px, size_px)
        for piece, name in zip(pieces, short, strict=True)
    }


def _find_anchor(painter: SolidPainter, bodies: NDArray[np.int64], piece: Piece) -> Point:
    """Return the rightmost visible pixel of a piece, or its rightmost corner if it is hidden."""
    rows, columns = np.nonzero(bodies == piece.number)
    if not len(columns):
        x, y, _ = max(painter.camera.project(piece.corners).tolist())
        return (x, y)
    right = columns.max()
    row = rows[columns >= right - 2 * OVERSAMPLING].mean()
    return (float(right) / OVERSAMPLING - 1, float(row) / OVERSAMPLING)


def _find_middle(painter: SolidPainter, bodies: NDArray[np.int64], piece: Piece) -> Point:
    """Return the visible pixel of a piece that is nearest to their middle, or its hidden middle."""
    pixels = np.argwhere(bodies == piece.number)[:, ::-1]
    if not len(pixels):
        x, y, _ = painter.camera.project(piece.corners).mean(axis=0).tolist()
        return (x, y)
    off = np.square(pixels - pixels.mean(axis=0)).sum(axis=1)
    x, y = pixels[int(np.argmin(off))].tolist()
    return (x / OVERSAMPLING, y / OVERSAMPLING)


def film_assembly(task: Task, skills: Sequence[str], width_px: float = 720.0) -> Iterator[Image]:
    """Yield pictures of a product as a plan puts it together, `FILM_FRAMES_PER_S` a second.

    Raises
    ------
    ValueError
        If the plan brings no body to a place.
    """
    parts = find_added_parts(task, skills)
    if not parts:
        raise ValueError(_NOTHING)
    return _Film(task.name, parts, round(width_px)).images()


class _Film:
    """The common layout of the pictures of a film."""

    def __init__(self, name: str, parts: Sequence[AddedPart], width_px: int) -> None:
        self.name, self.width_px = name, width_px
        self.pieces = [Piece(number, part, part.goal) for number, part in enumerate(parts, 1)]
        self.names = _shorten_names(self.pieces, _FILM_NAMES_PX - 46, TEXT_PX)
        self.rows = min(len(parts), _FILM_ROWS)
        placed = np.concatenate([piece.corners for piece in self.pieces])
        self.away_m = _AWAY * float(np.ptp(placed, axis=0).max())
        moved = [piece.moved(self.away_m).corners for piece in self.pieces]
        points = np.concatenate([placed, *moved])
        room = width_px - 2 * _FILM_MARGIN_PX - _FILM_NAMES_PX
        area = (
            _FILM_MARGIN_PX,
            _HEAD_PX + _FILM_MARGIN_PX,
            room,
            _FILM_HEIGHT_PX - 2 * _FILM_MARGIN_PX,
        )
        exploded = [(piece.part.body, piece.pose) for piece in take_apart(parts)]
        self.camera, inner_px = choose_camera(exploded).fitted(points, area, PITCH_PX * self.rows)
        self.height_px = round(inner_px + 2 * _FILM_MARGIN_PX + _HEAD_PX)

    def images(self) -> Iterator[Image]:
        """Yield all pictures."""
        placed = SolidPainter(self.camera, self.width_px, self.height_px)
        for number, piece in enumerate(self.pieces):
            words = self._write_words(number)
            for frame in range(_MOVING):
                # Quadratic, so that the part comes to rest gently.
                remaining = 1.0 - frame / _MOVING
                painter = placed.copy()
                self._add(painter, piece.moved(remaining**2 * self.away_m))
                yield _compose(words, painter)
            self._add(placed, piece)
            image = _compose(words, placed)
            for _ in range(_END if number == len(self.pieces) - 1 else _RESTING):
                yield image

    def _add(self, painter: SolidPainter, piece: Piece) -> None:
        painter.add(piece.part.body, piece.pose, COLOURS[piece.part.role], piece.number)

    def _write_words(self, current: int) -> Bytes:
        """Return an image of a heading and of the parts, with a mark at the current one."""
        picture = Picture(self.width_px, self.height_px, f"{self.name} put together")
        piece = self.pieces[current]
        words = f"{piece.number}. {self.names[piece.number]}, {name_direction(piece.part.along)}"
        corner = (_FILM_MARGIN_PX, _FILM_MARGIN_PX)
        picture.label(corner, words, size_px=15.0, anchor="start", bold=True)
        x = self.width_px - _FILM_NAMES_PX
        y = _HEAD_PX + (self.height_px - _HEAD_PX - PITCH_PX * self.rows) / 2
        first = min(max(0, current - self.rows // 2), len(self.pieces) - self.rows)
        for index, piece in enumerate(self.pieces[first : first + self.rows], first):
            added = index <= current
            picture.disc((x, y), 6.0, piece.part.role, opacity=1.0 if added else 0.25)
            if index == current:
                picture.polygon(((x - 22, y - 5), (x - 12, y), (x - 22, y + 5)), "ink")
            text = shorten_middle(
                f"{piece.number}. {self.names[piece.number]}", _FILM_NAMES_PX - 18
            )
            role = "ink" if added else "muted"
            picture.label((x + 14, y), text, role, anchor="start", bold=index == current)
            y += PITCH_PX
        return picture.pixels()


def _compose(words: Bytes, painter: SolidPainter) -> Image:
    """Return solids, reduced to the size of the picture, in front of words."""
    height, width = words.shape[:2]
    sheet = PillowImage.fromarray(words)
    solids = PillowImage.fromarray(painter.image())
    sheet.alpha_composite(solids.resize((width, height), PillowImage.Resampling.BOX))
    return Image(width, height, sheet.convert("RGB").tobytes())


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the task."""
    return [Run(get_requested_task(request))]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the product of a solved task."""
    task, result = get_requested_task(request), outcomes[0].result
    try:
        picture = draw_exploded_view(task, [step.skill for step in result.steps])
    except ValueError as error:
        raise request.unfit(str(error).rstrip(".")) from None
    return picture.with_heading(Heading(picture.title, request.details(outcomes[0].run)))


def film(request: FigureRequest, outcomes: Sequence[Outcome]) -> Iterator[Image]:
    """Yield pictures of the product as the plan puts it together, `FILM_FRAMES_PER_S` a second."""
    task, result = get_requested_task(request), outcomes[0].result
    try:
        return film_assembly(task, [step.skill for step in result.steps])
    except ValueError as error:
        raise request.unfit(str(error).rstrip(".")) from None


# Role and opacity of the part, its obstacles and all other parts, from the front to the back.
_PART, _IN_THE_WAY, _OTHER = ("blue", 0.85), ("orange", 0.5), ("grey", 0.3)
_FREE, _BLOCKED = "green", "red"
_FREEDOM_MARGIN_PX, _FREEDOM_NAMES_PX, _LINE_PX = 26.0, 250.0, 19.0
_FREEDOM_HEIGHT_PX = 560.0
# Length of an arrow as a share of the size of the assembly.
_LENGTH = 0.28


def draw_freedom(freedom: Freedom, goals: dict[str, Pose]) -> Picture:
    """Return a part in its place, with its obstacles and its directions.

    Parameters
    ----------
    freedom
        Obstacles of the part by direction, of a product with a task.
    goals
        Places of bodies in the finished product.

    Raises
    ------
    ValueError
        If the part has no body with a place.
    """
    if freedom.task is None or freedom.part not in goals:
        raise ValueError(f"{freedom.part} has no body with a place.")
    scene = freedom.task.scene
    names = [freedom.part, *(name for name in freedom.present if name in goals)]
    corners = {name: place_corners(scene.body(name), goals[name]) for name in names}
    every = np.concatenate(list(corners.values()))
    middle = corners[freedom.part].mean(axis=0)
    length_m = _LENGTH * float(np.ptp(every, axis=0).max())
    tips = [middle + length_m * np.array(way.direction) for way in freedom.ways]
    points = np.concatenate([every, tips])
    room = _WIDTH_PX - 2 * _FREEDOM_MARGIN_PX - _FREEDOM_NAMES_PX
    area = (
        _FREEDOM_MARGIN_PX,
        _FREEDOM_MARGIN_PX,
        room,
        _FREEDOM_HEIGHT_PX - 2 * _FREEDOM_MARGIN_PX,
    )
    lines_px = _LINE_PX * (len(freedom.ways) + 5)
    camera, inner_px = _best_camera(middle, tips).fitted(points, area, lines_px)
    title = f"Obstacles of {freedom.part} in {freedom.task.name}"
    picture = Picture(_WIDTH_PX, inner_px + 2 * _FREEDOM_MARGIN_PX, title)
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
        role, end = _get_role_of_way(way), camera.pixel(tip)
        picture.arrow(camera.pixel(middle), end, role, 2.2, head_px=9.0)
        picture.disc(end, 8.5, "paper", role, 1.4, note=Note(name_direction(way.direction)))
        picture.label(end, str(number), role, 10.0, bold=True)
    _draw_legend(picture, freedom)
    return picture


def _best_camera(middle: Points, tips: Sequence[Points]) -> Camera:
    """Return the camera for which the shortest arrow in the picture is longest."""
    cameras = [Camera(math.radians(degrees)) for degrees in AZIMUTHS_DEG]

    def shortest(camera: Camera) -> float:
        return min(math.dist(camera.pixel(middle), camera.pixel(tip)) for tip in tips)

    return max(cameras, key=lambda camera: round(shortest(camera), 4))


def _get_role_of_way(way: Way) -> str:
    return _BLOCKED if way.obstacles else _FREE


def _draw_legend(picture: Picture, freedom: Freedom) -> None:
    """Explain the colours and the numbers of the arrows on the right."""
    x, y = picture.width_px - _FREEDOM_NAMES_PX, _FREEDOM_MARGIN_PX + _LINE_PX / 2
    entries = [(_PART, freedom.part)]
    if freedom.blockers:
        entries.append((_IN_THE_WAY, "in its way"))
    entries.append((_OTHER, "in place, not in its way"))
    for (role, opacity), words in entries:
        picture.disc((x, y), 6.0, role, opacity=opacity)
        picture.label((x + 14, y), shorten(words, _FREEDOM_NAMES_PX - 18), anchor="start")
        y += _LINE_PX
    y += _LINE_PX / 2
    for number, way in enumerate(freedom.ways, 1):
        picture.disc((x, y), 8.5, "paper", _get_role_of_way(way), 1.4)
        picture.label((x, y), str(number), _get_role_of_way(way), 10.0, bold=True)
        picture.label((x + 14, y), shorten(_describe(way), _FREEDOM_NAMES_PX - 18), anchor="start")
        y += _LINE_PX


def _describe(way: Way) -> str:
    name = name_direction(way.direction)
    if not way.obstacles:
        return f"{name} free"
    more = f" and {len(way.obstacles) - 1} more" if len(way.obstacles) > 1 else ""
    return f"{name} {way.obstacles[0].part}{more}"
