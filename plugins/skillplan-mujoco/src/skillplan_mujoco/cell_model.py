"""The MuJoCo model of a cell: arm, hands, table, all bodies of a task and spare bonds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Capsule, Hand, Hull, Joint, Rod
from skillplan.task.scene import Body, Robot, name_shank
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan_pinocchio.arm_model import assume_masses
from skillplan_pinocchio.kinematics.serial_arm import make_placement
from skillplan_pinocchio.mass_properties import compute_mass_properties
from skillplan_simulation.robot_shapes import Block, Piece, make_body_pieces, make_jaw_pieces
from skillplan_simulation.simulator import (
    CARRIER,
    CARRIER_KG,
    CARRIER_KG_M2,
    FINGERS,
    GRAVITY_M_PER_S2,
    HAND,
    ROBOT,
    STEPS_PER_S,
    TABLE,
)

# Torsional friction of the arm, per unit of lateral friction, and of other bodies [m]; rolling
# friction [m].
ARM_TORSION_M = 0.01
_TORSION_M, _ROLLING_M = 0.001, 0.0001
# A contact has a normal force, two friction forces and a moment about the normal.
FRICTIONAL = 4
# Number of sides of the prism for a cylinder; its edges lie 0.05 % of the radius outside.
_SIDES = 96
# Group of the geometries that touch the table for all pieces of a body, and number of pieces
# without one: each piece has up to four contacts, which take time and let a body creep.
FOOT_GROUP, _MOST_ON_TABLE = 5, 16
# Stiffness of contacts and bonds (MuJoCo's solref and solimp): time constant [s] and damping ratio;
# impedance range, depth [m] and shape. Time constants below two steps are unstable.
STIFF = (2.0 / STEPS_PER_S, 1.0)
_SHARE, BOND_SHARE = (0.95, 0.99, 0.0005, 0.5, 2.0), (0.99, 0.999, 0.0005, 0.5, 2.0)


def set_contact(geom: Any, friction: float, torsion_m: float = _TORSION_M) -> None:
    """Set the friction and stiffness of a geometry's contacts."""
    geom.friction = (friction, torsion_m, _ROLLING_M)
    geom.condim = FRICTIONAL
    geom.solref, geom.solimp = STIFF, _SHARE


def add_piece(spec: Any, body: Any, piece: Piece, friction: float) -> Any:
    """Add a piece of the arm to a body and return its geometry.

    Parameters
    ----------
    spec, body
        Model specification, and one of its bodies.
    friction
        Friction coefficient of bodies [-]. MuJoCo takes the larger of the two in a contact, so both
        need it.
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
    set_contact(geom, friction, ARM_TORSION_M * friction)
    return geom


def add_shape(spec: Any, body: Any, shape: Shape) -> Any:
    """Add a shape to a body of a task as the hull of its corners; return its geometry.

    A box is a hull, too: for two parallel boxes that press by less than 0.05 mm, MuJoCo's box
    routine sometimes finds a single point, far too deep. A cylinder becomes a prism, because exact
    cylinders touch at points that jump from end to end, and roll away.
    """
    name = f"hull {len(spec.meshes)}"
    spec.add_mesh(
        name=name, uservert=[value for corner in _iterate_corners(shape) for value in corner]
    )
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)


def _iterate_corners(shape: Shape) -> Iterator[Sequence[float]]:
    """Yield corners of a shape's hull [m]."""
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


# Assumed masses of a hand's body and of one jaw [kg]; no manufacturer publishes them.
_BODY_KG, _JAW_KG = 0.73, 0.05
# Inertia of a jaw's drive, as a mass at the jaw [kg].
_DRIVE_KG = 0.1
# Greatest way of a jaw from the middle [m].
_MOST_OPENING_M = 1.0
_JAW_SIDES = (1, -1)


@dataclass(frozen=True, slots=True)
class SolidMass:
    """Mass of a hand's body or a jaw, computed as for a box.

    Parameters
    ----------
    mass_kg
        Mass [kg].
    centre_m
        Centre of mass, from the tip [m].
    inertia_kg_m2
        Moments of inertia about the axes through the centre.
    """

    mass_kg: float
    centre_m: tuple[float, float, float]
    inertia_kg_m2: tuple[float, float, float]


def compute_hand_masses(hand: Hand) -> dict[str, SolidMass]:
    """Return the masses of a hand and its jaws by name."""
    size = (2 * hand.half_width_m, 2 * hand.half_length_m, hand.underside_m)
    masses = {
        HAND: _make_box_mass(_BODY_KG, (0.0, 0.0, hand.underside_m / 2 - hand.arm_tip_m), size)
    }
    height_m, thick_m = hand.jaw_m[-1][0], hand.jaw_m[-1][3]
    size = (2 * hand.jaw_half_width_m, thick_m, height_m)
    for side, name in zip(_JAW_SIDES, FINGERS, strict=True):
        masses[name] = _make_box_mass(
            _JAW_KG, (0.0, side * thick_m / 2, hand.beyond_m - height_m / 2), size
        )
    return masses


def _make_box_mass(
    mass_kg: float, centre: tuple[float, float, float], size: Sequence[float]
) -> SolidMass:
    x, y, z = (extent**2 * mass_kg / 12 for extent in size)
    return SolidMass(mass_kg, centre, (y + z, x + z, x + y))


def add_hands(spec: Any, held: Any, hands: Sequence[Hand], friction: float) -> None:
    """Add the hands to the body at the tip, with jaws coupled by a gear.

    Parameters
    ----------
    hands
        All hands that the arm can have; the first is active at the start.
    friction
        Friction coefficient of bodies [-].
    """
    masses = compute_hand_masses(hands[0])
    _weigh(held, masses[HAND])
    held.gravcomp = 1.0
    for number, hand in enumerate(hands):
        for part in make_body_pieces(hand):
            _name_geometry(spec, add_piece(spec, held, part, friction), number)
    for side, name in zip(_JAW_SIDES, FINGERS, strict=True):
        jaw = held.add_body(name=name)
        jaw.gravcomp = 1.0
        _weigh(jaw, masses[name])
        slide = jaw.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE)
        slide.axis = (0.0, float(side), 0.0)
        slide.armature = _DRIVE_KG
        # Closed jaws meet.
        slide.limited, slide.range = True, (0.0, _MOST_OPENING_M)
        slide.solref_limit, slide.solimp_limit = STIFF, BOND_SHARE
        for number, hand in enumerate(hands):
            for piece in make_jaw_pieces(hand, side):
                _name_geometry(spec, add_piece(spec, jaw, piece, friction), number)
    gear = spec.add_equality(name="gear", type=mujoco.mjtEq.mjEQ_JOINT)
    gear.objtype = mujoco.mjtObj.mjOBJ_JOINT
    gear.name1, gear.name2 = FINGERS
    gear.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
    gear.solref, gear.solimp = STIFF, BOND_SHARE


def parse_hand_number(geom: str) -> int:
    """Return the number of the hand that a geometry belongs to, from its name."""
    return int(geom.split()[1])


def _name_geometry(spec: Any, geom: Any, number: int) -> None:
    geom.name = f"hand {number} {len(spec.geoms)}"


def _weigh(body: Any, mass: SolidMass) -> None:
    body.explicitinertial = True
    body.mass, body.ipos = mass.mass_kg, np.array(mass.centre_m)
    body.inertia = np.array(mass.inertia_kg_m2)


Vector = NDArray[np.float64]

TIP = "tip"

# Least half width of the table, its width beyond the places of bodies, and half its thickness [m].
_TABLE_M, _AROUND_M, _THICK_M = 1.5, 0.3, 0.05
# Ratio of frictional to normal impedance, and iterations of the solver.
_FRICTION_RATIO, _SOLVER_STEPS = 20.0, 100
# Iterations and tolerance [-] of the solver's line searches. With MuJoCo's 50 and 0.01 a search
# sometimes fails with contacts that are new, and light bodies keep the forces of the step before.
_SEARCH_STEPS, _SEARCH_TOLERANCE = 200, 1e-4
# Speed below which bodies that touch nothing awake sleep: they neither move nor have contacts until
# something touches them [m/s]. Hundreds of contacts of bodies at rest took most of the time.
_ASLEEP_M_PER_S = 1e-4
# Number of bonds in addition to one per body.
_MORE_BONDS = 8
LEAST_KG = 2e-4
"""Mass of lighter parts [kg]: the solver loses their contacts beside the masses of an arm."""
# Memory of a model: parts of hundreds of pieces have thousands of contacts. Only used pages count.
_MEMORY_BYTES = 512 * 2**20


def build_cell_spec(
    robot: Robot,
    hands: Sequence[Hand],
    bodies: Sequence[Body],
    friction: float,
    *,
    holds: bool = False,
) -> Any:
    """Return the specification from which the model of a cell is compiled.

    Parameters
    ----------
    robot, hands
        The arm and all hands that it can have.
    bodies
        All bodies that a world can ever hold, tools included.
    friction
        Friction coefficient of bodies and table [-].
    holds
        True if workholders or holders hold bodies: each may be fixed to others, held and carried.
    """
    spec = mujoco.MjSpec()
    spec.memory = _MEMORY_BYTES
    option = spec.option
    option.timestep = 1.0 / STEPS_PER_S
    option.gravity = (0.0, 0.0, -GRAVITY_M_PER_S2)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = _FRICTION_RATIO
    option.iterations = _SOLVER_STEPS
    option.ls_iterations, option.ls_tolerance = _SEARCH_STEPS, _SEARCH_TOLERANCE
    option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    option.sleep_tolerance = _ASLEEP_M_PER_S
    spec.compiler.balanceinertia = True
    spec.compiler.degree = False
    world = spec.worldbody
    table = world.add_body(name=TABLE, pos=(0.0, 0.0, -_THICK_M))
    places = (item.pose.position for body in bodies for item in body.placements)
    farthest_m = max((abs(value) for x, y, _ in places for value in (x, y)), default=0.0)
    half_m = max(_TABLE_M, farthest_m + _AROUND_M)
    size_m = (half_m, half_m, _THICK_M)
    set_contact(table.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size_m), friction)
    _add_arm(spec, robot, hands, friction)
    for number, body in enumerate(bodies):
        _add_part(spec, body, number, friction)
    if holds:
        _add_carrier(spec, len(bodies))
    for number in range((3 if holds else 1) * len(bodies) + _MORE_BONDS):
        bond = spec.add_equality(name=f"bond {number}", type=mujoco.mjtEq.mjEQ_WELD)
        bond.objtype = mujoco.mjtObj.mjOBJ_BODY
        bond.name1, bond.name2 = HAND, TABLE
        bond.active = False
        bond.solref, bond.solimp = STIFF, BOND_SHARE
    return spec


def format_joint_name(number: int) -> str:
    """Return the name of a joint of the arm, counted from 0 at the base."""
    return f"joint {number + 1}"


def _add_arm(spec: Any, robot: Robot, hands: Sequence[Hand], friction: float) -> None:
    model = assume_masses(robot.model)
    here = spec.worldbody.add_body(
        name=ROBOT, pos=robot.base, quat=_convert_rotation(np.array(robot.mount.rotation))
    )
    # In a world without the arm, it hangs weightless.
    here.gravcomp = 1.0
    shapes = model.shapes or [()] * (len(model.joints) + 1)
    for piece in shapes[0]:
        add_piece(spec, here, piece, friction)
    for number, joint in enumerate(model.joints):
        here = _add_link(here, number, joint)
        for piece in shapes[number + 1]:
            add_piece(spec, here, piece, friction)
    where = make_placement(model.tip) * make_placement(robot.tip)
    held = here.add_body(name=HAND, pos=where.translation, quat=_convert_rotation(where.rotation))
    held.add_site(name=TIP)
    add_hands(spec, held, hands, friction)


def _add_link(before: Any, number: int, joint: Joint) -> Any:
    """Add a link and its joint; return the link."""
    where = make_placement(joint.placement)
    link = before.add_body(
        name=f"link {number + 1}", pos=where.translation, quat=_convert_rotation(where.rotation)
    )
    link.gravcomp = 1.0
    if joint.link is not None:
        frame = make_placement(joint.link.frame)
        xx, yy, zz, xy, xz, yz = joint.link.tensor_kg_m2
        tensor = frame.rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        tensor = tensor @ frame.rotation.T
        link.explicitinertial = True
        link.mass = joint.link.mass_kg
        link.ipos = frame.act(np.array(joint.link.centre_m))
        link.fullinertia = (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])
    kinds = mujoco.mjtJoint
    kind = kinds.mjJNT_SLIDE if joint.is_prismatic else kinds.mjJNT_HINGE
    moving = link.add_joint(name=format_joint_name(number), type=kind)
    moving.axis = joint.axis
    moving.range = (joint.low_rad, joint.high_rad)
    return link


def _add_part(spec: Any, body: Body, number: int, friction: float) -> None:
    if body.fixed:
        pose = body.placements[0].pose
        x, y, z, w = pose.orientation
        still = spec.worldbody.add_body(name=body.name, pos=pose.position, quat=(w, x, y, z))
        for shape in body.shapes:
            set_contact(add_shape(spec, still, shape), friction)
        return
    if body.mass_kg < LEAST_KG:
        body = replace(body, mass_kg=LEAST_KG)
    part = spec.worldbody.add_body(name=body.name, pos=get_parking_position(number))
    part.add_freejoint()
    # MuJoCo refuses smaller moments of inertia.
    properties = compute_mass_properties(body).at_least(mujoco.mjMINVAL)
    part.explicitinertial = True
    part.mass, part.ipos = body.mass_kg, properties.centre
    part.inertia = properties.inertia_kg_m2
    part.gravcomp = 1.0
    for shape in body.shapes:
        set_contact(add_shape(spec, part, shape), friction)
    if len(body.shapes) > _MOST_ON_TABLE:
        _add_foot(spec, part, body, friction)
    if body.shank is not None:
        # A body of its own passes through others than the head does.
        shank = part.add_body(name=name_shank(body.name))
        geom = add_shape(spec, shank, body.shank.shape)
        set_contact(geom, friction)
        geom.mass = 0.0


def _add_carrier(spec: Any, number: int) -> None:
    """Add a body without shapes that moves others about."""
    carrier = spec.worldbody.add_body(name=CARRIER, pos=get_parking_position(number))
    carrier.add_freejoint()
    carrier.explicitinertial = True
    carrier.mass, carrier.inertia = CARRIER_KG, (CARRIER_KG_M2,) * 3
    carrier.ipos = (0.0, 0.0, 0.0)
    carrier.gravcomp = 1.0


def _add_foot(spec: Any, part: Any, body: Body, friction: float) -> None:
    """Add the hull of a body, which alone touches the table: a plane meets nothing else of it."""
    name = f"hull {len(spec.meshes)}"
    corners_m = np.array([corner for shape in body.shapes for corner in _iterate_corners(shape)])
    spec.add_mesh(name=name, uservert=np.unique(corners_m, axis=0).ravel().tolist())
    foot = part.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
    foot.group = FOOT_GROUP
    set_contact(foot, friction)


def get_parking_position(number: int) -> tuple[float, float, float]:
    """Return the position of a body that is not in the world [m]."""
    return 5.0 + number, 8.0, 1.0


def _convert_rotation(rotation: Vector) -> Vector:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion
