"""Screws in their holes: the shank's surroundings, the thread's engagement and the driving time.

A hole that is modelled (in a mesh, or between boxes) must have room for the shank. One that is not
is taken as drilled: in `through` to the seat of the head, in `into` as deep as the shank needs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from statistics import median

from skillplan.collision.solid import TOUCH_M, Solid
from skillplan.domains.assembly.layout import get_layout, get_table
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import find_dwell_s
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.workholding import turn_pose
from skillplan.errors import Issue
from skillplan.task.pose import Point, Pose, plus
from skillplan.task.scene import Shank

_TABLE = "the table"
# Start of a line above the seat of a nut [m], and share of the nut that its bolt fills at least.
_FAR_M, _LEAST_THREAD = 0.2, 0.5
# Upward component of a direction from which on the hand comes from beside the part.
_STEEP_UP = 0.5
# Clearance of an upright hand from the part [m].
_HAND_M = 0.12
# Radii of lines within and around the shank, in radii of the shank; number of lines on a ring.
_WITHIN, _AROUND, _LINES = 0.97, 1.15, 12

Spans = list[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Driving:
    """The driving of one screw.

    Parameters
    ----------
    takes_s
        Dwell time at the hole [s].
    engagement_m
        Length over which the screw is driven in [m]; None if unknown.
    source
        Origin of the time, as a clause.
    is_computed
        True if the time follows from thread and speed, not from a key `durations_s`.
    """

    takes_s: float
    engagement_m: float | None
    source: str
    is_computed: bool


def find_driving(config: AssemblyConfig, name: str) -> Driving:
    """Return how long a screw is driven: as given, or by its thread and the tool's speed."""
    screw = config.screws[name]
    tool = config.tools[screw.tool]
    takes_s = find_dwell_s("fasten", config.durations_s, screw, tool)
    engagement_m = measure_engagement_m(config, name)
    owners = (f"screws.{name}", screw.durations_s), (f"tools.{screw.tool}", tool.durations_s)
    for path, durations in owners:
        if durations is not None and durations.fasten is not None:
            source = f"{path}.durations_s.fasten"
            return Driving(takes_s, engagement_m, source, is_computed=False)
    if "fasten" in config.durations_s.model_fields_set:
        return Driving(takes_s, engagement_m, "durations_s.fasten", is_computed=False)
    pitch_m, speed_rpm = screw.thread_pitch_m, tool.speed_rpm
    if pitch_m is None or engagement_m is None or speed_rpm is None:
        missing = [] if speed_rpm is not None else [f"tools.{screw.tool}.speed_rpm"]
        missing += [] if engagement_m is not None else [f"screws.{name}.length_m"]
        missing += [] if pitch_m is not None else [f"screws.{name}.pitch_m"]
        source = f"the default, without {' and '.join(missing)}"
        return Driving(takes_s, engagement_m, source, is_computed=False)
    turns = engagement_m / pitch_m
    source = (
        f"{turns:.1f} turns over {engagement_m * 1e3:.1f} mm, pitch {pitch_m * 1e3:g} mm, at "
        f"{speed_rpm:g} rpm"
    )
    return Driving(turns / (speed_rpm / 60), engagement_m, source, is_computed=True)


def measure_engagement_m(config: AssemblyConfig, name: str) -> float | None:
    """Return the length over which a screw is driven in [m]; None if it is unknown.

    As given, or the length of the shank in the bodies of `into`, or the whole shank.
    """
    screw = config.screws[name]
    if screw.head == "nut":
        return screw.engagement_m or screw.head_height_m
    if screw.engagement_m is not None or screw.length_m is None or screw.into is None:
        return screw.engagement_m or screw.length_m
    lines = _Lines(config, name)
    rings = [lines.ring(lines.bodies[body], _AROUND) for body in screw.into_names]
    in_thread_m = [
        sum(end_m - begin_m for ring in rings for begin_m, end_m in lines.clip(ring[number]))
        for number in range(_LINES)
    ]
    # A shank that reaches no thread is a fault of its own.
    return round(median(in_thread_m), 6) or screw.length_m


def find_shank(config: AssemblyConfig, name: str) -> Shank | None:
    """Return the shank of a screw with the names of all bodies that have a hole for it.

    They are the parts that it fastens, and the bodies in which it stands at its feeder or start.
    """
    screw = config.screws[name]
    shank = screw.shank
    layout = get_layout(config)
    place = layout.fetch(screw)
    if shank is None or place is None:
        return shank
    solid = Solid((shank.shape,), Pose(place))
    stands_in = tuple(
        body for body in (*config.parts, *config.fixtures) if _overlap(solid, layout.start(body))
    )
    return replace(shank, stands_in=stands_in)


def list_asides_m(
    config: AssemblyConfig, name: str, motion: Pose | None = None
) -> list[Point | None]:
    """Return the displacements from below a screw to where the hand comes down beside its part.

    One for each side of the part, the robot's first; None alone for a screw that the hand reaches
    from above or from the side.

    Parameters
    ----------
    motion
        Motion of the product from its first orientation; None in it.
    """
    screw, layout = config.screws[name], get_layout(config)
    along = screw.direction if motion is None else motion.rotate(screw.direction)
    if along[2] < _STEEP_UP:
        return [None]
    x_m, y_m, _ = turn_pose(Pose(layout.hole(screw)), motion).position
    solid = layout.goal(screw.through)
    box = Solid(solid.shapes, turn_pose(solid.pose, motion)).box
    asides: list[Point | None] = [
        (box.low[0] - x_m - _HAND_M, 0.0, 0.0),
        (box.high[0] - x_m + _HAND_M, 0.0, 0.0),
        (0.0, box.low[1] - y_m - _HAND_M, 0.0),
        (0.0, box.high[1] - y_m + _HAND_M, 0.0),
    ]
    base_x_m, base_y_m, _ = config.robot.base_m

    def measure_m(aside_m: Point | None) -> float:
        assert aside_m is not None
        return math.hypot(x_m + aside_m[0] - base_x_m, y_m + aside_m[1] - base_y_m)

    return sorted(asides, key=measure_m)


class _Lines:
    """Lines along the axis of a screw, in the state with everything at its goal."""

    def __init__(self, config: AssemblyConfig, name: str) -> None:
        layout = get_layout(config)
        self.screw: ScrewConfig = config.screws[name]
        self.length_m = self.screw.length_m or 0.0
        self.pose = layout.hole_pose(self.screw)
        self.bodies: Mapping[str, Solid] = {
            **{part: layout.goal(part) for part in config.parts},
            **{fixture: layout.fixture(fixture) for fixture in config.fixtures},
            _TABLE: get_table(),
        }

    def on_axis(self, solid: Solid) -> Spans:
        """Return the stretches of the axis within a body, from the mouth [m]."""
        return self._line(solid, 0.0, 0.0)

    def ring(self, solid: Solid, share: float) -> list[Spans]:
        """Return the stretches of lines parallel to the axis, at a share of the shank's radius."""
        radius_m = share * self.screw.diameter_m / 2
        turns = (2 * math.pi * (number + 0.3) / _LINES for number in range(_LINES))
        return [
            self._line(solid, radius_m * math.cos(turn), radius_m * math.sin(turn))
            for turn in turns
        ]

    def _line(self, solid: Solid, x_m: float, y_m: float) -> Spans:
        spans_m = solid.spans_m(self.pose.apply((x_m, y_m, 0.0)), self.screw.direction)
        return [(begin_m, end_m) for begin_m, end_m in spans_m if end_m > TOUCH_M]

    def clip(self, spans: Spans) -> Spans:
        """Return the parts of some stretches that the shank takes up."""
        return [
            (max(begin_m, 0.0), min(end_m, self.length_m))
            for begin_m, end_m in spans
            if min(end_m, self.length_m) - max(begin_m, 0.0) > TOUCH_M
        ]

    @property
    def shank(self) -> Solid | None:
        """The shank in its hole."""
        shank = self.screw.shank
        return None if shank is None else Solid((shank.shape,), self.pose)


def find_shank_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield torques beyond a tool, and shanks that run into something or find no thread."""
    for name, screw in config.screws.items():
        for tool in screw.tools:
            limit_nm = config.tools[tool].torque_nm
            if screw.torque_nm is None or limit_nm is None or screw.torque_nm <= limit_nm:
                continue
            message = (
                f"{screw.torque_nm:g} N m is more than {tool!r} brings, {limit_nm:g} N m "
                f"(tools.{tool}.torque_nm). Take a stronger tool, or less torque."
            )
            yield Issue(message, ("screws", name, "torque_nm"))
        yield from _find_start_issues(config, name)
        if screw.head == "nut":
            yield from _find_bolt_issue(config, name)
        if screw.length_m is not None:
            yield from _find_feeder_issue(config, name)
            yield from _find_depth_issues(config, name)
            yield from _find_foreign_bodies(config, name)


def _find_start_issues(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    """Yield another screw before this one whose head is at the same place at the start."""
    screw, layout = config.screws[name], get_layout(config)
    if screw.start_m is None:
        return
    for other, standing in config.screws.items():
        if other == name:
            return
        places = layout.fetch(screw), layout.fetch(standing)
        if standing.start_m is None or places[0] is None or places[1] is None:
            continue
        apart_m = math.dist(places[0][:2], places[1][:2])
        width_m = (screw.head_diameter_m + standing.head_diameter_m) / 2
        height_m = max(screw.head_height_m, standing.head_height_m)
        if apart_m < width_m - TOUCH_M and abs(places[0][2] - places[1][2]) < height_m:
            words = f"its head, {_show_mm(screw.head_diameter_m)} wide, meets that of {other!r}"
            yield Issue(
                f"{words}, {_show_mm(apart_m)} away. Move one of them.", ("screws", name, "start_m")
            )
            return


def _find_bolt_issue(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    """Yield a nut whose bolt does not reach through it, or is not there."""
    screw, layout = config.screws[name], get_layout(config)
    seat, (body, *_) = layout.hole(screw), screw.into_names
    solid = layout.goal(body) if body in config.parts else layout.fixture(body)
    spans_m = solid.spans_m(plus(seat, screw.direction, -_FAR_M), screw.direction)
    high_m = _FAR_M - min((begin_m for begin_m, _ in spans_m), default=_FAR_M)
    if high_m < _LEAST_THREAD * screw.head_height_m:
        above = f"ends {_show_mm(high_m)} above its seat"
        there = above if high_m > TOUCH_M else "has no bolt on its axis"
        yield Issue(
            f"{body!r} {there}, and the nut is {_show_mm(screw.head_height_m)} high. Name the part "
            "with its bolt, or move the hole.",
            ("screws", name, "into"),
        )


def _find_feeder_issue(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    screw = config.screws[name]
    place = get_layout(config).fetch(screw)
    if place is None or screw.length_m is None:
        return
    height_m = place[2]
    if height_m < screw.length_m - TOUCH_M:
        message = (
            f"the head of {name!r} is {height_m:g} m above the table, and its shank is "
            f"{screw.length_m:g} m long. Give a height of {screw.length_m:g} m or more."
        )
        feeder = screw.feeder
        here = ("screws", name, "start_m") if feeder is None else ("feeders", feeder, "height_m")
        yield Issue(message, here)


def _find_depth_issues(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    """Yield a shank that is too thick or too long for its hole, or that reaches no thread."""
    lines, screw = _Lines(config, name), config.screws[name]
    length_m, path = lines.length_m, ("screws", name, "length_m")
    if screw.hole_depth_m is not None and length_m > screw.hole_depth_m + TOUCH_M:
        yield Issue(
            f"{_show_mm(length_m)} is longer than the hole, {_show_mm(screw.hole_depth_m)} "
            f"(screws.{name}.hole_depth_m). Take a shorter screw.",
            path,
        )
        return
    through = lines.bodies[screw.through]
    axis, within = lines.on_axis(through), lines.ring(through, _WITHIN)
    if not _begins_at_mouth(axis):
        # The hole is modelled.
        narrow = sum(map(bool, map(lines.clip, within)))
        bottom = lines.clip(axis)
        if bottom:
            yield _report_bottom(name, screw.through, bottom[0][0], length_m)
        elif narrow > _LINES // 4:
            yield Issue(
                f"its hole in {screw.through!r} is narrower than the shank of {name!r}, "
                f"{_show_mm(screw.diameter_m)}. Take a smaller size, or a wider hole.",
                ("screws", name, "size"),
            )
    for body in screw.into_names:
        solid = lines.bodies[body]
        around = [lines.clip(spans) for spans in lines.ring(solid, _AROUND)]
        axis = lines.clip(lines.on_axis(solid))
        tops_m = [spans[0][0] for spans in around if spans]
        if not tops_m and not axis:
            gap_m = min((spans[0][0] for spans in lines.ring(solid, _AROUND) if spans), default=0)
            far = f"which is {_show_mm(gap_m)} below its head" if gap_m > 0 else "which it misses"
            yield Issue(
                f"the shank of {name!r}, {_show_mm(length_m)} long, does not reach {body!r}, "
                f"{far}. Take a longer screw, or another 'into'.",
                path,
            )
        elif axis and tops_m and axis[0][0] > median(tops_m) + TOUCH_M:
            yield _report_bottom(name, body, axis[0][0], length_m)


def _begins_at_mouth(spans: Spans) -> bool:
    return any(begin_m <= TOUCH_M < end_m for begin_m, end_m in spans)


def _report_bottom(name: str, body: str, depth_m: float, length_m: float) -> Issue:
    return Issue(
        f"{_show_mm(length_m)} is longer than the hole: its bottom in {body!r} is "
        f"{_show_mm(depth_m)} below the head. Take a shorter screw.",
        ("screws", name, "length_m"),
    )


def _find_foreign_bodies(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    """Yield the bodies that the shank stands in at the end without a hole or a thread there."""
    screw, lines = config.screws[name], _Lines(config, name)
    shank = lines.shank
    assert shank is not None
    goal = None if config.goal is None else set(config.goal)
    for body, solid in lines.bodies.items():
        if body == screw.through or body in screw.into_names:
            continue
        is_movable = body in config.parts and not config.parts[body].fixed
        if goal is not None and is_movable and f"placed({body})" not in goal:
            continue
        if not _overlap(shank, solid):
            continue
        spans = lines.clip(lines.on_axis(solid))
        deep_m = sum(end_m - begin_m for begin_m, end_m in spans)
        far = f"{_show_mm(deep_m)} deep in" if deep_m else "in"
        remedy = "" if body == _TABLE else f", or name {body!r} in 'into' if its thread goes there"
        shown = body if body == _TABLE else repr(body)
        yield Issue(
            f"the shank of {name!r} is {far} {shown}. Take a shorter screw{remedy}.",
            ("screws", name, "length_m"),
        )


def _overlap(solid: Solid, other: Solid) -> bool:
    return solid.depth_m(other) > TOUCH_M


def _show_mm(length_m: float) -> str:
    return f"{length_m * 1e3:.1f} mm"
