"""The hand of the Franka Emika Panda; its outline is measured on the maker's collision meshes."""

from __future__ import annotations

import math
from typing import Final

from skillplan.robots.arm_description import Hand, Transform, read_hulls

# Rotation of the hand on the flange [rad].
HAND_YAW_RAD: Final = -math.pi / 4

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
# Mass from the maker's interface [kg].
HAND_MASS_KG: Final = 0.73

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
