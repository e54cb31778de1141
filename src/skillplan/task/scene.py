"""Constant geometry: bodies, robots and stations, in SI units and the world frame.

Geometry is a function of the state: :meth:`Scene.at` gives every body's pose in a state, so
that no simulator history is needed to know where things are.
A body's origin is the centre of its bottom face.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from skillplan.robots.arm_description import ArmDescription, Hand, Transform
from skillplan.robots.catalogue import DEFAULT_HAND, DEFAULT_MODEL
from skillplan.task.motion import Grasp, GraspKind
from skillplan.task.pose import Point, Pose, Quaternion, dot
from skillplan.task.shape import Box, Cylinder, Mesh, Shape
from skillplan.task.state import State

__all__ = [
    "WORLD",
    "Body",
    "Box",
    "Cylinder",
    "Grasp",
    "GraspKind",
    "Mesh",
    "Placement",
    "Pose",
    "Quaternion",
    "Robot",
    "Scene",
    "Shape",
    "Tool",
    "ToolKind",
]

WORLD = "world"


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a body is while a fact holds.

    Parameters
    ----------
    fact
        Name of the fact.
    pose
        In the world, or from the tip of the robot named by `frame`.
    frame
        ``"world"`` or a robot's name.
    solid
        False while nothing can touch it, as for a part inside a feeder.
    """

    fact: str
    pose: Pose
    frame: str = WORLD
    solid: bool = True


@dataclass(frozen=True)
class Body:
    """A rigid body made of boxes, cylinders and meshes.

    Parameters
    ----------
    name
        Unique in the scene.
    shapes
        At least one, in the body's frame; all convex.
    placements
        Where it is, by fact.
    mass_kg
        Mass [kg], > 0, spread evenly.
    grasps
        How it may be held, the preferred first; none for what no hand holds.
    surfaces
        Its exact shapes, where one of them is not convex and `shapes` has pieces of it that are;
        else empty.

    Raises
    ------
    ValueError
        If it has no shape, one of `shapes` is not convex, or its mass is not positive.
    """

    name: str
    shapes: tuple[Shape, ...]
    placements: tuple[Placement, ...]
    mass_kg: float
    grasps: tuple[Grasp, ...] = ()
    surfaces: tuple[Shape, ...] = ()

    def __post_init__(self) -> None:
        if not self.shapes:
            raise ValueError(f"Body {self.name!r} needs at least one shape.")
        if any(isinstance(shape, Mesh) and not shape.convex for shape in self.shapes):
            raise ValueError(f"Body {self.name!r}: shapes must be convex; pieces of one are.")
        if not (math.isfinite(self.mass_kg) and self.mass_kg > 0):
            raise ValueError(f"Body {self.name!r}: mass must be > 0 kg, not {self.mass_kg}.")

    @property
    def grasp(self) -> Grasp | None:
        """How it is held unless something else is said; None for what no hand holds."""
        return self.grasps[0] if self.grasps else None

    @property
    def exact_shapes(self) -> tuple[Shape, ...]:
        """Its shapes as they are, also those that are not convex."""
        return self.surfaces or self.shapes

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The smallest upright boxes about its shapes."""
        return tuple(shape.box for shape in self.shapes)

    @property
    def height_m(self) -> float:
        """Height of its top above its origin [m]."""
        return max(box.centre[2] + box.size[2] / 2 for box in self.boxes)

    def reach_m(self, pose: Pose, direction: Point) -> float:
        """Return how far it reaches along a direction from the world's origin [m], at a pose."""
        own = pose.inverse().rotate(direction)
        away_m = max(shape.reach_m(own) for shape in self.shapes)
        return dot(pose.position, direction) + away_m

    def placement(self, state: State) -> Placement | None:
        """Return where it is in `state`, or None where no fact says so."""
        for placement in self.placements:
            if placement.fact in state:
                return placement
        return None


class ToolKind(StrEnum):
    """What a tool does: grip between jaws, lift by suction, drive screws."""

    GRIPPER = "gripper"
    SUCTION = "suction"
    SCREWDRIVER = "screwdriver"


@dataclass(frozen=True, slots=True)
class Tool:
    """What may be attached to a robot.

    Parameters
    ----------
    name
        Unique among the tools.
    fact
        The fact that says it is attached.
    holder
        Position of its holder [m].
    envelope
        A box about the part of the tool above its tip [m], or None where it is not modelled.
    kind
        What it does.
    opening_m
        Of a gripper, the greatest distance between its jaws [m]; None where it is not modelled.
    force_n
        With how much a gripper closes, or what a suction cup holds at most [N]; None for what
        engines choose.
    hand
        Of a gripper, what it looks like; None for the hand of the arm.
    mass_kg
        Mass on the flange while it is attached [kg], >= 0; None for that of the arm's hand.
    """

    name: str
    fact: str
    holder: Point
    envelope: Box | None = None
    kind: ToolKind = ToolKind.GRIPPER
    opening_m: float | None = None
    force_n: float | None = None
    hand: Hand | None = None
    mass_kg: float | None = None


@dataclass(frozen=True)
class Robot:
    """A manipulator.

    Parameters
    ----------
    name
        Unique in the scene.
    base
        Position of its base [m].
    reach_m
        Greatest distance from base to tool tip, > 0.
    safe_height_m
        Height above the table of the lowest point of what it carries while it travels, > 0.
    places
        Where its tip stands, by fact.
    tools
        What may be attached to it.
    model
        The arm: joints, limits, masses, shapes and home posture.
    base_orientation
        How its base is turned in the world.
    hand
        What is on its flange. All tools end where its jaws do.
    payload_kg
        Greatest mass at the flange, tool included [kg], > 0; None for that of the model.

    Raises
    ------
    ValueError
        If reach, safe height or payload is not positive.
    """

    name: str
    base: Point
    reach_m: float
    safe_height_m: float
    places: Mapping[str, Point]
    tools: tuple[Tool, ...] = ()
    model: ArmDescription = DEFAULT_MODEL
    base_orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    hand: Hand = DEFAULT_HAND
    payload_kg: float | None = None

    def __post_init__(self) -> None:
        for name in ("reach_m", "safe_height_m", "payload_kg"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"Robot {self.name!r}: {name} must be > 0, not {value}.")

    @property
    def mount(self) -> Pose:
        """Where its base is in the world, and how it is turned."""
        return Pose(self.base, self.base_orientation)

    @property
    def home_rad(self) -> tuple[float, ...]:
        """The posture with room for every joint [rad]."""
        return self.model.home_rad

    @property
    def tip(self) -> Transform:
        """Where the tip of its hand or tool is on the flange: y closes jaws, z points out."""
        return self.hand.tip_on_flange

    def hand_of(self, tool: Tool | None) -> Hand:
        """Return what a gripper looks like; the arm's own hand for None and for other tools."""
        return self.hand if tool is None or tool.hand is None else tool.hand

    @property
    def carries_kg(self) -> float | None:
        """Greatest mass at the flange, tool included [kg]; None if unknown."""
        return self.model.payload_kg if self.payload_kg is None else self.payload_kg

    def tool_kg(self, tool: Tool | None) -> float:
        """Return the mass of a tool on the flange [kg]; that of the hand if none is given."""
        return self.hand.mass_kg if tool is None or tool.mass_kg is None else tool.mass_kg

    def place(self, state: State) -> tuple[str, Point]:
        """Return the fact that says where it stands in `state`, and the position [m].

        The position is that of the lowest point of tool and load, at safe height.

        Raises
        ------
        ValueError
            If the state does not say.
        """
        for fact, position in self.places.items():
            if fact in state:
                return fact, (position[0], position[1], self.safe_height_m)
        raise ValueError(f"The state does not say where {self.name!r} stands: {state}.")

    def tool(self, state: State) -> Tool | None:
        """Return the attached tool, or None."""
        for tool in self.tools:
            if tool.fact in state:
                return tool
        return None


@dataclass(frozen=True)
class Scene:
    """All geometry of a task.

    Raises
    ------
    ValueError
        If two bodies, or two robots, have one name.
    """

    bodies: tuple[Body, ...]
    robots: tuple[Robot, ...]
    stations: Mapping[str, Point] = field(default_factory=dict)
    frames: Mapping[str, Pose] = field(default_factory=dict)

    def __repr__(self) -> str:
        bodies = ", ".join(body.name for body in self.bodies)
        return f"<Scene of {', '.join(robot.name for robot in self.robots)}: {bodies}>"

    def __post_init__(self) -> None:
        for kind, items in (("bodies", self.bodies), ("robots", self.robots)):
            names = [item.name for item in items]
            if len(set(names)) != len(names):
                raise ValueError(f"Scene {kind} must have distinct names, not {names}.")

    def body(self, name: str) -> Body:
        """Return a body by name."""
        return next(body for body in self.bodies if body.name == name)

    def robot(self, name: str) -> Robot:
        """Return a robot by name."""
        return next(robot for robot in self.robots if robot.name == name)

    def at(self, state: State) -> dict[str, Pose]:
        """Return the pose of every body whose place the state determines."""
        poses = {}
        for body in self.bodies:
            placement = body.placement(state)
            if placement is None:
                continue
            if placement.frame == WORLD:
                poses[body.name] = placement.pose
            else:
                _, tip = self.robot(placement.frame).place(state)
                poses[body.name] = placement.pose.moved(tip)
        return poses
