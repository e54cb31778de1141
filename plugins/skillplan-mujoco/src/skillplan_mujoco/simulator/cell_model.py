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

from skillplan.physics.performance import FIELD_OF_VIEW_DEG, HEIGHT, WIDTH
from skillplan.robots.arm_description import Hand, Joint
from skillplan.task.scene import Body, Robot
from skillplan_mujoco.simulator.hand_model import add_hands
from skillplan_mujoco.simulator.shapes_model import BOND_SHARE, STIFF, add_piece, add_shape, touch
from skillplan_pinocchio.kinematics.serial_arm import placement
from skillplan_pinocchio.mass_properties import mass_properties
from skillplan_simulation.simulator import (
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
# Friction holds by so much more firmly than contacts press.
_FRICTION_RATIO, _SOLVER_STEPS = 20.0, 100
# So many bonds there are besides one for every body.
_MORE_BONDS = 8


def cell_spec(robot: Robot, hands: Sequence[Hand], bodies: Sequence[Body], friction: float) -> Any:
    """Return what is compiled to the model of a cell.

    Parameters
    ----------
    robot, hands
        The arm, and all hands that it can have.
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
    option.iterations = _SOLVER_STEPS
    spec.compiler.balanceinertia = True
    spec.compiler.degree = False
    _light(spec)
    world = spec.worldbody
    table = world.add_body(name=TABLE, pos=(0.0, 0.0, -_TABLE_HALF_M[2]))
    touch(table.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=_TABLE_HALF_M), friction)
    _add_arm(spec, robot, hands, friction)
    for number, body in enumerate(bodies):
        _add_part(spec, body, number, friction)
    for number in range(len(bodies) + _MORE_BONDS):
        bond = spec.add_equality(name=f"bond {number}", type=mujoco.mjtEq.mjEQ_WELD)
        bond.objtype = mujoco.mjtObj.mjOBJ_BODY
        bond.name1, bond.name2 = HAND, TABLE
        bond.active = False
        bond.solref, bond.solimp = STIFF, BOND_SHARE
    return spec


def _light(spec: Any) -> None:
    """Have pictures be as large as a view is made for, and lit from before the arm."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH, HEIGHT
    spec.visual.global_.fovy = FIELD_OF_VIEW_DEG
    spec.visual.map.znear, spec.visual.map.zfar = 0.002, 2.0
    spec.visual.headlight.ambient = (0.35, 0.35, 0.35)
    spec.visual.headlight.diffuse = (0.35, 0.35, 0.35)
    spec.visual.headlight.specular = (0.0, 0.0, 0.0)
    light = spec.worldbody.add_light(pos=(1.2, -1.0, 2.5), dir=(-0.35, 0.45, -1.0))
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.diffuse, light.specular = (0.5, 0.5, 0.5), (0.1, 0.1, 0.1)
    light.castshadow = False
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=(0.95, 0.96, 0.98),
        rgb2=(0.95, 0.96, 0.98),
        width=16,
        height=96,
    )


def joint_name(number: int) -> str:
    """Return what a joint of the arm is called, counted from 0 at the base."""
    return f"joint {number + 1}"


def _add_arm(spec: Any, robot: Robot, hands: Sequence[Hand], friction: float) -> None:
    model = robot.model
    here = spec.worldbody.add_body(
        name=ROBOT, pos=robot.base, quat=_wxyz(np.array(robot.mount.rotation))
    )
    # Where the arm is not in a world, it hangs without weight.
    here.gravcomp = 1.0
    shapes = model.shapes or [()] * (len(model.joints) + 1)
    for piece in shapes[0]:
        add_piece(spec, here, piece, friction)
    for number, joint in enumerate(model.joints):
        here = _add_link(here, number, joint)
        for piece in shapes[number + 1]:
            add_piece(spec, here, piece, friction)
    where = placement(model.tip) * placement(robot.tip)
    held = here.add_body(name=HAND, pos=where.translation, quat=_wxyz(where.rotation))
    held.add_site(name=TIP)
    add_hands(spec, held, hands, friction)


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


def _add_part(spec: Any, body: Body, number: int, friction: float) -> None:
    made = spec.worldbody.add_body(name=body.name, pos=parked(number))
    made.add_freejoint()
    properties = mass_properties(body).at_least(LEAST_INERTIA_KG_M2)
    made.explicitinertial = True
    made.mass, made.ipos = body.mass_kg, properties.centre
    made.inertia = properties.inertia_kg_m2
    made.gravcomp = 1.0
    for shape in body.shapes:
        touch(add_shape(spec, made, shape), friction)


def parked(number: int) -> tuple[float, float, float]:
    """Return where a body lies that is not there [m]."""
    return 5.0 + number, 8.0, 1.0


def _wxyz(rotation: Vector) -> Vector:
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(rotation).ravel())
    return found
