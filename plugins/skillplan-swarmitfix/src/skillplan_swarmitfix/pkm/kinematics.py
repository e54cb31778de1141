"""Kinematics of the PKM: an Exechon-like tripod (2-RRPR + SPR) with a spherical wrist.

Frames and joints. The base frame stands at the middle of the joints A and C, which lie on its
y axis; joint B lies on its x axis; z points to the platform. Legs A and C, with the platform
joints A' and C', stay in one plane that turns about the line AC. Leg B hangs in a spherical
joint at B and turns at B' about the platform's y axis. This leaves the platform three degrees
of freedom (Zoppi, Zlatanov and Molfino, Kinematics analysis of the Exechon tripod, 2010):

- its x axis is the normal of the plane of A and C: n = (sin a, 0, cos a);
- its origin lies in that plane: p . n = 0;
- leg B is perpendicular to its revolute joint: (p + R u_B - b_B) . R e_y = 0.

With e = (-cos a, 0, sin a) the direction in the plane that is perpendicular to AC, the platform's
other axes are y' = cos b e_y + sin b e and z' = cos b e - sin b e_y, and the constraints put its
origin at p = h z' + (b_B . y') y'. The wrist turns the platform into the head by Euler angles
ZYZ, R_head = R_platform Rz(w1) Ry(w2) Rz(w3); its centre S lies on the platform's z axis and
the head's origin W on the head's z axis.

`inverse` is closed. `forward` knows none of its formulas: it solves the joints' constraints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Point3 = tuple[float, float, float]
Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose6:
    """Pose of the head in the PKM's base frame: position and Euler angles ZYZ.

    Parameters
    ----------
    x_m, y_m, z_m
        The head's origin W [m].
    alpha_rad, beta_rad, gamma_rad
        R = Rz(alpha) Ry(beta) Rz(gamma) [rad].

    Raises
    ------
    ValueError
        If a coordinate is not finite.
    """

    x_m: float
    y_m: float
    z_m: float
    alpha_rad: float
    beta_rad: float
    gamma_rad: float

    def __post_init__(self) -> None:
        for item in fields(self):
            if not math.isfinite(value := getattr(self, item.name)):
                raise ValueError(f"Pose6 {item.name} must be finite, not {value}.")

    @classmethod
    def of(cls, position_m: Matrix, rotation: Matrix) -> Pose6:
        """Return the pose of a position [m], shape (3,), and a rotation matrix, shape (3, 3)."""
        x_m, y_m, z_m = (float(value) for value in position_m)
        return cls(x_m, y_m, z_m, *zyz_angles(rotation))

    @property
    def position_m(self) -> Matrix:
        """The head's origin [m], shape (3,)."""
        return np.array([self.x_m, self.y_m, self.z_m])

    @property
    def rotation(self) -> Matrix:
        """The head's axes as columns, shape (3, 3)."""
        return zyz_matrix(self.alpha_rad, self.beta_rad, self.gamma_rad)


def zyz_matrix(first_rad: float, second_rad: float, third_rad: float) -> Matrix:
    """Return Rz(first) Ry(second) Rz(third), shape (3, 3), of angles [rad]."""
    product: Matrix = _rz(first_rad) @ _ry(second_rad) @ _rz(third_rad)
    return product


def zyz_angles(rotation: Matrix) -> Point3:
    """Return the Euler angles ZYZ [rad] of a rotation matrix, shape (3, 3); the second >= 0.

    The third follows from the rest after the first two, so that the three reproduce the matrix
    up to rounding, even if the second is 0 or pi and the first is arbitrary.
    """
    first = math.atan2(rotation[1, 2], rotation[0, 2])
    second = math.atan2(math.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])
    rest = (_rz(first) @ _ry(second)).T @ rotation
    return first, second, math.atan2(rest[1, 0], rest[0, 0])


def _rz(angle_rad: float) -> Matrix:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _ry(angle_rad: float) -> Matrix:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


LEGS = ("A", "B", "C")

# Least share of the upright platform's determinant of the constraints; 0 where it is singular.
_LEAST_SHARE = 1e-3
# The platform axes of the revolute joints: x at A' and C', y at B'.
_NORMALS = [0, 1, 0]


class OutsideWorkspace(ValueError):
    """A pose or a set of joints that the PKM cannot take on in its working mode."""


@dataclass(frozen=True, slots=True)
class PkmGeometry:
    """Lengths of the PKM; by default the real machine's (2012).

    Parameters
    ----------
    base_half_m, platform_half_m
        Distance of the joints A and C, A' and C' from the middle between them [m], > 0.
    base_arm_m, platform_arm_m
        Distance of the joint B, B' from that middle [m], > 0.
    wrist_offset_m
        From the platform's origin to the wrist centre along the platform's z axis [m], >= 0.
    head_offset_m
        From the wrist centre to the head's origin along the head's z axis [m], >= 0.

    Raises
    ------
    ValueError
        If a length is out of range or not finite.
    """

    base_half_m: float = 0.05
    platform_half_m: float = 0.05
    base_arm_m: float = 0.18
    platform_arm_m: float = 0.086
    wrist_offset_m: float = 0.0905
    head_offset_m: float = 0.0725

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            positive = not item.name.endswith("offset_m")
            if not (math.isfinite(value) and (value > 0 if positive else value >= 0)):
                bound = "> 0" if positive else ">= 0"
                raise ValueError(
                    f"PkmGeometry {item.name} must be finite and {bound}, not {value}."
                )

    @property
    def base_points_m(self) -> Matrix:
        """The joints A, B, C in the base frame [m], shape (3, 3), one row a joint."""
        return _tripod(self.base_half_m, self.base_arm_m)

    @property
    def platform_points_m(self) -> Matrix:
        """The joints A', B', C' in the platform frame [m], shape (3, 3), one row a joint."""
        return _tripod(self.platform_half_m, self.platform_arm_m)


def _tripod(half_m: float, arm_m: float) -> Matrix:
    return np.array([[0.0, -half_m, 0.0], [arm_m, 0.0, 0.0], [0.0, half_m, 0.0]])


@dataclass(frozen=True, slots=True)
class PkmJoints:
    """The joints of a pose: six that are driven, and how the platform stands.

    Parameters
    ----------
    legs_m
        Lengths of the legs A, B, C [m], > 0; driven.
    wrist_rad
        Angles w1, w2, w3 of the wrist [rad]; driven.
    a_rad
        Angle of the plane of A and C about the line AC [rad]: pi/2 where it is upright.
    b_rad
        Angle of the platform within that plane [rad].
    h_m
        Extension: from the line AC to the platform's origin along the platform's z axis [m].

    Raises
    ------
    ValueError
        If a leg is not longer than 0 or a value is not finite.
    """

    legs_m: Point3
    wrist_rad: Point3
    a_rad: float
    b_rad: float
    h_m: float

    def __post_init__(self) -> None:
        for name, length_m in zip(LEGS, self.legs_m, strict=True):
            if not (math.isfinite(length_m) and length_m > 0):
                raise ValueError(f"PkmJoints leg {name} must be finite and > 0, not {length_m}.")
        rest = (*self.wrist_rad, self.a_rad, self.b_rad, self.h_m)
        if len(self.wrist_rad) != 3 or not all(math.isfinite(value) for value in rest):
            raise ValueError(f"PkmJoints needs six finite values after its legs, not {rest}.")


def inverse(geometry: PkmGeometry, pose: Pose6) -> PkmJoints:
    """Return the joints that put the head at a pose, in closed form.

    The result is the wrist solution with w2 in [0, pi]; if w1 and w3 turn
    about the same axis, w1 is what rounding makes of it and only their sum counts.

    Raises
    ------
    OutsideWorkspace
        If the pose needs a wrist centre behind the base, a platform turned over, or one at
        or beyond a parallel singularity, because leg lengths no longer determine the platform.
    """
    head = pose.rotation
    x_m, y_m, z_m = (float(v) for v in pose.position_m - geometry.head_offset_m * head[:, 2])
    if z_m <= 0.0:
        raise OutsideWorkspace(
            f"The wrist centre would lie {-z_m:.3f} m behind the PKM's base (z = {z_m:.3f} m); "
            "the PKM works in front of it."
        )
    # The plane of A and C holds the wrist centre, `reach` away from the line AC.
    reach = math.hypot(x_m, z_m)
    sin_a, cos_a = z_m / reach, -x_m / reach
    # S . y' = b_B . y' gives sin b : cos b.
    along = reach + geometry.base_arm_m * cos_a
    if along <= 0.0:
        raise OutsideWorkspace(
            f"The wrist centre would lie {reach:.3f} m from the line AC, so near to joint B that "
            "the platform would turn over."
        )
    scale = math.hypot(along, y_m)
    sin_b, cos_b = -y_m / scale, along / scale
    extension_m = cos_b * reach - sin_b * y_m - geometry.wrist_offset_m
    if extension_m <= 0.0:
        raise OutsideWorkspace(
            f"The platform would lie {-extension_m:.3f} m behind the line AC; its extension must "
            "be more than 0."
        )
    platform = np.array(
        [
            [sin_a, -sin_b * cos_a, -cos_b * cos_a],
            [0.0, cos_b, -sin_b],
            [cos_a, sin_b * sin_a, cos_b * sin_a],
        ]
    )
    slide_m = -geometry.base_arm_m * sin_b * cos_a
    origin = extension_m * platform[:, 2] + slide_m * platform[:, 1]
    upright = _slope(geometry, np.array([0.0, 0.0, extension_m]), np.eye(3))
    share = np.linalg.det(_slope(geometry, origin, platform)) / np.linalg.det(upright)
    if share < _LEAST_SHARE:
        raise OutsideWorkspace(
            f"The platform would be turned by {math.degrees(math.atan2(sin_b, cos_b)):.1f} degrees "
            "in the plane of legs A and C, to or beyond a singularity: there the leg lengths no "
            "longer fix it."
        )
    feet = _legs(geometry, origin, platform)
    leg_a, leg_b, leg_c = (float(length) for length in np.linalg.norm(feet, axis=1))
    return PkmJoints(
        legs_m=(leg_a, leg_b, leg_c),
        wrist_rad=zyz_angles(platform.T @ head),
        a_rad=math.atan2(sin_a, cos_a),
        b_rad=math.atan2(sin_b, cos_b),
        h_m=extension_m,
    )


def forward(geometry: PkmGeometry, joints: PkmJoints) -> Pose6:
    """Return the pose of the head from the six driven joints.

    The platform follows from the leg lengths by Newton's method on the constraints of the
    joints (see the module), in the working mode: the one joined to the upright platform. The
    fields `a_rad`, `b_rad` and `h_m` are not read.

    Raises
    ------
    OutsideWorkspace
        If the legs do not close in the working mode.
    """
    origin, platform = _platform(geometry, np.array(joints.legs_m))
    head = platform @ zyz_matrix(*joints.wrist_rad)
    centre = origin + geometry.wrist_offset_m * platform[:, 2]
    return Pose6.of(centre + geometry.head_offset_m * head[:, 2], head)


def _platform(geometry: PkmGeometry, legs_m: Matrix) -> tuple[Matrix, Matrix]:
    """Follow the platform from upright, with its simple closure, to the given leg lengths."""
    height = float(legs_m[0] + legs_m[2]) / 2
    origin, rotation = np.array([0.0, 0.0, height]), np.eye(3)
    home = np.linalg.norm(origin + geometry.platform_points_m - geometry.base_points_m, axis=1)
    done, stride = 0.0, 1.0
    while done < 1.0:
        target = min(1.0, done + stride)
        newton = _newton(geometry, home + target * (legs_m - home), origin, rotation)
        if newton is None:
            stride /= 2
            if stride < 1e-3:
                text = ", ".join(f"{n} {v:.4f} m" for n, v in zip(LEGS, legs_m, strict=True))
                raise OutsideWorkspace(f"Legs of {text} do not close in the working mode.")
        else:
            (origin, rotation), done = newton, target
    return origin, rotation


def _newton(
    geometry: PkmGeometry, legs_m: Matrix, origin: Matrix, rotation: Matrix
) -> tuple[Matrix, Matrix] | None:
    """Return the closure near to a platform pose, or None where Newton's method loses it."""
    for _ in range(25):
        legs = _legs(geometry, origin, rotation)
        sideways = np.einsum("ij,ij->i", legs, rotation.T[_NORMALS])
        fault = np.concatenate([(np.einsum("ij,ij->i", legs, legs) - legs_m**2) / 2, sideways])
        try:
            step = np.linalg.solve(_slope(geometry, origin, rotation), -fault)
        except np.linalg.LinAlgError:
            return None
        size = float(np.abs(step).max())
        if size > 0.3:
            return None
        origin, rotation = origin + step[:3], _turn(step[3:]) @ rotation
        if size < 1e-10:  # the rest is of second order
            working = rotation[0, 0] > 0 and rotation[1, 1] > 0 and origin @ rotation[:, 2] > 0
            return (origin, rotation) if working else None
    return None


def _legs(geometry: PkmGeometry, origin: Matrix, rotation: Matrix) -> Matrix:
    """Return the vectors from A, B, C to A', B', C' [m], shape (3, 3), one row a leg."""
    joints: Matrix = origin + geometry.platform_points_m @ rotation.T
    return joints - geometry.base_points_m


def _slope(geometry: PkmGeometry, origin: Matrix, rotation: Matrix) -> Matrix:
    """Return the derivative of the constraints by a small motion of the platform, shape (6, 6).

    Rows: half the squared lengths of A, B, C; then their parts along the revolute joints that
    they are perpendicular to. Columns: shift [m]; rotation vector [rad] in the base frame.
    """
    legs = _legs(geometry, origin, rotation)
    arms, normals = geometry.platform_points_m @ rotation.T, rotation.T[_NORMALS]
    lengths = np.hstack([legs, np.cross(arms, legs)])
    return np.vstack([lengths, np.hstack([normals, np.cross(arms - legs, normals)])])


def _turn(vector: Matrix) -> Matrix:
    """Return the rotation by a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = (float(value) for value in vector)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    half = float(np.sinc(angle / (2 * math.pi)))
    turn: Matrix = np.eye(3) + np.sinc(angle / math.pi) * cross + half**2 / 2 * (cross @ cross)
    return turn
