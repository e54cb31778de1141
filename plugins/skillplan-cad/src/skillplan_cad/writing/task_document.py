"""Write `product.yaml` and its meshes for an assembly plan."""

from __future__ import annotations

import math
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from skillplan.collision import compute_margin_m
from skillplan.collision.contact_forces import find_axes_across
from skillplan.domains.assembly import MAX_CORNERS
from skillplan.physics.linear_motions import SHANK_DIAMETER_M
from skillplan.robots.arm_description import Hand
from skillplan.robots.catalogue import ARMS
from skillplan.task.pose import DOWN
from skillplan_cad.blocking.ray_mesh import RayMesh
from skillplan_cad.planning.assembly_plan import AssemblyPlan, Step
from skillplan_cad.planning.bearing import Bearing, list_required
from skillplan_cad.planning.precedence import encode_set
from skillplan_cad.planning.stability import is_over
from skillplan_cad.product import (
    ROUND_KINDS,
    Part,
    Points,
    Product,
    Triangles,
    Vector,
    has_proper_edges,
    part_touching_corners,
    simplify_mesh,
    split_bodies,
)
from skillplan_cad.relation import Fastener, LeftOut, Relation
from skillplan_cad.writing.fit_play import choose_direction, list_free_directions
from skillplan_cad.writing.held_part import (
    CUP,
    CUPS_M,
    DRIVER,
    EXTENSIONS,
    GRIPPER,
    GRIPPERS,
    HEAVY_CUP,
    LARGE_CUP,
    LARGE_REACH_M,
    LONG_TIPS,
    NARROW_CUP,
    NEEDLE,
    PROFILES_M,
    SMALL_CUP,
    SOCKETS,
    TIPS,
    WIDE_CUP,
    PartHolds,
    build_tips,
    equip_hand,
)
from skillplan_cad.writing.lanes import LEAST_HEAD_M, MOST_HOVER_M, PLAY_M, JawSpaces
from skillplan_cad.writing.pieces_proof import PieceProof, ProvedPieces
from skillplan_cad.writing.upright import (
    Upright,
    list_angles_rad,
    name_orientations,
    place_turned,
)

_LONGEST = 64
# Sizes of nuts that a task has, and how far a thread may be from its size [-].
_SIZES = ("M2", "M2.5", "M3", "M4", "M5", "M6", "M8", "M10", "M12")
_NEAR_SIZE = 0.04
# Widths of sockets are rounded to tenths of a millimetre. A nut is a hexagon if one through its
# corners is at most wider than its flats by this factor.
_WIDTH_DECIMALS, _HEXAGON = 4, 1.05
# Lengths of the bits of screwdrivers and sockets; with the first, both are as long as a hand [m].
_BITS_M, _SOCKETS_M = (0.04, 0.10, 0.16), (0.05, 0.11, 0.17)
# Depth of a socket about a thin nut, as a share of the nut's height, and least depth [m].
_SOCKET_DEPTH, _LEAST_DEPTH_M = 0.8, 1e-4
# Width and length of the spindle of a socket [m].
_SPINDLE_M = (0.03, 0.062)


def assign_task_names(names: Iterable[str], taken: Iterable[str] = ()) -> Mapping[str, str]:
    """Map each part name to a unique task name of letters, digits, `_` and `-`.

    Parameters
    ----------
    taken
        Names that parts must not use.
    """
    task_name_of: dict[str, str] = {}
    seen = set(taken)
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_") or "part"
        if not plain[0].isalpha():
            plain = f"part_{plain}"
        task_name_of[name] = find_free_name(plain, seen)
        seen.add(task_name_of[name])
    return task_name_of


def find_free_name(name: str, taken: Collection[str]) -> str:
    """Return a name, with a number at its end if it is taken."""
    new, number = name[:_LONGEST], 2
    while new in taken:
        end = f"_{number}"
        new, number = f"{name[: _LONGEST - len(end)]}{end}", number + 1
    return new


Place = tuple[float, float]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Clearance between part boxes: for fingers, for the hand next to tall parts, and for a level hand.
_APART_M = 0.04
_BESIDE_TALL_M = 0.13
_BESIDE_RAISED_M = 0.25
_TALL_M = 0.035
_BESIDE_PRODUCT_M = 0.14
_GRID_M = 0.02
# Nearest and farthest place, as shares of the arm's reach; and the least of the nearest [m].
_NEAREST, _FARTHEST, _NEAREST_M = 0.25, 0.8422, 0.30
_SPREAD_RAD = math.radians(110)
# Most that a part slides further in the opposite direction, which is tried, too [-]; contacts are
# sampled.
_LONGER_TRAVEL = 1.25
# Nearest place of a level hand, if there is room, as a share of the arm's reach; and the distance
# from its tip to the wrist.
_NEAREST_LEVEL, WRIST = 0.55, 0.2
# Shares of the reach of a large arm for places at which its hand points along any axis.
_NEAREST_WRIST, _FARTHEST_WRIST = 0.4, 0.7
# Holders of the usual tools, and of those for small and heavy parts.
HOLDERS: tuple[Place, ...] = ((0.20, 0.50), (0.28, 0.50), (0.36, 0.50))
FURTHER_HOLDERS: tuple[Place, ...] = (
    *((0.12, 0.50), (0.04, 0.50), (-0.04, 0.50)),
    *((-0.13, 0.50), (-0.24, 0.50), (-0.32, 0.50), (-0.40, 0.50)),
    *((-0.26, 0.62), (-0.02, 0.62), (0.22, 0.62), (0.46, 0.62)),
    *((0.20, -0.50), (0.28, -0.50), (0.36, -0.50)),
    *((0.12, -0.50), (0.04, -0.50), (-0.04, -0.50)),
    *((-0.12, -0.50), (-0.20, -0.50), (-0.28, -0.50)),
)
# Least distance of a holder from an arm that reaches down that near [m].
_LEAST_HOLDER_M = 0.5
# Place of the tip at the start, as a share of the arm's reach; and the least of it [m].
_HOME, _HOME_M = 0.3, 0.35
# Arms whose elbow does not bend far enough to stand that near above the table [m].
_HOMES_M: Mapping[str, float] = {"iiwa7": 0.42, "iiwa14": 0.45}
# Share of the reach within which arms with a long hand work that points straight down.
_DOWNWARD: Mapping[str, float] = {"gen3_7dof": 0.88}
# Least distance at which arms reach down whose elbow does not bend far enough for less [m].
_NEAREST_DOWN_M: Mapping[str, float] = {"iiwa7": 0.42, "iiwa14": 0.42}


@dataclass(frozen=True, slots=True)
class Item:
    """A part, or a feeder of identical parts, that needs a place on the table.

    Parameters
    ----------
    size_m
        Extents x y z of the bounding box [m].
    is_raised
        True if a feeder presents it to a level hand.
    """

    name: str
    size_m: tuple[float, float, float]
    is_raised: bool = False

    @property
    def half_m(self) -> Place:
        """Half of its extents x y [m]."""
        return self.size_m[0] / 2, self.size_m[1] / 2

    @property
    def room_m(self) -> float:
        """Distance to what stands beside it [m]."""
        if self.is_raised:
            return _BESIDE_RAISED_M
        return _BESIDE_TALL_M if self.size_m[2] > _TALL_M else _APART_M


@dataclass(frozen=True, slots=True)
class Tray:
    """A layout of the table.

    Parameters
    ----------
    product_m
        Centre of the product's bounding box, x y [m].
    places
        Place of each item, by name.
    without
        Names of items that do not fit within reach.
    """

    product_m: Place
    places: dict[str, Place] = field(default_factory=dict)
    without: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Taken:
    """An occupied rectangle of the table."""

    middle: Place
    half: Place
    room: float

    def is_near(self, middles: Floats, half: Place, room: float) -> Bools:
        """Return a mask of the centres at which a rectangle would be too close."""
        distance_m = np.add(half, self.half) + (max(room, self.room) - 1e-9)
        near: Bools = np.all(np.abs(middles - self.middle) < distance_m, axis=1)
        return near


def lay_out_table(
    product_size_m: tuple[float, float, float],
    items: Sequence[Item],
    robot: str,
    holders: Sequence[Place] = HOLDERS,
    kept: Mapping[str, Place] | None = None,
    product_m: Place | None = None,
) -> Tray:
    """Lay out the table: product in front of the arm to its left, items close to it.

    Parameters
    ----------
    product_size_m
        Extents x y z of the product in its final orientation [m].
    items
        Items to place; the largest are placed first.
    robot
        Arm that reaches all places with a hand that points straight down.
    holders
        Places of tools, which stay free.
    kept
        Places of items that stay where they are, by name.
    product_m
        Centre of the product, if it stays where it is.
    """
    known = kept or {}
    nearest, farthest = find_range_m(robot)
    goal = product_m or choose_goal(product_size_m, nearest, farthest)
    half = (product_size_m[0] / 2, product_size_m[1] / 2)
    taken = [_Taken(goal, half, _BESIDE_PRODUCT_M)]
    taken += [_reserve_holder(place) for place in holders]
    spots = _list_grid_places(nearest, farthest, goal)
    places: dict[str, Place] = {}
    without = []
    order = sorted(
        items,
        key=lambda item: (item.name not in known, -item.size_m[0] * item.size_m[1], item.name),
    )
    for item in order:
        size, room = item.half_m, item.room_m
        spot = known.get(item.name)
        if spot is None:
            fits = _mask_fitting(spots, size, room, taken, nearest, farthest)
            if item.is_raised:
                # The wrist of a level hand that points away from the arm is nearer than the part.
                reach_m, far_m = ARMS[robot][0].works_within_m, np.hypot(*spots.T)
                level = fits & (far_m >= _NEAREST_LEVEL * reach_m)
                if reach_m > LARGE_REACH_M:
                    # It may point anywhere, with its wrist in reach.
                    wrists = [np.abs(spots) + along for along in WRIST * reach_m * np.eye(2)]
                    behind_m = np.maximum(*(np.hypot(*wrist.T) for wrist in wrists))
                    near = fits & (far_m >= _NEAREST_WRIST * reach_m)
                    near &= behind_m <= _FARTHEST_WRIST * reach_m
                    level = near if near.any() else level
                fits = level if level.any() else fits
            free = np.flatnonzero(fits)
            if not len(free):
                without.append(item.name)
                continue
            spot = (float(spots[free[0], 0]), float(spots[free[0], 1]))
        places[item.name] = spot
        taken.append(_Taken(spot, size, room))
    return Tray(goal, places, tuple(sorted(without)))


def find_range_m(robot: str) -> tuple[float, float]:
    """Return the nearest and the farthest distance at which an arm works downwards [m]."""
    reach_m = ARMS[robot][0].works_within_m * _DOWNWARD.get(robot, 1.0)
    nearest_m = max(_NEAREST_DOWN_M.get(robot, _NEAREST_M), _NEAREST * reach_m)
    return nearest_m, _FARTHEST * reach_m


def _place_holder(place: Place, robot: str) -> Place:
    """Return the place of a holder, farther out for an arm that does not reach down so near."""
    share = max(1.0, find_range_m(robot)[0] / _LEAST_HOLDER_M)
    return round(share * place[0], 3), round(share * place[1], 3)


def _reserve_holder(place: Place) -> _Taken:
    return _Taken(place, (0.03, 0.03), 0.06)


def choose_goal(size_m: tuple[float, float, float], nearest_m: float, farthest_m: float) -> Place:
    """Return the product's place: half a metre before the arm, a little to its left.

    A large product comes nearer, and then straight before the arm.
    """
    y_m = min(0.12 + size_m[1] / 2, 0.25)
    least_m = nearest_m + size_m[0] / 2
    x_m = max(0.50, least_m)
    beyond_m = math.hypot(x_m + size_m[0] / 2, y_m + size_m[1] / 2) - farthest_m
    if beyond_m > 0:
        x_m = max(least_m, x_m - beyond_m)
        room_m = math.sqrt(max(farthest_m**2 - (x_m + size_m[0] / 2) ** 2, 0.0))
        y_m = min(y_m, max(0.0, room_m - size_m[1] / 2))
    return round(x_m, 3), round(y_m, 3)


def _list_grid_places(nearest_m: float, farthest_m: float, goal: Place) -> Floats:
    """Return grid places within reach, sorted by distance to the product."""
    count = int(farthest_m / _GRID_M)
    places = []
    for i in range(-count, count + 1):
        for j in range(-count, count + 1):
            x, y = round(i * _GRID_M, 3), round(j * _GRID_M, 3)
            inside = nearest_m <= math.hypot(x, y) <= farthest_m
            if inside and abs(math.atan2(y, x)) <= _SPREAD_RAD:
                places.append((x, y))
    places.sort(key=lambda place: (round(math.dist(place, goal), 6), place))
    return np.array(places).reshape(-1, 2)


def _mask_fitting(
    spots: Floats,
    half: Place,
    room: float,
    taken: Sequence[_Taken],
    nearest_m: float,
    farthest_m: float,
) -> Bools:
    """Return a mask of the places where a rectangle is in reach and clear of all others."""
    x_m, y_m = np.abs(spots).T
    corners = [np.hypot(x_m + sign * half[0], y_m + half[1]) for sign in (-1, 1)]
    near = np.hypot(np.maximum(spots[:, 0] - half[0], 0), np.maximum(y_m - half[1], 0))
    fits: Bools = (np.maximum(*corners) <= farthest_m + 0.05) & (near >= nearest_m - 0.08)
    for rectangle in taken:
        fits &= ~rectangle.is_near(spots, half, room)
    return fits


FLIP = "flip_station"
# Place of the arm beside the product during a turn [m].
_STAND_M = 0.25
# Height within which the feet of a part lie that stands alone [m].
_LEVEL_FEET_M = 1e-4

# Meshes of a part: vertices [m] and triangles of each.
Meshes = tuple[tuple[Points, Triangles], ...]

# Margin on the force of jaws, and their least force [N].
_GRIP_MARGIN, _LEAST_GRIP_N = 2.0, 5.0
# Least force of finger tips [N]: parts of milligrams turn between jaws that press harder.
_LEAST_TIPS_N = 1.0
_LEAST_SAFE_M = 0.15
_ABOVE_PRODUCT_M = 0.05


def build_robot_entry(
    robot: str, parts: Sequence[Part], carried: Sequence[Part], upright: Upright
) -> dict[str, Any]:
    """Return the entry of an arm that travels above the product with its payload.

    Parameters
    ----------
    parts
        All parts of the task.
    carried
        The parts that the arm carries.
    """
    nearest_m = _HOMES_M.get(robot, _HOME_M)
    home_m = round(max(nearest_m, _HOME * ARMS[robot][0].works_within_m), 2)
    named = {"name": robot, "model": robot, "home_m": [home_m, 0.0]}
    return {**named, "safe_height_m": round(compute_safe_height_m(parts, carried, upright), 3)}


def compute_safe_height_m(
    parts: Sequence[Part], carried: Sequence[Part], upright: Upright
) -> float:
    """Return the height at which an arm travels above the product and the parts it carries [m]."""
    height = max(float(upright.vertices(part)[:, 2].max()) for part in parts)
    if upright.pivot_m is not None:
        height = upright.size_m[2]
    sizes_m = [upright.of(part.name).size(part) for part in carried]
    tallest = max((float(size_m[2]) for size_m in sizes_m), default=0.0)
    return max(_LEAST_SAFE_M, height + _ABOVE_PRODUCT_M, tallest + _ABOVE_PRODUCT_M)


_HOLDER_OF: Mapping[str, Place] = dict(
    zip(
        (
            *(GRIPPER, CUP, DRIVER, TIPS, SMALL_CUP, LARGE_CUP, WIDE_CUP, HEAVY_CUP, *SOCKETS),
            *GRIPPERS,
            *(f"{word}{name}" for word in EXTENSIONS[1:] for name in (DRIVER, *SOCKETS)),
            *(LONG_TIPS, NARROW_CUP, NEEDLE),
        ),
        (*HOLDERS, *FURTHER_HOLDERS),
        strict=True,
    )
)


def build_tool_entries(
    robot: str, entries: Sequence[Mapping[str, Any]], grips_n: Mapping[str, float]
) -> dict[str, Any]:
    """Return the tools that parts and screws use, with a grip force that bears the parts.

    Parameters
    ----------
    entries
        Entries of parts and screws.
    grips_n
        Force of the jaws of each tool for its parts, without margin; see `JawGrasp` [N].
    """
    hand = ARMS[robot][1]
    tools: dict[str, Any] = {}
    for name, place in _HOLDER_OF.items():
        holder = _place_holder(place, robot)
        if not any(entry.get("tool") == name for entry in entries):
            continue
        if name in GRIPPERS:
            force_n = _choose_grip_n(grips_n[name], equip_hand(hand, name)[0].force_n)
            tools[name] = {"model": name, "holder_m": list(holder), "force_n": force_n}
            continue
        drives = name.endswith((DRIVER, *SOCKETS))
        kind = "screwdriver" if drives else "suction" if name in CUPS_M else "gripper"
        tools[name] = {"type": kind, "holder_m": list(holder)}
        if kind == "gripper":
            tools[name]["opening_m"] = hand.opening_m
            least_n = _LEAST_TIPS_N if name in PROFILES_M else _LEAST_GRIP_N
            tools[name]["force_n"] = _choose_grip_n(grips_n[name], hand.force_n, least_n)
        if name in PROFILES_M:
            tools[name] |= build_tips(hand, name)
        if name in CUPS_M and name != CUP:
            tools[name]["cup_diameter_m"] = CUPS_M[name]
        if drives:
            driven = [entry for entry in entries if entry.get("tool") == name]
            tools[name] |= _build_driver(name, driven, hand)
    return tools


def _build_driver(name: str, driven: Sequence[Mapping[str, Any]], hand: Hand) -> dict[str, Any]:
    """Return the keys of a screwdriver or socket and its bit for the screws that it drives."""
    level = max(level for level, word in enumerate(EXTENSIONS) if name.startswith(word))
    if not name.endswith(DRIVER):
        flats_m = round(driven[0]["head_diameter_m"] * math.sqrt(3) / 2, 7)
        width_m, height_m = _SPINDLE_M
        body = {"size_m": [width_m, width_m, height_m]}
        entry = {"socket_m": flats_m, "bit_length_m": _SOCKETS_M[level], "body": body}
        # The rim of a socket stays above what a thin nut lies on.
        depth_m = _SOCKET_DEPTH * min(nut["head_height_m"] for nut in driven)
        if depth_m > flats_m / 3:
            return entry
        return {**entry, "socket_depth_m": max(_LEAST_DEPTH_M, round(depth_m, 6))}
    if level == 0:
        return {}
    length_m = hand.tip_on_flange.xyz_m[2] + _BITS_M[level] - _BITS_M[0]
    return {"length_m": round(length_m, 6), "bit_length_m": _BITS_M[level]}


def _choose_grip_n(needed_n: float, most_n: float, least_n: float = _LEAST_GRIP_N) -> float:
    """Return a force with a margin, in whole newtons, within limits."""
    return float(min(most_n, max(least_n, math.ceil(_GRIP_MARGIN * needed_n))))


_DECIMALS = 7
# Distance by which faces may move where a body touches itself [m]; of meshes that are too large, in
# tolerances.
_HEALED_M, _COARSEST = 1e-6, 2


def format_obj(vertices_m: Points, triangles: Triangles) -> str:
    """Return an OBJ file of a closed mesh.

    Parameters
    ----------
    vertices_m
        Merged vertices [m]; rounded to 0.1 micrometres.
    triangles
        Vertex indices, anticlockwise from outside.
    """
    corners = np.round(vertices_m, _DECIMALS) + 0.0
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in corners.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles.tolist()]
    return "\n".join(lines) + "\n"


def format_pieces(pieces: Iterable[tuple[Points, Triangles]]) -> str:
    """Return an OBJ file of several bodies, each an object with its own vertices.

    Parameters
    ----------
    pieces
        Vertices, already rounded to 0.1 micrometres, and triangles of each body.
    """
    lines, before = [], 1
    for number, (vertices_m, triangles) in enumerate(pieces, 1):
        lines.append(f"o piece_{number}")
        lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in (vertices_m + 0.0).tolist()]
        lines += [f"f {a + before} {b + before} {c + before}" for a, b, c in triangles.tolist()]
        before += len(vertices_m)
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """A layout of the table for the parts of a task.

    Parameters
    ----------
    tray
        Places of parts and feeders, by their task names.
    feeders
        Feeder of each part that has identical ones; keys are product names.
    without
        Product names of parts that do not fit within reach.
    holders
        Places of tools, which stay free.
    raised
        Feeders that present parts to a level hand.
    safe_height_m
        Greatest height of travels in the tasks with this layout [m].
    """

    upright: Upright
    tray: Tray
    feeders: Mapping[str, str]
    without: tuple[str, ...]
    holders: tuple[Place, ...]
    raised: frozenset[str]
    safe_height_m: float = 0.0


def lay_out_parts(
    parts: Sequence[Part],
    gripped: Sequence[Part],
    names: Mapping[str, str],
    taken: Collection[str],
    bearing: Bearing,
    robot: str,
    fixed: Collection[str] = (),
    tools: Collection[str] = (),
    presented: Collection[str] = (),
    before: Places | None = None,
) -> Places:
    """Place the product, single parts and feeders.

    What was tried stays where it was, as long as the product's foot is the same. Feeders keep their
    names, and parts their feeders.

    Parameters
    ----------
    parts
        All parts of the task.
    gripped
        The parts that stand on their own, without screws.
    names
        Task names by product names.
    taken
        Names that feeders must not use.
    bearing
        Orientations of the product.
    fixed
        Parts in place from the start.
    tools
        Names of tools whose holders stay free.
    presented
        Parts that a feeder presents above the table.
    before
        Layout of other parts, in the same orientation.
    """
    # Screws may hang below the table, but not below a workholder.
    standing = gripped if len(bearing.ups) == 1 else parts

    def place(place_m: Place) -> Upright:
        return place_turned(standing, bearing.ups, bearing.turned, place_m, bearing.heading)

    upright = place((0.0, 0.0))
    earlier = {} if before is None else before.feeders
    loose = [part for part in parts if part.name not in fixed]
    feeders = dict(_feeders(loose, names, taken, earlier))
    for part in gripped:
        own = upright.of(part.name)
        needs_feeder = part.name in presented or not stands_alone(part, own)
        if part.name not in {*fixed, *feeders} and needs_feeder:
            stem = f"{names[part.name]}_feeder"
            known = {*taken, *feeders.values(), *earlier.values()}
            feeders[part.name] = assign_task_names([stem], known)[stem]
    items: dict[str, Item] = {}
    for part in parts:
        name = feeders.get(part.name, names[part.name])
        if (part in gripped or part.name in feeders) and part.name not in fixed:
            x, y, z = (float(extent) for extent in upright.of(part.name).size(part))
            item = items.get(name, Item(name, (x, y, z)))
            items[name] = replace(item, is_raised=item.is_raised or part.name in presented)
    further = {_HOLDER_OF[tool] for tool in tools}.difference(HOLDERS)
    holders = tuple(_place_holder(place, robot) for place in (*HOLDERS, *sorted(further)))
    raised = frozenset(name for name, item in items.items() if item.is_raised)
    if before is not None and _still_stands(parts, gripped, upright, items, holders, before):
        tray = _keep_places(parts, [*items.values()], robot, holders, before)
        if not tray.without:
            kept = before.upright.keep_turned(upright.turned.keys())
            return replace(
                before, upright=kept, tray=tray, feeders=feeders, holders=holders, raised=raised
            )
    size_m = _measure_foot(parts, upright)[1]
    layout = lay_out_table(size_m, [*items.values()], robot, holders)
    without = tuple(
        part.name for part in parts if feeders.get(part.name, names[part.name]) in layout.without
    )
    return Places(place(layout.product_m), layout, feeders, without, holders, raised)


def _still_stands(
    parts: Sequence[Part],
    gripped: Sequence[Part],
    upright: Upright,
    items: Iterable[str],
    holders: Iterable[Place],
    before: Places,
) -> bool:
    """Return whether the product stands where the layout of other parts has it."""
    if upright.pivot_m is not None or before.upright.pivot_m is not None:
        known = before.tray.places.keys() >= {*items} and {*before.holders} >= {*holders}
        turns = (
            [other.poses.index(other.of(part.name)) for part in parts]
            for other in (upright, before.upright)
        )
        # A station whose last orientations are gone stays as high as it was.
        turns_still = 1 < len(upright.poses) <= len(before.upright.poses)
        return known and turns_still and next(turns) == next(turns)
    lowest_m = min(float(before.upright.vertices(part)[:, 2].min()) for part in gripped)
    return abs(lowest_m) < _LEVEL_FEET_M


def _keep_places(
    parts: Sequence[Part],
    items: Sequence[Item],
    robot: str,
    holders: Sequence[Place],
    before: Places,
) -> Tray:
    """Lay out the table with all items where they stood, unless they are in the way now."""
    foot_m, size_m = _measure_foot(parts, before.upright)
    taken = [_Taken(foot_m, (size_m[0] / 2, size_m[1] / 2), _BESIDE_PRODUCT_M)]
    taken += [_reserve_holder(place) for place in holders]
    kept = {}
    for item in items:
        place = before.tray.places.get(item.name)
        if place is None or (item.is_raised and item.name not in before.raised):
            continue
        spot = np.array([place])
        if not any(other.is_near(spot, item.half_m, item.room_m)[0] for other in taken):
            kept[item.name] = place
    return lay_out_table(size_m, items, robot, holders, kept, foot_m)


def _measure_foot(
    parts: Sequence[Part], upright: Upright
) -> tuple[Place, tuple[float, float, float]]:
    """Return the centre, x y, and the extents of the product in all its orientations [m]."""
    if upright.pivot_m is not None:
        return (upright.pivot_m[0], upright.pivot_m[1]), upright.size_m
    corners = np.concatenate([upright.vertices(part) for part in parts])
    low, high = corners.min(axis=0), corners.max(axis=0)
    x_m, y_m = ((low + high) / 2).tolist()[:2]
    x, y, z = (float(extent) for extent in high - low)
    return (x_m, y_m), (x, y, z)


def stands_alone(part: Part, upright: Upright) -> bool:
    """Return whether a part stands on the table by itself, with the margin of the core.

    Corners of a round face on its side are no feet, except on a level plane: such a part rolls.
    """
    corners = upright.vertices(part)
    centre = np.asarray(upright.point(part.centre_m))
    height_m = float(centre[2] - corners[:, 2].min())
    is_low = corners[:, 2] < corners[:, 2].min() + _LEVEL_FEET_M
    rolls, stands = np.zeros_like(is_low), np.zeros_like(is_low)
    for face in part.faces:
        is_upright = abs(upright.vector(face.axis)[2]) > 1 - _LEVEL
        if face.kind in ROUND_KINDS and (face.kind == "sphere" or not is_upright):
            rolls[part.triangles[face.triangles]] = True
        elif face.kind == "plane" and is_upright:
            stands[part.triangles[face.triangles]] = True
    feet = corners[is_low & (stands | ~rolls)]
    extent_m = float(np.ptp(corners, axis=0).max())
    return is_over(centre[:2], feet[:, :2], compute_margin_m(extent_m, height_m))


def _feeders(
    parts: Sequence[Part],
    names: Mapping[str, str],
    taken: Collection[str],
    before: Mapping[str, str],
) -> Mapping[str, str]:
    """Return the feeder name of each part that has identical ones, or had them before."""
    feeder_of: dict[str, str] = {}
    by_shape: dict[int, list[Part]] = {}
    for part in parts:
        by_shape.setdefault(part.shape, []).append(part)
    known = {*taken, *before.values()}
    for alike in by_shape.values():
        earlier = [before[part.name] for part in alike if part.name in before]
        if earlier:
            feeder_of |= {part.name: earlier[0] for part in alike}
        elif len(alike) > 1:
            stem = f"{names[alike[0].name]}_feeder"
            name = assign_task_names([stem], known)[stem]
            known.add(name)
            feeder_of |= {part.name: name for part in alike}
    return feeder_of


# Largest cosine of a level direction.
_LEVEL = 1e-6


def find_indirect_parts(plan: AssemblyPlan) -> dict[str, LeftOut]:
    """Return the parts that no straight single-part move brings, each with a reason."""
    reasons: dict[str, LeftOut] = {}
    for step in plan.steps:
        for part in step.parts:
            if len(step.parts) > 1:
                others = tuple(name for name in step.parts if name != part)
                words = f"comes as a sub-assembly with {', '.join(others)}"
                reasons[part] = LeftOut(part, "sub-assembly", words, others)
            elif step.path:
                words = f"comes by {len(step.path)} moves, not by a straight one"
                reasons[part] = LeftOut(part, "several moves", words)
    return reasons


def list_plan_limits(
    product: Product, plan: AssemblyPlan, up: Vector, placed: Collection[str]
) -> Iterator[tuple[str, str]]:
    """Yield part names with the limits that the plan puts on them.

    Parameters
    ----------
    up
        Vector that points up in the task, in the product's frame.
    placed
        Names of the parts in the task, which stay there, and for which the product is never turned.
    """
    for step in plan.steps:
        for part in step.parts:
            if step.up != up and part not in placed:
                yield part, "comes after a turn in the plan of the product in CAD"
    for name in [member.name for member in product if member.name not in placed]:
        numbers = [number for number, step in enumerate(plan.steps) if name in step.held]
        if numbers:
            first, after = plan.steps[numbers[0]], plan.steps[numbers[-1] + 1 :]
            since = "it" if name in first.parts else " with ".join(first.parts)
            until = f"until {' with '.join(after[0].parts)} is" if after else "to the end"
            yield name, f"must be held once {since} is placed, {until}"


_FLAT = 0.999
# Share of a head's radius at its rim.
_RIM = 0.97


def build_screw_entry(
    part: Part, fastener: Fastener, relation: Relation, upright: Upright, through: Part
) -> tuple[dict[str, Any], float]:
    """Return hole, head, mass and, unless it points straight down, axis of a screw.

    Returns
    -------
    entry
        The entry, of the screw driven home.
    hover_m
        Height of the head over the part beneath it as drawn [m]; 0 if it rests on it.
    """
    axis = np.asarray(fastener.axis)
    along = part.vertices_m @ axis
    radii_m, point = fastener.list_radii_m(part.vertices_m), np.asarray(fastener.point_m)
    radius, hover_m = float(radii_m.max()), 0.0
    seat = _find_touched_seat(part, fastener, relation)
    if seat is None:
        ring_m = (fastener.diameter_m / 2 + radius) / 2
        low = float(along[radii_m > ring_m].min())
        hover_m = _measure_hover_m(through, point + (low - point @ axis) * axis, axis, ring_m)
        seat = low - hover_m if hover_m else _find_rim(part, fastener)
    mouth = point + (seat - float(point @ axis)) * axis
    into = upright.vector((-float(axis[0]), -float(axis[1]), -float(axis[2])))
    entry: dict[str, Any] = {
        "hole_m": list(upright.point((float(mouth[0]), float(mouth[1]), float(mouth[2])))),
        "head_diameter_m": round(2 * radius, 6),
        "head_height_m": round(float(along.max()) - seat - hover_m, 6),
        "mass_kg": float(f"{max(part.mass_kg, 1e-6):.4g}"),
    }
    if into != DOWN:
        entry["axis"] = list(into)
    return entry, hover_m


# Rays around a head, unevenness of a seat [m], and fewest points of a contact on a seat.
_RING_RAYS, _UNEVEN_M, _SEAT_POINTS = 16, 1e-5, 3
# Rays around an axis to the walls of a counterbore, and heights at which they begin, as shares of
# that of the head.
_WALL_RAYS, _HEAD_HEIGHTS = 64, (0.25, 0.5, 0.75)


def _measure_hover_m(through: Part, mouth: Floats, axis: Floats, radius_m: float) -> float:
    """Return the height of a head over a flat seat [m]; 0 if it touches it or is too high."""
    angles = np.linspace(0, 2 * np.pi, _RING_RAYS, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles)]) @ find_axes_across(
        tuple(axis.tolist())
    )
    # Rays begin above the head, as it may be sunk in its seat.
    origins_mm = (radius_m * around + MOST_HOVER_M * axis) * 1000
    mesh = RayMesh(through, mouth)
    hit, beneath_mm = mesh.trace(origins_mm, np.tile(-axis, (_RING_RAYS, 1)))
    hovers_m = beneath_mm / 1000 - MOST_HOVER_M
    is_flat = (hit >= 0).all() and (mesh.normals[hit] @ axis > _FLAT).all()
    if not is_flat or np.ptp(hovers_m) > _UNEVEN_M:
        return 0.0
    hover_m = float(hovers_m.min())
    return hover_m if 0.0 < hover_m <= MOST_HOVER_M + _UNEVEN_M else 0.0


def _measure_wall_m(
    other: Part, mouth: Floats, axis: Floats, height_m: float, radius_m: float
) -> float:
    """Return the least radius of the walls around a head and its way out [m]; inf if none is near.

    Parameters
    ----------
    mouth
        Middle of the seat in the product's frame [m].
    """
    frame = find_axes_across(tuple(axis.tolist()))
    places, reach_m = (other.vertices_m - mouth) @ frame.T, radius_m + PLAY_M
    end_m = float(((other.vertices_m - mouth) @ axis).max())
    is_beside = (places.min(axis=0) > reach_m) | (places.max(axis=0) < -reach_m)
    if end_m <= _HEAD_HEIGHTS[0] * height_m or is_beside.any():
        return math.inf
    heights_m = [share * height_m for share in _HEAD_HEIGHTS]
    heights_m += np.linspace(height_m, end_m, _RING_RAYS)[:-1].tolist()
    angles = np.linspace(0, 2 * np.pi, _WALL_RAYS, endpoint=False)
    across = np.column_stack([np.cos(angles), np.sin(angles)]) @ frame
    origins = np.repeat(np.outer(heights_m, axis), _WALL_RAYS, axis=0) * 1000
    _, radii_mm = RayMesh(other, mouth).trace(origins, np.tile(across, (len(heights_m), 1)))
    return float(radii_mm.min()) / 1000


@dataclass(frozen=True, slots=True)
class Socketed:
    """A nut that a socket drives onto a bolt or rod that is held.

    Parameters
    ----------
    bolt
        The bolt or rod.
    thread_m
        Diameter of the thread, as drawn [m].
    flats_m
        Width across its flats, as drawn, or that of a hexagon around a nut of another shape [m].
    is_hexagon
        False if it has another shape, for which its socket is made.
    """

    bolt: str
    thread_m: float
    flats_m: float
    is_hexagon: bool

    @property
    def thread_entry(self) -> dict[str, Any]:
        """Its size, such as M8, or the diameter of its thread if it is near none."""
        size = min(_SIZES, key=lambda size: abs(float(size[1:]) / 1e3 - self.thread_m))
        known_m = float(size[1:]) / 1e3
        is_near = abs(known_m - self.thread_m) <= _NEAR_SIZE * known_m
        return {"size": size} if is_near else {"thread_m": round(self.thread_m, 6)}


def find_socketed(product: Product, relation: Relation, name: str) -> Socketed | None:
    """Return a driven nut on a bolt or rod that is held; None for other fasteners."""
    nut = relation.fastener(name) if name in relation.driven else None
    for mate in nut.threaded_in if nut is not None and nut.kind == "nut" else ():
        bolt = relation.fastener(mate)
        if bolt is None or bolt.held:
            assert nut is not None
            # The bore of a nut is drawn without its thread, which counts on a rod.
            thread_m = nut.diameter_m if bolt is None else bolt.diameter_m
            part = product.part(name)
            flats_m = _measure_flats_m(part, nut.axis)
            around_m = math.sqrt(3) * float(nut.list_radii_m(part.vertices_m).max())
            if abs(around_m / flats_m - 1) <= _HEXAGON - 1:
                return Socketed(mate, thread_m, flats_m, is_hexagon=True)
            width_m = round(max(around_m, flats_m), _WIDTH_DECIMALS)
            return Socketed(mate, thread_m, width_m, is_hexagon=False)
    return None


def _measure_flats_m(part: Part, axis: Vector) -> float:
    """Return the least width of a part across an axis [m]."""
    flat = part.vertices_m @ find_axes_across(axis).T
    hull = flat[ConvexHull(flat).vertices]
    edges = np.roll(hull, -1, axis=0) - hull
    across = np.stack([-edges[:, 1], edges[:, 0]], axis=1)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return round(float(np.ptp(hull @ across.T, axis=0).min()), _WIDTH_DECIMALS)


def list_undriven(
    product: Product, relation: Relation, names: Collection[str]
) -> dict[str, LeftOut]:
    """Return the nuts without a socket and the screws without a head, each with the reason."""
    socketed = {
        name: nut
        for name in sorted(names, key=relation.index)
        if (nut := find_socketed(product, relation, name)) is not None
    }
    widths = Counter(nut.flats_m for nut in socketed.values())
    usual = {width for width, _ in widths.most_common(len(SOCKETS))}
    reasons = {}
    for name, nut in socketed.items():
        if nut.flats_m not in usual:
            words = (
                f"needs a socket of {nut.flats_m * 1e3:.3g} mm, and a task has {len(SOCKETS)}: "
                f"{' and '.join(f'{width * 1e3:.3g}' for width in sorted(usual))} mm"
            )
            reasons[name] = LeftOut(name, "no grasp", words)
    for name in sorted(names, key=relation.index):
        screw = relation.fastener(name)
        vertices_m = product.part(name).vertices_m
        if screw is not None and screw.is_headless(vertices_m):
            reasons[name] = LeftOut(
                name,
                "no head",
                "has no head that bears on a part, which all screws of a task have",
            )
    return reasons


def _find_touched_seat(part: Part, fastener: Fastener, relation: Relation) -> float | None:
    """Return the position of a fastener's head contact along its axis [m], None without one.

    A nut consists of head only.
    """
    axis = np.asarray(fastener.axis)
    lowest = float((part.vertices_m @ axis).min())
    if fastener.kind == "nut":
        return lowest
    for contact in relation.contacts:
        if {part.name, fastener.joins[0]} != set(contact.parts) or not contact.points_m:
            continue
        if any(abs(float(np.dot(normal, axis))) > _FLAT for normal in contact.normals):
            # The points of the shank in its hole, and of a head in its recess, belong to the same
            # contact; points of the seat share a height.
            touched = np.asarray(contact.points_m) @ axis
            level = np.abs(touched[:, None] - touched) < _UNEVEN_M
            seat = touched[level.sum(axis=1) >= _SEAT_POINTS]
            touched = seat if len(seat) else touched
            return float(touched[np.abs(touched - lowest - fastener.length_m).argmin()])
    return None


def _find_rim(part: Part, fastener: Fastener) -> float:
    """Return the position of the rim of a countersunk head along its axis [m]."""
    along = part.vertices_m @ np.asarray(fastener.axis)
    radii = fastener.list_radii_m(part.vertices_m)
    rim = float(along[radii > _RIM * radii.max()].min())
    beneath_head = float(along.min()) + fastener.length_m
    return max(beneath_head, min(rim, float(along.max()) - LEAST_HEAD_M))


_MOST_DIRECTIONS = 3
# Stretch of a screw that a task does not give, and the longest that is written [m]; greatest sine
# of the slope of a screw that counts as level.
_DEFAULT_STRETCH_M, _LONGEST_STRETCH_M, _STEEP = 0.05, 0.25, 0.5
# Default length and clearance of level insertions, and overlap that counts as touching, as in the
# task's own measure of neighbours [m].
_LEAST_STROKE_M, _CLEAR_STROKE_M, _TOUCH_M = 0.01, 0.005, 2e-4
_BELOW_SHANK_M = 0.01
_COMMENT_WIDTH = 98
_PRESENTED = "comes from a feeder that presents it, as it does not stand on the table by itself"
_RAISED = "comes from a feeder that presents it to a hand from its side,"
_CARRIED = (
    "is carried by a workholder without a body: its room and that for its supports are not checked"
)
_HELD = "is held where it is put by a support of its own, the shape of which is not in the task"

_HEADER = """\
# yaml-language-server: $schema=assembly.schema.json
# Written by skillplan import-cad from CAD. Meshes are in metres, in the frame of each part.
# skillplan check FILE, chart FILE and search-optimal FILE --collision swept go on from here.
"""


def measure_travel_m(relation: Relation, part: Part, way: Vector) -> float:
    """Return how far a part slides along others when it goes in; 0 if it touches none."""
    along = np.asarray(way)
    touched = [
        float((np.asarray(contact.points_m) @ along).min())
        for contact in relation.contacts
        if part.name in contact.parts and contact.points_m
    ]
    return float((part.vertices_m @ along).max()) - min(touched) if touched else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class TaskNest:
    """A nest of the task, in which its first parts stand.

    Parameters
    ----------
    name
        Name of the fixture.
    reason
        Why the base needs it, as a clause that follows the base's name.
    seated
        Product names of the parts that stand on its floor, the base first.
    origin_m
        Centre of its bottom in the product's frame turned upright.
    files
        Meshes by path within the folder.
    entry
        Its entry of `skillplan.nest/1`.
    """

    name: str
    reason: str
    seated: tuple[str, ...]
    origin_m: tuple[float, float, float]
    files: Mapping[str, str | bytes]
    entry: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class WrittenTask:
    """A task before it is written to disk.

    Parameters
    ----------
    document
        Content of the YAML file; empty if no part remains.
    files
        Contents of all files by their path within the folder.
    names
        Task name of each part in the task.
    limits
        Limits of one arm for each part, by product name.
    left_out
        Parts outside the task, each with a reason.
    faults
        Reasons why `check` refuses the task that leaving parts out does not fix.
    skills
        Skills that bring all parts in an order that was found; empty if none was.
    doubt
        Reason why no order was found, or why it is not sure; empty without one.
    pieces
        Convex pieces by product name, with the pairs that they block wrongly.
    bearing
        Supports of the parts in the task's orientation.
    nest
        Nest of the base; None if it stands on the table.
    why_no_nest
        Why a base that needs a nest has none, as a clause; empty otherwise.
    station_nests
        Nests of the stations at which sub-assemblies are built.
    """

    document: Mapping[str, Any]
    files: Mapping[str, str]
    names: Mapping[str, str]
    limits: Mapping[str, tuple[str, ...]]
    left_out: Mapping[str, LeftOut]
    faults: tuple[str, ...]
    upright: Upright
    pieces: ProvedPieces
    bearing: Bearing
    skills: tuple[str, ...] = ()
    doubt: str = ""
    nest: TaskNest | None = None
    why_no_nest: str = ""
    station_nests: tuple[TaskNest, ...] = ()

    def explain(self, left_out: Mapping[str, LeftOut]) -> WrittenTask:
        """Return the task with other reasons of the parts outside it."""
        text = format_task(self.document, left_out, self.limits)
        return replace(self, left_out=left_out, files={**self.files, "product.yaml": text})

    @property
    def in_place(self) -> tuple[str, ...]:
        """Parts that are in place from the start, as the arm does not bring them."""
        parts = self.document.get("parts", {})
        return tuple(name for name, own in self.names.items() if parts.get(own, {}).get("fixed"))


@dataclass
class SharedMeshes:
    """Meshes of the parts in one orientation and their files, which rewritten tasks share.

    Parameters
    ----------
    of_part
        Meshes by name of the part.
    errors_m
        Distances by which simplified meshes are off, by name [m].
    """

    of_part: dict[str, Meshes] = field(default_factory=dict)
    errors_m: dict[str, float] = field(default_factory=dict)
    _texts: dict[str, tuple[object, str]] = field(default_factory=dict)

    def format(self, path: str, content: object, make: Callable[[], str]) -> str:
        """Return the text of a file; the same content is formatted once."""
        known = self._texts.get(path)
        if known is None or known[0] is not content:
            known = self._texts[path] = (content, make())
        return known[1]


@dataclass
class TaskWriter:
    """Writes the task of some parts of a product."""

    product: Product
    relation: Relation
    plan: AssemblyPlan
    bearing: Bearing
    robot: str
    left_out: Mapping[str, LeftOut]
    remarks: Mapping[str, Sequence[str]]
    holds: PartHolds
    shared: SharedMeshes
    before: Places | None = None
    names: Mapping[str, str] = field(init=False)
    kept: tuple[Part, ...] = field(init=False)
    limits: dict[str, list[str]] = field(init=False, default_factory=dict)
    steps: dict[str, Step] = field(init=False)
    gripped: list[Part] = field(init=False)
    drivers: Mapping[str, str] = field(init=False)
    raised_m: Mapping[str, float] = field(init=False)
    places: Places = field(init=False)
    upright: Upright = field(init=False)
    nest: TaskNest | None = field(init=False, default=None)
    orientations: Mapping[Upright, str] = field(init=False)

    def __post_init__(self) -> None:
        taken = {*_HOLDER_OF, self.robot, "world", "home", FLIP}
        names = assign_task_names((part.name for part in self.product), taken)
        self.names = {name: own for name, own in names.items() if name not in self.left_out}
        self.kept = tuple(part for part in self.product if part.name in self.names)
        # A part of a sub-assembly has its own step before that of the sub-assembly.
        self.steps = {}
        for step in self.plan.steps:
            for part in step.parts:
                self.steps.setdefault(part, step)
        self.gripped = [part for part in self.kept if not self._get_driven(part)]
        known, fixed = taken | set(self.names.values()), self.holds.fixed
        tools = {self.holds.held(p.name).tool for p in self.gripped if p.name not in fixed}
        self.drivers = self._choose_drivers()
        tools |= {*self.drivers.values()}
        self.raised_m = {
            part.name: self.holds.held(part.name).raised_m
            for part in self.gripped
            if part.name not in fixed and self.holds.held(part.name).raised_m
        }
        self.places = lay_out_parts(
            self.kept,
            self.gripped,
            self.names,
            known,
            self.bearing,
            self.robot,
            fixed,
            tools,
            self.raised_m,
            self.before,
        )
        self.upright = self.places.upright
        self.orientations = name_orientations(self.upright)

    def name_nest(self) -> str:
        """Return the name of the nest as a fixture."""
        taken = {*_HOLDER_OF, self.robot, "world", "home", *self.names.values()}
        return find_free_name("nest", taken | set(self.places.feeders.values()))

    def seat(self, nest: TaskNest) -> None:
        """Put the product into a nest, which stands on the table."""
        self.nest = nest
        x, y, _ = (float(value) for value in self.upright.offset_m)
        self.upright = replace(self.upright, offset_m=np.array([x, y, -nest.origin_m[2]]))

    def lift(self, raise_m: float) -> None:
        """Hold the product higher above the table [m]."""
        x, y, z = (float(value) for value in self.upright.offset_m)
        self.upright = replace(self.upright, offset_m=np.array([x, y, z + raise_m]))

    def write(self, proof: PieceProof) -> WrittenTask:
        """Return the written task; its pieces lack parts that a request to stop came before."""
        files: dict[str, str] = {}
        parts = {self.names[part.name]: self._build_part(part, files) for part in self.gripped}
        screws = {
            self.names[part.name]: self._build_screw(part, fastener)
            for part in self.kept
            if (fastener := self._get_driven(part)) is not None
        }
        meshes = self.shared.of_part
        proved = proof.prove(
            {part.name: meshes[part.name] for part in self.gripped},
            self._list_jaw_spaces,
            self.bearing.order,
        )
        self._add_pieces(proved, parts, files)
        up, names = self.bearing.up, self.names
        for name, words in list_plan_limits(self.product, self.plan, up, names):
            self._note(name, words)
        for name in self._list_held():
            self._note(name, _HELD)
        if self.upright.pivot_m is not None:
            self._note(next(name for name in self.bearing.order if name in self.names), _CARRIED)
        alike = Counter(self.places.feeders.values())
        for name, feeder in self.places.feeders.items():
            if name in self.raised_m:
                self._note(name, f"{_RAISED} {self.raised_m[name]:g} m above the table")
            elif alike[feeder] == 1 and not stands_alone(
                self.product.part(name), self.upright.of(name)
            ):
                self._note(name, _PRESENTED)
        for name in self.names:
            for words in self.remarks.get(name, ()):
                self._note(name, words)
            if name in self.holds.fixed:
                self._note(name, self.holds.fixed[name])
        if self.nest is not None:
            files |= {path: text for path, text in self.nest.files.items() if isinstance(text, str)}
        document = self._build_document(parts, screws)
        limits = {name: tuple(lines) for name, lines in self.limits.items()}
        files["product.yaml"] = format_task(document, self.left_out, limits)
        return WrittenTask(
            document,
            files,
            self.names,
            limits,
            self.left_out,
            (),
            self.upright,
            proved,
            replace(self.bearing, held=tuple(self._list_held())),
            nest=self.nest,
        )

    def _list_jaw_spaces(self) -> dict[str, JawSpaces]:
        """Return the spaces that jaws take at each part, for itself and for later parts.

        Those of a tool that is tried later are not known yet.
        """
        order = {name: number for number, name in enumerate(self.bearing.order)}
        own: dict[str, list[Points]] = {}
        pressed: dict[str, list[Points]] = {}
        bottoms: dict[str, Floats] = {}
        for part in self.gripped:
            upright = self.upright.of(part.name)
            bottoms[part.name] = np.array(upright.bottom(part))
            if part.name not in self.holds.fixed:
                held, top_m = self.holds.held(part.name), float(upright.size(part)[2])
                hand = ARMS[self.robot][1]
                own[part.name] = held.list_jaw_spaces(hand, top_m)
                pressed[part.name] = held.list_jaw_spaces(hand, top_m, is_pressed=True)
        spaces: dict[str, JawSpaces] = {}
        for name, bottom in bottoms.items():
            open_jaws = list(own.get(name, ()))
            for other, boxes in own.items():
                is_later = order.get(other, -1) > order.get(name, -1)
                if is_later and self.upright.of(other) is self.upright.of(name):
                    open_jaws += [box + (bottoms[other] - bottom) for box in boxes]
            spaces[name] = open_jaws, pressed.get(name, ())
        return spaces

    def _add_pieces(
        self, proved: ProvedPieces, parts: Mapping[str, Any], files: dict[str, str]
    ) -> None:
        """Add files of convex pieces, and name them in the entries of the meshes."""
        for part_name, per_mesh in proved.pieces.items():
            for mesh, pieces in zip(parts[self.names[part_name]]["meshes"], per_mesh, strict=True):
                if pieces:
                    mesh["pieces"] = mesh["file"].removesuffix(".obj") + ".pieces.obj"
                    files[mesh["pieces"]] = self.shared.format(
                        mesh["pieces"], pieces, partial(format_pieces, pieces)
                    )
        for part_name, fits in proved.fits.items():
            entry = {
                self.names[fit.into]: {
                    "drawn_m": fit.drawn_m,
                    "play_m": fit.play_m,
                    "outside_m": round(fit.outside_m, 7),
                }
                for fit in fits
                if fit.into in self.names
            }
            if entry and part_name in self.names:
                parts[self.names[part_name]]["fits"] = entry

    def _build_document(
        self, parts: Mapping[str, dict[str, Any]], screws: Mapping[str, dict[str, Any]]
    ) -> dict[str, Any]:
        held = [
            self.holds.held(part.name) for part in self.gripped if part.name not in self.holds.fixed
        ]
        grips_n: dict[str, float] = {}
        for hold in held:
            grips_n[hold.tool] = max(hold.grip_n, grips_n.get(hold.tool, 0.0))
        document: dict[str, Any] = {
            "kind": "assembly",
            "name": self._choose_name(),
            "description": f"{self._count_parts()} of {self.product.name}, from CAD.",
            "product_parts": len(self.product),
            "robot": self._build_robot(),
            "tools": build_tool_entries(self.robot, (*parts.values(), *screws.values()), grips_n),
            "initial_tool": GRIPPER,
            "tool_change": {"style": "swap"},
            "feeders": self._feeders(),
            "fixtures": self._build_fixtures(),
            "parts": parts,
            "screws": screws,
            "workholders": self._build_workholders(),
            "holders": self._build_holders(),
            "collision": {"swept": None},
        }
        document = {key: value for key, value in document.items() if value not in ({}, None)}
        if GRIPPER not in document["tools"]:
            document["initial_tool"] = next(iter(document["tools"]))
        return document

    def _build_robot(self) -> dict[str, Any]:
        """Return the entry of the arm; as long as a layout stands, its travels stay as high."""
        carried = [part for part in self.gripped if part.name not in self.holds.fixed]
        entry = build_robot_entry(self.robot, self.kept, carried, self.upright)
        height_m = max(entry["safe_height_m"], self.places.safe_height_m)
        self.places = replace(self.places, safe_height_m=height_m)
        return {**entry, "safe_height_m": height_m}

    def _list_held(self) -> list[str]:
        """Return the parts that do not stay by themselves, and then the base before them.

        Pushes would shift a loose base away from the supports.
        """
        fixed, base = self.holds.fixed, self.holds.base
        held = [name for name in self.bearing.held if name in self.names]
        if held and base not in held and base in self.names:
            held = [base, *held]
        kept = {*fixed, *(self.nest.seated if self.nest is not None else ())}
        return [name for name in held if name not in kept]

    def _build_fixtures(self) -> dict[str, Any]:
        """Return the nest as a fixture."""
        if self.nest is None:
            return {}
        files = self.nest.entry["files"]
        place = np.asarray(self.nest.origin_m) + self.upright.offset_m
        at_m = [round(float(value), 7) + 0.0 for value in place[:2]]
        meshes = [{"file": files["obj"], "pieces": files["pieces_obj"]}]
        return {self.nest.name: {"meshes": meshes, "at_m": at_m}}

    def _build_workholders(self) -> dict[str, Any]:
        """Return the station that turns the product, if it turns."""
        pivot_m, (first, *others) = self.upright.pivot_m, self.orientations.items()
        if pivot_m is None:
            return {}
        turns = {
            name: {"rpy_rad": list_angles_rad(self.upright.find_turn(pose))}
            for pose, name in others
        }
        home_m = build_robot_entry(self.robot, self.kept, (), self.upright)["home_m"][0]
        return {
            FLIP: {
                "pivot_m": list(pivot_m),
                "orientations": {first[1]: {}, **turns},
                "in_order": True,
                "stand_m": [home_m, -_STAND_M],
            }
        }

    def _build_holders(self) -> dict[str, Any]:
        """Return a support for each part that is held."""
        held = [self.names[name] for name in self._list_held()]
        taken = {*self.names.values(), *_HOLDER_OF, *self.places.feeders.values()}
        supports = assign_task_names((f"hold_{name}" for name in held), taken)
        return {
            supports[f"hold_{name}"]: {"kind": "hold", "parts": [name], "stays": True}
            for name in held
        }

    def _count_parts(self) -> str:
        count, all_of_them = len(self.kept), len(self.product)
        return f"{count} parts" if count == all_of_them else f"{count} of {all_of_them} parts"

    def _choose_name(self) -> str:
        return next(iter(assign_task_names([self.product.name or "product"]).values()))

    def _get_driven(self, part: Part) -> Fastener | None:
        """Return the fastener that a part is, if a screwdriver drives it."""
        return self.relation.fastener(part.name) if part.name in self.relation.driven else None

    def _feeders(self) -> dict[str, Any]:
        """Return the feeders of identical parts; the shanks of screws hang in their feeder."""
        groups, layout = self.places.feeders, self.places.tray
        entries: dict[str, Any] = {}
        for part in self.kept:
            name = groups.get(part.name)
            if name is not None and name in layout.places:
                entries.setdefault(name, {"position_m": list(layout.places[name])})
                raised_m = self.raised_m.get(part.name, 0.0)
                if raised_m:
                    entries[name]["height_m"] = raised_m
                fastener = self._get_driven(part)
                if fastener is not None:
                    height_m = fastener.length_m + _BELOW_SHANK_M
                    entries[name]["height_m"] = math.ceil(height_m * 1e3) / 1e3
        return entries

    def _build_part(self, part: Part, files: dict[str, str]) -> dict[str, Any]:
        """Return the entry of a part, and add its meshes to the files."""
        name, own = self.names[part.name], self.upright.of(part.name)
        bottom = np.array(own.bottom(part))
        meshes = self.shared.of_part.get(part.name)
        if meshes is None:
            meshes = self._prepare_meshes(part, own.vertices(part) - bottom)
            self.shared.of_part[part.name] = meshes
        count = sum(len(triangles) for _, triangles in meshes)
        if count < len(part.triangles):
            words = "is written with {:,} of its {:,} triangles, at most {:g} mm off"
            numbers = count, len(part.triangles), self.shared.errors_m[part.name] * 1e3
            self._note(part.name, words.format(*numbers))
        fixed = part.name in self.holds.fixed
        entry: dict[str, Any] = {"fixed": True} if fixed else self.holds.held(part.name).entry
        entry["mass_kg"] = float(f"{max(part.mass_kg, 1e-6):.4g}")
        entry["meshes"] = self._add_meshes(name, meshes, files)
        feeder = self.places.feeders.get(part.name)
        if feeder is not None:
            entry["feeder"] = feeder
        elif not fixed:
            entry["start_m"] = list(self.places.tray.places[name])
        entry["goal_m"] = [float(value) for value in bottom]
        if own is not self.upright:
            x, y, z = own.unpoint(bottom).tolist()
            entry["goal_m"] = list(self.upright.point((x, y, z)))
            entry["goal_rpy_rad"] = list_angles_rad(self.upright.find_turn(own).T)
        on = [
            self.names[bearer]
            for bearer in self.bearing.on.get(part.name, ())
            if bearer in self.names
        ]
        if self.nest is not None and part.name in self.nest.seated:
            on.insert(0, self.nest.name)
        if on:
            entry["goal_on"] = on
        entry |= self._name_orientation(part)
        ways = self.list_directions(part)
        if not any(way[2] < _LEVEL - 1 for way in ways):
            entry.pop("release_m", None)
        back = self.upright.find_turn(own).T
        along = [[float(value) + 0.0 for value in np.round(back @ way, 7)] for way in ways]
        if along != [[0.0, 0.0, -1.0]] and not fixed:
            entry["insert_along"] = along
            stroke_m = self._find_stroke_m(part, ways)
            if stroke_m is not None:
                entry["insert_m"] = stroke_m
        return entry

    def _find_stroke_m(self, part: Part, ways: Sequence[Sequence[float]]) -> float | None:
        """Return the length of level insertions that begin clear of earlier parts above [m].

        None if the default does: it clears the neighbours, but the part comes down from above.
        """
        if any(abs(way[2]) > _LEVEL for way in ways) or part.name not in self.bearing.order:
            return None
        before = self.bearing.order[: self.bearing.order.index(part.name)]
        upright = self.upright.of(part.name)
        own = upright.vertices(part)
        above_m, beside_m = 0.0, _LEAST_STROKE_M
        for other in self.gripped:
            there = upright.vertices(other)
            if other.name == part.name or there[:, 2].max() < own[:, 2].min() + _TOUCH_M:
                continue
            is_beside = there[:, 2].min() < own[:, 2].max() - _TOUCH_M
            if not is_beside and other.name not in before:
                continue
            for way in ways:
                frame = np.array([way, np.cross(way, DOWN)])
                mine, theirs = own @ frame.T, there @ frame.T
                overlaps = np.minimum(mine.max(axis=0), theirs.max(axis=0)) - np.maximum(
                    mine.min(axis=0), theirs.min(axis=0)
                )
                if (overlaps > _TOUCH_M).all():
                    length_m = float(mine[:, 0].max() - theirs[:, 0].min()) + _CLEAR_STROKE_M
                    if is_beside:
                        beside_m = max(beside_m, length_m)
                    else:
                        above_m = max(above_m, length_m)
        return round(above_m, 4) if above_m > beside_m else None

    def _prepare_meshes(self, part: Part, vertices_m: Points) -> Meshes:
        """Return meshes that a task accepts: each edge between two faces, and not too large.

        One mesh, unless bodies that pass through each other cannot be united.
        """
        mesh = vertices_m, part.triangles
        if has_proper_edges(*mesh) and len(vertices_m) <= MAX_CORNERS:
            return (mesh,)
        rounded = np.round(vertices_m, _DECIMALS)
        tolerance_m = self.relation.tolerance_m
        error_m = tolerance_m / 2 if len(vertices_m) > MAX_CORNERS else _HEALED_M
        healed = simplify_mesh(rounded, part.triangles, error_m)
        while len(healed[0]) > MAX_CORNERS and error_m < _COARSEST * tolerance_m:
            error_m *= 2
            healed = simplify_mesh(rounded, part.triangles, error_m)
        self.shared.errors_m[part.name] = error_m
        if has_proper_edges(*healed):
            return (healed,)
        bodies = split_bodies(rounded, part.triangles)
        if bodies and all(has_proper_edges(*body) for body in bodies):
            return tuple(bodies)
        parted = part_touching_corners(*healed, _HEALED_M), healed[1]
        return (parted if has_proper_edges(*parted) else mesh,)

    def _add_meshes(self, name: str, meshes: Meshes, files: dict[str, str]) -> list[dict[str, Any]]:
        """Add the meshes of a part to the files, and return their entries."""
        entries = []
        for number, mesh in enumerate(meshes, 1):
            path = f"meshes/{name}{f'_{number}' if len(meshes) > 1 else ''}.obj"
            files[path] = self.shared.format(path, mesh, partial(format_obj, *mesh))
            low, high = mesh[0].min(axis=0), mesh[0].max(axis=0)
            centre = [round(float(value), 7) + 0.0 for value in (low + high) / 2]
            entries.append({"file": path, "centre_m": centre})
        return entries

    def list_directions(self, part: Part) -> list[list[float]]:
        """Return up to three directions for bringing a part, down or that of the plan first."""
        order, upright = self.bearing.order, self.upright.of(part.name)
        before = order[: order.index(part.name)] if part.name in order else ()
        kept = encode_set([self.relation.index(name) for name in self.names])
        free = list_free_directions(self.relation, self.upright, part.name, before)
        vectors: dict[int, list[Vector]] = {}
        for vector, blockers in free:
            vectors.setdefault(blockers & kept, []).append(vector)
        fewest = [
            blockers
            for blockers in vectors
            if not any(other != blockers and other & blockers == other for other in vectors)
        ]
        ways = [min(vectors[blockers], key=_get_height) for blockers in fewest]

        def measure(way: Vector) -> float:
            x, y, z = (np.asarray(way) @ upright.matrix).tolist()
            return measure_travel_m(self.relation, part, (x, y, z))

        # One side may have no room for the hand.
        ways += [
            vector
            for blockers, way in zip(fewest, ways, strict=True)
            for vector in vectors[blockers]
            if np.allclose(vector, np.negative(way), atol=1e-6)
            and measure(vector) <= _LONGER_TRAVEL * measure(way)
        ]
        step = self.steps.get(part.name)
        planned = upright.vector(step.along) if step is not None and not step.path else DOWN
        first = choose_direction([vector for vector, _ in free], planned)
        if np.allclose(first, DOWN, atol=1e-6):
            # Friction draws a part out of the jaws on a level move along its support.
            ways = [way for way in ways if way[2] < -_LEVEL]
        if step is None:
            return [list(first)]
        others = [way for way in ways if not np.allclose(way, first, atol=1e-6)]
        return [list(way) for way in (first, *others)][:_MOST_DIRECTIONS]

    def _build_screw(self, part: Part, fastener: Fastener) -> dict[str, Any]:
        # From its head on; a nut lies on the part beneath its rod.
        lies = [
            join
            for join in fastener.joins
            if self._get_driven(self.product.part(join)) is None
            and not (fastener.kind == "nut" and join in fastener.threaded_in)
        ]
        missing = [join for join in fastener.joins if join not in self.names]
        if missing:
            self._note(part.name, f"is put in without {' and '.join(missing)}")
        seat = lies[0] if lies else fastener.joins[0]
        through, beneath = self.names[seat], self.product.part(seat)
        entry, hover_m = build_screw_entry(part, fastener, self.relation, self.upright, beneath)
        if hover_m:
            self._note(
                part.name,
                f"is drawn {hover_m * 1e3:.2g} mm over {seat}, and driven home; "
                "the room below its tip is not checked",
            )
        # A countersunk head has its seat at the wall.
        has_floor = hover_m > 0 or _find_touched_seat(part, fastener, self.relation) is not None
        if fastener.kind == "screw" and has_floor:
            entry["head_diameter_m"] = self._narrow_head(part, fastener, entry)
        feeders = self.places.feeders
        fed = {"feeder": feeders[part.name]} if part.name in feeders else {}
        turned: dict[str, Any] = self._name_orientation(part)
        if turned:
            up = self.bearing.get_up(part.name)
            joined = [self.names[name] for name in list_required(self.relation, part.name, up)]
            into = [name for name in joined if name != through]
            turned |= {"into": into} if into else {}
        stretch_m = self._find_stretch_m(part, entry)
        entry |= {} if stretch_m is None else {"insert_m": stretch_m}
        keys = {"through": through, **entry, **fed, **turned, **self._drive_nut(part)}
        return {"tool": self.drivers[part.name], **keys}

    def _narrow_head(self, part: Part, fastener: Fastener, entry: Mapping[str, Any]) -> float:
        """Return the diameter of a head that has play in its counterbore [m].

        A head that the parts around it would leave no seat is as wide as drawn.
        """
        drawn_m = float(entry["head_diameter_m"])
        radius_m, axis = drawn_m / 2, np.asarray(fastener.axis)
        mouth = self.upright.unpoint(np.asarray(entry["hole_m"]))
        walls = [
            (_measure_wall_m(other, mouth, axis, entry["head_height_m"], radius_m), other.name)
            for other in self.kept
            if other.name != part.name and self._get_driven(other) is None
        ]
        wall_m, wall = min(walls, default=(math.inf, ""))
        play_m = wall_m - radius_m
        narrowed_m = wall_m - PLAY_M
        if play_m >= PLAY_M - _UNEVEN_M or narrowed_m <= (fastener.diameter_m / 2 + radius_m) / 2:
            return drawn_m
        self._note(
            part.name,
            f"has a head that is written {(radius_m - narrowed_m) * 2e3:.2g} mm narrower, as "
            f"{wall} leaves it {max(play_m, 0.0) * 1e3:.2g} mm on each side",
        )
        return round(2 * narrowed_m, 6)

    def _name_orientation(self, part: Part) -> dict[str, Any]:
        """Return the key of the orientation in which a part goes in, if the product turns."""
        if len(self.orientations) == 1 or part.name in self.holds.fixed:
            return {}
        return {"orientation": self.orientations[self.upright.of(part.name)]}

    def _find_stretch_m(self, part: Part, entry: Mapping[str, Any]) -> float | None:
        """Return the length of the stretch of a level screw that begins clear of parts above [m].

        None if the default does, or none in reach: driver and screw come down behind the parts.
        """
        into = np.array(entry.get("axis", DOWN))
        if abs(into[2]) > _STEEP:
            return None
        frame = np.array([into, np.cross(into, DOWN), (0.0, 0.0, 1.0)])
        mouth = frame @ np.array(entry["hole_m"])
        half_m = max(SHANK_DIAMETER_M, entry["head_diameter_m"]) / 2
        length_m = 0.0
        for other in self.kept:
            if other.name == part.name:
                continue
            corners = (self.upright.vertices(other) @ frame.T - mouth)[other.triangles]
            low, high = corners.min(axis=1), corners.max(axis=1)
            above = (low[:, 1] < half_m) & (high[:, 1] > -half_m) & (high[:, 2] > -half_m)
            length_m = max(length_m, float(-low[above, 0].min(initial=0.0)))
        length_m += _CLEAR_STROKE_M
        return round(length_m, 4) if _DEFAULT_STRETCH_M < length_m <= _LONGEST_STRETCH_M else None

    def _choose_drivers(self) -> dict[str, str]:
        """Return the screwdriver or socket of each screw and nut, as long as it needs."""
        drivers: dict[str, str] = {}
        sockets: dict[float, str] = {}
        for part in self.kept:
            if self._get_driven(part) is not None:
                nut = find_socketed(self.product, self.relation, part.name)
                tool = DRIVER
                if nut is not None:
                    tool = sockets.setdefault(nut.flats_m, SOCKETS[len(sockets) % len(SOCKETS)])
                drivers[part.name] = f"{EXTENSIONS[self.holds.extension(part.name)]}{tool}"
        return drivers

    def _drive_nut(self, part: Part) -> dict[str, Any]:
        """Return the keys of a nut that a socket drives onto a standing bolt; none otherwise."""
        nut = find_socketed(self.product, self.relation, part.name)
        if nut is None or nut.bolt not in self.names:
            return {}
        if not nut.is_hexagon:
            self._note(part.name, "is no hexagon: its socket is made for its shape")
        diameter_m = round(nut.flats_m * 2 / math.sqrt(3), 7)
        keys = {**nut.thread_entry, "head": "nut", "into": self.names[nut.bolt]}
        return {"head_diameter_m": diameter_m, **keys}

    def _note(self, part: str, words: str) -> None:
        self.limits.setdefault(part, []).append(words)


def format_task(
    document: Mapping[str, Any],
    left_out: Mapping[str, LeftOut],
    limits: Mapping[str, tuple[str, ...]],
) -> str:
    """Return the text of a task file, with comments on parts left out and limits of one arm."""
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
    return _HEADER + _format_comments(left_out, limits) + text


def _format_comments(left_out: Mapping[str, LeftOut], limits: Mapping[str, tuple[str, ...]]) -> str:
    """Return the parts left out and the limits of one arm as comment lines."""
    messages = [f"Left out: {name} {reason.text}." for name, reason in left_out.items()]
    messages += [f"Beware: {name} {words}." for name, lines in limits.items() for words in lines]
    wrapped = [textwrap.wrap(line, _COMMENT_WIDTH, break_long_words=False) for line in messages]
    return "".join(f"# {line}\n" for lines in wrapped for line in lines)


def _get_height(vector: Vector) -> float:
    return vector[2]
