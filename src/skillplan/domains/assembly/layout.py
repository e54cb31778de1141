"""Where everything stands: poses of parts at start and goal, mouths of holes, positions of tools.

Shared by the consistency checks and the grounding; needs references without cycles. A part's pose
is that of its frame, whose origin is the centre of the bottom of the upright part.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from skillplan.collision.solid import Solid
from skillplan.domains.assembly.part_schema import PartConfig, ScrewConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import unit_of
from skillplan.task.motion import AXES
from skillplan.task.pose import DOWN, Point, Pose, cross, same_direction, unit
from skillplan.task.shape import Box, Cylinder, Shape

_TABLE_M = 40.0
# An axis of which z is more than this is taken for upright.
_STEEP = 0.9


def shapes_of(part: PartConfig) -> tuple[Shape, ...]:
    """Return what a part is made of, in its own frame."""
    if part.size_m is not None:
        x_m, y_m, z_m = part.size_m
        return (Box((x_m, y_m, z_m), (0.0, 0.0, z_m / 2)),)
    if part.cylinder is not None:
        height_m = part.cylinder.height_m
        return (Cylinder(part.cylinder.diameter_m, height_m, (0.0, 0.0, height_m / 2)),)
    if part.meshes is not None:
        return tuple(mesh.shape for mesh in part.meshes)
    return tuple(Box(point(box.size_m), point(box.centre_m)) for box in part.boxes or ())


def pieces_of(part: PartConfig) -> tuple[Shape, ...]:
    """Return convex shapes that a part is made of: of a mesh that is not convex, its pieces.

    Raises
    ------
    NoPieces
        If there is such a mesh and nothing is installed that takes it apart.
    """
    if all(mesh.convex for mesh in part.meshes or ()):
        return shapes_of(part)
    # Takes numpy, which most boards do without.
    from skillplan.collision.decomposition import decomposition_of

    found: list[Shape] = []
    for mesh in part.meshes or ():
        if mesh.convex:
            found.append(mesh.shape)
        else:
            found += mesh.given_pieces or decomposition_of(mesh.shape).pieces
    return tuple(found)


def boxes_of(part: PartConfig) -> tuple[Box, ...]:
    """Return the smallest upright boxes about the shapes of a part, in its own frame."""
    return tuple(shape.box for shape in shapes_of(part))


def height_of(part: PartConfig) -> float:
    """Return the height of a part's top above its bottom [m]."""
    return max(box.centre[2] + box.size[2] / 2 for box in boxes_of(part))


def start_of(config: AssemblyConfig, name: str) -> Point:
    """Return where the origin of a part is at the start [m]."""
    return start_pose(config, name).position


def goal_of(config: AssemblyConfig, name: str) -> Point:
    """Return where the origin of a part is at its goal [m]."""
    return goal_pose(config, name).position


def start_pose(config: AssemblyConfig, name: str) -> Pose:
    """Return the pose of a part at the start."""
    return start_solid(config, name).pose


def goal_pose(config: AssemblyConfig, name: str) -> Pose:
    """Return the pose of a part at its goal."""
    return goal_solid(config, name).pose


def start_solid(config: AssemblyConfig, name: str) -> Solid:
    """Return a part as it lies at the start; what comes from a feeder, as that hands it out."""
    return _layout(_Identity(config)).start(name)


def goal_solid(config: AssemblyConfig, name: str) -> Solid:
    """Return a part as it stands at its goal."""
    return _layout(_Identity(config)).goal(name)


@lru_cache(maxsize=1)
def table() -> Solid:
    """Return the table, whose top is at 0."""
    return Solid((Box((_TABLE_M, _TABLE_M, 1.0), (0.0, 0.0, -0.5)),), Pose((0.0, 0.0, 0.0)))


def hole_of(config: AssemblyConfig, screw: ScrewConfig) -> Point:
    """Return the mouth of a screw's hole [m]: as given, or its part's highest surface there."""
    if len(screw.hole_m) > 2:
        return point(screw.hole_m)
    x_m, y_m = screw.hole_m
    through = goal_solid(config, screw.through)
    top_m = through.top_m(x_m, y_m)
    return (x_m, y_m, _tidy(through.box.high[2] if top_m is None else top_m))


def hole_pose(config: AssemblyConfig, screw: ScrewConfig) -> Pose:
    """Return the mouth of a screw's hole; the screw goes in along its -z axis."""
    mouth = hole_of(config, screw)
    into = unit_of(screw.axis)
    if same_direction(into, DOWN):
        return Pose(mouth)
    # What turns about its axis may be turned about it in any way.
    level = unit(cross(into, AXES["z"] if abs(into[2]) < _STEEP else AXES["x"]))
    return Pose.of_axes(mouth, level, (-into[0], -into[1], -into[2]))


def holder_of(config: AssemblyConfig, tool: str) -> Point:
    """Return the position of a tool's holder [m]."""
    entry = config.tools[tool]
    return (entry.holder_m[0], entry.holder_m[1], entry.holder_height_m)


def look_of(config: AssemblyConfig) -> Point:
    """Return where the tip goes to look for a part whose grasp failed, at safe height [m]."""
    robot = config.robot
    assert robot.look_m is not None
    return (robot.look_m[0], robot.look_m[1], robot.safe_height_m)


def feeder_of(config: AssemblyConfig, name: str) -> Point:
    """Return where a feeder hands out [m]."""
    feeder = config.feeders[name]
    return (feeder.position_m[0], feeder.position_m[1], feeder.height_m)


def point(values: list[float]) -> Point:
    """Return three numbers as a point."""
    x, y, z = values
    return (x, y, z)


class _Identity:
    """A configuration, equal to nothing but itself: its content would take long to compare."""

    def __init__(self, config: AssemblyConfig) -> None:
        self.config = config

    def __hash__(self) -> int:
        return id(self.config)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Identity) and self.config is other.config


class _Layout:
    """The parts of a configuration where they lie and where they belong, each worked out once."""

    def __init__(self, config: AssemblyConfig) -> None:
        self.config = config
        self._starts: dict[str, Solid] = {}
        self._goals: dict[str, Solid] = {}
        self._shapes: dict[str, tuple[Shape, ...]] = {}

    def start(self, name: str) -> Solid:
        """Return a part at the start."""
        if name not in self._starts:
            part = self.config.parts[name]
            turn_rad = part.start_turn_rad
            if part.feeder is not None:
                *place_m, height_m = feeder_of(self.config, part.feeder)
                solid = self._lying(name, place_m, turn_rad, height_m)
            elif part.start_on is not None:
                beneath = self.start(part.start_on)
                place_m = part.start_m or list(beneath.pose.position[:2])
                solid = self._put(name, place_m, turn_rad, [beneath])
            else:
                solid = self._put(name, part.start_m or [], turn_rad, [])
            self._starts[name] = solid
        return self._starts[name]

    def goal(self, name: str) -> Solid:
        """Return a part at its goal."""
        if name not in self._goals:
            part = self.config.parts[name]
            beneath = [self.goal(other) for other in part.goal_on or ()]
            self._goals[name] = self._put(name, part.goal_m, part.goal_turn_rad, beneath)
        return self._goals[name]

    def _put(
        self, name: str, place_m: Sequence[float], turn_rad: Point, beneath: list[Solid]
    ) -> Solid:
        """Return a part where the file puts it, or else resting on what is beneath it."""
        if len(place_m) == 3:
            x_m, y_m, z_m = place_m
            return Solid(self._shapes_of(name), Pose.turned((x_m, y_m, z_m), turn_rad))
        if not beneath:
            return self._lying(name, place_m, turn_rad, 0.0)
        raised = self._at(name, place_m, turn_rad, 0.0)
        falls_m = [fall_m for other in beneath if (fall_m := raised.fall_m(other)) is not None]
        if not falls_m:
            top_m = max(other.box.high[2] for other in beneath)
            return self._lying(name, place_m, turn_rad, top_m)
        return self._at(name, place_m, turn_rad, _tidy(-min(falls_m)))

    def _lying(
        self, name: str, place_m: Sequence[float], turn_rad: Point, height_m: float
    ) -> Solid:
        """Return a part with its lowest point at a height; an upright one with its origin."""
        solid = self._at(name, place_m, turn_rad, height_m)
        if solid.pose.is_upright:
            return solid
        return self._at(name, place_m, turn_rad, _tidy(2 * height_m - solid.box.low[2]))

    def _at(self, name: str, place_m: Sequence[float], turn_rad: Point, z_m: float) -> Solid:
        x_m, y_m = place_m
        return Solid(self._shapes_of(name), Pose.turned((x_m, y_m, z_m), turn_rad))

    def _shapes_of(self, name: str) -> tuple[Shape, ...]:
        if name not in self._shapes:
            self._shapes[name] = shapes_of(self.config.parts[name])
        return self._shapes[name]


@lru_cache(maxsize=4)
def _layout(identity: _Identity) -> _Layout:
    return _Layout(identity.config)


def _tidy(length_m: float) -> float:
    """Round a sum of heights to a nanometre, so that stacks of equal height are level."""
    return round(length_m, 9)
