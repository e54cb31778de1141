"""The product taken apart along the directions in which a plan puts it together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from skillplan.task.pose import Point as Point3
from skillplan.task.task import Task
from skillplan.views.pictures.added_parts import AddedPart, Piece, added_parts, apart
from skillplan.views.pictures.drawing import (
    SMALL_PX,
    Disc,
    Drawing,
    Item,
    Label,
    Look,
    Point,
    Shape,
)
from skillplan.views.pictures.solid_view import View, body_items, inside

# Looked at from above, and from that side of several from which most is seen.
_AZIMUTHS_DEG = (-58, -32, -122, -148, 32, 58, 122, 148)
_MARGIN_PX, _NAMES_PX, _MOST_HEIGHT_PX = 20.0, 210.0, 980.0
_LEAST_PITCH_PX = 21.0


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
    parts = added_parts(task, skills)
    if not parts:
        raise ValueError("The plan brings no body to a place.")
    return exploded_drawing(task.name, parts, width_px)


def exploded_drawing(name: str, parts: Sequence[AddedPart], width_px: float = 760.0) -> Drawing:
    """Return parts of a product, at least one, in the order in which they are added."""
    return _Exploded(name, apart(parts), width_px).drawing()


def best_view(pieces: Sequence[Piece]) -> View:
    """Return from where the least of some pieces is hidden."""
    views = [View(math.radians(degrees)) for degrees in _AZIMUTHS_DEG]
    return min(views, key=lambda view: round(_hidden(view, pieces), 2))


def _hidden(view: View, pieces: Sequence[Piece]) -> float:
    """Return how much of the bodies is behind others, about."""
    order = view.back_to_front([one.corners for one in pieces])
    shapes = [view.outline(pieces[index].corners) for index in order]
    total = 0.0
    for index, shape in enumerate(shapes):
        points = [*shape, tuple(sum(v) / len(shape) for v in zip(*shape, strict=True))]
        covered = [any(inside(p, front) for front in shapes[index + 1 :]) for p in points]
        total += (sum(covered) / len(points)) ** 2
    return total


class _Exploded:
    """What the layers of one picture share."""

    def __init__(self, name: str, pieces: Sequence[Piece], width_px: float) -> None:
        self.name, self.pieces, self.width_px = name, pieces, width_px
        self.view = best_view(pieces)
        seen = [self.view.seen(corner) for one in pieces for corner in one.exact_corners]
        seen += [self.view.seen(one.part.goal.position) for one in pieces]
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
            ends = (self._pixels(piece.part.goal.position), self._pixels(piece.pose.position))
            items.append(Shape(ends, Look(stroke="muted", dashed=True), closed=False))
        for index in self.view.back_to_front([one.corners for one in self.pieces]):
            items += self._body(self.pieces[index])
        items += self._names()
        title = f"Exploded view of {self.name}, in the order of the plan"
        return Drawing(self.width_px, self.height_px, title, tuple(items))

    def _pixels(self, point: Point3) -> Point:
        x, y = self.view.seen(point)
        return (
            self.left + self.scale * (x - self.low[0]),
            self.top + self.scale * (self.high[1] - y),
        )

    def _body(self, piece: Piece) -> Iterator[Item]:
        title = f"{piece.number}. {piece.part.body.name}"
        look = Look(piece.part.role)
        return body_items(self.view, self._pixels, piece.part.body, piece.pose, look, title)

    def _names(self) -> Iterator[Item]:
        """Yield numbers and names on the right, each with a line to its part."""
        order = self.view.back_to_front([one.corners for one in self.pieces])
        outlines = [self.view.outline(self.pieces[index].corners) for index in order]
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
            yield Label((x + 16, y), one.part.body.name, anchor="start")

    def _anchor(self, piece: Piece, fronts: Sequence[Sequence[Point]]) -> Point:
        """Return the rightmost corner of a body on paper, if it can be one that is seen."""
        corners = piece.exact_corners
        seen = [
            corner
            for corner in corners
            if not any(inside(self.view.seen(corner), front) for front in fronts)
        ]
        return max(map(self._pixels, seen or corners))
