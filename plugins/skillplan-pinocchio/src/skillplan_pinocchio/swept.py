"""The detector ``swept``: convex hulls of hand, load and links along a skill's motion.

The motion is the one that all back ends share: a transfer motion at safe height, then at every
via point an approach-act-retreat motion, straight down and up again (Moller et al., section 4.4).
A skill is infeasible where the arm cannot follow, where something of it runs into a body, or where
nothing supports what it leaves behind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cached_property
from typing import ClassVar

from pydantic import Field

from skillplan.collision.detector import Detector
from skillplan.collision.hulls import HullScene
from skillplan.physics.linear_motions import jaw_faults, too_wide
from skillplan.physics.performance import PlannedMotion
from skillplan.task import back_end
from skillplan.task.back_end import RemovedDwell
from skillplan.task.motion import Event
from skillplan.task.scene import Robot
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.arm_paths import ArmPaths, PathSettings, SkillPaths
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.picture import hull_scene
from skillplan_pinocchio.planning.travel_planner import MOST_CHECKS
from skillplan_pinocchio.swept_motion import Collision, SweptMotion, SweptMotionBuilder
from skillplan_pinocchio.tight_fits import tight_fits
from skillplan_pinocchio.timing.kinematic_run import KinematicRun
from skillplan_pinocchio.timing.least_times import LeastTimes
from skillplan_pinocchio.timing.skill_times import SkillTimes
from skillplan_pinocchio.timing.trajectory import JointLimits
from skillplan_pinocchio.verdict_in_state import VerdictInState

_OF_TOOL = "the task or of a tool"
_OF_PART, _OF_SCREW = (f"the task, of a tool or of a {owner}" for owner in ("part", "screw"))


class SweptDetector(Detector):
    """A verdict on swept convex hulls of hand, load and links, on reach, and on supports."""

    name = "swept"
    expected_s = 0.005
    checks_arm = True
    removed_options: ClassVar[Mapping[str, RemovedDwell]] = {
        "grasp_s": RemovedDwell(Event.GRASP, 0.5, "durations_s.pick", _OF_PART),
        "release_s": RemovedDwell(Event.RELEASE, 0.5, "durations_s.place", _OF_PART),
        "load_s": RemovedDwell(Event.LOAD, 2.0, "durations_s.load", _OF_TOOL),
        "offload_s": RemovedDwell(Event.OFFLOAD, 2.0, "durations_s.offload", _OF_TOOL),
        "fetch_s": RemovedDwell(Event.FETCH, 1.0, "durations_s.fetch", _OF_SCREW),
        "drive_s": RemovedDwell(Event.DRIVE, 5.0, "durations_s.fasten", _OF_SCREW),
    }

    class Options(back_end.Options):
        """Options of the hulls and of the arm's speed."""

        samples: int = Field(
            default=40,
            ge=4,
            le=1_000,
            description="places along a linear motion at which links, and first touches, are "
            "looked for; hand and load are swept without gaps [-]",
        )
        tolerance_m: float = Field(
            default=2e-4,
            ge=0,
            le=0.01,
            description="overlap and gap that still count as touching [m]",
        )
        clearance_m: float = Field(
            default=0.004,
            ge=0,
            le=0.04,
            description="how far open jaws keep from the part, on either side [m]",
        )
        drop_height_m: float = Field(
            default=0.001,
            ge=0,
            le=0.05,
            description="height above its goal at which a part is let go [m]",
        )
        check_support: bool = Field(
            default=True,
            description="require something beneath what is placed or fastened [-]",
        )
        check_arm: bool = Field(
            default=True,
            description="check the links of the arm, not only the hand [-]",
        )
        check_travel: bool = Field(
            default=True,
            description="check the travels between motions, not only the motions [-]",
        )
        speed_fraction: float = Field(
            default=0.5,
            gt=0,
            le=1,
            description="share of the joints' speed and acceleration limits that is used [-]",
        )
        travel_checks: int = Field(
            default=MOST_CHECKS,
            ge=1,
            le=1_000_000,
            description="postures that are checked for a way round what stands in a straight "
            "travel, before the verdict is unknown [-]",
        )

    options: Options

    def __init__(self, task: Task, options: Options | None = None) -> None:
        super().__init__(task, options)
        self._swept_motions: dict[tuple[str, int], SweptMotion] = {}
        self._durations_s: dict[tuple[str, int, str], float | None] = {}

    def refuses(self) -> str | None:
        """Return in words why it cannot serve: it models one arm, which stands still."""
        robots = len(self.task.scene.robots)
        if robots != 1:
            return f"it models one arm, and the task {self.task.name!r} has {robots}"
        return None

    def faults(self) -> Mapping[str, str]:
        """Return which parts are too wide for the jaws, by the fact that they are placed."""
        return {} if self.refuses() is not None else jaw_faults(self.task)

    def warnings(self) -> Mapping[str, str]:
        """Return fits that convex pieces make tight; see :meth:`BackEnd.warnings`."""
        return {} if self.refuses() is not None else tight_fits(self.task, as_pieces=True)

    def not_checked(self) -> tuple[str, ...]:
        """Return what the arm's description leaves out; see :meth:`BackEnd.not_checked`."""
        return () if self.refuses() is not None else self._robot.model.not_checked

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict on the motion of `skill`; see :meth:`BackEnd.check`."""
        facts = self.task.facts
        if skill.motion is None:
            return Verdict.feasible(facts.none, facts.none)
        present, absent = self._circumstances(skill, state)
        key = (skill.name, present)
        if key not in self._swept_motions:
            self._swept_motions[key] = self._swept_motion(skill, state)
        return VerdictInState(state, present, absent, lambda: self.paths.stand(state)).on(
            self._swept_motions[key]
        )

    def duration_s(self, skill: Skill, state: State) -> float | None:
        """Return how long the arm takes within its limits; see :meth:`BackEnd.duration_s`.

        None for a skill without motion, and where the arm cannot follow.
        """
        if skill.motion is None:
            return None
        fact, position = self._robot.place(state)
        present, _ = self._circumstances(skill, state)
        key = (skill.name, present, fact)
        if key not in self._durations_s:
            stand = self.paths.stands.at(fact, position)
            motions = self.paths.motions(skill, state)
            self._durations_s[key] = self._times.duration_s(motions, stand)
        return self._durations_s[key]

    def least_duration_s(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a bound on `duration_s` by the joints' limits; see :class:`LeastTimes`."""
        return self._least_times.least_s(skill, true_bits, false_bits)

    def hulls(self, skill: Skill, state: State) -> HullScene:
        """Return what `skill` sweeps, to be looked at; see :meth:`HullDetector.hulls`."""
        words = too_wide(self.task.scene, self._robot, skill)
        if words is not None:
            raise ValueError(words)
        verdict = self.check(skill, state)
        return hull_scene(self.paths, skill, state, verdict)

    def planned_motion(self, skills: Sequence[Skill], frames_per_s: int) -> PlannedMotion:
        """Return how the arm moves in a plan; see :meth:`MotionPlans.planned_motion`."""
        run = KinematicRun(self.task, self.paths, self._times.limits, frames_per_s)
        return run.of(skills, self._granted_paths)

    def _granted_paths(self, skill: Skill, state: State, begin_rad: Vector | None) -> SkillPaths:
        verdict = self.check(skill, state)
        if not verdict.is_feasible:
            raise ValueError(f"{self.name} does not grant {skill.name}: {verdict.reason}")
        found = self.paths.paths(skill, state, begin_rad)
        unfound = found if isinstance(found, Unreachable) else found.unfound
        if unfound is not None:
            raise ValueError(f"{self.name} finds no path for {skill.name}: {unfound.reason}")
        assert isinstance(found, SkillPaths)
        return found

    @cached_property
    def _robot(self) -> Robot:
        return self.task.scene.robots[0]

    @cached_property
    def paths(self) -> ArmPaths:
        """Where the joints go, the same for whoever asks with the same settings."""
        names = [field.name for field in fields(PathSettings)]
        return ArmPaths(self.task, PathSettings(**self.options.model_dump(include=set(names))))

    @cached_property
    def _builder(self) -> SweptMotionBuilder:
        return SweptMotionBuilder(
            self.task.scene,
            self.paths.planner,
            self.paths.sweeps,
            self.paths.travels if self.options.check_travel else None,
            check_support=self.options.check_support,
        )

    @cached_property
    def _times(self) -> SkillTimes:
        fraction = self.options.speed_fraction
        return SkillTimes(JointLimits.of(self._robot.model).scaled(fraction))

    @cached_property
    def _least_times(self) -> LeastTimes:
        plan, stands = self.paths.motions, self.paths.stands
        return LeastTimes(self.task, self._robot, self._times, stands, plan)

    def _circumstances(self, skill: Skill, state: State) -> tuple[int, int]:
        """Return the facts that decide how the arm moves and what it holds, as bits.

        Those that hold, and those that do not.
        """
        assert skill.motion is not None
        facts, robot = self.task.facts, self._robot
        present = absent = 0
        tool = robot.tool(state)
        if tool is not None:
            present |= facts.bit(tool.fact)
        else:
            for item in robot.tools:
                absent |= facts.bit(item.fact)
        if len(skill.motion.routes) > 1:
            present |= next(
                route.when.bits
                for route in skill.motion.routes
                if state.bits & route.when.bits == route.when.bits
            )
        return present, absent

    def _swept_motion(self, skill: Skill, state: State) -> SweptMotion:
        words = too_wide(self.task.scene, self._robot, skill)
        if words is not None:
            return SweptMotion((Collision(None, words, {}),), ())
        return self._builder.build(self.paths.motions(skill, state))
