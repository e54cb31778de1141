from .arm_description import ArmDescription as ArmDescription
from .arm_description import Capsule as Capsule
from .arm_description import Hand as Hand
from .arm_description import Hull as Hull
from .arm_description import Joint as Joint
from .arm_description import LinkInertia as LinkInertia
from .arm_description import Rod as Rod
from .arm_description import Transform as Transform
from .catalogue import ARMS as ARMS
from .catalogue import PANDA as PANDA
from .catalogue import STANDARD_HAND as STANDARD_HAND
from .catalogue import UR5E as UR5E
from .home_posture import find_home as find_home
from .link_frames import compute_link_frames as compute_link_frames
from .panda_hand import FINGER_PROFILE_M as FINGER_PROFILE_M
from .panda_hand import HAND_HALF_LENGTH_M as HAND_HALF_LENGTH_M
from .panda_hand import HAND_UNDERSIDE_M as HAND_UNDERSIDE_M
from .panda_hand import PANDA_HAND as PANDA_HAND
from .panda_hand import TIP_M as TIP_M
from .urdf import Rigid as Rigid
from .urdf import UrdfError as UrdfError
from .urdf import read_urdf as read_urdf

__all__ = [
    "ARMS",
    "FINGER_PROFILE_M",
    "HAND_HALF_LENGTH_M",
    "HAND_UNDERSIDE_M",
    "PANDA",
    "PANDA_HAND",
    "STANDARD_HAND",
    "TIP_M",
    "UR5E",
    "ArmDescription",
    "Capsule",
    "Hand",
    "Hull",
    "Joint",
    "LinkInertia",
    "Rigid",
    "Rod",
    "Transform",
    "UrdfError",
    "compute_link_frames",
    "find_home",
    "read_urdf",
]
