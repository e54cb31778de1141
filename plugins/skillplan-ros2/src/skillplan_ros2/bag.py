"""A plan's trajectories as a bag of ROS 2: an MCAP file and what is known of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from skillplan_ros2.skill_trajectory import SkillTrajectory, seconds
from skillplan_ros2.timed_paths import TimedPlan

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


SKILL_TOPIC: Final = "/skillplan/skill"
HAND_TOPIC: Final = "/skillplan/hand"

# The last before one of a changed syntax, so that older readers know it, too.
_BAG_VERSION: Final = 8


def bag_files(plan: TimedPlan, topic: str) -> dict[str, bytes]:
    """Return the files of a bag by name.

    Parameters
    ----------
    plan
        The trajectories.
    topic
        Of the trajectories. Names of skills, and what the hand does, have topics of their own.
    """
    types = message_types()
    with TemporaryDirectory() as folder:
        # The file is called like the folder.
        path = Path(folder) / "trajectories"
        with Writer(path, version=_BAG_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
            connections = {
                name: writer.add_connection(name, kind, typestore=types)
                for name, kind in (
                    (SKILL_TOPIC, TEXT_TYPE),
                    (topic, TRAJECTORY_TYPE),
                    (HAND_TOPIC, TEXT_TYPE),
                )
            }
            for one in plan.skills:
                for name, time_ns, message in _messages(types.types, plan.joints, one, topic):
                    content = types.serialize_cdr(message, message.__msgtype__)
                    writer.write(connections[name], time_ns, content)
        return {one.name: one.read_bytes() for one in sorted(path.iterdir(), reverse=True)}


def _messages(
    types: Any, joints: tuple[str, ...], one: SkillTrajectory, topic: str
) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time [ns] and message of what is said of a skill."""
    text = types[TEXT_TYPE]
    yield SKILL_TOPIC, one.begin_ns, text(data=one.skill)
    yield topic, one.begin_ns, _trajectory(types, joints, one)
    for action in one.hand:
        yield HAND_TOPIC, one.begin_ns + action.after_ns, text(data=action.text)


def _trajectory(types: Any, joints: tuple[str, ...], one: SkillTrajectory) -> Any:
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    duration = types["builtin_interfaces/msg/Duration"]
    none = np.zeros(0)
    # The stamp of 0 tells a controller to begin at once.
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    return types[TRAJECTORY_TYPE](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
        joint_names=list(joints),
        points=[
            point(
                positions=position,
                velocities=speed,
                accelerations=none,
                effort=none,
                time_from_start=duration(*seconds(time_ns)),
            )
            for time_ns, position, speed in zip(
                one.times_ns, one.positions_rad, one.speeds_rad_per_s, strict=True
            )
        ],
    )
