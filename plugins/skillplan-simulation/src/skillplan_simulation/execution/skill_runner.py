"""Executes approach-act-retreat motions in a simulated world."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from skillplan.physics.linear_motions import LinearMotion, jaw_opening_m, visited_grasp
from skillplan.task.motion import Event, Grasp, GraspKind, Point
from skillplan.task.pose import DOWN, plus, same_direction
from skillplan.task.scene import WORLD, Scene, Tool
from skillplan.task.state import State
from skillplan_pinocchio.kinematics.fixed_order import dot, times
from skillplan_simulation.execution.contact_log import STEPS_PER_FRAME
from skillplan_simulation.execution.controlled_robot import ControlledRobot
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import Vector, of_quaternion, pose_of
from skillplan_simulation.motions import ArmMotion
from skillplan_simulation.simulator import JAW_SPEED_M_PER_S, STEP_S, TABLE, Arm, World

# A screw is brought so far above where it touches, and then felt for [m].
FEEL_FROM_M = 0.001

_FEEL_SPEED_M_PER_S = 0.01
_FELT_N = 0.2
_PRESS_S = 0.4
_PRESS_SPEED_M_PER_S = 0.004
# A screw of a gram between arm and workpiece would take more iterations to be pressed than
# there are: while the bit has it, it is as heavy as the bit's holder [kg].
_HELD_SCREW_KG = 0.1


def put_at_bit(robot: ControlledRobot, driven: LinearMotion, turned: Vector) -> None:
    """Put a screw at the bit, unless it is there already.

    Parameters
    ----------
    robot
        With a screwdriver.
    driven
        The motion that drives the screw, now or later.
    turned
        How the hand is turned in that, shape (3, 3).
    """
    screw = driven.visit.subject
    if robot.carried == screw:
        return
    world, body, tip = robot.world, robot.scene.body(screw), robot.arm.tip()
    # As it will be in its hole once it is driven.
    in_hand = times(turned.T, of_quaternion(driven.visit.pose.orientation))
    rotation = times(tip.rotation, in_hand)
    end = tip.position - body.height_m * rotation[:, 2]
    world.add(body, pose_of(end, rotation))
    world.weigh(screw, _HELD_SCREW_KG)
    robot.bind(screw)
    robot.carry(screw)


def drive(robot: ControlledRobot, motion: LinearMotion) -> None:
    """Feel for the hole's mouth and press, the force measured over the last half; let go then.

    Parameters
    ----------
    robot
        With the screw at its bit, outside the hole.
    motion
        The one that drives it; at its tip the screw touches.

    Raises
    ------
    StuckError
        If something blocks the arm.
    """
    world, arm, settings = robot.world, robot.arm, robot.settings
    assert arm.wanted is not None
    screw, along = motion.visit.subject, np.array(motion.visit.along)
    drivers = {screw, *robot.tools.robot_parts}
    through = {name for name in (*world.bodies, TABLE) if name not in drivers}
    # It lands on whatever is there; what else the robot touches meanwhile is not meant to be.
    robot.log.free.add(screw)
    contact = np.array(motion.tip)
    depth = dot(along, arm.wanted.position - contact)
    while depth < settings.press_travel_m and robot.log.pressing_n({screw}, through) < _FELT_N:
        depth += _FEEL_SPEED_M_PER_S * STEP_S
        _hold(robot, contact + depth * along)
        robot.step()
    arm.press_n = settings.press_force_n * along
    readings = []
    steps = round(_PRESS_S / STEP_S)
    for step in range(steps):
        if settings.control == "osc":
            # A force is commanded, and the depth yields to it.
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
    if not same_direction(motion.visit.along, DOWN):
        # Its thread holds it, where it would otherwise fall.
        bearing = world.nearest(screw, through)
        if bearing is not None:
            world.fasten(screw, bearing)
    world.weigh(screw, robot.scene.body(screw).mass_kg)
    robot.carry(None)


def _hold(robot: ControlledRobot, position: Vector) -> None:
    """Have the tip be at a point, not moving."""
    wanted = robot.arm.wanted
    assert wanted is not None
    robot.arm.wanted = replace(wanted, position=position, velocity=np.zeros(3))


# The hand stops so far above a tool's dock, which is no body [m].
_DOCK_GAP_M = 0.002
# And so far above what a suction cup lifts: its lip [m].
_CUP_GAP_M = 0.0015
# And a bit so far above where a screw stands in its feeder, as the head jumps to the magnet [m].
_FETCH_GAP_M = 0.001
_GRIP_S = 0.35
_LET_GO_S = 0.35
_SUCTION_S = 0.05
# Jaws that are this close to where they are to be are there [m].
_JAWS_PLAY_M = 0.001


class SkillRunner(ControlledRobot):
    """A robot that executes skills, one motion after the other; see `ControlledRobot`.

    Parameters
    ----------
    dwell
        Called with the simulation steps that are left of a dwell once the robot has acted, >= 0.
        By default dwells are left out, as no verdict depends on them.
    world, arm, scene, settings, tool, every_step
        As of `ControlledRobot`.

    Attributes
    ----------
    acting_steps
        Simulation steps spent to act at targets, dwells included.
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
        # Constraints that hold what a feeder hands out.
        self._kept: dict[str, int] = {}
        # Of the current skill.
        self._motions: tuple[ArmMotion, ...] = ()

    def begin(self, motions: Sequence[ArmMotion], state: State) -> None:
        """Have feeders hand out what a skill takes, and log its contacts from now on.

        Every execution of a skill begins here, by itself or in a whole plan: what touches now is
        expected to, so that what comes from a feeder has to be there already.

        Parameters
        ----------
        motions
            Of the skill.
        state
            Where it starts.
        """
        self._motions = tuple(motions)
        handled = {planned.motion.visit.subject for planned in motions}
        for subject in sorted(handled):
            self.bring_out(subject, state)
        self.world.stand(handled)
        self.watch(handled)

    def bring_out(self, subject: str, state: State) -> None:
        """Have a feeder hand out what a state has in it; what is elsewhere stays there."""
        body = next((one for one in self.scene.bodies if one.name == subject), None)
        placement = None if body is None else body.placement(state)
        if body is None or placement is None or placement.solid or placement.frame != WORLD:
            return
        if subject in self._kept:
            return
        if subject not in self.world.numbers:
            self.world.add(body, placement.pose)
        self.world.put(subject, placement.pose)
        # In a feeder, only the hand can touch it.
        self.world.part(subject, self.world.others(subject))
        self._kept[subject] = self.world.hold(subject)

    def take(self, planned: ArmMotion) -> None:
        """Put what a motion leaves into the hand, as if it had been picked up before."""
        motion = planned.motion
        subject, visit = motion.visit.subject, motion.visit
        grasp = self._held(motion)
        tip = self.arm.tip()
        # In the hand as it will be where it belongs, but for the gap of a cup.
        turned = times(tip.rotation, planned.rotation.T)
        rotation = times(turned, of_quaternion(visit.pose.orientation))
        away = np.array(grasp.tip)
        origin = tip.position - times(rotation, away) + self._gap_m(motion) * tip.rotation[:, 2]
        if subject not in self.world.numbers:
            body = self.scene.body(subject)
            self.world.add(body, pose_of(origin, rotation))
        self.carry(subject)
        if grasp.kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.bind(subject)
            return
        helping = self.arm.grip(subject)
        self.arm.close(self._grip_force_n)
        self.wait(self._jaws_s + _GRIP_S)
        self.world.release(helping)
        self.clasp(subject)

    def travel(self, planned: ArmMotion) -> None:
        """Move to where a motion begins, and the jaws meanwhile.

        Raises
        ------
        StuckError
            If something blocks the arm.
        """
        motion = planned.motion
        around = f" round {', '.join(planned.around)}" if planned.around else ""
        self.log.phase(f"the travel to {motion.visit.subject}{around}")
        if motion.visit.event is Event.GRASP and self._jaws_take_s(motion):
            self.arm.open(self._opening_for(motion))
        self.transfer(planned)

    def run(self, planned: ArmMotion) -> None:
        """Execute an approach-act-retreat motion from where it begins.

        Raises
        ------
        StuckError
            If something blocks the arm.
        """
        motion = planned.motion
        subject, event = motion.visit.subject, motion.visit.event
        if event is Event.DRIVE:
            put_at_bit(self, motion, planned.rotation)
        elif event is Event.GRASP:
            self.arm.open(self._opening_for(motion))
            # What was handled before may have left them closer, or wider.
            self.wait(self._jaws_take_s(motion))
        self.log.phase(f"the approach to {subject}")
        stretches = list(zip(motion.approach[1:], planned.down, strict=True))
        for point, path in stretches[:-1]:
            self.move(point, path)
        _, path = stretches[-1]
        if len(stretches) > 1 and event is Event.RELEASE:
            self.log.phase(f"the insertion of {subject}")
            self.log.insert(subject)
        self.move(plus(motion.tip, self._stops_along(motion), -self._stops_m(motion)), path)
        self.sensed["tip_error_m"] = self.arm.tip_error_m()
        self.log.inserted = None
        begun = self.world.steps
        self._act(motion)
        acted = self.world.steps - begun
        left = max(0, round(motion.visit.dwell_s / STEP_S) - acted)
        # Whole frames, so that those of the trace stay those of the log.
        left = STEPS_PER_FRAME * round(left / STEPS_PER_FRAME)
        self.acting_steps += acted + left
        self._dwell(left)
        self.log.phase(f"the retreat from {subject}")
        for point, path in zip(motion.retreat[1:], planned.up, strict=True):
            self.move(point, path)
        if event in (Event.RELEASE, Event.DRIVE):
            self.world.join(subject, self.tools.robot_parts)

    def _stops_m(self, motion: LinearMotion) -> float:
        """Return how far from where it acts the tip stops [m]."""
        event = motion.visit.event
        if event is Event.DRIVE:
            return FEEL_FROM_M
        if event in (Event.LOAD, Event.OFFLOAD):
            return _DOCK_GAP_M
        if event is Event.FETCH:
            return _FETCH_GAP_M
        return self._gap_m(motion) if event in (Event.GRASP, Event.RELEASE) else 0.0

    def _stops_along(self, motion: LinearMotion) -> Point:
        """Return the direction in which that is."""
        return motion.visit.along if motion.visit.event is Event.DRIVE else motion.points

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
        else:
            self.log.phase(f"the driving of {subject}")
            drive(self, motion)
            self.wait(_SUCTION_S)

    @property
    def _jaws_s(self) -> float:
        """How long the jaws take across their clearance [s]."""
        return self.settings.clearance_m / JAW_SPEED_M_PER_S

    def _driven(self, fetched: LinearMotion) -> tuple[LinearMotion, Vector]:
        """Return the motion that drives what is fetched, and how the hand is turned in it."""
        for planned in self._motions:
            visit = planned.motion.visit
            if visit.event is Event.DRIVE and visit.subject == fetched.visit.subject:
                return planned.motion, planned.rotation
        return fetched, self.arm.tip().rotation

    def _jaws_take_s(self, motion: LinearMotion) -> float:
        """Return how long the jaws still take to be as wide as a part wants them [s]."""
        if not self.tools.has_jaws:
            return 0.0
        away_m = abs(self._opening_for(motion) - self.arm.jaw_width_m()) / 2
        return away_m / JAW_SPEED_M_PER_S if away_m > _JAWS_PLAY_M else 0.0

    def _held(self, motion: LinearMotion) -> Grasp:
        """Return how a motion holds what it handles."""
        return visited_grasp(self.scene.body(motion.visit.subject), motion.visit)

    def _gap_m(self, motion: LinearMotion) -> float:
        """Return how far from a part the rim of a cup stops [m]."""
        return _CUP_GAP_M if self._held(motion).kind is GraspKind.SUCTION else 0.0

    @property
    def _grip_force_n(self) -> float:
        """With what force the jaws close: the tool's, where the task says it [N]."""
        tool = self.tools.tool
        given_n = None if tool is None else tool.force_n
        return self.settings.grip_force_n if given_n is None else given_n

    def _opening_for(self, motion: LinearMotion) -> float:
        return jaw_opening_m(
            self._held(motion), self.settings.clearance_m, self.tools.tool, self.arm.hand
        )

    def _grasp(self, motion: LinearMotion) -> None:
        subject = motion.visit.subject
        if self._held(motion).kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.log.cups[subject] = self.bind(subject)
            self.wait(_SUCTION_S)
        else:
            self.arm.close(self._grip_force_n)
            self.wait(self._jaws_s + _GRIP_S)
        if self._bond is None:
            # Before the collisions of the body change: some engines then forget its contacts.
            self.clasp(subject)
        if subject in self._kept:
            self.world.release(self._kept.pop(subject))
            self.world.join(subject, self.world.others(subject))
        self.carry(subject)

    def _release(self, motion: LinearMotion) -> None:
        subject = motion.visit.subject
        self.log.free.add(subject)
        self.carry(None)
        if self._bond is not None:
            self.log.cups.pop(subject, None)
            self.unbind()
        else:
            self.unclasp()
            self.arm.open(self._opening_for(motion))
        self.wait(self._jaws_s + _LET_GO_S)
