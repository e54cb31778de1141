"""What is taken out of collision touches nothing, whatever bodies were told before and after."""

from __future__ import annotations

import pybullet
import pytest

from skillplan.task import Body, Box, Pose, Robot, Scene, Tool, ToolKind
from skillplan_pinocchio import ArmModel, iterate_elbows
from skillplan_pybullet import SimulatedArm, SimulationSettings, World
from skillplan_simulation import ROBOT, ToolChanger

TIP = (0.5, 0.0, 0.3)
# From one finger to the other, and up to the palm.
BLOCK = Body("block", (Box((0.12, 0.12, 0.08), (0.0, 0.0, 0.04)),), (), 1.0)
SCREWDRIVER = Tool("screwdriver", "tool(screwdriver)", (0.0, 0.0, 0.0), kind=ToolKind.SCREWDRIVER)


@pytest.fixture
def arm():
    """Return an arm at rest in a world of its own."""
    settings = SimulationSettings()
    with World(settings.friction) as world:
        robot = Robot("robot", (0.0, 0.0, 0.0), 0.8, 0.2, {})
        simulated_arm = SimulatedArm(world, robot, settings)
        simulated_arm.stand(next(iterate_elbows(ArmModel(), TIP, 0.0)), 0.04)
        yield simulated_arm


def put_block(world: World) -> None:
    """Fix the block where the hand is."""
    world.add(BLOCK, Pose(TIP))
    world.hold("block")


def pass_and_touch_again(world: World) -> None:
    """Have the block pass through the robot for a while, as a part in a suction cup does."""
    world.part("block", [ROBOT])
    world.join("block", [ROBOT])


def touching(world: World, first: str, other: str) -> set[int]:
    """Return the links of one body that touch another after a step."""
    world.step()
    points = pybullet.getContactPoints(
        world.numbers[first], world.numbers[other], physicsClientId=world.client
    )
    return {point[3] for point in points}


def on_block(arm: SimulatedArm) -> set[int]:
    """Return which links of hand and fingers touch the block."""
    return touching(arm.world, ROBOT, "block") & set(arm.link_names)


class TestAHiddenHand:
    def test_it_leaves_what_it_touched(self, arm):
        put_block(arm.world)
        assert on_block(arm)
        arm.show_hand(False)
        assert on_block(arm) == set()
        arm.show_hand(True)
        assert on_block(arm)

    def test_it_touches_nothing_that_passed_through_the_robot_before(self, arm):
        put_block(arm.world)
        pass_and_touch_again(arm.world)
        assert on_block(arm)
        arm.show_hand(False)
        assert on_block(arm) == set()
        arm.show_hand(True)
        assert on_block(arm)

    def test_it_touches_nothing_that_passes_through_the_robot_later(self, arm):
        put_block(arm.world)
        arm.show_hand(False)
        pass_and_touch_again(arm.world)
        assert on_block(arm) == set()
        arm.show_hand(True)
        assert on_block(arm)

    def test_it_touches_nothing_that_comes_later(self, arm):
        arm.show_hand(False)
        put_block(arm.world)
        assert on_block(arm) == set()
        pass_and_touch_again(arm.world)
        assert on_block(arm) == set()
        arm.show_hand(True)
        assert on_block(arm)

    def test_what_passes_through_the_robot_does_so_when_it_is_shown_again(self, arm):
        put_block(arm.world)
        arm.show_hand(False)
        arm.world.part("block", [ROBOT])
        arm.show_hand(True)
        assert on_block(arm) == set()
        arm.world.join("block", [ROBOT])
        assert on_block(arm)


class TestADockedTool:
    @pytest.fixture
    def tools(self, arm):
        """Return a robot that has just left its screwdriver where it is."""
        robot = Robot("robot", (0.0, 0.0, 0.0), 0.8, 0.2, {}, tools=(SCREWDRIVER,))
        scene = Scene((), (robot,))
        changer = ToolChanger(arm.world, arm, scene, SCREWDRIVER)
        changer.detach()
        return changer

    def touches_block(self, world: World) -> bool:
        return bool(touching(world, "screwdriver", "block"))

    def test_it_is_not_solid_for_what_comes_later(self, arm, tools):
        put_block(arm.world)
        assert not self.touches_block(arm.world)

    def test_it_is_not_solid_for_what_passed_through_everything_before(self, arm, tools):
        world = arm.world
        put_block(world)
        world.part("block", world.others("block"))
        world.join("block", world.others("block"))
        assert not self.touches_block(world)

    def test_it_is_not_solid_for_the_hand_that_comes_next(self, arm, tools):
        arm.show_hand(True)
        assert touching(arm.world, ROBOT, "screwdriver") == set()
