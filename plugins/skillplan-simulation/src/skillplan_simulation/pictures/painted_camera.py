"""A software camera for simulated cells: surfaces, colours and views."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.collision.solid import area, intersect
from skillplan.physics.performance import HEIGHT, WIDTH, Image, View
from skillplan.robots.arm_description import Capsule, Hand, Hull, LinkShape
from skillplan.task.motion import Point
from skillplan.task.pose import Pose
from skillplan.task.scene import Robot, Scene, Zone
from skillplan.task.shape import Box, Cylinder, Mesh, Shape
from skillplan_pinocchio.shapes import ConvexPiece
from skillplan_simulation.pictures.annotations import Notes, Projection, annotate
from skillplan_simulation.pictures.rasteriser import (
    compute_corner_normals,
    draw_ground,
    draw_solid,
    shade,
    smooth_edges,
)
from skillplan_simulation.robot_shapes import make_tool_body
from skillplan_simulation.simulator import FINGERS, HAND, ROBOT, TABLE, Arm, World

Corners = NDArray[np.float64]
Triangles = NDArray[np.float32]

# Corners of a circle, and of a quarter of a ball's outline.
_CIRCLE, _QUARTER = 40, 8
# Cosine of the angle below which an edge between two triangles is smoothed.
_SMOOTH = float(np.cos(np.radians(38.0)))


@dataclass(frozen=True, slots=True)
class Surface:
    """A triangulated surface in its own frame.

    Parameters
    ----------
    corners
        Corners of the triangles, anticlockwise from outside [m], shape (n, 3, 3).
    normals
        Normals of the corners, shape (n, 3, 3).
    """

    corners: Triangles
    normals: Triangles

    @property
    def middle(self) -> Corners:
        """Centre of the bounding box [m], shape (3,)."""
        points = self.corners.reshape(-1, 3).astype(np.float64)
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


def make_body_surface(shapes: Iterable[Shape]) -> Surface:
    """Return the surface of the shapes of a body."""
    return _make_surface([_triangulate_shape(shape) for shape in shapes])


def make_link_surface(shapes: Iterable[LinkShape]) -> Surface:
    """Return the surface of the shapes of a link."""
    return _make_surface([_triangulate_link(shape) for shape in shapes])


def make_hand_surface(hand: Hand) -> Surface:
    """Return the surface of a hand's body, in the frame of the arm's tip."""
    pieces = [
        [(across, along, deep - hand.arm_tip_m) for along, across, deep in piece]
        for piece in hand.body_as_described
    ]
    return _make_surface([_triangulate_hull(corners) for corners in pieces])


def make_finger_surface(hand: Hand, side: int) -> Surface:
    """Return the surface of a closed jaw in the frame of the arm's tip; its side is 1 or -1."""
    pieces = [
        [(across, side * behind, hand.beyond_m - up) for behind, across, up in piece]
        for piece in hand.jaw
    ]
    return _make_surface([_triangulate_hull(corners) for corners in pieces])


def _make_surface(triangles: Sequence[Corners]) -> Surface:
    corners = np.concatenate([np.zeros((0, 3, 3)), *triangles])
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(across, axis=1)
    corners, across = corners[size > 0.0], across[size > 0.0]
    _, places = np.unique(np.round(corners.reshape(-1, 3), 7), axis=0, return_inverse=True)
    places = np.asarray(places, dtype=np.int64).ravel()
    order = np.argsort(places, kind="stable")
    normals = compute_corner_normals(across, places, order, _SMOOTH)
    return Surface(corners.astype(np.float32), normals.reshape(-1, 3, 3).astype(np.float32))


def _triangulate_shape(shape: Shape) -> Corners:
    if isinstance(shape, Mesh) and shape.faces:
        return np.asarray(np.array(shape.corners)[np.array(shape.faces)])
    if isinstance(shape, Mesh):
        return _triangulate_hull(shape.corners)
    if isinstance(shape, Cylinder):
        x, y, z = shape.centre
        half = shape.height_m / 2
        return _triangulate_round(
            (x, y, z - half), (x, y, z + half), shape.diameter_m / 2, domed=False
        )
    return _triangulate_box(shape)


def _triangulate_link(shape: LinkShape) -> Corners:
    if isinstance(shape, Hull):
        return _triangulate_hull(shape.corners_m)
    domed = isinstance(shape, Capsule)
    return _triangulate_round(shape.start_m, shape.end_m, shape.radius_m, domed=domed)


def _triangulate_box(box: Box) -> Corners:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return _triangulate_hull((np.array(box.centre) + signs * np.array(box.size) / 2).tolist())


def _triangulate_hull(points: Sequence[Sequence[float]]) -> Corners:
    """Return the triangles of the hull of some points."""
    corners, triangles = ConvexPiece(np.array(points, dtype=np.float64)).surface
    facets = corners[triangles]
    # Orient all triangles outward.
    across = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    away = facets.mean(axis=1) - corners.mean(axis=0)
    inward = np.einsum("ij,ij->i", across, away) < 0.0
    facets[inward] = facets[inward][:, ::-1]
    return np.asarray(facets)


def _triangulate_round(
    start_m: Sequence[float], end_m: Sequence[float], radius_m: float, *, domed: bool
) -> Corners:
    """Return the triangles of a cylinder between two points, or of a capsule around them."""
    start, end = np.array(start_m), np.array(end_m)
    length_m = float(np.linalg.norm(end - start))
    axis = (end - start) / length_m if length_m > 0.0 else np.array((0.0, 0.0, 1.0))
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    # Rings from end to end: position along the axis, and radius.
    if domed:
        turns = np.linspace(0.0, np.pi / 2, _QUARTER + 1)
        ends = [(-radius_m * np.cos(turn), radius_m * np.sin(turn)) for turn in turns]
        rings = ends + [(length_m - along, wide) for along, wide in ends[::-1]]
    else:
        rings = [(0.0, 0.0), (0.0, radius_m), (length_m, radius_m), (length_m, 0.0)]
    angles = np.arange(_CIRCLE) * 2 * np.pi / _CIRCLE
    about = np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * other
    points = np.array([start + along * axis + wide * about for along, wide in rings])
    after = np.roll(points, -1, axis=1)
    low = np.stack([points[:-1], after[:-1], after[1:]], axis=2)
    high = np.stack([points[:-1], after[1:], points[1:]], axis=2)
    return np.concatenate([low.reshape(-1, 3, 3), high.reshape(-1, 3, 3)])


Frame = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Part:
    """A surface at its place in the world.

    Parameters
    ----------
    name
        Owner: a body or tool, or the arm, its hand or a finger.
    frame
        Pose of the surface in the world, shape (3, 4).
    """

    name: str
    surface: Surface
    frame: Frame

    @property
    def middle(self) -> NDArray[np.float64]:
        """Centre of its bounding box in the world [m]."""
        return np.asarray(self.frame[:, :3] @ self.surface.middle + self.frame[:, 3])


class CellParts:
    """Surfaces of a scene, built when first needed.

    Parameters
    ----------
    scene
        Scene with one robot.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, self._robot = scene, scene.robots[0]
        self._made: dict[str, Surface] = {}
        self._hands: dict[Hand, tuple[Surface, ...]] = {}
        self._links: list[Surface] | None = None

    def of(self, world: World, arm: Arm) -> list[Part]:
        """Return all visible parts."""
        return [*self._of_bodies(world, arm.hand), *self._of_arm(arm)]

    def _of_bodies(self, world: World, hand: Hand) -> Iterator[Part]:
        for name in world.bodies:
            yield Part(name, self._of_body(name, hand), _make_frame(world.pose(name)))
        for tool in self._robot.tools:
            # A tool that was not taken yet lies in its dock, without collisions.
            body = make_tool_body(tool, hand)
            if body is not None and tool.name not in world.numbers and tool.mount is None:
                place = _make_frame(Pose(tool.holder))
                yield Part(tool.name, self._of_body(tool.name, hand), place)

    def _of_body(self, name: str, hand: Hand) -> Surface:
        if name not in self._made:
            bodies = {body.name: body for body in self._scene.bodies}
            tools = {tool.name: tool for tool in self._robot.tools}
            body = bodies.get(name) or make_tool_body(tools[name], hand)
            assert body is not None
            self._made[name] = make_body_surface(body.drawn_shapes)
        return self._made[name]

    def _of_arm(self, arm: Arm) -> Iterator[Part]:
        if self._links is None:
            self._links = [make_link_surface(shapes) for shapes in self._robot.model.shapes]
        joints_rad = np.array(arm.joints_rad())
        frames = [
            np.hstack([placement.rotation, placement.translation[:, None]])
            for placement in arm.kinematics.frames(joints_rad)
        ]
        for surface, frame in zip(
            self._links, [_get_base_frame(self._robot), *frames], strict=False
        ):
            yield Part(ROBOT, surface, frame)
        if not arm.shows_hand:
            return
        if arm.hand not in self._hands:
            jaws = (make_finger_surface(arm.hand, side) for side in (1, -1))
            self._hands[arm.hand] = (make_hand_surface(arm.hand), *jaws)
        body, *fingers = self._hands[arm.hand]
        tip = frames[-1]
        yield Part(HAND, body, tip)
        for name, finger, side in zip(FINGERS, fingers, (1, -1), strict=True):
            moved = tip.copy()
            moved[:, 3] += side * arm.jaw_width_m() / 2 * tip[:, 1]
            yield Part(name, finger, moved)


def _get_base_frame(robot: Robot) -> Frame:
    return _make_frame(robot.mount)


def _make_frame(pose: Pose) -> Frame:
    return np.hstack([np.array(pose.rotation), np.array(pose.position)[:, None]])


Colour = tuple[float, float, float, float]

PALETTE: tuple[Colour, ...] = (
    (0.16, 0.45, 0.24, 1.0),
    (0.85, 0.55, 0.20, 1.0),
    (0.80, 0.72, 0.30, 1.0),
    (0.55, 0.35, 0.65, 1.0),
    (0.75, 0.30, 0.25, 1.0),
    (0.35, 0.50, 0.75, 1.0),
    (0.45, 0.45, 0.48, 1.0),
    (0.20, 0.65, 0.65, 1.0),
    (0.90, 0.60, 0.65, 1.0),
    (0.55, 0.75, 0.30, 1.0),
    (0.20, 0.25, 0.55, 1.0),
    (0.55, 0.38, 0.22, 1.0),
    (0.70, 0.80, 0.92, 1.0),
    (0.25, 0.22, 0.22, 1.0),
)
TABLE_COLOUR: Colour = (0.83, 0.82, 0.79, 1.0)
ARM_COLOUR: Colour = (0.93, 0.93, 0.94, 1.0)
HAND_COLOUR: Colour = (0.36, 0.37, 0.40, 1.0)
# Marks on the table for feeders and docks.
FEEDER_COLOUR: Colour = (0.60, 0.66, 0.74, 1.0)
# Floors of zones that keep something out, and of slow ones.
CLOSED_COLOUR: Colour = (0.93, 0.70, 0.66, 1.0)
SLOW_COLOUR: Colour = (0.96, 0.87, 0.62, 1.0)
FIXTURE_COLOUR: Colour = (0.55, 0.57, 0.60, 1.0)
DOCK_COLOUR: Colour = (0.42, 0.46, 0.52, 1.0)
# Colliding bodies are red and orange, everything else is pale.
ALARMS: tuple[Colour, Colour] = ((0.90, 0.10, 0.10, 1.0), (1.0, 0.55, 0.05, 1.0))
PALE: Colour = (0.80, 0.80, 0.80, 1.0)


def get_colour_number(scene: Scene, name: str) -> int:
    """Return the number of a body's colour, the same in every picture; tools follow parts."""
    names = [body.name for body in scene.bodies]
    names += [tool.name for robot in scene.robots for tool in robot.tools]
    return names.index(name)


# Suffixes of the places of feeders and docks.
_FEEDER, _DOCK = ".start)", "holder)"
# A part this near to its feeder replaces the feeder's label [m].
_NEAR_M = 0.04
# Radius of a mark on the table [m].
PLACE_M = 0.022

Named = tuple[str, Point]


class CellStyle:
    """Colours, name tags and captions of a scene.

    Parameters
    ----------
    labels
        True if bodies, feeders and docks have name tags.
    """

    def __init__(self, scene: Scene, *, labels: bool) -> None:
        self.scene, self.labels = scene, labels
        names = [body.name for body in scene.bodies]
        names += [tool.name for robot in scene.robots for tool in robot.tools]
        self._colours = {
            name: PALETTE[get_colour_number(scene, name) % len(PALETTE)] for name in names
        } | {body.name: FIXTURE_COLOUR for body in scene.bodies if body.fixed}

    def colour(self, name: str, culprits: Sequence[str]) -> Colour:
        """Return the colour of a body, of the table, or of arm, hand or finger."""
        if name in culprits:
            return ALARMS[min(list(culprits).index(name), len(ALARMS) - 1)]
        if name == TABLE:
            return TABLE_COLOUR
        if culprits:
            return PALE
        if name == ROBOT:
            return ARM_COLOUR
        return HAND_COLOUR if name in (HAND, *FINGERS) else self._colours[name]

    def places(self, culprits: Sequence[str] = ()) -> list[tuple[str, Point, Colour]]:
        """Return names, positions and colours of feeders and docks."""
        places = []
        for robot in self.scene.robots:
            for fact, place in robot.places.items():
                if fact.endswith((_FEEDER, _DOCK)):
                    name = fact.removeprefix("at(").removesuffix(")")
                    colour = DOCK_COLOUR if fact.endswith(_DOCK) else FEEDER_COLOUR
                    places.append((name, place, PALE if culprits else colour))
        return places

    def notes(
        self, world: World, caption: str, culprits: Sequence[str], middles: Iterable[Named]
    ) -> Notes:
        """Return the annotations of a picture."""
        words = f"{' and '.join(culprits)}: {caption}" if culprits else caption
        return Notes(words, tuple(self._tags(list(middles))), _find_contact(world, culprits))

    def _tags(self, middles: Sequence[Named]) -> Iterable[Named]:
        if not self.labels:
            return
        yield from middles
        named: dict[tuple[str, Point], list[str]] = {}
        for fact, (x, y, _), _ in self.places():
            if all(math.dist((x, y), at[:2]) > _NEAR_M for _, at in middles):
                name, _, kind = fact.rpartition(".")
                what = "dock" if kind == _DOCK.strip(")") else "feeder"
                named.setdefault((what, (x, y, 0.0)), []).append(name)
        yield from ((f"{what} of {', '.join(names)}", at) for (what, at), names in named.items())


def _find_contact(world: World, culprits: Sequence[str]) -> Point | None:
    """Return the point where two culprits press on each other hardest [m]."""
    contacts = [touch for touch in world.touches() if {touch.first, touch.second} == set(culprits)]
    if not contacts:
        return None
    x, y, z = max(contacts, key=lambda touch: touch.normal_n).place.tolist()
    return x, y, z


# Half the side of the table [m].
_TABLE_M = 1.5
# Height of the floor of a zone above the table [m].
_ZONE_M = 5e-4
# Direction of the light: left of the camera, behind it, and above.
_ASIDE, _BEHIND, _ABOVE = -0.45, 0.30, 1.0


class PaintedCamera:
    """Takes pictures of worlds from one viewpoint.

    Parameters
    ----------
    labels
        True if bodies, feeders and docks have name tags.
    """

    def __init__(self, scene: Scene, view: View, *, labels: bool = False) -> None:
        self._view, self._style, self._parts = (
            view,
            CellStyle(scene, labels=labels),
            CellParts(scene),
        )
        right, up, back = (np.array(axis) for axis in view.angle.axes)
        seen = Projection(view, WIDTH, HEIGHT)
        self._focal, self._eye = seen.focal, np.array(seen.eye)
        self._axes = np.stack([right, up, -back])
        self._frame = np.hstack([self._axes, (-self._axes @ self._eye)[:, None]])
        level = np.array((back[0], back[1], 0.0))
        level = level / np.linalg.norm(level) if np.linalg.norm(level) > 1e-6 else up
        lamp = _ASIDE * right + _BEHIND * level + _ABOVE * np.array((0.0, 0.0, 1.0))
        self._sun = lamp / np.linalg.norm(lamp)
        self._lamp = self._axes @ self._sun
        self._grounds: dict[bool, tuple[Any, Any, Any]] = {}
        self._zones = [
            (_make_zone_surface(zone), CLOSED_COLOUR if zone.keeps_out else SLOW_COLOUR)
            for zone in scene.zones
        ]

    def shot(
        self, world: World, arm: Arm, caption: str = "", culprits: Sequence[str] = ()
    ) -> Callable[[], Image]:
        """Return a function that paints the world as it is now, on any thread.

        Parameters
        ----------
        world, arm
            World and arm of the same simulator.
        culprits
            Bodies in alarm colours, everything else pale; of the robot, its hand or a finger. An
            arrow points to the contact between them.
        """
        parts = self._parts.of(world, arm)
        bodies = set(world.bodies)
        middles = [
            (part.name, (float(x), float(y), float(z)))
            for part in parts
            if part.name in bodies and self._style.labels
            for x, y, z in [part.middle]
        ]
        notes = self._style.notes(world, caption, culprits, middles)
        blamed = tuple(culprits)
        return lambda: self._paint(parts, blamed, notes)

    def _paint(self, parts: Sequence[Part], culprits: Sequence[str], notes: Notes) -> Image:
        buffers = self._ground(culprits)
        image, _, shown = buffers
        for number, part in enumerate(parts, start=1):
            frame = self._axes @ part.frame
            frame[:, 3] += self._frame[:, 3]
            corners, normals = part.surface.corners, part.surface.normals
            colour = _convert_to_bytes(self._style.colour(part.name, culprits))
            draw_solid(corners, normals, frame, colour, self._lamp, number, self._focal, buffers)
        for part in parts:
            corners = part.surface.corners
            shade(corners, part.frame, self._sun, self._frame, self._focal, image, shown)
        return annotate(WIDTH, HEIGHT, smooth_edges(image, shown).tobytes(), self._view, notes)

    def _ground(self, culprits: Sequence[str]) -> tuple[Any, Any, Any]:
        """Return buffers with the background, which is drawn once."""
        pale = bool(culprits)
        if pale not in self._grounds:
            size = (HEIGHT, WIDTH)
            buffers = (
                np.zeros((*size, 3), np.uint8),
                np.zeros(size, np.float32),
                np.zeros(size, np.int16),
            )
            discs = np.zeros((0, 6))
            marks = [
                (place[0], place[1], PLACE_M, *_convert_to_bytes(colour))
                for _, place, colour in self._style.places(culprits)
            ]
            discs = np.array(marks) if marks else discs
            table = _convert_to_bytes(self._style.colour(TABLE, culprits))
            draw_ground(self._eye, self._axes, self._focal, _TABLE_M, table, discs, buffers)
            for surface, colour in self._zones:
                # A part of the ground, on which shadows fall.
                draw_solid(
                    surface.corners,
                    surface.normals,
                    self._frame,
                    _convert_to_bytes(colour),
                    self._lamp,
                    0,
                    self._focal,
                    buffers,
                )
            self._grounds[pale] = buffers
        image, near, shown = self._grounds[pale]
        return image.copy(), near.copy(), shown.copy()


def _make_zone_surface(zone: Zone) -> Surface:
    """Return the part of a zone's polygon that is on the table, closed zones above slow ones."""
    height_m = 2 * _ZONE_M if zone.keeps_out else _ZONE_M
    rim = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    table = tuple((_TABLE_M * x, _TABLE_M * y) for x, y in rim)
    triangles = [
        [(x, y, height_m) for x, y in (outline[0], a, b)]
        for piece in zone.pieces
        for outline in [intersect(piece if area(piece) > 0 else piece[::-1], table)]
        for a, b in pairwise(outline[1:])
    ]
    return _make_surface([np.array(triangles, dtype=float).reshape(-1, 3, 3)])


def _convert_to_bytes(colour: Colour) -> NDArray[np.float64]:
    return 255.0 * np.array(colour[:3])
