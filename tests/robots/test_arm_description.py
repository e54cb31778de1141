"""What is held of an arm, what is refused, and the arms that there are."""

import math
from dataclasses import FrozenInstanceError, replace

import pytest

from skillplan.robots import PANDA, UR5E, Joint, LinkInertia, Transform

LINK = LinkInertia(2.0, (0.0, 0.0, 0.1), (0.02, 0.03, 0.04, 0.001, 0.002, 0.003))
JOINT = Joint("elbow", Transform((0.1, 0.0, 0.2)), -2.0, 1.0, 3.0, 5.0, 80.0, LINK)
ARMS = (PANDA, UR5E)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"xyz_m": (0.0, math.nan, 0.0)}, "xyz_m must be 3 finite numbers"),
        ({"xyz_m": (0.0, 1.0)}, "xyz_m must be 3 finite numbers"),
        ({"rpy_rad": (math.inf, 0.0, 0.0)}, "rpy_rad must be 3 finite numbers"),
    ],
)
def test_a_transform_is_of_finite_numbers(change, words):
    """Three each."""
    with pytest.raises(ValueError, match=words):
        Transform(**change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mass_kg": 0.0}, "mass_kg must be > 0, not 0.0"),
        ({"mass_kg": math.nan}, "mass_kg must be > 0"),
        ({"centre_m": (0.0, math.inf, 0.0)}, "centre_m must be 3 finite numbers"),
        ({"tensor_kg_m2": (0.1, 0.1, 0.1)}, "tensor_kg_m2 must be 6 finite numbers"),
        ({"tensor_kg_m2": (-0.1, 0.1, 0.1, 0.0, 0.0, 0.0)}, "No body has the inertia"),
        # One moment is greater than the sum of the two others.
        ({"tensor_kg_m2": (0.1, 0.1, 0.3, 0.0, 0.0, 0.0)}, "No body has the inertia"),
        ({"tensor_kg_m2": (0.1, 0.1, 0.1, 0.0, 0.2, 0.0)}, "No body has the inertia"),
    ],
)
def test_a_link_is_one_that_a_rigid_body_can_be(change, words):
    """Mass above zero, moments that fit together."""
    with pytest.raises(ValueError, match=words):
        replace(LINK, **change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": ""}, "Joint must have a name"),
        ({"axis": (0.0, 1.0, 1.0)}, "elbow: axis must be of length 1"),
        ({"axis": (0.0, 0.0, math.nan)}, "elbow: axis must be 3 finite numbers"),
        ({"low_rad": 1.0}, "low_rad 1.0 must be below high_rad 1.0"),
        ({"high_rad": math.inf}, "elbow: limits must be 2 finite numbers"),
        ({"speed_rad_per_s": 0.0}, "speed_rad_per_s must be > 0, not 0.0"),
        ({"acceleration_rad_per_s2": -1.0}, "acceleration_rad_per_s2 must be > 0, not -1.0"),
        ({"torque_nm": math.inf}, "torque_nm must be > 0, not inf"),
    ],
)
def test_a_joint_has_a_name_an_axis_and_limits(change, words):
    """What is wrong is said with the joint's name."""
    with pytest.raises(ValueError, match=words):
        replace(JOINT, **change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": ""}, "Arm must have a name"),
        ({"joints": ()}, "must have joints"),
        ({"joints": (JOINT, JOINT), "home_rad": (0.0, 0.0)}, "must have distinct names"),
        ({"home_rad": (0.0,)}, "home_rad must be 6 finite numbers"),
        ({"home_rad": (0.0, 0.0, 4.0, 0.0, 0.0, 0.0)}, "joint elbow_joint at 4.0, beyond"),
    ],
)
def test_an_arm_has_joints_and_a_home_within_their_limits(change, words):
    """And a name."""
    with pytest.raises(ValueError, match=words):
        replace(UR5E, **change)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_an_arm_cannot_be_changed(arm):
    """It is shared by all who ask for it."""
    with pytest.raises(FrozenInstanceError):
        arm.name = "other"
    assert hash(arm) == hash(replace(arm))


def test_standard_parameters_turn_about_the_new_x():
    """First along z, then along x, then about x."""
    assert Transform.from_standard_dh(0.3, 0.2, 0.5) == Transform((0.3, 0.0, 0.2), (0.5, 0.0, 0.0))


def test_modified_parameters_turn_before_they_move_along_z():
    """A quarter turn about x makes the offset point along -y."""
    from_modified_dh = Transform.from_modified_dh(0.3, 0.2, math.pi / 2)
    assert from_modified_dh.xyz_m == pytest.approx((0.3, -0.2, 0.0))
    assert from_modified_dh.rpy_rad == (math.pi / 2, 0.0, 0.0)


def test_the_ur5e_weighs_what_its_maker_says_of_its_moving_links():
    """The sum of the table."""
    assert sum(joint.link.mass_kg for joint in UR5E.joints) == pytest.approx(17.7)


def test_the_ur5e_turns_twice_round_but_at_the_elbow():
    """There the upper arm is in the way."""
    full = (2 * math.pi,) * 2 + (math.pi,) + (2 * math.pi,) * 3
    assert full == UR5E.high_rad
    assert full == tuple(-angle for angle in UR5E.low_rad)
    assert UR5E.speed_rad_per_s == (math.pi,) * 6
    assert UR5E.torque_nm == (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
