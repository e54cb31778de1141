"""The detector ``aabb``: swept axis-aligned boxes, and supports of placed parts.

A motion is a transfer at safe height, and an approach and a retreat at every via point. They are
vertical, with a stretch in the direction of the insertion or of the hand. A skill is infeasible if
a moving box hits a body, or if a placed or fastened body has no support: it would drop and end
elsewhere than predicted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from pydantic import Field

from skillplan.collision.boxes import (
    WorldBox,
    box_at,
    centroid,
    contact_area,
    shank_boxes,
    sweep_hits,
    world_box,
    world_boxes,
)
from skillplan.collision.detector import Detector
from skillplan.task import back_end
from skillplan.task.back_end import BackEnd
from skillplan.task.motion import AXES, Event, Grasp, Visit
from skillplan.task.pose import DOWN, Point, Pose, cross, dot, is_same_direction, plus, unit
from skillplan.task.scene import (
    WORLD,
    Body,
    Placement,
    Robot,
    Scene,
    Tool,
    ToolKind,
    describe_unchecked_joins,
    describe_unchecked_slides,
    name_shank,
)
from skillplan.task.shape import Box
from skillplan.task.skill import Skill
from skillplan.task.state import AND, State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.task.zone import Mover, Zone, list_keep_outs

# Half of the least extent of a box whose sides are shifted inwards [m].
_LEAST_HALF_M = 5e-5
# Component of a direction from which on it counts as along an axis.
_STEEP = 0.5
# Clearance between a hand and a part that it approaches from the side or inserts [m].
_STANDOFF_M = 0.02


@dataclass(frozen=True, slots=True)
class Sweep:
    """A straight displacement of some boxes, and the name of the moving object."""

    label: str
    mover: str
    boxes: tuple[WorldBox, ...]
    by: Point
    spares: frozenset[str]
    is_load: bool = False
    overlaps_m: Mapping[str, float] = field(default_factory=dict)

    def tolerance_m(self, body: str, least_m: float) -> float:
        """Return the overlap with a body that counts as touching, or that a fit states [m]."""
        return least_m + self.overlaps_m.get(body, 0.0)


@dataclass(frozen=True, slots=True)
class _Load:
    """Objects that move at a visit, and the height of their origin above their bottom."""

    body: Body | None
    tool: Tool | None
    lift_m: float


def list_sweeps(
    scene: Scene,
    robot: Robot,
    place: Point,
    tool: Tool | None,
    visits: tuple[Visit, ...],
    carries: str | None,
) -> Iterator[Sweep]:
    """Yield the sweeps at every visit, in order.

    Parameters
    ----------
    place
        Place of its tip at the beginning [m].
    """
    here = place
    for visit in visits:
        if visit.event is Event.DRIVE:
            carries = visit.subject
        into, out = _find_stretches(scene, visit)
        load = _load(scene, visit, tool, carries)
        first = replace(visit, pose=Pose(visit.path[0])) if visit.path else visit
        yield from _sweep_approach(scene, first, load, robot.safe_height_m, here, into)
        for begin, end in pairwise((*visit.path, visit.position)):
            yield from _sweep_load(scene, "the path", visit, load, begin, plus(end, begin, -1.0))
        if visit.event in (Event.GRASP, Event.FETCH):
            carries = visit.subject
        elif visit.event in (Event.RELEASE, Event.DRIVE):
            carries = None
        elif visit.event is Event.OFFLOAD:
            tool = None
        elif visit.event is Event.LOAD:
            tool = next(item for item in robot.tools if item.name == visit.subject)
        load = _load(scene, visit, tool, carries)
        yield from _sweep_retreat(scene, visit, load, robot.safe_height_m, out)
        x_m, y_m, z_m = plus(visit.position, out)
        here = (x_m, y_m, max(robot.safe_height_m, z_m))


def hand_direction(scene: Scene, visit: Visit) -> Point:
    """Return the direction of the hand in the world at a visit."""
    grasp = _get_grasp(scene, visit)
    if grasp is not None:
        return unit(visit.pose.rotate(grasp.approach))
    return visit.along if visit.event is Event.DRIVE else DOWN


def _sweep_approach(
    scene: Scene, visit: Visit, load: _Load, safe_height_m: float, here: Point, into: Point
) -> Iterator[Sweep]:
    """Yield the travel at safe height, the way down, and the insertion."""
    x_m, y_m, z_m = before = plus(visit.position, into, -1.0)
    safe_m = max(safe_height_m, z_m - load.lift_m) + load.lift_m
    transfer: Point = (x_m - here[0], y_m - here[1], 0.0)
    at_height: Point = (here[0], here[1], safe_m)
    yield from _sweep_load(scene, "the travel", visit, load, at_height, transfer)
    down: Point = (0.0, 0.0, z_m - safe_m)
    is_last = not any(into)
    at_safe: Point = (x_m, y_m, safe_m)
    yield from _sweep_load(scene, "the approach", visit, load, at_safe, down, is_last=is_last)
    if not is_last:
        yield from _sweep_load(scene, "the approach", visit, load, before, into, is_last=True)


def _sweep_retreat(
    scene: Scene, visit: Visit, load: _Load, safe_height_m: float, out: Point
) -> Iterator[Sweep]:
    """Yield the retreat and the way up."""
    if any(out):
        yield from _sweep_load(scene, "the retreat", visit, load, visit.position, out)
    after = plus(visit.position, out)
    safe_m = max(safe_height_m, after[2] - load.lift_m) + load.lift_m
    up: Point = (0.0, 0.0, safe_m - after[2])
    yield from _sweep_load(scene, "the retreat", visit, load, after, up)


def _sweep_load(
    scene: Scene,
    label: str,
    visit: Visit,
    load: _Load,
    origin: Point,
    by: Point,
    *,
    is_last: bool = False,
) -> Iterator[Sweep]:
    """Yield the sweeps of the carried body and of the tool on it.

    Parameters
    ----------
    is_last
        True for the stretch that ends at the target.
    """
    body, tool = load.body, load.tool
    spares = frozenset({visit.subject} | ({body.name} if body is not None else set()))
    if body is not None:
        boxes = world_boxes(body, Pose(origin, visit.pose.orientation))
        fits = body.fits if visit.is_fitted and is_last else ()
        overlaps_m = {fit.into: fit.overlap_m for fit in fits if fit.overlap_m > 0}
        yield Sweep(label, body.name, boxes, by, spares, is_load=True, overlaps_m=overlaps_m)
        for into, overlap_m in overlaps_m.items():
            # The overlap is one of the sides: along the insertion it is none.
            core = tuple(_narrow(box, visit.along, overlap_m) for box in boxes)
            others_m = {other: m for other, m in overlaps_m.items() if other != into}
            yield Sweep(label, body.name, core, by, spares, is_load=True, overlaps_m=others_m)
        if body.shank is not None:
            shank = shank_boxes(body, Pose(origin, visit.pose.orientation))
            passes: tuple[str, ...] = ()
            if visit.event is Event.DRIVE and is_last:
                passes = body.shank.passes
            elif visit.event is Event.FETCH and label == "the retreat":
                passes = body.shank.stands_in
            spared = spares.union(passes)
            yield Sweep(label, f"the {name_shank(body.name)}", shank, by, spared, is_load=True)
    if tool is not None and tool.boxes:
        moved = plus(origin, visit.position, -1.0)
        boxes = tuple(_place_tool_box(scene, visit, load, box, moved) for box in tool.boxes)
        yield Sweep(label, tool.name, boxes, by, spares)


def _narrow(box: WorldBox, along: Point, by_m: float) -> WorldBox:
    """Return a box whose sides along an axis of the world are shifted inwards, but not flat."""
    low, high = list(box.low), list(box.high)
    for axis in (axis for axis in range(3) if abs(along[axis]) < _STEEP):
        half_m = (high[axis] - low[axis]) / 2
        in_m = min(by_m, max(half_m - _LEAST_HALF_M, 0.0))
        low[axis], high[axis] = low[axis] + in_m, high[axis] - in_m
    return WorldBox((low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _place_tool_box(
    scene: Scene, visit: Visit, load: _Load, envelope: Box, moved: Point
) -> WorldBox:
    """Return the box about the tool at a visit, displaced by a vector [m]."""
    body = load.body
    if body is None and visit.event in (Event.GRASP, Event.RELEASE, Event.FETCH, Event.DRIVE):
        body = scene.body(visit.subject)
    points = hand_direction(scene, visit)
    if is_same_direction(points, DOWN):
        if body is None:
            top_m = visit.position[2]
        elif visit.pose.is_upright:
            top_m = visit.position[2] + body.height_m
        else:
            top_m = body.reach_m(visit.pose, AXES["z"])
        tip = plus((visit.position[0], visit.position[1], top_m), moved)
        return world_box(envelope, tip)
    back: Point = (-points[0], -points[1], -points[2])
    grasp = _get_grasp(scene, visit)
    held = visit.position if grasp is None else visit.pose.apply(grasp.tip)
    if body is not None:
        held = plus(held, back, body.reach_m(visit.pose, back) - dot(held, back))
    closing = cross(AXES["z"], points) if grasp is None else visit.pose.rotate(grasp.closing)
    level = unit(closing) if math.hypot(*closing) > 1e-6 else AXES["y"]
    return box_at(envelope, Pose.of_axes(plus(held, moved), level, back))


def _load(scene: Scene, visit: Visit, tool: Tool | None, carries: str | None) -> _Load:
    body = None if carries is None else scene.body(carries)
    lift_m = 0.0
    if body is not None and not visit.pose.is_upright:
        lift_m = visit.position[2] + body.reach_m(visit.pose, DOWN)
    if body is not None and body.shank is not None:
        down = visit.pose.inverse().rotate(DOWN)
        lift_m = max(lift_m, body.shank.shape.reach_m(down))
    return _Load(body, tool, lift_m)


def _find_stretches(scene: Scene, visit: Visit) -> tuple[Point, Point]:
    """Return the straight stretches of the hand before and after it acts [m]."""
    none: Point = (0.0, 0.0, 0.0)
    if visit.event not in (Event.GRASP, Event.RELEASE, Event.DRIVE):
        return none, none
    points, grasp = hand_direction(scene, visit), _get_grasp(scene, visit)
    freed_m = _measure_extent_m(scene, visit, points) + _STANDOFF_M
    if visit.event is Event.GRASP:
        # The load is lifted straight up.
        return (none if is_same_direction(points, DOWN) else plus(none, points, freed_m)), none
    if is_same_direction(visit.along, DOWN):
        return none, none
    length_m = visit.insert_m or _measure_extent_m(scene, visit, visit.along) + _STANDOFF_M
    into = plus(none, visit.along, length_m)
    if grasp is not None and scene.body(visit.subject).is_left_straight(visit, grasp):
        return into, plus(none, points, -freed_m)
    return into, plus(none, visit.along, -length_m)


def _measure_extent_m(scene: Scene, visit: Visit, direction: Point) -> float:
    """Return the extent of the handled body along a direction [m]."""
    body, back = scene.body(visit.subject), (-direction[0], -direction[1], -direction[2])
    return body.reach_m(visit.pose, direction) + body.reach_m(visit.pose, back)


def _get_grasp(scene: Scene, visit: Visit) -> Grasp | None:
    if visit.event not in (Event.GRASP, Event.RELEASE):
        return None
    return visit.grasp or scene.body(visit.subject).grasp


_QUARTER_RAD = math.pi / 2
# Rotation that is negligible for a box: 1 mm for 1 m [rad].
_TURNED_RAD = 1e-3


@dataclass(frozen=True, slots=True)
class _Hit:
    """A collision in all states with the fact; with None in all states."""

    fact: str | None
    obstacle: str
    sweep: Sweep


@dataclass(frozen=True, slots=True)
class _Ground:
    """Possible supports of a placed body: their facts and contact areas."""

    body: str
    on_table: bool
    centre: tuple[float, float]
    contacts: tuple[tuple[str, str, tuple[tuple[float, float, float, float], ...]], ...]


@dataclass(frozen=True, slots=True)
class _SweptMotion:
    """All possible collisions and supports of a skill on one path."""

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
            default=True, description="require a support below placed or fastened bodies [-]"
        )

    options: Options

    def __init__(self, task: Task, options: Options | None = None) -> None:
        super().__init__(task, options)
        self._swept_motions: dict[tuple[str, int], _SweptMotion] = {}
        self._arm_is_checked = False
        self._placed = tuple(
            (
                body,
                placement,
                (*world_boxes(body, placement.pose), *shank_boxes(body, placement.pose)),
            )
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
            ) or any(
                zone.keeps_out and zone.high_m > robot.safe_height_m for zone in task.scene.zones
            )

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Check for a back end that checks the arm."""
        self._arm_is_checked = any(
            other.expensive or (isinstance(other, Detector) and other.checks_arm)
            for other in others
        )

    def not_checked(self) -> tuple[str, ...]:
        """Return that the arm is not checked, unless another back end checks it."""
        if self._arm_is_checked:
            return ()
        fitted = [b.name for b in self.task.scene.bodies if any(fit.stops for fit in b.fits)]
        turning = [workholder.name for workholder in self.task.scene.workholders]
        jaws = [name for holder in self.task.scene.holders for name in holder.fixtures]
        closed = [zone.name for zone in list_keep_outs(self.task.scene, "arm")]
        bare = [
            tool.name
            for robot in self.task.scene.robots
            for tool in robot.tools
            if tool.ends and not tool.boxes
        ]
        hands = [
            tool.name
            for robot in self.task.scene.robots
            for tool in robot.tools
            if tool.kind is ToolKind.GRIPPER and tool.hand is not None and not tool.boxes
        ]
        mounted = [
            tool.name
            for robot in self.task.scene.robots
            for tool in robot.tools
            if robot.list_companions(tool)
        ]
        without = f"tools without envelope_m or body: {', '.join(bare)}"
        zones = f"; in {', '.join(closed)} it misses all else of the arm" if closed else ""
        return (
            f"the arm's links, fingers and postures: aabb checks boxes of parts and tools{zones}",
            *([f"the stops of fits at the goals of {', '.join(fitted)}"] if fitted else []),
            *([f"bits, cups and shanks of {without}"] if bare else []),
            *(
                [f"other tools on the hand of the acting one: {', '.join(mounted)}"]
                if mounted
                else []
            ),
            *([f"bodies of the grippers {', '.join(hands)}, without envelope_m"] if hands else []),
            *([f"collisions while {', '.join(turning)} turns"] if turning else []),
            *([f"room for the jaws {', '.join(jaws)} to close"] if jaws else []),
            *describe_unchecked_joins(self.task.scene.bodies),
            *describe_unchecked_slides(self.task.scene.bodies),
        )

    def refuses(self) -> str | None:
        """Refuse bodies and directions oblique to the axes, whose boxes are too large."""
        for body, placement, _ in self._placed:
            turned = _describe_rotation(placement.pose)
            if turned is not None:
                return (
                    f"its boxes are parallel to the axes, and {body.name!r} is turned by "
                    f"{turned} where {placement.fact} holds. Take swept, or turn it by quarters"
                )
        for skill, visit in _list_visits(self.task):
            if visit.aside_m is not None:
                return f"its boxes come from above, and {skill} goes up from below. Take swept"
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
        """Refuse supports by round or slanted faces, which boxes cannot represent."""
        for skill, visit in _list_visits(self.task):
            if visit.event is Event.GRASP or self._list_holding(visit.subject):
                continue
            for ground in self._grounds((visit,)):
                if ground.on_table or _bears(ground, ground.contacts):
                    continue
                own = self.task.scene.body(ground.body)
                boxes = world_boxes(own, visit.pose)
                about = [
                    body
                    for body, _, there in self._solids(frozenset({own.name}))
                    if any(_overlap(box, other) for box in boxes for other in there)
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
            if skill.kind == "release" and self.options.check_support:
                return self._check_release(skill, state)
            return Verdict.feasible(facts.none, facts.none)
        swept = self._swept_motion(skill, state)
        present, absent = swept.present, swept.absent
        for hit in swept.hits:
            fact = facts.none if hit.fact is None else facts.of(hit.fact)
            if hit.fact is None or hit.fact in state:
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
            absent |= state.find_missing(hit.fact)
        return self._check_grounds(swept.grounds, state, present, absent)

    def _check_grounds(
        self, grounds: Sequence[_Ground], state: State, present: State, absent: State
    ) -> Verdict:
        """Return whether bodies left behind have a support, or a holder."""
        facts = self.task.facts
        for ground in grounds:
            held = self._list_holding(ground.body)
            holding = next((fact for fact in held if fact in state), None)
            if holding is not None:
                present |= facts.of(holding)
                continue
            absent |= state.find_missing(*held)
            bearers = [contact for contact in ground.contacts if contact[0] in state]
            present |= facts.of(*(contact[0] for contact in bearers))
            absent |= state.find_missing(*(contact[0] for contact in ground.contacts))
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

    def _list_holding(self, body: str) -> list[str]:
        """Return the facts that holders hold a body."""
        holders = self.task.scene.holders
        return [holder.facts[body] for holder in holders if body in holder.facts]

    def _check_release(self, skill: Skill, state: State) -> Verdict:
        """Return whether a part that a holder lets go of has a support, or is screwed or held."""
        facts, part = self.task.facts, skill.parameters["part"]
        body = self.task.scene.body(part)
        here = body.placement(state)
        done = self.task.operations[part]
        if here is None or done not in state:
            return Verdict.feasible(facts.none, facts.of(done) - state)
        present = facts.of(*here.fact.split(AND), done)
        for screw in self.task.scene.bodies:
            if part in screw.joins and len(screw.joins) > 1:
                driven = self.task.operations[screw.name]
                if driven in state:
                    return Verdict.feasible(present | facts.of(driven), facts.none)
        opened = skill.prediction.delete
        without = facts.state(state.bits & ~opened.bits)
        visit = Visit(here.pose, Event.RELEASE, part)
        verdict = self._check_grounds(tuple(self._grounds((visit,))), without, present, facts.none)
        screws = facts.of(
            *(
                self.task.operations[screw.name]
                for screw in self.task.scene.bodies
                if part in screw.joins and len(screw.joins) > 1
            )
        )
        absent = ((verdict.absent or facts.none) | screws) - opened
        return replace(verdict, absent=absent)

    def _swept_motion(self, skill: Skill, state: State) -> _SweptMotion:
        assert skill.motion is not None
        robot = self.task.scene.robot(skill.motion.robot)
        place_fact, place = robot.place(state)
        tool = robot.tool(state, skill.parameters.get("tool"))
        facts = self.task.facts
        present, absent = facts.none, facts.none
        if self._travel_matters[robot.name]:
            present |= facts.of(place_fact)
        if any(item.boxes for item in robot.tools):
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
                list_sweeps(self.task.scene, robot, place, tool, visits, skill.motion.carries)
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
        """Yield the collisions in any state, in the order of the motion."""
        seen = set()
        for sweep in sweeps:
            for body, placement, boxes in self._solids(sweep.spares):
                key = (placement.fact, sweep.label, sweep.mover)
                if key in seen:
                    continue
                if any(
                    sweep_hits(
                        moving,
                        sweep.by,
                        obstacle,
                        sweep.tolerance_m(body.name, self.options.tolerance_m),
                    )
                    for moving in sweep.boxes
                    for obstacle in boxes
                ):
                    seen.add(key)
                    yield _Hit(placement.fact, body.name, sweep)
            mover: Mover = "load" if sweep.is_load else "arm"
            for zone in list_keep_outs(self.task.scene, mover):
                if any(
                    _enters(box, sweep.by, zone, self.options.tolerance_m) for box in sweep.boxes
                ):
                    yield _Hit(None, zone.label, sweep)

    def _solids(
        self, spares: frozenset[str]
    ) -> Iterator[tuple[Body, Placement, tuple[WorldBox, ...]]]:
        return (placed for placed in self._placed if placed[0].name not in spares)

    def _grounds(self, visits: tuple[Visit, ...]) -> Iterator[_Ground]:
        """Yield the possible supports of each body that the motion leaves behind."""
        tolerance_m = self.options.tolerance_m
        for visit in visits:
            if visit.event not in (Event.RELEASE, Event.DRIVE):
                continue
            body = self.task.scene.body(visit.subject)
            # The support of a screw is below it along its axis.
            sideways = visit.event is Event.DRIVE and not is_same_direction(visit.along, DOWN)
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
                holds = any(fit.holds and fit.into == other.name for fit in body.fits)
                if holds and visit.is_fitted:
                    areas += tuple(
                        (box.low[0], box.low[1], box.high[0], box.high[1])
                        for box in boxes
                        if any(_overlap(box, top) for top in tops)
                    )
                if areas:
                    contacts.append((placement.fact, other.name, areas))
            on_table = level is None and floor_m <= tolerance_m
            yield _Ground(body.name, on_table, centroid(boxes), tuple(contacts))


def _describe_rotation(pose: Pose) -> str | None:
    """Return the rotation of a pose in degrees, unless it is by quarters."""
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
    """Return True if a unit vector is parallel to an axis of the world."""
    return sum(abs(value) <= _TURNED_RAD for value in direction) == 2


def _is_of_boxes(body: Body) -> bool:
    return all(isinstance(shape, Box) for shape in body.exact_shapes)


def _overlap(box: WorldBox, other: WorldBox) -> bool:
    return all(
        low <= top and bottom <= high
        for low, high, bottom, top in zip(box.low, box.high, other.low, other.high, strict=True)
    )


def _enters(box: WorldBox, by: Point, zone: Zone, tolerance_m: float) -> bool:
    """Return True if a box enters a zone on its way; exact if it rises, sinks or stays level."""
    xs, ys = (box.low[0], box.high[0]), (box.low[1], box.high[1])
    footprint = [(x + share * by[0], y + share * by[1]) for share in (0, 1) for x in xs for y in ys]
    low_m, high_m = box.low[2] + min(0.0, by[2]), box.high[2] + max(0.0, by[2])
    return zone.meets(footprint, low_m, high_m, tolerance_m)


def _list_visits(task: Task) -> Iterator[tuple[str, Visit]]:
    """Yield every visit of a task that handles a body, with the name of its skill."""
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
    """Return True if the body's centre lies within the hull rectangle of its contacts."""
    areas = [area for _, _, touching in bearers for area in touching]
    if not areas:
        return False
    x, y = ground.centre
    return min(area[0] for area in areas) <= x <= max(area[2] for area in areas) and min(
        area[1] for area in areas
    ) <= y <= max(area[3] for area in areas)
