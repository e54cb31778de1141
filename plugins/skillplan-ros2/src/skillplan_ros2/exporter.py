"""The exporter `ros2`: a folder with a bag of trajectories, or with the same messages as YAML."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Final, Literal

import numpy as np
from pydantic import Field, field_validator
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from skillplan.exporters.exporter import Exporter, Handover, quote, refuse_chance
from skillplan.task import back_end
from skillplan_ros2.skill_trajectory import Array, SkillTrajectory, WorkholderTurn, split_seconds
from skillplan_ros2.timed_paths import NoTrajectory, TimedPlan, time_plan

TRAJECTORY_TYPE: Final = "trajectory_msgs/msg/JointTrajectory"
TURN_TYPE: Final = "trajectory_msgs/msg/MultiDOFJointTrajectory"
TEXT_TYPE: Final = "std_msgs/msg/String"

# Durations and times are in every store. Loading all types of a version would take longer than the
# rest of the export.
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
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Transform": "\n".join(
        ("geometry_msgs/Vector3 translation", "geometry_msgs/Quaternion rotation")
    ),
    "geometry_msgs/msg/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint": "\n".join(
        (
            "geometry_msgs/Transform[] transforms",
            "geometry_msgs/Twist[] velocities",
            "geometry_msgs/Twist[] accelerations",
            "builtin_interfaces/Duration time_from_start",
        )
    ),
    TURN_TYPE: "\n".join(
        (
            "std_msgs/Header header",
            "string[] joint_names",
            "trajectory_msgs/MultiDOFJointTrajectoryPoint[] points",
        )
    ),
}


def list_message_types() -> Typestore:
    """Return the types of trajectories and texts with their parts."""
    types = get_typestore(Stores.EMPTY)
    for name, fields in _FIELDS.items():
        types.register(get_types_from_msg(f"{fields}\n", name))
    return types


SKILL_TOPIC: Final = "/skillplan/skill"
HAND_TOPIC: Final = "/skillplan/hand"
WORKHOLDER_TOPIC: Final = "/skillplan/workholder"

# The last release before a change of syntax, which older readers support.
_BAG_VERSION: Final = 8


def write_bag(plan: TimedPlan, topic: str) -> dict[str, bytes]:
    """Return the files of a bag by name.

    Parameters
    ----------
    topic
        Topic of the trajectories. Names of skills and actions of the hand have their own topics.
    """
    types = list_message_types()
    with TemporaryDirectory() as folder:
        # The file has the name of the folder.
        path = Path(folder) / "trajectories"
        with Writer(path, version=_BAG_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
            connections = {
                name: writer.add_connection(name, kind, typestore=types)
                for name, kind in (
                    (SKILL_TOPIC, TEXT_TYPE),
                    (topic, TRAJECTORY_TYPE),
                    (HAND_TOPIC, TEXT_TYPE),
                    *([(WORKHOLDER_TOPIC, TURN_TYPE)] if _has_turns(plan) else []),
                )
            }
            for skill in plan.skills:
                for name, time_ns, message in _list_messages(
                    types.types, plan.joints, skill, topic
                ):
                    content = types.serialize_cdr(message, message.__msgtype__)
                    writer.write(connections[name], time_ns, content)
        return {file.name: file.read_bytes() for file in sorted(path.iterdir(), reverse=True)}


def _list_messages(
    types: Any, joints: tuple[str, ...], skill: SkillTrajectory, topic: str
) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time [ns] and message for a skill."""
    text = types[TEXT_TYPE]
    yield SKILL_TOPIC, skill.begin_ns, text(data=skill.skill)
    yield topic, skill.begin_ns, _build_trajectory(types, joints, skill)
    for action in skill.hand:
        yield HAND_TOPIC, skill.begin_ns + action.after_ns, text(data=action.text)
    for turn in skill.turns:
        yield WORKHOLDER_TOPIC, skill.begin_ns + turn.after_ns, _build_turn(types, turn)


def _has_turns(plan: TimedPlan) -> bool:
    return any(skill.turns for skill in plan.skills)


def _build_turn(types: Any, turn: WorkholderTurn) -> Any:
    """Return the poses of a workholder in a turn as a message."""
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    transform = types["geometry_msgs/msg/Transform"]
    point = types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]
    duration = types["builtin_interfaces/msg/Duration"]
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    return types[TURN_TYPE](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="world"),
        joint_names=[turn.workholder],
        points=[
            point(
                transforms=[
                    transform(
                        translation=vector(*pose.position), rotation=quaternion(*pose.orientation)
                    )
                ],
                velocities=[],
                accelerations=[],
                time_from_start=duration(*split_seconds(time_ns)),
            )
            for time_ns, pose in zip(turn.times_ns, turn.poses, strict=True)
        ],
    )


def _build_trajectory(types: Any, joints: tuple[str, ...], skill: SkillTrajectory) -> Any:
    point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
    duration = types["builtin_interfaces/msg/Duration"]
    none = np.zeros(0)
    # A stamp of 0 means that the controller starts at once.
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
                time_from_start=duration(*split_seconds(time_ns)),
            )
            for time_ns, position, speed in zip(
                skill.times_ns, skill.positions_rad, skill.speeds_rad_per_s, strict=True
            )
        ],
    )


# Tolerances of angles [rad] and speeds [rad/s].
_DIGITS = 9


def format_messages(plan: TimedPlan) -> str:
    """Return the messages in order, with skill and times in comments."""
    names = json.dumps(list(plan.joints))
    return "".join(f"{line}\n" for skill in plan.skills for line in _write_document(names, skill))


def _write_document(names: str, skill: SkillTrajectory) -> Iterator[str]:
    yield "---"
    yield f"# {quote(skill.skill)}, from {_format_s(skill.begin_ns)} to {_format_s(skill.end_ns)} s"
    for action in skill.hand:
        begin_ns = skill.begin_ns + action.after_ns
        yield f"# {quote(action.text)} from {_format_s(begin_ns)} s on"
    yield "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}"
    yield f"joint_names: {names}"
    yield "points:"
    for time_ns, position, speed in zip(
        skill.times_ns, skill.positions_rad, skill.speeds_rad_per_s, strict=True
    ):
        sec, nanosec = split_seconds(time_ns)
        yield f"- positions: {_format_numbers(position)}"
        yield f"  velocities: {_format_numbers(speed)}"
        yield "  accelerations: []"
        yield "  effort: []"
        yield f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}"
    for turn in skill.turns:
        yield from _write_turn(skill, turn)


def _write_turn(skill: SkillTrajectory, turn: WorkholderTurn) -> Iterator[str]:
    begin_ns = skill.begin_ns + turn.after_ns
    yield "---"
    yield f"# turn of {quote(turn.workholder)} from {_format_s(begin_ns)} s on"
    yield "header: {stamp: {sec: 0, nanosec: 0}, frame_id: world}"
    yield f"joint_names: {json.dumps([turn.workholder])}"
    yield "points:"
    for time_ns, pose in zip(turn.times_ns, turn.poses, strict=True):
        sec, nanosec = split_seconds(time_ns)
        place, rotation = (
            ", ".join(
                f"{name}: {round(value, _DIGITS) + 0.0:.{_DIGITS}f}"
                for name, value in zip("xyzw", values, strict=False)
            )
            for values in (pose.position, pose.orientation)
        )
        yield f"- transforms: [{{translation: {{{place}}}, rotation: {{{rotation}}}}}]"
        yield "  velocities: []"
        yield "  accelerations: []"
        yield f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}"


def _format_numbers(values: Array) -> str:
    # YAML 1.1 would read a number with an exponent as text.
    return (
        "["
        + ", ".join(f"{round(float(value), _DIGITS) + 0.0:.{_DIGITS}f}" for value in values)
        + "]"
    )


def _format_s(time_ns: int) -> str:
    return f"{time_ns / 1e9:.3f}"


TEXT = "trajectories.yaml"


class Ros2Exporter(Exporter):
    """A bag of ROS 2 (MCAP) with a trajectory of the joints a skill; or these messages as YAML."""

    name: ClassVar[str] = "ros2"
    suffix: ClassVar[str] = ""

    class Options(back_end.Options):
        """Options of the content, and of the arm's speed."""

        format: Literal["bag", "yaml", "both"] = Field(
            default="bag",
            description="content of the folder: a bag, trajectories.yaml, or both [-]",
        )
        topic: str = Field(
            default="/joint_trajectory_controller/joint_trajectory",
            pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$",
            max_length=200,
            description="the topic of the trajectories in the bag [-]",
        )
        speed_fraction: float | None = Field(
            default=None,
            gt=0,
            le=1,
            description="share of the joints' speed and acceleration limits; default: that of "
            "swept [-]",
        )

        @field_validator("topic")
        @classmethod
        def _is_free(cls, value: str) -> str:
            if value in (SKILL_TOPIC, HAND_TOPIC, WORKHOLDER_TOPIC):
                raise ValueError(f"{value} is the topic of texts; name another one")
            return value

    options: Options
    _made: tuple[Handover, TimedPlan] | None = None

    def refuses(self, handover: Handover) -> str | None:
        """Refuse chance, tasks without an arm, and skills without a path of `swept`."""
        refusal = refuse_chance(handover)
        if refusal is not None:
            return refusal
        try:
            self._plan(handover)
        except NoTrajectory as error:
            return str(error)
        return None

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return that trajectories move only the arm, and what else moves."""
        where = f"the topic {HAND_TOPIC}" if self.options.format != "yaml" else "comments"
        words = f"trajectories move the arm only; when the hand acts stands in {where}"
        if not _has_turns(self._plan(handover)):
            return (words,)
        where = f"the topic {WORKHOLDER_TOPIC}" if self.options.format != "yaml" else "documents"
        return (words, f"poses of workholders in turns stand in {where} of their own")

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return the files of the bag, the text, or both."""
        plan = self._plan(handover)
        files: dict[str, str | bytes] = {}
        if self.options.format != "bag":
            files[TEXT] = format_messages(plan)
        if self.options.format != "yaml":
            files.update(write_bag(plan, self.options.topic))
        return files

    def _plan(self, handover: Handover) -> TimedPlan:
        """Return the trajectories, computed once."""
        if self._made is None or self._made[0] is not handover:
            self._made = handover, time_plan(handover, self.options.speed_fraction)
        return self._made[1]
