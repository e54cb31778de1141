"""The few types of messages that a plan takes, as every version of ROS 2 defines them."""

from __future__ import annotations

from typing import Final

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

TRAJECTORY_TYPE: Final = "trajectory_msgs/msg/JointTrajectory"
TEXT_TYPE: Final = "std_msgs/msg/String"

# Durations and times are in every store. All types of a version take longer to load than all else
# that is written.
_FIELDS: Final = {
    TEXT_TYPE: "string data",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "trajectory_msgs/msg/JointTrajectoryPoint": "\n".join(
        (
            "float64[] positions",
            "float64[] velocities",
            "float64[] accelerations",
            "float64[] effort",
            "builtin_interfaces/Duration time_from_start",
        )
    ),
    TRAJECTORY_TYPE: "\n".join(
        (
            "std_msgs/Header header",
            "string[] joint_names",
            "trajectory_msgs/JointTrajectoryPoint[] points",
        )
    ),
}


def message_types() -> Typestore:
    """Return the types of trajectories, of texts, and of what they are made of."""
    types = get_typestore(Stores.EMPTY)
    for name, fields in _FIELDS.items():
        types.register(get_types_from_msg(f"{fields}\n", name))
    return types
