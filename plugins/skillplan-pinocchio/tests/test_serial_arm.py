"""Models of described arms: against sums over the description, and against public models."""

import math
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, distribution

import numpy as np
import pinocchio as pin
import pytest

from serial_arms import random_arm, ur_arm
from skillplan.robots import PANDA, PANDA_HAND, UR5E, Transform
from skillplan_pinocchio import ArmModel, SerialArm

BASE = Transform((0.3, -0.2, 0.5), (0.1, -0.4, 1.2))
TOOL = Transform((0.01, 0.02, 0.13), (0.0, 0.2, -0.7))
ARMS = [PANDA, UR5E, random_arm(6, 1), random_arm(7, 2)]
GRAVITY_M_PER_S2 = 9.81


def postures(arm, count, seed=1):
    """Return joint angles within the limits, drawn evenly."""
    rng = np.random.default_rng(seed)
    return rng.uniform(arm.low_rad, arm.high_rad, (count, len(arm.joints)))


def frame(transform):
    """Return a transform as matrix, by pinocchio's own roll, pitch and yaw."""
    matrix = np.eye(4)
    matrix[:3, :3] = pin.rpy.rpyToMatrix(*transform.rpy_rad)
    matrix[:3, 3] = transform.xyz_m
    return matrix


def link_frames(arm, angles, base=Transform()):
    """Return the frames of the joints, by products of matrices."""
    here, results = frame(base), []
    for joint, angle in zip(arm.joints, angles, strict=True):
        turn = np.eye(4)
        turn[:3, :3] = pin.exp3(angle * np.array(joint.axis))
        here = here @ frame(joint.placement) @ turn
        results.append(here)
    return results


def masses(arm, angles):
    """Return mass, centre of mass, rotation and inertia of every link, in the world."""
    results = []
    for joint, here in zip(arm.joints, link_frames(arm, angles), strict=True):
        there = here @ frame(joint.link.frame)
        xx, yy, zz, xy, xz, yz = joint.link.tensor_kg_m2
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        centre = (there @ np.array([*joint.link.centre_m, 1.0]))[:3]
        results.append((joint.link.mass_kg, centre, there[:3, :3], tensor))
    return results


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_the_tip_is_where_the_product_of_all_transforms_puts_it(arm):
    """With base and tool, to a picometre."""
    mounted = SerialArm(arm, BASE, TOOL)
    for angles in postures(arm, 20):
        expected = link_frames(arm, angles, BASE)[-1] @ frame(arm.tip) @ frame(TOOL)
        assert np.abs(mounted.tip(angles).homogeneous - expected).max() < 1e-12


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_the_jacobian_is_the_derivative_of_the_tip(arm):
    """By differences."""
    mounted = SerialArm(arm, BASE, TOOL)
    angles = postures(arm, 1)[0]
    here = mounted.tip(angles)
    _, jacobian = mounted.error(angles, here)
    for number in range(len(arm.joints)):
        moved = angles.copy()
        moved[number] += 1e-6
        step = pin.log6(here.actInv(mounted.tip(moved))).vector / 1e-6
        assert step == pytest.approx(jacobian[:, number], abs=1e-5)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_the_error_is_the_motion_that_leads_to_the_pose(arm):
    """Also after other questions."""
    mounted = SerialArm(arm, BASE, TOOL)
    first, other = postures(arm, 2)
    target = mounted.tip(first)
    twist, _ = mounted.error(other, target)
    reached = mounted.tip(other) * pin.exp6(twist)
    assert np.abs(reached.homogeneous - target.homogeneous).max() < 1e-12


@pytest.mark.parametrize("arm", [PANDA, UR5E], ids=lambda arm: arm.name)
def test_gravity_pulls_at_the_masses_of_the_description(arm):
    """Torques at rest are derivatives of the sum of weights times heights."""
    mounted = SerialArm(arm)

    def energy_j(angles):
        return sum(
            GRAVITY_M_PER_S2 * mass * centre[2] for mass, centre, _, _ in masses(arm, angles)
        )

    data = mounted.model.createData()
    for angles in postures(arm, 3):
        torques = pin.computeGeneralizedGravity(mounted.model, data, angles)
        for number, step in enumerate(1e-5 * np.eye(len(angles))):
            slope = (energy_j(angles + step) - energy_j(angles - step)) / 2e-5
            assert torques[number] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("arm", [PANDA, UR5E], ids=lambda arm: arm.name)
def test_its_motion_has_the_energy_of_the_description_s_links(arm):
    """Half of mass times speed squared, and the same of the turning."""
    mounted = SerialArm(arm)
    data = mounted.model.createData()
    angles, speeds = postures(arm, 2)
    step = 1e-5
    energy_j = 0.0
    before, now, after = (masses(arm, angles + sign * step * speeds) for sign in (-1, 0, 1))
    for (mass, _, _, tensor), (_, low, turned, _), (_, high, turning, _) in zip(
        now, before, after, strict=True
    ):
        speed = (high - low) / (2 * step)
        spin = pin.log3(turned.T @ turning) / (2 * step)
        energy_j += (mass * speed @ speed + spin @ tensor @ spin) / 2
    assert pin.computeKineticEnergy(mounted.model, data, angles, speeds) == pytest.approx(
        energy_j, rel=1e-6
    )


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_the_limits_are_those_of_the_description(arm):
    """Positions, speeds and torques."""
    model = SerialArm(arm).model
    assert tuple(model.lowerPositionLimit) == arm.low_rad
    assert tuple(model.upperPositionLimit) == arm.high_rad
    assert tuple(model.velocityLimit) == arm.speed_rad_per_s
    assert tuple(model.effortLimit) == arm.torque_nm


def test_the_panda_with_its_hand_is_the_arm_of_the_detector():
    """To the bit."""
    base = (0.4, -0.2, 0.1)
    first, other = ArmModel(base), SerialArm(PANDA, Transform(base), PANDA_HAND.tip_on_flange)
    for angles in postures(PANDA, 20):
        position, rotation = first.tip(angles)
        assert np.array_equal(position, other.tip(angles).translation)
        assert np.array_equal(rotation, other.tip(angles).rotation)


# The nominal geometry in the form of the maker's ROS description: joints in the frames before.
UR5E_ROS = (
    Transform((0.0, 0.0, 0.1625)),
    Transform((0.0, 0.0, 0.0), (math.pi / 2, 0.0, 0.0)),
    Transform((-0.425, 0.0, 0.0)),
    Transform((-0.3922, 0.0, 0.1333)),
    Transform((0.0, -0.0997, 0.0), (math.pi / 2, 0.0, 0.0)),
    Transform((0.0, 0.0996, 0.0), (math.pi / 2, math.pi, math.pi)),
)


def test_the_ur5e_is_where_the_other_published_form_of_its_kinematics_puts_it():
    """A nanometre, over 1,000 postures."""
    joints = tuple(
        replace(joint, placement=place) for joint, place in zip(UR5E.joints, UR5E_ROS, strict=True)
    )
    first, other = SerialArm(UR5E), SerialArm(replace(UR5E, joints=joints, tip=Transform()))
    for angles in postures(UR5E, 1000):
        away = first.tip(angles).homogeneous - other.tip(angles).homogeneous
        assert np.abs(away).max() < 1e-9


def public_model(path):
    """Return a model of the wheel example-robot-data, if that is installed."""
    try:
        installed = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("the wheel example-robot-data, with models to compare with, is not installed")
    folder = "cmeel.prefix/share/example-robot-data/robots"
    return pin.buildModelFromUrdf(str(installed.locate_file(f"{folder}/{path}")))


# Arms of the family by the maker's parameters, and what the wheel calls them: it has no UR5e.
FAMILY = {
    "ur3": (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "ur5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
}


@pytest.mark.parametrize("name", FAMILY)
def test_arms_of_the_ur_family_are_where_a_public_model_puts_them(name):
    """A tenth of a millimetre over 1,000 postures, from the same base."""
    other = public_model(f"ur_description/urdf/{name}_robot.urdf")
    data = other.createData()
    base, flange = other.getFrameId("base"), other.getFrameId("tool0")
    arm = SerialArm(ur_arm(name, FAMILY[name]))
    for angles in postures(arm.description, 1000):
        pin.framesForwardKinematics(other, data, angles)
        there = data.oMf[base].actInv(data.oMf[flange])
        assert np.linalg.norm(arm.tip(angles).translation - there.translation) < 1e-4
        assert np.linalg.norm(pin.log3(arm.tip(angles).rotation.T @ there.rotation)) < 1e-4


def test_the_panda_is_where_a_public_model_puts_it():
    """A tenth of a millimetre over 1,000 postures."""
    other = public_model("panda_description/urdf/panda.urdf")
    data = other.createData()
    flange = other.getFrameId("panda_link8")
    arm = SerialArm(PANDA)
    for angles in postures(PANDA, 1000):
        pin.framesForwardKinematics(other, data, np.concatenate([angles, np.zeros(other.nq - 7)]))
        assert np.linalg.norm(arm.tip(angles).translation - data.oMf[flange].translation) < 1e-4
