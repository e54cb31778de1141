"""Execution of one skill in a fresh world with its surroundings, and the record of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillplan.physics.linear_motions import LinearMotion, choose_opening_m, choose_visit_grasp
from skillplan.task.motion import Event, GraspKind, Point, Visit
from skillplan.task.pose import Pose, plus
from skillplan.task.scene import WORLD, Robot
from skillplan.task.shape import Mesh
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_pinocchio.tight_fits import Insertion, measure_insertion
from skillplan_simulation.execution.contact_log import ContactLog, Guides
from skillplan_simulation.execution.controlled_robot import StuckError
from skillplan_simulation.execution.fastenings import Fastenings
from skillplan_simulation.execution.planned_paths import PlannedPaths, PlannedSkill
from skillplan_simulation.execution.skill_runner import SkillRunner
from skillplan_simulation.execution.surroundings import Located, Neighbourhood, Surroundings
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import UnreachableError
from skillplan_simulation.record import Record
from skillplan_simulation.robot_shapes import get_hand
from skillplan_simulation.round_bodies import undo_spin
from skillplan_simulation.simulator import (
    GRAVITY_M_PER_S2,
    STEP_S,
    TABLE,
    Arm,
    Simulator,
    UpsetError,
    World,
)
from skillplan_simulation.verdicts import CLEARANCE_MM, FRAMES, average_frames

# Motion of a body within `_STEPS` simulation steps above which it does not stay [m].
_FALLEN_M = 0.001
_STEPS = 48


@dataclass(frozen=True, slots=True)
class Fallen:
    """A body that did not stay."""

    body: str
    reason: str
    present: State
    absent: State


class SupportTrials:
    """Tests in small worlds whether bodies stay in place; caches the results."""

    def __init__(self, task: Task, surroundings: Surroundings, world: Callable[[], World]) -> None:
        self.task, self.surroundings, self.world = task, surroundings, world
        self.fastenings = Fastenings(task)
        self._known: dict[tuple[str, int], float] = {}

    def fallen(self, around: Neighbourhood, state: State) -> Fallen | None:
        """Return the first body of a neighbourhood that does not stay, or None.

        The result rests on its supports and on the bodies tested before it.
        """
        facts = self.task.facts
        present = absent = facts.none
        for body in around.near:
            if body.placement.fact not in state:
                absent |= state.find_missing(body.placement.fact)
                continue
            name = body.body.name
            beneath = self.surroundings.support(body, state)
            names = {other.body.name for other in beneath.bodies}
            beneath = beneath.resting_on(*self.fastenings.basis(names, state))
            present |= beneath.present
            absent |= beneath.absent
            moved_m = self._moved_m(body, beneath, state)
            if moved_m > _FALLEN_M:
                below = [other.body.name for other in beneath.bodies if other is not body]
                on = f"does not stay on {', '.join(below)}" if below else "has nothing beneath it"
                return Fallen(
                    name, f"{name} {on}: it falls before the robot has moved", present, absent
                )
        return None

    def _moved_m(self, body: Located, beneath: Neighbourhood, state: State) -> float:
        if body.body.fixed or body.body.name in self.fastenings.list_still(state):
            return 0.0
        is_simple = (
            body.is_boxy
            and len(body.body.shapes) == 1
            and not isinstance(body.body.shapes[0], Mesh)
        )
        if is_simple and self.surroundings.stands_on_table(body) and len(beneath.bodies) == 1:
            return 0.0
        key = (body.body.name, beneath.present.bits)
        if key not in self._known:
            with self.world() as world:
                for other in beneath.bodies:
                    world.add(other.body, other.placement.pose, stands=other is not body)
                there = ((other.body.name, other.placement) for other in beneath.bodies)
                self.fastenings.fasten(world, there, state)
                for _ in range(_STEPS):
                    world.step()
                if not world.is_sane():
                    self._known[key] = math.inf
                    return math.inf
                now = np.array(world.pose(body.body.name).position)
                away = now - np.array(body.placement.pose.position)
                self._known[key] = length(away)
        return self._known[key]


# Overlap on an insertion that is rounding, and clearance from which bodies do not guide a part [m].
_LEAST_OVERLAP_M, _LOOSE_M = 1e-5, CLEARANCE_MM / 1e3 - 1e-5


class GuideSearch:
    """Finds the bodies that guide parts into place; caches the results."""

    def __init__(self, task: Task) -> None:
        self._bodies = {body.name: body for body in task.scene.bodies}
        self._known: dict[tuple[str, Pose, Point, str, Pose], Insertion | None] = {}

    def of(self, motions: Sequence[LinearMotion], state: State) -> dict[str, Guides]:
        """Return the guides of the parts that a skill puts into place.

        A body guides a part if the part lies next to it at the end and passes it on its way.
        """
        guides = {}
        for visit in (motion.visit for motion in motions):
            if visit.event not in (Event.RELEASE, Event.DRIVE):
                continue
            lengths_m = {}
            given = self._bodies[visit.subject].fits if visit.is_fitted else ()
            fits = {fit.into: fit for fit in given if fit.kind}
            for other in self._bodies.values():
                placement = other.placement(state)
                is_there = placement is not None and placement.solid and placement.frame == WORLD
                if placement is None or not is_there or other.name == visit.subject:
                    continue
                insertion = self._measure(visit, other.name, placement.pose)
                if insertion is None:
                    continue
                is_beside = -_LEAST_OVERLAP_M < insertion.clearance_m < _LOOSE_M
                # Pieces have the play of a fit on one of the two.
                is_fit = any(
                    fit.into == {visit.subject: other.name}.get(body.name, visit.subject)
                    for body in (self._bodies[visit.subject], other)
                    for fit in body.fits
                )
                if is_beside or is_fit:
                    lengths_m[other.name] = insertion.length_m
            if lengths_m:
                seat_m = visit.pose.position
                stated = tuple(fit for into, fit in fits.items() if into in lengths_m)
                guides[visit.subject] = Guides(
                    visit.subject, seat_m, visit.along, lengths_m, stated
                )
        return guides

    def _measure(self, visit: Visit, other: str, pose: Pose) -> Insertion | None:
        key = (visit.subject, visit.pose, visit.along, other, pose)
        if key not in self._known:
            mover = self._bodies[visit.subject]
            self._known[key] = measure_insertion(
                mover, visit.pose, self._bodies[other], pose, visit.along
            )
        return self._known[key]


# Time for the world to come to rest before an execution, and after holders let go [s].
SETTLE_S = 0.1
RELEASE_S = 0.5


def _run_steps(world: World, duration_s: float) -> None:
    for _ in range(round(duration_s / STEP_S)):
        world.step()


class Workcell:
    """Executes skills of a task, each in its own world.

    Parameters
    ----------
    task
        Task with one robot.
    """

    def __init__(self, task: Task, settings: ExecutionSettings, simulator: Simulator) -> None:
        self.task, self.settings, self.simulator = task, settings, simulator
        self.robot: Robot = task.scene.robots[0]
        self.surroundings = Surroundings(task, settings.clearance_m, settings.press_travel_m)
        self.paths = PlannedPaths(task, settings)
        self.fastenings = Fastenings(task)
        self.guides = GuideSearch(task)
        self.supports = SupportTrials(task, self.surroundings, simulator.world)

    def execute(
        self, skill: Skill, state: State, watch: Callable[[SkillRunner], None] | None = None
    ) -> Record:
        """Execute a skill in a state in which it is applicable.

        Parameters
        ----------
        watch
            Called with the robot after every simulation step.
        """
        if skill.motion is None:
            return self._execute_release(skill, state)
        none = self.task.facts.none
        try:
            planned = self.paths.of(skill, state)
        except UnreachableError as error:
            route = self._route_facts(skill, state)
            return self._draft(skill, route, none, unreachable=str(error))
        if planned.unfound is not None:
            place = self.task.facts.of(self.robot.place(state)[0])
            present = self._route_facts(skill, state) | planned.present | place
            return self._draft(skill, present, planned.absent, upset=planned.unfound)
        around = self._around(skill, state, planned)
        # Reachability comes first, because it does not depend on bodies.
        fallen = self.supports.fallen(around, state)
        if fallen is not None and watch is None:
            basis = self._rests_on(skill, state, planned)
            present, absent = fallen.present | basis[0], fallen.absent | basis[1]
            return self._draft(skill, present, absent, unsettled=fallen.reason)
        first = planned.motions[0]
        hand = get_hand(self.robot, first.motion.tool)
        world, arm = self.simulator.cell(hand)
        with world:
            start = planned.begin_rad if planned.travels_first else first.approach[0]
            arm.stand(start, self._first_opening(first.motion))
            try:
                return self._run(skill, state, planned, world, arm, around, watch)
            except UnreachableError as error:
                basis = around.present, around.absent
                return self._draft(skill, *basis, unreachable=str(error))
            except (UpsetError, np.linalg.LinAlgError) as error:
                return self._draft(skill, around.present, around.absent, upset=str(error))

    def frees(self, skill: Skill, state: State) -> bool:
        """Return whether a skill without motion lets a holder go."""
        return bool(self.fastenings.find_rearrangement(skill, state).freed)

    def _execute_release(self, skill: Skill, state: State) -> Record:
        """Let holders go in a world without the arm; what they held must stand."""
        change = self.fastenings.find_rearrangement(skill, state)
        around = self.surroundings.around_released(change.freed, state)
        names = {body.body.name for body in around.bodies}
        around = around.resting_on(*self.fastenings.basis(names, state))
        record = self._draft(skill, around.present, around.absent)
        with self.simulator.world() as world:
            for body in around.bodies:
                world.add(body.body, body.placement.pose)
            there = [(body.body.name, body.placement) for body in around.bodies]
            self.fastenings.fasten(world, there, state)
            _run_steps(world, SETTLE_S)
            stood = {name: world.pose(name) for name in world.bodies}
            for name in change.freed:
                if name in names:
                    world.unfasten(name, TABLE)
            _run_steps(world, RELEASE_S)
            if not world.is_sane():
                return replace(record, upset="the simulation blew up")
            final = {name: world.pose(name) for name in world.bodies}
            return replace(record, final=final, expected=stood, steps=world.steps)

    def begin(self, runner: SkillRunner, skill: Skill, planned: PlannedSkill, state: State) -> None:
        """Let a robot begin a skill with a motion."""
        plain = [motion.motion for motion in planned.motions]
        runner.begin(
            planned.motions,
            state,
            self.guides.of(plain, state),
            turn=self.fastenings.find_turn(skill, state),
            held=set(self.task.scene.list_held(state)),
        )

    def around(self, skill: Skill, state: State) -> Neighbourhood:
        """Return the neighbourhood of an execution, and all facts that it rests on.

        Raises
        ------
        UnreachableError
            If the arm cannot follow the skill's motion.
        """
        return self._around(skill, state, self.paths.of(skill, state))

    def _around(self, skill: Skill, state: State, planned: PlannedSkill) -> Neighbourhood:
        turn = self.fastenings.find_turn(skill, state)
        neighbourhood = self.surroundings.around(skill, planned.motions, state, turn)
        names = {body.body.name for body in neighbourhood.bodies}
        neighbourhood = neighbourhood.resting_on(*self.fastenings.basis(names, state))
        return neighbourhood.resting_on(*self._rests_on(skill, state, planned))

    def _rests_on(self, skill: Skill, state: State, planned: PlannedSkill) -> tuple[State, State]:
        """Return the facts that decide the joint paths, by their truth."""
        facts = self._route_facts(skill, state) | planned.present
        if planned.travels_first:
            facts |= self.task.facts.of(self.robot.place(state)[0])
        return facts, planned.absent

    def _route_facts(self, skill: Skill, state: State) -> State:
        """Return the facts that decide the route."""
        assert skill.motion is not None
        routes = skill.motion.routes
        if len(routes) == 1:
            return self.task.facts.none
        return next(r.when for r in routes if state.bits & r.when.bits == r.when.bits)

    def _run(
        self,
        skill: Skill,
        state: State,
        planned: PlannedSkill,
        world: World,
        arm: Arm,
        around: Neighbourhood,
        watch: Callable[[SkillRunner], None] | None,
    ) -> Record:
        """Execute the motions of a skill and return the record.

        Parameters
        ----------
        arm
            Arm at rest at the start.
        watch
            Called with the robot after every simulation step.
        """
        scene = self.task.scene
        plain = [motion.motion for motion in planned.motions]
        handled = {motion.visit.subject for motion in plain}
        for body in around.bodies:
            stands = body.body.name not in handled
            world.add(body.body, body.placement.pose, stands=stands)
        there = ((body.body.name, body.placement) for body in around.bodies)
        self.fastenings.fasten(world, there, state)
        first = plain[0]
        runner = SkillRunner(world, arm, scene, self.settings, first.tool)
        if watch is not None:
            runner.every_step = lambda: watch(runner)
        stopped = None
        try:
            if first.visit.event is Event.RELEASE:
                runner.take(planned.motions[0])
            else:
                runner.bring_out(first.visit.subject, state)
            runner.wait(SETTLE_S)
            self.begin(runner, skill, planned, state)
            for index, motion in enumerate(planned.motions):
                if index or planned.travels_first:
                    runner.travel(motion)
                runner.run(motion)
        except StuckError:
            stopped = runner.log.phase_now or "its way before anything was done"
        self._sense(runner, plain[-1], stopped)
        basis = around.present, around.absent
        record = self._record(skill, state, plain[-1], basis, runner)
        return replace(record, travels=planned.travels)

    def _first_opening(self, motion: LinearMotion) -> float:
        hand = get_hand(self.robot, motion.tool)
        if motion.visit.event not in (Event.GRASP, Event.RELEASE):
            return hand.opening_m / 2
        grasp = choose_visit_grasp(self.task.scene.body(motion.visit.subject), motion.visit)
        return choose_opening_m(grasp, self.settings.clearance_m, motion.tool, hand)

    def _sense(self, runner: SkillRunner, last: LinearMotion, stopped: str | None) -> None:
        sensed = runner.sensed
        if stopped is not None:
            sensed["stuck_on"] = stopped
        if runner.log.resistance_n:
            resistance_n = average_frames(np.array(runner.log.resistance_n), FRAMES)
            sensed["insertion_force_n"] = float(resistance_n.max())
        event = last.visit.event
        if event in (Event.GRASP, Event.RELEASE):
            grasp = choose_visit_grasp(self.task.scene.body(last.visit.subject), last.visit)
            if grasp.kind is GraspKind.JAWS:
                sensed["jaw_width_m"] = runner.arm.jaw_width_m()

    def record_of(
        self,
        skill: Skill,
        state: State,
        planned: PlannedSkill | None,
        runner: SkillRunner,
        begin_s: float,
    ) -> Record:
        """Return the record of a skill that was just executed in a larger world.

        Bodies that it does not handle are expected where they were when the skill began, and a
        placed part where it belongs on them: earlier skills account for their error.
        """
        last = None if planned is None else planned.motions[-1].motion
        if last is not None:
            self._sense(runner, last, None)
        none = self.task.facts.none
        record = self._record(skill, state, last, (none, none), runner)
        stood = runner.log.stood | runner.due
        return replace(
            record,
            # A part in the hand does not move in a skill without motion.
            expected={
                name: stood.get(name, pose)
                for name, pose in record.expected.items()
                if planned is not None or name in stood
            },
            begin_s=begin_s,
            pauses=tuple(runner.log.pauses),
            travels=() if planned is None else planned.travels,
            carried=() if last is None else _find_goals(last.visit, record, runner.log),
        )

    def _record(
        self,
        skill: Skill,
        state: State,
        last: LinearMotion | None,
        basis: tuple[State, State],
        runner: SkillRunner,
    ) -> Record:
        world, log = runner.world, runner.log
        scene = self.task.scene
        known = [name for name in world.bodies if any(b.name == name for b in scene.bodies)]
        final = {name: world.pose(name) for name in known}
        expected = self._expected(skill, state, last, known)
        for name, pose in expected.items():
            final[name] = undo_spin(scene.body(name), final[name], pose)
        return Record(
            skill.name,
            *basis,
            tuple(log.phases),
            # A fixed body shows no weight.
            {
                name: np.array(log.forces.get(name, [])).reshape(-1, 3)
                for name in known
                if name not in world.fixed
            },
            {name: world.mass_kg(name) * GRAVITY_M_PER_S2 for name in known},
            {pair: np.array(values) for pair, values in sorted(log.pairs.items())},
            {name: np.array(values) for name, values in log.moved.items() if name in known},
            final,
            expected,
            runner.sensed,
            steps=world.steps,
            beside=frozenset(log.beside),
        )

    def _expected(
        self, skill: Skill, state: State, last: LinearMotion | None, names: Sequence[str]
    ) -> dict[str, Pose]:
        """Return the predicted poses; a held part is expected above the place of its grasp."""
        after = skill.prediction_in(state).apply(state)
        poses = self.task.scene.at(after)
        if last is not None and last.visit.event is Event.GRASP:
            lifted = plus(last.ends_at, last.grasp_tip, -1.0)
            poses[last.visit.subject] = last.visit.pose.moved(lifted)
        return {name: poses[name] for name in names if name in poses}

    def _draft(
        self,
        skill: Skill,
        present: State,
        absent: State,
        *,
        unreachable: str | None = None,
        unsettled: str | None = None,
        upset: str | None = None,
    ) -> Record:
        return Record(
            skill.name,
            present,
            absent,
            (),
            {},
            {},
            {},
            {},
            {},
            {},
            unreachable=unreachable,
            unsettled=unsettled,
            upset=upset,
        )


def _find_goals(visit: Visit, record: Record, log: ContactLog) -> tuple[Pose, ...]:
    """Return the goals of a placed part on the bodies that it touches, where these stand."""
    goal = record.expected.get(visit.subject)
    if goal is None or visit.event is not Event.RELEASE:
        return ()
    touching = {name for pair in log.last_pairs if visit.subject in pair for name in pair}
    return tuple(
        log.stood[name].then(record.expected[name].inverse()).then(goal)
        for name in sorted(touching & log.stood.keys() & record.expected.keys())
    )
