"""Choose tools and grasps: jaws from above, a suction cup, finger tips, or jaws from a side.

Every choice holds the true mesh; the first one that `swept` grants is written. Grippers of the
catalogue come after the arm's own hand, light ones first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import count, pairwise
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from skillplan.domains.assembly import ToolConfig
from skillplan.robots.arm_description import Hand
from skillplan.robots.catalogue import ARMS, DEFAULT_ARM
from skillplan.task.motion import AXES
from skillplan.task.pose import DOWN
from skillplan_cad.blocking.ray_mesh import RayMesh, RayView
from skillplan_cad.planning.bearing import Bearing, can_come_down
from skillplan_cad.planning.precedence import encode_set
from skillplan_cad.product import Part, Points, Product, Vector
from skillplan_cad.relation import LeftOut, Relation
from skillplan_cad.writing.mesh_grasps import OPEN_M, Floats, GraspFinder, JawGrasp
from skillplan_cad.writing.trial import Failure
from skillplan_cad.writing.upright import place_turned, place_upright

GRIPPER, TIPS, LONG_TIPS = "gripper", "finger_tips", "long_finger_tips"
CUP, SMALL_CUP, LARGE_CUP = "suction_cup", "small_suction_cup", "large_suction_cup"
WIDE_CUP, HEAVY_CUP = "wide_suction_cup", "heavy_suction_cup"
NARROW_CUP, NEEDLE = "narrow_suction_cup", "vacuum_needle"
CUPS_M: Mapping[str, float] = {
    CUP: 0.016,
    SMALL_CUP: 0.006,
    LARGE_CUP: 0.032,
    WIDE_CUP: 0.05,
    HEAVY_CUP: 0.07,
    NARROW_CUP: 0.0025,
    NEEDLE: 0.0008,
}
"""Diameters of the suction cups [m]; a needle of gauge 21 picks up chips and small washers."""

GRIPPERS: Mapping[str, float | None] = {
    "robotiq_2f85": 5.0,
    "robotiq_2f140": 2.5,
    "long_jaws": None,
    "wide_jaws": None,
}
"""Grippers of the catalogue from light to heavy, with their payload in a reseller's table [kg]."""

DRIVER, SOCKETS = "screwdriver", ("socket", "socket_2")
"""Tools of screws, and of nuts that go over standing bolts, by size."""

EXTENSIONS = ("", "long_", "longest_")
"""Names of their bits: the shortest that reaches past the parts beside a screw is taken."""

# Distance up to which files round equal corners apart [m].
_ROUNDED_M = 1e-6

TIPS_PROFILE_M = (
    (0.0, 0.002, 0.0, 0.0012),
    (0.006, 0.002, 0.0, 0.0012),
    (0.0085, 0.003, 0.0, 0.004),
    (0.04, 0.003, 0.0, 0.004),
    (0.047, 0.0089, 0.0, 0.0144),
    (0.0538, 0.0106, 0.0, 0.0265),
)
"""Finger tips for small parts, 6 mm wide and 40 mm long, the last 6 mm 4 mm wide and 1.2 mm thick:
they reach down beside walls. Rows as in `jaw_profile_m`. In steel they bend by 0.02 mm at 6 N."""

LONG_TIPS_PROFILE_M = (
    *TIPS_PROFILE_M[:2],
    (0.0085, 0.003, 0.0, 0.0034),
    (0.028, 0.003, 0.0, 0.0034),
    (0.032, 0.003, 0.0, 0.006),
    (0.065, 0.003, 0.0, 0.006),
    *((height_m + 0.025, *section) for height_m, *section in TIPS_PROFILE_M[-2:]),
)
"""Finger tips for the bottom of a bore, 65 mm long, the last 28 mm at most 3.4 mm thick. They are
no maker's product, but made for the task, like the others; in steel they bend by 0.04 mm at 6 N."""

PROFILES_M: Mapping[str, tuple[tuple[float, ...], ...]] = {
    TIPS: TIPS_PROFILE_M,
    LONG_TIPS: LONG_TIPS_PROFILE_M,
}
"""Shapes of the finger tips by tool."""

TIPS_CLEARANCE_M = 1e-3
"""Clearance of the open tips on each side of a part [m]: feeders present small parts closely."""

# Least margin on the force of jaws; see `JawGrasp`.
_LEAST_MARGIN = 1.5
# Area of each jaw and distance from the centre of mass of a grasp that comes before a cup [m2, m].
_GOOD_M2, _NEAR_M = 6e-6, 0.012
# Least share of the product's mass of a part that stands there from the start, next to the base.
_FRAME_SHARE = 0.15
# Height up to which a part stands on the table [m].
_GROUND_M = 2e-4
LONG_ARM = "ur10e"
"""Arm to try if a place is out of reach."""

# Shares of a part's mass at which a grasp is tried that its weight spoils; wood has 1/16 of steel.
_LIGHTER = (1 / 2, 1 / 4, 1 / 8, 1 / 16)

# Height at which a feeder presents a part to a hand from a side: it has room, and so has the wrist.
_RAISED_M = 0.06
# The same for an arm of large reach [m], as a share of it.
LARGE_REACH_M, _RAISED_SHARE = 1.5, 0.15

# A part that is let go above its goal: room of the fingers over what encloses it, depth that guides
# it at least, and greatest height [m].
_FINGER_ROOM_M, _GUIDED_M, _HIGHEST_M = 5e-4, 1e-3, 0.02
# Distances from the sides of a part at which heights are measured [m]: at the first they guide it.
_BESIDE_M = (5e-4, 1.5e-3, 3e-3, 5e-3)
_SIDE_POINTS = 25
# Axes along which a level hand points.
_LEVEL_AXES: tuple[Vector, ...] = (
    *((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    *((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)),
)


@dataclass(frozen=True, slots=True)
class Load:
    """A part in a tool.

    Parameters
    ----------
    mass_kg
        Mass of both.
    tip_m
        Least height of the tool's tip above the bottom of the part [m].
    """

    mass_kg: float
    tip_m: float


# Distances of pieces from open jaws, and of the space of jaws from the faces that they press [m].
_JAW_ROOM_M, _FILM_M = 2.5e-4, 2e-5


@dataclass(frozen=True, slots=True)
class Held:
    """A tool and the grasps of a part by it, as in the part's entry in a task file.

    Parameters
    ----------
    raised_m
        Height at which a feeder has to present the part for these grasps [m]; 0 on the table.
    released_m
        Height above its goal at which it is let go [m]; 0 at its goal.
    at_end
        True if jaws hold it at an end, which has room where its middle has none.
    grip_n
        Force of each jaw in the best grasp found, see `JawGrasp` [N].
    """

    tool: str
    grasps: tuple[Mapping[str, Any], ...]
    raised_m: float = 0.0
    released_m: float = 0.0
    at_end: bool = False
    grip_n: float = 0.0

    def compute_load_kg(self, part: Part, hand: Hand) -> float:
        """Return the mass of a part with the tool that holds it [kg]."""
        in_catalogue = self.tool in GRIPPERS
        return part.mass_kg + (equip_hand(hand, self.tool)[1] if in_catalogue else hand.mass_kg)

    @property
    def is_from_above(self) -> bool:
        """True if the hand points down."""
        return not any("approach" in grasp for grasp in self.grasps)

    def list_jaw_spaces(
        self, hand: Hand, top_m: float, *, is_pressed: bool = False
    ) -> list[Points]:
        """Return boxes around the open jaws of each grasp, or the layers that jaws press.

        Parameters
        ----------
        hand
            The arm's own hand.
        top_m
            Height of the part above its bottom [m].
        is_pressed
            True for the layers between the part and those boxes: a piece that stands out of a face
            pushes the part aside as the jaws close.

        Returns
        -------
        list
            Corners relative to the centre of the part's bottom [m], shape (8, 3) each.
        """
        if self.tool in CUPS_M:
            return []
        hand, clearance_m = get_jaws(hand, self.tool)
        boxes = []
        for grasp in self.grasps:
            if grasp.get("hold") == "inner":
                continue
            axis = grasp["closing_axis"]
            closing = np.array(AXES[axis] if isinstance(axis, str) else axis)
            out = -np.array(grasp.get("approach", DOWN))
            x_m, y_m, *z_m = grasp["at_m"]
            tip = np.array([x_m, y_m, z_m[0] if z_m else top_m - grasp["depth_m"]])
            width_m = grasp["width_m"]
            open_m = min(width_m + 2 * clearance_m, hand.opening_m)
            for lower, upper in pairwise(hand.jaw_m):
                half_m = max(lower[1], upper[1]) + _JAW_ROOM_M
                near_m = width_m / 2 + min(lower[2], upper[2]) + 2 * _JAW_ROOM_M
                far_m = open_m / 2 + max(lower[3], upper[3]) + _JAW_ROOM_M
                if is_pressed:
                    half_m -= _JAW_ROOM_M
                    near_m, far_m = near_m - 2 * _JAW_ROOM_M + _FILM_M, near_m
                ends = ((-half_m, half_m), (lower[0], upper[0]), (near_m, far_m))
                corners = np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 3)
                frame = np.stack([np.cross(out, closing), out, closing])
                boxes += [tip + corners * [1.0, 1.0, side] @ frame for side in (1, -1)]
        return boxes

    def release(self, rims_m: Floats, top_m: float) -> Held | None:
        """Return the grasps whose fingers stay above what encloses a part: it slides down the rest.

        Parameters
        ----------
        rims_m
            Heights around the part above its bottom at `_BESIDE_M`, a row each for -x, x, -y and y
            [m], shape (4, 4).
        top_m
            Height of the part [m].
        """
        if self.tool not in (*PROFILES_M, GRIPPER) or self.raised_m or not self.is_from_above:
            return None
        over_m = float(rims_m.max()) + _FINGER_ROOM_M
        heights_m = [round(over_m - (top_m - grasp["depth_m"]), 4) for grasp in self.grasps]
        least_m = min(heights_m)
        guide_m = float(rims_m[:, 0].min())
        if not 0 < least_m <= min(_HIGHEST_M, guide_m - _GUIDED_M):
            return None
        near = tuple(
            grasp
            for grasp, height_m in zip(self.grasps, heights_m, strict=True)
            if height_m <= least_m
        )
        return replace(self, grasps=near, released_m=least_m)

    @property
    def entry(self) -> dict[str, Any]:
        """Keys ``tool``, ``grasp`` and ``release_m``."""
        # Parts that share grasps have entries of their own, without YAML references.
        grasps = deepcopy([dict(grasp) for grasp in self.grasps])
        entry = {"tool": self.tool, "grasp": grasps if len(grasps) > 1 else grasps[0]}
        return {**entry, "release_m": self.released_m} if self.released_m else entry


@cache
def equip_hand(hand: Hand, gripper: str) -> tuple[Hand, float]:
    """Return the hand of an arm with a gripper of the catalogue instead, and its mass [kg]."""
    tool = ToolConfig.model_validate({"model": gripper, "holder_m": [0.0, 0.0]})
    equipped = tool.hand_on(hand)
    assert equipped is not None
    assert tool.mass_kg is not None
    return equipped, tool.mass_kg


def build_tips(hand: Hand, tool: str) -> dict[str, Any]:
    """Return the keys of finger tips on the hand of an arm, without their holder."""
    profile_m = PROFILES_M[tool]
    entry = {
        "jaw_profile_m": [list(row) for row in profile_m],
        "clearance_m": TIPS_CLEARANCE_M,
    }
    beyond_m = profile_m[-1][0] - TIPS_PROFILE_M[-1][0]
    if not beyond_m:
        return entry
    return {**entry, "length_m": round(hand.tip_on_flange.xyz_m[2] + beyond_m, 6)}


@cache
def _equip_tips(hand: Hand, tool: str) -> Hand:
    entry = {"type": "gripper", "holder_m": [0.0, 0.0], **build_tips(hand, tool)}
    equipped = ToolConfig.model_validate(entry).hand_on(hand)
    assert equipped is not None
    return equipped


def get_jaws(hand: Hand, tool: str) -> tuple[Hand, float]:
    """Return the hand with the jaws of a gripper, and their clearance on each side [m]."""
    if tool in PROFILES_M:
        return _equip_tips(hand, tool), TIPS_CLEARANCE_M
    return hand if tool == GRIPPER else equip_hand(hand, tool)[0], OPEN_M


def list_holds(
    part: Part,
    local: Points,
    centre_m: Floats,
    hand: Hand,
    sunk_m: float = 0.0,
    walls_m: Mapping[Vector, float] | None = None,
    raised_m: float = _RAISED_M,
) -> Iterator[Held]:
    """Yield tools with grasps, the preferred one first; nothing if no tool holds the part.

    Jaws from above come first if they meet enough material next to the centre of mass, else cups.
    Jaws of a hand without a margin of force come last: heavy parts creep between them.

    Parameters
    ----------
    local
        Vertices of the upright part, relative to the centre of its bottom [m].
    centre_m
        Centre of mass in that frame [m].
    sunk_m
        Height up to which other parts enclose it at its goal, from its bottom [m].
    walls_m
        The same along the axes of level hands, by the direction in which they point; for a part
        that goes in level.
    raised_m
        Height above the table at which a feeder presents it to a level hand [m].
    """
    weak: list[Held] = []
    for held in _search_holds(part, local, centre_m, hand, sunk_m, walls_m or {}, raised_m):
        if held.grip_n and _LEAST_MARGIN * held.grip_n > get_jaws(hand, held.tool)[0].force_n:
            weak.append(held)
        else:
            yield held
    yield from weak


def list_shallow_holds(part: Part, local: Points, centre_m: Floats, hand: Hand) -> list[Held]:
    """Return the shallowest grasps of jaws and tips from above; see `list_holds`."""
    finder = GraspFinder(part, local, centre_m)
    holds = []
    for tool in (TIPS, GRIPPER):
        jaws, clearance_m = get_jaws(hand, tool)
        grasps = finder.find_jaw_grasps(jaws, (DOWN,), 0.0, clearance_m=clearance_m, at_top=True)
        if grasps:
            holds.append(_hold(tool, grasps))
    return holds


def _search_holds(
    part: Part,
    local: Points,
    centre_m: Floats,
    hand: Hand,
    sunk_m: float,
    walls_m: Mapping[Vector, float],
    raised_m: float,
) -> Iterator[Held]:
    finder = GraspFinder(part, local, centre_m)
    above = finder.find_jaw_grasps(hand, (DOWN,), sunk_m)
    is_good = any(grasp.area_m2 >= _GOOD_M2 and grasp.cost <= _NEAR_M for grasp in above)
    if is_good:
        yield _hold(GRIPPER, above)
    for cup in (CUP, LARGE_CUP, WIDE_CUP, HEAVY_CUP):
        yield from _hold_by_cup(finder, cup)
    if above and not is_good:
        yield _hold(GRIPPER, above)
    yield from _hold_by_cup(finder, SMALL_CUP)
    for tool in PROFILES_M:
        tips, clearance_m = get_jaws(hand, tool)
        by_tips = finder.find_jaw_grasps(tips, (DOWN,), sunk_m, clearance_m=clearance_m)
        by_tips += finder.find_inner_grasps(tips, (DOWN,))
        if by_tips:
            yield _hold(tool, sorted(by_tips, key=lambda grasp: grasp.cost))
    for cup in (NARROW_CUP, NEEDLE):
        yield from _hold_by_cup(finder, cup)
    sides = finder.list_sides()
    beside = finder.find_jaw_grasps(hand, sides, sunk_m, walls_m=walls_m)
    if beside:
        yield _hold(GRIPPER, beside)
    for approaches in ((DOWN,), sides):
        for gripper, rated_kg in GRIPPERS.items():
            if rated_kg is None or part.mass_kg <= rated_kg:
                other = equip_hand(hand, gripper)[0]
                grasps = finder.find_jaw_grasps(other, approaches, sunk_m, walls_m=walls_m)
                if grasps:
                    yield _hold(gripper, grasps)
    raised = finder.find_jaw_grasps(hand, sides, sunk_m, raised_m, walls_m=walls_m)
    if raised:
        yield _hold(GRIPPER, raised, raised_m)
    inside = finder.find_inner_grasps(get_jaws(hand, TIPS)[0], sides)
    if inside:
        yield _hold(TIPS, inside, raised_m)
    ends = finder.find_jaw_grasps(hand, (DOWN,), sunk_m, at_ends=True)
    if ends:
        yield replace(_hold(GRIPPER, ends), at_end=True)


def _hold(tool: str, grasps: Sequence[JawGrasp], raised_m: float = 0.0) -> Held:
    entries = tuple(grasp.entry for grasp in grasps)
    return Held(tool, entries, raised_m, grip_n=grasps[0].grip_n)


def _hold_by_cup(finder: GraspFinder, cup: str) -> Iterator[Held]:
    place = finder.find_cup_place(CUPS_M[cup])
    if place is not None:
        yield Held(cup, ({"at_m": list(place)},))


def get_payload_kg(robot: str) -> float:
    """Return the payload of an arm of the catalogue, tool included [kg]."""
    payload_kg = ARMS[robot][0].payload_kg
    assert payload_kg is not None
    return payload_kg


def describe_too_heavy(mass_kg: float, tool_kg: float, robot: str, tool: str) -> str | None:
    """Return why an arm cannot carry a part with a tool, and the least arm that can, or None."""
    if mass_kg + tool_kg <= get_payload_kg(robot):
        return None
    able = [name for name in ARMS if get_payload_kg(name) >= mass_kg + tool_kg]
    words = (
        f"weighs {mass_kg:.3g} kg, and {robot} carries {get_payload_kg(robot) - tool_kg:.3g} kg "
        f"with {tool}"
    )
    if not able:
        return f"{words}; no arm of the catalogue carries it"
    weakest = min(able, key=lambda name: (get_payload_kg(name), name))
    return f"{words}; --robot {weakest} carries {get_payload_kg(weakest) - tool_kg:.3g} kg"


@dataclass(slots=True)
class KnownHolds:
    """Tools and grasps that were found, by upright shape, density and depth in other parts.

    Attributes
    ----------
    granted, bits
        Tools and grasps of an accepted task, by part, side up and heading, and numbers of the bits,
        by part and side up.
    """

    _found: dict[tuple[Any, ...], tuple[list[Held], Iterator[Held]]] = field(default_factory=dict)
    # Upright shapes by the numbers of their corners and triangles.
    _shapes: dict[tuple[int, int], list[cKDTree]] = field(default_factory=dict)
    granted: dict[tuple[str, Vector, int], Held] = field(default_factory=dict)
    bits: dict[tuple[str, Vector], int] = field(default_factory=dict)

    def find_shape(self, part: Part, local: Points) -> tuple[int, ...]:
        """Return the key of an upright shape, which parts of the same triangles share."""
        counts = len(local), len(part.triangles)
        points_m = np.vstack([local, local[part.triangles].mean(axis=1)])
        shapes = self._shapes.setdefault(counts, [])
        for number, tree in enumerate(shapes):
            if np.isfinite(tree.query(points_m, distance_upper_bound=_ROUNDED_M)[0]).all():
                return (*counts, number)
        shapes.append(cKDTree(points_m))
        return (*counts, len(shapes) - 1)

    def iterate(self, key: tuple[Any, ...], search: Callable[[], Iterator[Held]]) -> Iterator[Held]:
        """Yield the holds of a part; each is searched once."""
        if key not in self._found:
            self._found[key] = ([], search())
        known, more = self._found[key]
        for number in count():
            while len(known) <= number:
                held = next(more, None)
                if held is None:
                    return
                known.append(held)
            yield known[number]


class PartHolds:
    """Tools and grasps of the parts of a product: the chosen ones, and others to try.

    Parameters
    ----------
    robot
        Arm whose payload limits the choice; None for an arm that carries everything.
    known
        Holds that were found before, also for other arms.

    Attributes
    ----------
    fixed
        Parts in place from the start, with the reason as a clause that follows the part's name.
    """

    def __init__(
        self,
        product: Product,
        relation: Relation,
        base: str,
        up: Vector,
        robot: str | None,
        known: KnownHolds | None = None,
    ) -> None:
        self._product, self._relation, self._base = product, relation, base
        self._robot, self._hand = robot, ARMS[robot or DEFAULT_ARM][1]
        self._known = known or KnownHolds()
        # Tools that hold a part and that the arm cannot carry with it.
        self._heavy: dict[str, Held] = {}
        self._upright = place_upright(product, up, (0.0, 0.0))
        self._bearing = Bearing(up, ())
        self._choices: dict[str, Iterator[Held]] = {}
        self._chosen: dict[str, Held] = {}
        self._failures: dict[str, Failure] = {}
        # Parts without room for finger tips (True), or out of reach of a level hand (False).
        self._futile: set[tuple[str, bool]] = set()
        # Parts for which finger tips may be too short.
        self._deep: set[str] = set()
        self._extensions: dict[str, int] = {}
        self._tried_bits: dict[str, set[int]] = {}
        self._order: tuple[str, ...] = ()
        self._on: Mapping[str, tuple[str, ...]] = {}
        self.fixed: dict[str, str] = {}

    @property
    def base(self) -> str:
        """Name of the part that the others are put on."""
        return self._base

    def held(self, name: str) -> Held:
        """Return the chosen tool and grasps of a part."""
        return self._chosen[name]

    def extension(self, name: str) -> int:
        """Return the number of the bit that drives a screw or nut."""
        bit = self._known.bits.get((name, self._bearing.get_up(name)), 0)
        return self._extensions.get(name, bit)

    def find_failure(self, name: str) -> Failure | None:
        """Return why the arm cannot bring a part with the tools before the chosen one, or None."""
        return self._failures.get(name)

    def list_order(self) -> list[str]:
        """Return the parts in the order of assembly, each screw after what it joins."""
        order = list(self._order)
        for name in sorted(self._relation.driven, key=self._relation.index):
            fastener = self._relation.fastener(name)
            joins = () if fastener is None else fastener.joins
            places = [order.index(join) for join in joins if join in order]
            order.insert(max(places, default=len(order) - 1) + 1, name)
        ups = self._bearing.ups
        return sorted(order, key=lambda name: ups.index(self._bearing.get_up(name)))

    def choose(self, bearing: Bearing) -> dict[str, LeftOut]:
        """Choose tools for the parts that stand; return the parts without one.

        The base is fixed instead, and so is a heavy part on it that others need.
        """
        self._order, self._on = bearing.order, bearing.on
        poses, heading = (bearing.up, bearing.turned), bearing.heading
        if (*poses, heading) != (self._bearing.up, self._bearing.turned, self._bearing.heading):
            parts = self._product.parts
            self._upright = place_turned(parts, bearing.ups, bearing.turned, (0.0, 0.0), heading)
        self._bearing = bearing
        if bearing.order and self._base not in bearing.order:
            grounded = [name for name in bearing.order if not bearing.on[name]]
            self._base = max(grounded, key=lambda name: self._product.part(name).mass_kg)
        unheld: dict[str, LeftOut] = {}
        for name in bearing.order:
            if name in self.fixed and not self._rests(name):
                why = f"{self.fixed.pop(name)}; nothing bears it there before other parts come"
                unheld[name] = LeftOut(name, "no grasp", why)
                continue
            if name in self._chosen or name in self.fixed:
                continue
            part = self._product.part(name)
            words = self._describe_load(part, self._hand.mass_kg, "its hand")
            if words is not None:
                if not self._fix(name, words):
                    unheld[name] = LeftOut(name, "too heavy", words)
            elif not self.take_next(name):
                unheld |= self.give_up(name)
        return unheld

    def keep(self) -> None:
        """Let the chosen tools be the first ones of the next task."""
        for name, held in self._chosen.items():
            self._known.granted[name, self._bearing.get_up(name), self._bearing.heading] = held
        for name, bit in self._extensions.items():
            self._known.bits[name, self._bearing.get_up(name)] = bit

    def list_loads(self) -> dict[str, Load]:
        """Return the loads of an arm, parts with their chosen tools."""
        loads = {}
        for name, held in self._chosen.items():
            part = self._product.part(name)
            height_m = float(self._upright.of(name).size(part)[2])
            tips_m = [
                grasp["at_m"][2] if "approach" in grasp else height_m - grasp.get("depth_m", 0.0)
                for grasp in held.grasps
            ]
            loads[name] = Load(held.compute_load_kg(part, self._hand), min(tips_m))
        return loads

    def _describe_load(self, part: Part, tool_kg: float, tool: str) -> str | None:
        if self._robot is None:
            return None
        return describe_too_heavy(part.mass_kg, tool_kg, self._robot, tool)

    def take_next(self, name: str, failure: Failure | None = None) -> bool:
        """Choose the next tool of a part, or another bit; return False if there is none.

        Parameters
        ----------
        failure
            Why the arm cannot bring the part with the tool before.
        """
        if failure is not None:
            self._note_failure(name, failure)
        if name in self._relation.driven:
            tried = self._tried_bits.setdefault(name, {self.extension(name)})
            bit = next((n for n in range(len(EXTENSIONS)) if n not in tried), None)
            if bit is None:
                return False
            tried.add(bit)
            self._extensions[name] = bit
            return True
        if failure is not None and (failure.is_blocked or failure.falls):
            return False
        if name not in self._choices:
            self._choices[name] = self._list_holds(self._product.part(name))
        part = self._product.part(name)
        for held in self._choices[name]:
            if self._is_futile(name, held):
                continue
            tool_kg = held.compute_load_kg(part, self._hand) - part.mass_kg
            if self._describe_load(part, tool_kg, held.tool) is None:
                self._chosen[name] = held
                return True
            self._heavy.setdefault(name, held)
        return False

    def begin_again(self, name: str) -> None:
        """Choose the first tool of a part or the shortest bit, and forget its failures."""
        for kept in (self._failures, self._choices, self._extensions, self._tried_bits):
            kept.pop(name, None)
        self._futile -= {(name, True), (name, False)}
        self._deep.discard(name)
        if name not in self._relation.driven:
            self.take_next(name)

    def _note_failure(self, name: str, failure: Failure) -> None:
        first, held = self._failures.setdefault(name, failure), self._chosen.get(name)
        from_above = held is None or held.is_from_above
        # A level hand that does not get there is no reason for a longer arm.
        is_far = first.is_far or (failure.is_far and from_above)
        self._failures[name] = replace(first, is_far=is_far)
        if held is not None and held.tool == TIPS and failure.is_by_hand:
            self._deep.add(name)
            if failure.is_by_fingers:
                self._futile.add((name, True))
        if held is not None and not from_above and failure.is_by_arm:
            self._futile.add((name, False))

    def _is_futile(self, name: str, held: Held) -> bool:
        """Return whether a gripper need not be tried.

        Fingers have no room where thinner ones had none; long tips help only where shorter ones
        met something.
        """
        if held.tool == LONG_TIPS:
            return name not in self._deep
        is_thick = held.tool == GRIPPER or held.tool in GRIPPERS
        is_usual = not (held.raised_m or held.released_m or held.at_end)
        return is_thick and is_usual and (name, held.is_from_above) in self._futile

    def give_up(self, name: str) -> dict[str, LeftOut]:
        """Return a part that no tool holds or brings, with the nearest remedy; fix the base."""
        failure = self._failures.get(name)
        if failure is None:
            return self._give_up_unheld(self._product.part(name))
        words = f"cannot be brought, whatever tool holds it: {failure.text}"
        if name in self._relation.driven:
            words = f"cannot be driven: {failure.text}"
        elif self._fix(name, words):
            return {}
        # The links of another arm may have room where those of this one have none.
        by_arm = failure.is_by_arm or (
            name in self._relation.driven and "of the arm" in failure.text
        )
        if failure.is_far or by_arm:
            remedy = "" if self._robot == LONG_ARM else f"; --robot {LONG_ARM} reaches farther"
            return {name: LeftOut(name, "unreachable", f"{words}{remedy}")}
        return {name: LeftOut(name, "no grasp", words)}

    def _give_up_unheld(self, part: Part) -> dict[str, LeftOut]:
        """Return a part that no tool holds, or none that the arm carries; fix the base."""
        name, heavy = part.name, self._heavy.get(part.name)
        if heavy is not None:
            tool_kg = heavy.compute_load_kg(part, self._hand) - part.mass_kg
            words = self._describe_load(part, tool_kg, f"{heavy.tool}, which holds it") or ""
            return {} if self._fix(name, words) else {name: LeftOut(name, "too heavy", words)}
        lighter_kg = self._find_bearable_mass(part)
        if lighter_kg is not None:
            words = (
                f"weighs {part.mass_kg:.3g} kg, more than the grippers, and the cups that its "
                "level faces have room for, bear"
            )
            if self._fix(name, words):
                return {}
            words += f"; at {lighter_kg:.3g} kg it could be held: is it of another material?"
            return {name: LeftOut(name, "too heavy", words)}
        wide_mm = float(self._upright.of(part.name).size(part)[:2].min()) * 1e3
        most_mm = max(equip_hand(self._hand, name)[0].opening_m for name in GRIPPERS) * 1e3
        wide = f"{wide_mm:.{0 if wide_mm >= 1 else 2}f} mm wide"
        words = (
            f"is {wide}, has no opposite faces that a gripper holds (they open up to "
            f"{most_mm:.0f} mm), and no level face wide enough for a cup"
        )
        if self._fix(name, words):
            return {}
        remedy = "--as-one with a part that can be held, or --leave-out"
        return {name: LeftOut(name, "no grasp", f"{words}; {remedy}")}

    def _find_bearable_mass(self, part: Part) -> float | None:
        """Return the half, quarter, ... of a part's mass that a tool bears [kg], or None."""
        for share in _LIGHTER:
            lighter = replace(part, density_kg_m3=share * part.density_kg_m3)
            if next(self._list_holds(lighter), None) is not None:
                return lighter.mass_kg
        return None

    def _fix(self, name: str, words: str) -> bool:
        """Put the base, or a heavy part on it, in place from the start; False for other parts."""
        if name in self._relation.driven:
            return False
        if not self._rests(name) or (name != self._base and not self._is_frame(name)):
            return False
        self.fixed[name] = f"stands in place from the start: it {words}"
        return True

    def _rests(self, name: str) -> bool:
        """Return whether a part stands on the table or on fixed parts alone: it is there first."""
        bearers = self._on.get(name, ())
        if bearers:
            return all(bearer in self.fixed for bearer in bearers)
        low_m = [self._find_low_m(other) for other in self._order]
        return self._find_low_m(name) < min(low_m) + _GROUND_M

    def _find_low_m(self, name: str) -> float:
        return float(self._upright.of(name).bottom(self._product.part(name))[2])

    def _is_frame(self, name: str) -> bool:
        """Return whether a part is heavy, and others need it."""
        whole_kg = sum(part.mass_kg for part in self._product)
        joins = {join for fastener in self._relation.fasteners for join in fastener.joins}
        needed = joins.union(*self._on.values())
        is_heavy = self._product.part(name).mass_kg >= _FRAME_SHARE * whole_kg
        return is_heavy and name in needed

    def _list_holds(self, part: Part) -> Iterator[Held]:
        upright = self._upright.of(part.name)
        bottom = np.array(upright.bottom(part))
        local = upright.vertices(part) - bottom
        centre = upright.matrix @ np.asarray(part.centre_m) + upright.offset_m - bottom
        enclosed = self._list_enclosed(part) - bottom
        sunk_m = round(float(enclosed[:, 2].max(initial=0.0)), 6)
        walls_m = self._find_walls_m(part, enclosed)
        up = self._bearing.get_up(part.name)
        granted = self._known.granted.get((part.name, up, self._bearing.heading))
        # What encloses a part that slides to its goal may be another in this order.
        if granted is not None and not granted.released_m:
            yield granted
        shape = self._known.find_shape(part, local)
        reach_m = ARMS[self._robot or DEFAULT_ARM][0].works_within_m
        # The forearm of a large arm would meet the table.
        raised_m = round(_RAISED_SHARE * reach_m, 2) if reach_m > LARGE_REACH_M else _RAISED_M
        key = (*shape, part.density_kg_m3, sunk_m, *walls_m.values(), raised_m)
        tried = []
        for held in self._known.iterate(
            key, lambda: list_holds(part, local, centre, self._hand, sunk_m, walls_m, raised_m)
        ):
            tried.append(held)
            if held != granted:
                yield held
        rims_m = self._measure_rims_m(part) - bottom[2]
        top_m = float(local[:, 2].max())
        released = [held.release(rims_m, top_m) for held in tried]
        if not any(released) and 0 < rims_m[:, 0].min() <= top_m:
            # The usual grasps of a part that is enclosed up to its top are deeper.
            shallow = list_shallow_holds(part, local, centre, self._hand)
            released = [held.release(rims_m, top_m) for held in shallow]
        yield from (held for held in released if held is not None)

    def _measure_rims_m(self, part: Part) -> Floats:
        """Return the heights of earlier parts at `_BESIDE_M` from -x, x, -y and y of a part [m]."""
        upright = self._upright.of(part.name)
        own = upright.vertices(part)[:, :2]
        low, high = own.min(axis=0), own.max(axis=0)
        beside, share = np.array(_BESIDE_M), np.linspace(0, 1, _SIDE_POINTS)
        sides = []
        for axis in (0, 1):
            along = low[1 - axis] + share * (high - low)[1 - axis]
            for place in (low[axis] - beside, high[axis] + beside):
                points = np.stack(np.meshgrid(place, along), axis=-1).reshape(-1, 2)
                sides.append(points if axis == 0 else points[:, ::-1])
        rims_m = np.full((4, len(beside)), -np.inf)
        for other in map(self._product.part, self._list_before(part.name)):
            there = upright.vertices(other)
            near = (there[:, :2].min(axis=0) < high + beside[-1]).all()
            if not near or not (there[:, :2].max(axis=0) > low - beside[-1]).all():
                continue
            mesh = RayMesh(replace(other, vertices_m=there), np.zeros(3))
            seen = RayView(mesh, np.eye(3)).trace_heights(np.concatenate(sides) * 1e3).high / 1e3
            rims_m = np.fmax(rims_m, np.fmax.reduce(seen.reshape(4, -1, len(beside)), axis=1))
        return rims_m

    def _list_enclosed(self, part: Part) -> Points:
        """Return the points at which earlier parts touch a part at its goal [m]."""
        upright = self._upright.of(part.name)
        points = [
            upright.point(point)
            for contact in self._relation.contacts
            if part.name in contact.parts
            and any(other in self._list_before(part.name) for other in contact.parts)
            for point in contact.points_m
        ]
        return np.array(points).reshape(-1, 3)

    def _find_walls_m(self, part: Part, enclosed: Points) -> dict[Vector, float]:
        """Return how far earlier parts enclose one that goes in level, against the axes [m].

        Parameters
        ----------
        enclosed
            Points at which they touch it, relative to the centre of its bottom [m].
        """
        before = encode_set([*map(self._relation.index, self._list_before(part.name))])
        up = self._bearing.get_up(part.name)
        if not len(enclosed) or can_come_down(self._relation, part.name, before, up):
            return {}
        return {along: round(-float((enclosed @ along).min()), 4) for along in _LEVEL_AXES}

    def _list_before(self, name: str) -> tuple[str, ...]:
        return self._order[: self._order.index(name)] if name in self._order else ()
