"""Axis-aligned boxes along a skill's motion, and a support under what it leaves behind.

The motion is a transfer at safe height and, at every via point, an approach and a retreat. They are
vertical, with a stretch along the direction in which a part goes in, or from which the hand comes.
A skill is infeasible where a moving box runs into a body, or where what it places or fastens
has nothing beneath it: a part left in the air drops and ends elsewhere than predicted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pydantic import Field

from skillplan.collision.box_sweeps import Sweep, hand_direction, sweeps_of
from skillplan.collision.boxes import WorldBox, centroid, contact_area, sweep_hits, world_boxes
from skillplan.collision.detector import Detector
from skillplan.task import back_end
from skillplan.task.back_end import BackEnd
from skillplan.task.motion import Event, Point, Visit
from skillplan.task.pose import DOWN, Pose, same_direction
from skillplan.task.scene import WORLD, Body, Box, Placement
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

_QUARTER_RAD = math.pi / 2
# So little does not show in a box: 1 mm of a metre [rad].
_TURNED_RAD = 1e-3


@dataclass(frozen=True, slots=True)
class _Hit:
    """A possible collision: it happens where the fact holds."""

    fact: str
    obstacle: str
    sweep: Sweep


@dataclass(frozen=True, slots=True)
class _Ground:
    """What would support a placed body: the facts of its supporters and where they touch."""

    body: str
    on_table: bool
    centre: tuple[float, float]
    contacts: tuple[tuple[str, str, tuple[tuple[float, float, float, float], ...]], ...]


@dataclass(frozen=True, slots=True)
class _SweptMotion:
    """Everything that can befall a skill on one path, worked out once."""

    present: State
    absent: State
    hits: tuple[_Hit, ...]
    grounds: tuple[_Ground, ...]


class AabbDetector(Detector):
    """Checks swept axis-aligned boxes, and what supports them."""

    name = "aabb"
    expected_s = 1e-4

    class Options(back_end.Options):
        """Options of the boxes."""

        tolerance_m: float = Field(
            default=2e-4,
            ge=0,
            le=0.01,
            description="overlap and gap that still count as touching [m]",
        )
        check_support: bool = Field(
            default=True,
            description="require something beneath what is placed or fastened [-]",
        )

    options: Options

    def __init__(self, task: Task, options: Options | None = None) -> None:
        super().__init__(task, options)
        self._swept_motions: dict[tuple[str, int], _SweptMotion] = {}
        self._arm_is_checked = False
        self._placed = tuple(
            (body, placement, world_boxes(body, placement.pose))
            for body in task.scene.bodies
            for placement in body.placements
            if placement.solid and placement.frame == WORLD
        )
        self._travel_matters = {robot.name: False for robot in task.scene.robots}
        for robot in task.scene.robots:
            self._travel_matters[robot.name] = any(
                box.high[2] > robot.safe_height_m + self.options.tolerance_m
                for _, _, boxes in self._solids(frozenset())
                for box in boxes
            )

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Note whether another back end checks the arm."""
        self._arm_is_checked = any(
            other.expensive or (isinstance(other, Detector) and other.checks_arm)
            for other in others
        )

    def not_checked(self) -> tuple[str, ...]:
        """Return that the arm is not checked, unless another back end does."""
        if self._arm_is_checked:
            return ()
        return ("the arm's links, fingers and postures: aabb checks boxes of parts and tools",)

    def refuses(self) -> str | None:
        """Return what is not parallel to the axes: a box about it would be too large."""
        for body, placement, _ in self._placed:
            turned = _off_axes(placement.pose)
            if turned is not None:
                return (
                    f"its boxes are parallel to the axes, and {body.name!r} is turned by "
                    f"{turned} where {placement.fact} holds. Take swept, or turn it by quarters"
                )
        for skill, visit in _visits(self.task):
            hand = hand_direction(self.task.scene, visit)
            for direction, does in ((visit.along, "goes"), (hand, "is held")):
                if not _is_axis(direction):
                    shown = ", ".join(f"{value:.4g}" for value in direction)
                    return (
                        f"its boxes are parallel to the axes, and {visit.subject!r} {does} along "
                        f"[{shown}] in {skill}. Take swept, or a direction along an axis"
                    )
        return self._cannot_judge_support() if self.options.check_support else None

    def _cannot_judge_support(self) -> str | None:
        """Return what round or slanted faces have to hold, where boxes about them do not."""
        for skill, visit in _visits(self.task):
            if visit.event is Event.GRASP:
                continue
            for ground in self._grounds((visit,)):
                if ground.on_table or _bears(ground, ground.contacts):
                    continue
                own = self.task.scene.body(ground.body)
                boxes = world_boxes(own, visit.pose)
                about = [
                    body
                    for body, _, there in self._solids(frozenset({own.name}))
                    if any(_overlap(one, other) for one in boxes for other in there)
                ]
                if not all(_is_of_boxes(body) for body in (own, *about)):
                    return (
                        f"no boxes bear that about {own.name!r} in {skill}, and boxes cannot tell "
                        "what holds a round or slanted face. Take swept, or option "
                        "check_support: false"
                    )
        return None

    def check(self, skill: Skill, state: State) -> Verdict:
        """Check the motion of `skill`; see :meth:`BackEnd.check`."""
        facts = self.task.facts
        if skill.motion is None:
            return Verdict.feasible(facts.none, facts.none)
        swept = self._swept_motion(skill, state)
        present, absent = swept.present, swept.absent
        for hit in swept.hits:
            fact = facts.of(hit.fact)
            if hit.fact in state:
                return Verdict.infeasible(
                    f"{hit.sweep.mover} runs into {hit.obstacle} on {hit.sweep.label}",
                    present | fact,
                    absent,
                    {
                        "moving": hit.sweep.mover,
                        "bodies": [hit.obstacle],
                        "during": hit.sweep.label,
                    },
                )
            absent |= fact
        for ground in swept.grounds:
            bearers = [contact for contact in ground.contacts if contact[0] in state]
            present |= facts.of(*(contact[0] for contact in bearers))
            absent |= facts.of(*(c[0] for c in ground.contacts if c[0] not in state))
            if not ground.on_table and not _bears(ground, bearers):
                names = sorted({body for _, body, _ in bearers})
                reason = (
                    f"{ground.body} would tip off {', '.join(names)}"
                    if names
                    else f"{ground.body} has nothing beneath it"
                )
                possible = sorted({body for _, body, _ in ground.contacts})
                return Verdict.infeasible(
                    reason,
                    present,
                    absent,
                    {"body": ground.body, "bodies": names, "possible_supports": possible},
                )
        return Verdict.feasible(present, absent)

    def _swept_motion(self, skill: Skill, state: State) -> _SweptMotion:
        assert skill.motion is not None
        robot = self.task.scene.robot(skill.motion.robot)
        place_fact, place = robot.place(state)
        tool = robot.tool(state)
        facts = self.task.facts
        present, absent = facts.none, facts.none
        if self._travel_matters[robot.name]:
            present |= facts.of(place_fact)
        if any(item.envelope is not None for item in robot.tools):
            if tool is None:
                absent |= facts.of(*(item.fact for item in robot.tools))
            else:
                present |= facts.of(tool.fact)
        if len(skill.motion.routes) > 1:
            present |= next(
                route.when
                for route in skill.motion.routes
                if state.bits & route.when.bits == route.when.bits
            )
        key = (skill.name, present.bits)
        swept = self._swept_motions.get(key)
        if swept is None:
            visits = skill.motion.visits(state)
            sweeps = tuple(
                sweeps_of(self.task.scene, robot, place, tool, visits, skill.motion.carries)
            )
            swept = _SweptMotion(
                present,
                absent,
                tuple(self._hits(sweeps)),
                tuple(self._grounds(visits)) if self.options.check_support else (),
            )
            self._swept_motions[key] = swept
        return swept

    def _hits(self, sweeps: tuple[Sweep, ...]) -> Iterator[_Hit]:
        """Yield every collision that some state would cause, in the order of the motion."""
        seen = set()
        for sweep in sweeps:
            for body, placement, boxes in self._solids(sweep.spares):
                key = (placement.fact, sweep.label, sweep.mover)
                if key in seen:
                    continue
                if any(
                    sweep_hits(moving, sweep.by, obstacle, self.options.tolerance_m)
                    for moving in sweep.boxes
                    for obstacle in boxes
                ):
                    seen.add(key)
                    yield _Hit(placement.fact, body.name, sweep)

    def _solids(
        self, spares: frozenset[str]
    ) -> Iterator[tuple[Body, Placement, tuple[WorldBox, ...]]]:
        return (placed for placed in self._placed if placed[0].name not in spares)

    def _grounds(self, visits: tuple[Visit, ...]) -> Iterator[_Ground]:
        """Yield what has to support each body that the motion leaves behind."""
        tolerance_m = self.options.tolerance_m
        for visit in visits:
            if visit.event not in (Event.RELEASE, Event.DRIVE):
                continue
            body = self.task.scene.body(visit.subject)
            # What a screw is pressed on is beneath it along its axis.
            sideways = visit.event is Event.DRIVE and not same_direction(visit.along, DOWN)
            level = visit.pose.inverse() if sideways else None
            boxes = world_boxes(body, visit.pose if level is None else level.then(visit.pose))
            floor_m = min(box.low[2] for box in boxes)
            feet = [box for box in boxes if box.low[2] - floor_m <= tolerance_m]
            contacts = []
            for other, placement, there in self._solids(frozenset({body.name})):
                tops = there if level is None else world_boxes(other, level.then(placement.pose))
                areas = tuple(
                    area
                    for foot in feet
                    for top in tops
                    if (area := contact_area(foot, top, tolerance_m)) is not None
                )
                if areas:
                    contacts.append((placement.fact, other.name, areas))
            on_table = level is None and floor_m <= tolerance_m
            yield _Ground(body.name, on_table, centroid(boxes), tuple(contacts))


def _off_axes(pose: Pose) -> str | None:
    """Return by how much a pose is turned where that is not by quarters, in degrees."""
    if pose.is_upright:
        yaw_rad = pose.yaw_rad
        if abs(yaw_rad - round(yaw_rad / _QUARTER_RAD) * _QUARTER_RAD) <= _TURNED_RAD:
            return None
        return f"{math.degrees(yaw_rad):.4g} degrees"
    if all(_is_axis(row) for row in pose.rotation):
        return None
    angle_rad = 2 * math.acos(min(1.0, abs(pose.orientation[3])))
    return f"{math.degrees(angle_rad):.4g} degrees in space"


def _is_axis(direction: Point) -> bool:
    """Whether a unit vector is parallel to an axis of the world."""
    return sum(abs(value) <= _TURNED_RAD for value in direction) == 2


def _is_of_boxes(body: Body) -> bool:
    return all(isinstance(shape, Box) for shape in body.exact_shapes)


def _overlap(one: WorldBox, other: WorldBox) -> bool:
    return all(
        low <= top and bottom <= high
        for low, high, bottom, top in zip(one.low, one.high, other.low, other.high, strict=True)
    )


def _visits(task: Task) -> Iterator[tuple[str, Visit]]:
    """Yield every visit of a task that handles something, with the name of its skill."""
    for skill in task.skills:
        motions = [way.motion for way in skill.ways]
        if not motions and skill.motion is not None:
            motions = [skill.motion]
        for motion in motions:
            for route in motion.routes:
                for visit in route.visits:
                    if visit.event in (Event.GRASP, Event.RELEASE, Event.DRIVE):
                        yield skill.name, visit


def _bears(
    ground: _Ground,
    bearers: Sequence[tuple[str, str, tuple[tuple[float, float, float, float], ...]]],
) -> bool:
    """Whether the body's centre lies within the hull rectangle of its contacts."""
    areas = [area for _, _, touching in bearers for area in touching]
    if not areas:
        return False
    x, y = ground.centre
    return min(area[0] for area in areas) <= x <= max(area[2] for area in areas) and min(
        area[1] for area in areas
    ) <= y <= max(area[3] for area in areas)
