"""Executes strokes in a simulated world: approach, act, retreat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from skillplan.physics import panda
from skillplan.physics.jaws import jaw_opening_m
from skillplan.physics.strokes import Stroke, grasp_of
from skillplan.task.motion import Event, Point
from skillplan.task.scene import Body, GraspKind, Pose, Scene, Tool
from skillplan_pybullet.contact_log import STEPS_PER_FRAME, ContactLog
from skillplan_pybullet.execution_settings import ExecutionSettings
from skillplan_pybullet.simulated_arm import (
    HAND,
    JAW_SPEED_M_PER_S,
    LINK_NAMES,
    ROBOT,
    SimulatedArm,
)
from skillplan_pybullet.straight_motion import StraightMotion
from skillplan_pybullet.tool_changer import ToolChanger
from skillplan_pybullet.world import STEP_S, TABLE, UpsetError, World

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
_PRESS_S = 0.4
_FEEL_SPEED_M_PER_S = 0.01
_PRESS_SPEED_M_PER_S = 0.004
_FELT_N = 0.2
# A screw is brought so far above where it touches, and then felt for [m].
_FEEL_FROM_M = 0.001
# A screw of a gram between arm and workpiece would take more iterations to be pressed than
# there are: while the bit has it, it is as heavy as the bit's holder [kg].
_HELD_SCREW_KG = 0.1


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
        self.carried: str | None = None
        self._bond: int | None = None
        self._kept: dict[str, int] = {}
        self._last_step = _MOST_STEPS
        self.tools = ToolChanger(world, arm, scene, tool)
        self._feel_load()

    @property
    def opening_m(self) -> float:
        """How far the jaws are open where nothing is said of it [m]."""
        return panda.OPENING_M / 2

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

    def keep(self, body: Body, pose: Pose) -> None:
        """Put a body where only the hand can touch it, as into a feeder."""
        if body.name not in self.world.numbers:
            self.world.add(body, pose, len(self.world.bodies))
        self.world.put(body.name, pose)
        self.world.part(body.name, self.world.others(body.name))
        self._kept[body.name] = self.world.hold(body.name)

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
        self.carried = body.name
        self._feel_load()
        if grasp.kind is GraspKind.SUCTION or not self.tools.has_jaws:
            self.world.part(body.name, self.tools.robot_parts)
            self._bond = self.arm.grip(body.name)
            return
        helping = self.arm.grip(body.name)
        self.arm.close()
        self.wait(self._jaws_s + _GRIP_S)
        self.world.release(helping)

    def wait(self, duration_s: float) -> None:
        """Stay where the tip is to be."""
        for _ in range(round(duration_s / STEP_S)):
            self._step()

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
            self._step()

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
            self._screw_at_bit(subject)
            z_m += _FEEL_FROM_M
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
        if event is Event.RELEASE:
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
            self._feel_load()
            self.wait(_SUCTION_S)
            self.sensed["tool_attached"] = "none"
        elif event is Event.LOAD:
            self.log.phase(f"the coupling of {subject}")
            x_m, y_m, z_m = stroke.tip
            dock = (x_m, y_m, z_m + _DOCK_GAP_M)
            self.sensed["coupling_error_m"] = self.tools.couple(subject, dock)
            self._feel_load()
            self.wait(_SUCTION_S)
            attached = self.tools.tool
            self.sensed["tool_attached"] = "none" if attached is None else attached.name
        elif event is Event.FETCH:
            self.log.phase(f"the fetching of {subject}")
            self._screw_at_bit(subject)
            self.wait(_SUCTION_S)
        else:
            self.log.phase(f"the driving of {subject}")
            self._drive(subject, stroke.tip[2])

    def _feel_load(self) -> None:
        """Have the arm bear the tool and what it carries."""
        carried_kg = 0.0 if self.carried is None else self.world.mass_kg(self.carried)
        self.arm.payload_kg = self.tools.load_kg + carried_kg

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
            self.world.part(subject, self.tools.robot_parts)
            self._bond = self.arm.grip(subject)
            self.log.cups[subject] = self._bond
            self.wait(_SUCTION_S)
        else:
            self.arm.close()
            self.wait(self._jaws_s + _GRIP_S)
        if subject in self._kept:
            self.world.release(self._kept.pop(subject))
            self.world.join(subject, self.world.others(subject))
        self.carried = subject
        self._feel_load()

    def _release(self, subject: str) -> None:
        self.log.free.add(subject)
        self.carried = None
        self._feel_load()
        if self._bond is not None:
            self.log.cups.pop(subject, None)
            self.world.release(self._bond)
            self._bond = None
        else:
            self.arm.open(self._opening_for(subject))
        self.wait(self._jaws_s + _LET_GO_S)

    def _screw_at_bit(self, subject: str) -> None:
        if self.carried == subject:
            return
        body = self.scene.body(subject)
        tip = self.tools.upright_tip()
        x, y, z = tip.position
        self.world.add(body, Pose((x, y, z - body.height_m)), len(self.world.bodies))
        self.world.part(subject, self.tools.robot_parts)
        self.world.weigh(subject, _HELD_SCREW_KG)
        self._bond = self.arm.grip(subject)
        self.carried = subject
        self._feel_load()

    def _drive(self, subject: str, contact_m: float) -> None:
        """Feel for the hole's mouth and press, the force measured over the last half."""
        assert self.arm.wanted is not None
        drivers = {subject, *self.tools.robot_parts}
        through = {name for name in (*self.world.bodies, TABLE) if name not in drivers}
        self.log.free |= drivers
        x, y, z = self.arm.wanted.position.tolist()
        lowest = contact_m - self.settings.press_travel_m
        while z > lowest and self.log.pressing_n({subject}, through) < _FELT_N:
            z -= _FEEL_SPEED_M_PER_S * STEP_S
            self.arm.wanted = replace(
                self.arm.wanted, position=np.array([x, y, z]), velocity=np.zeros(3)
            )
            self._step()
        self.arm.press_n = self.settings.press_force_n
        readings = []
        steps = round(_PRESS_S / STEP_S)
        for step in range(steps):
            z = self._pressing_height_m(z, self.log.pressing_n({subject}, through))
            self.arm.wanted = replace(self.arm.wanted, position=np.array([x, y, z]))
            self._step()
            if step >= steps // 2 and step % STEPS_PER_FRAME == 0:
                readings.append(self.log.pressing_n({subject}, through))
        self.arm.press_n = 0.0
        self.sensed["fastening_force_n"] = float(np.mean(readings))
        assert self._bond is not None
        self.world.release(self._bond)
        self._bond, self.carried = None, None
        self.world.weigh(subject, self.scene.body(subject).mass_kg)
        self._feel_load()
        self.wait(_SUCTION_S)
        self.log.free -= set(self.tools.robot_parts)

    def _pressing_height_m(self, height_m: float, felt_n: float) -> float:
        """Return at what height the tip is to be while it presses [m].

        Under operational-space control a force is asked for, and the height gives way to it;
        position control is lowered until as much is felt.
        """
        if self.settings.control == "osc":
            return float(self.arm.tip().position[2])
        short = felt_n < self.settings.press_force_n
        return height_m - _PRESS_SPEED_M_PER_S * STEP_S if short else height_m

    def _check_sanity(self) -> None:
        if not (self.world.is_sane() and np.isfinite(self.arm.tip_error_m())):
            raise UpsetError("the simulation blew up")
        if self.world.steps > self._last_step:
            raise UpsetError(f"the skill took more than {_MOST_STEPS:,} simulation steps")

    def _step(self) -> None:
        self.arm.actuate()
        self.world.step()
        if self.world.steps % STEPS_PER_FRAME == 0:
            self._check_sanity()
            self.log.frame()
            if self.arm.tip_error_m() > _STUCK_M:
                raise StuckError
        self.every_step()
