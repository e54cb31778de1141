"""Where everything stands: heights of stacks and supports, shapes of parts, positions of tools.

Shared by the consistency checks and the grounding; needs references without cycles.
"""

from __future__ import annotations

from skillplan.domains.assembly.handling.schema import unit_of
from skillplan.domains.assembly.part_schema import PartConfig, ScrewConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.task.grasp import AXES
from skillplan.task.pose import DOWN, Point, Pose, cross, same_direction, unit
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

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
        return tuple(Mesh(mesh.corners, mesh.faces) for mesh in part.meshes)
    return tuple(Box(point(box.size_m), point(box.centre_m)) for box in part.boxes or ())


def boxes_of(part: PartConfig) -> tuple[Box, ...]:
    """Return the smallest upright boxes about the shapes of a part, in its own frame."""
    return tuple(shape.box for shape in shapes_of(part))


def height_of(part: PartConfig) -> float:
    """Return the height of a part's top above its bottom [m]."""
    return max(box.centre[2] + box.size[2] / 2 for box in boxes_of(part))


def start_of(config: AssemblyConfig, name: str) -> Point:
    """Return the centre of a part's bottom at the start [m]."""
    part = config.parts[name]
    if part.feeder is not None:
        feeder = config.feeders[part.feeder]
        return (feeder.position_m[0], feeder.position_m[1], feeder.height_m)
    if part.start_on is not None:
        x_m, y_m, z_m = start_of(config, part.start_on)
        return (x_m, y_m, _tidy(z_m + height_of(config.parts[part.start_on])))
    assert part.start_m is not None
    return (part.start_m[0], part.start_m[1], 0.0)


def goal_of(config: AssemblyConfig, name: str) -> Point:
    """Return the centre of a part's bottom at its goal [m]."""
    part = config.parts[name]
    z_m = 0.0
    if part.goal_on is not None:
        z_m = goal_of(config, part.goal_on)[2] + height_of(config.parts[part.goal_on])
    return (part.goal_m[0], part.goal_m[1], _tidy(z_m))


def start_pose(config: AssemblyConfig, name: str) -> Pose:
    """Return where a part is at the start and how it is turned."""
    return Pose.upright(start_of(config, name), config.parts[name].start_yaw_rad)


def goal_pose(config: AssemblyConfig, name: str) -> Pose:
    """Return where a part is at its goal and how it is turned."""
    return Pose.upright(goal_of(config, name), config.parts[name].goal_yaw_rad)


def hole_of(config: AssemblyConfig, screw: ScrewConfig) -> Point:
    """Return the mouth of a screw's hole: as given, or the top of the part it goes through [m]."""
    if len(screw.hole_m) > 2:
        return point(screw.hole_m)
    z_m = goal_of(config, screw.through)[2] + height_of(config.parts[screw.through])
    return (screw.hole_m[0], screw.hole_m[1], _tidy(z_m))


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


def _tidy(length_m: float) -> float:
    """Round a sum of heights to a nanometre, so that stacks of equal height are level."""
    return round(length_m, 9)
