"""The Franka Emika Panda and its hand, with data from the maker.

Kinematics are in the modified Denavit-Hartenberg convention (Craig), limits from the maker's
interface specification; the outline of the hand is measured on its collision meshes.

The maker publishes no masses. The masses of the links were identified by Gaz, Cognetti, Oliva,
Robuffo Giordano and De Luca, "Dynamic Identification of the Franka Emika Panda Robot With Retrieval
of Feasible Parameters Using Penalty-Based Optimization", IEEE Robotics and Automation Letters,
2019.
"""

from __future__ import annotations

import math
from typing import Final

from skillplan.robots.arm_description import (
    ArmDescription,
    Hand,
    Joint,
    LinkInertia,
    Transform,
    read_hulls,
)

# Link lengths a [m], offsets d [m] and twists alpha [rad] of the seven joints.
LINK_LENGTHS_M: Final = (0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088)
LINK_OFFSETS_M: Final = (0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0)
LINK_TWISTS_RAD: Final = (
    0.0,
    -math.pi / 2,
    math.pi / 2,
    math.pi / 2,
    -math.pi / 2,
    math.pi / 2,
    math.pi / 2,
)
# Distance from the seventh joint to the flange [m], and rotation of the hand on it [rad].
FLANGE_M: Final = 0.107
HAND_YAW_RAD: Final = -math.pi / 4

JOINT_LOW_RAD: Final = (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
JOINT_HIGH_RAD: Final = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
JOINT_SPEED_RAD_PER_S: Final = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
JOINT_ACCELERATION_RAD_PER_S2: Final = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
JOINT_TORQUE_NM: Final = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)
# The "ready" pose, with the most room for the elbow.
READY_RAD: Final = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)

# Distances from the frame of the hand to the ends of its fingers and to its underside [m].
TIP_M: Final = 0.11225
HAND_UNDERSIDE_M: Final = 0.06597
# Half extents of the body of the hand across and along the closing axis [m].
HAND_HALF_WIDTH_M: Final = 0.0317
HAND_HALF_LENGTH_M: Final = 0.104
# Greatest distance between the jaws [m].
OPENING_M: Final = 0.080
# Outline of a finger, from its end upwards: height above the end, half its width across the closing
# axis, and begin and end behind the jaw's face along that axis [m]. Convex in between.
FINGER_PROFILE_M: Final = (
    (0.0, 0.0089, 0.0, 0.0144),
    (0.0033, 0.0089, 0.0, 0.0144),
    (0.0177, 0.0089, 0.0, 0.0200),
    (0.0354, 0.0106, 0.0, 0.0257),
    (0.0538, 0.0106, 0.0, 0.0265),
)

# Outline of the hand's body from its underside upwards: depth in the frame of the hand, and half
# its extents along and across the closing axis [m]. Convex in between. Made symmetric, as jaws
# close alike with the hand turned by half a turn.
HAND_OUTLINE_M: Final = (
    (HAND_UNDERSIDE_M, 0.0975, 0.0173),
    (0.0560, 0.0960, 0.0196),
    (0.0560, 0.1006, 0.0165),
    (0.0430, 0.0960, 0.0208),
    (0.0430, 0.1006, 0.0170),
    (0.0110, 0.0930, 0.0246),
    (0.0012, 0.0020, HAND_HALF_WIDTH_M),
    (0.0012, HAND_HALF_LENGTH_M, 0.0040),
    (-0.0085, 0.0420, 0.0281),
    (-0.0085, 0.0800, 0.0262),
    (-0.0085, 0.0880, 0.0248),
    (-0.0085, HAND_HALF_LENGTH_M, 0.0037),
    (-0.0180, 0.1000, 0.0040),
    (-0.0262, 0.0885, 0.0040),
)
# Greatest continuous force of the jaws [N].
HAND_FORCE_N: Final = 70.0
# Payload from the data sheet, and mass of the hand from the maker's interface [kg].
PAYLOAD_KG: Final = 3.0
HAND_MASS_KG: Final = 0.73

_LINKS: Final = (
    LinkInertia(
        4.970684,
        (0.003875, 0.002081, -0.04762),
        (0.70337, 0.70661, 0.0091170, -0.00013900, 0.0067720, 0.019169),
    ),
    LinkInertia(
        0.646926,
        (-0.003141, -0.02872, 0.003495),
        (0.0079620, 0.028110, 0.025995, -0.0039250, 0.010254, 0.00070400),
    ),
    LinkInertia(
        3.228604,
        (0.027518, 0.039252, -0.066502),
        (0.037242, 0.036155, 0.010830, -0.0047610, -0.011396, -0.012805),
    ),
    LinkInertia(
        3.587895,
        (-0.05317, 0.104419, 0.027454),
        (0.025853, 0.019552, 0.028323, 0.0077960, -0.0013320, 0.0086410),
    ),
    LinkInertia(
        1.225946,
        (-0.011953, 0.041065, -0.038437),
        (0.035549, 0.029474, 0.0086270, -0.0021170, -0.0040370, 0.00022900),
    ),
    LinkInertia(
        1.666555,
        (0.060149, -0.014117, -0.010517),
        (0.0019640, 0.0043540, 0.0054330, 0.00010900, -0.0011580, 0.00034100),
    ),
    LinkInertia(
        0.735522,
        (0.010517, -0.004252, 0.061597),
        (0.012516, 0.010027, 0.0048150, -0.00042800, -0.0011960, -0.00074100),
    ),
)

PANDA: Final = ArmDescription(
    name="Franka Emika Panda",
    joints=tuple(
        Joint(
            f"joint_{index + 1}",
            Transform.from_modified_dh(
                LINK_LENGTHS_M[index], LINK_OFFSETS_M[index], LINK_TWISTS_RAD[index]
            ),
            JOINT_LOW_RAD[index],
            JOINT_HIGH_RAD[index],
            JOINT_SPEED_RAD_PER_S[index],
            JOINT_ACCELERATION_RAD_PER_S2[index],
            JOINT_TORQUE_NM[index],
            link,
        )
        for index, link in enumerate(_LINKS)
    ),
    tip=Transform((0.0, 0.0, FLANGE_M)),
    home_rad=READY_RAD,
    shapes=read_hulls("panda"),
    reach_m=0.855,
    swing=(0, 2, 6),
    payload_kg=PAYLOAD_KG,
)
"""The arm without its hand; its tip is the flange."""

((_BODY,), (_JAW,)) = read_hulls("panda_hand")

PANDA_HAND: Final = Hand(
    OPENING_M,
    TIP_M,
    HAND_FORCE_N,
    FINGER_PROFILE_M,
    HAND_OUTLINE_M,
    Transform(rpy_rad=(0.0, 0.0, HAND_YAW_RAD)),
    # Behind the face of the jaw, across the closing axis, and above its end; see `Hand`.
    _JAW.corners_m,
    _BODY.corners_m,
    HAND_MASS_KG,
)
"""The hand as it is mounted."""

TIP_ON_FLANGE: Final = PANDA_HAND.tip_on_flange
"""Ends of the fingers relative to the flange."""
