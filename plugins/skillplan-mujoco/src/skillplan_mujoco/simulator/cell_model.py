"""The model of a cell: an arm with its hand, a table, every body of a task, and bonds to spare.

It is compiled once. What a check has not in its world lies apart, without weight and touching
nothing; what is fixed to what, and what touches what, is set in the model between two checks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Joint
from skillplan.robots.hand import Hand
from skillplan.robots.link_shapes import Capsule, Hull, Rod
from skillplan.task.scene import Body, Robot
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan_pinocchio.kinematics.serial_arm import placement
from skillplan_pinocchio.simulation.arm.robot_outline import Block, Piece, body_pieces, jaw_pieces
from skillplan_pinocchio.simulation.mass_properties import mass_properties
from skillplan_pinocchio.simulation.simulator import (
    FINGERS,
    GRAVITY_M_PER_S2,
    HAND,
    LEAST_INERTIA_KG_M2,
    ROBOT,
    STEPS_PER_S,
    TABLE,
)

Vector = NDArray[np.float64]

# Of the model, beside what has a name in every engine.
TIP = "tip"

_TABLE_HALF_M = (1.5, 1.5, 0.05)
# What a hand weighs, of which no description says it: body and one jaw [kg].
_BODY_KG, _JAW_KG = 0.73, 0.05
# Friction of jaws: along [-], and against being turned about the normal [m]; that of others, and
# of what rolls [m].
_FINGER_FRICTION, _FINGER_TORSION_M = 1.0, 0.01
_TORSION_M, _ROLLING_M = 0.001, 0.0001
# The inertia of a jaw's drive, as mass at the jaw [kg].
_DRIVE_KG = 0.1
# How stiff contacts and bonds are, in the simulator's terms: time constant [s] and damping ratio,
# and the share of a force that is met, from where to where, over which depth [m]. Nothing that is
# faster than two steps is stable.
_STIFF = (2.0 / STEPS_PER_S, 1.0)
_SHARE, _BOND_SHARE = (0.95, 0.99, 0.0005, 0.5, 2.0), (0.99, 0.999, 0.0005, 0.5, 2.0)
# Friction holds by so much more firmly than contacts press, and its slip is taken back so often.
_FRICTION_RATIO, _NO_SLIP_STEPS, _SOLVER_STEPS = 20.0, 5, 100
# So many bodies can be fixed to others at once.
_BONDS = 24


def cell_spec(robot: Robot, hand: Hand, bodies: Sequence[Body], friction: float) -> Any:
    """Return what is compiled to the model of a cell.

    Parameters
    ----------
    robot, hand
        The arm, and what jaws it has.
    bodies
        All that can ever be in a world beside it, tools included.
    friction
        Of bodies and table [-].
    """
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = 1.0 / STEPS_PER_S
    option.gravity = (0.0, 0.0, -GRAVITY_M_PER_S2)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = _FRICTION_RATIO
    option.noslip_iterations = _NO_SLIP_STEPS
    option.iterations = _SOLVER_STEPS
    spec.compiler.balanceinertia = True
    spec.compiler.degree = False
    world = spec.worldbody
    table = world.add_body(name=TABLE, pos=(0.0, 0.0, -_TABLE_HALF_M[2]))
    _touch(table.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=_TABLE_HALF_M), friction)
    _add_arm(spec, robot, hand)
    for number, body in enumerate(bodies):
        _add_part(spec, body, number, friction)
    for number in range(_BONDS):
        bond = spec.add_equality(name=f"bond {number}", type=mujoco.mjtEq.mjEQ_WELD)
        bond.objtype = mujoco.mjtObj.mjOBJ_BODY
        bond.name1, bond.name2 = HAND, TABLE
        bond.active = False
        bond.solref, bond.solimp = _STIFF, _BOND_SHARE
    return spec


def _touch(geom: Any, friction: float, torsion_m: float = _TORSION_M) -> None:
    geom.friction = (friction, torsion_m, _ROLLING_M)
    geom.condim = 4
    geom.solref, geom.solimp = _STIFF, _SHARE


def joint_name(number: int) -> str:
    """Return what a joint of the arm is called, counted from 0 at the base."""
    return f"joint {number + 1}"


def _add_arm(spec: Any, robot: Robot, hand: Hand) -> None:
    model = robot.model
    here = spec.worldbody.add_body(
        name=ROBOT, pos=robot.base, quat=_wxyz(np.array(robot.mount.rotation))
    )
    # Where the arm is not in a world, it hangs without weight.
    here.gravcomp = 1.0
    shapes = model.shapes or [()] * (len(model.joints) + 1)
    for piece in shapes[0]:
        _add_piece(spec, here, piece)
    for number, joint in enumerate(model.joints):
        here = _add_link(here, number, joint)
        for piece in shapes[number + 1]:
            _add_piece(spec, here, piece)
    where = placement(model.tip) * placement(robot.tip)
    held = here.add_body(name=HAND, pos=where.translation, quat=_wxyz(where.rotation))
    size = (2 * hand.half_width_m, 2 * hand.half_length_m, hand.underside_m)
    _weigh(held, _BODY_KG, (0.0, 0.0, hand.underside_m / 2 - hand.tip_m), size)
    held.gravcomp = 1.0
    held.add_site(name=TIP)
    for part in body_pieces(hand):
        _add_piece(spec, held, part)
    _add_jaws(spec, held, hand)


def _add_link(before: Any, number: int, joint: Joint) -> Any:
    """Add a link and the joint that moves it; return it."""
    where = placement(joint.placement)
    link = before.add_body(
        name=f"link {number + 1}", pos=where.translation, quat=_wxyz(where.rotation)
    )
    link.gravcomp = 1.0
    if joint.link is not None:
        frame = placement(joint.link.frame)
        xx, yy, zz, xy, xz, yz = joint.link.tensor_kg_m2
        tensor = frame.rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        tensor = tensor @ frame.rotation.T
        link.explicitinertial = True
        link.mass = joint.link.mass_kg
        link.ipos = frame.act(np.array(joint.link.centre_m))
        link.fullinertia = (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])
    made = link.add_joint(name=joint_name(number), type=mujoco.mjtJoint.mjJNT_HINGE)
    made.axis = joint.axis
    made.range = (joint.low_rad, joint.high_rad)
    return link


def _add_jaws(spec: Any, held: Any, hand: Hand) -> None:
    """Add two jaws that move by one gear."""
    for side, name in zip((1, -1), FINGERS, strict=True):
        jaw = held.add_body(name=name)
        jaw.gravcomp = 1.0
        height_m, thick_m = hand.jaw_m[-1][0], hand.jaw_m[-1][3]
        size = (2 * hand.jaw_half_width_m, thick_m, height_m)
        _weigh(jaw, _JAW_KG, (0.0, side * thick_m / 2, -height_m / 2), size)
        slide = jaw.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE)
        slide.axis = (0.0, float(side), 0.0)
        slide.armature = _DRIVE_KG
        for piece in jaw_pieces(hand, side):
            _add_piece(spec, jaw, piece)
    gear = spec.add_equality(name="gear", type=mujoco.mjtEq.mjEQ_JOINT)
    gear.objtype = mujoco.mjtObj.mjOBJ_JOINT
    gear.name1, gear.name2 = FINGERS
    gear.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
    gear.solref, gear.solimp = _STIFF, _BOND_SHARE


def _weigh(body: Any, mass_kg: float, centre: Sequence[float], size: Sequence[float]) -> None:
    x, y, z = (extent**2 * mass_kg / 12 for extent in size)
    body.explicitinertial = True
    body.mass, body.ipos, body.inertia = mass_kg, centre, (y + z, x + z, x + y)


def _add_piece(spec: Any, body: Any, piece: Piece) -> None:
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
    _touch(geom, _FINGER_FRICTION, _FINGER_TORSION_M)


def _add_part(spec: Any, body: Body, number: int, friction: float) -> None:
    made = spec.worldbody.add_body(name=body.name, pos=parked(number))
    made.add_freejoint()
    properties = mass_properties(body).at_least(LEAST_INERTIA_KG_M2)
    made.explicitinertial = True
    made.mass, made.ipos = body.mass_kg, properties.centre
    made.inertia = properties.inertia_kg_m2
    made.gravcomp = 1.0
    for shape in body.shapes:
        _touch(_add_shape(spec, made, shape), friction)


def parked(number: int) -> tuple[float, float, float]:
    """Return where a body lies that is not there [m]."""
    return 5.0 + number, 8.0, 1.0


def _add_shape(spec: Any, body: Any, shape: Shape) -> Any:
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


def _wxyz(rotation: Vector) -> Vector:
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(rotation).ravel())
    return found
