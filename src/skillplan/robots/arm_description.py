"""Serial arms and hands as data: joints, limits, masses, shapes, outline and force of jaws.

All shapes of links are convex, which every engine supports. This module checks data and computes
nothing else.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

Triple = tuple[float, float, float]
"""Three coordinates, or three angles."""


@dataclass(frozen=True, slots=True)
class Hull:
    """The convex hull of corners.

    Parameters
    ----------
    corners_m
        Corners in the link's frame [m], at least four, not coplanar.

    Raises
    ------
    ValueError
        If there are fewer, or one is not finite.
    """

    corners_m: tuple[Triple, ...]

    def __post_init__(self) -> None:
        if len(self.corners_m) < 4:
            raise ValueError(f"Hull needs four corners at least, not {len(self.corners_m)}.")
        for corner in self.corners_m:
            _require_point("Hull corner", corner)


@dataclass(frozen=True, slots=True)
class Capsule:
    """All points within a distance of a segment; a ball if its ends coincide.

    Parameters
    ----------
    start_m, end_m
        Ends of the segment in the link's frame [m].
    radius_m
        Radius [m], > 0.

    Raises
    ------
    ValueError
        If the radius is not positive, or a number not finite.
    """

    start_m: Triple
    end_m: Triple
    radius_m: float

    def __post_init__(self) -> None:
        _require_round("Capsule", self.start_m, self.end_m, self.radius_m)


@dataclass(frozen=True, slots=True)
class Rod:
    """A cylinder between two points, with flat ends.

    Parameters
    ----------
    start_m, end_m
        Distinct centres of its ends in the link's frame [m].
    radius_m
        Radius [m], > 0.

    Raises
    ------
    ValueError
        If the radius is not positive, a number not finite, or the ends coincide.
    """

    start_m: Triple
    end_m: Triple
    radius_m: float

    def __post_init__(self) -> None:
        _require_round("Rod", self.start_m, self.end_m, self.radius_m)
        if self.start_m == self.end_m:
            raise ValueError("Rod must have two ends.")


LinkShape = Hull | Capsule | Rod
"""A shape of a link."""


def read_hulls(name: str) -> tuple[tuple[Hull, ...], ...]:
    """Return the convex pieces of a shipped robot's bodies, in the order of its file.

    Parameters
    ----------
    name
        File in the folder ``shapes``, without its suffix.
    """
    return build_hulls(read_data(f"shapes/{name}.json")["hulls_mm"])


def read_data(name: str) -> Any:
    """Return a JSON file of this package; all numbers are floats."""
    return json.loads((Path(__file__).parent / name).read_text("utf-8"), parse_int=float)


def build_hulls(bodies: list[list[list[Triple]]]) -> tuple[tuple[Hull, ...], ...]:
    """Return convex pieces from the corners of each piece of each body [mm]."""
    return tuple(
        tuple(Hull(tuple((x / 1e3, y / 1e3, z / 1e3) for x, y, z in hull)) for hull in hulls)
        for hulls in bodies
    )


def _require_round(what: str, start_m: Triple, end_m: Triple, radius_m: float) -> None:
    _require_point(f"{what} start_m", start_m)
    _require_point(f"{what} end_m", end_m)
    if not (math.isfinite(radius_m) and radius_m > 0):
        raise ValueError(f"{what} radius_m must be > 0, not {radius_m}.")


def _require_point(what: str, point: Triple) -> None:
    if len(point) != 3 or not all(math.isfinite(value) for value in point):
        raise ValueError(f"{what} must be three finite numbers, not {point}.")


# The defaults below are constructed on import and use these checks.
def _require_finite(what: str, values: tuple[float, ...], count: int) -> None:
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise ValueError(f"{what} must be {count} finite numbers, not {values}.")


def _is_positive(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> bool:
    """Return True if a symmetric matrix is positive definite, by Sylvester's criterion."""
    second = xx * yy - xy * xy
    third = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return xx > 0 and second > 0 and third > 0


@dataclass(frozen=True, slots=True)
class Transform:
    """Pose of a frame in another: a shift, then rotations about fixed x, y and z in this order.

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
        """Return the transform after a joint's rotation by the standard parameters (distal frames).

        Parameters
        ----------
        a_m, d_m
            Length and offset of the link [m].
        alpha_rad
            Twist of the link [rad].
        """
        return cls((a_m, 0.0, d_m), (alpha_rad, 0.0, 0.0))

    @classmethod
    def from_modified_dh(cls, a_m: float, d_m: float, alpha_rad: float) -> Transform:
        """Return the transform before a joint's rotation by Craig's parameters (proximal frames).

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
    """Mass of a link, its centre, and the inertia about the centre.

    Parameters
    ----------
    mass_kg
        Mass [kg], > 0.
    centre_m
        Centre of mass in `frame` [m].
    tensor_kg_m2
        Inertia about the centre of mass, along the axes of `frame` [kg m2]: xx, yy, zz, xy, xz and
        yz.
    frame
        Frame of the source, relative to the joint that moves the link.

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
        # A rigid body has positive second moments, tr/2 - J; then J is positive as well.
        xx, yy, zz, xy, xz, yz = self.tensor_kg_m2
        half = (xx + yy + zz) / 2
        if not _is_positive(half - xx, half - yy, half - zz, -xy, -xz, -yz):
            raise ValueError(f"No body has the inertia {self.tensor_kg_m2}.")


@dataclass(frozen=True, slots=True)
class Joint:
    """A revolute or prismatic joint, and the link that it moves.

    Fields of a prismatic joint count metres and newtons instead of radians and newton metres.

    Parameters
    ----------
    name
        Not empty.
    placement
        Frame at angle 0, in the frame of the joint before, or of the base.
    low_rad, high_rad
        Limits of the angle [rad]; of a prismatic joint, of its stroke [m].
    speed_rad_per_s, acceleration_rad_per_s2
        Greatest speed [rad/s] and acceleration [rad/s2], > 0; of a prismatic joint [m/s] and
        [m/s2].
    torque_nm
        Greatest torque [Nm], of a prismatic joint greatest force [N], > 0; None if unknown.
    link
        Mass of the moved link; None if unknown.
    axis
        Unit vector of the axis in its frame.
    is_prismatic
        True for a prismatic joint.
    follows
        For a joint that another one moves: number of that joint, factor and offset of its position.

    Raises
    ------
    ValueError
        If a limit is not positive or not finite, the range of angles is empty, the axis is not of
        length 1, or the name is empty.
    """

    name: str
    placement: Transform
    low_rad: float
    high_rad: float
    speed_rad_per_s: float
    acceleration_rad_per_s2: float
    torque_nm: float | None
    link: LinkInertia | None
    axis: Triple = (0.0, 0.0, 1.0)
    is_prismatic: bool = False
    follows: tuple[int, float, float] | None = None

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
    """A serial arm of revolute and prismatic joints.

    Parameters
    ----------
    name
        Name of the robot, not empty.
    joints
        Joints from the base to the tip, at least one, with distinct names.
    tip
        Flange that holds hands and tools, in the frame of the last joint.
    home_rad
        A posture with room for every joint [rad], of prismatic joints [m], within the limits.
    shapes
        Collision shapes of the base in its frame, then of every link in the frame of its joint;
        empty
        if unknown.
    reach_m
        Working distance from the base as published [m]; None for the length of the links.
    swing
        For an arm with a spare joint, whose first axis is z of its base and which points down at
        home:
        numbers of the joints that turn the whole arm, swing its elbow, and turn its hand. None for
        other arms.
    payload_kg
        Greatest mass at the flange as published, hand and tool included [kg], > 0; None if unknown.
    overlaps
        Numbers of two bodies each, 0 for the base, whose shapes overlap in most postures because
        they are larger than the links: these pairs are not checked.
    assumptions
        Sentences on values that its file does not give, and on parts of it that are left out.

    Raises
    ------
    ValueError
        If a value is inconsistent.
    """

    name: str
    joints: tuple[Joint, ...]
    tip: Transform
    home_rad: tuple[float, ...]
    shapes: tuple[tuple[LinkShape, ...], ...] = ()
    reach_m: float | None = None
    swing: tuple[int, int, int] | None = None
    payload_kg: float | None = None
    overlaps: tuple[tuple[int, int], ...] = ()
    assumptions: tuple[str, ...] = ()

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
        for number, joint in enumerate(self.joints):
            leader = None if joint.follows is None else joint.follows[0]
            if leader is not None and (
                not 0 <= leader < len(self.joints) or self.joints[leader].follows is not None
            ):
                raise ValueError(f"Arm {self.name}: joint {joint.name} follows no other joint.")
            if abs(self.follow(self.home_rad)[number] - self.home_rad[number]) > 1e-6:
                raise ValueError(f"Arm {self.name}: home_rad has {joint.name} off its leader.")
        if self.shapes and len(self.shapes) != len(self.joints) + 1:
            raise ValueError(
                f"Arm {self.name}: shapes must be of the base and each of {len(self.joints)} "
                f"links, not of {len(self.shapes)}."
            )
        for what in ("reach_m", "payload_kg"):
            value = getattr(self, what)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"Arm {self.name}: {what} must be > 0, not {value}.")

    def follow(self, joints_rad: Sequence[float]) -> tuple[float, ...]:
        """Return a posture with each following joint where its leader puts it."""
        return tuple(
            angle
            if joint.follows is None
            else joint.follows[1] * joints_rad[joint.follows[0]] + joint.follows[2]
            for joint, angle in zip(self.joints, joints_rad, strict=True)
        )

    @property
    def freedoms(self) -> int:
        """Number of joints that move independently."""
        return sum(joint.follows is None for joint in self.joints)

    @property
    def works_within_m(self) -> float:
        """Working distance from the base [m]."""
        if self.reach_m is not None:
            return self.reach_m
        frames = (*(joint.placement for joint in self.joints), self.tip)
        strokes_m = (
            max(abs(joint.low_rad), abs(joint.high_rad))
            for joint in self.joints
            if joint.is_prismatic
        )
        return sum(math.hypot(*frame.xyz_m) for frame in frames) + sum(strokes_m)

    @property
    def without_shape(self) -> tuple[int, ...]:
        """Numbers of the links without a shape; 0 is the base."""
        if not self.shapes:
            return tuple(range(len(self.joints) + 1))
        return tuple(number for number, shapes in enumerate(self.shapes) if not shapes)

    @property
    def not_checked(self) -> tuple[str, ...]:
        """Sentences on contacts and torques that cannot be checked for lack of data."""
        sentences = []
        links = ["the base" if not number else f"link {number}" for number in self.without_shape]
        if links:
            sentences.append(
                f"contacts of {', '.join(links)} of {self.name}: its description has no collision "
                "shape for them"
            )
        if self.overlaps:
            pairs = ", ".join(
                f"link {other_link} with {f'link {link}' if link else 'the base'}"
                for link, other_link in self.overlaps
            )
            sentences.append(
                f"contacts of {pairs} of {self.name}: their shapes overlap in most postures"
            )
        joints = [joint.name for joint in self.joints if joint.torque_nm is None]
        if joints:
            sentences.append(
                f"torques of {', '.join(joints)} of {self.name}: its description has no limit"
            )
        unweighed = [joint.name for joint in self.joints if joint.link is None]
        if unweighed:
            sentences.append(
                f"weight of the links after {', '.join(unweighed)} of {self.name}: its description "
                "has no mass for them"
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


_NOWHERE = Transform()
# Rounding of outlines [m].
_ROUNDING_M = 1e-6

JawProfile = tuple[tuple[float, float, float, float], ...]
"""See :attr:`Hand.jaw_m`."""


def _is_convex(rows: Sequence[tuple[float, float, float, float]]) -> bool:
    """Return whether no row of a jaw lies inside the hull of its neighbours."""
    for below, row, above in zip(rows, rows[1:], rows[2:], strict=False):
        span_m = above[0] - below[0]
        share = (row[0] - below[0]) / span_m if span_m > 0 else 0.0
        half_m, begin_m, end_m = (
            low_m + share * (high_m - low_m)
            for low_m, high_m in zip(below[1:], above[1:], strict=True)
        )
        if max(half_m - row[1], row[2] - begin_m, end_m - row[3]) > _ROUNDING_M:
            return False
    return True


@dataclass(frozen=True, slots=True)
class Hand:
    """A hand with two jaws that close along the y axis of its frame; z points out of it.

    Parameters
    ----------
    opening_m
        Greatest distance between the jaws [m], > 0.
    tip_m
        Distance from the hand's frame to the ends of its jaws along z [m], > 0.
    force_n
        Greatest closing force [N], > 0.
    jaw_m
        Outline of a jaw, from its end upwards: height above the end, half its width across the
        closing
        axis, and begin and end behind its face along that axis [m]. Convex in between.
    body_m
        Outline of the body, from its underside upwards: depth in the hand's frame, half its extent
        along the closing axis, and half its extent across it [m]. Convex in between.
    on_flange
        Frame of the hand on the flange.
    jaw_corners_m
        Exact corners of a jaw, may be empty: distance behind its face, across the closing axis, and
        height above its end [m].
    body_corners_m
        Exact corners of the body, may be empty: along the closing axis, across it, and depth in the
        hand's frame [m]. They need not be symmetric.
    mass_kg
        Mass [kg], >= 0; 0 if unknown.
    beyond_m
        Distance of the jaws' ends beyond the tip of the arm [m], negative if they end before it;
        0 for the arm's own hand.
    jaw_pieces_m
        Convex pieces of a jaw as `jaw_corners_m`, if it is not one; else empty.
    body_pieces_m
        Convex pieces of the body as `body_corners_m`, if it is not one; else empty.

    Raises
    ------
    ValueError
        If a length or the force is not positive, or an outline has fewer than two heights.
    """

    opening_m: float
    tip_m: float
    force_n: float
    jaw_m: JawProfile
    body_m: tuple[tuple[float, float, float], ...]
    on_flange: Transform = _NOWHERE
    jaw_corners_m: tuple[Triple, ...] = ()
    body_corners_m: tuple[Triple, ...] = ()
    mass_kg: float = 0.0
    beyond_m: float = 0.0
    jaw_pieces_m: tuple[tuple[Triple, ...], ...] = ()
    body_pieces_m: tuple[tuple[Triple, ...], ...] = ()

    def __post_init__(self) -> None:
        for what in ("opening_m", "tip_m", "force_n"):
            value = getattr(self, what)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"Hand {what} must be > 0, not {value}.")
        if not (math.isfinite(self.mass_kg) and self.mass_kg >= 0):
            raise ValueError(f"Hand mass_kg must be >= 0, not {self.mass_kg}.")
        for what, rows in (("jaw_m", self.jaw_m), ("body_m", self.body_m)):
            if len(rows) < 2 or not all(math.isfinite(x) for row in rows for x in row):
                raise ValueError(f"Hand {what} needs two heights at least, all of them finite.")

    def jaw_thickness_m(self, depth_m: float) -> float:
        """Return the extent of a jaw behind its face, up to a height above its end [m]."""
        ends_m = [row[3] for row in self.jaw_m if row[0] <= depth_m]
        for below, above in pairwise(self.jaw_m):
            if below[0] < depth_m < above[0]:
                share = (depth_m - below[0]) / (above[0] - below[0])
                ends_m.append(below[3] + share * (above[3] - below[3]))
        return max(ends_m, default=self.jaw_m[0][3])

    @property
    def straight_jaw_m(self) -> float:
        """Height of a jaw above its end up to which it gets no thicker [m]."""
        end_m = self.jaw_m[0][3] + _ROUNDING_M
        return max(row[0] for row in self.jaw_m if self.jaw_thickness_m(row[0]) <= end_m)

    @property
    def tip_on_flange(self) -> Transform:
        """Ends of the jaws on the flange; the hand is only turned about the flange's axis."""
        x_m, y_m, z_m = self.on_flange.xyz_m
        return Transform((x_m, y_m, z_m + self.tip_m), self.on_flange.rpy_rad)

    @property
    def arm_tip_m(self) -> float:
        """Distance from the hand's frame to the tip of the arm [m], alike for all hands of it."""
        return self.tip_m - self.beyond_m

    @property
    def jaw(self) -> tuple[tuple[Triple, ...], ...]:
        """Convex pieces of a jaw: behind its face, across the closing axis, above its end [m]."""
        if self.jaw_pieces_m:
            return self.jaw_pieces_m
        if self.jaw_corners_m:
            return (self.jaw_corners_m,)
        # A slim jaw below a thick one is no single piece: its hull would be a wedge.
        rows = [self.jaw_m] if _is_convex(self.jaw_m) else list(pairwise(self.jaw_m))
        return tuple(
            tuple(
                (behind_m, side * half_m, height_m)
                for height_m, half_m, begin_m, end_m in piece
                for behind_m in (begin_m, end_m)
                for side in (-1, 1)
            )
            for piece in rows
        )

    @property
    def jaw_block_m(self) -> tuple[Triple, Triple]:
        """Lower and upper corner of the block with the flat face that engines use, as `jaw` [m].

        It has the full width of the outline up to the end of a jaw, where the exact corners narrow.
        """
        heights_m, halves_m, begins_m, ends_m = zip(*self.jaw_m, strict=True)
        half_m = min(halves_m)
        low = (max(begins_m), -half_m, heights_m[0])
        return low, (min(ends_m), half_m, heights_m[-1])

    @property
    def body(self) -> tuple[tuple[Triple, ...], ...]:
        """Corners of convex pieces of the body: along the closing axis, across it, depth [m].

        A hand may be turned by half a turn, because its jaws close alike. An asymmetric body is
        therefore
        two pieces: as described and turned.
        """
        if self.body_pieces_m:
            turned_pieces = (
                tuple((-x_m, -y_m, z_m) for x_m, y_m, z_m in piece) for piece in self.body_pieces_m
            )
            seen = {frozenset(piece) for piece in self.body_pieces_m}
            others = (piece for piece in turned_pieces if frozenset(piece) not in seen)
            return (*self.body_pieces_m, *others)
        if self.body_corners_m:
            turned = tuple((-x_m, -y_m, z_m) for x_m, y_m, z_m in self.body_corners_m)
            return (self.body_corners_m, turned)
        corners = tuple(
            (a * length_m, b * width_m, depth_m)
            for depth_m, length_m, width_m in self.body_m
            for a in (-1, 1)
            for b in (-1, 1)
        )
        return (corners,)

    @property
    def body_as_described(self) -> tuple[tuple[Triple, ...], ...]:
        """Corners of the body without the pieces that are turned by half a turn; see `body`."""
        return self.body_pieces_m or self.body[:1]

    @property
    def underside_m(self) -> float:
        """Depth of the end of the body in the hand's frame [m]."""
        return max(row[0] for row in self.body_m)

    @property
    def half_length_m(self) -> float:
        """Half the extent of its body along the closing axis [m]."""
        return max(row[1] for row in self.body_m)

    @property
    def half_width_m(self) -> float:
        """Half the extent of its body across the closing axis [m]."""
        return max(row[2] for row in self.body_m)

    @property
    def jaw_half_width_m(self) -> float:
        """Half the width of the end of a jaw [m]."""
        return self.jaw_m[0][1]
