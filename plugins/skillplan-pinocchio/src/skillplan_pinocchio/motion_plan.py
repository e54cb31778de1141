"""Joint paths of motions: elbow choice, and collisions of the links along them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from operator import is_not
from typing import Any

import coal
import numpy as np

from skillplan.physics.linear_motions import LinearMotion, plan_linear_motions
from skillplan.task.motion import Event, Grasp, Point
from skillplan.task.pose import dot
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import ArmModel, LinkPiece, Vector
from skillplan_pinocchio.gravity import GravityCheck, Overload
from skillplan_pinocchio.inverse_kinematics import (
    Strokes,
    Unreachable,
    list_descents,
    list_strokes,
)
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.continuous_check import Held, Hit, SelfCheck
from skillplan_pinocchio.shapes import (
    STILL,
    ConvexPiece,
    Obstacle,
    bound_gap,
    measure_geometry_distance,
)
from skillplan_pinocchio.sweep import Touch

# Maximum excursion of a link between the nodes of a path [m].
_BULGE_M = 0.02


@dataclass(frozen=True)
class LinkTouch:
    """First link that touches an obstacle.

    Parameters
    ----------
    link
        Number of the link's joint.
    """

    link: int
    touch: Touch


@dataclass(frozen=True)
class _Places:
    """Links in several postures.

    Parameters
    ----------
    rotations, origins
        Joint frames, shapes (postures, joints, 3, 3) and (postures, joints, 3) [m].
    low, high
        Corners of axis-aligned boxes about the pieces, shape (postures, pieces, 3) [m].
    moved_m
        Distance that no point of a piece exceeds from the first posture on, shape (postures,
        pieces) [m].
    placements
        Placements of the pieces for coal by posture and piece, as far as they were needed.
    """

    rotations: Vector
    origins: Vector
    low: Vector
    high: Vector
    moved_m: Vector
    placements: dict[tuple[int, int], Any] = field(default_factory=dict)


class LinkSweep:
    """The links of the arm along a joint path."""

    def __init__(self, arm: ArmModel, path: JointPath) -> None:
        self.arm = arm
        self.path = path
        self._sampled: dict[int, _Places] = {}

    def touch(self, obstacle: Obstacle, tolerance_m: float, samples: int) -> LinkTouch | None:
        """Return the first link that touches an obstacle, or None.

        Parameters
        ----------
        tolerance_m
            Penetration depth that counts as harmless touching [m], >= 0.
        samples
            Number of equal intervals of the path that are checked, >= 1.
        """
        lows, highs = self._reach
        near = [
            (number, piece)
            for piece in obstacle.pieces
            for number in np.flatnonzero(_find_overlaps(lows, highs, piece, 0.0)).tolist()
        ]
        if not near:
            return None
        places = self._at(samples)
        first: tuple[int, int] | None = None
        geometries: tuple[Any, ...] = ()
        for number, piece in near:
            low, high = places.low[:, number], places.high[:, number]
            moved_m, free_m = places.moved_m[:, number].tolist(), 0.0
            for sample in np.flatnonzero(_find_overlaps(low, high, piece, tolerance_m)).tolist():
                if first is not None and (sample, number) >= first:
                    break
                if moved_m[sample] < free_m:
                    continue
                placement = self._place(places, sample, number)
                pair = (self._pieces[number].geometry, placement, piece.hull, STILL)
                gap_m = bound_gap(*pair, tolerance_m)
                if gap_m is None:
                    first, geometries = (sample, number), pair
                    break
                free_m = moved_m[sample] + gap_m
        if first is None:
            return None
        sample, number = first
        touch = Touch(sample / samples, partial(measure_geometry_distance, *geometries))
        return LinkTouch(self._pieces[number].link, touch)

    @property
    def _pieces(self) -> tuple[LinkPiece, ...]:
        return self.arm.pieces

    def _place(self, places: _Places, sample: int, number: int) -> Any:
        """Return the placement of a piece for coal."""
        if (sample, number) not in places.placements:
            of_link = self._pieces[number]
            rotation = places.rotations[sample, of_link.link - 1]
            origin = places.origins[sample, of_link.link - 1]
            frame = of_link.frame
            places.placements[sample, number] = coal.Transform3s(
                rotation @ frame.rotation, rotation @ frame.translation + origin
            )
        return places.placements[sample, number]

    def _at(self, samples: int) -> _Places:
        if samples not in self._sampled:
            postures = [self.path.at(number / samples) for number in range(samples + 1)]
            self._sampled[samples] = self._placed(postures)
        return self._sampled[samples]

    @cached_property
    def _reach(self) -> tuple[Vector, Vector]:
        """Boxes that contain each link along the path [m], shapes (pieces, 3)."""
        places = self._placed(list(self.path.nodes))
        return places.low.min(axis=0) - _BULGE_M, places.high.max(axis=0) + _BULGE_M

    def _placed(self, postures: list[Vector]) -> _Places:
        rotations, origins = self.arm.frames(postures)
        joints, centres, halves = self.arm.boxes
        turned = rotations[:, joints]
        middle = np.einsum("spij,pj->spi", turned, centres) + origins[:, joints]
        reach = np.einsum("spij,pj->spi", np.abs(turned), halves)
        # A turn moves no point farther than its matrix norm times the distance from the centre.
        turns = np.linalg.norm(np.diff(turned, axis=0), axis=(2, 3)) * np.linalg.norm(
            halves, axis=1
        )
        steps_m = np.linalg.norm(np.diff(middle, axis=0), axis=2) + turns
        moved_m = np.concatenate([np.zeros((1, len(joints))), np.cumsum(steps_m, axis=0)])
        return _Places(rotations, origins, middle - reach, middle + reach, moved_m)


def _find_overlaps(low: Vector, high: Vector, piece: ConvexPiece, tolerance_m: float) -> Vector:
    """Return a mask of the boxes that overlap a piece's box by more than the tolerance."""
    inside = (low + tolerance_m < np.array(piece.high)) & (high - tolerance_m > np.array(piece.low))
    return np.asarray(inside.all(axis=1))


Hold = tuple[str, Grasp | None]
"""A part, and its grasp if the task offers several."""


def hold_of(motion: LinearMotion) -> Hold | None:
    """Return the part that a motion takes or releases and its grasp; None for other motions."""
    visit = motion.visit
    return (visit.subject, visit.grasp) if visit.event in (Event.GRASP, Event.RELEASE) else None


def group_by_hold(task: Task, drop_height_m: float) -> Mapping[Hold, tuple[LinearMotion, ...]]:
    """Return the motions of a task by held part and grasp, in the order of its skills.

    Parameters
    ----------
    drop_height_m
        Height above its goal at which a part is released [m], >= 0.
    """
    motions_by_hold: dict[Hold, dict[LinearMotion, None]] = {}
    for skill in task.skills:
        for variant in [skill.by(way) for way in skill.ways] or [skill]:
            for route in () if variant.motion is None else variant.motion.routes:
                state = variant.precondition.requires | route.when
                for motion in plan_linear_motions(task, variant, state, drop_height_m):
                    hold = hold_of(motion)
                    if hold is not None:
                        motions_by_hold.setdefault(hold, {})[motion] = None
    return {hold: tuple(motions) for hold, motions in motions_by_hold.items()}


_OTHERWISE_TURNED = "only with the hand turned by half, unlike where the same part is handled"


@dataclass(frozen=True, eq=False)
class Elbow:
    """Joint paths to a target and back with one elbow position.

    Parameters
    ----------
    overload
        Joint that gravity overloads, or None.
    is_free
        Returns whether the links meet no obstacle in any state.
    find_meets
        Returns the obstacles that the links could collide with, in order of the motion.
    find_hit
        Returns the collision of the arm or its load with the arm or its base, or None.
    """

    strokes: Strokes
    overload: Overload | None
    is_free: Callable[[], bool]
    find_meets: Callable[[], tuple[tuple[Obstacle, LinkTouch], ...]]
    find_hit: Callable[[], Hit | None]

    @cached_property
    def is_clear(self) -> bool:
        """True if it meets no obstacle in any state and overloads no joint."""
        return self.overload is None and self.is_free() and self.itself is None

    @cached_property
    def meets(self) -> tuple[tuple[Obstacle, LinkTouch], ...]:
        """Obstacles that the links could collide with, in order of the motion.

        Fractions refer to all paths of `strokes.distinct` with equal weight.
        """
        return () if self.is_clear else self.find_meets()

    @cached_property
    def itself(self) -> Hit | None:
        """Collision of the arm or its load with the arm or its base; its place is a fraction."""
        return self.find_hit()

    def at(self, fraction: float) -> Vector:
        """Return the joint angles at a fraction of all paths [rad]."""
        paths = self.strokes.distinct
        number = min(int(fraction * len(paths)), len(paths) - 1)
        return paths[number].at(fraction * len(paths) - number)

    @property
    def blocked(self) -> bool:
        """Return whether it meets a permanent obstacle or overloads a joint."""
        never = self.itself is not None or self.overload is not None
        return never or any(obstacle.fact is None for obstacle, _ in self.meets)


@dataclass(frozen=True)
class DescentPaths:
    """Joint paths to a place and back.

    Parameters
    ----------
    elbows
        Elbows in order of preference: only the clear one nearest to the ready pose or, if none is
        clear, all of them, fewest obstacles first.
    unreachable
        Reason why there is no elbow, or None.
    """

    elbows: tuple[Elbow, ...]
    unreachable: Unreachable | None = None


@dataclass(frozen=True)
class ArmMotion:
    """A linear motion and the joint paths along it.

    Parameters
    ----------
    elbows, unreachable
        See :class:`DescentPaths`.
    """

    motion: LinearMotion
    elbows: tuple[Elbow, ...]
    unreachable: Unreachable | None = None


class _Candidates:
    """Paths of a motion by number; each is checked once.

    Attributes
    ----------
    elbows
        Checked paths by number.
    """

    def __init__(self, strokes: Iterable[Strokes | Unreachable]) -> None:
        self.strokes = strokes
        self.elbows: dict[int, Elbow] = {}


class MotionPlanner:
    """Plans the joint paths of motions, once per motion.

    The preferred path depends on the obstacles of all states, never on the current state. So a
    verdict rests on the facts of the obstacles met, and the time of a skill on none of them.

    Parameters
    ----------
    tolerance_m
        Penetration depth that counts as harmless touching [m], >= 0.
    samples
        Number of equal intervals of a path at which links are checked, >= 1.
    check_arm
        True if the links are checked.
    held
        Function that returns the pieces at the end of the arm where a motion begins and where it
        ends.
    holds
        Motions by held part and grasp. The hand has the same turn about its pointing direction,
        seen from the part, in all motions of a group.
    gravity
        Check of gravity torques; None skips it.
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
        # The obstacle that links met last comes first.
        self._likely = [*self.obstacles]
        self.tolerance_m = tolerance_m
        self.samples = samples
        self.check_arm = check_arm
        self.holds = holds or {}
        self.held = held
        self._itself = SelfCheck(arm)
        # Pieces at the ends of the motion that was checked last, often with several elbows.
        self._last_held: tuple[LinearMotion, tuple[Held, Held]] | None = None
        self._known: dict[tuple[Any, ...], DescentPaths] = {}
        self._turns: dict[Hold, Point | None] = {}
        # Paths by motion, until the turn of the hand is chosen.
        self._candidates: dict[tuple[Any, ...], _Candidates] = {}

    def plan(self, motion: LinearMotion) -> ArmMotion:
        """Return the joint paths of a motion."""
        paths = self._paths(motion, self._closing(motion))
        return ArmMotion(motion, paths.elbows, paths.unreachable)

    def can_reach(self, motion: LinearMotion) -> bool:
        """Return whether the arm can follow a motion, if nothing is in its way."""
        strokes = list_strokes(self.arm, motion)
        return any(not isinstance(candidate, Unreachable) for candidate in strokes)

    def _paths(self, motion: LinearMotion, closing: Point | None) -> DescentPaths:
        """Return the paths of a motion with the jaws closing along a direction, or along either."""
        spares = get_spared_bodies(motion)
        ends = (motion.carries, motion.tool and motion.tool.name, motion.leaves_with)
        event = motion.visit.event
        if motion.is_vertical:
            where: tuple[Any, ...] = (motion.tip, motion.above, motion.closing_yaw_rad)
        else:
            where = (motion.approach, motion.retreat, motion.orientation)
        either = (*where, spares, *ends, event)
        key = (*either, closing)
        if key not in self._known:
            near = None if closing is None else self._taken(motion, closing)
            preferred = None if closing is None or near is not None else self._paths(motion, None)
            if preferred and closing and self._is_turned(preferred, closing):
                self._known[key] = preferred
            else:
                strokes = list_strokes(self.arm, motion, near)
                candidates = _Candidates(strokes)
                if near is None:
                    candidates = self._candidates.setdefault(either, candidates)
                self._known[key] = self._best(candidates, spares, motion, closing)
        return self._known[key]

    def _taken(self, motion: LinearMotion, closing: Point) -> Vector | None:
        """Return the posture after the grasp of the part that a motion releases, or None.

        None also for a hand that points down, whose elbow goes where there is room. A part creeps
        between the jaws the more, the farther the joints turn.
        """
        hold = hold_of(motion)
        if hold is None or motion.points_down or motion.visit.event is not Event.RELEASE:
            return None
        for other in self.holds.get(hold, ()):
            if other.visit.event is Event.GRASP:
                alike = other.visit.pose.rotate(_transform_to_part(motion, closing))
                elbows = self._paths(other, alike).elbows
                return elbows[0].strokes.end if elbows else None
        return None

    def _is_turned(self, paths: DescentPaths, closing: Point) -> bool:
        """Return whether the best path is clear and its jaws close along a direction.

        Then the other paths need no check.
        """
        if not paths.elbows:
            return False
        best = paths.elbows[0]
        return best.is_clear and dot(self._tip_closing(best.strokes), closing) > 0

    def _closing(self, motion: LinearMotion) -> Point | None:
        """Return the closing direction that a motion shares with its group, or None."""
        hold = hold_of(motion)
        if hold is None or hold not in self.holds:
            return None
        if hold not in self._turns:
            self._turns[hold] = self._common_turn(self.holds[hold])
            self._candidates.clear()
        axis = self._turns[hold]
        return None if axis is None else motion.visit.pose.rotate(axis)

    def _common_turn(self, motions: Sequence[LinearMotion]) -> Point | None:
        """Return the axis of a part along which jaws close in all motions that handle it.

        If the preferred paths disagree, take the turn with the fewest unreachable motions, then the
        fewest obstacles, then the most room.
        """
        preferred = [(motion, self._paths(motion, None)) for motion in motions]
        axes = [
            _transform_to_part(motion, self._tip_closing(paths.elbows[0].strokes))
            for motion, paths in preferred
            if paths.elbows
        ]
        if not axes:
            return None
        first = axes[0]
        if all(dot(first, axis) > 0 for axis in axes):
            return first
        x, y, z = first
        return min((first, (-x, -y, -z)), key=lambda axis: self._effort(motions, axis))

    def _effort(self, motions: Sequence[LinearMotion], axis: Point) -> tuple[int, int, float]:
        """Return unreachable motions, obstacles met, and the largest turn of a joint."""
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

    def _refuse_turn(self, strokes: Strokes, closing: Point | None) -> Unreachable | None:
        """Return that the jaws close otherwise than along a direction, or None."""
        if closing is None or dot(self._tip_closing(strokes), closing) > 0:
            return None
        tip, rotation = self.arm.tip(strokes.down[-1].nodes[-1])
        return Unreachable(_make_point(tip), _OTHERWISE_TURNED, 0.0, _make_point(rotation[:, 2]))

    def _tip_closing(self, paths: Strokes) -> Point:
        """Return the unit vector of the closing direction in the world."""
        _, rotation = self.arm.tip(paths.down[-1].nodes[-1])
        return _make_point(rotation[:, 1])

    def descents(
        self,
        tip: Point,
        above: Point,
        closing_yaw: float,
        spares: frozenset[str],
    ) -> DescentPaths:
        """Return the paths straight down to a place.

        Parameters
        ----------
        tip, above
            End and start of the tip [m].
        closing_yaw
            Closing direction of the jaws, from x about the vertical [rad].
        spares
            Bodies that may be touched.
        """
        key = (tip, above, closing_yaw, spares)
        if key not in self._known:
            candidates = _Candidates(list_descents(self.arm, tip, above, closing_yaw))
            self._known[key] = self._best(candidates, spares, None, None)
        return self._known[key]

    def met(
        self, path: JointPath, spares: frozenset[str]
    ) -> tuple[tuple[Obstacle, LinkTouch], ...]:
        """Return the obstacles that the links collide with on a path, in order of the motion.

        Parameters
        ----------
        spares
            Bodies that may be touched.
        """
        sweep = LinkSweep(self.arm, path)
        touches = [
            (obstacle, touch)
            for obstacle in self._list_obstacles(spares, self.obstacles)
            if (touch := sweep.touch(obstacle, self.tolerance_m, self.samples)) is not None
        ]
        return tuple(sorted(touches, key=lambda pair: pair[1].touch.fraction))

    def _best(
        self,
        candidates: _Candidates,
        spares: frozenset[str],
        motion: LinearMotion | None,
        closing: Point | None,
    ) -> DescentPaths:
        elbows: list[Elbow] = []
        failures: list[Unreachable] = []
        for number, candidate in enumerate(candidates.strokes):
            if isinstance(candidate, Unreachable):
                failures.append(candidate)
                continue
            refusal = self._refuse_turn(candidate, closing)
            if refusal is not None:
                failures.append(refusal)
                continue
            if number not in candidates.elbows:
                candidates.elbows[number] = self._check(candidate, spares, motion)
            elbow = candidates.elbows[number]
            if elbow.is_clear:
                return DescentPaths((elbow,))
            elbows.append(elbow)
        if not elbows:
            return DescentPaths((), min(failures, key=lambda failure: failure.distance_m))
        # The sort is stable for elbows that meet equally many obstacles.
        return DescentPaths(
            tuple(sorted(elbows, key=lambda elbow: (elbow.blocked, len(elbow.meets))))
        )

    def _check(
        self, strokes: Strokes, spares: frozenset[str], motion: LinearMotion | None
    ) -> Elbow:
        """Return paths with the obstacles and torques that block them."""
        overload = None
        if motion is not None and self.gravity is not None:
            overload = self.gravity.on_strokes(motion, strokes)
        return Elbow(
            strokes,
            overload,
            partial(self._is_free, strokes, spares),
            partial(self._met, strokes, spares),
            partial(self._hit_itself, strokes, motion),
        )

    def _is_free(self, strokes: Strokes, spares: frozenset[str]) -> bool:
        """Return whether the links meet no obstacle on some paths."""
        for path in strokes.distinct:
            sweep = LinkSweep(self.arm, path)
            for obstacle in self._list_obstacles(spares, self._likely):
                if sweep.touch(obstacle, self.tolerance_m, self.samples) is not None:
                    # Other elbows often meet the same.
                    self._likely.sort(key=partial(is_not, obstacle))
                    return False
        return True

    def _list_obstacles(self, spares: frozenset[str], among: Iterable[Obstacle]) -> list[Obstacle]:
        """Return the obstacles of the links among some."""
        return [
            obstacle
            for obstacle in among
            if self.check_arm and obstacle.body not in spares and obstacle.stops(load=False)
        ]

    def _met(
        self, stroke_paths: Strokes, spares: frozenset[str]
    ) -> tuple[tuple[Obstacle, LinkTouch], ...]:
        """Return the obstacles on several paths in order, each once."""
        paths = stroke_paths.distinct
        if len(paths) == 1:
            return self.met(paths[0], spares)
        first: dict[tuple[str, str | None], tuple[Obstacle, LinkTouch]] = {}
        for number, path in enumerate(paths):
            for obstacle, link_touch in self.met(path, spares):
                fraction = (number + link_touch.touch.fraction) / len(paths)
                touch = replace(link_touch.touch, fraction=fraction)
                first.setdefault(
                    (obstacle.body, obstacle.fact), (obstacle, replace(link_touch, touch=touch))
                )
        return tuple(first.values())

    def _hit_itself(self, stroke_paths: Strokes, motion: LinearMotion | None) -> Hit | None:
        """Return the first collision of the arm with itself, including its load, or None."""
        if not self.check_arm:
            return None
        before: Held = ()
        after: Held = ()
        if motion is not None and self.held is not None:
            if self._last_held is None or self._last_held[0] != motion:
                self._last_held = motion, self.held(motion)
            before, after = self._last_held[1]
        count = len(stroke_paths.distinct)
        for number, path in enumerate(stroke_paths.distinct):
            held = []
            if number < len(stroke_paths.down):
                held.append((before, stroke_paths.begin))
            if stroke_paths.mirrored or number >= len(stroke_paths.down):
                held.append((after, stroke_paths.end))
            hit = self._itself.first_hit(path, *held)
            if hit is not None:
                return replace(hit, place=round((number + hit.place) / count, 6))
        return None


def _transform_to_part(motion: LinearMotion, direction: Point) -> Point:
    """Transform a direction from the world to the frame of the handled part."""
    return motion.visit.pose.inverse().rotate(direction)


def _make_point(vector: Vector) -> Point:
    x, y, z = vector.tolist()
    return (x, y, z)


def get_spared_bodies(motion: LinearMotion) -> frozenset[str]:
    """Return the bodies that a motion may touch: its target and its load."""
    carried = {motion.carries} if motion.carries is not None else set()
    return frozenset({motion.visit.subject} | carried)
