"""Joint angles for poses of the tip, and joint paths to a target and back.

Postures nearest to home come first. A closed form, if the arm has one, gives all of them. Seven
joints leave one degree of freedom: the elbow swings about the line from shoulder to wrist. If the
description names the elbow's joint and the hand points straight down, each start of the search
gives one elbow position. Otherwise the search starts from postures spread evenly over the joint
ranges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import count, islice, pairwise
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.pose import DOWN, Point, is_same_direction
from skillplan_pinocchio.arm_model import (
    ArmModel,
    Vector,
    get_closing_yaw_rad,
    make_hand_pose,
    make_pose_down,
)
from skillplan_pinocchio.kinematics.fixed_order import dot, length, solve_linear, times
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.kinematics.numeric_inverse import Unreached

# Accuracy of a solution in position [m] and rotation [rad].
ACCURACY: Final = 1e-7

# Swing of the elbow in the starts [rad], nearest first.
ELBOWS_RAD: Final = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)

_MOST_ITERATIONS = 120
_MOST_STEP_RAD = 0.3
_PARTLY_ITERATIONS = 60
_DAMPING = 1e-4
# Share of the distance to the start's posture that an iteration closes; not in the last ones.
_PULL = 0.3
_PULLED_ITERATIONS = 25
_IDENTITY = np.eye(6)
# Number of postures and of starts for a hand that does not point down.
_POSTURES = 6
_TRIES = 24
# Directions with a cosine below this differ.
_STRAIGHT = 1 - 1e-9
# Number of motions whose paths are kept.
_MOST_KNOWN = 1_000
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Unreachable:
    """A pose that is out of reach, and the reason.

    Parameters
    ----------
    position
        Target of the tip [m].
    why
        Reason in words, such as ``joint 4 at its limit``.
    distance_m
        Distance from the target to the nearest tip position found [m].
    points
        Unit vector along which the hand should point.
    off_yaw
        True if the hand gets there and points that way, but is turned about its axis.
    """

    position: Point
    why: str
    distance_m: float
    points: Point = DOWN
    off_yaw: bool = False

    @property
    def reason(self) -> str:
        """The reason as one clause."""
        if self.off_yaw:
            where = ", ".join(f"{value:.3f}" for value in self.position)
            return f"the jaws cannot close as they should at ({where}): {self.why}"
        where = ", ".join(f"{value:.3f}" for value in self.position)
        if is_same_direction(self.points, DOWN):
            return f"the hand cannot point straight down at ({where}): {self.why}"
        along = ", ".join(f"{value:.2f}" for value in self.points)
        return f"the hand cannot point along ({along}) at ({where}): {self.why}"


def iterate_elbows(
    arm: ArmModel, position: Point, closing_yaw: float
) -> Iterator[Vector | Unreachable]:
    """Yield joint angles for a hand that points down, nearest to the home posture first.

    Jaws also close alike with the hand turned by half a turn, so both turns are tried.

    Parameters
    ----------
    position
        Target of the tip in the world [m].
    closing_yaw
        Closing direction of the jaws, from x about the vertical [rad].

    Yields
    ------
    Vector or Unreachable
        Joint angles [rad] within their limits, shape (joints,), with the tip within 1e-6 m and 1e-6
        rad of the pose; or the reason why a start failed.
    """
    _, rotation = arm.tip(arm.home_rad)
    swing = arm.description.swing
    if swing is None or not arm.mount.is_upright or rotation[2, 2] > -_STRAIGHT:
        yield from iterate_postures(arm, make_pose_down(position, closing_yaw))
        return
    base, elbow, hand = swing
    turned, home = arm.mount.yaw_rad, arm.home_rad
    home_yaw = get_closing_yaw_rad(rotation) - turned
    away = arm.mount.position
    bearing = math.atan2(position[1] - away[1], position[0] - away[0]) - turned
    for elbow_rad in ELBOWS_RAD:
        starts = []
        for turn in (0.0, math.pi):
            # Seen from above, the hand turns against the first joint.
            wrist = home[hand] - _wrap(closing_yaw - turned + turn - home_yaw - bearing)
            wrist = _find_turn(wrist, arm.low_rad[hand], arm.high_rad[hand])
            # Less turn of the hand leaves more room for later motions.
            starts.append((abs(wrist), wrist, turn))
        for _, wrist, turn in sorted(starts):
            start = home.copy()
            start[base] = bearing - elbow_rad
            start[elbow] = elbow_rad
            start[hand] = wrist
            yield solve(arm, make_pose_down(position, closing_yaw + turn), start, pull=_PULL)


def iterate_postures(
    arm: ArmModel, target: Any, near: Vector | None = None, *, is_exact: bool = False
) -> Iterator[Vector | Unreachable]:
    """Yield joint angles for a hand that points anywhere, nearest to a posture first.

    Jaws also close alike with the hand turned by half a turn, so both turns are tried.

    Parameters
    ----------
    target
        Target pose of the tip, as `pinocchio.SE3`.
    near
        Reference posture [rad], shape (joints,). Default: the home posture.
    is_exact
        True to try the given turn alone.

    Yields
    ------
    Vector or Unreachable
        Joint angles [rad] within their limits, shape (joints,); or the reason why there are none.
    """
    candidates: list[Vector] = []
    for turn in (np.eye(3), _HALF_TURN)[: 1 if is_exact else 2]:
        turned = pin.SE3(times(target.rotation, turn), target.translation)
        if near is not None:
            closest = solve(arm, turned, near)
            candidates += [] if isinstance(closest, Unreachable) else [closest]
        candidates += _find_solutions(arm, turned)
    if not candidates:
        yield _solve_from_other_starts(arm, target)
        return
    reference = arm.home_rad if near is None else near
    # The sort is stable for equal distances.
    yield from sorted(
        candidates, key=lambda joints: round(float(np.abs(joints - reference).max()), 6)
    )


def _find_solutions(arm: ArmModel, target: Any) -> list[Vector]:
    if arm.closed_form is None:
        return arm.inverse.several(target, _POSTURES, _TRIES)
    turn = 2 * math.pi
    solutions = []
    for joints in arm.closed_form.solve(target):
        # Take the full turn of each joint nearest to home.
        nearest = joints + turn * np.round((arm.home_rad - joints) / turn)
        nearest = np.where(nearest < arm.low_rad, nearest + turn, nearest)
        nearest = np.where(nearest > arm.high_rad, nearest - turn, nearest)
        solutions.append(nearest)
    return solutions


def _solve_from_other_starts(arm: ArmModel, target: Any) -> Vector | Unreachable:
    """Return joint angles from other starts, or the reason why there are none."""
    if arm.closed_form is not None:
        return solve(arm, target, arm.home_rad)
    solution = arm.inverse.solve(target)
    if not isinstance(solution, Unreached):
        return solution
    return _make_unreachable(arm, target, solution.reason, solution.distance_m)


def _make_unreachable(arm: ArmModel, target: Any, why: str, distance_m: float) -> Unreachable:
    x, y, z = (float(value) for value in target.translation)
    px, py, pz = (float(value) for value in target.rotation[:, 2])
    freedoms, off_yaw = arm.description.freedoms, False
    if freedoms < 6:
        # With few joints a place is reached, but the hand is turned; that is the reason then.
        for rows in (5, 3):
            joints = _reach_partly(arm, target, rows)
            if joints is None:
                continue
            own = arm.tip(joints)[1].T @ target.rotation
            if rows == 5:
                turn = (math.degrees(math.atan2(own[1, 0], own[0, 0])) + 90) % 180 - 90
                off_yaw = True
                why = (
                    f"they are {abs(turn):.0f} deg off there, and no other of the {freedoms} "
                    "joints turns the hand about its axis; turn the part"
                )
            else:
                tilt = math.degrees(math.acos(min(1.0, max(-1.0, own[2, 2]))))
                why = f"{freedoms} joints move; the nearest posture there is {tilt:.0f} deg off"
            distance_m = 0.0
            break
    return Unreachable((x, y, z), why, round(distance_m, 6), (px, py, pz), off_yaw)


def _reach_partly(arm: ArmModel, target: Any, rows: int) -> Vector | None:
    """Return joint angles with the tip at a place, if there are any from several starts.

    Parameters
    ----------
    rows
        3 for the place alone; 5 for the direction of the hand, too.
    """
    low, high = arm.low_rad, arm.high_rad
    random = np.random.default_rng(0)
    starts = [arm.home_rad, *(random.uniform(low, high) for _ in range(_TRIES))]
    best: tuple[float, Vector] | None = None
    for start in starts:
        joints = start.copy()
        for _ in range(_PARTLY_ITERATIONS):
            position, rotation = arm.tip(joints)
            away = rotation.T @ (target.translation - position)
            x, y, z = rotation.T @ target.rotation[:, 2]
            angle = math.atan2(math.hypot(x, y), z)
            share = angle / math.hypot(x, y) if math.hypot(x, y) > ACCURACY else 1.0
            twist = np.array([*away, -y * share, x * share])
            if float(np.abs(twist[:rows]).max()) < ACCURACY:
                if best is None or angle < best[0] - ACCURACY:
                    best = (angle, joints)
                break
            jacobian = arm.error(joints, target)[1]
            if arm.serial.coupling is not None:
                inner = times(jacobian, arm.serial.coupling)[:rows]
                step = times(arm.serial.coupling, _solve_damped(inner, twist[:rows], _DAMPING))
            else:
                step = _solve_damped(jacobian[:rows], twist[:rows], _DAMPING)
            size = float(np.abs(step).max())
            step = step if size <= _MOST_STEP_RAD else step * (_MOST_STEP_RAD / size)
            joints = np.clip(joints + step, low, high)
        if best is not None and rows == 5:
            break
    return None if best is None else best[1]


def solve(arm: ArmModel, target: Any, start: Vector, pull: float = 0.0) -> Vector | Unreachable:
    """Return joint angles for a pose, from one start.

    Parameters
    ----------
    target
        Target pose of the tip, as `pinocchio.SE3`.
    start
        Joint angles [rad], shape (joints,); clipped to the limits.
    pull
        Weight in [0, 1) that holds the elbow at its start. At 0 the joints move as little as
        possible.

    Returns
    -------
    Vector or Unreachable
        Joint angles [rad] within their limits, shape (joints,); or the reason why there are none.
    """
    low, high = arm.low_rad, arm.high_rad
    posture = np.clip(start, low, high)
    joints = posture.copy()
    missed = []
    for iteration in range(_MOST_ITERATIONS):
        twist, jacobian = arm.error(joints, target)
        settled = pull == 0.0 or iteration >= _PULLED_ITERATIONS
        if settled and float(np.abs(twist).max()) < ACCURACY:
            return joints
        missed.append(twist[:3])
        step = _step(arm, jacobian, twist, 0.0 if settled else pull, posture - joints)
        moved = joints + step
        # A joint that would leave its limits stays at them; the others compensate.
        stuck = (moved < low) | (moved > high)
        if stuck.any():
            free = jacobian * ~stuck
            held = np.where(stuck, np.clip(moved, low, high) - joints, 0.0)
            step = held + _step(arm, free, twist - times(jacobian, held), 0.0, posture) * ~stuck
            moved = np.clip(joints + step, low, high)
        joints = moved
    nearest_m = min(length(error) for error in missed)
    return _make_unreachable(arm, target, _explain_failure(arm, joints, target), nearest_m)


def _step(arm: ArmModel, jacobian: Vector, twist: Vector, pull: float, back: Vector) -> Vector:
    """Return the joint step [rad] towards the pose first, and towards the posture second."""
    # Damping vanishes near the solution, where the step becomes Newton's.
    damping = min(_DAMPING, dot(twist, twist)) + 1e-12
    coupling = arm.serial.coupling
    if coupling is not None:
        inner_jacobian = times(jacobian, coupling)
        step = times(coupling, _solve_damped(inner_jacobian, twist, damping))
        size = float(np.abs(step).max())
        return step if size <= _MOST_STEP_RAD else step * (_MOST_STEP_RAD / size)
    if jacobian.shape[1] < len(twist):
        step = _solve_damped(jacobian, twist, damping)
        size = float(np.abs(step).max())
        return step if size <= _MOST_STEP_RAD else step * (_MOST_STEP_RAD / size)
    inner = times(jacobian, jacobian.T) + damping * _IDENTITY
    if pull:
        back = pull * back
        left = twist - times(jacobian, back)
        step = back + times(jacobian.T, solve_linear(inner, left))
    else:
        step = times(jacobian.T, solve_linear(inner, twist))
    size = float(np.abs(step).max())
    return step if size <= _MOST_STEP_RAD else step * (_MOST_STEP_RAD / size)


def _solve_damped(jacobian: Vector, twist: Vector, damping: float) -> Vector:
    """Return the damped least-squares step of few joints; no posture is left to prefer."""
    inner = times(jacobian.T, jacobian) + damping * np.eye(jacobian.shape[1])
    return solve_linear(inner, times(jacobian.T, twist))


def _explain_failure(arm: ArmModel, joints: Vector, target: Any) -> str:
    near = 1e-6
    at_limit = [
        str(number + 1)
        for number in range(arm.joints)
        if not arm.low_rad[number] + near < joints[number] < arm.high_rad[number] - near
    ]
    if at_limit:
        these = "joint" if len(at_limit) == 1 else "joints"
        each = "its limit" if len(at_limit) == 1 else "their limits"
        return f"{these} {' and '.join(at_limit)} at {each}"
    away = length(target.translation - arm.shoulder)
    return f"it is {away:.3f} m from the shoulder, beyond what the arm spans"


def _wrap(angle_rad: float) -> float:
    """Return an angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def _find_turn(angle_rad: float, low: float, high: float) -> float:
    """Return the full turn of an angle that lies within limits, or the nearest limit."""
    for turned in (angle_rad, angle_rad - 2 * math.pi, angle_rad + 2 * math.pi):
        if low <= turned <= high:
            return turned
    return min(max(angle_rad, low), high)


# Intervals of the spline of a path.
_INTERVALS = 8
# More for a path along a direction of insertion, which keeps it within 0.1 mm of the line.
_FINE_INTERVALS = 16


@dataclass(frozen=True)
class Strokes:
    """Joint paths to a target and back; the arm stops between two of them.

    Parameters
    ----------
    down
        Paths to the target, one per straight stretch of the tip.
    up
        Paths back from it, likewise.
    """

    down: tuple[JointPath, ...]
    up: tuple[JointPath, ...]

    @property
    def begin(self) -> Vector:
        """Start posture [rad]."""
        return np.asarray(self.down[0].nodes[0])

    @property
    def end(self) -> Vector:
        """End posture [rad]."""
        return np.asarray(self.up[-1].nodes[-1])

    @cached_property
    def mirrored(self) -> bool:
        """Return whether the way back is the way there, reversed."""
        return len(self.down) == len(self.up) and all(
            np.array_equal(there.nodes, back.nodes[::-1])
            for there, back in zip(self.down, reversed(self.up), strict=True)
        )

    @cached_property
    def distinct(self) -> tuple[JointPath, ...]:
        """All paths, without reversed duplicates."""
        return self.down if self.mirrored else (*self.down, *self.up)


def iterate_strokes(
    arm: ArmModel, motion: LinearMotion, near: Vector | None = None
) -> Iterator[Strokes | Unreachable]:
    """Yield paths to a target and back, one per posture at the target, preferred first.

    Parameters
    ----------
    near
        Posture to which the target's should be near, if the hand does not point down [rad], shape
        (joints,). Default: the home posture.

    Yields
    ------
    Strokes or Unreachable
        Paths along the motion, or the reason why a posture allows none.
    """
    if motion.is_vertical:
        yield from _iterate_mirrored(arm, motion.tip, motion.above, motion.closing_yaw_rad)
        return
    target = make_hand_pose(motion.tip, motion.orientation)
    if motion.is_exact:
        postures_at_target = iterate_postures(arm, target, near, is_exact=True)
    elif motion.points_down:
        postures_at_target = iterate_elbows(arm, motion.tip, motion.closing_yaw_rad)
    else:
        postures_at_target = iterate_postures(arm, target, near)
    for joints in postures_at_target:
        if isinstance(joints, Unreachable):
            yield joints
            continue
        yield _plan_along(arm, motion, joints)


class _Recalled(Iterable[Strokes | Unreachable]):
    """Paths that are found one after another, and kept."""

    def __init__(self, find: Callable[[], Iterator[Strokes | Unreachable]]) -> None:
        self._find = find
        self._rest: Iterator[Strokes | Unreachable] | None = None
        self._known: list[Strokes | Unreachable] = []
        self._is_whole = False

    def __iter__(self) -> Iterator[Strokes | Unreachable]:
        for number in count():
            if number == len(self._known) and not self._is_whole:
                self._extend()
            if number == len(self._known):
                return
            yield self._known[number]

    def _extend(self) -> None:
        try:
            if self._rest is None:
                self._rest = islice(self._find(), len(self._known), None)
            strokes = next(self._rest, None)
            if strokes is None:
                self._is_whole = True
            else:
                self._known.append(strokes)
        except BaseException:
            # A time limit may interrupt the search anywhere.
            self._rest = None
            raise


def list_strokes(
    arm: ArmModel, motion: LinearMotion, near: Vector | None = None
) -> Iterable[Strokes | Unreachable]:
    """Return the paths of :func:`iterate_strokes`, which are found when they are needed.

    The last motions of an arm are kept, as tasks with fewer parts have the same ones.
    """
    if motion.is_vertical:
        return list_descents(arm, motion.tip, motion.above, motion.closing_yaw_rad)
    way = (motion.tip, motion.closing_yaw_rad, motion.orientation, motion.is_exact)
    key = (*way, motion.approach, motion.retreat, None if near is None else near.tobytes())
    return _recall(arm, key, partial(iterate_strokes, arm, motion, near))


def list_descents(
    arm: ArmModel, tip: Point, above: Point, closing_yaw: float
) -> Iterable[Strokes | Unreachable]:
    """Return the paths of :func:`iterate_descents` and back, likewise."""
    key = (tip, above, closing_yaw)
    return _recall(arm, key, partial(_iterate_mirrored, arm, tip, above, closing_yaw))


def _recall(
    arm: ArmModel, key: tuple[Any, ...], find: Callable[[], Iterator[Strokes | Unreachable]]
) -> _Recalled:
    known: dict[tuple[Any, ...], _Recalled] = arm.known_strokes
    known[key] = recalled = known.pop(key, None) or _Recalled(find)
    if len(known) > _MOST_KNOWN:
        known.pop(next(iter(known)))
    return recalled


def _iterate_mirrored(
    arm: ArmModel, tip: Point, above: Point, closing_yaw: float
) -> Iterator[Strokes | Unreachable]:
    for path in iterate_descents(arm, tip, above, closing_yaw):
        yield path if isinstance(path, Unreachable) else mirror_path(path)


def mirror_path(path: JointPath) -> Strokes:
    """Return a path and its reverse."""
    return Strokes((path,), (JointPath(path.nodes[::-1]),))


def _plan_along(arm: ArmModel, motion: LinearMotion, joints: Vector) -> Strokes | Unreachable:
    """Return the paths to a posture at the target and back."""
    # Keep the turn of the hand that was found.
    _, rotation = arm.tip(joints)
    there = _follow_points(arm, motion.approach[::-1], joints, rotation)
    if isinstance(there, Unreachable):
        return there
    back = _follow_points(arm, motion.retreat, joints, rotation)
    if isinstance(back, Unreachable):
        return back
    down = tuple(JointPath(path.nodes[::-1]) for path in reversed(there))
    return Strokes(down, back)


def _follow_points(
    arm: ArmModel, points: Sequence[Point], joints: Vector, rotation: Any
) -> tuple[JointPath, ...] | Unreachable:
    """Return the paths along straight stretches of the tip, from a posture at the first point."""
    paths = []
    for begin, end in pairwise(points):
        nodes = [joints]
        for number in range(1, _FINE_INTERVALS + 1):
            position = np.array(_interpolate(begin, end, number / _FINE_INTERVALS))
            reached = solve(arm, pin.SE3(rotation, position), nodes[-1])
            if isinstance(reached, Unreachable):
                return reached
            nodes.append(reached)
        joints = nodes[-1]
        paths.append(JointPath(nodes))
    return tuple(paths)


def iterate_descents(
    arm: ArmModel, tip: Point, above: Point, closing_yaw: float
) -> Iterator[JointPath | Unreachable]:
    """Yield paths straight down to a target, by elbow position; see :func:`iterate_elbows`.

    Parameters
    ----------
    tip
        End of the path [m].
    above
        Start of the path, straight above [m].
    closing_yaw
        Closing direction of the jaws, from x about the vertical [rad].

    Yields
    ------
    JointPath or Unreachable
        Path from `above` to `tip`, or the reason why this elbow position allows none.
    """
    for elbow in iterate_elbows(arm, tip, closing_yaw):
        if isinstance(elbow, Unreachable):
            yield elbow
            continue
        _, rotation = arm.tip(elbow)
        # Keep the turn of the hand that was found.
        yaw = get_closing_yaw_rad(rotation)
        nodes = [elbow]
        reached: Vector | Unreachable = elbow
        for number in range(1, _INTERVALS + 1):
            share = number / _INTERVALS
            position = _interpolate(tip, above, share)
            reached = solve(arm, make_pose_down(position, yaw), nodes[-1])
            if isinstance(reached, Unreachable):
                break
            nodes.append(reached)
        yield reached if isinstance(reached, Unreachable) else JointPath(nodes[::-1])


def _interpolate(begin: Vector | Point, end: Vector | Point, share: float) -> Point:
    x, y, z = (
        float(a + share * (b - a)) for a, b in zip(np.asarray(begin), np.asarray(end), strict=True)
    )
    return (x, y, z)
