"""A MuJoCo world: a reset cell with some of its bodies, and masks of pairs that do not touch."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Body, Pose, name_shank
from skillplan_mujoco.cell import Cell
from skillplan_mujoco.cell_model import FOOT_GROUP, FRICTIONAL, STIFF
from skillplan_simulation import simulator
from skillplan_simulation.simulator import (
    CARRIER,
    ROBOT,
    STEP_S,
    TABLE,
    Touch,
    UpsetError,
    compute_speeds,
)

# Number of usable bits: the first is the kind of all bodies without a kind of their own, and the
# one after them that of feet, which touch the table only.
_BITS = 30
_FOOT = 1 << _BITS


class PairMasks:
    """Collision masks of a compiled model, which let pairs of bodies pass through each other.

    Two geometries touch if the kind of one is among the affinities of the other. A body that passes
    through some others has a kind of its own; the rest share one.

    Parameters
    ----------
    owners
        Names by number of the model's body; links belong to the arm.
    present
        Bodies in the world, kept up to date.
    """

    def __init__(self, model: Any, owners: Mapping[int, str], present: Mapping[str, int]) -> None:
        self._model, self._owners, self._present = model, owners, present
        self._parted: set[tuple[str, str]] = set()
        self._withdrawn: dict[str, frozenset[int]] = {}
        self._idle: list[int] = []
        self._geoms: dict[int, list[int]] = {}
        self._feet: dict[int, int] = {}
        groups = model.geom_group.tolist()
        for geom, body in enumerate(model.geom_bodyid.tolist()):
            if groups[geom] == FOOT_GROUP:
                self._feet[body] = geom
            else:
                self._geoms.setdefault(body, []).append(geom)
        self._above = {_sort_pair(owners[body], TABLE) for body in self._feet}

    def geoms(self, body: int) -> list[int]:
        """Return the numbers of a body's geometries, without its foot."""
        return self._geoms.get(body, [])

    def part(self, name: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        self._parted |= {_sort_pair(name, other) for other in others}
        self.set()

    def join(self, name: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""
        self._parted -= {_sort_pair(name, other) for other in others}
        self.set()

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Disable collisions of these links only; -1 means the whole body."""
        self._withdrawn[name] = frozenset(links)
        self.set()

    def idle(self, geoms: Iterable[int]) -> None:
        """Disable collisions of these geometries only."""
        self._idle = list(geoms)
        self.set()

    def set(self) -> None:
        """Write the masks to the model."""
        special = _cover_pairs(self._parted | self._above)
        if len(special) > _BITS - 1:
            raise UpsetError(f"more than {_BITS - 1} bodies pass through others at once")
        bits = {name: 2 << place for place, name in enumerate(special)}
        model = self._model
        for body, geoms in self._geoms.items():
            kind, affinity = self._mask(body, bits)
            model.geom_contype[geoms], model.geom_conaffinity[geoms] = kind, affinity
            model.body_contype[body], model.body_conaffinity[body] = kind, affinity
        self._set_feet()
        model.geom_contype[self._idle] = model.geom_conaffinity[self._idle] = 0

    def _set_feet(self) -> None:
        """Let the feet of the bodies that are there touch the table."""
        model = self._model
        for body, foot in self._feet.items():
            name = self._owners[body]
            hidden = self._withdrawn.get(name, frozenset())
            stands = name in self._present and not hidden & {body, -1}
            stands &= _sort_pair(name, TABLE) not in self._parted
            model.geom_contype[foot], model.geom_conaffinity[foot] = _FOOT * stands, 0
            model.body_contype[body] |= _FOOT * stands
        if self._feet and TABLE in self._present:
            table = self._present[TABLE]
            model.geom_conaffinity[self._geoms[table]] |= _FOOT
            model.body_conaffinity[table] |= _FOOT

    def _mask(self, body: int, bits: Mapping[str, int]) -> tuple[int, int]:
        """Return kind and affinity of a body of the model."""
        name = self._owners[body]
        if name not in self._present:
            return 0, 0
        hidden = self._withdrawn.get(name, frozenset())
        if body in hidden or -1 in hidden:
            return 0, 0
        pairs = self._parted | self._above
        through = {name, *(other for pair in pairs if name in pair for other in pair)}
        # For a body with a kind of its own, the other bodies' affinities decide.
        shared = 0 if name in bits else 1
        return bits.get(name, 1), shared + sum(
            bit for other, bit in bits.items() if other not in through
        )


def _cover_pairs(parted: Iterable[tuple[str, str]]) -> list[str]:
    """Return a vertex cover of the pairs, with the arm, whose links are not obstacles."""
    pairs = sorted(parted)
    count = Counter(name for pair in pairs for name in pair)
    covered = {ROBOT}
    for pair in pairs:
        if not covered & set(pair):
            covered.add(max(pair, key=lambda name: (count[name], name)))
    return sorted(covered)


def _sort_pair(name: str, other: str) -> tuple[str, str]:
    return min(name, other), max(name, other)


Vector = NDArray[np.float64]


def multiply(matrix: Vector, vector: Vector) -> Vector:
    """Return the product of a matrix and a vector, summed in a fixed order."""
    result = np.empty(matrix.shape[0])
    mujoco.mju_mulMatVec(result, matrix, vector)
    return result


def multiply_transposed(matrix: Vector, vector: Vector) -> Vector:
    """Return the product of a transposed matrix and a vector, summed in a fixed order."""
    result = np.empty(matrix.shape[1])
    mujoco.mju_mulMatTVec(result, matrix, vector)
    return result


def multiply_matrices(left: Vector, right: Vector) -> Vector:
    """Return the product of two matrices, summed in a fixed order."""
    result = np.empty((left.shape[0], right.shape[1]))
    mujoco.mju_mulMatMat(result, left, right)
    return result


def merge_touches(touches: Iterable[Touch]) -> list[Touch]:
    """Return one contact for each pair of bodies, with its total force and mean place and normal.

    Hundreds of contacts of bodies at rest would be added up in every frame.
    """
    groups: dict[tuple[str, str], list[Touch]] = {}
    for touch in touches:
        groups.setdefault((touch.first, touch.second), []).append(touch)
    merged = []
    for (first, second), group in groups.items():
        normal_n = sum(touch.normal_n for touch in group)
        # Weighed by force, they give the same sums as the contacts.
        place, normal = (
            sum((touch.normal_n * vector(touch) for touch in group), np.zeros(3)) / normal_n
            for vector in (attrgetter("place"), attrgetter("normal"))
        )
        force_n = sum((touch.force_n for touch in group), np.zeros(3))
        merged.append(Touch(first, second, place, normal, normal_n, force_n))
    return merged


# Greatest distance [m] and speed [m/s] of a body in a simulation that has not blown up.
_FAR_M, _FAST_M_PER_S = 10.0, 50.0
# Distance below which bodies bear on each other [m].
_NEAR_M = 0.0005
# Speed at which a body that lands sinks a tenth of a millimetre in a step [m/s].
_FALLING_M_PER_S = 1e-4 / STEP_S
# Steps after that in which it comes to rest, and damping ratio of its contacts meanwhile: pieces
# that sink beside a seam are pushed aside, and a light part spins if it bounces.
_LANDING_STEPS, _LANDING_DAMPING = 12, 3.0
# Speed that wakes a body and moves it by nothing that counts [m/s].
_WAKING_M_PER_S = 1e-12
# MuJoCo's counter of a body that may sleep after ten steps at rest.
_JUST_WOKEN = -11


class World(simulator.World):
    """A table and bodies under gravity, advanced 240 times a simulated second.

    Worlds of a cell share its model: a new one invalidates the previous one.
    """

    def __init__(self, cell: Cell) -> None:
        super().__init__(cell.friction)
        self.cell = cell
        self.model, self.data, self.ids = cell.model, cell.start(), cell.ids
        self.divide(1)
        self.numbers[TABLE] = self.ids[TABLE]
        self.filters: PairMasks = PairMasks(self.model, cell.owners, self.numbers)
        self._is_prepared = False
        # Contacts of the last step, once read; and those of bodies that sleep since, one a pair.
        self._touches: list[Touch] | None = None
        self._resting: list[Touch] = []
        # Bodies that a skill moves, which stay awake, and the numbers of their trees.
        self._handled: list[str] = []
        self._moving: list[int] = []
        # Steps until a part that fell is at rest.
        self._landing = 0
        self.filters.set()

    def show_arm(self) -> None:
        """Put the arm into the world."""
        self.numbers[ROBOT] = self.ids[ROBOT]
        self.cell.weigh_arm()
        self.filters.set()

    def fit(self, hand: Hand) -> None:
        """Mount another hand of the model."""
        self.filters.idle(self.cell.fit(hand))
        self.placed()

    def geoms(self, name: str) -> list[int]:
        """Return the numbers of the geometries of a body."""
        return self.filters.geoms(self.numbers[name])

    def prepare(self) -> None:
        """Compute positions, contacts, inertia and bias for the next step."""
        if not self._is_prepared:
            awake = int(self.data.ntree_awake)
            for tree in self._moving:
                if self.data.tree_asleep[tree] < 0:
                    self.data.tree_asleep[tree] = _JUST_WOKEN
            mujoco.mj_step1(self.model, self.data)
            self._is_prepared, self._touches = True, None
            if self.data.ntree_awake > awake:
                self._resting = [touch for touch in self._resting if self._is_resting(touch)]

    def step(self) -> None:
        """Advance by 1/240 s, or by the last part of a divided step."""
        self.prepare()
        self.advance()
        self.steps += 1

    def divide(self, count: int, *, stiff: bool = False) -> None:
        """Divide each step from now on, whose parts `advance` and at last `step` simulate.

        Parameters
        ----------
        stiff
            True if contacts are as stiff as the shorter steps allow, and do not bounce.
        """
        self.model.opt.timestep = STEP_S / count
        self.model.geom_solref[:, 0] = STIFF[0] / (count if stiff else 1)
        self.model.geom_solref[:, 1] = _LANDING_DAMPING if stiff else STIFF[1]

    def advance(self) -> None:
        """Simulate a prepared part of a step."""
        awake = int(self.data.ntree_awake)
        mujoco.mj_step2(self.model, self.data)
        self._is_prepared, self._touches = False, None
        if self.data.ntree_awake < awake:
            self._resting = merge_touches(filter(self._is_resting, self.touches()))

    def _is_resting(self, touch: Touch) -> bool:
        """Return whether a contact is between bodies that sleep or cannot move."""
        return self._is_asleep(touch.first) and self._is_asleep(touch.second)

    def _is_asleep(self, name: str) -> bool:
        tree = int(self.model.body_treeid[self.ids[name]])
        return tree < 0 or int(self.data.tree_asleep[tree]) >= 0

    def _wake(self) -> None:
        """Let all bodies move again, as supports or bonds of sleeping ones may be gone."""
        counters = self.data.tree_asleep
        asleep = np.flatnonzero(counters >= 0)
        # MuJoCo wakes bodies that have a speed.
        self.data.qvel[self.model.tree_dofadr[asleep]] = _WAKING_M_PER_S
        # Bodies that were still in the hand would sleep in the step in which it lets them go.
        counters[counters < 0] = _JUST_WOKEN
        self._is_prepared, self._resting = False, []

    def add(self, body: Body, pose: Pose, *, stands: bool = False) -> int:
        """Put a body at a pose; only bodies that a task fixes cannot be moved."""
        number = self.numbers[body.name] = self.ids[body.name]
        self._masses[body.name] = body.mass_kg
        if body.shank is not None:
            shank = name_shank(body.name)
            self.numbers[shank] = self.ids[shank]
            self.filters.part(shank, body.shank.unchecked)
        if not body.fixed:
            self.model.body_gravcomp[number] = 0.0
            self.put(body.name, pose)
        self.filters.set()
        return number

    def remove(self, name: str) -> None:
        """Take a body out of the world, with all its fastenings."""
        self._release_all(name)
        self._wake()
        place, speed = self.cell.coordinates(name)
        self.data.qpos[place] = self.model.qpos0[place]
        self.data.qvel[speed] = 0.0
        self.model.body_gravcomp[self.numbers.pop(name)] = 1.0
        self.numbers.pop(name_shank(name), None)
        del self._masses[name]
        self.placed()
        self.filters.set()

    def stand(self, moving: Iterable[str]) -> None:
        """Keep bodies that are moved awake: one at rest in the jaws must fall once they open."""
        trees = {
            name: int(self.model.body_treeid[self.ids[name]])
            for name in sorted(moving)
            if name in self.ids
        }
        self._handled = [name for name, tree in trees.items() if tree >= 0]
        self._moving = [trees[name] for name in self._handled]

    def has_falling(self) -> bool:
        """Return whether a body that a skill moves is fast, or was, and nothing holds it.

        A part that has landed turns and slides for some steps, if contacts become soft at once.
        """
        self._landing = self._landing - 1 if self._landing else 0
        if self._is_one_fast():
            self._landing = _LANDING_STEPS
        return bool(self._landing)

    def moves_thin(self) -> bool:
        """Return whether a thin body is awake while no skill handles it."""
        asleep = self.data.tree_asleep
        return any(asleep[tree] < 0 and tree not in self._moving for tree in self.cell.thin)

    def _is_one_fast(self) -> bool:
        model, data = self.model, self.data
        for name in self._handled:
            if name not in self.numbers:
                continue
            speed = data.qvel[self.cell.coordinates(name)[1]][:3].tolist()
            if math.hypot(*speed) > _FALLING_M_PER_S:
                number = self.numbers[name]
                active = [bond for bond in self.cell.bonds if data.eq_active[bond]]
                if not any(number in (model.eq_obj1id[b], model.eq_obj2id[b]) for b in active):
                    return True
        return False

    def push(self, name: str, force_n: Vector) -> None:
        """Push the centre of a body in every step until further notice [N], shape (3,)."""
        self.data.xfrc_applied[self.numbers[name], :3] = force_n

    def pushed_n(self, name: str) -> Vector:
        """Return the force of `push` on a body [N], shape (3,)."""
        return np.array(self.data.xfrc_applied[self.numbers[name], :3])

    def put(self, name: str, pose: Pose) -> None:
        """Move a body to a pose, at rest."""
        _, speed = self.cell.coordinates(name)
        self._put(name, pose)
        self.data.qvel[speed] = 0.0
        self.placed()

    def _put(self, name: str, pose: Pose) -> None:
        x, y, z, w = pose.orientation
        place, _ = self.cell.coordinates(name)
        self.data.qpos[place] = (*pose.position, w, x, y, z)

    def placed(self) -> None:
        """Update positions after a body was put elsewhere."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self._is_prepared = False

    def pose(self, name: str) -> Pose:
        """Return the pose of the centre of a body's bottom."""
        if self.cell.is_still(name):
            number = self.ids[name]
            px, py, pz = self.model.body_pos[number].tolist()
            w, x, y, z = self.model.body_quat[number].tolist()
            return Pose((px, py, pz), (x, y, z, w))
        place, _ = self.cell.coordinates(name)
        px, py, pz, w, x, y, z = self.data.qpos[place].tolist()
        return Pose((px, py, pz), (x, y, z, w))

    def centre(self, name: str) -> Vector:
        """Return the centre of mass of a body [m], shape (3,)."""
        return np.array(self.data.xipos[self.numbers[name]])

    def is_sane(self) -> bool:
        """Return whether every body has a finite position and a plausible speed."""
        qpos, qvel = self.data.qpos, self.data.qvel
        for place, speed in map(self.cell.coordinates, self._masses.keys() - self.fixed):
            # NaN is not within limits, either.
            position = [abs(value) < _FAR_M for value in qpos[place][:3].tolist()]
            linear = [abs(value) < _FAST_M_PER_S for value in qvel[speed][:3].tolist()]
            if not (all(position) and all(linear)):
                return False
        return True

    def velocity(self, name: str) -> tuple[Vector, Vector]:
        """Return the velocity of a body's centre of mass [m/s] and its angular velocity [rad/s]."""
        _, speed = self.cell.coordinates(name)
        rotation, values = self._rotation(name), np.array(self.data.qvel[speed])
        # Rates are about the body's own axes, and its origin is at its bottom.
        turning = multiply(rotation, values[3:])
        away = multiply(rotation, self.model.body_ipos[self.numbers[name]])
        return values[:3] + np.cross(turning, away), turning

    def inertia_kg_m2(self, name: str) -> Vector:
        """Return the inertia tensor about the centre of mass in world axes, shape (3, 3)."""
        rotation = self._rotation(name)
        along = rotation * self.model.body_inertia[self.numbers[name]]
        return multiply_matrices(along, np.ascontiguousarray(rotation.T))

    def _rotation(self, name: str) -> Vector:
        place, _ = self.cell.coordinates(name)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, self.data.qpos[place][3:])
        return rotation.reshape(3, 3)

    def weigh(self, name: str, mass_kg: float) -> None:
        """Change the mass of a body temporarily; its shape stays."""
        self.cell.scale_mass(name, mass_kg / self._masses[name])
        self._masses[name] = mass_kg

    @property
    def fixed(self) -> frozenset[str]:
        """Bodies that cannot move."""
        return frozenset(name for name in self._masses if self.cell.is_still(name))

    def smooth(self, names: Iterable[str]) -> None:
        """Disable friction of parts of the arm."""
        geoms = [geom for name in names for geom in self.filters.geoms(self.ids[name])]
        # The geometry with the higher priority determines the contact.
        self.model.geom_priority[geoms], self.model.geom_condim[geoms] = 1, 1

    def roughen(self, names: Iterable[str]) -> None:
        """Enable friction of parts of the arm again."""
        geoms = [geom for name in names for geom in self.filters.geoms(self.ids[name])]
        self.model.geom_priority[geoms], self.model.geom_condim[geoms] = 0, FRICTIONAL

    def hold(self, name: str) -> int:
        """Fix a body in place; return the constraint for `release`."""
        return self.bond(0, self.numbers[name])

    def fix(self, name: str, other: str) -> int:
        """Fix a body to another in its current pose; return the constraint for `release`."""
        return self.bond(self.numbers[other], self.numbers[name])

    def carry(self, names: Iterable[str], pose: Pose) -> None:
        """Fix bodies to a heavy carrier at a pose, which `drive` moves."""
        self._put(CARRIER, pose)
        self.placed()
        self._carried += [self.bond(self.ids[CARRIER], self.numbers[name]) for name in names]

    def drive(self, pose: Pose, after: Pose) -> None:
        """Set the pose of the carrier, and its speed to the pose after the next step."""
        velocity, spin = compute_speeds(pose, after)
        _, speed = self.cell.coordinates(CARRIER)
        self._put(CARRIER, pose)
        self.data.qvel[speed] = (*velocity, *pose.inverse().rotate(spin))
        self._is_prepared = False

    def bond(self, bearing: int, body: int) -> int:
        """Fix a body of the model to another in its current pose; return the constraint."""
        bond = next((number for number in self.cell.bonds if not self.data.eq_active[number]), None)
        if bond is None:
            raise UpsetError(f"more than {len(self.cell.bonds)} bodies are fixed to others at once")
        model, data = self.model, self.data
        back, offset, turn = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(back, data.xquat[bearing])
        mujoco.mju_rotVecQuat(offset, data.xpos[body] - data.xpos[bearing], back)
        mujoco.mju_mulQuat(turn, back, data.xquat[body])
        model.eq_obj1id[bond], model.eq_obj2id[bond] = bearing, body
        # MuJoCo makes bonds as stiff as the mean of the inverse moments of inertia allows: a rod,
        # which spins easily, would tilt. This weight is 1 for a ball.
        inertia_kg_m2 = model.body_inertia[body]
        weight = math.sqrt((1.0 / inertia_kg_m2).mean() * inertia_kg_m2.max())
        # Anchor on the body, pose of the body in the bearing frame, and weight of rotations.
        model.eq_data[bond, :11] = (0.0, 0.0, 0.0, *offset, *turn, weight)
        data.eq_active[bond] = 1
        return int(bond)

    def release(self, constraint: int) -> None:
        """Remove a constraint."""
        self.data.eq_active[constraint] = 0
        self._wake()

    def part(self, name: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        super().part(name, others)
        self._wake()

    def nearest(self, name: str, others: Iterable[str] | None = None) -> str | None:
        """Return the body that touches or is nearest to another within 0.5 mm, or None."""
        close = [
            (distance_m, other)
            for other in (self.others(name) if others is None else sorted(others))
            if (distance_m := self._distance_m(name, other, _NEAR_M)) < _NEAR_M
        ]
        return min(close)[1] if close else None

    def is_near(self, name: str, other: str, distance_m: float) -> bool:
        """Return whether two bodies are within a distance [m]."""
        return self._distance_m(name, other, distance_m) < distance_m

    def _distance_m(self, name: str, other: str, most_m: float) -> float:
        """Return the distance between two bodies, at most `most_m` [m]."""
        ones, others = (self.filters.geoms(self.numbers[body]) for body in (name, other))
        (centres, halves), (middles, sizes) = map(self._bound, (ones, others))
        apart_m = np.abs(centres[:, None] - middles) - halves[:, None] - sizes
        near = np.argwhere(np.linalg.norm(np.maximum(apart_m, 0.0), axis=2) < most_m)
        distances_m = (
            mujoco.mj_geomDistance(self.model, self.data, ones[row], others[column], most_m, None)
            for row, column in near.tolist()
        )
        return min(map(float, distances_m), default=most_m)

    def _bound(self, geoms: list[int]) -> tuple[Vector, Vector]:
        """Return centres and half sizes of the boxes about geometries [m], shape (geoms, 3)."""
        turns = self.data.geom_xmat[geoms].reshape(-1, 3, 3)
        boxes = self.model.geom_aabb[geoms]
        centres = self.data.geom_xpos[geoms] + np.einsum("ijk,ik->ij", turns, boxes[:, :3])
        return centres, np.einsum("ijk,ik->ij", np.abs(turns), boxes[:, 3:])

    def touches(self) -> list[Touch]:
        """Return the contacts of the last step."""
        if self._touches is None:
            self._touches = self._read_touches()
        return self._touches

    def _read_touches(self) -> list[Touch]:
        data, resting = self.data, self._resting
        # MuJoCo keeps the last contacts when all bodies sleep.
        if not (data.ncon and data.ntree_awake):
            return list(resting)
        contacts, force_n = data.contact, np.array(data.efc_force)
        rows: Vector = contacts.efc_address
        pressing = [n for n, row in enumerate(rows.tolist()) if row >= 0 and force_n[row] > 0.0]
        if not pressing:
            return list(resting)
        first_row = rows[pressing]
        frames = contacts.frame[pressing].reshape(-1, 3, 3)
        normal = force_n[first_row, np.newaxis] * frames[:, 0]
        # Rows of a contact: its normal force and, if it has friction, two friction forces and a
        # moment about the normal.
        rough = contacts.dim[pressing] > 1
        friction, cross_friction = (
            np.where(rough, force_n[first_row + axis * rough], 0.0)[:, np.newaxis] * frames[:, axis]
            for axis in (1, 2)
        )
        # The normal points from the first geometry to the second, which feels the force.
        felt_n, places = normal + friction + cross_friction, contacts.pos[pressing]
        labels = self.cell.labels
        names = zip(
            contacts.geom2[pressing].tolist(), contacts.geom1[pressing].tolist(), strict=True
        )
        return [
            *resting,
            *(
                Touch(labels[feels], labels[gives], places[n], frames[n, 0], size_n, felt_n[n])
                for n, ((feels, gives), size_n) in enumerate(
                    zip(names, force_n[first_row].tolist(), strict=True)
                )
            ),
        ]

    def points_on(self, name: str) -> list[Touch]:
        """Return the contacts of a body, as it feels them."""
        return [
            point if point.first == name else point.turned()
            for point in self.touches()
            if name in (point.first, point.second)
        ]

    def pulled_n(self, name: str, constraint: int) -> Vector:
        """Return the force of a constraint on its body, fixed to the robot [N], shape (3,)."""
        data, weld = self.data, mujoco.mjtConstraint.mjCNSTR_EQUALITY
        rows = [
            row
            for row in range(data.ne)
            if data.efc_type[row] == weld and data.efc_id[row] == constraint
        ]
        # Three forces on the bearing body, then three moments.
        return -np.array(data.efc_force[rows[:3]]) if rows else np.zeros(3)
