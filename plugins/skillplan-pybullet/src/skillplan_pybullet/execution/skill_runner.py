"""Executes approach-act-retreat motions in a simulated world."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from skillplan.physics.jaws import jaw_opening_m
from skillplan.physics.linear_motions import LinearMotion, grasp_of
from skillplan.task.motion import Event, Point
from skillplan.task.scene import WORLD, Body, GraspKind, Pose, Scene, Tool
from skillplan.task.state import State
from skillplan_pybullet.arm.simulated_arm import JAW_SPEED_M_PER_S, SimulatedArm
from skillplan_pybullet.execution.controlled_robot import ControlledRobot
from skillplan_pybullet.execution.screw_driving import FEEL_FROM_M, drive, put_at_bit
from skillplan_pybullet.execution_settings import ExecutionSettings
from skillplan_pybullet.simulator.world import World

# The hand stops so far above a tool's dock, which is no body [m].
_DOCK_GAP_M = 0.002
# And so far above what a suction cup lifts: its lip [m].
_CUP_GAP_M = 0.0015
_GRIP_S = 0.35
_LET_GO_S = 0.35
_SUCTION_S = 0.05
# Jaws that are this close to where they are to be are there [m].
_JAWS_PLAY_M = 0.001


class SkillRunner(ControlledRobot):
    """A robot that executes skills, one motion after the other; see `ControlledRobot`."""

    def __init__(
        self,
        world: World,
        arm: SimulatedArm,
        scene: Scene,
        settings: ExecutionSettings,
        tool: Tool | None,
        every_step: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(world, arm, scene, settings, tool, every_step)
        # Constraints that hold what a feeder hands out.
        self._kept: dict[str, int] = {}

    def begin(self, motions: Sequence[LinearMotion], state: State) -> None:
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
        handled = {motion.visit.subject for motion in motions}
        for subject in sorted(handled):
            self.bring_out(subject, state)
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
            self.world.add(body, placement.pose, len(self.world.bodies))
        self.world.put(subject, placement.pose)
        # In a feeder, only the hand can touch it.
        self.world.part(subject, self.world.others(subject))
        self._kept[subject] = self.world.hold(subject)

    def take(self, body: Body, yaw_rad: float) -> None:
        """Put a body into the hand as if it had been picked up before."""
        grasp = grasp_of(body)
        tip = self.arm.tip().position
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        x, y, z = grasp.tip
        origin: Point = (
            float(tip[0] - cos * x + sin * y),
            float(tip[1] - sin * x - cos * y),
            float(tip[2] - z - self._gap_m(body.name)),
        )
        if body.name not in self.world.numbers:
            self.world.add(body, Pose.upright(origin, yaw_rad), len(self.world.bodies))
        self.carry(body.name)
        if grasp.kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.bind(body.name)
            return
        helping = self.arm.grip(body.name)
        self.arm.close()
        self.wait(self._jaws_s + _GRIP_S)
        self.world.release(helping)

    def travel(self, motion: LinearMotion, yaw_rad: float) -> None:
        """Move to above a motion's target, the hand turned so [rad], and the jaws meanwhile.

        Raises
        ------
        StuckError
            If something blocks the arm.
        """
        subject = motion.visit.subject
        self.log.phase(f"the travel to {subject}")
        if motion.visit.event is Event.GRASP and self._jaws_take_s(subject):
            self.arm.open(self._opening_for(subject))
        self.transfer(motion.above, yaw_rad)

    def run(self, motion: LinearMotion, yaw_rad: float) -> None:
        """Execute an approach-act-retreat motion from above its target, the hand turned so [rad].

        Raises
        ------
        StuckError
            If something blocks the arm.
        """
        subject, event = motion.visit.subject, motion.visit.event
        x_m, y_m, z_m = motion.tip
        if event is Event.DRIVE:
            put_at_bit(self, subject)
            z_m += FEEL_FROM_M
        elif event in (Event.LOAD, Event.OFFLOAD):
            z_m += _DOCK_GAP_M
        elif event is Event.GRASP:
            self.arm.open(self._opening_for(subject))
            # What was handled before may have left them closer, or wider.
            self.wait(self._jaws_take_s(subject))
            z_m += self._gap_m(subject)
        elif event is Event.RELEASE:
            z_m += self._gap_m(subject)
        self.log.phase(f"the approach to {subject}")
        self.move((x_m, y_m, z_m), yaw_rad)
        self.sensed["tip_error_m"] = self.arm.tip_error_m()
        self._act(motion)
        self.log.phase(f"the retreat from {subject}")
        self.move(motion.above, yaw_rad)
        if event in (Event.RELEASE, Event.DRIVE):
            self.world.join(subject, self.tools.robot_parts)

    def _act(self, motion: LinearMotion) -> None:
        subject, event = motion.visit.subject, motion.visit.event
        if event is Event.GRASP:
            self.log.phase(f"the grasp of {subject}")
            self._grasp(subject)
        elif event is Event.RELEASE:
            self.log.phase(f"the release of {subject}")
            self._release(subject)
        elif event is Event.OFFLOAD:
            self.log.phase(f"the return of {subject}")
            self.tools.detach()
            self.carry(self.carried)
            self.wait(_SUCTION_S)
            self.sensed["tool_attached"] = "none"
        elif event is Event.LOAD:
            self.log.phase(f"the coupling of {subject}")
            x_m, y_m, z_m = motion.tip
            dock = (x_m, y_m, z_m + _DOCK_GAP_M)
            self.sensed["coupling_error_m"] = self.tools.couple(subject, dock)
            self.carry(self.carried)
            self.wait(_SUCTION_S)
            attached = self.tools.tool
            self.sensed["tool_attached"] = "none" if attached is None else attached.name
        elif event is Event.FETCH:
            self.log.phase(f"the fetching of {subject}")
            put_at_bit(self, subject)
            self.wait(_SUCTION_S)
        else:
            self.log.phase(f"the driving of {subject}")
            drive(self, subject, motion.tip[2])
            self.wait(_SUCTION_S)

    @property
    def _jaws_s(self) -> float:
        """How long the jaws take across their clearance [s]."""
        return self.settings.clearance_m / JAW_SPEED_M_PER_S

    def _jaws_take_s(self, subject: str) -> float:
        """Return how long the jaws still take to be as wide as a part wants them [s]."""
        if not self.tools.has_jaws:
            return 0.0
        away_m = abs(self._opening_for(subject) - self.arm.jaw_width_m()) / 2
        return away_m / JAW_SPEED_M_PER_S if away_m > _JAWS_PLAY_M else 0.0

    def _gap_m(self, subject: str) -> float:
        """Return how far above a part the rim of a cup stops [m]."""
        is_cup = grasp_of(self.scene.body(subject)).kind is GraspKind.SUCTION
        return _CUP_GAP_M if is_cup else 0.0

    def _opening_for(self, subject: str) -> float:
        grasp = grasp_of(self.scene.body(subject))
        return jaw_opening_m(grasp, self.settings.clearance_m, self.tools.tool)

    def _grasp(self, subject: str) -> None:
        body = self.scene.body(subject)
        if grasp_of(body).kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.log.cups[subject] = self.bind(subject)
            self.wait(_SUCTION_S)
        else:
            self.arm.close()
            self.wait(self._jaws_s + _GRIP_S)
        if subject in self._kept:
            self.world.release(self._kept.pop(subject))
            self.world.join(subject, self.world.others(subject))
        self.carry(subject)

    def _release(self, subject: str) -> None:
        self.log.free.add(subject)
        self.carry(None)
        if self._bond is not None:
            self.log.cups.pop(subject, None)
            self.unbind()
        else:
            self.arm.open(self._opening_for(subject))
        self.wait(self._jaws_s + _LET_GO_S)
