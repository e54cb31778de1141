"""The parts of a product in the order in which they are added, and as pieces moved away."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from skillplan.task.pose import DOWN, Point, Pose
from skillplan.task.scene import Body
from skillplan.task.task import Task
from skillplan.views.pictures.drawing import SERIES
from skillplan.views.pictures.outlines import corners_of
from skillplan.views.pictures.plan_places import reached_state, releases

_GAP_M = 0.018


@dataclass(frozen=True, slots=True)
class AddedPart:
    """A part that is brought to its place.

    Parameters
    ----------
    body, goal
        What belongs where.
    along
        Unit vector in which it comes.
    role
        Of its colour.
    """

    body: Body
    goal: Pose
    along: Point
    role: str


@dataclass(frozen=True, slots=True)
class Piece:
    """A part, moved away from its place.

    Parameters
    ----------
    number
        In the order in which parts are added, from 1.
    part
        The part.
    pose
        Where it is.
    """

    number: int
    part: AddedPart
    pose: Pose

    @property
    def corners(self) -> list[Point]:
        """Corners of all its shapes in the world [m]."""
        return [
            self.pose.apply(corner)
            for shape in self.part.body.shapes
            for corner in corners_of(shape)
        ]

    @property
    def exact_corners(self) -> list[Point]:
        """Corners of its true shapes in the world [m]."""
        return [
            self.pose.apply(corner)
            for shape in self.part.body.exact_shapes
            for corner in corners_of(shape)
        ]

    def moved(self, length_m: float) -> Piece:
        """Return it at its place but for so much of its way."""
        away = [-length_m * value for value in self.part.along]
        return Piece(self.number, self.part, self.part.goal.moved((away[0], away[1], away[2])))


def added_parts(task: Task, skills: Sequence[str]) -> list[AddedPart]:
    """Return what a plan brings to a place, in its order.

    Parameters
    ----------
    task
        Whose bodies have goals.
    skills
        Of the plan.
    """
    goals = task.scene.at(reached_state(task, skills))
    names = [body.name for body in task.scene.bodies]
    return [
        AddedPart(task.scene.body(name), goals[name], along or DOWN, role_of(names.index(name)))
        for name, along in releases(task, skills).items()
        if name in goals
    ]


def role_of(number: int) -> str:
    """Return the role of the colour of a part, by its number in the task."""
    return SERIES[number % len(SERIES)]


def apart(parts: Iterable[AddedPart]) -> list[Piece]:
    """Return parts as pieces, each clear of those before it."""
    pieces: list[Piece] = []
    for part in parts:
        body, goal, (x, y, z) = part.body, part.goal, part.along
        away = (-x, -y, -z)
        least = -body.reach_m(goal, part.along)
        over = [
            one.part.body.reach_m(one.pose, away) + _GAP_M
            for one in pieces
            if _share_plan(one.part, part)
        ]
        lift = max([0.0, *(reach - least for reach in over)])
        pieces.append(Piece(len(pieces) + 1, part, goal).moved(lift))
    return pieces


def _share_plan(one: AddedPart, other: AddedPart) -> bool:
    """Whether a part would pass another one on its way."""
    x, y, z = (-value for value in other.along)
    for axis in ((y, z, x), (z, x, y)):
        back = (-axis[0], -axis[1], -axis[2])
        a = (-one.body.reach_m(one.goal, back), one.body.reach_m(one.goal, axis))
        b = (-other.body.reach_m(other.goal, back), other.body.reach_m(other.goal, axis))
        if a[1] <= b[0] + 1e-6 or b[1] <= a[0] + 1e-6:
            return False
    return True
