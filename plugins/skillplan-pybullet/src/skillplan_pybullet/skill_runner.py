"""Executes strokes in a simulated world: approach, act, retreat."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillplan.physics.jaws import jaw_opening_m
from skillplan.physics.linear_motions import Stroke, grasp_of
from skillplan.task.motion import Event, Point
from skillplan.task.scene import Body, GraspKind, Pose, Scene, Tool
from skillplan.task.state import State
from skillplan_pybullet.contact_log import STEPS_PER_FRAME, ContactLog
from skillplan_pybullet.execution_settings import ExecutionSettings
from skillplan_pybullet.screw_driving import FEEL_FROM_M, drive, put_at_bit
from skillplan_pybullet.simulated_arm import (
    HAND,
    JAW_SPEED_M_PER_S,
    LINK_NAMES,
    ROBOT,
    SimulatedArm,
)
from skillplan_pybullet.straight_motion import StraightMotion
from skillplan_pybullet.tool_changer import ToolChanger
from skillplan_pybullet.world import STEP_S, UpsetError, World

# A tip that lags so far behind is stuck, and what comes after that is chaos [m].
_STUCK_M = 0.012
# The hand stops so far above a tool's dock, which is no body [m].
_DOCK_GAP_M = 0.002
# And so far above what a suction cup lifts: its lip [m].
_CUP_GAP_M = 0.0015
# Two heights that differ by less are one [m].
_LEVEL_M = 1e-6
_GRIP_S = 0.35
_LET_GO_S = 0.35
_SUCTION_S = 0.05
# No skill takes so many simulation steps.
_MOST_STEPS = 200_000


class StuckError(Exception):
    """Raised where the arm cannot go on: something is in its way."""


class SkillRunner:
    """The robot at work in a world.

    Parameters
    ----------
    world, arm
        Where, and with what.
    scene
        What bodies and tools there are.
    settings
        How it moves.
    tool
        The tool attached at the start; the hand itself is a tool without a body.
    every_step
        Called after every simulation step.
    """

    def __init__(
        self,
        world: World,
        arm: SimulatedArm,
        scene: Scene,
        settings: ExecutionSettings,
        tool: Tool | None,
        every_step: Callable[[], None] = lambda: None,
    ) -> None:
        self.world, self.arm, self.scene, self.settings = world, arm, scene, settings
        self.every_step = every_step
        self.log = ContactLog(world, arm, ())
        self.sensed: dict[str, float | bool | str] = {}
        self._bond: int | None = None
        self._kept: dict[str, int] = {}
        self._last_step = _MOST_STEPS
        self.tools = ToolChanger(world, arm, scene, tool)
        self.carry(None)

    def watch(self, handled: set[str]) -> None:
        """Begin a log for the skill to come."""
        self.log = ContactLog(self.world, self.arm, handled)
        for name in (HAND, *LINK_NAMES.values(), ROBOT):
            for other in handled:
                self.log.expected.add((min(name, other), max(name, other)))
        if self.carried is not None and self._bond is not None:
            self.log.cups[self.carried] = self._bond
        self.log.begin()
        self.sensed = {}
        self._last_step = self.world.steps + _MOST_STEPS

    def bring_out(self, subject: str, state: State) -> None:
        """Have a feeder hand out what a state has in it; what is elsewhere stays there."""
        body = next((one for one in self.scene.bodies if one.name == subject), None)
        placement = None if body is None else body.placement(state)
        if body is None or placement is None or placement.solid:
            return
        if subject not in self.world.numbers:
            self.world.add(body, placement.pose, len(self.world.bodies))
        self.world.put(subject, placement.pose)
        # In a feeder, only the hand can touch it.
        self.world.part(subject, self.world.others(subject))
        self._kept[subject] = self.world.hold(subject)

    def take(self, body: Body, stroke_yaw_rad: float) -> None:
        """Put a body into the hand as if it had been picked up before."""
        grasp = grasp_of(body)
        tip = self.arm.tip().position
        cos, sin = np.cos(stroke_yaw_rad), np.sin(stroke_yaw_rad)
        x, y, z = grasp.tip
        origin: Point = (
            float(tip[0] - cos * x + sin * y),
            float(tip[1] - sin * x - cos * y),
            float(tip[2] - z - self._gap_m(body.name)),
        )
        if body.name not in self.world.numbers:
            self.world.add(body, Pose.upright(origin, stroke_yaw_rad), len(self.world.bodies))
        self.carry(body.name)
        if grasp.kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.bind(body.name)
            return
        helping = self.arm.grip(body.name)
        self.arm.close()
        self.wait(self._jaws_s + _GRIP_S)
        self.world.release(helping)

    def carry(self, name: str | None) -> None:
        """Have the arm bear the tool and a body, or nothing besides."""
        self.carried = name
        carried_kg = 0.0 if name is None else self.world.mass_kg(name)
        self.arm.payload_kg = self.tools.load_kg + carried_kg

    def bind(self, name: str) -> int:
        """Fix a body to the robot, which it passes through from now on; return the constraint."""
        self.world.part(name, self.tools.robot_parts)
        self._bond = self.arm.grip(name)
        return self._bond

    def unbind(self) -> None:
        """Undo the bond, if there is one."""
        if self._bond is not None:
            self.world.release(self._bond)
            self._bond = None

    def wait(self, duration_s: float) -> None:
        """Stay where the tip is to be."""
        for _ in range(round(duration_s / STEP_S)):
            self.step()

    def step(self) -> None:
        """Go on by one simulation step.

        Raises
        ------
        StuckError
            If something is in the arm's way.
        UpsetError
            If the simulation blew up, or goes on and on.
        """
        self.arm.actuate()
        self.world.step()
        if self.world.steps % STEPS_PER_FRAME == 0:
            self._check_sanity()
            self.log.frame()
            if self.arm.tip_error_m() > _STUCK_M:
                raise StuckError
        self.every_step()

    def move(self, end: Point, yaw_rad: float) -> None:
        """Move the tip straight to a point.

        Raises
        ------
        StuckError
            If something is in its way.
        """
        here = self.arm.wanted
        assert here is not None
        motion = StraightMotion.between(
            here.position,
            np.array(end),
            here.yaw_rad,
            yaw_rad,
            speed_m_per_s=self.settings.speed_m_per_s,
            acceleration_m_per_s2=self.settings.acceleration_m_per_s2,
        )
        for step in range(1, int(motion.duration_s / STEP_S) + 2):
            self.arm.wanted = motion.at(step * STEP_S)
            self.step()

    def travel(self, end: Point, yaw_rad: float) -> None:
        """Move the tip to a point above something else, no lower than the higher of the two.

        Raises
        ------
        StuckError
            If something is in its way.
        """
        here = self.arm.wanted
        assert here is not None
        x_m, y_m, z_m = here.position.tolist()
        if z_m < end[2] - _LEVEL_M:
            self.move((x_m, y_m, end[2]), here.yaw_rad)
        elif z_m > end[2] + _LEVEL_M:
            self.move((end[0], end[1], z_m), yaw_rad)
        self.move(end, yaw_rad)

    def run(self, stroke: Stroke, yaw_rad: float) -> None:
        """Execute a stroke from above its target, the hand turned as it is to be.

        Raises
        ------
        StuckError
            If something is in the way.
        """
        subject, event = stroke.visit.subject, stroke.visit.event
        x_m, y_m, z_m = stroke.tip
        if event is Event.DRIVE:
            put_at_bit(self, subject)
            z_m += FEEL_FROM_M
        elif event in (Event.LOAD, Event.OFFLOAD):
            z_m += _DOCK_GAP_M
        elif event is Event.GRASP:
            self.arm.open(self._opening_for(subject))
            z_m += self._gap_m(subject)
        elif event is Event.RELEASE:
            z_m += self._gap_m(subject)
        self.log.phase(f"the approach to {subject}")
        self.move((x_m, y_m, z_m), yaw_rad)
        self.sensed["tip_error_m"] = self.arm.tip_error_m()
        self._act(stroke)
        self.log.phase(f"the retreat from {subject}")
        self.move(stroke.above, yaw_rad)
        if event in (Event.RELEASE, Event.DRIVE):
            self.world.join(subject, self.tools.robot_parts)

    def _act(self, stroke: Stroke) -> None:
        subject, event = stroke.visit.subject, stroke.visit.event
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
            x_m, y_m, z_m = stroke.tip
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
            drive(self, subject, stroke.tip[2])
            self.wait(_SUCTION_S)

    @property
    def _jaws_s(self) -> float:
        """How long the jaws take across their clearance [s]."""
        return self.settings.clearance_m / JAW_SPEED_M_PER_S

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

    def _check_sanity(self) -> None:
        if not (self.world.is_sane() and np.isfinite(self.arm.tip_error_m())):
            raise UpsetError("the simulation blew up")
        if self.world.steps > self._last_step:
            raise UpsetError(f"the skill took more than {_MOST_STEPS:,} simulation steps")
