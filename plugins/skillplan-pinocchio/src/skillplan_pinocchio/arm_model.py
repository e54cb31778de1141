"""An arm with its hand for pinocchio and coal, built from its description, not a model file.

The tip is the lowest point of hand or tool, always at the same distance from the frame of the hand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Final

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from skillplan.robots.arm_description import (
    ArmDescription,
    Capsule,
    Hand,
    Hull,
    Joint,
    LinkInertia,
    LinkShape,
)
from skillplan.robots.catalogue import DEFAULT_HAND, DEFAULT_MODEL
from skillplan.task.pose import Point, Pose, Quaternion
from skillplan.task.scene import Robot
from skillplan_pinocchio.kinematics.fixed_order import length, times
from skillplan_pinocchio.kinematics.numeric_inverse import NumericInverse
from skillplan_pinocchio.kinematics.serial_arm import SerialArm
from skillplan_pinocchio.kinematics.ur_inverse import UrInverse, UrLengths

Array = NDArray[np.float64]

# Corners of a circle in pictures of round shapes.
_RING: Final = 12


# coal counts the neighbours of a corner in a byte.
_MOST_NEIGHBOURS: Final = 250


def build_convex(hull: Hull) -> Any:
    """Return a hull as `coal.Convex`, thinned out if a corner has too many neighbours."""
    corners = np.array(hull.corners_m)
    try:
        return _compute_convex(corners)
    except RuntimeError:
        if len(corners) <= _MOST_NEIGHBOURS:
            raise
    number = np.arange(_MOST_NEIGHBOURS) + 0.5
    z = 1 - 2 * number / _MOST_NEIGHBOURS
    angle = math.pi * (1 + math.sqrt(5)) * number
    flat = np.sqrt(1 - z * z)
    directions = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
    farthest = np.argmax((corners - corners.mean(axis=0)) @ directions.T, axis=0)
    return _compute_convex(corners[np.unique(farthest)])


def _compute_convex(corners: Array) -> Any:
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    return coal.Convex.convexHull(points, True, "Qt")


@dataclass(frozen=True, eq=False)
class LinkPiece:
    """A convex shape on a link.

    Parameters
    ----------
    link
        Number of the link's joint, counted from 1.
    shape
        Shape in the description.
    """

    link: int
    shape: LinkShape

    @cached_property
    def geometry(self) -> Any:
        """Geometry for coal, in the frame `frame`."""
        if isinstance(self.shape, Hull):
            return build_convex(self.shape)
        length_m = math.dist(self.shape.start_m, self.shape.end_m)
        shape_class = coal.Capsule if isinstance(self.shape, Capsule) else coal.Cylinder
        return shape_class(self.shape.radius_m, length_m)

    @cached_property
    def frame(self) -> Any:
        """Pose of the geometry in the frame of the joint, as `pinocchio.SE3`."""
        if isinstance(self.shape, Hull):
            return pin.SE3.Identity()
        start, end = np.array(self.shape.start_m), np.array(self.shape.end_m)
        along = end - start
        turned = _align_z(along) if np.any(along) else np.eye(3)
        return pin.SE3(turned, (start + end) / 2)

    @cached_property
    def corners(self) -> Array:
        """Corners for pictures, in the frame of the joint [m], shape (corners, 3)."""
        if isinstance(self.shape, Hull):
            return np.array(self.shape.corners_m)
        radius_m = self.shape.radius_m
        half_m = math.dist(self.shape.start_m, self.shape.end_m) / 2
        angles = 2 * np.pi * np.arange(_RING) / _RING
        # A round end adds a circle half-way up, and its top.
        rings = [(half_m, radius_m)]
        if isinstance(self.shape, Capsule):
            rings += [(half_m + radius_m * math.sqrt(0.5), radius_m * math.sqrt(0.5))]
            rings += [(half_m + radius_m, 0.0)]
        corners = [
            (ring_m * math.cos(angle), ring_m * math.sin(angle), side * height_m)
            for side in (-1, 1)
            for height_m, ring_m in rings
            for angle in angles
        ]
        frame = self.frame
        return np.asarray(times(np.array(corners), frame.rotation.T) + frame.translation)

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Centre and half extents of the bounding box in the frame of the joint [m]."""
        if isinstance(self.shape, Hull):
            low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        else:
            ends = np.array([self.shape.start_m, self.shape.end_m])
            low = ends.min(axis=0) - self.shape.radius_m
            high = ends.max(axis=0) + self.shape.radius_m
        return (low + high) / 2, (high - low) / 2

    @property
    def volume_m3(self) -> float:
        """Volume [m3]."""
        if isinstance(self.shape, Hull):
            return float(ConvexHull(np.array(self.shape.corners_m)).volume)
        radius_m = self.shape.radius_m
        ends_m3 = 4 / 3 * math.pi * radius_m**3 if isinstance(self.shape, Capsule) else 0.0
        length_m = math.dist(self.shape.start_m, self.shape.end_m)
        return math.pi * radius_m**2 * length_m + ends_m3


# Density of links without a mass [kg/m3]; mass and half extent of those without a shape, too.
_ASSUMED_KG_PER_M3: Final = 1_500.0
_ASSUMED_KG, _ASSUMED_HALF_M = 0.1, 0.02


@lru_cache(maxsize=8)
def assume_masses(arm: ArmDescription) -> ArmDescription:
    """Return an arm whose links all have a mass, for engines that move them.

    Links without one get a density of 1,500 kg/m3 in their shapes. Joints that move such a link
    have no greatest torque then, because their own may not bear a mass that is made up.
    """
    unknown = [number for number, joint in enumerate(arm.joints) if joint.link is None]
    if not unknown:
        return arm
    shapes = arm.shapes or ((),) * (len(arm.joints) + 1)
    joints = [_weigh(joint, own) for joint, own in zip(arm.joints, shapes[1:], strict=True)]
    last = max(unknown)
    freed = (replace(joint, torque_nm=None) for joint in joints[: last + 1])
    return replace(arm, joints=(*freed, *joints[last + 1 :]))


def _weigh(joint: Joint, shapes: Sequence[LinkShape]) -> Joint:
    if joint.link is not None:
        return joint
    pieces = [LinkPiece(1, shape) for shape in shapes]
    mass_kg = _ASSUMED_KG_PER_M3 * sum(piece.volume_m3 for piece in pieces)
    low, high = np.full(3, -_ASSUMED_HALF_M), np.full(3, _ASSUMED_HALF_M)
    if pieces:
        low = np.min([piece.box[0] - piece.box[1] for piece in pieces], axis=0)
        high = np.max([piece.box[0] + piece.box[1] for piece in pieces], axis=0)
    mass_kg = max(mass_kg, _ASSUMED_KG)
    x_m2, y_m2, z_m2 = (high - low) ** 2
    tensor = [(y_m2 + z_m2), (x_m2 + z_m2), (x_m2 + y_m2)]
    xx, yy, zz = (float(mass_kg * value / 12) for value in tensor)
    x_m, y_m, z_m = ((low + high) / 2).tolist()
    return replace(joint, link=LinkInertia(mass_kg, (x_m, y_m, z_m), (xx, yy, zz, 0.0, 0.0, 0.0)))


# Several detectors may share an arm.
@lru_cache(maxsize=8)
def collect_link_pieces(arm: ArmDescription) -> tuple[LinkPiece, ...]:
    """Return the shapes of all links that move; the base does not."""
    return tuple(
        LinkPiece(link, shape) for link, shapes in enumerate(arm.shapes) if link for shape in shapes
    )


def _align_z(along: Array) -> Array:
    """Return a rotation that turns z along a vector, shape (3, 3)."""
    z = along / length(along)
    # Take the axis that is farther from it.
    aside = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
    x = np.cross(aside, z)
    x /= length(x)
    return np.column_stack([x, np.cross(z, x), z])


Vector = NDArray[np.float64]


class ArmModel:
    """The arm: pose of the tip, Jacobian, and poses of the links.

    Parameters
    ----------
    base
        Position of the base in the world [m].

    Attributes
    ----------
    low_rad, high_rad
        Joint limits [rad], shape (joints,).
    home_rad
        Home posture [rad], shape (joints,).
    pieces
        Shapes of the links.
    known_strokes
        Joint paths of motions that were planned before.
    """

    def __init__(
        self,
        base: Point = (0.0, 0.0, 0.0),
        description: ArmDescription = DEFAULT_MODEL,
        orientation: Quaternion = (0.0, 0.0, 0.0, 1.0),
        hand: Hand = DEFAULT_HAND,
    ) -> None:
        self.description = description
        self.mount = Pose(base, orientation)
        self.hand = hand
        turned = pin.SE3(np.array(self.mount.rotation), np.array(base, dtype=float))
        self.serial = SerialArm(description, turned, hand.tip_on_flange)
        self.low_rad = self.serial.low_rad
        self.high_rad = self.serial.high_rad
        self.home_rad = self.serial.home_rad
        self.model = self.serial.model
        self.pieces = collect_link_pieces(description)
        self._data = self.model.createData()
        self.known_strokes: dict[tuple[Any, ...], Any] = {}

    @staticmethod
    def of(robot: Robot) -> ArmModel:
        """Return the arm of a scene's robot; equal robots share it."""
        return _build_arm(robot.base, robot.model, robot.base_orientation, robot.hand)

    @cached_property
    def inverse(self) -> NumericInverse:
        """Numeric inverse kinematics for any pose of the tip."""
        return NumericInverse(self.serial)

    @cached_property
    def closed_form(self) -> UrInverse | None:
        """Closed-form inverse kinematics, or None if the arm has none."""
        return None if UrLengths.of(self.description) is None else UrInverse(self.serial)

    @cached_property
    def shoulder(self) -> Vector:
        """Position of the second joint at home [m], shape (3,)."""
        pin.forwardKinematics(self.model, self._data, self.home_rad)
        return np.asarray(self._data.oMi[min(2, self.joints)].translation.copy())

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.home_rad)

    def tip(self, joints_rad: Vector) -> tuple[Vector, Vector]:
        """Return position [m], shape (3,), and rotation, shape (3, 3), of the tip.

        The tip's z points out of the hand, its y along the closing axis of the jaws.
        """
        placement = self.serial.tip(joints_rad)
        return placement.translation.copy(), placement.rotation.copy()

    def error(self, joints_rad: Vector, target: Any) -> tuple[Vector, Vector]:
        """Return the error of the tip's pose, and the Jacobian; see :meth:`SerialArm.error`."""
        return self.serial.error(joints_rad, target)

    @cached_property
    def boxes(self) -> tuple[NDArray[np.intp], Vector, Vector]:
        """Joint number, from 0, centre and half extents of every piece's bounding box [m].

        In the frame of the joint; shapes (pieces,), (pieces, 3) and (pieces, 3).
        """
        joints = np.array([piece.link - 1 for piece in self.pieces], dtype=np.intp)
        centres = np.array([piece.box[0] for piece in self.pieces]).reshape(-1, 3)
        return joints, centres, np.array([piece.box[1] for piece in self.pieces]).reshape(-1, 3)

    def frames(self, postures_rad: Sequence[Vector]) -> tuple[Vector, Vector]:
        """Return rotations and origins [m] of the joints' frames in several postures.

        Parameters
        ----------
        postures_rad
            Joint angles [rad], each of shape (joints,).

        Returns
        -------
        tuple
            Shapes (postures, joints, 3, 3) and (postures, joints, 3).
        """
        placements = []
        for joints_rad in postures_rad:
            pin.forwardKinematics(self.model, self._data, joints_rad)
            placements.append([placement.homogeneous for placement in self._data.oMi[1:]])
        array = np.array(placements)
        return array[..., :3, :3], array[..., :3, 3]


@lru_cache(maxsize=4)
def _build_arm(
    base: Point, description: ArmDescription, orientation: Quaternion, hand: Hand
) -> ArmModel:
    return ArmModel(base, description, orientation, hand)


def make_pose_down(position: Point, closing_yaw_rad: float) -> Any:
    """Return the pose of a tip that points straight down.

    Parameters
    ----------
    position
        Position in the world [m].
    closing_yaw_rad
        Closing direction of the jaws, from x about the vertical [rad].
    """
    cos, sin = math.cos(closing_yaw_rad), math.sin(closing_yaw_rad)
    rotation = np.array([[-sin, cos, 0.0], [cos, sin, 0.0], [0.0, 0.0, -1.0]])
    return pin.SE3(rotation, np.array(position, dtype=float))


def make_hand_pose(position: Point, orientation: Quaternion) -> Any:
    """Return the pose of a tip, as `pinocchio.SE3`.

    Parameters
    ----------
    position
        Position in the world [m].
    orientation
        Orientation of the hand: z points out of it, y along the closing axis.
    """
    return pin.SE3(np.array(Pose(position, orientation).rotation), np.array(position, dtype=float))


def get_closing_yaw_rad(rotation: Vector) -> float:
    """Return the closing direction of the jaws, from x about the vertical [rad]."""
    return math.atan2(rotation[1, 1], rotation[0, 1])
