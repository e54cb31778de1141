"""A compiled cell. Every world resets the fields that the previous one changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from skillplan.robots.arm_description import Hand
from skillplan_mujoco.cell_model import compute_hand_masses, parse_hand_number
from skillplan_simulation.simulator import FINGERS, GRAVITY_M_PER_S2, HAND, ROBOT, STEP_S

# Fields of a model that worlds change: contact masks, bonds and masses.
_CHANGED = (
    "geom_contype",
    "geom_conaffinity",
    "geom_condim",
    "geom_priority",
    "body_contype",
    "body_conaffinity",
    "eq_obj1id",
    "eq_obj2id",
    "eq_data",
    "body_gravcomp",
    "body_mass",
    "body_inertia",
    "body_ipos",
    "body_subtreemass",
    "body_invweight0",
    "dof_invweight0",
)

# Mass below which contacts of a body are as stiff as with it [kg]. MuJoCo's contacts yield by force
# over mass: jaws of 27 N would sink 14 mm into a gram.
_STIFF_KG = 0.05

# Thickness of a body into whose middle another one falls, if both lose their contacts for a step
# [m]. MuJoCo then pushes them aside rather than up.
_THIN_M = 4 * GRAVITY_M_PER_S2 * STEP_S**2

# Change of the solver's cost at which it ends, a mass times squared acceleration [kg m2/s4]. MuJoCo
# compares with its tolerance times the mean inertia of a model and its degrees of freedom: with an
# arm in it, parts of grams and plates on hundreds of contacts got the wrong forces, and jumped.
_SOLVED_KG_M2_PER_S4 = 1e-12


class Cell:
    """A compiled model and the names of its bodies.

    Parameters
    ----------
    hands
        All hands that the arm can have, in the order of the model.
    friction
        Coefficient of lateral friction of bodies and table [-].
    """

    def __init__(self, model: Any, hands: Sequence[Hand], friction: float) -> None:
        self.model, self.hands, self.friction = model, tuple(hands), friction
        model.opt.tolerance = _SOLVED_KG_M2_PER_S4 / (model.stat.meaninertia * model.nv)
        self._data = mujoco.MjData(model)
        self._coordinates: dict[str, tuple[slice, slice]] = {}
        self._weights = np.array(model.body_invweight0)
        self._masses = np.array(model.body_mass)
        for number in np.flatnonzero(self._weights[:, 0] > 0).tolist():
            self._set_stiffness(number)
        self._own = {name: np.array(getattr(model, name)) for name in _CHANGED}
        self._boxes = np.array(model.bvh_aabb)
        self.ids: dict[str, int] = {
            model.body(number).name: number for number in range(model.nbody)
        }
        root = self.ids[ROBOT]
        self._arm = [number for number in self.ids.values() if model.body_rootid[number] == root]
        # Name of the task's body, or of the arm, by number of the model's body.
        self.owners = {number: name for name, number in self.ids.items()}
        self.owners |= dict.fromkeys(self._arm, ROBOT)
        handling = {self.ids[name]: name for name in (HAND, *FINGERS)}
        # Owner of every geometry; hand and fingers have names of their own.
        known = self.owners | handling
        self.labels: list[str] = [known[body] for body in model.geom_bodyid.tolist()]
        # Thin bodies that move, by the numbers of their trees.
        self.thin = [
            int(model.body_treeid[number])
            for number in self.ids.values()
            if number not in self._arm
            and model.body_treeid[number] >= 0
            and model.body_bvhnum[number]
            and 2 * model.bvh_aabb[model.body_bvhadr[number], 3:].min() < _THIN_M
        ]
        weld = mujoco.mjtEq.mjEQ_WELD
        self.bonds = [number for number in range(model.neq) if model.eq_type[number] == weld]

    def start(self) -> Any:
        """Reset all changed fields and return the simulator's initial state."""
        for name, values in self._own.items():
            getattr(self.model, name)[:] = values
        mujoco.mj_resetData(self.model, self._data)
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)
        return self._data

    def weigh_arm(self) -> None:
        """Give the links of the arm their weight."""
        self.model.body_gravcomp[self._arm] = 0.0

    def fit(self, hand: Hand) -> list[int]:
        """Give the hand the masses of one of its variants; return the geometries of the others."""
        for name, mass in compute_hand_masses(hand).items():
            number = self.ids[name]
            self.model.body_mass[number] = mass.mass_kg
            self.model.body_ipos[number] = mass.centre_m
            self.model.body_inertia[number] = mass.inertia_kg_m2
            self._move_boxes(number)
        own = self.hands.index(hand)
        return [
            geom
            for name in (HAND, *FINGERS)
            for geom in self._geoms(name)
            if parse_hand_number(self.model.geom(geom).name) != own
        ]

    def _move_boxes(self, number: int) -> None:
        """Keep the boxes that find contacts in place; MuJoCo stores them about mass centres."""
        first = int(self.model.body_bvhadr[number])
        boxes = slice(first, first + int(self.model.body_bvhnum[number]))
        moved = self.model.body_ipos[number] - self._own["body_ipos"][number]
        self.model.bvh_aabb[boxes, :3] = self._boxes[boxes, :3] - moved

    def _geoms(self, name: str) -> range:
        """Return the numbers of the geometries of a body."""
        first = int(self.model.body_geomadr[self.ids[name]])
        return range(first, first + int(self.model.body_geomnum[self.ids[name]]))

    def is_still(self, name: str) -> bool:
        """Return whether a body is a part of the world that has no coordinates."""
        return int(self.model.body_jntnum[self.ids[name]]) == 0

    def coordinates(self, name: str) -> tuple[slice, slice]:
        """Return the slices of a moving body's coordinates and speeds in the state."""
        if name in self._coordinates:
            return self._coordinates[name]
        joint = self.model.body_jntadr[self.ids[name]]
        place, speed = int(self.model.jnt_qposadr[joint]), int(self.model.jnt_dofadr[joint])
        slices = self._coordinates[name] = slice(place, place + 7), slice(speed, speed + 6)
        return slices

    def scale_mass(self, name: str, factor: float) -> None:
        """Multiply the mass of a body by a factor; its distribution stays."""
        number, (_, speeds) = self.ids[name], self.coordinates(name)
        for values in (self.model.body_mass, self.model.body_inertia, self.model.body_subtreemass):
            values[number] *= factor
        self._set_stiffness(number)
        self.model.dof_invweight0[speeds] /= factor

    def _set_stiffness(self, number: int) -> None:
        """Set the inverse masses by which contacts and bonds of a body yield."""
        mass_kg = float(self.model.body_mass[number])
        if mass_kg > 0:
            weights = self._weights[number] * self._masses[number] / mass_kg
            self.model.body_invweight0[number] = weights * min(1.0, 1 / (_STIFF_KG * weights[0]))
