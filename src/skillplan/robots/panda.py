"""Facts of the Franka Emika Panda and its hand, as its maker publishes them.

Kinematics in the modified convention of Denavit and Hartenberg (Craig), limits from the
maker's interface specification; the outline of the hand is measured on its collision meshes.
"""

from __future__ import annotations

import math
from typing import Final

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
# From the seventh joint to the flange [m], and how the hand is turned on it [rad].
FLANGE_M: Final = 0.107
HAND_YAW_RAD: Final = -math.pi / 4

JOINT_LOW_RAD: Final = (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
JOINT_HIGH_RAD: Final = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
JOINT_SPEED_RAD_PER_S: Final = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
JOINT_ACCELERATION_RAD_PER_S2: Final = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
JOINT_TORQUE_NM: Final = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)
# The posture in which the elbow has the most room: the "ready" pose.
READY_RAD: Final = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)

# From the frame of the hand to the ends of its fingers, and to the underside of its body [m].
TIP_M: Final = 0.11225
HAND_UNDERSIDE_M: Final = 0.06597
# Half extents of the body of the hand across and along the closing axis [m].
HAND_HALF_WIDTH_M: Final = 0.0317
HAND_HALF_LENGTH_M: Final = 0.104
# Greatest distance between the jaws [m].
OPENING_M: Final = 0.080
# A finger, from its end upwards: height above the end, half its width across the closing axis,
# and how far behind the jaw's face it begins and ends along that axis [m]. Convex between.
FINGER_PROFILE_M: Final = (
    (0.0, 0.0089, 0.0, 0.0144),
    (0.0033, 0.0089, 0.0, 0.0144),
    (0.0177, 0.0089, 0.0, 0.0200),
    (0.0354, 0.0106, 0.0, 0.0257),
    (0.0538, 0.0106, 0.0, 0.0265),
)
