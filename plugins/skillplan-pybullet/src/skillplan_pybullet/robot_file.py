"""The URDF file of an arm with its hand, for pybullet.

Kinematics, masses and collision shapes come from the arm's description.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np

from skillplan.robots.arm_description import (
    ArmDescription,
    Capsule,
    Hand,
    Hull,
    LinkInertia,
    Rod,
    Transform,
)
from skillplan_pinocchio.arm_model import assume_masses, build_convex
from skillplan_pinocchio.kinematics.serial_arm import make_placement
from skillplan_simulation.kinematics import Vector, compute_rpy
from skillplan_simulation.robot_shapes import Piece, make_body_pieces, make_jaw_pieces

TIP_LINK = "hand"
"""Link of the hand; its frame is the tip."""

JAW_LINKS = ("left_jaw", "right_jaw")

# Assumed masses of a hand's body and of one jaw, as for the Panda [kg].
_BODY_KG, _JAW_KG = 0.73, 0.05
# Torque limit of a joint without a known limit [Nm].
_NO_LIMIT_NM = 1e6
_JAW_SPEED_M_PER_S = 0.2
_WORLD = np.eye(3)


@dataclass(frozen=True, slots=True)
class RobotFile:
    """A robot file, and pybullet's numbers of its links and joints.

    Parameters
    ----------
    dynamics
        The same description without shapes, as text.
    joints
        Joints of the arm, from the base.
    hand
        Link of the hand, whose frame is the tip: y along the closing axis, z out of it.
    jaws
        Links of the two jaws, and their joints.
    """

    path: Path
    dynamics: str
    joints: tuple[int, ...]
    hand: int
    jaws: tuple[int, int]


class _Folder:
    """A temporary folder that exists until the program ends."""

    def __init__(self) -> None:
        self._made: TemporaryDirectory[str] | None = None
        self.count = 0

    def new(self, ending: str) -> Path:
        """Return the path of a new file."""
        if self._made is None:
            self._made = TemporaryDirectory(prefix="skillplan_robot_")
        self.count += 1
        return Path(self._made.name) / f"{self.count}.{ending}"


_FOLDER = _Folder()


@lru_cache(maxsize=32)
def write_robot_file(description: ArmDescription, tip: Transform, hand: Hand) -> RobotFile:
    """Return the file of an arm with a hand; it exists until the program ends.

    Parameters
    ----------
    tip
        Pose of the jaws' ends on the flange.
    """
    description = assume_masses(description)
    path = _FOLDER.new("urdf")
    path.write_text(_write_text(description, tip, hand, shaped=True), "utf-8")
    count = len(description.joints)
    return RobotFile(
        path,
        _write_text(description, tip, hand, shaped=False),
        tuple(range(count)),
        count,
        (count + 1, count + 2),
    )


def _write_text(description: ArmDescription, tip: Transform, hand: Hand, *, shaped: bool) -> str:
    root = ElementTree.Element("robot", name="arm")
    names = ["base", *(f"link_{number + 1}" for number in range(len(description.joints)))]
    shapes: Sequence[Sequence[Piece]] = description.shapes or [()] * len(names)
    inertias = [None, *(joint.link for joint in description.joints)]
    for name, pieces, inertia in zip(names, shapes, inertias, strict=True):
        _add_link(root, name, inertia, pieces if shaped else ())
    for number, joint in enumerate(description.joints):
        torque_nm = _NO_LIMIT_NM if joint.torque_nm is None else joint.torque_nm
        limits = (joint.low_rad, joint.high_rad, torque_nm, joint.speed_rad_per_s)
        _add_joint(
            root,
            "prismatic" if joint.is_prismatic else "revolute",
            names[number : number + 2],
            make_placement(joint.placement),
            joint.axis,
            limits,
        )
    _add_link(root, TIP_LINK, _compute_hand_inertia(hand), make_body_pieces(hand) if shaped else ())
    where = make_placement(description.tip) * make_placement(tip)
    _add_joint(root, "fixed", [names[-1], TIP_LINK], where)
    for side, name in zip((1, -1), JAW_LINKS, strict=True):
        pieces = make_jaw_pieces(hand, side) if shaped else ()
        _add_link(root, name, _compute_jaw_inertia(hand, side), pieces)
        limits = (0.0, hand.opening_m / 2, hand.force_n, _JAW_SPEED_M_PER_S)
        axis = (0.0, float(side), 0.0)
        _add_joint(root, "prismatic", [TIP_LINK, name], make_placement(Transform()), axis, limits)
    # pybullet reads lines of at most a thousand characters.
    ElementTree.indent(root)
    return ElementTree.tostring(root, "unicode") + "\n"


def _compute_hand_inertia(hand: Hand) -> LinkInertia:
    size = (2 * hand.half_width_m, 2 * hand.half_length_m, hand.underside_m)
    return _compute_box_inertia(_BODY_KG, (0.0, 0.0, hand.underside_m / 2 - hand.arm_tip_m), size)


def _compute_jaw_inertia(hand: Hand, side: int) -> LinkInertia:
    height_m, thick_m = hand.jaw_m[-1][0], hand.jaw_m[-1][3]
    centre = (0.0, side * thick_m / 2, hand.beyond_m - height_m / 2)
    return _compute_box_inertia(_JAW_KG, centre, (2 * hand.jaw_half_width_m, thick_m, height_m))


def _compute_box_inertia(
    mass_kg: float, centre_m: tuple[float, float, float], size_m: tuple[float, float, float]
) -> LinkInertia:
    x, y, z = (extent**2 * mass_kg / 12 for extent in size_m)
    return LinkInertia(mass_kg, centre_m, (y + z, x + z, x + y, 0.0, 0.0, 0.0))


def _add_link(
    root: ElementTree.Element, name: str, inertia: LinkInertia | None, pieces: Sequence[Piece]
) -> None:
    link = ElementTree.SubElement(root, "link", name=name)
    if inertia is not None:
        inertial = ElementTree.SubElement(link, "inertial")
        frame = make_placement(inertia.frame)
        _add_origin(inertial, frame.act(np.array(inertia.centre_m)), frame.rotation)
        ElementTree.SubElement(inertial, "mass", value=repr(inertia.mass_kg))
        xx, yy, zz, xy, xz, yz = (repr(value) for value in inertia.tensor_kg_m2)
        ElementTree.SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy=xy, ixz=xz, iyz=yz)
    for piece in pieces:
        _add_shape(ElementTree.SubElement(link, "collision"), piece)


def _add_joint(
    root: ElementTree.Element,
    kind: str,
    links: Sequence[str],
    where: Any,
    axis: tuple[float, float, float] | None = None,
    limits: tuple[float, float, float, float] | None = None,
) -> None:
    parent, child = links
    joint = ElementTree.SubElement(root, "joint", name=f"to_{child}", type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    _add_origin(joint, where.translation, where.rotation)
    if axis is not None:
        ElementTree.SubElement(joint, "axis", xyz=_format_numbers(axis))
    if limits is not None:
        low, high, effort, velocity = (repr(float(value)) for value in limits)
        ElementTree.SubElement(
            joint, "limit", lower=low, upper=high, effort=effort, velocity=velocity
        )


def _add_shape(parent: ElementTree.Element, piece: Piece) -> None:
    """Add the pose and geometry of a piece."""
    if isinstance(piece, Hull):
        _add_origin(parent, np.zeros(3), _WORLD)
        geometry = ElementTree.SubElement(parent, "geometry")
        ElementTree.SubElement(geometry, "mesh", filename=str(_write_mesh(piece)))
        return
    if isinstance(piece, Capsule | Rod):
        start, end = np.array(piece.start_m), np.array(piece.end_m)
        length = float(np.linalg.norm(end - start))
        _add_origin(parent, (start + end) / 2, _align_z(end - start))
        geometry = ElementTree.SubElement(parent, "geometry")
        radius = repr(piece.radius_m)
        if isinstance(piece, Rod):
            ElementTree.SubElement(geometry, "cylinder", radius=radius, length=repr(length))
        elif length == 0.0:
            ElementTree.SubElement(geometry, "sphere", radius=radius)
        else:
            ElementTree.SubElement(geometry, "capsule", radius=radius, length=repr(length))
        return
    low, high = np.array(piece.low_m), np.array(piece.high_m)
    _add_origin(parent, (low + high) / 2, _WORLD)
    geometry = ElementTree.SubElement(parent, "geometry")
    ElementTree.SubElement(geometry, "box", size=_format_numbers((high - low).tolist()))


@lru_cache(maxsize=512)
def _write_mesh(hull: Hull) -> Path:
    """Write a hull as a triangle mesh."""
    surface = build_convex(hull)
    corners = np.asarray(surface.points())
    middle = corners.mean(axis=0)
    lines = [f"v {_format_numbers(corner.tolist())}" for corner in corners]
    for number in range(surface.num_polygons):
        a, b, c = (int(surface.polygons(number)[index]) for index in range(3))
        normal = np.cross(corners[b] - corners[a], corners[c] - corners[a])
        if float(normal @ (corners[a] - middle)) < 0:
            b, c = c, b
        lines.append(f"f {a + 1} {b + 1} {c + 1}")
    path = _FOLDER.new("obj")
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def _align_z(along: Vector) -> Vector:
    """Return a rotation that turns z along a direction."""
    length = float(np.linalg.norm(along))
    if length == 0.0:
        return _WORLD
    z = along / length
    aside = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x = aside / np.linalg.norm(aside)
    return np.column_stack([x, np.cross(z, x), z])


def _add_origin(parent: ElementTree.Element, position: Vector, rotation: Vector) -> None:
    ElementTree.SubElement(
        parent,
        "origin",
        xyz=_format_numbers(position.tolist()),
        rpy=_format_numbers(compute_rpy(rotation)),
    )


def _format_numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
