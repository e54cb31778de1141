"""A product as it is put together: part after part comes along its way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from skillplan.physics.performance import Image
from skillplan.task.pose import Point as Point3
from skillplan.task.task import Task
from skillplan.views.pictures.added_parts import AddedPart, Piece, added_parts, apart
from skillplan.views.pictures.depth_buffer import DepthBuffer
from skillplan.views.pictures.drawing import Disc, Drawing, Item, Label, Look, Point, Shape
from skillplan.views.pictures.exploded_picture import best_view
from skillplan.views.pictures.raster_canvas import FINER, raster, rgb
from skillplan.views.text.wording import direction_name

FRAMES_PER_S = 12.5
# Of a part: the frames of its way, and those for which it rests; of the end, the rest.
_MOVING, _RESTING, _END = 10, 4, 25
# How far away parts appear, as a share of the product's size.
_AWAY = 0.55
_MARGIN_PX, _NAMES_PX, _LINE_PX, _HEAD_PX = 18.0, 200.0, 21.0, 34.0
_MOST_HEIGHT_PX = 460.0


def assembly_film(task: Task, skills: Sequence[str], width_px: float = 720.0) -> Iterator[Image]:
    """Yield pictures of a product as a plan puts it together, `FRAMES_PER_S` for a second.

    Parameters
    ----------
    task
        Whose bodies have goals.
    skills
        Of the plan.
    width_px
        How wide each picture is.

    Raises
    ------
    ValueError
        If the plan brings no body to a place.
    """
    parts = added_parts(task, skills)
    if not parts:
        raise ValueError("The plan brings no body to a place.")
    return _Film(task.name, parts, width_px).images()


class _Film:
    """What the pictures of one film share."""

    def __init__(self, name: str, parts: Sequence[AddedPart], width_px: float) -> None:
        self.name, self.width_px = name, width_px
        self.pieces = [Piece(number, one, one.goal) for number, one in enumerate(parts, 1)]
        self.view = best_view(apart(parts))
        placed = [corner for one in self.pieces for corner in one.exact_corners]
        size_m = max(max(values) - min(values) for values in zip(*placed, strict=True))
        self.away_m = _AWAY * size_m
        moved = [c for one in self.pieces for c in one.moved(self.away_m).exact_corners]
        seen = [self.view.seen(corner) for corner in (*placed, *moved)]
        self.low = (min(x for x, _ in seen), min(y for _, y in seen))
        self.high = (max(x for x, _ in seen), max(y for _, y in seen))
        wide, tall = self.high[0] - self.low[0], self.high[1] - self.low[1]
        room = width_px - 2 * _MARGIN_PX - _NAMES_PX
        self.scale = min(room / wide, (_MOST_HEIGHT_PX - 2 * _MARGIN_PX) / tall)
        self.lines_px = _LINE_PX * len(parts)
        self.height_px = max(self.scale * tall, self.lines_px) + 2 * _MARGIN_PX + _HEAD_PX
        self.left = _MARGIN_PX + (room - self.scale * wide) / 2
        self.top = _HEAD_PX + (self.height_px - _HEAD_PX - self.scale * tall) / 2

    def images(self) -> Iterator[Image]:
        """Yield all pictures."""
        width, height = round(self.width_px) * FINER, round(self.height_px) * FINER
        there = DepthBuffer(width, height, rgb("paper"))
        for number, piece in enumerate(self.pieces):
            words = self._words(number)
            for frame in range(_MOVING):
                # It comes to rest gently.
                left = 1.0 - frame / _MOVING
                moment = there.copy()
                self._add(moment, piece.moved(left * left * self.away_m))
                yield raster(words, moment.pixels)
            self._add(there, piece)
            last = number == len(self.pieces) - 1
            for _ in range(_END if last else _RESTING):
                yield raster(words, there.pixels)

    def _add(self, buffer: DepthBuffer, piece: Piece) -> None:
        part = piece.part
        buffer.add(self.view, self._finer, part.body, piece.pose, rgb(part.role))

    def _words(self, number: int) -> Drawing:
        title = f"{self.name} put together"
        return Drawing(self.width_px, self.height_px, title, tuple(self._names(number)))

    def _finer(self, point: Point3) -> Point:
        x, y = self._pixels(point)
        return (x * FINER, y * FINER)

    def _pixels(self, point: Point3) -> Point:
        x, y = self.view.seen(point)
        return (
            self.left + self.scale * (x - self.low[0]),
            self.top + self.scale * (self.high[1] - y),
        )

    def _names(self, current: int) -> Iterator[Item]:
        """Yield a heading, and all parts with their colours, the present one marked."""
        piece = self.pieces[current]
        words = f"{piece.number}. {piece.part.body.name}, {direction_name(piece.part.along)}"
        yield Label((_MARGIN_PX, _MARGIN_PX), words, size_px=15.0, anchor="start", bold=True)
        x = self.width_px - _NAMES_PX
        y = _HEAD_PX + (self.height_px - _HEAD_PX - self.lines_px) / 2
        for index, one in enumerate(self.pieces):
            come = index <= current
            fill = Look(one.part.role, opacity=1.0 if come else 0.25)
            yield Disc((x, y), 6.0, fill)
            if index == current:
                yield Shape(((x - 22, y - 5), (x - 12, y), (x - 22, y + 5)), Look("ink"))
            role = "ink" if come else "muted"
            text = f"{one.number}. {one.part.body.name}"
            yield Label((x + 14, y), text, role, anchor="start", bold=index == current)
            y += _LINE_PX
