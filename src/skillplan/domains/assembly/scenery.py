"""The constant geometry of an assembly: its parts, screws, tools and the arm."""

from __future__ import annotations

from collections.abc import Mapping

from skillplan.domains.assembly import vocabulary
from skillplan.domains.assembly.gripping import grasps_of_part, tool_kind
from skillplan.domains.assembly.layout import (
    feeder_of,
    goal_pose,
    holder_of,
    hole_pose,
    pieces_of,
    point,
    shapes_of,
    start_pose,
)
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.task.motion import Point
from skillplan.task.scene import Body, Placement, Pose, Robot, Scene, Tool
from skillplan.task.shape import Box, Cylinder


def scene_of(config: AssemblyConfig, places: Mapping[str, Point]) -> Scene:
    """Return the scene of a faultless assembly.

    Parameters
    ----------
    config
        The assembly.
    places
        Where the tip of the arm stands [m], by fact.
    """
    robot = config.robot
    base = point(robot.base_m)
    return Scene(
        bodies=(
            *(_part_body(config, name) for name in config.parts),
            *(_screw_body(config, name) for name in config.screws),
        ),
        robots=(
            Robot(
                robot.name,
                base,
                robot.reaches_m,
                robot.safe_height_m,
                places,
                tuple(_tool(config, name) for name in config.tools),
                robot.arm,
                robot.base_orientation,
                robot.hand,
                robot.payload_kg,
            ),
        ),
        stations={
            **{vocabulary.holder_place(tool): holder_of(config, tool) for tool in config.tools},
            **{feeder: feeder_of(config, feeder) for feeder in config.feeders},
        },
        frames={"world": Pose((0.0, 0.0, 0.0)), robot.name: Pose(base, robot.base_orientation)},
    )


def _part_body(config: AssemblyConfig, name: str) -> Body:
    part = config.parts[name]
    start, goal = start_pose(config, name), goal_pose(config, name)
    pieces, shapes = pieces_of(part), shapes_of(part)
    in_hand = Pose((0.0, 0.0, 0.0))
    return Body(
        name,
        pieces,
        (
            Placement(f"at_start({name})", start, solid=part.feeder is None),
            Placement(f"held({name})", in_hand, frame=config.robot.name),
            Placement(f"placed({name})", goal),
        ),
        part.mass_kg,
        grasps_of_part(config, name),
        () if pieces == shapes else shapes,
    )


def _screw_body(config: AssemblyConfig, name: str) -> Body:
    screw = config.screws[name]
    height_m = screw.head_height_m
    head = Cylinder(screw.head_diameter_m, height_m, (0.0, 0.0, height_m / 2))
    driven = Placement(f"fastened({name})", hole_pose(config, screw))
    return Body(name, (head,), (driven,), screw.mass_kg)


def _tool(config: AssemblyConfig, name: str) -> Tool:
    entry = config.tools[name]
    size = entry.envelope_m
    return Tool(
        name,
        f"tool({name})",
        holder_of(config, name),
        None if size is None else Box(point(size), (0.0, 0.0, size[2] / 2)),
        tool_kind(config, name),
        entry.opening_m,
        entry.force_n,
        entry.hand_on(config.robot.hand),
        entry.mass_kg,
    )
