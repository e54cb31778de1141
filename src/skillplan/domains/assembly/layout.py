"""Poses of parts at the start and at their goals, and the mouths of holes.

Validation and grounding share it. References must be free of cycles. The pose of a part is that of
its frame, whose origin is the centre of the bottom of the upright part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial

from skillplan.collision.solid import TOUCH_M, Solid
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.task.motion import AXES
from skillplan.task.pose import DOWN, Point, Pose, cross, is_same_direction, unit
from skillplan.task.shape import Box, Shape

_TABLE_M = 40.0
# An axis with a larger z component counts as upright.
_STEEP = 0.9
# Slack of a part that passes the walls of its fit [m].
_SLACK_M = 1e-6
# Number of layouts kept: a draw of a family compares two of them.
_KEPT = 4

# Distance of points under the rim of a screw's head from its axis, in radii; number of them.
_RIM_SHARE, _RIM_POINTS = 0.96, 12
# Rings on which the rim of a hole is looked for, in those distances: a head may be left out.
_RIM_SHARES = (1.0, 1.25, 1.5, 2.0, 3.0)
LEAST_RIM = 5 / 6
"""Least share of the rim of a screw's head that rests on its part."""

_recent: tuple[Layout, ...] = ()


def get_layout(config: AssemblyConfig) -> Layout:
    """Return the layout of a configuration; the last few are kept."""
    global _recent
    for layout in _recent:
        # Comparing contents would take longer than computing the layout.
        if layout.config is config:
            return layout
    layout = Layout(config)
    _recent = (layout, *_recent[: _KEPT - 1])
    return layout


def list_rim(screw: ScrewConfig) -> list[tuple[float, float]]:
    """Return points under the rim of a head, from its axis [m]."""
    radius_m = _RIM_SHARE * screw.head_diameter_m / 2
    turns = (2 * math.pi * number / _RIM_POINTS for number in range(_RIM_POINTS))
    return [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]


@lru_cache(maxsize=1)
def get_table() -> Solid:
    """Return the table, whose top is at height 0."""
    return Solid((Box((_TABLE_M, _TABLE_M, 1.0), (0.0, 0.0, -0.5)),), Pose((0.0, 0.0, 0.0)))


class Layout:
    """The parts of a configuration at the start and at their goals, each computed once."""

    def __init__(self, config: AssemblyConfig) -> None:
        self.config = config
        self._fixtures: dict[str, Solid] = {}
        self._starts: dict[str, Solid] = {}
        self._goals: dict[str, Solid] = {}
        self._buffered: dict[tuple[str, str], Solid] = {}
        self._solids: dict[tuple[str, Pose], Solid] = {}
        # Start and goal share the shapes: meshes of thousands of corners keep derived data.
        self._shapes: dict[str, tuple[Shape, ...]] = {}

    def fixture(self, name: str) -> Solid:
        """Return a fixture where it stays."""
        if name not in self._fixtures:
            fixture = self.config.fixtures[name]
            beneath = [] if fixture.stands_on is None else [self.fixture(fixture.stands_on)]
            self._fixtures[name] = self._place(name, fixture.at_m, fixture.turn_rad, beneath)
        return self._fixtures[name]

    def start(self, name: str) -> Solid:
        """Return a part at the start, in a feeder as that presents it; or a fixture."""
        if name in self.config.fixtures:
            return self.fixture(name)
        if self.config.parts[name].fixed:
            return self.goal(name)
        if name not in self._starts:
            part = self.config.parts[name]
            beneath: list[Solid] = []
            place_m, height_m = part.start_m or [], 0.0
            if part.feeder is not None:
                *place_m, height_m = self.config.feeders[part.feeder].position
            elif part.start_on is not None:
                beneath = [self.start(part.start_on)]
                place_m = part.start_m or list(beneath[0].pose.position[:2])
            self._starts[name] = self._place(name, place_m, part.start_turn_rad, beneath, height_m)
        return self._starts[name]

    def goal(self, name: str) -> Solid:
        """Return a part at its goal, or a fixture."""
        if name in self.config.fixtures:
            return self.fixture(name)
        if name not in self._goals:
            part = self.config.parts[name]
            beneath = [self.goal(other) for other in part.goal_on or ()]
            overlaps_m = [
                0.0 if fit is None else fit.overlap_m
                for fit in ((part.fits or {}).get(other) for other in part.goal_on or ())
            ]
            self._goals[name] = self._place(
                name, part.goal_m, part.goal_turn_rad, beneath, overlaps_m=overlaps_m
            )
        return self._goals[name]

    def buffered(self, name: str, buffer: str) -> Solid:
        """Return a part in a buffer."""
        key = (name, buffer)
        if key not in self._buffered:
            place = self.config.buffers[buffer]
            beneath = [] if place.stands_on is None else [self.fixture(place.stands_on)]
            self._buffered[key] = self._place(name, place.at_m, place.turn_rad, beneath)
        return self._buffered[key]

    def fetch(self, screw: ScrewConfig) -> Point | None:
        """Return where a tool fetches a screw [m]: in a feeder or at its start; None for none."""
        if screw.start_m is not None:
            x_m, y_m, z_m = screw.start_m
            return (x_m, y_m, z_m)
        return None if screw.feeder is None else self.config.feeders[screw.feeder].position

    def hole(self, screw: ScrewConfig) -> Point:
        """Return the mouth of a screw's hole [m]: as given, or at the surface of its part."""
        if len(screw.hole_m) > 2:
            x_m, y_m, z_m = screw.hole_m
            return (x_m, y_m, z_m)
        x_m, y_m = screw.hole_m
        through, up = self.goal(screw.through), 1.0 if screw.direction[2] < 0 else -1.0

        def face_m(at_x_m: float, at_y_m: float) -> float | None:
            """Return the height of the outer face at a point; of an underside, negative."""
            if up > 0:
                return through.top_m(at_x_m, at_y_m)
            spans_m = through.spans_m((at_x_m, at_y_m, 0.0), AXES["z"])
            return -spans_m[0][0] if spans_m else None

        on_axis_m = face_m(x_m, y_m)
        for share in _RIM_SHARES:
            rim_m = [
                height_m
                for dx_m, dy_m in list_rim(screw)
                if (height_m := face_m(x_m + share * dx_m, y_m + share * dy_m)) is not None
            ]
            # A wall next to the head may be higher than the face that most of the rim is on.
            level_m = max(rim_m, key=partial(_count_near, rim_m), default=-math.inf)
            rests = _count_near(rim_m, level_m)[0] >= LEAST_RIM * _RIM_POINTS
            if rests and (on_axis_m is None or level_m > on_axis_m + TOUCH_M):
                seat_m = max(z_m for z_m in rim_m if z_m <= level_m + TOUCH_M)
                return (x_m, y_m, up * _round_height(seat_m))
            if on_axis_m is not None:
                # The hole is not modelled.
                return (x_m, y_m, up * _round_height(on_axis_m))
        default_m = through.box.high[2] if up > 0 else -through.box.low[2]
        return (x_m, y_m, up * _round_height(default_m))

    def hole_pose(self, screw: ScrewConfig) -> Pose:
        """Return the pose of a hole's mouth; the screw goes in along its -z axis."""
        mouth = self.hole(screw)
        into = screw.direction
        if is_same_direction(into, DOWN):
            return Pose(mouth)
        # A screw may be turned about its axis, so any horizontal direction serves.
        level = unit(cross(into, AXES["z"] if abs(into[2]) < _STEEP else AXES["x"]))
        return Pose.of_axes(mouth, level, (-into[0], -into[1], -into[2]))

    def _place(
        self,
        name: str,
        place_m: Sequence[float],
        turn_rad: Point,
        beneath: list[Solid],
        height_m: float = 0.0,
        overlaps_m: Sequence[float] = (),
    ) -> Solid:
        """Return a body at a given place, or else resting on the solids beneath it.

        Parameters
        ----------
        overlaps_m
            Depths to which its fits let it into the walls of these solids [m].
        """
        if name not in self._shapes:
            owner = self.config.fixtures.get(name) or self.config.parts[name]
            self._shapes[name] = owner.shapes
        if len(place_m) == 3:
            x_m, y_m, z_m = place_m
            return self._find_solid(name, Pose.turned((x_m, y_m, z_m), turn_rad))
        x_m, y_m = place_m
        if beneath:
            raised = self._find_solid(name, Pose.turned((x_m, y_m, 0.0), turn_rad))
            falls_m = [
                fall_m
                for other, overlap_m in zip(
                    beneath, overlaps_m or [0.0] * len(beneath), strict=True
                )
                if (fall_m := _find_fall_m(raised, other, overlap_m)) is not None
            ]
            if falls_m:
                z_m = _round_height(-min(falls_m))
                return self._find_solid(name, Pose.turned((x_m, y_m, z_m), turn_rad))
            height_m = max(other.box.high[2] for other in beneath)
        solid = self._find_solid(name, Pose.turned((x_m, y_m, height_m), turn_rad))
        if solid.pose.is_upright:
            return solid
        # The lowest point of a turned part is at that height, not its origin.
        z_m = _round_height(2 * height_m - solid.box.low[2])
        return self._find_solid(name, Pose.turned((x_m, y_m, z_m), turn_rad))

    def _find_solid(self, name: str, pose: Pose) -> Solid:
        """Return a body at a pose: the one of a recent layout if it is the same."""
        shapes = self._shapes[name]
        for layout in (self, *_recent):
            solid = layout._solids.get((name, pose))
            # Comparing the corners of meshes would take too long.
            if solid is not None and list(map(id, solid.shapes)) == list(map(id, shapes)):
                self._solids[name, pose] = solid
                return solid
        self._solids[name, pose] = solid = Solid(shapes, pose)
        return solid


def _count_near(heights_m: list[float], level_m: float) -> tuple[int, float]:
    """Return the number of heights at a level, and the level [m]."""
    return sum(abs(height_m - level_m) <= TOUCH_M for height_m in heights_m), level_m


def _find_fall_m(solid: Solid, other: Solid, overlap_m: float) -> float | None:
    """Return the height to fall on another [m], past walls of a hole that overlap by a fit."""
    if overlap_m <= 0.0:
        return solid.fall_m(other)
    fall_m = solid.narrowed_fall_m(other, overlap_m + _SLACK_M)
    return fall_m if math.isfinite(fall_m) else solid.fall_m(other)


def _round_height(length_m: float) -> float:
    """Round a sum of heights to a nanometre, which levels stacks of equal height."""
    return round(length_m, 9)
