"""What an arm surely reaches, told from its description, without any engine."""

from __future__ import annotations

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.robots.straight_down import straight_down
from skillplan.task.scene import Robot
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

# A part is between the fingers so far at most that the body of the hand is surely clear of it [m].
_MOST_DEPTH_M = 0.03


def surely_reached(task: Task, skill: Skill, state: State) -> bool:
    """Whether an arm surely gets to all that a skill visits, with nothing of its own in the way.

    The hand has to point straight down on an upright base, where the arm is known to reach. False
    says nothing: then an arm model has to be queried.

    Parameters
    ----------
    task
        The skill's task.
    skill
        One that is applicable.
    state
        Where it starts.
    """
    if skill.motion is None:
        return False
    robot = task.scene.robot(skill.motion.robot)
    return all(
        _is_near(robot, motion) and _depth_m(task, motion) <= _MOST_DEPTH_M
        for motion in linear_motions(task, skill, state)
    )


def _is_near(robot: Robot, motion: LinearMotion) -> bool:
    """Whether the tip is where the arm reaches, all along an approach and a retreat."""
    ring = straight_down(robot.model)
    if ring is None or not robot.mount.is_upright or not motion.points_down:
        return False
    x_m, y_m, z_m = robot.base
    up_m = robot.hand.tip_m - z_m
    return all(
        ring.holds((point[0] - x_m, point[1] - y_m, point[2] + up_m))
        for point in (*motion.approach, *motion.retreat)
    )


def _depth_m(task: Task, motion: LinearMotion) -> float:
    """Return how far what is handled rises above the tip of the hand [m]."""
    handled = motion.carries or motion.leaves_with
    if handled is None:
        return 0.0
    visit = motion.visit
    body = task.scene.body(visit.subject)
    return body.reach_m(visit.pose, (0.0, 0.0, 1.0)) - motion.grasp_tip[2]
