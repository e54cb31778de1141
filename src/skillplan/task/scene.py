"""Geometry of a task: bodies, robots and stations, in SI units and the world frame.

Geometry is a function of the state: :meth:`Scene.at` returns the pose of every body in a state. No
simulation history is needed. The origin of a body is the centre of its bottom face.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from skillplan.robots.arm_description import ArmDescription, Hand, Transform
from skillplan.robots.catalogue import DEFAULT_HAND, DEFAULT_MODEL
from skillplan.task.motion import Grasp, GraspKind, Visit
from skillplan.task.pose import Point, Pose, Quaternion, dot, is_same_direction, plus, unit
from skillplan.task.shape import Box, Cylinder, Mesh, Shape
from skillplan.task.state import AND, State
from skillplan.task.zone import Zone

__all__ = [
    "WORLD",
    "Body",
    "Box",
    "Cylinder",
    "Grasp",
    "GraspKind",
    "Holder",
    "Mesh",
    "Placement",
    "Pose",
    "Quaternion",
    "Robot",
    "Scene",
    "Shank",
    "Shape",
    "Tool",
    "ToolKind",
    "Workholder",
    "Zone",
]

WORLD = "world"

# Half angle below which a turn has no axis [rad].
_NO_TURN_RAD = 1e-9


@dataclass(frozen=True, slots=True)
class Placement:
    """The pose of a body while a fact holds.

    Parameters
    ----------
    pose
        Pose in the world, or in the tip frame of the robot named by `frame`.
    frame
        ``"world"`` or a robot's name.
    solid
        False while the body cannot be touched, such as a part inside a feeder.
    """

    fact: str
    pose: Pose
    frame: str = WORLD
    solid: bool = True


@dataclass(frozen=True, slots=True)
class Fit:
    """A fit of a body in another, which is there before.

    Parameters
    ----------
    into
        Name of the body that it goes in beside.
    drawn_m
        Clearance of the drawing, on each side [m]; negative for interference.
    play_m
        Clearance that the shapes leave, on each side [m].
    kind
        ``clearance``, ``press``, ``snap``, ``compliant`` or ``glued``; "" if the body only has
        shapes that leave a play.
    force_n
        Force that pushes the body in [N]; None for the engine's limit.
    lead_in_m
        Width of the chamfer at the mouth [m]; None if contacts lead the body in.
    stops
        True if a face of another body must end the insertion.
    outside_m
        Greatest depth to which the shapes of both are in the way of parts [m], >= 0.
    """

    into: str
    drawn_m: float
    play_m: float
    kind: str = ""
    force_n: float | None = None
    lead_in_m: float | None = None
    stops: bool = False
    outside_m: float = 0.0

    @property
    def overlap_m(self) -> float:
        """Overlap of the shapes that the fit states, >= 0 [m]."""
        return max(0.0, -self.drawn_m) if self.kind else 0.0

    @property
    def holds(self) -> bool:
        """True if the body stays in place by this fit alone."""
        return self.kind in ("press", "snap", "glued")

    @property
    def fastens(self) -> bool:
        """True if engines fix the body to the other one: it is held, or cannot lie apart."""
        return self.holds or self.kind == "compliant"

    @property
    def is_led(self) -> bool:
        """True if engines lead the body in with a force: rigid shapes cannot overlap."""
        led = self.overlap_m > 0 or self.lead_in_m is not None or self.kind == "glued"
        return bool(self.kind) and led


@dataclass(frozen=True, slots=True)
class Shank:
    """The shank of a screw, below the origin of its body.

    Parameters
    ----------
    diameter_m, length_m
        Diameter and length [m], > 0.
    passes
        Names of the bodies with a hole or a thread for it.
    stands_in
        Names of the bodies that it stands in at its feeder.
    """

    diameter_m: float
    length_m: float
    passes: tuple[str, ...] = ()
    stands_in: tuple[str, ...] = ()

    @property
    def unchecked(self) -> tuple[str, ...]:
        """Names of all these bodies: engines let it pass them on every stretch."""
        return (*self.passes, *(name for name in self.stands_in if name not in self.passes))

    @property
    def shape(self) -> Cylinder:
        """The shank in the frame of the body."""
        return Cylinder(self.diameter_m, self.length_m, (0.0, 0.0, -self.length_m / 2))


def name_shank(screw: str) -> str:
    """Return the name of a screw's shank in verdicts, without an article."""
    return f"shank of {screw}"


# Least extent of a wall in the way of jaws [m].
_WALL_M = 0.001


@dataclass(frozen=True)
class Body:
    """A rigid body made of boxes, cylinders and meshes.

    Parameters
    ----------
    name
        Unique in the scene.
    shapes
        Convex shapes in the body's frame, at least one.
    placements
        Poses of the body by fact.
    mass_kg
        Mass [kg], > 0, evenly distributed.
    grasps
        Possible grasps, the preferred first.
    surfaces
        The exact shapes, if one of them is not convex and `shapes` holds its convex pieces, or if
        `shapes` leave room in fits; else empty.
    fits
        Fits in other bodies.
    fixed
        True for a body that nothing moves, however it is pushed.
    shank
        Shank of a screw; its shapes are the head alone. None if it is not modelled.
    joins
        Bodies that a driven screw fixes to each other; empty for other bodies.
    part_of
        Name of the body that replaces it once it is joined to others; "" for none.
    release_m
        Height above its goal from which it slides down by its weight [m], >= 0; 0 for that at which
        a detector or engine releases all bodies.
    """

    name: str
    shapes: tuple[Shape, ...]
    placements: tuple[Placement, ...]
    mass_kg: float
    grasps: tuple[Grasp, ...] = ()
    surfaces: tuple[Shape, ...] = ()
    fits: tuple[Fit, ...] = ()
    fixed: bool = False
    shank: Shank | None = None
    joins: tuple[str, ...] = ()
    part_of: str = ""
    release_m: float = 0.0

    def __post_init__(self) -> None:
        if not self.shapes:
            raise ValueError(f"Body {self.name!r} needs at least one shape.")
        if any(isinstance(shape, Mesh) and not shape.convex for shape in self.shapes):
            raise ValueError(f"Body {self.name!r}: shapes must be convex; pieces of one are.")
        if not (math.isfinite(self.mass_kg) and self.mass_kg > 0):
            raise ValueError(f"Body {self.name!r}: mass must be > 0 kg, not {self.mass_kg}.")

    @property
    def grasp(self) -> Grasp | None:
        """The preferred grasp, or None."""
        return self.grasps[0] if self.grasps else None

    @property
    def exact_shapes(self) -> tuple[Shape, ...]:
        """The exact shapes, convex or not."""
        return self.surfaces or self.shapes

    @property
    def drawn_shapes(self) -> tuple[Shape, ...]:
        """The exact shapes, and the shank of a screw."""
        return self.exact_shapes if self.shank is None else (*self.exact_shapes, self.shank.shape)

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The bounding boxes of the shapes."""
        return tuple(shape.box for shape in self.shapes)

    @property
    def height_m(self) -> float:
        """Height of the top above the origin [m]."""
        return max(box.centre[2] + box.size[2] / 2 for box in self.boxes)

    def is_left_straight(self, visit: Visit, grasp: Grasp) -> bool:
        """Return whether a hand leaves against the direction it points, not back as it came in.

        Jaws do if the body is between them as they close along the insertion, or if one of them is
        inside a frame: on the pick they came past it in the direction they point. A cup does if a
        wall of the body rises behind it.
        """
        is_cup = grasp.kind is GraspKind.SUCTION
        if not is_cup and abs(dot(visit.along, visit.pose.rotate(grasp.closing))) > 1e-6:
            return True
        back = visit.pose.inverse().rotate(plus((0.0, 0.0, 0.0), visit.along, -1.0))
        out = plus((0.0, 0.0, 0.0), grasp.approach, -1.0)
        if is_same_direction(back, out):
            return False
        for box in self.boxes:
            (across_m, wide_m), (behind_m, long_m), (above_m, high_m) = (
                (
                    dot(plus(box.centre, grasp.tip, -1.0), axis),
                    sum(abs(part) * size / 2 for part, size in zip(axis, box.size, strict=True)),
                )
                for axis in (grasp.closing, back, out)
            )
            if min(behind_m + long_m, above_m + high_m) < _WALL_M:
                continue
            if is_cup:
                return True
            if grasp.is_inner:
                if abs(across_m) - wide_m < grasp.width_m / 2 - _WALL_M:
                    return True
            elif abs(across_m) + wide_m > grasp.width_m / 2 + _WALL_M:
                return True
        return False

    def reach_m(self, pose: Pose, direction: Point) -> float:
        """Return the extent along a direction from the world's origin [m], at a pose."""
        own = pose.inverse().rotate(direction)
        away_m = max(shape.reach_m(own) for shape in self.shapes)
        return dot(pose.position, direction) + away_m

    def placement(self, state: State) -> Placement | None:
        """Return the placement in `state`, or None if no fact gives one."""
        for placement in self.placements:
            if placement.fact in state:
                return placement
        return None


def describe_unchecked_joins(bodies: Iterable[Body]) -> tuple[str, ...]:
    """Return that joined bodies may slip in the hand, if there are any."""
    wholes = ", ".join(dict.fromkeys(body.part_of for body in bodies if body.part_of))
    note = f"whether the members of {wholes} keep together while they are carried: they count as"
    return (f"{note} one body once joined",) if wholes else ()


def describe_unchecked_slides(bodies: Iterable[Body]) -> tuple[str, ...]:
    """Return that bodies let go above their goals may not slide there, if there are any."""
    released = ", ".join(body.name for body in bodies if body.release_m)
    return (f"whether what is let go above its goal slides there: {released}",) if released else ()


class ToolKind(StrEnum):
    """Kind of a tool: jaws, suction cup, screwdriver, press or dispenser."""

    GRIPPER = "gripper"
    SUCTION = "suction"
    SCREWDRIVER = "screwdriver"
    PRESS = "press"
    DISPENSER = "dispenser"


STANDARD_BIT_M: Final = (0.040, 0.005)
"""Length and diameter of a bit that a task does not describe [m]."""

STANDARD_CUP_M: Final = 0.016
"""Diameter of a suction cup that a task does not describe [m]."""

# Height of a pad below a shank that ends at the flange [m]. A narrow pad has a stem as long as a
# bit.
_PAD_HEIGHT_M: Final = 0.006


def find_cup_height_m(diameter_m: float) -> float:
    """Return the height of a suction cup below its shank: of its pad, or of a narrow one's stem."""
    return STANDARD_BIT_M[0] if diameter_m < STANDARD_CUP_M else _PAD_HEIGHT_M


@dataclass(frozen=True, slots=True)
class Tool:
    """A tool that a robot can attach.

    Parameters
    ----------
    name
        Unique among the tools.
    fact
        Fact that holds while the tool is attached.
    envelope
        Bounding box of the tool above its tip [m]; None if it is not modelled.
    opening_m
        Greatest distance between the jaws of a gripper [m]; None if it is not modelled.
    force_n
        Closing force of a gripper, or holding force of a suction cup [N]; None for the engine's
        default.
    hand
        Shape of a gripper; None for the hand of the arm.
    mass_kg
        Mass on the flange [kg], >= 0; None for that of the arm's hand.
    cup_m
        Diameter of a suction cup [m], > 0.
    beyond_m
        Distance of its tip beyond the tip of the arm [m], along the axis of the flange; negative
        for a tool that is shorter than the arm's hand.
    bit_m
        Length and diameter of the bit of a screwdriver, the ram of a press or the needle of a
        dispenser [m]; None for the standard one.
    shapes
        Convex shapes of its body, without bit and cups, from its tip, z towards the flange, x along
        the closing axis; empty for a gripper and for a standard shank. A tool may be turned by half
        a turn, so they are symmetric.
    cups
        Centres of the suction cups from the axis, x y [m].
    outer_m
        Least and greatest width of a part that the jaws hold from outside [m]; None for all that
        they open.
    clearance_m
        Clearance of its open jaws on each side of a part [m], >= 0; None for that of the back end.
    is_socket
        True if a socket takes the place of the bit of a screwdriver, as one of `shapes`.
    mount
        Pose of its tip, with z out of the tool and y along its closing axis, in the frame of the
        arm's tip, for a tool on the hand of another one; None for a tool on the flange's axis.
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
    cup_m: float = STANDARD_CUP_M
    beyond_m: float = 0.0
    bit_m: tuple[float, float] | None = None
    shapes: tuple[Shape, ...] = ()
    cups: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    outer_m: tuple[float, float] | None = None
    mount: Pose | None = None
    is_socket: bool = False
    clearance_m: float | None = None

    @property
    def tip_on_arm(self) -> Pose:
        """Pose of its tip in the frame of the arm's tip."""
        return Pose((0.0, 0.0, self.beyond_m)) if self.mount is None else self.mount

    @property
    def ends(self) -> tuple[Cylinder, ...]:
        """Its suction cups, or its bit, ram or needle, from its tip; empty for a gripper."""
        if self.kind is ToolKind.GRIPPER or self.is_socket:
            return ()
        if self.kind is ToolKind.SUCTION:
            height_m = find_cup_height_m(self.cup_m)
            return tuple(Cylinder(self.cup_m, height_m, (x, y, height_m / 2)) for x, y in self.cups)
        height_m, diameter_m = self.bit_m or STANDARD_BIT_M
        return (Cylinder(diameter_m, height_m, (0.0, 0.0, height_m / 2)),)

    @property
    def boxes(self) -> tuple[Box, ...]:
        """Boxes about it from its tip; empty if its body is not modelled, and for a gripper."""
        if self.envelope is not None:
            return (self.envelope,)
        if self.kind is ToolKind.GRIPPER or not self.shapes:
            return ()
        return tuple(shape.box for shape in (*self.ends, *self.shapes))


@dataclass(frozen=True)
class Robot:
    """A manipulator.

    Parameters
    ----------
    name
        Unique in the scene.
    reach_m
        Greatest distance from base to tool tip [m], > 0.
    safe_height_m
        Height of the lowest point of tool and load above the table during travel [m], > 0.
    places
        Positions of the tip by fact [m].
    model
        Description of the arm: joints, limits, masses, shapes and home posture.
    hand
        Hand on the flange. Its jaws end at the tip of the arm.
    payload_kg
        Greatest mass at the flange, tool included [kg], > 0; None for that of the model.
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
        """Pose of the base in the world."""
        return Pose(self.base, self.base_orientation)

    @property
    def home_rad(self) -> tuple[float, ...]:
        """Home posture, in which every joint can move both ways [rad]."""
        return self.model.home_rad

    @property
    def tip(self) -> Transform:
        """Pose of the tip on the flange: jaws close along y, z points away from the hand."""
        return self.hand.tip_on_flange

    def hand_of(self, tool: Tool | None) -> Hand:
        """Return the shape of a gripper; the arm's own hand for None and for other tools."""
        return self.hand if tool is None or tool.hand is None else tool.hand

    @property
    def carries_kg(self) -> float | None:
        """Greatest mass at the flange, tool included [kg]; None if unknown."""
        return self.model.payload_kg if self.payload_kg is None else self.payload_kg

    def tool_kg(self, tool: Tool | None) -> float:
        """Return the mass of a tool [kg]; for None, that of the hand."""
        return self.hand.mass_kg if tool is None or tool.mass_kg is None else tool.mass_kg

    def list_companions(self, tool: Tool | None) -> tuple[Tool, ...]:
        """Return the other tools on the same hand."""
        if tool is None:
            return ()
        alike = (item for item in self.tools if item.fact == tool.fact)
        return tuple(item for item in alike if item.name != tool.name)

    def place(self, state: State) -> tuple[str, Point]:
        """Return the fact for the place of the arm in `state`, and the position [m].

        The position is the lowest point of tool and load, at safe height.

        Raises
        ------
        ValueError
            If the state gives no place.
        """
        for fact, position in self.places.items():
            if fact in state:
                return fact, (position[0], position[1], self.safe_height_m)
        raise ValueError(f"The state gives no place of {self.name!r}: {state}.")

    def tool(self, state: State, acting: str | None = None) -> Tool | None:
        """Return the attached tool, or None.

        Parameters
        ----------
        acting
            Name of the tool that acts, if several are attached on one hand. Default: the first.
        """
        attached = [tool for tool in self.tools if tool.fact in state]
        named = (tool for tool in attached if tool.name == acting)
        return next(named, attached[0] if attached else None)


@dataclass(frozen=True)
class Workholder:
    """A station that carries bodies and turns them about a fixed point.

    Parameters
    ----------
    name
        Unique among the workholders.
    pivot
        Fixed point of its turns in the world [m].
    orientations
        Motions that take bodies from the first orientation to each one, by the fact that holds
        there.
    carries
        Bodies that turn with it once they are placed or fastened.
    own
        Bodies of the workholder itself, which are always on it.
    """

    name: str
    pivot: Point
    orientations: Mapping[str, Pose]
    carries: tuple[str, ...] = ()
    own: tuple[str, ...] = ()

    def find_orientation(self, state: State) -> str:
        """Return the fact of its orientation in `state`.

        Raises
        ------
        ValueError
            If the state gives none.
        """
        for fact in self.orientations:
            if fact in state:
                return fact
        raise ValueError(f"The state gives no orientation of {self.name!r}: {state}.")

    def turn(self, begin: str, end: str, share: float) -> Pose:
        """Return the motion of bodies from an orientation over a share of the turn to another.

        It rotates about the pivot along the shortest arc, and shifts along a straight line.

        Parameters
        ----------
        begin, end
            Facts of the two orientations.
        share
            Share of the angle and of the shift, in [0, 1].
        """
        first, last = self.orientations[begin], self.orientations[end]
        x, y, z, w = last.then(first.inverse()).orientation
        # Half of the angle is at most a quarter of a turn on the shortest arc.
        sign = -1.0 if w < 0 else 1.0
        half_rad = math.atan2(math.hypot(x, y, z), abs(w))
        axis = (0.0, 0.0, 1.0) if half_rad < _NO_TURN_RAD else unit((sign * x, sign * y, sign * z))
        sine = math.sin(share * half_rad)
        about = Pose(
            (0.0, 0.0, 0.0),
            (axis[0] * sine, axis[1] * sine, axis[2] * sine, math.cos(share * half_rad)),
        )
        # Places of the pivot after both turns.
        start, stop = first.apply(self.pivot), last.apply(self.pivot)
        middle = plus(start, plus(stop, start, -1.0), share)
        return Pose(plus(middle, about.rotate(start), -1.0), about.orientation)

    def move(self, begin: str, end: str, time_share: float) -> Pose:
        """Return the motion of bodies over a share of the time of a turn, from rest to rest.

        Parameters
        ----------
        begin, end
            Facts of the two orientations.
        time_share
            Share of the time, in [0, 1].
        """
        # The polynomial of least jerk.
        share = time_share**3 * (10.0 - 15.0 * time_share + 6.0 * time_share**2)
        return self.turn(begin, end, share)


@dataclass(frozen=True)
class Holder:
    """A clamp, or a passive holder, that keeps a part where it is.

    Parameters
    ----------
    name
        Unique among the holders.
    kind
        ``clamp`` closes on a placed part; ``hold`` may be set before the part comes.
    facts
        Facts that it holds a part, by the name of the part.
    workholder
        Name of the workholder that it turns along with; None if it stands in the world.
    force_n
        Force of its jaws [N]; None if it is not stated.
    fixtures
        Bodies that are there only while it holds a part.
    """

    name: str
    kind: str
    facts: Mapping[str, str]
    workholder: str | None = None
    force_n: float | None = None
    fixtures: tuple[str, ...] = ()


@dataclass(frozen=True)
class Scene:
    """The geometry of a task."""

    bodies: tuple[Body, ...]
    robots: tuple[Robot, ...]
    stations: Mapping[str, Point] = field(default_factory=dict)
    frames: Mapping[str, Pose] = field(default_factory=dict)
    zones: tuple[Zone, ...] = ()
    workholders: tuple[Workholder, ...] = ()
    holders: tuple[Holder, ...] = ()

    def __repr__(self) -> str:
        bodies = ", ".join(body.name for body in self.bodies)
        return f"<Scene of {', '.join(robot.name for robot in self.robots)}: {bodies}>"

    def __post_init__(self) -> None:
        for kind, items in (
            ("bodies", self.bodies),
            ("robots", self.robots),
            ("zones", self.zones),
            ("workholders", self.workholders),
            ("holders", self.holders),
        ):
            names = [item.name for item in items]
            if len(set(names)) != len(names):
                raise ValueError(f"Scene {kind} must have distinct names, not {names}.")

    def body(self, name: str) -> Body:
        """Return a body by name."""
        return next(body for body in self.bodies if body.name == name)

    def robot(self, name: str) -> Robot:
        """Return a robot by name."""
        return next(robot for robot in self.robots if robot.name == name)

    def find_workholder(self, subject: str) -> Workholder:
        """Return a workholder by name, or by ``WORKHOLDER.ORIENTATION``, a visit's subject."""
        name = subject.partition(".")[0]
        return next(holder for holder in self.workholders if holder.name == name)

    def list_carried(self, workholder: Workholder, state: State) -> frozenset[str]:
        """Return the bodies that turn with a workholder in `state`, its own included."""
        fact = workholder.find_orientation(state)
        return frozenset(
            body.name
            for body in self.bodies
            if (placement := body.placement(state)) is not None
            and fact in placement.fact.split(AND)
        )

    def list_held(self, state: State) -> dict[str, Holder]:
        """Return the holder of each part that is held in `state`; the first if it has several."""
        held: dict[str, Holder] = {}
        for holder in self.holders:
            for part, fact in holder.facts.items():
                if fact in state:
                    held.setdefault(part, holder)
        return held

    def at(self, state: State) -> dict[str, Pose]:
        """Return the pose of every body that the state determines."""
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
