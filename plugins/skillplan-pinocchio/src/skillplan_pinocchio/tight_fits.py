"""Fits of parts whose clearance the convex decomposition consumes.

A moving part is made of convex pieces, which stand out of its mesh in hollows. If they fill the
clearance of a fit, a skill is refused that the meshes allow.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Any

import numpy as np

from skillplan.collision.solid import Solid
from skillplan.task.motion import Event, Point
from skillplan.task.pose import DOWN, Pose
from skillplan.task.scene import WORLD, Body, Placement
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.shapes import (
    ConvexPiece,
    make_pieces,
    make_standing_pieces,
    may_touch,
    measure_distance,
)

# Number of places along an insertion at which the clearance of the meshes is measured.
_SAMPLES = 8
# Distance from the seat at which measuring starts, because seated bodies touch [m].
_OFF_SEAT_M = 0.001
# Remaining clearance above which, and loss below which, a fit is not reported [m].
_NARROW_M = 1e-4
_LEAST_TAKEN_M = 5e-5
# Rounding of distances [m].
_ROUNDING_M = 1e-5


@dataclass(frozen=True, slots=True)
class TightFit:
    """Two parts whose convex pieces reduce the clearance of their meshes.

    Parameters
    ----------
    bodies
        Names, the moving part first.
    clearance_m
        Minimum distance between the meshes along the insertion [m], at most 1 mm.
    left_m
        Remaining clearance between the pieces [m]; negative for the depth of their overlap.
    """

    bodies: tuple[str, str]
    clearance_m: float
    left_m: float

    @property
    def is_tight(self) -> bool:
        """Return whether the pieces take enough of the clearance to matter."""
        return self.left_m < min(_NARROW_M, self.clearance_m - _LEAST_TAKEN_M)

    @property
    def is_blocked(self) -> bool:
        """Return whether the pieces take more than the clearance."""
        return self.is_tight and self.left_m < -_ROUNDING_M

    @property
    def words(self) -> str:
        """One sentence without a full stop."""
        mover, other = self.bodies
        begin = f"{mover!r} fits {other!r}"
        if self.clearance_m < _OFF_SEAT_M - _ROUNDING_M:
            begin += f" with {self.clearance_m * 1e3:.2f} mm between their meshes"
        if self.is_blocked:
            pieces = f"are {-self.left_m * 1e3:.2f} mm deep in each other"
        else:
            pieces = f"leave {self.left_m * 1e3:.2f} mm of it"
        return f"{begin}, but when it moves, their convex pieces {pieces}"


def find_blocked_fits(task: Task, *, as_pieces: bool) -> dict[str, str]:
    """Return messages on fits that pieces block in every order, by the fact of a placed part.

    Parameters
    ----------
    task, as_pieces
        See `measure_fits`.
    """
    blocked = []
    for fits in measure_fits(task, as_pieces=as_pieces):
        widest = max(fits, key=lambda fit: fit.left_m)
        if widest.is_blocked:
            blocked.append(widest)
    return _write_messages(blocked, "")


def find_tight_fits(task: Task, *, as_pieces: bool) -> dict[str, str]:
    """Return messages on fits that pieces narrow in some order, by the fact of a placed part.

    Parameters
    ----------
    task, as_pieces
        See `measure_fits`.
    """
    narrowest = (
        min(fits, key=lambda fit: fit.left_m) for fits in measure_fits(task, as_pieces=as_pieces)
    )
    return _write_messages(
        [fit for fit in narrowest if fit.is_tight], ", so that swept or an engine may refuse it"
    )


def _write_messages(fits: Sequence[TightFit], effect: str) -> dict[str, str]:
    messages: dict[str, str] = {}
    for fit in fits:
        fact = f"placed({fit.bodies[0]})"
        message = f"{fit.words}{effect}. Give 'pieces' that follow the meshes, or more clearance."
        messages[fact] = f"{messages[fact]} {message}" if fact in messages else message
    return messages


# Number of fits that a sentence names.
_SHOWN = 4
# Facts of fits of convex pieces that are assumed, not drawn.
_ASSUMED = ("play_m", "outside_m")


def describe_unchecked_fits(bodies: Iterable[Body], *, simulated: bool) -> tuple[str, ...]:
    """Return sentences on what is not checked of fits.

    Parameters
    ----------
    simulated
        True for engines, which apply forces.
    """
    everything = tuple(bodies)
    lines = list(describe_assumed_play(everything))
    fits = [(body.name, fit) for body in everything for fit in body.fits if fit.kind]
    if simulated:
        led = [f"{name} in {fit.into} ({fit.kind})" for name, fit in fits if fit.is_led]
        if led:
            lines.append(
                "contacts of fits that overlap or have a lead-in, while the part goes in: the "
                "stated force resists, and a hand farther aside than the lead-in is refused: "
                f"{_join(led)}"
            )
        loose = [
            f"{name} in {fit.into}"
            for name, fit in fits
            if fit.is_led and fit.overlap_m > 0 and fit.lead_in_m is None
        ]
        if loose:
            lines.append(f"how tight fits without lead_in_m find their hole: {_join(loose)}")
    else:
        forced = [f"{name} in {fit.into} ({fit.kind})" for name, fit in fits if fit.force_n]
        if forced:
            lines.append(f"forces of fits, which engines apply: {_join(forced)}")
    return tuple(lines)


def _join(names: Sequence[str]) -> str:
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def describe_assumed_play(bodies: Iterable[Body]) -> tuple[str, ...]:
    """Return a sentence on the fits that shapes of bodies leave more room than is drawn."""
    fits = sorted(
        (fit.drawn_m, body.name, fit.into)
        for body in bodies
        for fit in body.fits
        if not fit.kind and fit.play_m > fit.drawn_m
    )
    if not fits:
        return ()
    assumed = [
        fit for body in bodies for fit in body.fits if not fit.kind and fit.play_m > fit.drawn_m
    ]
    play_m, outside_m = (max(getattr(fit, key) for fit in assumed) for key in _ASSUMED)
    excess = f"; pieces exceed walls by up to {outside_m * 1e3:.3g} mm" if outside_m else ""
    named = [
        f"{name} in {into} (drawn {drawn_m * 1e3:.3g} mm)" for drawn_m, name, into in fits[:_SHOWN]
    ]
    more = len(fits) - len(named)
    others = f" and {more} more" if more > 0 else ""
    return (
        f"fits with less than {play_m * 1e3:.3g} mm of clearance on each side: the parts go in "
        f"with that much, and with chamfers: {', '.join(named)}{others}{excess}",
    )


def measure_fits(task: Task, *, as_pieces: bool) -> list[list[TightFit]]:
    """Return the fits of every pair of near parts, for each order and direction of insertion.

    Pairs of convex parts are left out, and orders in which the meshes themselves do not pass.

    Parameters
    ----------
    as_pieces
        True if fixed bodies are convex pieces, too, instead of meshes.
    """
    if not any(body.surfaces for body in task.scene.bodies):
        return []
    fits_of_pairs: list[list[TightFit]] = []
    for placed in (_place_at_start(task), _place_at_goal(task)):
        pairs: dict[frozenset[str], list[TightFit]] = {}
        for mover, other in permutations(placed, 2):
            if (mover.body.surfaces or other.body.surfaces) and mover.is_near(other):
                pair = frozenset((mover.body.name, other.body.name))
                fits = _measure_pair(mover, other, as_pieces=as_pieces)
                pairs.setdefault(pair, []).extend(fits)
        fits_of_pairs += [fits for fits in pairs.values() if fits]
    return fits_of_pairs


@dataclass(frozen=True)
class _Placed:
    """A body at its start or goal, and the directions from which it gets there."""

    body: Body
    placement: Placement
    along: tuple[Point, ...]

    @cached_property
    def solid(self) -> Solid:
        return Solid(self.body.exact_shapes, self.placement.pose)

    @cached_property
    def meshes(self) -> tuple[ConvexPiece, ...]:
        return make_standing_pieces(self.body, self.placement.pose)

    @cached_property
    def pieces(self) -> tuple[ConvexPiece, ...]:
        return make_pieces(self.body, self.placement.pose)

    @cached_property
    def low(self) -> tuple[float, ...]:
        return tuple(min(piece.low[axis] for piece in self.meshes) for axis in range(3))

    @cached_property
    def high(self) -> tuple[float, ...]:
        return tuple(max(piece.high[axis] for piece in self.meshes) for axis in range(3))

    def is_near(self, other: _Placed) -> bool:
        """Return whether the bounding boxes overlap or touch."""
        return all(
            low <= top and bottom <= high
            for low, high, bottom, top in zip(
                self.low, self.high, other.low, other.high, strict=True
            )
        )


@dataclass(frozen=True, slots=True)
class Insertion:
    """The last stretch of a move, on which one part lies beside another.

    Parameters
    ----------
    length_m
        Length of the stretch [m], > 0.
    clearance_m
        Minimum distance between the moving part's pieces and the other's mesh on it [m], at most
        1 mm; negative for the depth of their overlap.
    """

    length_m: float
    clearance_m: float


def measure_insertion(
    mover: Body, seat: Pose, other: Body, other_pose: Pose, along: Point
) -> Insertion | None:
    """Return the insertion of a part beside another, or None if it only comes to lie on it.

    Parameters
    ----------
    seat
        Final pose of the moving part.
    along
        Unit vector of the move.
    """
    moving, standing = make_pieces(mover, seat), make_standing_pieces(other, other_pose)
    length_m = _measure_overlap_m(moving, standing, along)
    if length_m <= _ROUNDING_M:
        return None
    back = _scale(along, -length_m)
    raised = _scale(along, -min(_OFF_SEAT_M, length_m / 2))
    swept = [ConvexPiece(piece.corners + np.array(raised)).swept(back) for piece in moving]
    return Insertion(length_m, _measure_distance_m(swept, standing))


def _measure_overlap_m(
    moving: Sequence[ConvexPiece], standing: Sequence[ConvexPiece], along: Point
) -> float:
    """Return how far bodies overlap along a direction [m]; 0 if boxes are clear of each other."""
    lows, highs = _bound(moving)
    other_lows, other_highs = _bound(standing)
    direction = np.array(along)
    across = np.abs(direction) < 1 - _ROUNDING_M
    apart = (lows > other_highs + _OFF_SEAT_M) | (other_lows > highs + _OFF_SEAT_M)
    if (apart & across).any():
        return 0.0
    ahead_m = max(float((piece.corners @ direction).max()) for piece in moving)
    begin_m = min(float((piece.corners @ direction).min()) for piece in standing)
    return max(0.0, ahead_m - begin_m)


def _bound(pieces: Sequence[ConvexPiece]) -> tuple[Any, Any]:
    """Return the lower and upper corners of a box about pieces [m], shape (3,)."""
    return (
        np.min([piece.low for piece in pieces], axis=0),
        np.max([piece.high for piece in pieces], axis=0),
    )


def _measure_pair(mover: _Placed, other: _Placed, *, as_pieces: bool) -> Iterator[TightFit]:
    """Yield the fit for every direction in which the meshes pass each other."""
    stands = other.pieces if as_pieces else other.meshes
    for along in mover.along:
        length_m = _measure_length_m(mover, other, along)
        if length_m <= _ROUNDING_M:
            # It stands on the other.
            continue
        clearance_m = _measure_clearance_m(mover.meshes, other.meshes, along, length_m)
        if clearance_m <= 0:
            continue
        back = _scale(along, -length_m)
        left_m = _measure_distance_m([piece.swept(back) for piece in mover.pieces], stands)
        if left_m < -_LEAST_TAKEN_M:
            left_m += mover.solid.depth_m(other.solid)
        else:
            # At its seat the body touches.
            seat = _scale(along, -min(_OFF_SEAT_M, length_m / 2))
            raised = [ConvexPiece(piece.corners + seat) for piece in mover.pieces]
            left_m = _measure_distance_m([piece.swept(back) for piece in raised], stands)
        yield TightFit((mover.body.name, other.body.name), clearance_m, left_m)


def _measure_length_m(mover: _Placed, other: _Placed, along: Point) -> float:
    """Return the distance back at which a body's box leaves another's [m]."""
    exits_m = []
    for axis in range(3):
        if abs(along[axis]) > _ROUNDING_M:
            ahead_m = (
                other.high[axis] - mover.low[axis]
                if along[axis] < 0
                else mover.high[axis] - other.low[axis]
            )
            exits_m.append(ahead_m / abs(along[axis]))
    return min(exits_m)


def _measure_clearance_m(
    moving: Sequence[ConvexPiece], standing: Sequence[ConvexPiece], along: Point, length_m: float
) -> float:
    """Return the minimum distance of meshes along an insertion, off their seat [m]."""
    begin_m = min(_OFF_SEAT_M, length_m / 2)
    step_m = (length_m - begin_m) / _SAMPLES
    offsets = [_scale(along, -(begin_m + number * step_m)) for number in range(_SAMPLES)]
    distances = (
        measure_distance(mover, other, offset).distance_m
        for offset in offsets
        for mover in moving
        for other in standing
    )
    return min(_OFF_SEAT_M, *distances)


def _measure_distance_m(moving: Sequence[ConvexPiece], standing: Sequence[ConvexPiece]) -> float:
    """Return the minimum distance of pieces [m], at most 1 mm; negative for an overlap."""
    distances = (
        measure_distance(mover, other).distance_m
        for mover in moving
        for other in standing
        if may_touch(mover, other, -_OFF_SEAT_M)
    )
    return min(_OFF_SEAT_M, min(distances, default=_OFF_SEAT_M))


def _place_at_start(task: Task) -> list[_Placed]:
    return [
        _Placed(body, placement, (DOWN,))
        for body in task.scene.bodies
        if (placement := _find_solid(body, task.initial)) is not None
    ]


def _place_at_goal(task: Task) -> list[_Placed]:
    """Return bodies at their goals; bodies without a goal stay in place."""
    goal = task.goal.requires
    along: dict[str, dict[Point, None]] = {}
    for skill in task.skills:
        for motion in (skill.motion, *(way.motion for way in skill.ways)):
            for route in () if motion is None else motion.routes:
                for visit in route.visits:
                    if visit.event is Event.RELEASE:
                        along.setdefault(visit.subject, {})[visit.along] = None
    bodies = []
    for body in task.scene.bodies:
        placed, lies = _find_solid(body, goal), _find_solid(body, task.initial)
        if placed is not None:
            bodies.append(_Placed(body, placed, tuple(along.get(body.name, ()))))
        elif lies is not None:
            bodies.append(_Placed(body, lies, ()))
    return bodies


def _find_solid(body: Body, state: State) -> Placement | None:
    """Return the placement of a body in the world in a state, or None."""
    placements = (
        placement
        for placement in body.placements
        if placement.solid and placement.frame == WORLD and placement.fact in state
    )
    return next(placements, None)


def _scale(direction: Point, length_m: float) -> Point:
    x, y, z = direction
    return (x * length_m, y * length_m, z * length_m)
