"""Shapes of the model of a cell: how they look to contacts, and how firm these are."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from skillplan.robots.link_shapes import Capsule, Hull, Rod
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan_pinocchio.simulation.arm.robot_outline import Block, Piece
from skillplan_pinocchio.simulation.simulator import STEPS_PER_S

# Friction of jaws: along [-], and against being turned about the normal [m]; that of others, and
# of what rolls [m].
_FINGER_FRICTION, _FINGER_TORSION_M = 1.0, 0.01
_TORSION_M, _ROLLING_M = 0.001, 0.0001
# How stiff contacts and bonds are, in the simulator's terms: time constant [s] and damping ratio,
# and the share of a force that is met, from where to where, over which depth [m]. Nothing that is
# faster than two steps is stable.
STIFF = (2.0 / STEPS_PER_S, 1.0)
_SHARE, BOND_SHARE = (0.95, 0.99, 0.0005, 0.5, 2.0), (0.99, 0.999, 0.0005, 0.5, 2.0)


def touch(geom: Any, friction: float, torsion_m: float = _TORSION_M) -> None:
    """Say what contacts of a geometry are like."""
    geom.friction = (friction, torsion_m, _ROLLING_M)
    geom.condim = 4
    geom.solref, geom.solimp = STIFF, _SHARE


def add_piece(spec: Any, body: Any, piece: Piece) -> Any:
    """Add a piece of the arm to a body; return its geometry."""
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
    touch(geom, _FINGER_FRICTION, _FINGER_TORSION_M)
    return geom


def add_shape(spec: Any, body: Any, shape: Shape) -> Any:
    """Add a shape to a body of a task; return its geometry. Of a mesh that is its hull."""
    kinds = mujoco.mjtGeom
    if isinstance(shape, Box):
        half = [extent / 2 for extent in shape.size]
        return body.add_geom(type=kinds.mjGEOM_BOX, size=half, pos=shape.centre)
    if isinstance(shape, Cylinder):
        size = (shape.diameter_m / 2, shape.height_m / 2, 0.0)
        return body.add_geom(type=kinds.mjGEOM_CYLINDER, size=size, pos=shape.centre)
    name = f"hull {len(spec.meshes)}"
    spec.add_mesh(name=name, uservert=np.array(shape.corners).ravel().tolist())
    return body.add_geom(type=kinds.mjGEOM_MESH, meshname=name)
