"""Decide whether bodies stand by themselves.

Bodies stand if contact forces balance their weights, also if the ground is tilted a little and
their centres of mass are a little off the stated places. A linear program decides it. Three
rules keep it from claiming too much, as forces in equilibrium alone do not prove rest (Pang and
Trinkle: Stability characterizations of fixtured rigid bodies with Coulomb friction, 2000):

- Friction acts only where a body lies on another one: upright walls and faces above it push, but do
  not carry.
- Friction is credited for the weight that comes down there, not for clamping between bodies.
- Upright walls that end below the centre of mass of a body, or are so low that the body tilts in
  the play of a fit, push it with a share of its weight only, beyond what slopes need. A round part
  stands in a hole deeper than half its height, but with play it leans in a flat one, and so does a
  sheet on pins.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product

import highspy
import numpy as np
from numpy.typing import NDArray

from skillplan.collision.contact_forces import (
    BEARS,
    FRICTION,
    Surface,
    collect_pushes,
    find_axes_across,
    make_program,
)
from skillplan.collision.solid import TOUCH_M, Solid

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

TILT_DEG = 2.0
"""Tilt of the ground in any direction that bodies must stand [degrees]."""

SHIFT_M = 5e-4
"""Offset of the centres of mass that bodies must stand [m]; at most a share of their extent."""

_SHIFT_SHARE = 0.05
# Height of walls in which a body tilts by `TILT_DEG` with a play of 0.1 mm on each side [m]; walls
# of half the extent of a small body suffice.
_UPRIGHT_M, _UPRIGHT_SHARE = 2e-4 / math.tan(math.radians(TILT_DEG)), 0.5
# Corners of the polygon about the circle of all tilts.
_TILTS = 8
_BEYOND = 1 / math.cos(math.pi / _TILTS)
# Directions of the edges of the pyramid in each cone of friction, in the plane across the normal.
_RAYS = np.array([(math.cos(turn), math.sin(turn)) for turn in np.arange(8) * math.pi / 4])
# Share of its weight that may be missing to balance a body: the tolerance of the program.
_HELP = 1e-6
# Share of the weight on a body with which low walls push it.
_WALLS = 0.15
_MOVES = 1e-7
_PER_FORCE = 1e-9
_ROUNDING_M = 1e-6
# Points of a contact between two bodies.
_MOST_POINTS = 24
_ALONG = 0.999
_INFINITY = highspy.kHighsInf


@dataclass(frozen=True, slots=True)
class Weight:
    """A rigid body that may move.

    Parameters
    ----------
    centre_m
        Centre of mass [m].
    extent_m
        Largest extent [m], > 0.
    """

    mass_kg: float
    centre_m: Vector
    extent_m: float


@dataclass(frozen=True, eq=False)
class Touch:
    """A contact between two bodies. A body without a `Weight` is firm, such as the table.

    Parameters
    ----------
    points_m
        Points of the contact, shape (points, 3) [m].
    normals
        Unit vectors along which the other body pushes this one, shape (points, 3).
    """

    body: str
    other: str
    points_m: Array
    normals: Array


@dataclass(frozen=True, slots=True)
class Standing:
    """Result of `decide_standing`.

    Parameters
    ----------
    moving
        Body that moves first; None if all stand.
    how
        ``falls``, ``tips`` or ``slides``; empty if all stand.
    towards
        Direction in which its centre of mass moves, a unit vector.
    only_tilted
        True if it stands on level ground, but not within the margin.
    reason
        Sentence with the body, the motion and the missing contact.
    """

    moving: str | None = None
    how: str = ""
    towards: Vector = (0.0, 0.0, 0.0)
    only_tilted: bool = False
    reason: str = ""

    @property
    def stands(self) -> bool:
        """True if all bodies stand."""
        return self.moving is None


def decide_standing(
    bodies: Mapping[str, Weight],
    touches: Sequence[Touch],
    held: Collection[str] = (),
    *,
    joined: Iterable[tuple[str, str]] = (),
    up: Vector = (0.0, 0.0, 1.0),
    friction: float = FRICTION,
    tilt_deg: float = TILT_DEG,
) -> Standing:
    """Return whether bodies stand by themselves, or which of them moves.

    Parameters
    ----------
    bodies
        Bodies that may move, by name.
    touches
        Contacts of these bodies with each other and with firm ones.
    held
        Bodies that are held or clamped: they do not move, whatever pushes them.
    joined
        Pairs of bodies that move as one, such as by a screw.
    up
        Unit vector against gravity.
    friction
        Coefficient of friction that is credited where bodies lie on others, >= 0 [-].
    tilt_deg
        Margin: tilt in any direction that they stand as well, 0 to 45 [degrees]. Unless it is 0,
        each centre of mass may also be 0.5 mm aside, or a twentieth of the body's extent if less.
    """
    scene = _Scene(bodies, touches, joined, up, friction, tilt_deg)
    return scene.decide(scene.find_groups(held))


def compute_margin_m(extent_m: float, height_m: float, tilt_deg: float = TILT_DEG) -> float:
    """Return the distance of the centre of mass from the edge of what bears a body alone [m].

    A body on level faces with this distance stands by `decide_standing`.

    Parameters
    ----------
    extent_m
        Largest extent of the body [m].
    height_m
        Height of its centre of mass above the lowest of these faces [m].
    """
    aside_m = min(SHIFT_M, _SHIFT_SHARE * extent_m)
    return (aside_m + math.tan(math.radians(tilt_deg)) * height_m) * _BEYOND


def weigh(solid: Solid, mass_kg: float) -> Weight:
    """Return a body with its mass spread evenly over its shapes."""
    low, high = solid.box.low, solid.box.high
    extent_m = max(high[axis] - low[axis] for axis in range(3))
    return Weight(mass_kg, solid.centre, extent_m)


def find_touches(solids: Mapping[str, Solid], tolerance_m: float = TOUCH_M) -> list[Touch]:
    """Return the contacts between bodies.

    Parameters
    ----------
    tolerance_m
        Gap or overlap that counts as contact [m].
    """
    touches = []
    surfaces: list[tuple[Surface, Surface, Array, Array]]
    for (name, solid), (other, second) in combinations(solids.items(), 2):
        surfaces = []
        for piece, there in product(solid.pieces, second.pieces):
            low = np.maximum(piece.box.low, there.box.low) - tolerance_m
            high = np.minimum(piece.box.high, there.box.high) + tolerance_m
            if (low <= high).all():
                first, face = piece.surface, there.surface
                pair = (first.corners, first.faces), (face.corners, face.faces)
                surfaces.append((*pair, low, high))
        points, normals = collect_pushes(surfaces, tolerance_m, _MOST_POINTS)
        if len(points):
            touches.append(Touch(name, other, points, normals))
    return touches


class _Scene:
    """Bodies in groups that move as one, with their contacts."""

    def __init__(
        self,
        bodies: Mapping[str, Weight],
        touches: Sequence[Touch],
        joined: Iterable[tuple[str, str]],
        up: Vector,
        friction: float,
        tilt_deg: float,
    ) -> None:
        if not 0 <= tilt_deg <= 45:
            raise ValueError(f"tilt_deg must be 0 to 45, not {tilt_deg}.")
        self._bodies, self.friction, self._tilt_deg = bodies, friction, tilt_deg
        self.up, self._across = np.asarray(up, dtype=float), find_axes_across(up)
        self.groups = _join(bodies, joined)
        self._number = {name: i for i, group in enumerate(self.groups) for name in group}
        masses = [[bodies[name].mass_kg for name in group] for group in self.groups]
        self.mass_kg = np.array([sum(some) for some in masses])
        self.centre_m = np.array(
            [
                np.average([bodies[name].centre_m for name in group], axis=0, weights=some)
                for group, some in zip(self.groups, masses, strict=True)
            ]
        ).reshape(-1, 3)
        self.extent_m = np.array(
            [max(bodies[name].extent_m for name in group) for group in self.groups]
        )
        self.pairs: list[tuple[int | None, int | None, Array, Array]] = []
        for touch in touches:
            first, second = self._number.get(touch.body), self._number.get(touch.other)
            if first != second and len(touch.points_m):
                self.pairs.append((first, second, touch.points_m, touch.normals))
        self.lying = self._find_lying()
        self.forces = [force for contact in self.pairs for force in self._list_forces(*contact)]

    def find_groups(self, names: Collection[str]) -> frozenset[int]:
        """Return the groups of some bodies; firm bodies have none."""
        return frozenset(self._number[name] for name in names if name in self._number)

    def name_heaviest(self, group: int) -> str:
        """Return the heaviest body of a group."""
        return max(self.groups[group], key=lambda name: self._bodies[name].mass_kg)

    def is_walled(self, group: int) -> bool:
        """Return whether upright walls about a group keep it upright up to its centre of mass."""
        heights_m = [
            points[np.abs(normals @ self.up) <= BEARS] @ self.up
            for first, second, points, normals in self.pairs
            if group in (first, second)
        ]
        walls_m = np.concatenate([np.empty(0), *heights_m])
        least_m = min(_UPRIGHT_M, _UPRIGHT_SHARE * float(self.extent_m[group]))
        return (
            len(walls_m) > 0
            and float(walls_m.max()) >= float(self.centre_m[group] @ self.up) - _ROUNDING_M
            and float(np.ptp(walls_m)) >= least_m - _ROUNDING_M
        )

    def decide(self, held: frozenset[int]) -> Standing:
        """Return whether all groups stand while some are held."""
        program = _Program(self, held, held)
        for number, load in enumerate(self._list_loads()):
            if (motion := program.find_motion(*load)) is not None:
                return self._describe(motion, number > 0)
        return Standing()

    def _list_loads(self) -> Iterator[tuple[Array, Array]]:
        """Yield upward directions, and offsets of the centres of mass in shares of `SHIFT_M`.

        The first is level. The others are corners of a polygon about all tilts: loads that forces
        can balance form a convex set, so all tilts within are balanced, too.
        """
        yield self.up, np.zeros(3)
        if self._tilt_deg:
            for turn in range(_TILTS):
                angle = 2 * math.pi * turn / _TILTS
                across = math.cos(angle) * self._across[0] + math.sin(angle) * self._across[1]
                # Gravity pulls towards `across` where the ground is tilted towards it.
                slope = math.tan(math.radians(self._tilt_deg)) * _BEYOND
                yield self.up - slope * across, across * _BEYOND

    def _describe(self, motion: Mapping[int, tuple[Array, Array]], only_tilted: bool) -> Standing:
        """Return the verdict on a motion: of the group that moves most, seen from the ground."""

        def measure(group: int) -> tuple[float, int]:
            shift, turn = motion[group]
            size = np.linalg.norm(shift) + np.linalg.norm(turn) * self.extent_m[group]
            # A heavy body takes light ones on it along.
            return round(float(size * self.mass_kg[group]), 6), -group

        group = max(motion, key=measure)
        shift, turn = motion[group]
        name, sinking = self.name_heaviest(group), -float(shift @ self.up)
        sideways = shift + sinking * self.up
        turning = float(np.linalg.norm(turn)) * self.extent_m[group] / 2
        if turning < sinking and float(np.linalg.norm(sideways)) < sinking:
            how, towards, lack = "falls", -self.up, "nothing beneath it bears it"
        else:
            length = float(np.linalg.norm(sideways))
            if length < _MOVES:
                # It turns about its centre of mass: its top goes this way.
                sideways = np.cross(turn, self.up)
                length = max(float(np.linalg.norm(sideways)), _MOVES)
            how = "tips" if turning > length / 2 else "slides"
            towards = sideways / length
            lack = f"nothing {'bears' if how == 'tips' else 'stops'} it on that side"
        x, y, z = (round(float(value), 6) + 0.0 for value in towards)
        way = "" if how == "falls" else f" towards {_name_direction((x, y, z))}"
        when = f" if the ground is tilted by {self._tilt_deg:g} degrees" if only_tilted else ""
        reason = f"{name!r} {how}{way}{when}: {lack}"
        return Standing(name, how, (x, y, z), only_tilted, reason)

    def _list_forces(
        self, first: int | None, second: int | None, points_m: Array, normals: Array
    ) -> Iterator[_Forces]:
        """Yield the forces at a contact: pushes, and forces with friction where a body lies."""
        heights = normals @ self.up
        aside = np.linalg.norm(normals - heights[:, None] * self.up, axis=1)
        # Slopes that bear need walls against them.
        wall = np.where(np.abs(heights) <= BEARS, 1.0, -aside)
        yield _Forces(self._compute_wrenches(first, second, points_m, normals), wall)
        for pair, lies in (((first, second), heights > BEARS), ((second, first), heights < -BEARS)):
            upper, lower = pair
            if upper is None or (upper, lower) not in self.lying or not lies.any():
                continue
            frames = [find_axes_across((x, y, z)) for x, y, z in normals[lies].tolist()]
            sideways = self.friction * (_RAYS @ np.array(frames)).reshape(-1, 3)
            forces = np.repeat(normals[lies], len(_RAYS), axis=0) + sideways
            points = np.repeat(points_m[lies], len(_RAYS), axis=0)
            sides = self._compute_wrenches(first, second, points, forces)
            # A weight presses on a slope with less than itself.
            credit = 1 / np.repeat(np.abs(heights[lies]), len(_RAYS))
            yield _Forces(sides, np.zeros(len(forces)), (upper, lower), credit)

    def _compute_wrenches(
        self, first: int | None, second: int | None, points_m: Array, forces: Array
    ) -> list[tuple[int, Array]]:
        """Return the effect of forces on each group of a contact.

        These are force and torque over the extent of the group, shape (forces, 6).
        """
        wrenches = []
        for group, sign in ((first, 1.0), (second, -1.0)):
            if group is not None:
                torques = np.cross(points_m - self.centre_m[group], forces) / self.extent_m[group]
                wrenches.append((group, sign * np.hstack([forces, torques])))
        return wrenches

    def _find_lying(self) -> set[tuple[int, int | None]]:
        """Return pairs of groups of which the first lies on the second.

        Not if the second lies on the first as well, also across others, such as two hooks.
        """
        below: dict[int, set[int | None]] = {}
        for first, second, _, normals in self.pairs:
            heights = normals @ self.up
            if first is not None and (heights > BEARS).any():
                below.setdefault(first, set()).add(second)
            if second is not None and (heights < -BEARS).any():
                below.setdefault(second, set()).add(first)

        def reaches(begin: int | None, end: int) -> bool:
            seen, border = set[int | None](), {begin}
            while border:
                seen |= border
                there = {
                    lower for body in border if body is not None for lower in below.get(body, ())
                }
                border = there - seen
            return end in seen

        return {
            (upper, lower)
            for upper, lowers in below.items()
            for lower in lowers
            if not reaches(lower, upper)
        }


@dataclass(frozen=True, eq=False, slots=True)
class _Forces:
    """Unit forces at a contact.

    Parameters
    ----------
    sides
        Groups with the force and the torque over the extent on them, shape (forces, 6).
    wall
        Share of each force that counts as the push of a wall, shape (forces,).
    pair
        Groups of which the first lies on the second, for forces with friction.
    credit
        Weight that each force with friction needs, shape (forces,).
    """

    sides: list[tuple[int, Array]]
    wall: Array
    pair: tuple[int, int | None] | None = None
    credit: Array = field(default_factory=lambda: np.empty(0))


class _Program:
    """The linear program of some loose groups, for one load after the other.

    Rows: force and torque of each loose group in shares of its weight; then the pushes of walls on
    each, the friction that is credited between two groups, and the weight that comes down through
    each group.
    """

    def __init__(self, scene: _Scene, held: frozenset[int], weightless: frozenset[int]) -> None:
        self._scene = scene
        self._loose = [n for n in range(len(scene.groups)) if n not in held]
        count = len(self._loose)
        self._row = {group: 6 * i for i, group in enumerate(self._loose)}
        self._walls = {group: 6 * count + i for i, group in enumerate(self._loose)}
        # Columns in blocks with the same rows: rows, and values of shape (columns, rows).
        self._blocks: list[tuple[list[int], Array]] = []
        credits = self._add_forces(7 * count)
        upper = [
            _INFINITY if scene.is_walled(group) else _WALLS * float(scene.mass_kg[group])
            for group in self._loose
        ]
        upper += [0.0] * len(credits)
        self._add_flows(credits, weightless, upper)
        self._forces = sum(len(values) for _, values in self._blocks)
        self._highs = self._build(upper) if count else None

    def find_motion(self, upwards: Array, aside: Array) -> dict[int, tuple[Array, Array]] | None:
        """Return a motion that no contact resists; None if forces balance a load.

        Parameters
        ----------
        upwards
            Force against gravity, in shares of each weight, shape (3,).
        aside
            Offset of the centres of mass in shares of `SHIFT_M`, shape (3,).

        Returns
        -------
        dict or None
            Shift of the centre of mass and turn of each group that moves, shape (3,) each; the
            turn is per metre of shift.
        """
        if self._highs is None:
            return None
        scene, loads = self._scene, []
        for group in self._loose:
            shift_m = min(SHIFT_M, _SHIFT_SHARE * scene.extent_m[group]) * aside
            torque = np.cross(shift_m, upwards) / scene.extent_m[group]
            loads += [*upwards.tolist(), *torque.tolist()]
        for row, load in enumerate(loads):
            self._highs.changeRowBounds(row, load, load)
        self._highs.run()
        if self._highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            # Scaled rows may leave residuals above the tolerance.
            self._highs.setOptionValue("simplex_scale_strategy", 0)
            self._highs.clearSolver()
            self._highs.run()
        if self._highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            raise RuntimeError("The linear program on contact forces was not solved.")
        solution = self._highs.getSolution()
        helps = np.array(solution.col_value[self._forces :])
        if float(helps.sum()) <= _HELP:
            return None
        # The prices of the rows are the motion, as powers per share of weight.
        powers = -np.array(solution.row_dual[: len(loads)]).reshape(-1, 6)
        motion = {}
        for group, power in zip(self._loose, powers, strict=True):
            if np.abs(power).max() > _MOVES:
                shift = power[:3] / scene.mass_kg[group]
                turn = power[3:] / (scene.mass_kg[group] * scene.extent_m[group])
                motion[group] = (shift, turn)
        return motion

    def _add_forces(self, first_row: int) -> dict[tuple[int, int | None], int]:
        """Add the forces at all contacts; return the rows of credited friction of each pair."""
        scene, credits = self._scene, dict[tuple[int, int | None], int]()
        for force in scene.forces:
            sides = [(n, wrench) for n, wrench in force.sides if n in self._row]
            if not sides:
                continue
            scale_kg = min(float(scene.mass_kg[n]) for n, _ in sides)
            rows = [self._row[n] + i for n, _ in sides for i in range(6)]
            rows += [self._walls[n] for n, _ in sides]
            values = [scale_kg / scene.mass_kg[n] * wrench for n, wrench in sides]
            walls = np.repeat(scale_kg * force.wall[:, None], len(sides), axis=1)
            block = np.hstack([*values, walls])
            if force.pair is not None:
                rows.append(credits.setdefault(force.pair, first_row + len(credits)))
                block = np.hstack([block, scale_kg * force.credit[:, None]])
            self._blocks.append((rows, block))
        return credits

    def _add_flows(
        self,
        credits: Mapping[tuple[int, int | None], int],
        weightless: frozenset[int],
        upper: list[float],
    ) -> None:
        """Add the weight that comes down through each pair, and a row for each group.

        Parameters
        ----------
        upper
            Upper bounds of the rows after the balance [kg]; they are appended.
        """
        first = 6 * len(self._loose) + len(upper)
        groups = range(len(self._scene.groups))
        upper += [0.0 if n in weightless else float(self._scene.mass_kg[n]) for n in groups]
        for pair in sorted(self._scene.lying, key=str):
            above, below = pair
            column = {first + above: 1.0}
            if below is not None:
                column[first + below] = -1.0
            if below in self._walls:
                column[self._walls[below]] = -_WALLS
            if pair in credits:
                column[credits[pair]] = -1.0
            self._blocks.append(([*column], np.array([[*column.values()]])))

    def _build(self, upper: Sequence[float]) -> highspy.Highs:
        balance = 6 * len(self._loose)
        for row in range(balance):
            self._blocks.append(([row], np.array([[1.0], [-1.0]])))
        counts = [len(rows) for rows, values in self._blocks for _ in range(len(values))]
        return make_program(
            counts,
            np.concatenate([np.tile(rows, len(values)) for rows, values in self._blocks]),
            np.concatenate([values.reshape(-1) for _, values in self._blocks]),
            np.concatenate([np.full(self._forces, _PER_FORCE), np.ones(2 * balance)]),
            _INFINITY,
            (
                np.array([0.0] * balance + [-_INFINITY] * len(upper)),
                np.array([0.0] * balance + [*upper]),
            ),
        )


def _join(bodies: Iterable[str], joined: Iterable[tuple[str, str]]) -> list[tuple[str, ...]]:
    """Return the bodies in groups that move as one, in order."""
    group_of = {name: [name] for name in bodies}
    for first, second in joined:
        group, other = group_of[first], group_of[second]
        if group is not other:
            group += other
            group_of.update(dict.fromkeys(other, group))
    return list(dict.fromkeys(tuple(group) for group in group_of.values()))


def _name_direction(vector: Vector) -> str:
    """Return an axis such as ``-x``, or the components."""
    for axis, value in zip("xyz", vector, strict=True):
        if abs(value) > _ALONG:
            return f"{'-' if value < 0 else '+'}{axis}"
    return "(" + ", ".join(f"{value:.2g}" for value in vector) + ")"
