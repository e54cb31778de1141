"""Execution of approach-act-retreat motions in a simulated world, and of screw driving."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from skillplan.physics.linear_motions import (
    LinearMotion,
    choose_clearance_m,
    choose_opening_m,
    choose_visit_grasp,
)
from skillplan.task.motion import Event, Grasp, GraspKind, Point
from skillplan.task.pose import DOWN, Pose, is_same_direction, plus
from skillplan.task.scene import WORLD, Scene, Tool
from skillplan.task.state import State
from skillplan_pinocchio.kinematics.fixed_order import dot, times
from skillplan_simulation.execution.contact_log import STEPS_PER_FRAME, DrivenHead, Guides
from skillplan_simulation.execution.controlled_robot import ControlledRobot
from skillplan_simulation.execution.fastenings import (
    Rearrangement,
    Turn,
    fix_in_place,
    fix_joined,
    free_joined,
    list_fixed_to,
)
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import Vector, convert_quaternion, make_pose
from skillplan_simulation.motions import (
    PEAK_SPEED,
    ArmMotion,
    PathSection,
    PosturePath,
)
from skillplan_simulation.simulator import JAW_SPEED_M_PER_S, STEP_S, TABLE, Arm, World

# Distance from contact at which the search for a hole starts [m].
FEEL_FROM_M = 0.001

_FEEL_SPEED_M_PER_S = 0.01
_FELT_N = 0.2
_PRESS_S, _RELAX_S = 0.4, 0.05
_PRESS_SPEED_M_PER_S = 0.004
# Mass of a screw at the bit [kg]. With its own mass of a gram, pressing it between arm and
# workpiece would need more solver iterations.
_HELD_SCREW_KG = 0.1


def put_at_bit(robot: ControlledRobot, driven: LinearMotion, turned: Vector) -> None:
    """Put a screw at the bit, unless it is there already.

    Parameters
    ----------
    driven
        Motion that drives the screw, now or later.
    turned
        Rotation of the hand in that motion, shape (3, 3).
    """
    screw = driven.visit.subject
    if robot.carried == screw:
        return
    world, body, tip = robot.world, robot.scene.body(screw), robot.arm.tip()
    # The pose in the hand is that of the driven screw.
    in_hand = times(turned.T, convert_quaternion(driven.visit.pose.orientation))
    rotation = times(tip.rotation, in_hand)
    end = robot.tools.tool_tip() - body.height_m * rotation[:, 2]
    if screw in world.numbers:
        # It has stood in its tray.
        world.put(screw, make_pose(end, rotation))
    else:
        world.add(body, make_pose(end, rotation))
    world.weigh(screw, _HELD_SCREW_KG)
    robot.bind(screw)
    robot.carry(screw)


def drive(robot: ControlledRobot, motion: LinearMotion) -> None:
    """Search for the hole, press, measure the force over the last half, and release.

    Parameters
    ----------
    robot
        Robot with the screw at its bit, outside the hole.
    motion
        Motion that drives the screw; the screw touches at its tip.

    Raises
    ------
    StuckError
        If an obstacle blocks the arm.
    """
    world, arm, settings = robot.world, robot.arm, robot.settings
    assert arm.setpoint is not None
    screw, along = motion.visit.subject, np.array(motion.visit.along)
    drivers = {screw, *robot.tools.robot_parts}
    through = {name for name in (*world.bodies, TABLE) if name not in drivers}
    # The screw may touch anything; other contacts of the robot are unexpected.
    robot.log.free.add(screw)
    contact = np.array(motion.tip)
    widths_m = [min(box.size[:2]) for box in robot.scene.body(screw).boxes]
    robot.log.head = DrivenHead(
        screw,
        frozenset(robot.tools.robot_parts),
        contact,
        along,
        max(widths_m) / 2,
        settings.press_travel_m,
    )
    depth = dot(along, arm.setpoint.position - contact)
    while depth < settings.press_travel_m and robot.log.pressing_n({screw}, through) < _FELT_N:
        depth += _FEEL_SPEED_M_PER_S * STEP_S
        _hold(robot, contact + depth * along)
        robot.step()
    arm.press_n = settings.press_force_n * along
    readings = []
    steps = round(_PRESS_S / STEP_S)
    for step in range(steps):
        if settings.control == "osc":
            # The force is commanded, and the depth follows.
            depth = dot(along, arm.tip().position - contact)
        elif robot.log.pressing_n({screw}, through) < settings.press_force_n:
            depth += _PRESS_SPEED_M_PER_S * STEP_S
        _hold(robot, contact + depth * along)
        robot.step()
        if step >= steps // 2 and step % STEPS_PER_FRAME == 0:
            readings.append(robot.log.pressing_n({screw}, through))
    arm.press_n = np.zeros(3)
    robot.sensed["fastening_force_n"] = float(np.mean(readings))
    robot.unbind()
    holds_product = bool(robot.scene.workholders or robot.scene.holders)
    goes_down = is_same_direction(motion.visit.along, DOWN)
    if holds_product and goes_down:
        # Contacts give back the depth to which the head was pressed. Other screws would fall.
        robot.wait(_RELAX_S)
    if holds_product or not goes_down:
        # The thread holds the screw against gravity.
        bearing = world.nearest(screw, through)
        if bearing is not None:
            world.fasten(screw, bearing)
    if holds_product:
        fix_joined(world, robot.scene.body(screw))
    world.weigh(screw, robot.scene.body(screw).mass_kg)
    robot.carry(None)


def press(robot: ControlledRobot, motion: LinearMotion) -> None:
    """Feel the part, press with the force of a work, and measure it over the last half.

    Parameters
    ----------
    robot
        Robot with its tool shortly above the part.

    Raises
    ------
    StuckError
        If an obstacle blocks the arm.
    """
    world, arm, settings = robot.world, robot.arm, robot.settings
    assert arm.setpoint is not None
    along, force_n = np.array(motion.tool_points), motion.visit.press_n
    tools = set(robot.tools.robot_parts)
    parts = {name for name in (*world.bodies, TABLE) if name not in tools}
    robot.log.expected |= {(min(a, b), max(a, b)) for a in tools for b in parts}
    contact = np.array(motion.tip)
    depth = dot(along, arm.setpoint.position - contact)
    while depth < settings.press_travel_m and robot.log.pressing_n(tools, parts) < _FELT_N:
        depth += _FEEL_SPEED_M_PER_S * STEP_S
        _hold(robot, contact + depth * along)
        robot.step()
    arm.press_n = force_n * along
    readings = []
    steps = round(_PRESS_S / STEP_S)
    for step in range(steps):
        if settings.control == "osc":
            depth = dot(along, arm.tip().position - contact)
        elif robot.log.pressing_n(tools, parts) < force_n:
            depth += _PRESS_SPEED_M_PER_S * STEP_S
        _hold(robot, contact + depth * along)
        robot.step()
        if step >= steps // 2 and step % STEPS_PER_FRAME == 0:
            readings.append(robot.log.pressing_n(tools, parts))
    arm.press_n = np.zeros(3)
    robot.sensed["pressing_force_n"] = float(np.mean(readings))


def _hold(robot: ControlledRobot, position: Vector) -> None:
    """Set the target of the tip to a point at rest."""
    setpoint = robot.arm.setpoint
    assert setpoint is not None
    robot.arm.setpoint = replace(setpoint, position=position, velocity=np.zeros(3))


# Gap between the hand and a tool's dock, which is not a body [m].
_DOCK_GAP_M = 0.002
# Gap of a suction cup's lip [m].
_CUP_GAP_M = 0.0015
# Gap of a bit above a screw in its feeder; the magnet attracts the head [m].
_FETCH_GAP_M = 0.001
# Speed of a part that guides lead to its seat, and distance before them at which it slows down.
_INSERTION_M_PER_S, _BEFORE_MOUTH_M = 0.02, 0.002
# Mean speed along a path of a tool below which the rest of its time is spent at its end.
_LEAST_M_PER_S = 0.005
_GRIP_S = 0.35
_LET_GO_S = 0.35
_SUCTION_S = 0.05
# Speed at which a part goes down to its goal in a holder [m/s].
_LOWERING_M_PER_S = 0.01
# Time until the arm stands after that, and before a fit [s].
_SWING_S = 0.1
# Time in which bodies come to rest after a turn, or after holders have moved [s]; steps at the end
# of a turn in which the workholder stands.
_REST_S, _STILL_STEPS = 0.25, 12
# Tolerance for the position of jaws [m].
_JAWS_PLAY_M = 0.001


class SkillRunner(ControlledRobot):
    """A robot that executes skills motion by motion; see `ControlledRobot`.

    Parameters
    ----------
    dwell
        Called with the remaining simulation steps of a dwell after an action, >= 0. By default
        dwells are skipped, because no verdict depends on them.
    world, arm, scene, settings, tool, every_step
        See `ControlledRobot`.

    Attributes
    ----------
    acting_steps
        Simulation steps of actions at targets, dwells included.
    """

    def __init__(
        self,
        world: World,
        arm: Arm,
        scene: Scene,
        settings: ExecutionSettings,
        tool: Tool | None,
        every_step: Callable[[], None] = lambda: None,
        dwell: Callable[[int], None] = lambda steps: None,
    ) -> None:
        super().__init__(world, arm, scene, settings, tool, every_step)
        self._dwell = dwell
        self.acting_steps = 0
        # Constraints that hold parts in feeders.
        self._kept: dict[str, int] = {}
        # Motions of the current skill, and guides of its parts.
        self._motions: tuple[ArmMotion, ...] = ()
        self._guides: Mapping[str, Guides] = {}
        self._in_holders: Collection[str] = ()
        self._turn: Turn | None = None
        # Poses at which a turn must leave its bodies, and holders the parts that they let go.
        self.due: dict[str, Pose] = {}

    def begin(
        self,
        motions: Sequence[ArmMotion],
        state: State,
        guides: Mapping[str, Guides],
        *,
        turn: Turn | None = None,
        held: Collection[str] = (),
    ) -> None:
        """Present the parts of feeders that a skill takes, and start its contact log.

        Every execution of a skill starts here, alone or in a plan. Contacts at this moment are
        expected, so parts from feeders must be present already.

        Parameters
        ----------
        guides
            Guides of the parts that the skill puts into place, by name.
        turn
            The turn of the skill, or None.
        held
            Parts in holders, also if they are still to come.
        """
        self._motions, self._guides = tuple(motions), guides
        self.arm.yields = False
        self._turn, self._in_holders, self.due = turn, held, {}
        if motions:
            self.tools.activate(motions[0].motion.tool)
        handled = {planned.motion.visit.subject for planned in motions}
        for subject in sorted(handled):
            self.bring_out(subject, state)
        carried = set() if turn is None else turn.carried & self.world.numbers.keys()
        self.world.stand(handled | carried)
        self.watch(handled, carried)

    def rearrange(self, change: Rearrangement, label: str) -> None:
        """Close and open holders, or join parts to one, while the arm stands.

        Raises
        ------
        StuckError
            If a body pushes the arm away.
        """
        world = self.world
        shift = None
        if change.lead is not None:
            name, pose = change.lead
            shift = world.pose(name).then(pose.inverse())
        for name in change.vanishes:
            world.remove(name)
        for body, pose in change.appears:
            world.add(body, pose if shift is None else shift.then(pose))
        for name, part in change.passes:
            world.part(name, [part])
        for name in change.fixed:
            fix_in_place(world, name)
        self.due = {name: world.pose(name) for name in change.freed if name in world.numbers}
        in_hand = set() if self.carried is None else {self.carried}
        world.stand({*change.freed, *in_hand})
        self.watch(in_hand, change.freed)
        self.log.phase(label)
        self.log.free |= {*change.freed, *(body.name for body, _ in change.appears)}
        for name in change.freed:
            if (name, TABLE) in world.fastened:
                world.unfasten(name, TABLE)
        self.wait(_REST_S)

    def _run_turn(self, turn: Turn, duration_s: float) -> None:
        """Turn a workholder with the bodies fixed to it; others follow by contact."""
        world, start = self.world, turn.pivot
        fixed = list_fixed_to(world, turn.held & world.numbers.keys())
        self.log.free |= turn.carried - fixed
        end = turn.at(1.0)
        self.due = {
            name: end.then(world.pose(name)) for name in turn.carried & world.numbers.keys()
        }
        for name in fixed:
            if (name, TABLE) in world.fastened:
                world.unfasten(name, TABLE)
        world.carry(sorted(fixed), start)
        steps = max(1, round(duration_s / STEP_S))
        poses = (turn.at(step / steps).then(start) for step in range(steps + 1))
        for here, after in pairwise(poses):
            world.drive(here, after)
            self.step()
        for _ in range(_STILL_STEPS):
            world.drive(after, after)
            self.step()
        world.set_down()
        for name in sorted(turn.held & fixed):
            fix_in_place(world, name)
        self.wait(_REST_S)

    def bring_out(self, subject: str, state: State) -> None:
        """Present a part that is in a feeder; others stay in place."""
        body = next((body for body in self.scene.bodies if body.name == subject), None)
        placement = None if body is None else body.placement(state)
        if body is None or placement is None or placement.solid or placement.frame != WORLD:
            return
        if subject in self._kept:
            return
        if subject not in self.world.numbers:
            self.world.add(body, placement.pose)
        self.world.put(subject, placement.pose)
        # In a feeder, only the hand can touch the part.
        self.world.part(subject, self.world.others(subject))
        self._kept[subject] = self.world.hold(subject)

    def give_up(self, name: str) -> None:
        """Take a body out of the world, and out of the hand or the feeder that has it."""
        if name in self._kept:
            self.world.release(self._kept.pop(name))
        if self.carried == name:
            self.unbind()
            self.unclasp()
            self.carry(None)
        if name in self.world.numbers:
            self.world.remove(name)
            free_joined(self.world, self.scene.body(name), self.scene.bodies)

    def take(self, planned: ArmMotion) -> None:
        """Put the part that a motion releases into the hand, as if picked up before."""
        motion = planned.motion
        subject, visit = motion.visit.subject, motion.visit
        grasp = self._held(motion)
        tip = self.arm.tip()
        # The pose in the hand is that at the goal, except for the gap of a cup.
        turned = times(tip.rotation, planned.rotation.T)
        rotation = times(turned, convert_quaternion(visit.pose.orientation))
        away = np.array(grasp.tip)
        held_m = self.tools.tool_tip() + self._gap_m(motion) * self.tools.points()
        origin = held_m - times(rotation, away)
        if subject not in self.world.numbers:
            body = self.scene.body(subject)
            self.world.add(body, make_pose(origin, rotation))
        self.carry(subject)
        if grasp.kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.bind(subject)
            return
        helping = self.arm.grip(subject)
        self.arm.close(self._grip_force_n, outwards=grasp.is_inner)
        self.wait(self._jaws_s + _GRIP_S)
        self.world.release(helping)
        self.clasp(subject)

    def travel(self, planned: ArmMotion) -> None:
        """Travel to the start of a motion while the jaws open.

        Raises
        ------
        StuckError
            If an obstacle blocks the arm.
        """
        motion = planned.motion
        around = f" round {', '.join(planned.around)}" if planned.around else ""
        self.log.phase(f"the travel to {motion.visit.subject}{around}")
        if motion.visit.event is Event.GRASP and self._jaws_take_s(motion):
            self.arm.open(self._opening_for(motion))
        self.transfer(planned)

    def run(self, planned: ArmMotion) -> None:
        """Execute an approach-act-retreat motion from its start.

        Raises
        ------
        StuckError
            If an obstacle blocks the arm.
        """
        motion = planned.motion
        subject, event = motion.visit.subject, motion.visit.event
        if event is Event.DRIVE:
            put_at_bit(self, motion, planned.rotation)
        elif event is Event.GRASP:
            self.arm.open(self._opening_for(motion))
            # An earlier part may have left them narrower or wider.
            self.wait(self._jaws_take_s(motion))
        self.log.phase(f"the approach to {subject}")
        least_times_s = motion.least_times_s
        stretches = list(zip(pairwise(self._hold_off(motion)), planned.down, strict=True))
        path_steps = 0
        for (line, path), least_s in zip(stretches[:-1], least_times_s, strict=False):
            path_steps += self._move_slowly(line, line[1], path, least_s)
        (begin, _), path = stretches[-1]
        if len(stretches) > 1 and event is Event.RELEASE:
            self.log.phase(f"the insertion of {subject}")
            self.log.insert(subject)
        end = plus(motion.tip, self._stops_along(motion), -self._stops_m(motion))
        acts_in_place = event in (Event.RELEASE, Event.DRIVE)
        guides = self._guides.get(subject) if acts_in_place else None
        if guides is None:
            path_steps += self._move_slowly(stretches[-1][0], end, path, least_times_s[-1])
        else:
            self._slide_in(guides, begin, end, path)
        self.sensed["tip_error_m"] = self.arm.tip_error_m()
        self.log.inserted = self.log.guides = None
        begin_steps = self.world.steps - path_steps
        self.arm.yields = self.arm.yields and event is not Event.DRIVE
        self._act(motion)
        self.arm.yields = False
        acted = self.world.steps - begin_steps
        left = max(0, round(motion.visit.acts_s / STEP_S) - acted)
        # Whole frames keep the trace aligned with the log.
        left = STEPS_PER_FRAME * round(left / STEPS_PER_FRAME)
        self.acting_steps += acted + left
        self._dwell(left)
        self.log.phase(f"the retreat from {subject}")
        for point, path in zip(motion.retreat[1:], planned.up, strict=True):
            self.move(point, path)
        if acts_in_place:
            self.world.join(subject, self.tools.robot_parts)

    def _move_slowly(
        self, line: tuple[Point, Point], end: Point, path: PosturePath, least_s: float
    ) -> int:
        """Move to the end of a line; return the steps, or 0 if it has no least time [s]."""
        if not least_s:
            self.move(end, path)
            return 0
        begin_steps = self.world.steps
        mean_m_per_s = max(math.dist(*line) / least_s, _LEAST_M_PER_S)
        most_m_per_s = min(PEAK_SPEED * mean_m_per_s, self.settings.speed_m_per_s)
        self.move(end, path, most_m_per_s)
        return self.world.steps - begin_steps

    def _slide_in(self, guides: Guides, begin: Point, end: Point, path: PosturePath) -> None:
        """Move the held part to the mouth of its guides, and slowly on to its seat."""
        whole_m, slow_m = math.dist(begin, end), max(guides.lengths_m.values()) + _BEFORE_MOUTH_M
        share = max(0.0, 1 - slow_m / whole_m)
        if share > 0.0:
            mouth = plus(begin, plus(end, begin, -1.0), share)
            self.move(mouth, PathSection(path, 0.0, share))
        self.log.phase(f"the insertion of {guides.subject}")
        self.log.guides = guides
        if guides.force_n is not None:
            self.sensed["insertion_limit_n"] = guides.force_n
        if not guides.led:
            # A heavy arm that still moves would swing on the springs.
            self.wait(_SWING_S)
            # Until the part is released, or the screw driven.
            self.arm.yields = True
            self.move(end, PathSection(path, share, 1.0), _INSERTION_M_PER_S)
            return
        self._lead_in(guides)
        self.log.insert(guides.subject)
        force_n = guides.force_n or 0.0
        along = np.array(guides.along)
        self.world.push(guides.subject, -force_n * along)
        self.arm.press_n = force_n * along
        try:
            self.move(end, PathSection(path, share, 1.0), _INSERTION_M_PER_S)
        finally:
            self.world.push(guides.subject, np.zeros(3))
            self.arm.press_n = np.zeros(3)
        self.sensed["fit_force_n"] = force_n
        for fit in guides.led:
            if fit.fastens:
                self.world.fasten(guides.subject, fit.into)
            else:
                self.world.join(guides.subject, [fit.into])

    def _lead_in(self, guides: Guides) -> None:
        """Check that lead-ins lead a part at their mouth, and let it pass the walls of its fits."""
        aside_m = guides.aside_m(self.world.pose(guides.subject).position)
        self.sensed["aside_m"] = aside_m
        for fit in guides.led:
            room_m = max(fit.drawn_m, 0.0) + (fit.lead_in_m or 0.0)
            if fit.lead_in_m is not None and aside_m > room_m:
                self.sensed["missed"] = (
                    f"{guides.subject} meets the rim of {fit.into} {aside_m * 1e3:.2f} mm aside, "
                    f"where clearance and lead-in are {room_m * 1e3:.2f} mm"
                )
        self.world.part(guides.subject, [fit.into for fit in guides.led])

    def _hold_off(self, motion: LinearMotion) -> tuple[Point, ...]:
        """Return the points of the approach, later ones by the gap of a cup behind the part."""
        if motion.visit.event is not Event.RELEASE:
            return motion.approach
        first, *rest = motion.approach
        gap_m = self._gap_m(motion)
        return (first, *(plus(point, motion.tool_points, -gap_m) for point in rest))

    def _stops_m(self, motion: LinearMotion) -> float:
        """Return the distance from the target at which the tip stops [m]."""
        event = motion.visit.event
        if event is Event.DRIVE or motion.visit.press_n:
            return FEEL_FROM_M
        if event in (Event.LOAD, Event.OFFLOAD):
            return _DOCK_GAP_M
        if event is Event.FETCH:
            return _FETCH_GAP_M
        return self._gap_m(motion) if event in (Event.GRASP, Event.RELEASE) else 0.0

    def _stops_along(self, motion: LinearMotion) -> Point:
        """Return the direction of that distance."""
        return motion.visit.along if motion.visit.event is Event.DRIVE else motion.tool_points

    def _act(self, motion: LinearMotion) -> None:
        subject, event = motion.visit.subject, motion.visit.event
        if event is Event.GRASP:
            self.log.phase(f"the grasp of {subject}")
            self._grasp(motion)
        elif event is Event.RELEASE:
            self.log.phase(f"the release of {subject}")
            self._release(motion)
        elif event is Event.OFFLOAD:
            self.log.phase(f"the return of {subject}")
            self.tools.detach()
            self.carry(self.carried)
            self.wait(_SUCTION_S)
            self.sensed["tool_attached"] = "none"
        elif event is Event.LOAD:
            self.log.phase(f"the coupling of {subject}")
            dock = plus(motion.tip, motion.points, -_DOCK_GAP_M)
            self.sensed["coupling_error_m"] = self.tools.couple(subject, dock)
            self.carry(self.carried)
            self.wait(_SUCTION_S)
            attached = self.tools.tool
            self.sensed["tool_attached"] = "none" if attached is None else attached.name
        elif event is Event.FETCH:
            self.log.phase(f"the fetching of {subject}")
            put_at_bit(self, *self._driven(motion))
            self.wait(_SUCTION_S)
        elif event is Event.TURN:
            self.log.phase(f"the turn to {subject}")
            assert self._turn is not None
            self._run_turn(self._turn, motion.visit.dwell_s)
        elif event is Event.WORK:
            self.log.phase(f"the work {subject}")
            if motion.visit.press_n:
                press(self, motion)
            self.wait(_SUCTION_S)
        else:
            self.log.phase(f"the driving of {subject}")
            drive(self, motion)
            self.wait(_SUCTION_S)

    @property
    def _jaws_s(self) -> float:
        """Time of the jaws across their clearance [s]."""
        clearance_m = choose_clearance_m(self.settings.clearance_m, self.tools.tool)
        return clearance_m / JAW_SPEED_M_PER_S

    def _driven(self, fetched: LinearMotion) -> tuple[LinearMotion, Vector]:
        """Return the motion that drives a fetched screw, and the rotation of the hand in it."""
        for planned in self._motions:
            visit = planned.motion.visit
            if visit.event is Event.DRIVE and visit.subject == fetched.visit.subject:
                return planned.motion, planned.rotation
        return fetched, self.arm.tip().rotation

    def _jaws_take_s(self, motion: LinearMotion) -> float:
        """Return the remaining time of the jaws to the opening for a part [s]."""
        if not self.tools.has_jaws:
            return 0.0
        away_m = abs(self._opening_for(motion) - self.arm.jaw_width_m()) / 2
        return away_m / JAW_SPEED_M_PER_S if away_m > _JAWS_PLAY_M else 0.0

    def _held(self, motion: LinearMotion) -> Grasp:
        """Return the grasp of the part that a motion handles."""
        return choose_visit_grasp(self.scene.body(motion.visit.subject), motion.visit)

    def _gap_m(self, motion: LinearMotion) -> float:
        """Return the gap between a part and the rim of a cup [m]."""
        return _CUP_GAP_M if self._held(motion).kind is GraspKind.SUCTION else 0.0

    @property
    def _grip_force_n(self) -> float:
        """Grip force: the tool's, if the task gives one [N]."""
        tool = self.tools.tool
        given_n = None if tool is None else tool.force_n
        return self.settings.grip_force_n if given_n is None else given_n

    def _opening_for(self, motion: LinearMotion) -> float:
        return choose_opening_m(
            self._held(motion), self.settings.clearance_m, self.tools.tool, self.arm.hand
        )

    def _grasp(self, motion: LinearMotion) -> None:
        subject = motion.visit.subject
        if self._held(motion).kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.log.cups[subject] = self.bind(subject)
            self.wait(_SUCTION_S)
        else:
            self.arm.close(self._grip_force_n, outwards=self._held(motion).is_inner)
            self.wait(self._jaws_s + _GRIP_S)
        if self._bond is None:
            # Do this before the collision filters change: some engines then drop its contacts.
            self.clasp(subject)
        if subject in self._kept:
            self.world.release(self._kept.pop(subject))
            self.world.join(subject, self.world.others(subject))
        self.carry(subject)

    def _release(self, motion: LinearMotion) -> None:
        subject = motion.visit.subject
        self.log.free.add(subject)
        if subject in self._in_holders and motion.visit.at_goal:
            # It does not fall into its holder.
            rim = plus(motion.tip, self._stops_along(motion), -self._stops_m(motion))
            self.move(plus(rim, DOWN, motion.drop_m), None, _LOWERING_M_PER_S)
            # The arm swings a little when it stops.
            self.wait(_SWING_S)
            fix_in_place(self.world, subject)
        self.carry(None)
        if self._bond is not None:
            self.log.cups.pop(subject, None)
            self.unbind()
        else:
            self.unclasp()
            self.arm.open(self._opening_for(motion))
        self.wait(self._jaws_s + _LET_GO_S)
