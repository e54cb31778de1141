"""Hands in the model of a cell: the shapes of all that an arm can have; those of one count.

Jaws of every hand slide along the same way, so that a hand that is taken up changes which shapes
touch, and what the hand weighs, and no joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from skillplan.robots.arm_description import Hand
from skillplan_mujoco.simulator.shapes_model import BOND_SHARE, STIFF, add_piece
from skillplan_simulation.arm.robot_outline import body_pieces, jaw_pieces
from skillplan_simulation.simulator import FINGERS, HAND

# What a hand weighs, of which no description says it: body and one jaw [kg].
_BODY_KG, _JAW_KG = 0.73, 0.05
# The inertia of a jaw's drive, as mass at the jaw [kg].
_DRIVE_KG = 0.1
_SIDES = (1, -1)


@dataclass(frozen=True, slots=True)
class SolidMass:
    """What a hand's body or a jaw weighs, as a box.

    Parameters
    ----------
    mass_kg
        How much [kg].
    centre_m
        Of its mass, from the tip [m].
    inertia_kg_m2
        Moments about the axes through the centre.
    """

    mass_kg: float
    centre_m: tuple[float, float, float]
    inertia_kg_m2: tuple[float, float, float]


def hand_masses(hand: Hand) -> dict[str, SolidMass]:
    """Return what a hand and its jaws weigh, by name."""
    size = (2 * hand.half_width_m, 2 * hand.half_length_m, hand.underside_m)
    found = {HAND: _box(_BODY_KG, (0.0, 0.0, hand.underside_m / 2 - hand.tip_m), size)}
    height_m, thick_m = hand.jaw_m[-1][0], hand.jaw_m[-1][3]
    size = (2 * hand.jaw_half_width_m, thick_m, height_m)
    for side, name in zip(_SIDES, FINGERS, strict=True):
        found[name] = _box(_JAW_KG, (0.0, side * thick_m / 2, -height_m / 2), size)
    return found


def _box(mass_kg: float, centre: tuple[float, float, float], size: Sequence[float]) -> SolidMass:
    x, y, z = (extent**2 * mass_kg / 12 for extent in size)
    return SolidMass(mass_kg, centre, (y + z, x + z, x + y))


def add_hands(spec: Any, held: Any, hands: Sequence[Hand], friction: float) -> None:
    """Add hands to the body at the tip of an arm, and jaws that move by one gear.

    Parameters
    ----------
    spec
        To be compiled.
    held
        Its body for the hand.
    hands
        All that there can be; the first counts at the start.
    friction
        Of what they touch [-].
    """
    masses = hand_masses(hands[0])
    _weigh(held, masses[HAND])
    held.gravcomp = 1.0
    for number, hand in enumerate(hands):
        for part in body_pieces(hand):
            _name(spec, add_piece(spec, held, part, friction), number)
    for side, name in zip(_SIDES, FINGERS, strict=True):
        jaw = held.add_body(name=name)
        jaw.gravcomp = 1.0
        _weigh(jaw, masses[name])
        slide = jaw.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE)
        slide.axis = (0.0, float(side), 0.0)
        slide.armature = _DRIVE_KG
        for number, hand in enumerate(hands):
            for piece in jaw_pieces(hand, side):
                _name(spec, add_piece(spec, jaw, piece, friction), number)
    gear = spec.add_equality(name="gear", type=mujoco.mjtEq.mjEQ_JOINT)
    gear.objtype = mujoco.mjtObj.mjOBJ_JOINT
    gear.name1, gear.name2 = FINGERS
    gear.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
    gear.solref, gear.solimp = STIFF, BOND_SHARE


def hand_number(geom: str) -> int:
    """Return of which hand a geometry is, by its name."""
    return int(geom.split()[1])


def _name(spec: Any, geom: Any, number: int) -> None:
    geom.name = f"hand {number} {len(spec.geoms)}"


def _weigh(body: Any, mass: SolidMass) -> None:
    body.explicitinertial = True
    body.mass, body.ipos = mass.mass_kg, np.array(mass.centre_m)
    body.inertia = np.array(mass.inertia_kg_m2)
