"""The motions of a skill as the arm makes them: with which elbow, and what its links may meet."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import coal
import numpy as np

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.task.motion import Event, Grasp, Point
from skillplan.task.pose import dot
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import ArmModel, LinkPiece, Vector
from skillplan_pinocchio.gravity import GravityCheck, Overload
from skillplan_pinocchio.inverse_kinematics import (
    Strokes,
    Unreachable,
    descent_paths,
    strokes,
    there_and_back,
)
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.continuous_check import Held, Hit, SelfCheck
from skillplan_pinocchio.shapes import ConvexPiece, Obstacle, geometry_nearness
from skillplan_pinocchio.sweep import Touch

# Between the nodes of a path a link bulges out by no more than this [m].
_BULGE_M = 0.02
_STILL = coal.Transform3s()


@dataclass(frozen=True)
class LinkTouch:
    """Which link touches something first, and where.

    Parameters
    ----------
    link
        Number of the joint that moves it.
    touch
        Where.
    """

    link: int
    touch: Touch


@dataclass(frozen=True)
class _Places:
    """Where links are in some postures.

    Parameters
    ----------
    rotations, origins
        Of the joints' frames, shapes (postures, joints, 3, 3) and (postures, joints, 3) [m].
    low, high
        Corners of the upright boxes about the pieces, shape (postures, pieces, 3) [m].
    """

    rotations: Vector
    origins: Vector
    low: Vector
    high: Vector


class LinkSweep:
    """The links of the arm along a path.

    Parameters
    ----------
    arm
        The arm.
    path
        Of its joints.
    """

    def __init__(self, arm: ArmModel, path: JointPath) -> None:
        self.arm = arm
        self.path = path
        self._sampled: dict[int, _Places] = {}

    def touch(self, obstacle: Obstacle, tolerance_m: float, samples: int) -> LinkTouch | None:
        """Return which link touches an obstacle first, or None.

        Parameters
        ----------
        obstacle
            What may block the motion.
        tolerance_m
            Depth that still counts as touching without harm [m], >= 0.
        samples
            How many equally spaced intervals of the path are checked, >= 1.
        """
        lows, highs = self._reach
        near = [
            (number, piece)
            for piece in obstacle.pieces
            for number in np.flatnonzero(_overlap(lows, highs, piece, 0.0)).tolist()
        ]
        if not near:
            return None
        places = self._at(samples)
        first: tuple[int, int] | None = None
        found = None
        depth_m = 0.0
        for number, piece in near:
            low, high = places.low[:, number], places.high[:, number]
            for sample in np.flatnonzero(_overlap(low, high, piece, tolerance_m)).tolist():
                distance_m, position = self._nearness(places, sample, number, piece)
                if distance_m >= -tolerance_m:
                    continue
                depth_m = max(depth_m, -distance_m)
                if first is None or (sample, number) < first:
                    first, found = (sample, number), position
        if first is None or found is None:
            return None
        sample, number = first
        touch = Touch(sample / samples, found, round(depth_m, 6))
        return LinkTouch(self._pieces[number].link, touch)

    @property
    def _pieces(self) -> tuple[LinkPiece, ...]:
        return self.arm.pieces

    def _nearness(
        self, places: _Places, sample: int, number: int, piece: ConvexPiece
    ) -> tuple[float, tuple[float, float, float]]:
        of_link = self._pieces[number]
        rotation = places.rotations[sample, of_link.link - 1]
        origin = places.origins[sample, of_link.link - 1]
        frame = of_link.frame
        placement = coal.Transform3s(
            rotation @ frame.rotation, rotation @ frame.translation + origin
        )
        found = geometry_nearness(of_link.geometry, placement, piece.hull, _STILL)
        return found.distance_m, found.position

    def _at(self, samples: int) -> _Places:
        if samples not in self._sampled:
            postures = [self.path.at(number / samples) for number in range(samples + 1)]
            self._sampled[samples] = self._placed(postures)
        return self._sampled[samples]

    @cached_property
    def _reach(self) -> tuple[Vector, Vector]:
        """The boxes in which each link stays [m], shapes (pieces, 3)."""
        places = self._placed(list(self.path.nodes))
        return places.low.min(axis=0) - _BULGE_M, places.high.max(axis=0) + _BULGE_M

    def _placed(self, postures: list[Vector]) -> _Places:
        rotations, origins = self.arm.frames(postures)
        joints, centres, halves = self.arm.boxes
        turned = rotations[:, joints]
        middle = np.einsum("spij,pj->spi", turned, centres) + origins[:, joints]
        reach = np.einsum("spij,pj->spi", np.abs(turned), halves)
        return _Places(rotations, origins, middle - reach, middle + reach)


def _overlap(low: Vector, high: Vector, piece: ConvexPiece, tolerance_m: float) -> Vector:
    """Return which boxes overlap the box about a piece by more than the tolerance."""
    inside = (low + tolerance_m < np.array(piece.high)) & (high - tolerance_m > np.array(piece.low))
    return np.asarray(inside.all(axis=1))


Hold = tuple[str, Grasp | None]
"""A part, and how it is held where that is a matter of choice."""


def hold_of(motion: LinearMotion) -> Hold | None:
    """Return what a motion takes or lets go, and how it is held; None for any other."""
    visit = motion.visit
    return (visit.subject, visit.grasp) if visit.event in (Event.GRASP, Event.RELEASE) else None


def holds_of(task: Task, drop_height_m: float) -> Mapping[Hold, tuple[LinearMotion, ...]]:
    """Return the motions of a task by what they hold, in the order of its skills.

    Parameters
    ----------
    task
        The task.
    drop_height_m
        From how high above its goal a part is let go [m], >= 0.
    """
    found: dict[Hold, dict[LinearMotion, None]] = {}
    for skill in task.skills:
        for one in [skill.by(way) for way in skill.ways] or [skill]:
            for route in () if one.motion is None else one.motion.routes:
                state = one.precondition.requires | route.when
                for motion in linear_motions(task, one, state, drop_height_m):
                    hold = hold_of(motion)
                    if hold is not None:
                        found.setdefault(hold, {})[motion] = None
    return {hold: tuple(motions) for hold, motions in found.items()}


_OTHERWISE_TURNED = "only with the hand turned by half, unlike where the same part is handled"


@dataclass(frozen=True)
class Elbow:
    """The paths of the joints to a target and back, with one position of the elbow.

    Parameters
    ----------
    strokes
        Of the joints.
    meets
        What its links run into wherever that is there, in order of the motion; fractions are those
        of all paths of `strokes.distinct` together, which count alike.
    itself
        How the arm, or what it holds, runs into the arm or its base; None where it does not. Its
        place is such a fraction.
    overload
        A joint that gravity overloads; None if there is none.
    """

    strokes: Strokes
    meets: tuple[tuple[Obstacle, LinkTouch], ...]
    itself: Hit | None = None
    overload: Overload | None = None

    @property
    def is_clear(self) -> bool:
        """Whether it meets nothing in any state, and no joint is overloaded."""
        return not self.meets and self.itself is None and self.overload is None

    def at(self, fraction: float) -> Vector:
        """Return the joint angles after a fraction of all paths [rad]."""
        paths = self.strokes.distinct
        number = min(int(fraction * len(paths)), len(paths) - 1)
        return paths[number].at(fraction * len(paths) - number)

    @property
    def blocked(self) -> bool:
        """Whether it runs into what is always there, or overloads a joint."""
        never = self.itself is not None or self.overload is not None
        return never or any(obstacle.fact is None for obstacle, _ in self.meets)


@dataclass(frozen=True)
class DescentPaths:
    """The paths of the joints to a place and back.

    Parameters
    ----------
    elbows
        In the order in which they are preferred: the nearest to the ready pose of those that
        meet nothing, alone; otherwise all, those that meet the least first. Empty where there
        is none.
    unreachable
        Why there is none; None where there is one.
    """

    elbows: tuple[Elbow, ...]
    unreachable: Unreachable | None = None


@dataclass(frozen=True)
class ArmMotion:
    """A linear motion and the paths of the joints along it.

    Parameters
    ----------
    motion
        What the hand does.
    elbows, unreachable
        See :class:`DescentPaths`.
    """

    motion: LinearMotion
    elbows: tuple[Elbow, ...]
    unreachable: Unreachable | None = None


class MotionPlanner:
    """Finds the paths of the joints, once for each motion.

    Which path is preferred depends on the obstacles that there may be in any state, never on
    those that there are in one: so that a verdict rests on the facts of the obstacles met, and
    the time of a skill on none of them.

    Parameters
    ----------
    arm
        The arm.
    obstacles
        All that there may be.
    tolerance_m
        Depth that still counts as touching without harm [m], >= 0.
    samples
        How many equally spaced intervals of a path the links are checked at, >= 1.
    check_arm
        Whether the links are checked.
    held
        Returns what is at the end of the arm before a motion acts, and after that: in the world,
        as it is where the motion begins, and where it ends.
    holds
        Motions that handle the same part held the same way, by that: the hand has the same turn
        about what it points along in all of them, seen from the part.
    gravity
        Holds the torques of motions to the limits of the joints; None to leave them unchecked.
    """

    def __init__(
        self,
        arm: ArmModel,
        obstacles: Sequence[Obstacle],
        *,
        tolerance_m: float,
        samples: int,
        check_arm: bool,
        held: Callable[[LinearMotion], tuple[Held, Held]] | None = None,
        holds: Mapping[Hold, tuple[LinearMotion, ...]] | None = None,
        gravity: GravityCheck | None = None,
    ) -> None:
        self.arm = arm
        self.gravity = gravity
        self.obstacles = tuple(obstacles)
        self.tolerance_m = tolerance_m
        self.samples = samples
        self.check_arm = check_arm
        self.holds = holds or {}
        self.held = held
        self._itself = SelfCheck(arm)
        self._known: dict[tuple[Any, ...], DescentPaths] = {}
        self._turns: dict[Hold, Point | None] = {}

    def plan(self, motion: LinearMotion) -> ArmMotion:
        """Return how the arm makes a motion."""
        paths = self._paths(motion, self._closing(motion))
        return ArmMotion(motion, paths.elbows, paths.unreachable)

    def _paths(self, motion: LinearMotion, closing: Point | None) -> DescentPaths:
        """Return the paths of a motion, the jaws closing along a direction, or along either."""
        spares = spared(motion)
        ends = (motion.carries, motion.tool and motion.tool.name, motion.leaves_with)
        event = motion.visit.event
        if motion.is_vertical:
            where: tuple[Any, ...] = (motion.tip, motion.above, motion.closing_yaw_rad)
        else:
            where = (motion.approach, motion.retreat, motion.orientation)
        key = (*where, spares, *ends, event, closing)
        if key not in self._known:
            near = None if closing is None else self._taken(motion, closing)
            preferred = None if closing is None or near is not None else self._paths(motion, None)
            if preferred and closing and self._is_turned(preferred, closing):
                self._known[key] = preferred
            else:
                found = self._turned(strokes(self.arm, motion, near), closing)
                self._known[key] = self._best(found, spares, motion)
        return self._known[key]

    def _taken(self, motion: LinearMotion, closing: Point) -> Vector | None:
        """Return how the arm stands once it has taken what a motion lets go; None for others.

        None, too, for hands that point down, whose elbow is where there is room. The farther the
        joints turn with a part in the jaws, the more it creeps.
        """
        hold = hold_of(motion)
        if hold is None or motion.points_down or motion.visit.event is not Event.RELEASE:
            return None
        for one in self.holds.get(hold, ()):
            if one.visit.event is Event.GRASP:
                alike = one.visit.pose.rotate(_in_part(motion, closing))
                elbows = self._paths(one, alike).elbows
                return elbows[0].strokes.end if elbows else None
        return None

    def _is_turned(self, paths: DescentPaths, closing: Point) -> bool:
        """Whether the best of some paths meets nothing, and its jaws close along a direction.

        Then no other has to be looked at.
        """
        if not paths.elbows:
            return False
        best = paths.elbows[0]
        return best.is_clear and dot(self._tip_closing(best.strokes), closing) > 0

    def _closing(self, motion: LinearMotion) -> Point | None:
        """Return the direction of the jaws that a motion has in common with others, or None."""
        hold = hold_of(motion)
        if hold is None or hold not in self.holds:
            return None
        if hold not in self._turns:
            self._turns[hold] = self._common_turn(self.holds[hold])
        axis = self._turns[hold]
        return None if axis is None else motion.visit.pose.rotate(axis)

    def _common_turn(self, motions: Sequence[LinearMotion]) -> Point | None:
        """Return along which axis of a part jaws close on it, in all motions that handle it.

        The one of the paths that are preferred, where these agree. Else of the two turns the one
        that leaves the least out of reach, meets the least, and has the most room.
        """
        preferred = [(motion, self._paths(motion, None)) for motion in motions]
        axes = [
            _in_part(motion, self._tip_closing(paths.elbows[0].strokes))
            for motion, paths in preferred
            if paths.elbows
        ]
        if not axes:
            return None
        one = axes[0]
        if all(dot(one, axis) > 0 for axis in axes):
            return one
        x, y, z = one
        return min((one, (-x, -y, -z)), key=lambda axis: self._effort(motions, axis))

    def _effort(self, motions: Sequence[LinearMotion], axis: Point) -> tuple[int, int, float]:
        """Return how much of some motions is out of reach, is met, and how far joints turn."""
        lost = met = 0
        farthest_rad = 0.0
        for motion in motions:
            paths = self._paths(motion, motion.visit.pose.rotate(axis))
            if not paths.elbows:
                lost += 1
                continue
            best = paths.elbows[0]
            met += len(best.meets) + (best.itself is not None)
            away = np.abs(best.strokes.down[-1].nodes[-1] - self.arm.home_rad)
            farthest_rad = max(farthest_rad, round(float(away.max()), 6))
        return lost, met, farthest_rad

    def _turned(
        self, found: Iterable[Strokes | Unreachable], closing: Point | None
    ) -> Iterator[Strokes | Unreachable]:
        """Yield strokes in which the jaws close along a direction; why the others are none."""
        for one in found:
            if (
                closing is None
                or isinstance(one, Unreachable)
                or dot(self._tip_closing(one), closing) > 0
            ):
                yield one
            else:
                tip, rotation = self.arm.tip(one.down[-1].nodes[-1])
                yield Unreachable(_point(tip), _OTHERWISE_TURNED, 0.0, _point(rotation[:, 2]))

    def _tip_closing(self, one: Strokes) -> Point:
        """Return the unit vector along which the jaws close in the world."""
        _, rotation = self.arm.tip(one.down[-1].nodes[-1])
        return _point(rotation[:, 1])

    def descents(
        self,
        tip: Point,
        above: Point,
        closing_yaw: float,
        spares: frozenset[str],
    ) -> DescentPaths:
        """Return how the arm goes straight down to a place.

        Parameters
        ----------
        tip, above
            Where the tip of the hand ends, and begins [m].
        closing_yaw
            Direction in which the jaws are to close, from x about the vertical [rad].
        spares
            Bodies that may be touched.
        """
        key = (tip, above, closing_yaw, spares)
        if key not in self._known:
            found = (
                path if isinstance(path, Unreachable) else there_and_back(path)
                for path in descent_paths(self.arm, tip, above, closing_yaw)
            )
            self._known[key] = self._best(found, spares, None)
        return self._known[key]

    def met(
        self, path: JointPath, spares: frozenset[str]
    ) -> tuple[tuple[Obstacle, LinkTouch], ...]:
        """Return what the links run into on a path, in order of the motion.

        Parameters
        ----------
        path
            Of the joints.
        spares
            Bodies that may be touched.
        """
        if not self.check_arm:
            return ()
        sweep = LinkSweep(self.arm, path)
        found = [
            (obstacle, touch)
            for obstacle in self.obstacles
            if obstacle.body not in spares
            and (touch := sweep.touch(obstacle, self.tolerance_m, self.samples)) is not None
        ]
        return tuple(sorted(found, key=lambda pair: pair[1].touch.fraction))

    def _best(
        self,
        found: Iterable[Strokes | Unreachable],
        spares: frozenset[str],
        motion: LinearMotion | None,
    ) -> DescentPaths:
        elbows: list[Elbow] = []
        failures: list[Unreachable] = []
        for one in found:
            if isinstance(one, Unreachable):
                failures.append(one)
                continue
            overload = None
            if motion is not None and self.gravity is not None:
                overload = self.gravity.on_strokes(motion, one)
            elbow = Elbow(one, self._met(one, spares), self._hit_itself(one, motion), overload)
            if elbow.is_clear:
                return DescentPaths((elbow,))
            elbows.append(elbow)
        if not elbows:
            return DescentPaths((), min(failures, key=lambda failure: failure.distance_m))
        # Sorting keeps the order of those that meet equally much.
        return DescentPaths(
            tuple(sorted(elbows, key=lambda elbow: (elbow.blocked, len(elbow.meets))))
        )

    def _met(self, one: Strokes, spares: frozenset[str]) -> tuple[tuple[Obstacle, LinkTouch], ...]:
        """Return what the links run into on several paths in turn, each obstacle once."""
        paths = one.distinct
        if len(paths) == 1:
            return self.met(paths[0], spares)
        first: dict[tuple[str, str | None], tuple[Obstacle, LinkTouch]] = {}
        for number, path in enumerate(paths):
            for obstacle, found in self.met(path, spares):
                fraction = (number + found.touch.fraction) / len(paths)
                touch = replace(found.touch, fraction=fraction)
                first.setdefault(
                    (obstacle.body, obstacle.fact), (obstacle, replace(found, touch=touch))
                )
        return tuple(first.values())

    def _hit_itself(self, one: Strokes, motion: LinearMotion | None) -> Hit | None:
        """Return how the arm first runs into itself, with what it holds there."""
        if not self.check_arm:
            return None
        before: Held = ()
        after: Held = ()
        if motion is not None and self.held is not None:
            before, after = self.held(motion)
        count = len(one.distinct)
        for number, path in enumerate(one.distinct):
            held = []
            if number < len(one.down):
                held.append((before, one.begin))
            if one.mirrored or number >= len(one.down):
                held.append((after, one.end))
            hit = self._itself.first_hit(path, *held)
            if hit is not None:
                return replace(hit, place=round((number + hit.place) / count, 6))
        return None


def _in_part(motion: LinearMotion, direction: Point) -> Point:
    """Return a direction in the world as one in the frame of what a motion handles."""
    return motion.visit.pose.inverse().rotate(direction)


def _point(vector: Vector) -> Point:
    x, y, z = vector.tolist()
    return (x, y, z)


def spared(motion: LinearMotion) -> frozenset[str]:
    """Return the bodies that a motion may touch: its target and what is carried."""
    carried = {motion.carries} if motion.carries is not None else set()
    return frozenset({motion.visit.subject} | carried)
