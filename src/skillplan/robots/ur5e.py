"""The Universal Robots UR5e, with data from the maker.

Kinematics (standard Denavit-Hartenberg parameters), masses and centres of mass are from the maker's
article "DH Parameters for calculations of kinematics and dynamics"; angles, speeds and payload from
its user manual; torques from its article "Max. joint torques". The elbow turns by half of the angle
in the manual, since the upper arm is in its way, as in the maker's ROS description.

The article neglects the inertias of the links; these are from the maker's ROS description
(`config/ur5e/physical_parameters.yaml`). Accelerations are not published; these are the assumption
of that description, 180 degrees/s2.
"""

from __future__ import annotations

import math
from typing import Final

from skillplan.robots.arm_description import (
    ArmDescription,
    Joint,
    LinkInertia,
    Transform,
    read_hulls,
)

# Names of the joints in the maker's ROS description.
_NAMES: Final = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
# Link lengths a [m], offsets d [m] and twists alpha [rad], each after the joint of its number.
_LINK_ENDS: Final = (
    Transform.from_standard_dh(0.0, 0.1625, math.pi / 2),
    Transform.from_standard_dh(-0.425, 0.0, 0.0),
    Transform.from_standard_dh(-0.3922, 0.0, 0.0),
    Transform.from_standard_dh(0.0, 0.1333, math.pi / 2),
    Transform.from_standard_dh(0.0, 0.0997, -math.pi / 2),
    Transform.from_standard_dh(0.0, 0.0996, 0.0),
)
_TURN_RAD: Final = (2 * math.pi, 2 * math.pi, math.pi, 2 * math.pi, 2 * math.pi, 2 * math.pi)
_SPEED_RAD_PER_S: Final = math.pi
_ACCELERATION_RAD_PER_S2: Final = math.pi
_TORQUE_NM: Final = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)

# Masses, centres of mass and inertias, in the frame at the end of each link.
_MASS_KG: Final = (3.761, 8.058, 2.846, 1.37, 1.3, 0.365)
_CENTRES_M: Final = (
    (0.0, -0.02561, 0.00193),
    (0.2125, 0.0, 0.11336),
    (0.15, 0.0, 0.0265),
    (0.0, -0.0018, 0.01634),
    (0.0, 0.0018, 0.01634),
    (0.0, 0.0, -0.001159),
)
_TENSORS_KG_M2: Final = (
    (0.00700210, 0.00648091, 0.00657286, 0.00000073, -0.00001053, 0.00049994),
    (0.01505885, 0.33388086, 0.33247207, -0.00005400, 0.00000563, -0.00000181),
    (0.00399632, 0.07879254, 0.07848510, -0.00001365, 0.00137272, -0.00000660),
    (0.00165491, 0.00135962, 0.00126279, -0.00000282, -0.00000438, 0.00010157),
    (0.00135617, 0.00127827, 0.00096614, -0.00000274, 0.00000444, -0.00005048),
    (0.00018694, 0.00018908, 0.00025756, 0.00000006, -0.00000017, -0.00000092),
)

UR5E: Final = ArmDescription(
    name="Universal Robots UR5e",
    joints=tuple(
        Joint(
            name,
            # A joint is at the end of the link before.
            _LINK_ENDS[index - 1] if index else Transform(),
            -_TURN_RAD[index],
            _TURN_RAD[index],
            _SPEED_RAD_PER_S,
            _ACCELERATION_RAD_PER_S2,
            _TORQUE_NM[index],
            LinkInertia(
                _MASS_KG[index], _CENTRES_M[index], _TENSORS_KG_M2[index], _LINK_ENDS[index]
            ),
        )
        for index, name in enumerate(_NAMES)
    ),
    tip=_LINK_ENDS[-1],
    # Upper arm upright, forearm level, flange pointing down.
    home_rad=(0.0, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0),
    shapes=read_hulls("ur5e"),
    reach_m=0.85,
    payload_kg=5.0,
)
"""The arm; its tip is the tool flange."""
