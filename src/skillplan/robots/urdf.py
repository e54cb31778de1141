"""An arm from a URDF: the chain from its base to a named link, with limits, masses and shapes.

Joints outside the chain stand still. Values that a file leaves out are assumed, and the description
lists these assumptions. All faults of a file come in one message.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import ParamSpec, TypeVar

from skillplan.robots.arm_description import (
    ArmDescription,
    Capsule,
    Hull,
    Joint,
    LinkInertia,
    LinkShape,
    Rod,
    Transform,
    Triple,
)
from skillplan.xml_tree import Element, XmlError, parse_xml

Matrix = tuple[Triple, Triple, Triple]
_ONE: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Rigid:
    """A rotation, by its rows, and an origin [m]."""

    rows: Matrix = _ONE
    origin: Triple = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, xyz_m: Triple, rpy_rad: Triple) -> Rigid:
        """Return a shift followed by rotations about fixed x, y and z."""
        (cr, cp, cy), (sr, sp, sy) = (
            tuple(function(angle) for angle in rpy_rad) for function in (math.cos, math.sin)
        )
        rows = (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
        return cls(rows, xyz_m)

    def rotate(self, vector: Triple) -> Triple:
        """Return a vector of this frame in the parent frame."""
        x, y, z = (sum(a * b for a, b in zip(row, vector, strict=True)) for row in self.rows)
        return (x, y, z)

    def apply(self, point: Triple) -> Triple:
        """Return a point of this frame [m] in the parent frame."""
        x, y, z = self.rotate(point)
        return (x + self.origin[0], y + self.origin[1], z + self.origin[2])

    @classmethod
    def about(cls, axis: Triple, angle_rad: float) -> Rigid:
        """Return a rotation about a unit vector (Rodrigues)."""
        (x, y, z), cos, sin = axis, math.cos(angle_rad), math.sin(angle_rad)
        rest = 1 - cos
        rows = (
            (cos + x * x * rest, x * y * rest - z * sin, x * z * rest + y * sin),
            (y * x * rest + z * sin, cos + y * y * rest, y * z * rest - x * sin),
            (z * x * rest - y * sin, z * y * rest + x * sin, cos + z * z * rest),
        )
        return cls(rows)

    def then(self, other: Rigid) -> Rigid:
        """Return a transform of this frame in the parent frame."""
        columns = [self.rotate(_get_column(other.rows, number)) for number in range(3)]
        (a, b, c), (d, e, f), (g, h, i) = columns
        return Rigid(((a, d, g), (b, e, h), (c, f, i)), self.apply(other.origin))

    def turned(self, tensor: Matrix) -> Matrix:
        """Return a tensor of this frame along the axes of the parent frame."""
        half = [self.rotate(row) for row in tensor]
        columns = [self.rotate(_get_column((half[0], half[1], half[2]), n)) for n in range(3)]
        return (columns[0], columns[1], columns[2])

    @property
    def transform(self) -> Transform:
        """The transform with roll, pitch and yaw."""
        (xx, _, _), (yx, yy, yz), (zx, zy, zz) = self.rows
        pitch = math.atan2(-zx, math.hypot(zy, zz))
        if math.hypot(zy, zz) < 1e-9:
            # Roll and yaw turn about the same axis: roll takes all of the rotation.
            return Transform(self.origin, (math.atan2(-yz, yy), pitch, 0.0))
        return Transform(self.origin, (math.atan2(zy, zz), pitch, math.atan2(yx, xx)))


@dataclass(frozen=True, slots=True)
class Mass:
    """Mass [kg], centre [m] and inertia about the centre [kg m2] in one frame."""

    kg: float
    centre: Triple
    tensor: Matrix

    def seen_from(self, frame: Rigid) -> Mass:
        """Return the mass in the parent frame."""
        return Mass(self.kg, frame.apply(self.centre), frame.turned(self.tensor))


def sum_masses(masses: Sequence[Mass]) -> Mass:
    """Return the sum of masses in one frame (Huygens and Steiner).

    Parameters
    ----------
    masses
        At least one, each > 0.
    """
    kg = sum(mass.kg for mass in masses)
    x, y, z = (sum(mass.kg * mass.centre[axis] for mass in masses) / kg for axis in range(3))
    total = [[0.0] * 3 for _ in range(3)]
    for mass in masses:
        away = (mass.centre[0] - x, mass.centre[1] - y, mass.centre[2] - z)
        square = sum(value * value for value in away)
        for i in range(3):
            for j in range(3):
                shift = (square if i == j else 0.0) - away[i] * away[j]
                total[i][j] += mass.tensor[i][j] + mass.kg * shift
    (a, b, c), (d, e, f), (g, h, i9) = total
    return Mass(kg, (x, y, z), ((a, b, c), (d, e, f), (g, h, i9)))


def _get_column(rows: Matrix, number: int) -> Triple:
    return (rows[0][number], rows[1][number], rows[2][number])


MOST_NUMBER = 1_000_000.0
"""Greatest magnitude of a number without its own limit."""

MOST_LENGTH_M = 100.0
"""Greatest coordinate and extent [m]."""

# Restricted to ASCII; runs in linear time.
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INFINITE = re.compile(r"[+-]?inf(?:inity)?", re.IGNORECASE)


class UrdfError(Exception):
    """A URDF does not describe a supported arm.

    Parameters
    ----------
    key
        Key of the task file at fault: ``model``, ``tip`` or ``home_rad``.
    """

    def __init__(self, message: str, key: str = "model", line: int | None = None) -> None:
        self.key = key
        self.line = line
        super().__init__(message if line is None else f"line {line}: {message}")


def index_by_name(root: Element, tag: str) -> dict[str, Element]:
    """Return the elements with a tag by name.

    Raises
    ------
    UrdfError
        If an element has no name, or two have the same.
    """
    elements: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.attributes.get("name")
        if not name:
            raise UrdfError(f"a <{tag}> has no name", line=element.line)
        if name in elements:
            raise UrdfError(f"two {tag}s are called {name!r}", line=element.line)
        elements[name] = element
    return elements


def read_number(
    element: Element, key: str, default: float | None = None, most: float = MOST_NUMBER
) -> float:
    """Return a number of an element's attribute.

    Parameters
    ----------
    default
        Value if the attribute is missing; None if it is required.
    most
        Greatest magnitude, > 0.

    Raises
    ------
    UrdfError
        If a required attribute is missing, or the value is not a number up to `most`.
    """
    text = element.attributes.get(key)
    if text is None and default is not None:
        return default
    return _parse_bounded(element, key, text, most)


def read_numbers(element: Element, key: str, default: Triple, most: float = MOST_NUMBER) -> Triple:
    """Return three numbers of an element's attribute.

    Raises
    ------
    UrdfError
        If the value is not three numbers up to `most`.
    """
    text = element.attributes.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) != 3:
        raise UrdfError(f"{key}={text[:40]!r} are not three numbers", line=element.line)
    x, y, z = (_parse_bounded(element, key, word, most) for word in words)
    return (x, y, z)


def read_pose(element: Element) -> Rigid:
    """Return the pose in the <origin> of an element; identity without one."""
    origin = element.first("origin")
    if origin is None:
        return Rigid()
    zero = (0.0, 0.0, 0.0)
    return Rigid.of(
        read_numbers(origin, "xyz", zero, MOST_LENGTH_M), read_numbers(origin, "rpy", zero)
    )


def _parse_bounded(element: Element, key: str, text: str | None, most: float) -> float:
    # `float` also accepts other scripts' digits and underscores, unlike other readers of URDF.
    digits = "" if text is None else text.strip(" \t\r\n")
    value = float(digits) if _DECIMAL.fullmatch(digits) else math.nan
    if not math.isfinite(value):
        given = "nothing" if text is None else repr(text[:40])
        words = f"<{element.tag}> needs a number as {key!r}, and has {given}"
        raise UrdfError(words, line=element.line)
    if abs(value) > most:
        words = f"<{element.tag}> has {value:g} as {key!r}, where {most:,g} is the most"
        if most == MOST_LENGTH_M:
            words += " [m]; is the file in millimetres? An origin is in metres"
        raise UrdfError(words, line=element.line)
    return value


_ONE_URDF: Triple = (1.0, 1.0, 1.0)

ReadMesh = Callable[[str, Triple], Sequence[tuple[Triple, ...]]]
"""Reads the corners of the convex pieces of a mesh [m], by name and scale; none if it is empty."""

# A URDF has no accelerations: a joint takes this long to reach its greatest speed [s].
_SPEEDING_UP_S = 0.25
# Speeds of joints without one [rad/s] and [m/s].
_ASSUMED_RAD_PER_S, _ASSUMED_M_PER_S = 1.0, 0.25
# Travel of a prismatic joint without an end, to that side [m].
_ASSUMED_TRAVEL_M = 5.0
# Density of a link whose inertia no body has [kg/m3].
_ASSUMED_KG_PER_M3 = 1_500.0
MOST_JOINTS = 8
"""Greatest number of moving joints from the base to the tip."""

LEAST_JOINTS = 4
"""Least number of them."""

_MOST_LINKS = 200
# Limit for the whole arm: each pair of links is tested for contact.
_MOST_SHAPES = 400
# A slower joint would take months for a turn.
_LEAST_SPEED = 1e-6
_FULL_TURN = 2 * math.pi
# Larger limits [rad] and speeds [rad/s] are rather degrees.
_DOUBTED_RAD, _DOUBTED_RAD_PER_S = 4 * math.pi + 0.1, 40.0
_MOVING = ("revolute", "continuous", "prismatic")
# A base on such a joint is placed by the task.
_LOOSE = ("floating", "planar")
# Elements of xacro, except macros, that change a file.
_XACRO_WORDS = frozenset(
    {"include", "if", "unless", "insert_block", "call", "element", "attribute"}
)
_TIP_NAMES = (
    "tool0",
    "flange",
    "ee_link",
    "link_ee",
    "end_effector",
    "tcp",
    "tool_link",
    "tool_frame",
    "tool",
    "ee",
)


def read_urdf(
    content: bytes, tip: str | None, home_rad: Sequence[float] | None, read_mesh: ReadMesh
) -> ArmDescription:
    """Return the arm that a URDF describes.

    Parameters
    ----------
    content
        The file, without xacro that is used.
    tip
        Link that holds hands: z of its frame points out of it.
    home_rad
        Home posture [rad], of prismatic joints [m]; None for a posture that `find_home` finds.

    Raises
    ------
    UrdfError
        If the file does not describe a supported arm.
    """
    return parse_urdf(content, read_mesh).arm(tip, home_rad)


def parse_urdf(content: bytes, read_mesh: ReadMesh) -> UrdfTree:
    """Return the links and joints of a URDF.

    Raises
    ------
    UrdfError
        If the file is not a URDF, or its tree is broken.
    """
    root = parse_root(content)
    xacro = find_xacro(root)
    if xacro.first_use is not None:
        line, used = xacro.first_use
        raise UrdfError(f"{used} is xacro, a language of macros; expand it first", line=line)
    if root.tag != "robot":
        raise UrdfError(f"its root is <{root.tag}>, where a URDF has <robot>", line=root.line)
    tree = UrdfTree(root, read_mesh)
    if xacro.unused:
        several = xacro.unused > 1
        count = f"{xacro.unused} xacro element{'s' if several else ''}"
        tree.notes.append(
            f"{count} passed over, because nothing uses {'them' if several else 'it'}"
        )
    return tree


def parse_root(content: bytes) -> Element:
    """Return the root of an XML file.

    Raises
    ------
    UrdfError
        If it is not XML, or too large.
    """
    try:
        return parse_xml(content)
    except XmlError as error:
        raise UrdfError(str(error), line=error.line) from None


@dataclass(frozen=True, slots=True)
class Xacro:
    """Elements of xacro in a file.

    Parameters
    ----------
    first_use
        Line and text of the first element or attribute that needs expansion, if any.
    unused
        Number of definitions that nothing uses.
    """

    first_use: tuple[int, str] | None
    unused: int


def find_xacro(root: Element) -> Xacro:
    """Return the use of xacro in a file; a declared name space alone does not count."""
    prefixes = {
        key.removeprefix("xmlns:") + ":"
        for key, value in root.attributes.items()
        if key.startswith("xmlns:") and "xacro" in value
    } | {"xacro:"}
    definitions = {prefix + name for prefix in prefixes for name in ("property", "arg", "macro")}
    unused, uses = 0, []
    waiting = [root]
    macros = {
        element.attributes.get("name") for element in root.children if element.tag in definitions
    }
    includes = any(
        element.tag in {f"{prefix}include" for prefix in prefixes} for element in root.children
    )
    while waiting:
        element = waiting.pop()
        if element.tag in definitions:
            unused += 1
            continue
        if element.tag.startswith(tuple(prefixes)):
            # A call of a macro that the file does not have was left over by an expansion.
            name = element.tag.partition(":")[2]
            if not includes and name not in macros and name not in _XACRO_WORDS:
                unused += 1
                continue
            uses.append((element.line, f"<{element.tag}>"))
        for value in element.attributes.values():
            start = min((value.find(mark) for mark in ("${", "$(") if mark in value), default=-1)
            if start >= 0:
                uses.append((element.line, value[start : start + 40]))
        waiting += element.children
    return Xacro(min(uses, default=None), unused)


def read_shapes(
    link: Element, frame: Rigid, read_mesh: ReadMesh, notes: Notes | None = None
) -> list[LinkShape]:
    """Return the collision shapes of a link, or its visual ones if it has none.

    Parameters
    ----------
    frame
        Frame of the link, relative to the joint that moves it.

    Raises
    ------
    UrdfError
        If a shape is not supported.
    """
    notes = Notes() if notes is None else notes
    name = link.attributes["name"]
    elements = list(link.all("collision"))
    is_visual = not elements
    if is_visual:
        elements = list(link.all("visual"))
        if elements:
            notes.visual.append(name)
    shapes: list[LinkShape] = []
    for element in elements:
        geometry = element.first("geometry")
        shape = geometry.children[0] if geometry is not None and geometry.children else None
        if shape is None:
            raise UrdfError(f"a <{element.tag}> of link {name!r} has no shape", line=element.line)
        try:
            own = _read_shape(shape, frame.then(read_pose(element)), read_mesh)
        except ValueError as error:
            raise UrdfError(str(error).rstrip("."), line=shape.line) from None
        except UrdfError:
            # A URDF without collision shapes is whole without its pictures, too.
            if not (is_visual and shape.tag == "mesh"):
                raise
            notes.unread.append(name)
            continue
        if not own:
            what = shape.attributes.get("filename", f"<{shape.tag}>")
            notes.empty.append(f"{name} ({what[-60:]})")
        shapes += own
    return shapes


def _read_shape(shape: Element, frame: Rigid, read_mesh: ReadMesh) -> list[LinkShape]:
    if shape.tag == "box":
        sides = read_numbers(shape, "size", (0.0, 0.0, 0.0), MOST_LENGTH_M)
        if min(sides) < 0:
            raise ValueError(f"a box has the size {sides}")
        if min(sides) == 0:
            return []
        corners = [
            frame.apply((a * sides[0] / 2, b * sides[1] / 2, c * sides[2] / 2))
            for a, b, c in product((-1, 1), repeat=3)
        ]
        return [Hull(tuple(corners))]
    if shape.tag == "sphere":
        radius_m = read_number(shape, "radius", most=MOST_LENGTH_M)
        return [Capsule(frame.origin, frame.origin, radius_m)] if radius_m else []
    if shape.tag in ("cylinder", "capsule"):
        half_m = read_number(shape, "length", most=MOST_LENGTH_M) / 2
        ends = frame.apply((0.0, 0.0, -half_m)), frame.apply((0.0, 0.0, half_m))
        radius_m = read_number(shape, "radius", most=MOST_LENGTH_M)
        if not radius_m or (not half_m and shape.tag == "cylinder"):
            return []
        return [Rod(*ends, radius_m) if shape.tag == "cylinder" else Capsule(*ends, radius_m)]
    if shape.tag == "mesh":
        name = shape.attributes.get("filename", "")
        pieces = read_mesh(name, read_numbers(shape, "scale", _ONE_URDF))
        return [Hull(tuple(frame.apply(corner) for corner in corners)) for corners in pieces]
    raise ValueError(
        f"<{shape.tag}> is no shape of a link; give box, cylinder, capsule, sphere or mesh"
    )


@dataclass
class Notes:
    """Names of elements about which a reader made an assumption, by assumption."""

    visual: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    empty: list[str] = field(default_factory=list)
    massless: list[str] = field(default_factory=list)
    impossible: list[str] = field(default_factory=list)
    speeds: list[str] = field(default_factory=list)
    torques: list[str] = field(default_factory=list)
    locked: list[str] = field(default_factory=list)
    still: list[str] = field(default_factory=list)
    beyond: list[str] = field(default_factory=list)
    followers: list[str] = field(default_factory=list)
    degrees: list[str] = field(default_factory=list)
    fast: list[str] = field(default_factory=list)
    strays: list[str] = field(default_factory=list)
    loose: list[str] = field(default_factory=list)
    mimics: list[str] = field(default_factory=list)
    unlimited: list[str] = field(default_factory=list)
    endless: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def sentences(self) -> tuple[str, ...]:
        """Return one clause for each assumption."""
        texts = (
            (self.visual, "no <collision> of {}: the <visual> shapes are used"),
            (self.unread, "unreadable <visual> meshes of {}: no shape"),
            (self.empty, "no volume in a shape of {}: left out"),
            (
                self.massless,
                "no mass of {}: weights are not checked, and engines take "
                f"{_ASSUMED_KG_PER_M3:,.0f} kg/m3",
            ),
            (self.impossible, "an inertia that no body has, of {}: that of a ball is used"),
            (
                self.speeds,
                f"no speed of {{}}: {_ASSUMED_RAD_PER_S:g} rad/s, or {_ASSUMED_M_PER_S:g} m/s, is "
                "assumed",
            ),
            (self.torques, "no effort of {}: torques are not checked"),
            (self.locked, "no range of {}: locked"),
            (self.still, "joints beside the chain stand still: {}"),
            (self.loose, "joints between base and tip stand still at 0: {}"),
            (self.strays, "links that no joint leads to from the base, {}: left out"),
            (self.mimics, "<mimic> of {}: passed over"),
            (
                self.endless,
                f"travel without an end of {{}}: {_ASSUMED_TRAVEL_M:g} m to that side are assumed",
            ),
            (self.unlimited, "limits beyond 1,000,000 rad of {}: none, as of a continuous joint"),
            (
                self.beyond,
                "joints beyond the tip, {}: left out with everything on them, because tools are "
                "part of the task",
            ),
            (
                self.degrees,
                "limits of {} rad: are these degrees? One turn either way at most is used",
            ),
            (self.fast, "speeds of {} rad/s: are these degrees per second?"),
            (self.followers, "shapes that follow a joint of the chain, {}: left out"),
        )
        sentences = [words.format(_join_names(names)) for names, words in texts if names]
        return (*sentences, *self.doubts)


_MOST_NAMES = 8


def _join_names(names: Sequence[str]) -> str:
    shown = list(dict.fromkeys(names))
    more = len(shown) - _MOST_NAMES
    return ", ".join(shown[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


@dataclass(frozen=True, slots=True)
class _Segment:
    """A joint of the chain as read: moving, or at rest in `still`."""

    element: Element
    still: Rigid | None
    follows: tuple[str, float, float] | None = None


class UrdfTree:
    """Links and joints of a file, by name.

    Attributes
    ----------
    notes
        Sentences on the file that hold for any tip.
    """

    def __init__(self, root: Element, read_mesh: ReadMesh) -> None:
        self.name = root.attributes.get("name") or "robot"
        self.read_mesh = read_mesh
        self.notes: list[str] = []
        self.links = index_by_name(root, "link")
        self.joints = index_by_name(root, "joint")
        self.above: dict[str, Element] = {}
        self.below: dict[str, list[Element]] = {}
        if len(self.links) > _MOST_LINKS:
            raise UrdfError(f"it has more than {_MOST_LINKS} links; keep the arm alone")
        shapes = sum(1 for link in self.links.values() for _ in link.all("collision"))
        if shapes > _MOST_SHAPES:
            raise UrdfError(
                f"its links have {shapes:,} collision shapes, where {_MOST_SHAPES} are the most; "
                "give fewer and simpler ones"
            )
        faults = _Faults()
        for name, joint in self.joints.items():
            faults.collect(self._check_joint, name, joint)
        faults.settle()

    def arm(self, tip: str | None, home_rad: Sequence[float] | None) -> ArmDescription:
        """Return the arm that ends at a link; see `read_urdf`."""
        chain = self._chain(self._tip(tip))
        notes, faults = Notes(), _Faults()
        for element in chain:
            faults.collect(_check_mimic, self.joints, element)
        faults.collect(self._leave_out_strays, _get_end(chain[0], "parent"), notes)
        _refuse_blank_limits(chain)
        segments = [
            segment
            for joint in chain
            if (segment := faults.collect(_read_segment, joint, notes)) is not None
        ]
        faults.settle()
        segments = self._resolve_leaders(segments)
        moving = [segment for segment in segments if segment.still is None]
        freedoms = sum(segment.follows is None for segment in moving)
        if not LEAST_JOINTS <= freedoms <= MOST_JOINTS:
            verb = "joint moves" if freedoms == 1 else "joints move"
            raise UrdfError(
                f"{freedoms} {verb} between its base and {tip!r}; an arm has "
                f"{LEAST_JOINTS} to {MOST_JOINTS}",
                key="tip",
            )
        bodies = _Bodies(self, segments, notes, faults)
        own_joints: list[Joint] = []
        parts = [bodies.collect(_get_end(chain[0], "parent"), is_last=False)]
        before = Rigid()
        for segment in segments:
            before = before.then(read_pose(segment.element))
            if segment.still is not None:
                before = before.then(segment.still)
                continue
            parts.append(bodies.collect(_get_end(segment.element, "child"), segment is moving[-1]))
            inertia = faults.collect(_build_inertia, segment.element, parts[-1][0], notes)
            joint = faults.collect(_build_joint, segment.element, before.transform, inertia, notes)
            own_joints += [] if joint is None else [joint]
            before = Rigid()
        faults.settle()
        names = [joint.name for joint in own_joints]
        own_joints = _couple(
            own_joints,
            {
                names.index(segment.element.attributes["name"]): (
                    names.index(segment.follows[0]),
                    *segment.follows[1:],
                )
                for segment in moving
                if segment.follows is not None
            },
        )
        shapes = tuple(tuple(own_shapes) for _, own_shapes in parts)
        return self._described(own_joints, before.transform, home_rad, shapes, notes)

    def _described(
        self,
        joints: list[Joint],
        tip: Transform,
        home_rad: Sequence[float] | None,
        shapes: tuple[tuple[LinkShape, ...], ...],
        notes: Notes,
    ) -> ArmDescription:
        freedoms = sum(joint.follows is None for joint in joints)
        if home_rad is not None:
            if len(home_rad) != freedoms:
                message = f"{len(home_rad)} angles, where the arm has {freedoms} joints"
                raise UrdfError(message, key="home_rad")
            own = iter(home_rad)
            home_rad = [0.0 if joint.follows is not None else next(own) for joint in joints]
        near = [min(max(0.0, joint.low_rad), joint.high_rad) for joint in joints]
        start = _follow(joints, near if home_rad is None else home_rad)
        if freedoms < 6:
            notes.doubts.append(
                f"{freedoms} joints move, so the hand takes only some orientations at a place"
            )
        arm = ArmDescription(
            self.name,
            tuple(joints),
            tip,
            start,
            shapes if any(shapes) else (),
            assumptions=(*self.notes, *notes.sentences()),
        )
        # Imports numpy and scipy.
        from skillplan.robots.home_posture import find_home

        posed = find_home(arm)
        return posed if home_rad is None else replace(posed, home_rad=start)

    def _resolve_leaders(self, segments: Sequence[_Segment]) -> list[_Segment]:
        """Return the chain with its mimic joints bound to the joint that moves them in the end."""
        by_name = {segment.element.attributes["name"]: segment for segment in segments}
        resolved = []
        for segment in segments:
            joint = segment.element
            factor, offset, leader = 1.0, 0.0, joint.attributes["name"]
            seen: set[str] = set()
            mimic = joint.first("mimic")
            while mimic is not None and leader not in seen:
                seen.add(leader)
                offset += factor * read_number(mimic, "offset", 0.0)
                factor *= read_number(mimic, "multiplier", 1.0)
                leader = mimic.attributes.get("joint", "")
                mimic = self.joints[leader].first("mimic") if leader in self.joints else None
            if leader == joint.attributes["name"] or segment.still is not None:
                resolved.append(segment)
            elif leader in by_name and by_name[leader].still is None and factor:
                resolved.append(_Segment(joint, None, (leader, factor, offset)))
            else:
                resolved.append(_Segment(joint, _rest(self.joints, joint)))
        return resolved

    def list_tips(self) -> list[tuple[str, int]]:
        """Return possible tips and the number of moving joints to each, the likeliest first.

        A tip is a link after which nothing moves, or several joints move side by side, as fingers
        do. Links with the usual names of a flange come first.
        """
        tips = []
        for link in self.links:
            joints = self.count_joints(link)
            if LEAST_JOINTS <= joints <= MOST_JOINTS and self._ends_chain(link):
                tips.append((link, joints))
        # A flange is a mere frame.
        tips.sort(
            key=lambda tip: (
                _rank_name(tip[0]),
                self._is_finger(tip[0]),
                -tip[1],
                self.links[tip[0]].first("collision") is not None,
                tip[0],
            )
        )
        return tips

    def count_joints(self, link: str) -> int:
        """Return the number of moving joints from the base to a link."""
        joints = steps = 0
        above = self.above.get(link)
        while above is not None and steps <= len(self.joints):
            joints += above.attributes["type"] in _MOVING
            above = self.above.get(_get_end(above, "parent"))
            steps += 1
        return joints

    def _is_finger(self, link: str) -> bool:
        """Return whether several joints move side by side before a link, as fingers do."""
        above = self.above.get(link)
        while above is not None and above.attributes["type"] not in _MOVING:
            above = self.above.get(_get_end(above, "parent"))
        if above is None:
            return False
        body = _get_end(above, "parent")
        return sum(self.moves(joint) for joint in self.below.get(body, ())) > 1

    def _ends_chain(self, link: str) -> bool:
        """Return whether a link is called as a flange, or nothing hangs on it, or fingers do."""
        moving = [joint for joint in self.below.get(link, ()) if self.moves(joint)]
        others = [joint for joint in self.below.get(link, ()) if not self.moves(joint)]
        return len(moving) > 1 or _rank_name(link) < len(_TIP_NAMES) or not (moving or others)

    def moves(self, joint: Element) -> bool:
        """Return whether a joint moves, or any joint after it."""
        waiting, steps = [joint], 0
        while waiting and steps <= len(self.joints):
            here = waiting.pop()
            steps += 1
            if here.attributes["type"] in _MOVING:
                return True
            waiting += self.below.get(_get_end(here, "child"), ())
        return False

    def _check_joint(self, name: str, joint: Element) -> None:
        kind = joint.attributes.get("type", "")
        if kind not in (*_MOVING, *_LOOSE, "fixed"):
            raise UrdfError(
                f"joint {name!r} is {kind or 'of no type'}; an arm's joints are revolute, "
                "continuous, prismatic or fixed",
                line=joint.line,
            )
        for end in ("parent", "child"):
            element = joint.first(end)
            link = None if element is None else element.attributes.get("link")
            if link == "world" and end == "parent" and link not in self.links:
                self.links[link] = Element("link", {"name": link}, joint.line)
                self.notes.append(f"link {link!r} is not described: taken as a mere frame")
            if link is None or link not in self.links:
                raise UrdfError(f"joint {name!r} has no {end} link that exists", line=joint.line)
            if end == "child":
                if link in self.above:
                    raise UrdfError(
                        f"link {link!r} hangs on two joints, {name!r} and "
                        f"{self.above[link].attributes['name']!r}: a loop, which no arm here has",
                        line=joint.line,
                    )
                self.above[link] = joint
        self.below.setdefault(_get_end(joint, "parent"), []).append(joint)

    def _leave_out_strays(self, base: str, notes: Notes) -> None:
        """Note the links that nothing joins to the base.

        Raises
        ------
        UrdfError
            If one has a shape: its place is unknown.
        """
        for root in self.links:
            if root in self.above or root == base:
                continue
            notes.strays.append(root)
            waiting = [root]
            while waiting:
                link = self.links[waiting.pop(0)]
                name = link.attributes["name"]
                waiting += [_get_end(joint, "child") for joint in self.below.get(name, ())]
                if link.first("collision") or link.first("visual"):
                    raise UrdfError(
                        f"no joint leads from {base!r} to link {name!r}, so its place is unknown; "
                        f"join {root!r} by a fixed joint, or take it out",
                        line=link.line,
                    )

    def _tip(self, tip: str | None) -> str:
        if tip is not None and tip in self.links:
            return tip
        likely = [link for link, _ in self.list_tips()]
        if tip is None:
            names = f", such as {_join_names(likely[:3])}" if likely else ""
            raise UrdfError(f"give 'tip', the link that hands are fixed to{names}", key="model")
        ends = likely or [link for link in self.links if link not in self.below]
        ends = ends or list(self.links)
        raise UrdfError(f"there is no link {tip!r}; it ends in {', '.join(ends[:6])}", "tip")

    def _chain(self, tip: str) -> list[Element]:
        """Return the joints from the base to a link."""
        chain: list[Element] = []
        link = tip
        while link in self.above:
            joint = self.above[link]
            if joint in chain:
                words = f"joint {joint.attributes['name']!r} is part of a loop, which no arm has"
                raise UrdfError(words, line=joint.line)
            chain.append(joint)
            link = _get_end(joint, "parent")
        if not chain:
            raise UrdfError(f"nothing leads to {tip!r}; give the link at the arm's end", key="tip")
        return chain[::-1]


def _rank_name(link: str) -> int:
    """Return the place of a link's name among the usual ones of a flange, the likeliest first."""
    own = link.lower()
    ranks = [
        rank for rank, name in enumerate(_TIP_NAMES) if own == name or own.endswith("_" + name)
    ]
    return min(ranks, default=len(_TIP_NAMES))


P = ParamSpec("P")
T = TypeVar("T")


class _Faults:
    """Faults of a file, which are raised together."""

    def __init__(self) -> None:
        self.errors: list[UrdfError] = []

    def collect(
        self, function: Callable[P, T], *arguments: P.args, **keywords: P.kwargs
    ) -> T | None:
        """Return the result of a function, or None if it raises a fault, which is kept."""
        try:
            return function(*arguments, **keywords)
        except UrdfError as error:
            self.errors.append(error)
            return None

    def settle(self) -> None:
        """Raise the faults in one message, if there are any."""
        if not self.errors:
            return
        lines = list(dict.fromkeys(str(error) for error in self.errors))
        if len(lines) == 1:
            raise self.errors[0]
        shown = lines[:_MOST_NAMES]
        more = f"; and {len(lines) - len(shown)} more" if len(lines) > len(shown) else ""
        raise UrdfError(f"{len(lines)} faults: {'; '.join(shown)}{more}", self.errors[0].key)


class _Bodies:
    """Masses and shapes of what moves as one, by its first link."""

    def __init__(
        self, tree: UrdfTree, segments: Sequence[_Segment], notes: Notes, faults: _Faults
    ) -> None:
        self.tree, self.notes, self.faults = tree, notes, faults
        self._chain = {segment.element.attributes["name"]: segment for segment in segments}

    def collect(self, link: str, is_last: bool) -> tuple[list[Mass], list[LinkShape]]:
        """Return masses and shapes of a link and of everything fixed to it.

        Parameters
        ----------
        is_last
            True for the body that holds the hand: joints after it are beyond the tip.
        """
        masses: list[Mass] = []
        shapes: list[LinkShape] = []
        waiting = [(link, Rigid())]
        while waiting:
            name, frame = waiting.pop(0)
            element = self.tree.links[name]
            masses += [
                mass.seen_from(frame)
                for mass in self.faults.collect(_read_masses, element, self.notes) or ()
            ]
            own = self.faults.collect(read_shapes, element, frame, self.tree.read_mesh, self.notes)
            shapes += own or ()
            for joint in self.tree.below.get(name, ()):
                still = self._still(joint, is_last)
                if still is not None:
                    placed = frame.then(read_pose(joint)).then(still)
                    waiting.append((_get_end(joint, "child"), placed))
        return masses, shapes

    def _still(self, joint: Element, is_last: bool) -> Rigid | None:
        """Return the motion of a joint at rest; None if its link moves or is left out."""
        name = joint.attributes["name"]
        if name in self._chain:
            return self._chain[name].still
        if is_last and self.tree.moves(joint):
            self.notes.beyond += self._list_moving(joint)
            return None
        kind = joint.attributes["type"]
        if kind not in _MOVING:
            if kind in _LOOSE:
                self.notes.still.append(f"{name} ({kind}) at 0")
            return Rigid()
        if fault := _find_mimic_fault(self.tree.joints, joint):
            self.notes.mimics.append(f"{name} ({fault})")
        leader = _find_leader(self.tree.joints, joint)
        if leader in self._chain and self._chain[leader].still is None:
            self.notes.followers.append(name)
            return None
        value = self.faults.collect(_compute_rest, self.tree.joints, joint)
        if value is None:
            return None
        unit = "m" if kind == "prismatic" else "rad"
        self.notes.still.append(f"{name} at {value:.4g} {unit}")
        return self.faults.collect(_move, joint, value)

    def _list_moving(self, joint: Element) -> list[str]:
        moving, waiting = [], [joint]
        while waiting:
            here = waiting.pop(0)
            if here.attributes["type"] in _MOVING:
                moving.append(here.attributes["name"])
            waiting += self.tree.below.get(_get_end(here, "child"), ())
        return moving


def _find_leader(joints: Mapping[str, Element], joint: Element) -> str:
    """Return the name of the joint that a joint follows in the end, or its own."""
    seen: set[str] = set()
    while True:
        name = joint.attributes["name"]
        mimic = joint.first("mimic")
        leader = None if mimic is None else joints.get(mimic.attributes.get("joint", ""))
        if leader is None or name in seen:
            return name
        seen.add(name)
        joint = leader


def _rest(joints: Mapping[str, Element], joint: Element) -> Rigid:
    """Return the motion of a joint outside the chain: at 0, its nearest limit, or as its leader."""
    return _move(joint, _compute_rest(joints, joint))


def _find_mimic_fault(joints: Mapping[str, Element], joint: Element) -> str:
    """Return why a joint that follows others follows none in the end; nothing if it does."""
    names = [joint.attributes["name"]]
    mimic = joint.first("mimic")
    while mimic is not None:
        leader = mimic.attributes.get("joint", "")
        if leader not in joints:
            return f"there is no joint {leader!r}"
        if leader in names:
            return f"a loop: {' follows '.join([*names, leader])}"
        names.append(leader)
        mimic = joints[leader].first("mimic")
    return ""


def _check_mimic(joints: Mapping[str, Element], joint: Element) -> None:
    """Raise if a joint of the chain follows none in the end."""
    if joint.attributes["type"] in _MOVING and (fault := _find_mimic_fault(joints, joint)):
        words = f"<mimic> of joint {joint.attributes['name']!r}: {fault}"
        raise UrdfError(words, line=joint.line)


def _compute_rest(joints: Mapping[str, Element], joint: Element) -> float:
    """Return the angle [rad] or stroke [m] at which a joint beside the chain stands."""
    mimic = joint.first("mimic")
    if mimic is not None and not _find_mimic_fault(joints, joint):
        factor = read_number(mimic, "multiplier", 1.0)
        offset = read_number(mimic, "offset", 0.0)
        return factor * _compute_rest(joints, joints[mimic.attributes["joint"]]) + offset
    limit = joint.first("limit")
    if limit is None or joint.attributes["type"] == "continuous":
        return 0.0
    low, high = _read_limits(joint, limit)
    return min(max(0.0, low), high) if low <= high else 0.0


def _move(joint: Element, value: float) -> Rigid:
    """Return the motion of a joint by an angle [rad] or a stroke [m]."""
    if value == 0.0:
        return Rigid()
    axis = _read_axis(joint)
    if joint.attributes["type"] == "prismatic":
        return Rigid(origin=(axis[0] * value, axis[1] * value, axis[2] * value))
    return Rigid.about(axis, value)


def _read_axis(joint: Element) -> Triple:
    """Return the unit vector of a joint's axis."""
    axis = joint.first("axis")
    direction = (1.0, 0.0, 0.0) if axis is None else read_numbers(axis, "xyz", (1.0, 0.0, 0.0))
    length = math.hypot(*direction)
    if length < 1e-9:
        name = joint.attributes["name"]
        raise UrdfError(f"joint {name!r} has an axis of length 0", line=joint.line)
    return (direction[0] / length, direction[1] / length, direction[2] / length)


def _refuse_blank_limits(chain: Sequence[Element]) -> None:
    """Raise if joints have only zeros as limits, which an exporter left to be filled in."""
    blank = []
    for joint in chain:
        limit = joint.first("limit")
        if joint.attributes["type"] not in ("revolute", "prismatic") or limit is None:
            continue
        keys = ("lower", "upper", "velocity", "effort")
        if all(_is_zero(limit.attributes.get(key, "0")) for key in keys):
            blank.append(joint)
    if blank:
        names = _join_names([joint.attributes["name"] for joint in blank])
        verb = "are" if len(blank) > 1 else "is"
        raise UrdfError(
            f"range, speed and torque of {names} {verb} 0; fill in lower, upper, velocity and "
            "effort of <limit>",
            line=blank[0].line,
        )


def _is_zero(text: str) -> bool:
    return bool(_DECIMAL.fullmatch(text.strip())) and float(text) == 0.0


def _read_segment(joint: Element, notes: Notes) -> _Segment:
    """Return a joint of the chain, at rest if it cannot move."""
    name, kind = joint.attributes["name"], joint.attributes["type"]
    if kind == "fixed":
        return _Segment(joint, Rigid())
    if kind in _LOOSE:
        notes.loose.append(f"{name} ({kind})")
        return _Segment(joint, Rigid())
    limit = joint.first("limit")
    if kind == "continuous":
        return _Segment(joint, None)
    if limit is None:
        raise UrdfError(f"joint {name!r} has no <limit>; give one", line=joint.line)
    low, high = _read_limits(joint, limit)
    if low == high:
        unit = "m" if kind == "prismatic" else "rad"
        notes.locked.append(f"{name} (at {low:g} {unit})")
        return _Segment(joint, _move(joint, low))
    return _Segment(joint, None)


def _read_limit(limit: Element, key: str) -> float:
    """Return a number of <limit>, which may be infinite; 0 without one."""
    text = limit.attributes.get(key, "").strip(" \t\r\n")
    if _INFINITE.fullmatch(text):
        return -math.inf if text.startswith("-") else math.inf
    return read_number(limit, key, 0.0, math.inf)


def _read_limits(joint: Element, limit: Element) -> tuple[float, float]:
    """Return the range of a joint [rad] or [m]; an end that no joint reaches is infinite."""
    most = MOST_LENGTH_M if joint.attributes["type"] == "prismatic" else MOST_NUMBER
    ends = []
    for key, sign in (("lower", -1.0), ("upper", 1.0)):
        end = _read_limit(limit, key)
        ends.append(sign * math.inf if sign * end > most else end)
        if -sign * end > most:
            words = f"<limit> has {end:g} as {key!r}, where {most:,g} is the most"
            raise UrdfError(words, line=limit.line)
    return ends[0], ends[1]


def _build_joint(
    joint: Element, placement: Transform, link: LinkInertia | None, notes: Notes
) -> Joint:
    name, kind = joint.attributes["name"], joint.attributes["type"]
    limit = joint.first("limit") or Element("limit", {}, joint.line)
    if kind == "continuous":
        low, high = -_FULL_TURN, _FULL_TURN
    else:
        low, high = _read_limits(joint, limit)
        if not low < high:
            words = f"joint {name!r} has lower {low:g}, where it must be below upper, {high:g}"
            raise UrdfError(words, line=limit.line)
    is_prismatic = kind == "prismatic"
    if math.isinf(low) or math.isinf(high):
        (notes.endless if is_prismatic else notes.unlimited).append(name)
        most = _ASSUMED_TRAVEL_M if is_prismatic else _FULL_TURN
        low = min(-most, high - most) if math.isinf(low) else low
        high = max(most, low + most) if math.isinf(high) else high
    speed = _read_limit(limit, "velocity")
    if 0 < speed < _LEAST_SPEED:
        words = f"joint {name!r} turns at {speed:g} rad/s; {_LEAST_SPEED:g} is the least"
        raise UrdfError(words, line=limit.line)
    if speed == 0.0 or speed > MOST_NUMBER:
        notes.speeds.append(name if speed == 0.0 else f"{name} (infinite)")
        speed = _ASSUMED_M_PER_S if is_prismatic else _ASSUMED_RAD_PER_S
    effort = _read_limit(limit, "effort")
    if effort == 0.0 or math.isinf(effort):
        notes.torques.append(name if effort == 0.0 else f"{name} (infinite)")
        effort = 0.0
    if not is_prismatic and max(abs(low), abs(high)) > _DOUBTED_RAD:
        notes.degrees.append(f"{name} ({low:g} to {high:g})")
        # More than a turn either way reaches no other place.
        low, high = max(low, -_FULL_TURN), min(high, _FULL_TURN)
    if not is_prismatic and speed > _DOUBTED_RAD_PER_S:
        notes.fast.append(f"{name} ({speed:g})")
    try:
        return Joint(
            name,
            placement,
            low,
            high,
            speed,
            speed / _SPEEDING_UP_S,
            # An effort of 0 is an unknown one.
            effort or None,
            link,
            _read_axis(joint),
            is_prismatic,
        )
    except ValueError as error:
        raise UrdfError(str(error).rstrip("."), line=limit.line) from None


def _follow(joints: Sequence[Joint], home_rad: Sequence[float]) -> tuple[float, ...]:
    """Return a posture with each following joint where its leader puts it."""
    return tuple(
        angle
        if joint.follows is None
        else joint.follows[1] * home_rad[joint.follows[0]] + joint.follows[2]
        for joint, angle in zip(joints, home_rad, strict=True)
    )


def _couple(
    joints: Sequence[Joint], followers: Mapping[int, tuple[int, float, float]]
) -> list[Joint]:
    """Return joints with followers, and leaders that keep followers within their limits.

    Raises
    ------
    UrdfError
        If a leader has no room left.
    """
    coupled = list(joints)
    for number, (leader, factor, offset) in followers.items():
        follower, own = joints[number], coupled[leader]
        ends = sorted((limit - offset) / factor for limit in (follower.low_rad, follower.high_rad))
        low, high = max(own.low_rad, ends[0]), min(own.high_rad, ends[1])
        if not low < high:
            raise UrdfError(
                f"joint {follower.name!r} follows {own.name!r}, and no position is within the "
                "limits of both"
            )
        coupled[leader] = replace(own, low_rad=low, high_rad=high)
    for number, (leader, factor, offset) in followers.items():
        own = coupled[leader]
        ends = sorted(factor * limit + offset for limit in (own.low_rad, own.high_rad))
        coupled[number] = replace(
            joints[number], low_rad=ends[0], high_rad=ends[1], follows=(leader, factor, offset)
        )
    return coupled


def _read_masses(link: Element, notes: Notes) -> list[Mass]:
    inertial = link.first("inertial")
    if inertial is None:
        return []
    mass, inertia = inertial.first("mass"), inertial.first("inertia")
    kg = 0.0 if mass is None else read_number(mass, "value")
    if kg == 0.0:
        return []
    name = link.attributes["name"]
    if kg < 0:
        raise UrdfError(f"link {name!r} has a negative mass", line=inertial.line)
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    zeros = (0.0,) * 6
    tensor = zeros if inertia is None else tuple(read_number(inertia, key, 0.0) for key in keys)
    try:
        LinkInertia(kg, (0.0, 0.0, 0.0), tensor)  # type: ignore[arg-type]
    except ValueError:
        notes.impossible.append(name)
        tensor = _compute_ball_tensor(kg)
    xx, yy, zz, xy, xz, yz = tensor
    own = Mass(kg, (0.0, 0.0, 0.0), ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return [own.seen_from(read_pose(inertial))]


def _compute_ball_tensor(mass_kg: float) -> tuple[float, ...]:
    """Return the inertia of a ball of the assumed density [kg m2]."""
    radius_m = (3 * mass_kg / (4 * math.pi * _ASSUMED_KG_PER_M3)) ** (1 / 3)
    own = 0.4 * mass_kg * radius_m**2
    return (own, own, own, 0.0, 0.0, 0.0)


def _build_inertia(joint: Element, masses: list[Mass], notes: Notes) -> LinkInertia | None:
    link = _get_end(joint, "child")
    if not masses:
        notes.massless.append(link)
        return None
    whole = sum_masses(masses)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = whole.tensor
    try:
        return LinkInertia(whole.kg, whole.centre, (xx, yy, zz, xy, xz, yz))
    except ValueError as error:
        raise UrdfError(f"link {link!r}: {str(error).rstrip('.')}", line=joint.line) from None


def _get_end(joint: Element, which: str) -> str:
    element = joint.first(which)
    assert element is not None
    return element.attributes["link"]
