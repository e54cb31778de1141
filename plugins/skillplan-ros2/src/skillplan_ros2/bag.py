"""A plan's trajectories as a bag of ROS 2: an MCAP file and what is known of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from skillplan_ros2.message_types import TEXT_TYPE, TRAJECTORY_TYPE, message_types
from skillplan_ros2.skill_trajectory import SkillTrajectory, seconds
from skillplan_ros2.timed_paths import TimedPlan

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
