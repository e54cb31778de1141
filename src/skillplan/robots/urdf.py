"""An arm from a URDF: the chain from its base to a named link, with limits, masses and shapes.

The chain must consist of revolute and fixed joints. Other files are refused with a message.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

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
        raise UrdfError(words, line=element.line)
    return value


_ONE_URDF: Triple = (1.0, 1.0, 1.0)


def read_shapes(
    link: Element, frame: Rigid, read_mesh: Callable[[str, Triple], tuple[Triple, ...]]
) -> list[LinkShape]:
    """Return the collision shapes of a link.

    Parameters
    ----------
    frame
        Frame of the link, relative to the joint that moves it.
    read_mesh
        Reads the corners of a mesh's convex hull, by name and scale.

    Raises
    ------
    UrdfError
        If a shape is not supported.
    """
    shapes = []
    for collision in link.all("collision"):
        geometry = collision.first("geometry")
        shape = geometry.children[0] if geometry is not None and geometry.children else None
        if shape is None:
            name = link.attributes["name"]
            raise UrdfError(f"a <collision> of link {name!r} has no shape", line=collision.line)
        try:
            shapes.append(_read_shape(shape, frame.then(read_pose(collision)), read_mesh))
        except ValueError as error:
            raise UrdfError(str(error).rstrip("."), line=shape.line) from None
    return shapes


def _read_shape(
    shape: Element, frame: Rigid, read_mesh: Callable[[str, Triple], tuple[Triple, ...]]
) -> LinkShape:
    if shape.tag == "box":
        sides = read_numbers(shape, "size", (0.0, 0.0, 0.0), MOST_LENGTH_M)
        if min(sides) <= 0:
            raise ValueError(f"a box has the size {sides}")
        corners = [
            frame.apply((a * sides[0] / 2, b * sides[1] / 2, c * sides[2] / 2))
            for a, b, c in product((-1, 1), repeat=3)
        ]
        return Hull(tuple(corners))
    if shape.tag == "sphere":
        return Capsule(frame.origin, frame.origin, read_number(shape, "radius", most=MOST_LENGTH_M))
    if shape.tag == "cylinder":
        half_m = read_number(shape, "length", most=MOST_LENGTH_M) / 2
        ends = frame.apply((0.0, 0.0, -half_m)), frame.apply((0.0, 0.0, half_m))
        return Rod(*ends, read_number(shape, "radius", most=MOST_LENGTH_M))
    if shape.tag == "mesh":
        name = shape.attributes.get("filename", "")
        corners = [
            frame.apply(corner)
            for corner in read_mesh(name, read_numbers(shape, "scale", _ONE_URDF))
        ]
        return Hull(tuple(corners))
    raise ValueError(f"<{shape.tag}> is no shape of a link; give box, cylinder, sphere or mesh")


ReadMesh = Callable[[str, Triple], tuple[Triple, ...]]
"""Reads the corners of a mesh's convex hull [m], by name and scale."""

# A URDF has no accelerations: a joint takes this long to reach its greatest speed [s].
_SPEEDING_UP_S = 0.25
_JOINTS = (6, 7)
_MOST_LINKS = 200
# Limit for the whole arm: each pair of links is tested for contact.
_MOST_SHAPES = 400
# A slower joint would take months for a turn.
_LEAST_SPEED_RAD_PER_S = 1e-6
_FULL_TURN = 2 * math.pi
_MOVING = ("revolute", "continuous")


def read_urdf(
    content: bytes, tip: str | None, home_rad: Sequence[float] | None, read_mesh: ReadMesh
) -> ArmDescription:
    """Return the arm that a URDF describes.

    Parameters
    ----------
    tip
        Link that holds hands: z of its frame points out of it.
    home_rad
        Home posture [rad]; None for angles of 0, or the nearest limit.

    Raises
    ------
    UrdfError
        If the file does not describe a supported arm.
    """
    try:
        root = parse_xml(content)
    except XmlError as error:
        raise UrdfError(str(error), line=error.line) from None
    _refuse_xacro(root)
    if root.tag != "robot":
        raise UrdfError(f"its root is <{root.tag}>, where a URDF has <robot>", line=root.line)
    return _Tree(root, read_mesh).arm(tip, home_rad)


class _Tree:
    """Links and joints of a file, by name."""

    def __init__(self, root: Element, read_mesh: ReadMesh) -> None:
        self.name = root.attributes.get("name") or "robot"
        self.read_mesh = read_mesh
        self.links = index_by_name(root, "link")
        self.joints = index_by_name(root, "joint")
        self.above: dict[str, Element] = {}
        if len(self.links) > _MOST_LINKS:
            raise UrdfError(f"it has more than {_MOST_LINKS} links; keep the arm alone")
        shapes = sum(1 for link in self.links.values() for _ in link.all("collision"))
        if shapes > _MOST_SHAPES:
            raise UrdfError(
                f"its links have {shapes:,} collision shapes, where {_MOST_SHAPES} are the most; "
                "give fewer and simpler ones"
            )
        for name, joint in self.joints.items():
            self._check_joint(name, joint)

    def arm(self, tip: str | None, home_rad: Sequence[float] | None) -> ArmDescription:
        """Return the arm that ends at a link."""
        chain = self._chain(self._tip(tip))
        moving = [joint for joint in chain if joint.attributes["type"] in _MOVING]
        for joint in self.joints.values():
            if joint not in chain and joint.attributes["type"] != "fixed":
                raise UrdfError(
                    f"joint {joint.attributes['name']!r} moves, and is not between base and tip; "
                    "leave it out, or make it fixed",
                    line=joint.line,
                )
        if len(moving) not in _JOINTS:
            raise UrdfError(
                f"{len(moving)} joints move between its base and {tip!r}; an arm has 6 or 7",
                key="tip",
            )
        base = chain[0].first("parent")
        assert base is not None
        bodies = [self._body(base.attributes["link"], Rigid())]
        joints: list[Joint] = []
        before = Rigid()
        for joint in chain:
            before = before.then(read_pose(joint))
            if joint.attributes["type"] == "fixed":
                continue
            child = joint.first("child")
            assert child is not None
            bodies.append(self._body(child.attributes["link"], Rigid()))
            inertia = _build_inertia(joint, bodies[-1][0])
            joints.append(_build_joint(joint, before.transform, inertia))
            before = Rigid()
        return self._described(joints, before.transform, home_rad, bodies)

    def _described(
        self,
        joints: list[Joint],
        tip: Transform,
        home_rad: Sequence[float] | None,
        bodies: list[tuple[list[Mass], list[LinkShape]]],
    ) -> ArmDescription:
        if home_rad is None:
            home_rad = [min(max(0.0, joint.low_rad), joint.high_rad) for joint in joints]
        if len(home_rad) != len(joints):
            message = f"{len(home_rad)} angles, where the arm has {len(joints)} joints"
            raise UrdfError(message, key="home_rad")
        shapes = tuple(tuple(own_shapes) for _, own_shapes in bodies)
        return ArmDescription(
            self.name, tuple(joints), tip, tuple(home_rad), shapes if any(shapes) else ()
        )

    def _check_joint(self, name: str, joint: Element) -> None:
        kind = joint.attributes.get("type", "")
        if joint.first("mimic") is not None:
            raise UrdfError(
                f"joint {name!r} mimics another; leave the hand out, as tools are part of the task",
                line=joint.line,
            )
        if kind not in (*_MOVING, "fixed"):
            raise UrdfError(
                f"joint {name!r} is {kind or 'of no type'}; an arm's joints are revolute, "
                "continuous or fixed",
                line=joint.line,
            )
        for end in ("parent", "child"):
            element = joint.first(end)
            link = None if element is None else element.attributes.get("link")
            if link not in self.links:
                raise UrdfError(f"joint {name!r} has no {end} link that exists", line=joint.line)
            if end == "child":
                assert link is not None
                if link in self.above:
                    raise UrdfError(
                        f"link {link!r} hangs on two joints, {name!r} and "
                        f"{self.above[link].attributes['name']!r}: a loop, which no arm here has",
                        line=joint.line,
                    )
                self.above[link] = joint

    def _tip(self, tip: str | None) -> str:
        if tip is None:
            raise UrdfError("give 'tip', the link that hands are fixed to", key="model")
        if tip not in self.links:
            ends = [link for link in self.links if not self._below(link)] or list(self.links)
            raise UrdfError(f"there is no link {tip!r}; it ends in {', '.join(ends[:6])}", "tip")
        return tip

    def _below(self, link: str) -> list[Element]:
        return [joint for joint in self.joints.values() if _get_end(joint, "parent") == link]

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

    @property
    def _fixed(self) -> list[Element]:
        """The joints that fix links to each other."""
        return [joint for joint in self.joints.values() if joint.attributes["type"] == "fixed"]

    def _body(self, link: str, frame: Rigid) -> tuple[list[Mass], list[LinkShape]]:
        """Return masses and shapes of a link and of all links fixed to it, in a frame."""
        element = self.links[link]
        masses = [mass.seen_from(frame) for mass in _read_masses(element)]
        shapes = read_shapes(element, frame, self.read_mesh)
        for joint in self._fixed:
            if _get_end(joint, "parent") == link:
                others = self._body(_get_end(joint, "child"), frame.then(read_pose(joint)))
                masses += others[0]
                shapes += others[1]
        return masses, shapes


def _refuse_xacro(root: Element) -> None:
    macros = any(child.tag.startswith("xacro:") for child in root.children)
    if macros or any(name == "xmlns:xacro" for name in root.attributes):
        raise UrdfError(
            "it is written in xacro, a language of macros; expand it first: "
            "xacro arm.urdf.xacro > arm.urdf",
            line=root.line,
        )


def _build_joint(joint: Element, placement: Transform, link: LinkInertia) -> Joint:
    name = joint.attributes["name"]
    limit = joint.first("limit")
    if limit is None:
        raise UrdfError(f"joint {name!r} has no <limit>; give one", line=joint.line)
    if joint.attributes["type"] == "continuous":
        low, high = -_FULL_TURN, _FULL_TURN
    else:
        low, high = read_number(limit, "lower", 0.0), read_number(limit, "upper", 0.0)
    speed = read_number(limit, "velocity")
    if 0 < speed < _LEAST_SPEED_RAD_PER_S:
        words = f"joint {name!r} turns at {speed:g} rad/s; {_LEAST_SPEED_RAD_PER_S:g} is the least"
        raise UrdfError(words, line=limit.line)
    axis = joint.first("axis")
    direction = (1.0, 0.0, 0.0) if axis is None else read_numbers(axis, "xyz", (1.0, 0.0, 0.0))
    length = math.hypot(*direction)
    if length < 1e-9:
        raise UrdfError(f"joint {name!r} has an axis of length 0", line=joint.line)
    try:
        return Joint(
            name,
            placement,
            low,
            high,
            speed,
            speed / _SPEEDING_UP_S,
            # Files of industrial arms often have no effort, or an effort of 0.
            read_number(limit, "effort", 0.0, most=math.inf) or None,
            link,
            (direction[0] / length, direction[1] / length, direction[2] / length),
        )
    except ValueError as error:
        raise UrdfError(str(error).rstrip("."), line=limit.line) from None


def _read_masses(link: Element) -> list[Mass]:
    inertial = link.first("inertial")
    if inertial is None:
        return []
    mass, inertia = inertial.first("mass"), inertial.first("inertia")
    kg = 0.0 if mass is None else read_number(mass, "value")
    if kg == 0.0:
        return []
    if kg < 0 or inertia is None:
        words = f"link {link.attributes['name']!r} has no mass and inertia that a body has"
        raise UrdfError(words, line=inertial.line)
    xx, yy, zz, xy, xz, yz = (
        read_number(inertia, key, 0.0) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    own = Mass(kg, (0.0, 0.0, 0.0), ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return [own.seen_from(read_pose(inertial))]


def _build_inertia(joint: Element, masses: list[Mass]) -> LinkInertia:
    link = _get_end(joint, "child")
    if not masses:
        raise UrdfError(f"link {link!r} has no mass; give it <inertial>", line=joint.line)
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
