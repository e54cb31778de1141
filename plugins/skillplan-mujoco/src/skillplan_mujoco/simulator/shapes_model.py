"""Shapes of the model of a cell: how they look to contacts, and how firm these are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import mujoco
import numpy as np

from skillplan.robots.arm_description import Capsule, Hull, Rod
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan_simulation.arm.robot_outline import Block, Piece
from skillplan_simulation.simulator import STEPS_PER_S

# What points of contact resist being turned about the normal, by their force [m]: of the arm, by
# friction as well, and of others; and what they resist being rolled [m].
ARM_TORSION_M = 0.01
_TORSION_M, _ROLLING_M = 0.001, 0.0001
# A contact is a normal force, two of friction, and a moment about the normal.
FRICTIONAL = 4
# A cylinder has so many sides; its edges are 0.05 % of its radius outside.
_SIDES = 96
# How stiff contacts and bonds are, in the simulator's terms: time constant [s] and damping ratio,
# and the share of a force that is met, from where to where, over which depth [m]. Nothing that is
# faster than two steps is stable.
STIFF = (2.0 / STEPS_PER_S, 1.0)
_SHARE, BOND_SHARE = (0.95, 0.99, 0.0005, 0.5, 2.0), (0.99, 0.999, 0.0005, 0.5, 2.0)


def touch(geom: Any, friction: float, torsion_m: float = _TORSION_M) -> None:
    """Say what contacts of a geometry are like."""
    geom.friction = (friction, torsion_m, _ROLLING_M)
    geom.condim = FRICTIONAL
    geom.solref, geom.solimp = STIFF, _SHARE


def add_piece(spec: Any, body: Any, piece: Piece, friction: float) -> Any:
    """Add a piece of the arm to a body; return its geometry.

    Parameters
    ----------
    spec, body
        To be compiled, and what of it.
    piece
        Of the arm.
    friction
        Of what it touches [-]: of two, the greater counts, so that both have to have it.
    """
    kinds = mujoco.mjtGeom
    if isinstance(piece, Hull):
        name = f"hull {len(spec.meshes)}"
        spec.add_mesh(name=name, uservert=np.array(piece.corners_m).ravel().tolist())
        geom = body.add_geom(type=kinds.mjGEOM_MESH, meshname=name)
    elif isinstance(piece, Block):
        low, high = np.array(piece.low_m), np.array(piece.high_m)
        geom = body.add_geom(type=kinds.mjGEOM_BOX, size=(high - low) / 2, pos=(low + high) / 2)
    elif piece.start_m == piece.end_m:
        size = (piece.radius_m, 0.0, 0.0)
        geom = body.add_geom(type=kinds.mjGEOM_SPHERE, size=size, pos=piece.start_m)
    else:
        assert isinstance(piece, Capsule | Rod)
        kind = kinds.mjGEOM_CYLINDER if isinstance(piece, Rod) else kinds.mjGEOM_CAPSULE
        geom = body.add_geom(type=kind, size=(piece.radius_m, 0.0, 0.0))
        geom.fromto = (*piece.start_m, *piece.end_m)
    touch(geom, friction, ARM_TORSION_M * friction)
    return geom


def add_shape(spec: Any, body: Any, shape: Shape) -> Any:
    """Add a shape to a body of a task, as the hull of its corners; return its geometry.

    A box is one, too: of two boxes with parallel axes that press on each other by less than
    0.05 mm, the simulator's own routine finds a single point now and then, and far too deep. A
    cylinder is a prism, whose sides are as far from its axis as its own: exact ones touch by points
    that jump from end to end, and roll away.
    """
    name = f"hull {len(spec.meshes)}"
    spec.add_mesh(name=name, uservert=[value for corner in _corners(shape) for value in corner])
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)


def _corners(shape: Shape) -> Iterator[Sequence[float]]:
    """Yield corners about a shape [m]."""
    if not isinstance(shape, Box | Cylinder):
        yield from shape.corners
        return
    x_m, y_m, z_m = shape.centre
    if isinstance(shape, Box):
        width_m, length_m, height_m = shape.size
        ends = list(product((-width_m / 2, width_m / 2), (-length_m / 2, length_m / 2)))
    else:
        height_m, half = shape.height_m, math.pi / _SIDES
        radius_m = shape.diameter_m / 2 / math.cos(half)
        turns = [(2 * side + 1) * half for side in range(_SIDES)]
        ends = [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
    for across_m, along_m in ends:
        for up_m in (-height_m / 2, height_m / 2):
            yield x_m + across_m, y_m + along_m, z_m + up_m
