"""Which bodies pass through each other: kinds and affinities of a compiled model.

Two geometries touch where the kind of one is among the affinities of the other. A body that passes
through some others has a kind of its own; all the rest share one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from types import TracebackType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Body, Pose
from skillplan_mujoco.cell import Cell
from skillplan_mujoco.cell_model import FRICTIONAL
from skillplan_simulation.simulator import ROBOT, TABLE, Touch, UpsetError

# Bits of a kind; the first is that of all bodies without one of their own.
_BITS = 31


class PairMasks:
    """Lets pairs of bodies, or links of the arm, touch nothing.

    Parameters
    ----------
    model
        Compiled.
    owners
        Names of what the bodies of the model belong to: the arm's links to the arm.
    present
        What is in the world, kept up to date.
    """

    def __init__(self, model: Any, owners: Mapping[int, str], present: Mapping[str, int]) -> None:
        self._model, self._owners, self._present = model, owners, present
        self._parted: set[tuple[str, str]] = set()
        self._withdrawn: dict[str, frozenset[int]] = {}
        self._idle: list[int] = []
        self._geoms: dict[int, list[int]] = {}
        for geom, body in enumerate(model.geom_bodyid.tolist()):
            self._geoms.setdefault(body, []).append(geom)

    def geoms(self, body: int) -> list[int]:
        """Return the numbers of a body's geometries."""
        return self._geoms.get(body, [])

    def part(self, one: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        self._parted |= {_pair(one, other) for other in others}
        self.set()

    def join(self, one: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""
        self._parted -= {_pair(one, other) for other in others}
        self.set()

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Let links of the arm touch nothing, and its others what they may; -1 is all of a body."""
        self._withdrawn[name] = frozenset(links)
        self.set()

    def idle(self, geoms: Iterable[int]) -> None:
        """Let these geometries touch nothing, and all others what they may."""
        self._idle = list(geoms)
        self.set()

    def set(self) -> None:
        """Tell the model."""
        special = _cover(self._parted)
        if len(special) > _BITS - 1:
            raise UpsetError(f"more than {_BITS - 1} bodies pass through others at once")
        bits = {name: 2 << place for place, name in enumerate(special)}
        model = self._model
        for body, geoms in self._geoms.items():
            kind, affinity = self._mask(body, bits)
            model.geom_contype[geoms], model.geom_conaffinity[geoms] = kind, affinity
            model.body_contype[body], model.body_conaffinity[body] = kind, affinity
        model.geom_contype[self._idle] = model.geom_conaffinity[self._idle] = 0

    def _mask(self, body: int, bits: Mapping[str, int]) -> tuple[int, int]:
        """Return kind and affinity of a body of the model."""
        name = self._owners[body]
        if name not in self._present:
            return 0, 0
        hidden = self._withdrawn.get(name, frozenset())
        if body in hidden or -1 in hidden:
            return 0, 0
        through = {name, *(other for pair in self._parted if name in pair for other in pair)}
        # Whoever has a kind of its own leaves it to the rest whether they touch it.
        shared = 0 if name in bits else 1
        return bits.get(name, 1), shared + sum(
            bit for other, bit in bits.items() if other not in through
        )


def _cover(parted: Iterable[tuple[str, str]]) -> list[str]:
    """Return bodies of which every pair has one, and the arm, whose links are no obstacles."""
    pairs = sorted(parted)
    count = Counter(name for pair in pairs for name in pair)
    found = {ROBOT}
    for pair in pairs:
        if not found & set(pair):
            found.add(max(pair, key=lambda name: (count[name], name)))
    return sorted(found)


def _pair(one: str, other: str) -> tuple[str, str]:
    return min(one, other), max(one, other)


Vector = NDArray[np.float64]


def times(matrix: Vector, vector: Vector) -> Vector:
    """Return a matrix times a vector, shapes (rows, columns) and (columns,)."""
    empty = np.empty(matrix.shape[0])
    mujoco.mju_mulMatVec(empty, matrix, vector)
    return empty


def times_transposed(matrix: Vector, vector: Vector) -> Vector:
    """Return a transposed matrix times a vector, shapes (rows, columns) and (rows,)."""
    empty = np.empty(matrix.shape[1])
    mujoco.mju_mulMatTVec(empty, matrix, vector)
    return empty


def product(left: Vector, right: Vector) -> Vector:
    """Return a product of matrices, shapes (rows, inner) and (inner, columns)."""
    empty = np.empty((left.shape[0], right.shape[1]))
    mujoco.mju_mulMatMat(empty, left, right)
    return empty


# Nothing gets so far, or so fast, in a simulation that has not blown up [m], [m/s].
_FAR_M, _FAST_M_PER_S = 10.0, 50.0
# Bodies that are this close bear on each other [m].
_NEAR_M = 0.0005


class World:
    """A table and bodies under gravity, advanced 240 times a simulated second.

    Worlds of a cell share its model: a new one ends the one before.

    Parameters
    ----------
    cell
        Whose model is simulated.
    """

    def __init__(self, cell: Cell) -> None:
        self.cell, self.friction = cell, cell.friction
        self.model, self.data, self.ids = cell.model, cell.start(), cell.ids
        self.steps = 0
        self.numbers: dict[str, int] = {TABLE: self.ids[TABLE]}
        self._masses: dict[str, float] = {}
        self._masks = PairMasks(self.model, cell.owners, self.numbers)
        self._is_prepared = False
        # Of the last step, once somebody has read them.
        self._touches: list[Touch] | None = None
        self._masks.set()

    def __enter__(self) -> World:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave all as it is: the next world starts afresh."""

    def show_arm(self) -> None:
        """Put the arm into the world."""
        self.numbers[ROBOT] = self.ids[ROBOT]
        self.cell.weigh_arm()
        self._masks.set()

    def fit(self, hand: Hand) -> None:
        """Have the arm's hand be another of those in the model."""
        self._masks.idle(self.cell.fit(hand))
        self.placed()

    def geoms(self, name: str) -> list[int]:
        """Return the numbers of the geometries of a body."""
        return self._masks.geoms(self.numbers[name])

    def prepare(self) -> None:
        """Work out what the next step begins with: places, contacts, inertia and bias."""
        if not self._is_prepared:
            mujoco.mj_step1(self.model, self.data)
            self._is_prepared, self._touches = True, None

    def step(self) -> None:
        """Advance by 1/240 s."""
        self.prepare()
        mujoco.mj_step2(self.model, self.data)
        self._is_prepared, self._touches = False, None
        self.steps += 1

    def add(self, body: Body, pose: Pose, *, stands: bool = False) -> int:
        """Put a body at a pose, its origin at the centre of its bottom.

        Parameters
        ----------
        body, pose
            What, and where.
        stands
            Of no use here: whatever is in the world can be moved.
        """
        number = self.numbers[body.name] = self.ids[body.name]
        self._masses[body.name] = body.mass_kg
        self.model.body_gravcomp[number] = 0.0
        self.put(body.name, pose)
        self._masks.set()
        return number

    def stand(self, moving: Iterable[str]) -> None:
        """Have what is not to be moved stand; nothing changes here."""

    def put(self, name: str, pose: Pose) -> None:
        """Move a body to a pose, at rest."""
        x, y, z, w = pose.orientation
        place, speed = self.cell.coordinates(name)
        self.data.qpos[place] = (*pose.position, w, x, y, z)
        self.data.qvel[speed] = 0.0
        self.placed()

    def placed(self) -> None:
        """Work out where all is after something was put elsewhere."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self._is_prepared = False

    def pose(self, name: str) -> Pose:
        """Return where a body is: the pose of the centre of its bottom."""
        place, _ = self.cell.coordinates(name)
        px, py, pz, w, x, y, z = self.data.qpos[place].tolist()
        return Pose((px, py, pz), (x, y, z, w))

    def centre(self, name: str) -> Vector:
        """Return where the centre of mass of a body is [m], shape (3,)."""
        return np.array(self.data.xipos[self.numbers[name]])

    def is_sane(self) -> bool:
        """Whether every body is at a finite place and none races off."""
        qpos, qvel = self.data.qpos, self.data.qvel
        for place, speed in map(self.cell.coordinates, self._masses):
            # What is no number is not within limits, either.
            position = [abs(value) < _FAR_M for value in qpos[place][:3].tolist()]
            linear = [abs(value) < _FAST_M_PER_S for value in qvel[speed][:3].tolist()]
            if not (all(position) and all(linear)):
                return False
        return True

    def velocity(self, name: str) -> tuple[Vector, Vector]:
        """Return how fast a body's centre of mass moves [m/s] and the body turns [rad/s]."""
        _, speed = self.cell.coordinates(name)
        rotation, values = self._rotation(name), np.array(self.data.qvel[speed])
        # A body turns about its own axes, and its place is that of its bottom.
        turning = times(rotation, values[3:])
        away = times(rotation, self.model.body_ipos[self.numbers[name]])
        return values[:3] + np.cross(turning, away), turning

    def inertia_kg_m2(self, name: str) -> Vector:
        """Return the inertia of a body about its centre of mass in the world, shape (3, 3)."""
        rotation = self._rotation(name)
        along = rotation * self.model.body_inertia[self.numbers[name]]
        return product(along, np.ascontiguousarray(rotation.T))

    def _rotation(self, name: str) -> Vector:
        place, _ = self.cell.coordinates(name)
        zeros = np.zeros(9)
        mujoco.mju_quat2Mat(zeros, self.data.qpos[place][3:])
        return zeros.reshape(3, 3)

    def mass_kg(self, name: str) -> float:
        """Return the mass of a body [kg]."""
        return self._masses[name]

    def weigh(self, name: str, mass_kg: float) -> None:
        """Change the mass of a body for a while; its shape stays."""
        self.cell.scale_mass(name, mass_kg / self._masses[name])
        self._masses[name] = mass_kg

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies of the scene, in the order in which they were put."""
        return tuple(self._masses)

    @property
    def fixed(self) -> frozenset[str]:
        """Bodies that nothing can move: none."""
        return frozenset()

    def others(self, name: str) -> list[str]:
        """Return the names of the table and all bodies but one."""
        return [other for other in (TABLE, *self.bodies) if other != name]

    def smooth(self, names: Iterable[str]) -> None:
        """Have parts of the arm press without friction."""
        geoms = [geom for name in names for geom in self._masks.geoms(self.ids[name])]
        # Of two that touch, the one of the higher priority says what contacts are like.
        self.model.geom_priority[geoms], self.model.geom_condim[geoms] = 1, 1

    def roughen(self, names: Iterable[str]) -> None:
        """Have parts of the arm press with friction again."""
        geoms = [geom for name in names for geom in self._masks.geoms(self.ids[name])]
        self.model.geom_priority[geoms], self.model.geom_condim[geoms] = 0, FRICTIONAL

    def part(self, one: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        self._masks.part(one, others)

    def join(self, one: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""
        self._masks.join(one, others)

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Let links of a body touch nothing; see :meth:`PairMasks.withdraw`."""
        self._masks.withdraw(name, links)

    def hold(self, name: str) -> int:
        """Fix a body where it is; return the constraint, to be given to `release`."""
        return self.bond(0, self.numbers[name])

    def fasten(self, name: str, other: str) -> None:
        """Fix a body to another as it is; the two pass through each other from now on."""
        self.part(name, [other])
        self.bond(0 if other == TABLE else self.numbers[other], self.numbers[name])

    def bond(self, bearing: int, body: int) -> int:
        """Fix a body of the model to another as it is; return the constraint."""
        found = next((one for one in self.cell.bonds if not self.data.eq_active[one]), None)
        if found is None:
            raise UpsetError(f"more than {len(self.cell.bonds)} bodies are fixed to others at once")
        model, data = self.model, self.data
        back, offset, turn = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(back, data.xquat[bearing])
        mujoco.mju_rotVecQuat(offset, data.xpos[body] - data.xpos[bearing], back)
        mujoco.mju_mulQuat(turn, back, data.xquat[body])
        model.eq_obj1id[found], model.eq_obj2id[found] = bearing, body
        # Where it is on the body, the body in the frame of what bears it, and how turns count.
        model.eq_data[found, :11] = (0.0, 0.0, 0.0, *offset, *turn, 1.0)
        data.eq_active[found] = 1
        return int(found)

    def release(self, constraint: int) -> None:
        """Undo a constraint."""
        self.data.eq_active[constraint] = 0

    def nearest(self, name: str, others: Iterable[str] | None = None) -> str | None:
        """Return which of the others touches a body, or is nearest to it by 0.5 mm; else None."""
        found = [
            (distance_m, other)
            for other in (self.others(name) if others is None else sorted(others))
            if (distance_m := self._distance_m(name, other, _NEAR_M)) < _NEAR_M
        ]
        return min(found)[1] if found else None

    def is_near(self, one: str, other: str, distance_m: float) -> bool:
        """Whether two bodies are no farther apart than a distance [m]."""
        return self._distance_m(one, other, distance_m) < distance_m

    def _distance_m(self, one: str, other: str, most_m: float) -> float:
        """Return how far two bodies are apart, and no more than so far [m]."""
        found = (
            mujoco.mj_geomDistance(self.model, self.data, first, second, most_m, None)
            for first in self._masks.geoms(self.numbers[one])
            for second in self._masks.geoms(self.numbers[other])
        )
        return min(map(float, found))

    def touches(self) -> list[Touch]:
        """Return where bodies press on each other, after the last step."""
        if self._touches is None:
            self._touches = self._read_touches()
        return self._touches

    def _read_touches(self) -> list[Touch]:
        data = self.data
        if not data.ncon:
            return []
        contacts, force_n = data.contact, np.array(data.efc_force)
        rows: Vector = contacts.efc_address
        pressing = [n for n, row in enumerate(rows.tolist()) if row >= 0 and force_n[row] > 0.0]
        if not pressing:
            return []
        first_row = rows[pressing]
        frames = contacts.frame[pressing].reshape(-1, 3, 3)
        normal = force_n[first_row, np.newaxis] * frames[:, 0]
        # A contact's rows are its normal force and, where it has any, two of friction, and a
        # moment about the normal.
        rough = contacts.dim[pressing] > 1
        one, other = (
            np.where(rough, force_n[first_row + axis * rough], 0.0)[:, np.newaxis] * frames[:, axis]
            for axis in (1, 2)
        )
        # The normal leads from the first geometry to the second, which feels the force.
        felt_n, places = normal + one + other, contacts.pos[pressing]
        labels = self.cell.labels
        names = zip(
            contacts.geom2[pressing].tolist(), contacts.geom1[pressing].tolist(), strict=True
        )
        return [
            Touch(labels[feels], labels[gives], places[n], frames[n, 0], size_n, felt_n[n])
            for n, ((feels, gives), size_n) in enumerate(
                zip(names, force_n[first_row].tolist(), strict=True)
            )
        ]

    def points_on(self, name: str) -> list[Touch]:
        """Return where a body is touched, as what is felt by it."""
        return [
            point if point.first == name else point.turned()
            for point in self.touches()
            if name in (point.first, point.second)
        ]

    def pulled_n(self, name: str, constraint: int) -> Vector:
        """Return what a constraint does to a body that it fixes to the robot [N], shape (3,)."""
        data, weld = self.data, mujoco.mjtConstraint.mjCNSTR_EQUALITY
        rows = [
            row
            for row in range(data.ne)
            if data.efc_type[row] == weld and data.efc_id[row] == constraint
        ]
        # Three forces on what bears it, then three moments.
        return -np.array(data.efc_force[rows[:3]]) if rows else np.zeros(3)
