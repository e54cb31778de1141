"""A plan's trajectories as YAML, a document a message, as ROS 2 prints and reads messages."""

from __future__ import annotations

import json
from collections.abc import Iterator

from skillplan.exporters.identifiers import quoted
from skillplan_ros2.skill_trajectory import Array, SkillTrajectory, seconds
from skillplan_ros2.timed_paths import TimedPlan

# Of angles [rad] and speeds [rad/s].
_DIGITS = 9


def message_text(plan: TimedPlan) -> str:
    """Return the messages in order, each with its skill and times in a comment."""
    names = json.dumps(list(plan.joints))
    return "".join(f"{line}\n" for one in plan.skills for line in _document(names, one))


def _document(names: str, one: SkillTrajectory) -> Iterator[str]:
    yield "---"
    yield f"# {quoted(one.skill)}, from {_shown_s(one.begin_ns)} to {_shown_s(one.end_ns)} s"
    for action in one.hand:
        begin_ns = one.begin_ns + action.after_ns
        yield f"# {quoted(action.text)} from {_shown_s(begin_ns)} s on"
    yield "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}"
    yield f"joint_names: {names}"
    yield "points:"
    for time_ns, position, speed in zip(
        one.times_ns, one.positions_rad, one.speeds_rad_per_s, strict=True
    ):
        sec, nanosec = seconds(time_ns)
        yield f"- positions: {_numbers(position)}"
        yield f"  velocities: {_numbers(speed)}"
        yield "  accelerations: []"
        yield "  effort: []"
        yield f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}"


def _numbers(values: Array) -> str:
    # Without an exponent, which YAML 1.1 would take for a text.
    return (
        "[" + ", ".join(f"{round(float(one), _DIGITS) + 0.0:.{_DIGITS}f}" for one in values) + "]"
    )


def _shown_s(time_ns: int) -> str:
    return f"{time_ns / 1e9:.3f}"
