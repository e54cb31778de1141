"""The robot at work in a simulated world: motion, grips, tools, and the log of contacts."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from skillplan.task.motion import Point
from skillplan.task.scene import Pose, Robot, Scene, Tool, ToolKind
from skillplan_pinocchio.kinematics.fixed_order import length, times
from skillplan_pinocchio.timing.slow_zones import SlowZones
from skillplan_simulation.execution.contact_log import STEPS_PER_FRAME, ContactLog
from skillplan_simulation.execution.zone_watch import ZoneWatch
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import Vector, compute_turn, make_pose
from skillplan_simulation.motions import ArmMotion, JointMotion, PosturePath, StraightMotion
from skillplan_simulation.robot_shapes import get_hand, make_tool_body
from skillplan_simulation.simulator import (
    FINGERS,
    HAND,
    ROBOT,
    STEP_S,
    Arm,
    Grip,
    UpsetError,
    World,
)

# Largest distance at which couplings engage [m].
_MISALIGNED_M = 0.002
# A tool's z is against the hand's.
_BACKWARDS = np.array([1.0, 1.0, -1.0])


class ToolChanger:
    """The tools of an arm.

    Parameters
    ----------
    tool
        Tool attached at the start, or None.
    """

    def __init__(self, world: World, arm: Arm, scene: Scene, tool: Tool | None) -> None:
        self.world, self.arm, self.scene = world, arm, scene
        self.tool = tool
        # Mass of the tools without the hand [kg].
        self.load_kg = 0.0
        self._bonds: dict[str, int] = {}
        self._docked: dict[str, int] = {}
        self.arm.show_hand(self.shows_hand)
        for item in self.attached:
            self._attach(item)

    @property
    def has_jaws(self) -> bool:
        """Return whether the acting tool is a gripper."""
        return self.tool is not None and self.tool.kind is ToolKind.GRIPPER

    @property
    def attached(self) -> list[Tool]:
        """All tools on the hand, the acting one first."""
        return [] if self.tool is None else [self.tool, *self._robot.list_companions(self.tool)]

    @property
    def shows_hand(self) -> bool:
        """Return whether a gripper is attached."""
        return any(tool.kind is ToolKind.GRIPPER for tool in self.attached)

    @property
    def robot_parts(self) -> list[str]:
        """Names of the robot's bodies, the tools included."""
        attached = [tool.name for tool in self.attached]
        return [ROBOT, *(name for name in attached if name in self.world.numbers)]

    @property
    def _robot(self) -> Robot:
        return self.arm.robot

    def activate(self, tool: Tool | None) -> None:
        """Let another tool on the same hand act."""
        if tool is not None and tool in self.attached:
            self.tool = tool

    def tool_pose(self) -> Pose:
        """Return the pose of the attached tool: origin at its tip, z towards the flange.

        It is upright if the hand points down; its x is along the closing axis.
        """
        return self._find_pose(self.tool)

    def _find_pose(self, tool: Tool | None) -> Pose:
        """Return the pose of a tool on the hand: origin at its tip, z towards the flange."""
        rotation = self._find_rotation(tool)
        return make_pose(self._find_tip(tool), rotation[:, [1, 0, 2]] * _BACKWARDS)

    def _find_rotation(self, tool: Tool | None) -> Vector:
        tip = self.arm.tip()
        if tool is None or tool.mount is None:
            return tip.rotation
        return times(tip.rotation, np.array(tool.mount.rotation))

    def _find_tip(self, tool: Tool | None) -> Vector:
        tip = self.arm.tip()
        if tool is None:
            return tip.position
        if tool.mount is not None:
            return tip.position + times(tip.rotation, np.array(tool.mount.position))
        beyond_m = tool.beyond_m
        return tip.position + beyond_m * tip.rotation[:, 2] if beyond_m else tip.position

    def hand_pose(self) -> Pose:
        """Return the pose of the arm's tip, with axes as of `tool_pose`."""
        tip = self.arm.tip()
        return make_pose(tip.position, tip.rotation[:, [1, 0, 2]] * _BACKWARDS)

    def points(self) -> Vector:
        """Return the direction in which the acting tool points."""
        return self._find_rotation(self.tool)[:, 2]

    def tool_tip(self) -> Vector:
        """Return the position of the tip of the attached tool, or of the bare arm [m]."""
        return self._find_tip(self.tool)

    def follow(self) -> None:
        """Put the bodies of attached tools where the hand is."""
        for tool in self.attached:
            if tool.name in self._bonds:
                self.world.put(tool.name, self._find_pose(tool))

    def detach(self) -> None:
        """Leave the tool in its dock."""
        assert self.tool is not None
        for name, bond in self._bonds.items():
            self.world.release(bond)
            self.world.withdraw(name, [-1])
            self._docked[name] = self.world.hold(name)
        self._bonds = {}
        self.load_kg = 0.0
        self.tool = None
        self.arm.show_hand(False)

    def couple(self, name: str, dock: Point) -> float:
        """Take a tool from its dock; return the misalignment of the coupling [m].

        The tool is not attached if the misalignment is too large.
        """
        apart_m = length(self.arm.tip().position - np.array(dock))
        if apart_m <= _MISALIGNED_M:
            tools = [item for robot in self.scene.robots for item in robot.tools]
            self.tool = next(item for item in tools if item.name == name)
            self.arm.fit(get_hand(self.arm.robot, self.tool))
            self.arm.show_hand(self.shows_hand)
            for item in self.attached:
                self._attach(item)
        return apart_m

    def _attach(self, tool: Tool) -> None:
        body = make_tool_body(tool, self.arm.hand)
        if body is None:
            return
        if tool.name in self._docked:
            self.world.release(self._docked.pop(tool.name))
            self.world.withdraw(tool.name, [])
        else:
            self.world.add(body, self._find_pose(tool))
        self.world.part(tool.name, [ROBOT, *self._bonds])
        self._bonds[tool.name] = self.arm.grip(tool.name)
        self.load_kg += body.mass_kg


# Lag of the tip at which the arm is stuck [m].
_STUCK_M = 0.012
# Maximum number of simulation steps of a skill.
_MOST_STEPS = 200_000
# Turn of the hand after which its contacts are refreshed, during a move and at its end [rad].
_TURN_FELT_RAD, _TURN_UNFELT_RAD = 0.3, 0.01


class StuckError(Exception):
    """The arm is blocked."""


class ControlledRobot:
    """A robot with commands to move, carry and step.

    Parameters
    ----------
    tool
        Tool attached at the start; a gripper is a tool without a body.

    Attributes
    ----------
    log
        Log of the current skill's contacts.
    sensed
        Sensor values of the current skill.
    carried
        Body in the hand, or None.
    """

    def __init__(
        self,
        world: World,
        arm: Arm,
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
        self._static: Grip | None = None
        self._last_step = _MOST_STEPS
        self.slow_zones = SlowZones.of(scene, arm.robot)
        self._zone_watch = ZoneWatch.of(scene, arm.robot)
        self.tools = ToolChanger(world, arm, scene, tool)
        self.carry(None)

    def watch(self, handled: set[str], carried: Collection[str] = ()) -> None:
        """Start a log for the next skill, whose bodies on a workholder the robot must not touch."""
        self.log = ContactLog(self.world, self.arm, {*handled, *carried})
        for name in (HAND, *FINGERS, ROBOT):
            for other in handled:
                self.log.expected.add((min(name, other), max(name, other)))
        if self.carried is not None:
            bond = self._bond if self._static is None else self._static.constraint
            if bond is not None:
                self.log.cups[self.carried] = bond
        self.log.begin()
        self.sensed = {}
        self._last_step = self.world.steps + _MOST_STEPS

    def carry(self, name: str | None) -> None:
        """Set the payload to the tool and a body, or to the tool alone."""
        self.carried = name
        carried_kg = 0.0 if name is None else self.world.mass_kg(name)
        self.arm.payload_kg = self.tools.load_kg + carried_kg
        tool = [name for name in self.tools.robot_parts if name != ROBOT]
        self.arm.bears = (*tool, *([] if name is None else [name]))

    def bind(self, name: str) -> int:
        """Fix a body to the robot and let it pass through it; return the constraint."""
        self.world.part(name, self.tools.robot_parts)
        self._bond = self.arm.grip(name)
        return self._bond

    def unbind(self) -> None:
        """Remove the bond, if there is one."""
        if self._bond is not None:
            self.world.release(self._bond)
            self._bond = None

    def clasp(self, name: str) -> None:
        """Let friction hold a body still between the jaws."""
        self._static = self.arm.clasp(name)
        if self._static.constraint is not None:
            self.log.cups[name] = self._static.constraint

    def unclasp(self) -> None:
        """Release the held body to its contacts."""
        if self._static is not None:
            self.log.cups.pop(self._static.name, None)
            self._static.let_go()
            self._static = None

    def stand_again(self, joints_rad: Vector) -> None:
        """Put the empty arm at rest in a posture [rad], with its tools."""
        self.arm.press_n, self.arm.yields = np.zeros(3), False
        self.arm.stand(joints_rad, self.arm.jaw_width_m())
        self.tools.follow()

    def wait(self, duration_s: float) -> None:
        """Hold the current target."""
        for _ in range(round(duration_s / STEP_S)):
            self.step()

    def step(self) -> None:
        """Advance by one simulation step.

        Raises
        ------
        StuckError
            If an obstacle blocks the arm.
        UpsetError
            If the simulation blew up, the skill takes too many steps, or the arm falls behind
            with nothing in its way, which proves nothing about the skill.
        """
        self.arm.actuate()
        self.world.step()
        if self.world.steps % STEPS_PER_FRAME == 0:
            self._check_sanity()
            self.log.frame()
            self._keep_hold()
            if self._zone_watch is not None and "in_zone" not in self.sensed:
                entry = self._zone_watch.look(self)
                if entry is not None:
                    self.sensed["in_zone"] = f"{entry} on {self.log.phase_now or 'its way'}"
                    self.sensed["in_zone_frame"] = self.log.frames
            lag_m = self.arm.tip_error_m()
            if lag_m > _STUCK_M:
                if self._is_touching():
                    raise StuckError
                raise UpsetError(
                    f"the simulated arm lags {lag_m * 1e3:.0f} mm behind its path on "
                    f"{self.log.phase_now or 'the way to its start'} and touches nothing: its "
                    "drives cannot follow there"
                )
        self.every_step()

    def _is_touching(self) -> bool:
        """Return whether the arm, its tool or the body that it carries touches another one."""
        own = {ROBOT, HAND, *FINGERS, *self.tools.robot_parts, self.carried}
        return any((first in own) != (second in own) for first, second in self.log.last_pairs)

    def move(
        self, end: Point, path: PosturePath | None = None, speed_m_per_s: float | None = None
    ) -> None:
        """Move the tip straight to a point.

        Parameters
        ----------
        end
            Target [m].
        path
            Joint path on the way. Default: the current posture.
        speed_m_per_s
            Maximum speed of the tip [m/s]. Default: that of the settings.

        Raises
        ------
        StuckError
            If an obstacle blocks the arm.
        """
        here = self.arm.setpoint
        assert here is not None
        most_m_per_s = speed_m_per_s or self.settings.speed_m_per_s
        if self.slow_zones is not None:
            zones = self.slow_zones.with_tool(self.tools.tool)
            beyond = zones.away(here.rotation)
            limit = zones.find_speed_m_per_s(here.position + beyond, np.array(end) + beyond)
            most_m_per_s = min(most_m_per_s, limit)
        self.follow(
            StraightMotion.between(
                here,
                np.array(end),
                path,
                speed_m_per_s=most_m_per_s,
                acceleration_m_per_s2=self.settings.acceleration_m_per_s2,
                joints_rad_per_s=self.arm.robot.model.speed_rad_per_s,
            )
        )

    def transfer(self, planned: ArmMotion) -> None:
        """Travel to the start of a motion along its joint path.

        Raises
        ------
        StuckError
            If an obstacle blocks the arm.
        """
        self.follow(planned.travel)

    def follow(self, motion: StraightMotion | JointMotion) -> None:
        """Follow a timed motion.

        Raises
        ------
        StuckError
            If an obstacle blocks the arm.
        """
        assert self.arm.setpoint is not None
        felt = self.arm.setpoint.rotation
        times_s = [step * STEP_S for step in range(1, int(motion.duration_s / STEP_S) + 2)]
        for setpoint in motion.at_each(times_s):
            self.arm.setpoint = setpoint
            self.step()
            if _measure_angle(felt, self.arm.setpoint.rotation) > _TURN_FELT_RAD:
                self._refresh_contacts()
                felt = self.arm.setpoint.rotation
        if _measure_angle(felt, self.arm.setpoint.rotation) > _TURN_UNFELT_RAD:
            self._refresh_contacts()

    def _keep_hold(self) -> None:
        """Let the held body slip if friction cannot hold it."""
        if self._static is None:
            return
        self._static.hold(STEPS_PER_FRAME * STEP_S)
        if self._static.constraint is None:
            name, pushed_n = self._static.name, length(self.world.pushed_n(self._static.name))
            self.unclasp()
            # A part that slips does not move with the arm.
            self.arm.bears = tuple(body for body in self.arm.bears if body != name)
            if pushed_n > 0:
                # It would fly off: nothing else takes up the force of its fit.
                self.world.push(name, np.zeros(3))
                self.arm.press_n = np.zeros(3)
                self.sensed["missed"] = (
                    f"{name} slips in the jaws under the {pushed_n:.0f} N of its fit; give its "
                    "tool more force_n"
                )

    def _refresh_contacts(self) -> None:
        """Recreate the contacts between jaws and the held body.

        The simulator keeps contact points with their directions in the world and does not turn them
        with the body.
        """
        if self.carried is not None and self._bond is None:
            self.world.part(self.carried, [ROBOT])
            self.world.join(self.carried, [ROBOT])

    def _check_sanity(self) -> None:
        if not (self.world.is_sane() and np.isfinite(self.arm.tip_error_m())):
            raise UpsetError("the simulation blew up")
        if self.world.steps > self._last_step:
            raise UpsetError(f"the skill took more than {_MOST_STEPS:,} simulation steps")


def _measure_angle(rotation: Vector, other: Vector) -> float:
    """Return the angle between two rotations [rad]."""
    return 0.0 if rotation is other else length(compute_turn(rotation, other))
