"""A whole plan executed in one continuous world, as on the real workplace."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from skillplan.collision.boxes import world_boxes
from skillplan.physics.performance import (
    MOST_PLAYED_S,
    Angle,
    Arrival,
    Image,
    Performance,
    PerformedSkill,
    Sample,
    View,
)
from skillplan.task.motion import Point
from skillplan.task.scene import WORLD, Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict
from skillplan_simulation.arm.hand_shapes import hand_of
from skillplan_simulation.arm.kinematics import UnreachableError
from skillplan_simulation.execution.contact_log import STEPS_PER_FRAME
from skillplan_simulation.execution.controlled_robot import StuckError
from skillplan_simulation.execution.planned_paths import PlannedSkill
from skillplan_simulation.execution.skill_runner import SkillRunner
from skillplan_simulation.execution.workcell import SETTLE_S, Workcell
from skillplan_simulation.performing.film import Film
from skillplan_simulation.performing.footage import caption_of
from skillplan_simulation.record import FRAMES_PER_S
from skillplan_simulation.simulator import STEPS_PER_S, Arm, UpsetError, World
from skillplan_simulation.verdicts.contact_judge import Judge, collision_in
from skillplan_simulation.verdicts.postconditions import (
    Tolerances,
    offset_m,
    postcondition_verdict,
    tilt_rad,
)

if TYPE_CHECKING:
    from skillplan_simulation.pictures.painted_camera import PaintedCamera

# So high above its tip a hand has to be seen [m].
_HAND_M = 0.15
# And so high above its base an arm [m].
_ARM_M = 0.8


@dataclass(frozen=True, slots=True)
class Rules:
    """What has to hold of every skill.

    Parameters
    ----------
    tolerances
        How exactly every prediction has to come true.
    judges
        Who rules on contacts.
    """

    tolerances: Tolerances
    judges: tuple[Judge, ...]


@dataclass(frozen=True, slots=True)
class Observers:
    """Who looks on while a plan is executed.

    Parameters
    ----------
    frames_per_s
        Pictures a simulated second [1/s]; None for none.
    show
        Is given every picture.
    note
        Is given a sample of every frame of 1/60 s.
    angle
        From which side pictures are taken; left out: from the one that the arm does not hide.
    labels
        Whether bodies have name tags.
    """

    frames_per_s: float | None = None
    show: Callable[[Image], None] | None = None
    note: Callable[[Sample], None] | None = None
    angle: Angle | None = None
    labels: bool = False


def execute_plan(
    workcell: Workcell,
    rules: Rules,
    skills: Sequence[Skill],
    observers: Observers,
    stopped: Callable[[], bool],
) -> Performance:
    """Execute a plan without a break; see :meth:`skillplan.physics.performance.Performer`.

    Parameters
    ----------
    workcell
        Whose task and settings they are.
    rules
        What has to hold of every skill.
    skills
        The plan.
    observers
        Who looks on.
    stopped
        Whether to end before the next skill.
    """
    robot = workcell.robot
    hand = hand_of(robot, robot.tool(workcell.task.initial))
    world, arm = workcell.simulator.cell(hand)
    with world, ExitStack() as stack:
        film = None
        if observers.frames_per_s and observers.show is not None:
            film = stack.enter_context(Film(observers.show))
        return _PlanExecution(workcell, rules, world, arm, observers, film).play(skills, stopped)


class _PlanExecution:
    def __init__(
        self,
        workcell: Workcell,
        rules: Rules,
        world: World,
        arm: Arm,
        observers: Observers,
        film: Film | None,
    ) -> None:
        self.workcell, self.rules, self.world = workcell, rules, world
        self.film, self.note = film, observers.note
        self.task = workcell.task
        self.robot = self.task.scene.robots[0]
        self.arm = arm
        self.every = STEPS_PER_S / (observers.frames_per_s or STEPS_PER_S)
        self.shown = 0
        # Steps of dwells in which arm and parts were at rest: counted, not simulated.
        self.held = 0
        self.skill = ""
        self.step = 0
        self.camera: PaintedCamera | None = None
        if film is not None:
            view = View.about(self._extent(), observers.angle)
            # An execution without pictures does not load the painter.
            from skillplan_simulation.pictures.painted_camera import PaintedCamera

            self.camera = PaintedCamera(self.task.scene, view, labels=observers.labels)

    def play(self, skills: Sequence[Skill], stopped: Callable[[], bool]) -> Performance:
        state = self.task.initial
        try:
            self.here_rad = self.workcell.paths.stand(state)
            self.arm.stand(self.here_rad, self.arm.hand.opening_m / 2)
        except UnreachableError as error:
            none = self.task.facts.none
            verdict = Verdict.infeasible(f"before it begins: {error}", none, none)
            begun = tuple(PerformedSkill(skill.name, verdict, 0.0, 0.0) for skill in skills[:1])
            return Performance(begun, (), 0.0, 0)
        for body in self.task.scene.bodies:
            placement = body.placement(state)
            if placement is not None and placement.solid:
                self.world.add(body, placement.pose, stands=True)
                self.workcell.fastenings.fasten(self.world, [(body.name, placement)])
        runner = SkillRunner(
            self.world,
            self.arm,
            self.task.scene,
            self.workcell.settings,
            self.robot.tool(state),
            self._every_step,
            self._dwell,
        )
        self.runner = runner
        with suppress(StuckError, UpsetError):
            # What blocks the arm from the start, the first skill will say.
            runner.wait(SETTLE_S)
        done: list[PerformedSkill] = []
        for skill in skills:
            if done and stopped():
                break
            self.skill = skill.name
            self.step += 1
            begin_s, runner.acting_steps = self._now_s, 0
            verdict = self._execute(skill, state)
            state = skill.prediction_in(state).apply(state)
            acting_s = runner.acting_steps / STEPS_PER_S
            done.append(PerformedSkill(skill.name, verdict, begin_s, self._now_s, acting_s))
            if not verdict.is_feasible:
                break
        return Performance(
            tuple(done),
            tuple(self._arrivals(state)),
            self._now_s,
            self.world.steps,
            held_s=self.held / STEPS_PER_S,
            pace=self.workcell.settings.pace,
        )

    def _execute(self, skill: Skill, state: State) -> Verdict:
        facts = self.task.facts
        if not skill.applicable(state):
            missing = skill.why_not(state)
            return Verdict.infeasible(
                f"needs {', '.join(missing.requires)}", facts.none, facts.none
            )
        if skill.motion is None:
            return Verdict.feasible(facts.none, facts.none)
        runner = self.runner
        try:
            planned = self.workcell.paths.of(skill, state, self.here_rad)
        except UnreachableError as error:
            return Verdict.infeasible(str(error), facts.none, facts.none)
        if planned.unfound is not None:
            return Verdict.unknown(planned.unfound)
        runner.begin(planned.motions, state)
        # The frames of a log are the rows of the trace.
        begin_s = ((self.world.steps + self.held) // STEPS_PER_FRAME + 1) / FRAMES_PER_S
        try:
            for one in planned.motions:
                runner.travel(one)
                runner.run(one)
                self.here_rad = one.retreat[-1]
        except (UpsetError, np.linalg.LinAlgError) as error:
            return Verdict.unknown(str(error))
        except UnreachableError as error:
            return Verdict.infeasible(str(error), facts.none, facts.none)
        except StuckError:
            runner.sensed["stuck_on"] = runner.log.phase_now
        return self._sensed(skill, state, planned, begin_s)

    def _sensed(self, skill: Skill, state: State, planned: PlannedSkill, begin_s: float) -> Verdict:
        """Return the verdict of a search: a collision is named before what it causes."""
        record = self.workcell.record_of(skill, state, planned, self.runner, begin_s)
        verdict = postcondition_verdict(skill, record, self.rules.tolerances)
        collision = collision_in(record, self.rules.judges)
        if collision is None:
            return verdict
        evidence = {**verdict.evidence, **collision.evidence}
        return Verdict.infeasible(collision.reason, evidence=evidence)

    @property
    def _now_s(self) -> float:
        return (self.world.steps + self.held) / STEPS_PER_S

    def _dwell(self, steps: int) -> None:
        """Have time pass while arm and parts are at rest: pictures and samples stay the same."""
        if not steps:
            return
        begin = self.world.steps + self.held
        self.held += steps
        self.runner.log.pauses.append((self.runner.log.frames, steps / STEPS_PER_S))
        if self.film and self.camera:
            shot = cache(self._shot())
            while begin + steps >= self.shown * self.every:
                self.film.add(shot)
                self.shown += 1
        if self.note is not None:
            sample = self._sample()
            # No dwell fills a trace with more than an hour of rows.
            end = (begin + min(steps, MOST_PLAYED_S * STEPS_PER_S)) // STEPS_PER_FRAME
            for frame in range(begin // STEPS_PER_FRAME + 1, end + 1):
                self.note(replace(sample, time_s=frame / FRAMES_PER_S))

    def _shot(self) -> Callable[[], Image]:
        assert self.camera is not None
        skill = f"{self.step}. {self.skill}" if self.skill else ""
        caption = caption_of(skill, self.runner.log.phase_now, self._now_s)
        return self.camera.shot(self.world, self.arm, caption)

    def _every_step(self) -> None:
        steps = self.world.steps + self.held
        if self.film and self.camera and steps >= self.shown * self.every:
            self.film.add(self._shot())
            self.shown += 1
        if self.note is not None and steps % STEPS_PER_FRAME == 0:
            self.note(self._sample())

    def _sample(self) -> Sample:
        assert self.arm.wanted is not None
        # Of the joints of this very moment: an engine's own frames may be those of a step before.
        joints = self.arm.joints_rad()
        x, y, z = self.arm.kinematics.tip(np.array(joints)).position.tolist()
        a, b, c = self.arm.wanted.position.tolist()
        known = {body.name for body in self.task.scene.bodies}
        return Sample(
            self._now_s,
            self.skill,
            self.runner.log.phase_now,
            (x, y, z),
            (a, b, c),
            joints,
            self.arm.jaw_width_m(),
            self.runner.log.unexpected_n(),
            {name: self.world.pose(name) for name in self.world.bodies if name in known},
            self.runner.log.contacts(),
        )

    def _arrivals(self, state: State) -> list[Arrival]:
        held = self.runner.carried
        found: list[Arrival] = []
        if not self.world.is_sane():
            return found
        for name, goal in self.task.scene.at(state).items():
            if name in self.world.numbers and name != held:
                final: Pose = self.world.pose(name)
                found.append(
                    Arrival(name, goal, final, offset_m(final, goal), tilt_rad(final, goal))
                )
        return found

    def _extent(self) -> list[Point]:
        """Return corners about the arm, all places of parts, and the hand that carries them [m]."""
        corners = [
            corner
            for body in self.task.scene.bodies
            for placement in body.placements
            if placement.frame == WORLD and placement.solid
            for box in world_boxes(body, placement.pose)
            for corner in product(*zip(box.low, box.high, strict=True))
        ]
        low_m = self.robot.safe_height_m
        for x_m, y_m, _ in self.robot.places.values():
            corners += [(x_m, y_m, 0.0), (x_m, y_m, low_m + _HAND_M)]
        x_m, y_m, z_m = self.robot.base
        corners += [(x_m, y_m, z_m), (x_m, y_m, z_m + _ARM_M)]
        return [(x, y, z) for x, y, z in corners]
