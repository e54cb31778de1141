"""The detector ``swept``: convex hulls of hand, load and links along a skill's motion.

The motion is the one of all back ends: a transfer motion at safe height, then at every via point an
approach-act-retreat motion, straight down and up again (Moller et al., section 4.4). A skill is
infeasible if the arm cannot follow, if it collides with a body, or if a part is left without
support.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
from pydantic import Field

from skillplan.collision.detector import Detector
from skillplan.collision.hulls import Hull, HullRole, HullScene
from skillplan.collision.solid import intersect
from skillplan.physics.linear_motions import (
    LinearMotion,
    describe_too_wide,
    find_jaw_faults,
    plan_linear_motions,
)
from skillplan.physics.performance import PlannedMotion
from skillplan.task import back_end
from skillplan.task.back_end import BackEnd, RemovedDwell
from skillplan.task.motion import Event, Point
from skillplan.task.scene import (
    Robot,
    Zone,
    describe_unchecked_joins,
    describe_unchecked_slides,
)
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.task.zone import describe_unchecked_speeds
from skillplan_pinocchio.arm_model import ArmModel, Vector
from skillplan_pinocchio.arm_paths import ArmPaths, PathSettings, SkillPaths
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.holds import describe_no_hold
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.planning.travel_planner import MOST_CHECKS
from skillplan_pinocchio.shapes import TABLE, ConvexPiece, make_zone_pieces
from skillplan_pinocchio.swept_motion import (
    Collision,
    SweptMotion,
    SweptMotionBuilder,
    VerdictInState,
)
from skillplan_pinocchio.tight_fits import describe_unchecked_fits, find_tight_fits
from skillplan_pinocchio.timing.kinematic_run import KinematicRun
from skillplan_pinocchio.timing.skill_times import LeastTimes, SkillTimes
from skillplan_pinocchio.timing.slow_zones import SlowZones
from skillplan_pinocchio.timing.trajectory import JointLimits
from skillplan_pinocchio.turning import Turns

# Number of postures in which a travel is drawn.
_PICTURES = 13
# Distance from what moves up to which a zone is drawn [m].
_NEAR_M = 0.15


def build_hull_scene(paths: ArmPaths, skill: Skill, state: State, verdict: Verdict) -> HullScene:
    """Return the hulls of hand and load in a skill, and the bodies present.

    Parameters
    ----------
    paths
        Joint paths; they know all obstacles. The table is left out.
    skill, state
        Skill, and the state in which it starts.
    verdict
        The detector's verdict, which names contacts.

    Raises
    ------
    ValueError
        If the skill sweeps no hulls.
    """
    met = set(verdict.evidence.get("bodies", ()))
    motions = paths.motions(skill, state)
    hulls = [
        *_draw_motions(motions, paths.sweeps),
        *_draw_travels(paths, skill, state),
        *_draw_links(motions, paths.planner.arm, verdict),
    ]
    if not hulls:
        raise ValueError("nothing is swept")
    moved = {hull.name for hull in hulls}
    for obstacle in paths.planner.obstacles:
        there = obstacle.fact is None or obstacle.fact in state
        if there and obstacle.body != TABLE and obstacle.body not in moved:
            role = HullRole.MET if obstacle.body in met else HullRole.STANDING
            zone = obstacle.zone
            pieces = obstacle.pieces if zone is None else _cut_zone(zone, hulls)
            hulls += [_make_hull(obstacle.body, role, piece) for piece in pieces]
    reason = "" if verdict.is_feasible else verdict.reason
    return HullScene(
        hulls, list(_iterate_touches(verdict)), reason, frozenset(_iterate_subjects(verdict))
    )


def _cut_zone(zone: Zone, hulls: Sequence[Hull]) -> tuple[ConvexPiece, ...]:
    """Return a zone near some hulls, because most are far larger than what moves."""
    points = np.array([corner for hull in hulls for corner in hull.vertices])
    low, high = points.min(axis=0) - _NEAR_M, points.max(axis=0) + _NEAR_M
    frame = ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))
    low_m, high_m = max(zone.low_m, float(low[2])), min(zone.high_m, float(high[2]))
    outlines = [intersect(piece, frame) for piece in zone.pieces] if low_m < high_m else []
    return make_zone_pieces([outline for outline in outlines if outline], low_m, high_m)


def _iterate_subjects(verdict: Verdict) -> Iterator[str]:
    """Yield the names of the bodies in the reason of a verdict."""
    evidence = verdict.evidence
    yield from (str(evidence[key]) for key in ("moving", "body") if key in evidence)
    for key in ("bodies", "links"):
        yield from evidence.get(key, ())


def _draw_travels(paths: ArmPaths, skill: Skill, state: State) -> Iterator[Hull]:
    """Yield hulls of hand and load on travels that need a check.

    A travel that was not found is drawn as the blocked straight one.
    """
    paths_of_skill = paths.paths(skill, state)
    if isinstance(paths_of_skill, Unreachable):
        return
    here = paths_of_skill.begin_rad
    for motion in paths_of_skill.motions:
        goal = motion.strokes.begin
        if motion.is_checked:
            straight = JointPath([here, goal])
            path = straight if isinstance(motion.travel, Unfound) else motion.travel.path
            yield from _draw_along(paths, motion.motion, path)
        here = motion.strokes.end


def _draw_along(paths: ArmPaths, motion: LinearMotion, path: JointPath) -> Iterator[Hull]:
    serial = paths.planner.arm.serial
    back = serial.tip(path.at(1.0)).inverse()
    places = np.linspace(0.0, 1.0, _PICTURES).tolist()
    moved = [serial.tip(path.at(place)) * back for place in places]
    for name, pieces in paths.sweeps.held(motion, motion.above):
        for piece in pieces:
            placed = [piece.corners @ pose.rotation.T + pose.translation for pose in moved]
            for begin, end in pairwise(placed):
                yield _make_hull(name, HullRole.MOVING, ConvexPiece(np.concatenate([begin, end])))


def _draw_motions(motions: Sequence[ArmMotion], sweeps: HandSweeps) -> Iterator[Hull]:
    for motion in motions:
        stretches = [*sweeps.approach(motion.motion), *sweeps.retreat(motion.motion)]
        sweeps_of_motion = [sweep for stretch in stretches for sweep in stretch]
        for sweep in sweeps_of_motion:
            for piece in sweep.pieces:
                yield _make_hull(sweep.mover, HullRole.MOVING, piece.swept(sweep.by))


def _draw_links(motions: Sequence[ArmMotion], arm: ArmModel, verdict: Verdict) -> Iterator[Hull]:
    """Yield the links in the posture where one of them first collides, if any."""
    evidence = verdict.evidence
    if not str(evidence.get("moving", "")).startswith("link"):
        return
    met = set(evidence["bodies"])
    for motion in motions:
        for elbow in motion.elbows[:1]:
            if met & {obstacle.body for obstacle, _ in elbow.meets}:
                joints_rad = elbow.at(float(evidence["fraction"]))
                rotations, origins = arm.frames([joints_rad])
                for piece in arm.pieces:
                    rotation = rotations[0, piece.link - 1]
                    corners = piece.corners @ rotation.T + origins[0, piece.link - 1]
                    name = f"link {piece.link} of the arm"
                    yield _make_hull(name, HullRole.MOVING, ConvexPiece(corners))
                return


def _iterate_touches(verdict: Verdict) -> Iterator[Point]:
    position = verdict.evidence.get("position_m")
    if position is not None and "bodies" in verdict.evidence:
        x, y, z = position
        yield (x, y, z)


def _make_hull(name: str, role: HullRole, piece: ConvexPiece) -> Hull:
    """Return a piece as a hull with triangles from coal."""
    corners, faces = piece.surface
    return Hull(
        name,
        role,
        [(float(x), float(y), float(z)) for x, y, z in corners.tolist()],
        [(int(a), int(b), int(c)) for a, b, c in faces.tolist()],
    )


_OF_TOOL = "the task or of a tool"
_OF_PART, _OF_SCREW = (f"the task, of a tool or of a {owner}" for owner in ("part", "screw"))


class SweptDetector(Detector):
    """A verdict on swept convex hulls of hand, load and links, on reach, and on supports."""

    name = "swept"
    version = "7"
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
            description="samples along a linear motion for links and for first contacts; hand and "
            "load are swept without gaps [-]",
        )
        tolerance_m: float = Field(
            default=2e-4,
            ge=0,
            le=0.01,
            description="overlap or gap that counts as touching [m]; a tenth of it for hand and "
            "tool",
        )
        clearance_m: float = Field(
            default=0.004,
            ge=0,
            le=0.04,
            description="clearance of open jaws on either side of a part [m]",
        )
        drop_height_m: float = Field(
            default=0.001,
            ge=0,
            le=0.05,
            description="height above its goal at which a part is released [m]",
        )
        check_support: bool = Field(
            default=True,
            description="require a support beneath parts that are placed or fastened [-]",
        )
        check_arm: bool = Field(
            default=True,
            description="check the links of the arm in addition to the hand [-]",
        )
        check_travel: bool = Field(
            default=True,
            description="check the travels between motions [-]",
        )
        speed_fraction: float = Field(
            default=0.5,
            gt=0,
            le=1,
            description="fraction of the joints' speed and acceleration limits in use [-]",
        )
        travel_checks: int = Field(
            default=MOST_CHECKS,
            ge=1,
            le=1_000_000,
            description="postures checked for a path around an obstacle before the verdict is "
            "unknown [-]",
        )

    options: Options

    def __init__(self, task: Task, options: Options | None = None) -> None:
        super().__init__(task, options)
        self._swept_motions: dict[tuple[str, int], SweptMotion] = {}
        self._approaches: dict[tuple[str, int], SweptMotion] = {}
        self._durations_s: dict[tuple[str, int, str], float | None] = {}

    def refuses(self) -> str | None:
        """Return the reason why a task is not supported: `swept` models exactly one arm."""
        robots = len(self.task.scene.robots)
        if robots != 1:
            return f"it models one arm, and the task {self.task.name!r} has {robots}"
        return None

    def faults(self) -> Mapping[str, str]:
        """Return messages on parts too wide for the jaws, by the fact that they are placed."""
        return {} if self.refuses() is not None else find_jaw_faults(self.task)

    def warnings(self) -> Mapping[str, str]:
        """Return fits that convex pieces make tight; see :meth:`BackEnd.warnings`."""
        return {} if self.refuses() is not None else find_tight_fits(self.task, as_pieces=True)

    def not_checked(self) -> tuple[str, ...]:
        """Return limits that the arm's description lacks, and what of fits, speeds and joins."""
        if self.refuses() is not None:
            return ()
        return (
            *self._robot.model.not_checked,
            *describe_unchecked_fits(self.task.scene.bodies, simulated=False),
            *describe_unchecked_speeds(self.task.scene),
            *describe_unchecked_joins(self.task.scene.bodies),
            *describe_unchecked_slides(self.task.scene.bodies),
        )

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict on the motion of `skill`; see :meth:`BackEnd.check`."""
        facts = self.task.facts
        if skill.motion is None and "holder" not in skill.parameters:
            return Verdict.feasible(facts.none, facts.none)
        present, absent = self._circumstances(skill, state)
        in_state = VerdictInState(state, present, absent, lambda: self.paths.stand(state))
        key = (skill.name, present)
        if key not in self._approaches:
            self._approaches[key] = self._first_approach(skill, state)
        early = in_state.on(self._approaches[key])
        if not early.is_feasible:
            return early
        if key not in self._swept_motions:
            self._swept_motions[key] = self._swept_motion(skill, state)
        swept = self._swept_motions[key]
        return in_state.on(swept if self.options.check_travel else replace(swept, travels=None))

    def take_over(self, other: BackEnd) -> None:
        """Use the motions of a detector whose options differ in the check of travels alone."""
        if not isinstance(other, SweptDetector) or other.task is not self.task:
            return
        as_own = {"check_travel": self.options.check_travel}
        if other.options.model_copy(update=as_own) == self.options:
            self.paths, self._builder = other.paths, other._builder
            self._swept_motions, self._approaches = other._swept_motions, other._approaches

    def refuse_early(self, skill: Skill, state: State) -> Verdict | None:
        """Return the refusal by a sweep of the hand alone, without joint paths, or None."""
        if skill.motion is None and "holder" not in skill.parameters:
            return None
        present, absent = self._circumstances(skill, state)
        key = (skill.name, present)
        swept = self._approaches.get(key)
        if swept is None:
            # Nothing is looked for beyond the first collision in this state.
            swept = self._first_approach(skill, state, lambda fact: fact in state)
        verdict = VerdictInState(state, present, absent, lambda: self.paths.stand(state)).on(swept)
        return None if verdict.is_feasible else verdict

    def duration_s(self, skill: Skill, state: State) -> float | None:
        """Return the duration within the arm's limits [s]; see :meth:`BackEnd.duration_s`.

        None for a skill without motion, or if the arm cannot follow.
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
        """Return a lower bound on `duration_s` from joint limits; see :class:`LeastTimes`."""
        return self._least_times.least_s(skill, true_bits, false_bits)

    def hulls(self, skill: Skill, state: State) -> HullScene:
        """Return the hulls of `skill` for pictures; see :meth:`HullDetector.hulls`."""
        words = describe_too_wide(self.task.scene, self._robot, skill)
        if words is not None:
            raise ValueError(words)
        verdict = self.check(skill, state)
        return build_hull_scene(self.paths, skill, state, verdict)

    def planned_motion(self, skills: Sequence[Skill], frames_per_s: int) -> PlannedMotion:
        """Return the motion of the arm in a plan; see :meth:`MotionPlans.planned_motion`."""
        run = KinematicRun(self.task, self.paths, self._times.limits, frames_per_s)
        return run.of(skills, self._granted_paths)

    def _granted_paths(self, skill: Skill, state: State, begin_rad: Vector | None) -> SkillPaths:
        verdict = self.check(skill, state)
        if not verdict.is_feasible:
            raise ValueError(f"{self.name} does not grant {skill.name}: {verdict.reason}")
        paths = self.paths.paths(skill, state, begin_rad)
        unfound = paths if isinstance(paths, Unreachable) else paths.unfound
        if unfound is not None:
            raise ValueError(f"{self.name} finds no path for {skill.name}: {unfound.reason}")
        assert isinstance(paths, SkillPaths)
        return paths

    @cached_property
    def _robot(self) -> Robot:
        return self.task.scene.robots[0]

    @cached_property
    def paths(self) -> ArmPaths:
        """Joint paths for the settings in the options."""
        names = [field.name for field in fields(PathSettings)]
        return ArmPaths(self.task, PathSettings(**self.options.model_dump(include=set(names))))

    @cached_property
    def _builder(self) -> SweptMotionBuilder:
        return SweptMotionBuilder(
            self.task.scene,
            self.paths.planner,
            self.paths.sweeps,
            self.paths.travels,
            check_support=self.options.check_support,
        )

    @cached_property
    def _turns(self) -> Turns:
        return Turns(self.task.scene, self.paths.planner, self.paths.sweeps)

    @cached_property
    def _times(self) -> SkillTimes:
        fraction = self.options.speed_fraction
        limits = JointLimits.of(self._robot.model).scaled(fraction)
        return SkillTimes(limits, SlowZones.of(self.task.scene, self._robot))

    @cached_property
    def _least_times(self) -> LeastTimes:
        plan, stands = self.paths.motions, self.paths.stands
        return LeastTimes(self.task, self._robot, self._times, stands, plan)

    def _circumstances(self, skill: Skill, state: State) -> tuple[int, int]:
        """Return bits of the facts that decide the arm's motion and load.

        First the facts that hold, then the others.
        """
        facts, robot = self.task.facts, self._robot
        present = absent = 0
        if skill.motion is None:
            # A holder is with the product, in one of its orientations.
            placement = self.task.scene.body(skill.parameters["part"]).placement(state)
            return 0 if placement is None else facts.bit(placement.fact), 0
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

    def _first_approach(
        self, skill: Skill, state: State, holds: Callable[[str], bool] | None = None
    ) -> SweptMotion:
        """Return what hand and load meet on the first approach, if the arm reaches its target.

        Parameters
        ----------
        holds
            Returns whether a fact holds, if only the first collision with an existing body counts.
        """
        words = self._describe_no_grip(skill)
        if words is not None:
            return SweptMotion((Collision(None, words, {}),), ())
        if skill.motion is None:
            return SweptMotion((), ())
        motion = plan_linear_motions(self.task, skill, state, self.options.drop_height_m)[0]
        if not self.paths.planner.can_reach(motion):
            return SweptMotion((), ())
        if holds is None:
            return SweptMotion(self._builder.approach(motion), ())
        hit = self._builder.find_first_hit(motion, holds)
        return SweptMotion(() if hit is None else (hit,), ())

    def _describe_no_grip(self, skill: Skill) -> str | None:
        scene, robot = self.task.scene, self._robot
        words = describe_too_wide(scene, robot, skill)
        return words or describe_no_hold(scene, robot, skill)

    def _swept_motion(self, skill: Skill, state: State) -> SweptMotion:
        if skill.motion is None:
            part, holder = skill.parameters["part"], skill.parameters["holder"]
            if skill.kind == "release":
                return self._turns.release(self._builder, holder, part, state)
            return SweptMotion(tuple(self._turns.close(holder, part)), ())
        motions = self.paths.motions(skill, state)
        swept = self._builder.build(motions)
        turns = tuple(
            collision
            for motion in motions
            if motion.motion.visit.event is Event.TURN
            for collision in self._turns.turn(motion, state)
        )
        return replace(swept, events=(*swept.events, *turns)) if turns else swept
