"""What is known of a serial arm, as data: joints, limits, masses, tip and home.

It holds facts and their checks, in plain Python: whoever computes with them, computes elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from skillplan.robots.link_shapes import LinkShape

Triple = tuple[float, float, float]
"""Three coordinates, or three angles."""


# Defaults below are made when this file is read, and are checked with these.
def _require_finite(what: str, values: tuple[float, ...], count: int) -> None:
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise ValueError(f"{what} must be {count} finite numbers, not {values}.")


def _is_positive(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> bool:
    """Say whether a symmetric matrix is positive definite, by Sylvester's criterion."""
    second = xx * yy - xy * xy
    third = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return xx > 0 and second > 0 and third > 0


@dataclass(frozen=True, slots=True)
class Transform:
    """Where a frame is in another one: moved, then turned about fixed x, y and z in this order.

    Parameters
    ----------
    xyz_m
        Origin [m].
    rpy_rad
        Roll, pitch and yaw [rad], as in URDF: the rotation is Rz(yaw) Ry(pitch) Rx(roll).

    Raises
    ------
    ValueError
        If these are not three finite numbers each.
    """

    xyz_m: Triple = (0.0, 0.0, 0.0)
    rpy_rad: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _require_finite("Transform xyz_m", self.xyz_m, 3)
        _require_finite("Transform rpy_rad", self.rpy_rad, 3)

    @classmethod
    def from_standard_dh(cls, a_m: float, d_m: float, alpha_rad: float) -> Transform:
        """Return what follows a joint's rotation by the standard parameters (distal frames).

        Parameters
        ----------
        a_m, d_m
            Length and offset of the link [m].
        alpha_rad
            Its twist [rad].
        """
        return cls((a_m, 0.0, d_m), (alpha_rad, 0.0, 0.0))

    @classmethod
    def from_modified_dh(cls, a_m: float, d_m: float, alpha_rad: float) -> Transform:
        """Return what goes before a joint's rotation by Craig's parameters (proximal frames).

        Parameters
        ----------
        a_m, d_m
            Length of the link before the joint, and offset of the joint [m].
        alpha_rad
            Twist of the link before the joint [rad].
        """
        xyz_m = (a_m, -math.sin(alpha_rad) * d_m, math.cos(alpha_rad) * d_m)
        return cls(xyz_m, (alpha_rad, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class LinkInertia:
    """Mass of a link, where its centre is, and its inertia about the centre.

    Parameters
    ----------
    mass_kg
        Mass [kg], > 0.
    centre_m
        Centre of mass in `frame` [m].
    tensor_kg_m2
        Inertia about the centre of mass, along the axes of `frame` [kg m2]: xx, yy, zz, xy, xz
        and yz.
    frame
        In which the source states them, seen from the joint that moves the link.

    Raises
    ------
    ValueError
        If no rigid body has this mass and inertia.
    """

    mass_kg: float
    centre_m: Triple
    tensor_kg_m2: tuple[float, float, float, float, float, float]
    frame: Transform = Transform()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mass_kg) and self.mass_kg > 0):
            raise ValueError(f"Link mass_kg must be > 0, not {self.mass_kg}.")
        _require_finite("Link centre_m", self.centre_m, 3)
        _require_finite("Link tensor_kg_m2", self.tensor_kg_m2, 6)
        # A body has mass where its second moments, tr/2 - J, are positive; then J is, too.
        xx, yy, zz, xy, xz, yz = self.tensor_kg_m2
        half = (xx + yy + zz) / 2
        if not _is_positive(half - xx, half - yy, half - zz, -xy, -xz, -yz):
            raise ValueError(f"No body has the inertia {self.tensor_kg_m2}.")


@dataclass(frozen=True, slots=True)
class Joint:
    """A revolute joint, and the link that it moves.

    Parameters
    ----------
    name
        Not empty.
    placement
        Its frame at angle 0, in the frame of the joint before (of the base, if first).
    low_rad, high_rad
        Limits of its angle [rad].
    speed_rad_per_s, acceleration_rad_per_s2
        Greatest speed [rad/s] and acceleration [rad/s2], > 0.
    torque_nm
        Greatest torque [Nm], > 0; None if unknown.
    link
        What it moves.
    axis
        About which it turns, in its frame; of length 1.

    Raises
    ------
    ValueError
        If a limit is not positive or not finite, the range of angles is empty, the axis not of
        length 1, or the name empty.
    """

    name: str
    placement: Transform
    low_rad: float
    high_rad: float
    speed_rad_per_s: float
    acceleration_rad_per_s2: float
    torque_nm: float | None
    link: LinkInertia
    axis: Triple = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("Joint must have a name.")
        _require_finite(f"Joint {self.name}: axis", self.axis, 3)
        if abs(math.hypot(*self.axis) - 1) > 1e-9:
            raise ValueError(f"Joint {self.name}: axis must be of length 1, not {self.axis}.")
        _require_finite(f"Joint {self.name}: limits", (self.low_rad, self.high_rad), 2)
        if not self.low_rad < self.high_rad:
            raise ValueError(
                f"Joint {self.name}: low_rad {self.low_rad} must be below high_rad {self.high_rad}."
            )
        for what in ("speed_rad_per_s", "acceleration_rad_per_s2", "torque_nm"):
            value = getattr(self, what)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"Joint {self.name}: {what} must be > 0, not {value}.")


@dataclass(frozen=True, slots=True)
class ArmDescription:
    """A serial arm of revolute joints.

    Parameters
    ----------
    name
        Of the robot, not empty.
    joints
        From the base to the tip, at least one, with distinct names.
    tip
        The flange, to which hands and tools are fixed, in the frame of the last joint.
    home_rad
        A posture with room for every joint [rad], within the limits.
    shapes
        What collides, of the base in its frame, then of every link in the frame of the joint that
        moves it; none of any where nothing is known.
    reach_m
        How far from the base it works, as its maker says [m]; None for the length of its links.
    swing
        Of an arm with a spare joint whose first axis is its base's z and which points down at home:
        the joints, counted from 0, that turn all of it, swing its elbow, and turn its hand. None
        for others.
    payload_kg
        Greatest mass at the flange, hand and tool included, as its maker says [kg], > 0; None if
        unknown.

    Raises
    ------
    ValueError
        If one of these does not hold.
    """

    name: str
    joints: tuple[Joint, ...]
    tip: Transform
    home_rad: tuple[float, ...]
    shapes: tuple[tuple[LinkShape, ...], ...] = ()
    reach_m: float | None = None
    swing: tuple[int, int, int] | None = None
    payload_kg: float | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("Arm must have a name.")
        if not self.joints:
            raise ValueError(f"Arm {self.name} must have joints.")
        names = [joint.name for joint in self.joints]
        if len(set(names)) < len(names):
            raise ValueError(f"Arm {self.name}: joints must have distinct names, not {names}.")
        _require_finite(f"Arm {self.name}: home_rad", self.home_rad, len(self.joints))
        for joint, angle in zip(self.joints, self.home_rad, strict=True):
            if not joint.low_rad <= angle <= joint.high_rad:
                raise ValueError(
                    f"Arm {self.name}: home_rad has joint {joint.name} at {angle}, beyond "
                    f"its limits {joint.low_rad} and {joint.high_rad}. Give an angle between "
                    "them, or leave out home_rad for the default."
                )
        if self.shapes and len(self.shapes) != len(self.joints) + 1:
            raise ValueError(
                f"Arm {self.name}: shapes must be of the base and each of {len(self.joints)} "
                f"links, not of {len(self.shapes)}."
            )
        for what in ("reach_m", "payload_kg"):
            value = getattr(self, what)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"Arm {self.name}: {what} must be > 0, not {value}.")

    @property
    def works_within_m(self) -> float:
        """How far from the base it works [m]."""
        if self.reach_m is not None:
            return self.reach_m
        return sum(
            math.hypot(*frame.xyz_m)
            for frame in (*(joint.placement for joint in self.joints), self.tip)
        )

    @property
    def without_shape(self) -> tuple[int, ...]:
        """Numbers of the links that have no shape; 0 is the base."""
        if not self.shapes:
            return tuple(range(len(self.joints) + 1))
        return tuple(number for number, shapes in enumerate(self.shapes) if not shapes)

    @property
    def not_checked(self) -> tuple[str, ...]:
        """Sentences on contacts and torques that back ends cannot check for want of a figure."""
        sentences = []
        links = ["the base" if not number else f"link {number}" for number in self.without_shape]
        if links:
            sentences.append(
                f"contacts of {', '.join(links)} of {self.name}: its description has no collision "
                "shape for them"
            )
        joints = [joint.name for joint in self.joints if joint.torque_nm is None]
        if joints:
            sentences.append(
                f"torques of {', '.join(joints)} of {self.name}: its description has no limit"
            )
        return tuple(sentences)

    @property
    def low_rad(self) -> tuple[float, ...]:
        """Lower limits of the joints [rad]."""
        return tuple(joint.low_rad for joint in self.joints)

    @property
    def high_rad(self) -> tuple[float, ...]:
        """Upper limits of the joints [rad]."""
        return tuple(joint.high_rad for joint in self.joints)

    @property
    def speed_rad_per_s(self) -> tuple[float, ...]:
        """Greatest speeds of the joints [rad/s]."""
        return tuple(joint.speed_rad_per_s for joint in self.joints)

    @property
    def acceleration_rad_per_s2(self) -> tuple[float, ...]:
        """Greatest accelerations of the joints [rad/s2]."""
        return tuple(joint.acceleration_rad_per_s2 for joint in self.joints)

    @property
    def torque_nm(self) -> tuple[float, ...]:
        """Greatest torques of the joints [Nm], infinite if unknown."""
        return tuple(joint.torque_nm or math.inf for joint in self.joints)
