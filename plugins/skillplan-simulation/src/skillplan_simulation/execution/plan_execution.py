"""Execution of a whole plan in one continuous world, with films and pictures of failures."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from types import TracebackType
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from skillplan.collision.boxes import world_boxes
from skillplan.physics.linear_motions import plan_linear_motions
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
from skillplan.task.motion import Event, Point
from skillplan.task.scene import WORLD, Pose
from skillplan.task.skill import FeederClock, Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict
from skillplan_simulation.execution.contact_log import STEPS_PER_FRAME
from skillplan_simulation.execution.controlled_robot import StuckError
from skillplan_simulation.execution.planned_paths import PlannedSkill
from skillplan_simulation.execution.skill_runner import SkillRunner
from skillplan_simulation.execution.workcell import SETTLE_S, Workcell
from skillplan_simulation.kinematics import UnreachableError
from skillplan_simulation.record import FRAMES_PER_S, Record
from skillplan_simulation.robot_shapes import get_hand
from skillplan_simulation.round_bodies import undo_spin
from skillplan_simulation.simulator import STEPS_PER_S, Arm, UpsetError, World
from skillplan_simulation.verdicts import (
    Judge,
    Tolerances,
    check_postcondition,
    find_collision,
    list_moved,
    measure_offset_m,
    measure_tilt_rad,
)

if TYPE_CHECKING:
    from skillplan_simulation.pictures.painted_camera import PaintedCamera


T = TypeVar("T")
Shot = Callable[[], Image]

# Maximum length of a queue; then the simulation waits.
_MOST_WAITING = 8


class Film:
    """Renders pictures on one thread and shows them on another; a context manager.

    Errors are raised at the next picture, or at the end.

    Parameters
    ----------
    show
        Called with every picture, in order.
    """

    def __init__(self, show: Callable[[Image], None]) -> None:
        self._shown = _Stage(show)
        self._made: _Stage[Shot] = _Stage(lambda shot: self._shown.add(shot()))

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Wait for the last picture."""
        self._made.end()
        self._shown.end()
        if error is None:
            self._made.raise_error()
            self._shown.raise_error()

    def add(self, shot: Shot) -> None:
        """Queue a picture."""
        self._made.add(shot)


class _Stage(Generic[T]):
    """A worker thread that processes a queue."""

    def __init__(self, work: Callable[[T], None]) -> None:
        self._work = work
        self._waiting: queue.Queue[T | None] = queue.Queue(_MOST_WAITING)
        self._wrong: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, item: T) -> None:
        """Queue an item; raise earlier errors."""
        self.raise_error()
        self._waiting.put(item)

    def end(self) -> None:
        """Wait until the queue is empty."""
        self._waiting.put(None)
        self._thread.join()

    def raise_error(self) -> None:
        """Raise an error of the worker, once."""
        if self._wrong is not None:
            wrong, self._wrong = self._wrong, None
            raise wrong

    def _run(self) -> None:
        is_failed = False
        while (item := self._waiting.get()) is not None:
            if not is_failed:
                try:
                    self._work(item)
                except BaseException as error:  # raised again in the thread of the simulation
                    self._wrong, is_failed = error, True


# Frame in which unsupported bodies are shown as they fall.
_FALLING_FRAMES = 4


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame of an execution, and the bodies to highlight.

    Parameters
    ----------
    frame
        Number of the frame; None for the end.
    """

    frame: int | None
    bodies: tuple[str, ...]


def format_caption(skill: str, phase: str, time_s: float) -> str:
    """Return the caption of a picture: skill, phase and time."""
    return "   ".join(word for word in (skill, phase, f"{time_s:.2f} s") if word)


class _Taken(Exception):
    """Ends an execution whose picture is taken."""


def find_failure(record: Record, judges: Sequence[Judge]) -> Moment:
    """Return the frame of the first collision, displacement or entry of a zone, or the end."""
    collision = find_collision(record, judges)
    if collision is None:
        return Moment(record.sensed.get("in_zone_frame"), ())
    evidence = collision.evidence
    return Moment(round(evidence["at_s"] * FRAMES_PER_S), tuple(evidence["bodies"]))


def take_picture(
    workcell: Workcell, skill: Skill, state: State, judges: Sequence[Judge], *, blamed: bool = False
) -> Image:
    """Return a picture of the moment at which a skill fails, or of its end.

    Colliding bodies are red and orange, everything else is pale. If none collide and the skill is
    to blame, the handled bodies are highlighted.

    Raises
    ------
    ValueError
        If there is no picture because the arm cannot follow the motion.
    """
    record = workcell.execute(skill, state)
    moment = find_failure(record, judges)
    culprits = moment.bodies
    if blamed and not culprits and skill.motion is not None:
        culprits = tuple(visit.subject for visit in skill.motion.visits(state))
        if workcell.fastenings.find_turn(skill, state) is not None:
            culprits = list_moved(record)
    frame = _FALLING_FRAMES if record.unsettled is not None else moment.frame
    camera = _make_camera(workcell, skill, state)
    taken: list[Image] = []

    def caption(runner: SkillRunner) -> str:
        return format_caption(skill.name, runner.log.phase_now, runner.world.steps / STEPS_PER_S)

    def watch(runner: SkillRunner) -> None:
        if runner.log.phases and frame is not None and runner.log.frames > frame:
            taken.append(camera.shot(runner.world, runner.arm, caption(runner), culprits)())
            raise _Taken
        if frame is None and runner.world.steps == record.steps:
            taken.append(camera.shot(runner.world, runner.arm, caption(runner), culprits)())

    try:
        workcell.execute(skill, state, watch)
    except _Taken:
        return taken[0]
    if not taken:
        raise ValueError(record.unreachable or "the execution has no such moment")
    return taken[0]


def film_skill(
    workcell: Workcell, skill: Skill, state: State, frames_per_s: float
) -> Iterator[Image]:
    """Yield pictures of a skill at a rate per simulated second.

    Raises
    ------
    ValueError
        If the rate is not in (0, 60].
    """
    if not 0 < frames_per_s <= FRAMES_PER_S:
        raise ValueError(f"There are 0 to {FRAMES_PER_S} pictures a second, not {frames_per_s}.")
    camera = _make_camera(workcell, skill, state)
    every = STEPS_PER_S / frames_per_s
    taken: list[Image] = []

    def watch(runner: SkillRunner) -> None:
        if runner.world.steps >= len(taken) * every:
            time_s = runner.world.steps / STEPS_PER_S
            caption = format_caption(skill.name, runner.log.phase_now, time_s)
            taken.append(camera.shot(runner.world, runner.arm, caption)())

    workcell.execute(skill, state, watch)
    yield from taken


def _make_camera(workcell: Workcell, skill: Skill, state: State) -> PaintedCamera:
    motions = plan_linear_motions(workcell.task, skill, state, workcell.settings.drop_height_m)
    turn = workcell.fastenings.find_turn(skill, state)
    x_m, y_m, z_m = motions[-1].tip if turn is None else turn.pivot.position
    view = View.close_up((x_m, y_m, z_m + 0.05))
    # An execution without pictures does not load the painter.
    from skillplan_simulation.pictures.painted_camera import PaintedCamera

    return PaintedCamera(workcell.task.scene, view)


# Height of the visible part of the hand above its tip [m].
_HAND_M = 0.15
# Height of the visible part of the arm above its base [m].
_ARM_M = 0.8


@dataclass(frozen=True, slots=True)
class Rules:
    """Requirements on every skill.

    Parameters
    ----------
    judges
        Detectors that decide about contacts.
    """

    tolerances: Tolerances
    judges: tuple[Judge, ...]


@dataclass(frozen=True, slots=True)
class Observers:
    """Outputs of an execution.

    Parameters
    ----------
    frames_per_s
        Pictures per simulated second [1/s], or None.
    note
        Called with a sample of every frame of 1/60 s.
    angle
        View angle. Default: one at which the arm hides least.
    labels
        True if bodies have name tags.
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
    *,
    keeps_going: bool = False,
) -> Performance:
    """Execute a plan without a break; see :meth:`skillplan.physics.performance.Performer`.

    Parameters
    ----------
    stopped
        Returns whether to end before the next skill.
    """
    robot = workcell.robot
    hand = get_hand(robot, robot.tool(workcell.task.initial))
    world, arm = workcell.simulator.cell(hand)
    with world, ExitStack() as stack:
        film = None
        if observers.frames_per_s and observers.show is not None:
            film = stack.enter_context(Film(observers.show))
        execution = _PlanExecution(
            workcell, rules, world, arm, observers, film, keeps_going=keeps_going
        )
        return execution.play(skills, stopped)


# Events that handle a part.
_HANDLING = (Event.GRASP, Event.RELEASE, Event.FETCH, Event.DRIVE)


def _list_parts(skill: Skill, state: State) -> list[str]:
    """Return the parts that a skill handles in a state."""
    visits = () if skill.motion is None else skill.motion.visits(state)
    return list(dict.fromkeys(visit.subject for visit in visits if visit.event in _HANDLING))


class _PlanExecution:
    def __init__(
        self,
        workcell: Workcell,
        rules: Rules,
        world: World,
        arm: Arm,
        observers: Observers,
        film: Film | None,
        *,
        keeps_going: bool,
    ) -> None:
        self.workcell, self.rules, self.world = workcell, rules, world
        self.keeps_going = keeps_going
        self.film, self.note = film, observers.note
        self.task = workcell.task
        self.robot = self.task.scene.robots[0]
        self.arm = arm
        self.every = STEPS_PER_S / (observers.frames_per_s or STEPS_PER_S)
        self.shown = 0
        # Steps of dwells at rest, which are counted but not simulated.
        self.held = 0
        # Steps that the arm has waited for the part of the current skill.
        self.waited = 0
        self.skill = ""
        self.step = 0
        # Parts that were taken away, with the skills that failed.
        self.taken_away: dict[str, str] = {}
        self.feeders = FeederClock()
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
            failed = tuple(PerformedSkill(skill.name, verdict, 0.0, 0.0) for skill in skills[:1])
            return Performance(failed, (), 0.0, 0)
        for body in self.task.scene.bodies:
            placement = body.placement(state)
            if placement is not None and placement.solid:
                self.world.add(body, placement.pose, stands=True)
                self.workcell.fastenings.fasten(self.world, [(body.name, placement)], state)
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
            # The first skill reports an arm that is blocked from the start.
            runner.wait(SETTLE_S)
        done: list[PerformedSkill] = []
        for skill in skills:
            if done and stopped():
                break
            self.skill = skill.name
            self.step += 1
            begin_s, runner.acting_steps, self.waited = self._now_s, 0, 0
            verdict, state, goes_on = self._perform(skill, state)
            acting_s = runner.acting_steps / STEPS_PER_S
            waited_s = self.waited / STEPS_PER_S
            done.append(
                PerformedSkill(skill.name, verdict, begin_s, self._now_s, acting_s, waited_s)
            )
            if not goes_on:
                break
        return Performance(
            tuple(done),
            tuple(self._arrivals(state)),
            self._now_s,
            self.world.steps,
            held_s=self.held / STEPS_PER_S,
            pace=self.workcell.settings.pace,
            taken_away=tuple(self.taken_away),
        )

    def _perform(self, skill: Skill, state: State) -> tuple[Verdict, State, bool]:
        """Return the verdict on a skill, the state after it, and whether the plan goes on.

        A part that failed is taken away, as by hand, and the arm goes on from the end of the skill.
        """
        parts, none = _list_parts(skill, state), self.task.facts.none
        needed = [*parts, *skill.parameters.values()]
        lost = [part for part in needed if part in self.taken_away]
        if lost:
            reason = f"{lost[0]} was taken away after {self.taken_away[lost[0]]}"
            after = skill.prediction_in(state).apply(state)
            return Verdict.infeasible(reason, none, none), self._leave_out(parts, after), True
        verdict = self._execute(skill, state)
        if self.taken_away and not skill.applicable(state):
            return verdict, state, True
        after = skill.prediction_in(state).apply(state)
        if verdict.is_feasible or not (self.keeps_going and parts and self.world.is_sane()):
            return verdict, after, verdict.is_feasible
        for part in parts:
            self.taken_away[part] = skill.name
            self.runner.give_up(part)
        self.runner.stand_again(self.here_rad)
        return verdict, self._leave_out(parts, after), True

    def _leave_out(self, parts: Sequence[str], state: State) -> State:
        """Return a state without parts at their goals."""
        goals = self.task.operations
        return state - self.task.facts.of(*(goals[part] for part in parts if part in goals))

    def _execute(self, skill: Skill, state: State) -> Verdict:
        facts = self.task.facts
        if not skill.applicable(state):
            missing = skill.why_not(state)
            return Verdict.infeasible(
                f"needs {', '.join(missing.requires)}", facts.none, facts.none
            )
        runner = self.runner
        if skill.motion is None:
            return self._rearrange(skill, state)
        try:
            planned = self.workcell.paths.of(skill, state, self.here_rad)
        except UnreachableError as error:
            return Verdict.infeasible(str(error), facts.none, facts.none)
        if planned.unfound is not None:
            return Verdict.unknown(planned.unfound)
        self._await(skill, skill.compute_wait_s(self._now_s))
        self.workcell.begin(runner, skill, planned, state)
        # Frames of the log correspond to rows of the trace.
        begin_s = ((self.world.steps + self.held) // STEPS_PER_FRAME + 1) / FRAMES_PER_S
        try:
            for number, motion in enumerate(planned.motions):
                runner.travel(motion)
                if number == 0:
                    self._await(skill, self.feeders.present(skill, self._now_s))
                runner.run(motion)
        except (UpsetError, np.linalg.LinAlgError) as error:
            return Verdict.unknown(str(error))
        except UnreachableError as error:
            return Verdict.infeasible(str(error), facts.none, facts.none)
        except StuckError:
            runner.sensed["stuck_on"] = runner.log.phase_now
        finally:
            self.here_rad = planned.motions[-1].retreat[-1]
        return self._sensed(skill, state, planned, begin_s)

    def _rearrange(self, skill: Skill, state: State) -> Verdict:
        """Execute a skill without motion: holders close and open, parts are joined."""
        self._await(skill, skill.compute_wait_s(self._now_s))
        runner, begin = self.runner, self.world.steps + self.held
        begin_s = (begin // STEPS_PER_FRAME + 1) / FRAMES_PER_S
        change = self.workcell.fastenings.find_rearrangement(skill, state)
        try:
            runner.rearrange(change, skill.name)
        except UpsetError as error:
            return Verdict.unknown(str(error))
        except StuckError:
            runner.sensed["stuck_on"] = skill.name
        steps = round(skill.duration_s.at(state) * STEPS_PER_S) - (
            self.world.steps + self.held - begin
        )
        self._dwell(STEPS_PER_FRAME * max(0, round(steps / STEPS_PER_FRAME)))
        return self._sensed(skill, state, None, begin_s)

    def _sensed(
        self, skill: Skill, state: State, planned: PlannedSkill | None, begin_s: float
    ) -> Verdict:
        """Return the verdict of a search: a collision takes precedence over its consequences."""
        record = self.workcell.record_of(skill, state, planned, self.runner, begin_s)
        verdict = check_postcondition(skill, record, self.rules.tolerances)
        collision = find_collision(record, self.rules.judges)
        if collision is None:
            return verdict
        evidence = {**verdict.evidence, **collision.evidence}
        return Verdict.infeasible(collision.reason, evidence=evidence)

    @property
    def _now_s(self) -> float:
        return (self.world.steps + self.held) / STEPS_PER_S

    def _await(self, skill: Skill, wait_s: float) -> None:
        """Let the arm rest until the part of a skill is there."""
        if wait_s:
            self.runner.log.phase(f"the wait for {skill.parameters.get('part', 'a part')}")
            # Whole frames keep the trace aligned with the log.
            steps = STEPS_PER_FRAME * math.ceil(wait_s * FRAMES_PER_S)
            self.waited += steps
            self._dwell(steps)

    def _dwell(self, steps: int) -> None:
        """Let time pass with arm and parts at rest: pictures and samples repeat."""
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
            # A dwell adds at most an hour of rows to a trace.
            end = (begin + min(steps, MOST_PLAYED_S * STEPS_PER_S)) // STEPS_PER_FRAME
            for frame in range(begin // STEPS_PER_FRAME + 1, end + 1):
                self.note(replace(sample, time_s=frame / FRAMES_PER_S))

    def _shot(self) -> Callable[[], Image]:
        assert self.camera is not None
        skill = f"{self.step}. {self.skill}" if self.skill else ""
        caption = format_caption(skill, self.runner.log.phase_now, self._now_s)
        return self.camera.shot(self.world, self.arm, caption)

    def _every_step(self) -> None:
        steps = self.world.steps + self.held
        if self.film and self.camera and steps >= self.shown * self.every:
            self.film.add(self._shot())
            self.shown += 1
        if self.note is not None and steps % STEPS_PER_FRAME == 0:
            self.note(self._sample())

    def _sample(self) -> Sample:
        assert self.arm.setpoint is not None
        # From the current joints: an engine's own frames may be one step old.
        joints = self.arm.joints_rad()
        x, y, z = self.arm.kinematics.tip(np.array(joints)).position.tolist()
        a, b, c = self.arm.setpoint.position.tolist()
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
        arrivals: list[Arrival] = []
        if not self.world.is_sane():
            return arrivals
        for name, goal in self.task.scene.at(state).items():
            if name in self.world.numbers and name != held:
                final: Pose = self.world.pose(name)
                unspun = undo_spin(self.task.scene.body(name), final, goal)
                arrivals.append(
                    Arrival(
                        name,
                        goal,
                        final,
                        measure_offset_m(unspun, goal),
                        measure_tilt_rad(unspun, goal),
                    )
                )
        return arrivals

    def _extent(self) -> list[Point]:
        """Return corners around the arm, the places of parts, and the hand [m]."""
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
