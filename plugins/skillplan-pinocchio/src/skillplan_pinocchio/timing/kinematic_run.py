"""Playback of a plan along its joint paths; held parts move with the hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from skillplan.physics.linear_motions import choose_opening_m, choose_visit_grasp
from skillplan.physics.performance import MOST_PLAYED_S, PerformedSkill, PlannedMotion, Sample
from skillplan.task.motion import Event, Visit
from skillplan.task.pose import Pose
from skillplan.task.scene import WORLD, Robot, Tool, ToolKind
from skillplan.task.skill import FeederClock, Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.arm_paths import ArmPaths, MotionPaths, SkillPaths
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.timing.slow_zones import SlowZones
from skillplan_pinocchio.timing.trajectory import JointLimits, find_fastest_trajectory

# Tolerance for the time of a frame [s].
_ROUNDING_S: Final = 1e-9

PathsOf = Callable[[Skill, State, Vector | None], SkillPaths]
"""Returns the paths of a skill from a posture; raises ValueError if there are none."""


class KinematicRun:
    """Moves arm and parts along the paths of a plan.

    Parameters
    ----------
    task
        Task with one robot.
    frames_per_s
        Samples per second, >= 1.
    """

    def __init__(self, task: Task, paths: ArmPaths, limits: JointLimits, frames_per_s: int) -> None:
        self.task = task
        self.robot: Robot = task.scene.robots[0]
        self.arm = paths.planner.arm
        self.limits = limits
        self.slow_zones = SlowZones.of(task.scene, self.robot)
        self.clearance_m = paths.settings.clearance_m
        self._frame_s = 1 / frames_per_s
        self._samples: list[Sample] = []
        self._now_s = 0.0
        self._skill = self._phase = ""
        self._opening_m = 0.0
        # If the arm cannot stand there, it begins above its first target.
        self._joints: Vector | None = paths.stand(task.initial)[1]
        self._state = task.initial
        # Poses of fixed bodies; the held body and its pose in the frame of the tip.
        self._poses: dict[str, Pose] = {}
        self._held: tuple[str, Pose] | None = None
        self._feeders = FeederClock()

    def of(self, skills: Sequence[Skill], paths_of: PathsOf) -> PlannedMotion:
        """Return the motion of a plan from the initial state on.

        Parameters
        ----------
        skills
            Skills in order, each applicable in its turn, with at most one motion.
        paths_of
            Returns the paths of a skill.

        Raises
        ------
        ValueError
            If there is no path for a skill, or no trajectory along it.
        """
        state = self.task.initial
        none = self.task.facts.none
        self._stand_still(state)
        done = []
        for skill in skills:
            begin_s, self._skill, self._state = self._now_s, skill.name, state
            after = skill.prediction_in(state).apply(state)
            self._await(skill, skill.compute_wait_s(begin_s))
            if skill.motion is None:
                self._phase = "no motion of the arm"
                self._dwell(skill.duration_s.at(state), {}, self._opening_m)
            else:
                self._move(skill, paths_of(skill, state, self._joints), state, after)
            self._stand_still(after)
            verdict = Verdict.feasible(none, none)
            done.append(PerformedSkill(skill.name, verdict, begin_s, self._now_s))
            state = after
        if self._joints is not None:
            self._frame()
        return PlannedMotion(tuple(done), self._samples)

    def _stand_still(self, state: State) -> None:
        """Place fixed bodies as a state has them; feeders show no parts."""
        self._poses = {
            body.name: placement.pose
            for body in self.task.scene.bodies
            if (placement := body.placement(state)) is not None
            and placement.frame == WORLD
            and (placement.solid or body.name in self._poses)
        }

    def _await(self, skill: Skill, wait_s: float) -> None:
        """Let the arm rest until the part of a skill is there."""
        if wait_s:
            self._phase = f"the wait for {skill.parameters.get('part', 'a part')}"
            self._dwell(wait_s, {}, self._opening_m)

    def _move(self, skill: Skill, paths: SkillPaths, state: State, after: State) -> None:
        """Execute the motions of a skill in order."""
        if self._joints is None:
            self._joints = np.asarray(paths.begin_rad)
        self._bring_out({motion.motion.visit.subject for motion in paths.motions}, state)
        for number, motion in enumerate(paths.motions):
            self._take_along(motion)
            subject = motion.motion.visit.subject
            assert not isinstance(motion.travel, Unfound)
            self._phase = f"the travel to {subject}"
            wide_m = self._opening_for(motion)
            opens_m = wide_m if motion.motion.visit.event is Event.GRASP else self._opening_m
            self._along(motion.travel.path, opens_m, motion.motion.tool)
            if number == 0:
                self._await(skill, self._feeders.present(skill, self._now_s))
            self._phase = f"the approach to {subject}"
            down = zip(motion.strokes.down, motion.motion.least_times_s, strict=True)
            for path, least_s in down:
                self._along(path, self._opening_m, motion.motion.tool, least_s)
            self._phase = f"the {motion.motion.visit.event.value} of {subject}"
            self._act(motion, paths.motions[number + 1 :], after)
            self._phase = f"the retreat from {subject}"
            for path in motion.strokes.up:
                self._along(path, self._opening_m, motion.motion.tool_after)

    def _bring_out(self, subjects: set[str], state: State) -> None:
        """Place the handled parts of feeders."""
        for subject in subjects:
            body = next((body for body in self.task.scene.bodies if body.name == subject), None)
            placement = None if body is None else body.placement(state)
            if placement is not None and placement.frame == WORLD:
                self._poses.setdefault(subject, placement.pose)

    def _take_along(self, paths: MotionPaths) -> None:
        """Put the part that a motion releases into the hand if no earlier skill took it."""
        carries = paths.motion.carries
        if carries is not None and (self._held is None or self._held[0] != carries):
            self._held = carries, self._in_hand(paths)
            self._poses.pop(carries, None)

    def _in_hand(self, paths: MotionPaths) -> Pose:
        """Return the pose of the handled part in the frame of the tip during the action."""
        posture = paths.strokes.down[-1].nodes[-1]
        _, rotation = self.arm.tip(posture)
        tip = _make_pose(paths.motion.grasp_tip, rotation)
        return tip.inverse().then(paths.motion.visit.pose)

    def _act(self, paths: MotionPaths, later: Sequence[MotionPaths], after: State) -> None:
        """Execute the action at a target while the arm stands."""
        visit, goals = paths.motion.visit, self.task.scene.at(after)
        subject, dwell_s = visit.subject, visit.dwell_s
        if visit.event is Event.GRASP:
            grasp = choose_visit_grasp(self.task.scene.body(subject), visit)
            self._dwell(dwell_s, {}, grasp.width_m if self._has_jaws(paths) else self._opening_m)
            stood = self._poses.pop(subject, visit.pose)
            self._held = subject, self._tip().inverse().then(stood)
        elif visit.event is Event.FETCH:
            self._dwell(dwell_s, {}, self._opening_m)
            drives = (next_ for next_ in later if next_.motion.visit.event is Event.DRIVE)
            driven = next((it for it in drives if it.motion.visit.subject == subject), paths)
            self._poses.pop(subject, None)
            self._held = subject, self._in_hand(driven)
        elif visit.event in (Event.RELEASE, Event.DRIVE):
            assert self._held is not None
            left = self._tip().then(self._held[1])
            self._held = None
            self._poses[subject] = left
            # The part falls to its goal, or the screw goes into its hole.
            self._dwell(dwell_s, {subject: goals.get(subject, left)}, self._opening_for(paths))
        elif visit.event is Event.TURN:
            self._turn(visit, after)
        else:
            self._dwell(dwell_s, {}, self._opening_m)

    def _turn(self, visit: Visit, after: State) -> None:
        """Turn a workholder with its bodies while the arm stands."""
        scene, begins = self.task.scene, dict(self._poses)
        workholder = scene.find_workholder(visit.subject)
        begin, end = (workholder.find_orientation(state) for state in (self._state, after))
        carried = scene.list_carried(workholder, self._state) & begins.keys()
        begin_s, whole_s = self._now_s, visit.dwell_s
        for share in self._frames(whole_s):
            moved = workholder.move(begin, end, share)
            self._poses |= {name: moved.then(begins[name]) for name in carried}
            self._frame()
        self._now_s = begin_s + whole_s

    def _has_jaws(self, paths: MotionPaths) -> bool:
        tool = paths.motion.tool
        return tool is None or tool.kind is ToolKind.GRIPPER

    def _opening_for(self, paths: MotionPaths) -> float:
        """Return the jaws' opening for a motion [m]; unchanged for other tools."""
        visit = paths.motion.visit
        if visit.event not in (Event.GRASP, Event.RELEASE) or not self._has_jaws(paths):
            return self._opening_m
        grasp = choose_visit_grasp(self.task.scene.body(visit.subject), visit)
        return choose_opening_m(grasp, self.clearance_m, paths.motion.tool, self.robot.hand)

    def _along(
        self, path: JointPath, opening_m: float, tool: Tool | None, least_s: float = 0.0
    ) -> None:
        """Follow a path from rest to rest with a tool while the jaws open.

        Parameters
        ----------
        least_s
            Least time of it [s], >= 0.
        """
        zones = None if self.slow_zones is None else self.slow_zones.with_tool(tool)
        try:
            run = find_fastest_trajectory(path, self.limits, zones)
        except ArithmeticError as error:
            words = f"no run along the path of {self._skill} keeps the limits: {error}"
            raise ValueError(words) from None
        whole_s = max(run.duration_s, least_s)
        begin_s, first_m = self._now_s, self._opening_m
        for share in self._frames(whole_s):
            self._joints = run.at(min(share * run.duration_s, run.duration_s))[0]
            self._opening_m = first_m + share * (opening_m - first_m)
            self._frame()
        self._joints, self._opening_m = np.asarray(path.nodes[-1]), opening_m
        self._now_s = begin_s + whole_s

    def _dwell(self, whole_s: float, goals: Mapping[str, Pose], opening_m: float) -> None:
        """Let the arm stand while the jaws move and released parts go to their goals."""
        if self._now_s + whole_s > MOST_PLAYED_S:
            raise ValueError(
                f"the plan takes more than {MOST_PLAYED_S:,} s, and no more are played"
            )
        begin_s, first_m = self._now_s, self._opening_m
        begins = {name: self._poses[name] for name in goals}
        for share in self._frames(whole_s):
            self._opening_m = first_m + share * (opening_m - first_m)
            self._poses |= {name: _interpolate(begins[name], goals[name], share) for name in goals}
            self._frame()
        self._poses |= goals
        self._opening_m, self._now_s = opening_m, begin_s + whole_s

    def _frames(self, whole_s: float) -> list[float]:
        """Return the share of the next seconds at every frame in them, in (0, 1]."""
        if whole_s <= 0 or self._joints is None:
            return []
        begin_s, end_s = self._now_s, self._now_s + whole_s
        last = math.floor((end_s + _ROUNDING_S) / self._frame_s)
        frames = range(len(self._samples) + 1, last + 1)
        return [min(1.0, (frame * self._frame_s - begin_s) / whole_s) for frame in frames]

    def _tip(self) -> Pose:
        assert self._joints is not None
        position, rotation = self.arm.tip(self._joints)
        return _make_pose(position, rotation)

    def _frame(self) -> None:
        """Record the state at the next frame."""
        assert self._joints is not None
        tip = self._tip()
        bodies = dict(self._poses)
        if self._held is not None:
            name, seen = self._held
            bodies[name] = tip.then(seen)
        joints = tuple(float(angle) for angle in self._joints)
        time_s = (len(self._samples) + 1) * self._frame_s
        where = tip.position
        self._samples.append(
            Sample(
                time_s, self._skill, self._phase, where, where, joints, self._opening_m, 0.0, bodies
            )
        )


def _make_pose(position: Sequence[float] | Vector, rotation: Vector) -> Pose:
    x, y, z = (float(value) for value in position)
    closing, out = (tuple(float(value) for value in rotation[:, axis]) for axis in (1, 2))
    return Pose.of_axes((x, y, z), closing, out)  # type: ignore[arg-type]


def _interpolate(begin: Pose, end: Pose, share: float) -> Pose:
    """Interpolate the position of two poses; the orientation is that of the end."""
    x, y, z = (a + share * (b - a) for a, b in zip(begin.position, end.position, strict=True))
    return Pose((x, y, z), end.orientation)
