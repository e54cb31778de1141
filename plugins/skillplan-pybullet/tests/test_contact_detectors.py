"""What both contact detectors make of records: whose they read, what they leave to the engine."""

import json
from dataclasses import replace

import numpy as np
import pybullet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import skillplan_simulation as simulation
from situations import assembly, config_content
from skillplan.checks import introduce
from skillplan.task import Body, Box, Pose, Robot, Scene, Tool, ToolKind
from skillplan_pinocchio import ArmModel, iterate_elbows
from skillplan_pybullet import (
    ContactForceDetector,
    PybulletEngine,
    SimulatedArm,
    SimulationSettings,
    World,
)

DETECTORS = [ContactForceDetector, simulation.ContactPairsDetector]


@pytest.fixture(scope="module")
def task():
    """The paper's board."""
    return assembly(config_content("inverter_board"))


def a_record(task, **changes):
    """Return the record of half a second in which nothing touches."""
    facts = task.facts
    record = simulation.Record(
        skill="place(switch_2)",
        present=facts.of("placed(pcb)"),
        absent=facts.of("placed(brace)"),
        phases=((0, "the approach to switch_2"), (20, "the retreat from switch_2")),
        forces_n={name: np.zeros((30, 3)) for name in ("pcb", "switch_2", "transformer")},
        weights_n={"pcb": 1.1772, "switch_2": 0.2943, "transformer": 2.4525},
        pairs_n={},
        moved_m={name: np.zeros(30) for name in ("pcb", "transformer")},
        final={},
        expected={},
    )
    return replace(record, **changes)


def bump(frames, value, begin=10, length=30):
    """Return a signal that is a value for some frames, else zero."""
    signal = np.zeros(length)
    signal[begin : begin + frames] = value
    return signal


@pytest.mark.parametrize(("base_mm", "is_right"), [(0.0, False), (0.4, True), (-0.4, False)])
def test_a_part_belongs_where_the_part_below_it_stands(task, base_mm, is_right):
    """0.7 mm off its goal, on a part that was set down off its own goal by an earlier skill."""
    goal = task.scene.body("switch_2").placements[0].pose
    record = a_record(
        task,
        expected={"switch_2": goal},
        final={"switch_2": goal.moved((7e-4, 0.0, 0.0))},
        carried=(goal.moved((base_mm * 1e-3, 0.0, 0.0)),),
    )
    (skill,) = (skill for skill in task.skills if skill.name == record.skill)
    verdict = simulation.check_postcondition(
        skill, record, simulation.Tolerances(5e-4, 0.03, 3e-3, 3.0, 5.0)
    )
    assert verdict.is_feasible == is_right
    assert is_right or verdict.reason == "switch_2 came to rest 0.7 mm beside its goal"


class TestBoth:
    @pytest.mark.parametrize("detector", DETECTORS)
    def test_a_verdict_rests_on_what_decides_the_simulated_world(self, task, detector):
        """Present and absent are those of the record; the evidence is JSON."""
        record = a_record(task)
        verdict = detector(task).verdict_on(record)
        assert verdict.is_feasible
        assert (record.present, record.absent) == (verdict.present, verdict.absent)
        assert json.dumps(verdict.evidence)

    @pytest.mark.parametrize("detector", DETECTORS)
    @pytest.mark.parametrize("fault", ["unreachable", "unsettled", "upset"])
    def test_what_the_engine_beside_it_rules_on_is_left_to_it(self, task, detector, fault):
        """Alone it rules itself: what says nothing about the skill is unknown."""
        record = a_record(task, **{fault: "it came to nothing"})
        alone, beside, engine = detector(task), detector(task), PybulletEngine(task)
        introduce([alone])
        introduce([beside, engine])
        assert beside.verdict_on(record).is_feasible
        verdict = alone.verdict_on(record)
        assert verdict.reason == "it came to nothing"
        assert (fault != "upset") == verdict.is_infeasible
        assert not verdict.is_feasible

    def test_detectors_read_the_simulation_of_the_engine_beside_them(self, task):
        """One and the same engine, whose options belong to what their answers depend on."""
        engine = PybulletEngine(task, PybulletEngine.Options(drop_height_m=0.002))
        detectors = [detector(task) for detector in DETECTORS]
        introduce([engine, *detectors])
        for detector in detectors:
            assert engine is detector.engine
            assert detector.basis["options"]["drop_height_m"] == 0.002
            assert not detector.basis["alone"]

    def test_detectors_without_an_engine_share_one(self, task):
        """With default options; so that one execution serves both."""
        pairs, force = simulation.ContactPairsDetector(task), ContactForceDetector(task)
        introduce([pairs, force])
        assert pairs.engine is force.engine
        assert pairs.basis["alone"]
        assert PybulletEngine.Options().model_dump(mode="json") == pairs.basis["options"]

    def test_a_collision_is_named_before_the_disorder_it_causes(self):
        """Detectors are asked before the engine."""
        assert all(item.expected_s < PybulletEngine.expected_s for item in DETECTORS)
        assert all(entry.expensive for entry in DETECTORS)


class TestFrameMeans:
    @given(arrays(float, st.integers(0, 20), elements=st.floats(0, 100)), st.integers(1, 8))
    def test_each_is_the_mean_of_the_frames_up_to_it(self, values, frames):
        """Before the first frame nothing touched."""
        means = simulation.average_frames(values, frames)
        padded = [0.0] * frames + list(values)
        for index, mean in enumerate(means):
            window = padded[index + 1 : index + 1 + frames]
            assert mean == pytest.approx(sum(window) / frames)

    def test_axes_are_averaged_apart(self):
        """Shape in is shape out."""
        values = np.arange(12.0).reshape(4, 3)
        assert simulation.average_frames(values, 2).shape == (4, 3)
        assert simulation.average_frames(values, 2)[1].tolist() == [1.5, 2.5, 3.5]


class TestContactPairs:
    def test_an_unexpected_pair_that_presses_is_a_collision(self, task):
        """Phase, bodies and figure in words, the mover first."""
        pressing = {("transformer", "left finger"): bump(8, 12.0)}
        verdict = simulation.ContactPairsDetector(task).verdict_on(a_record(task, pairs_n=pressing))
        assert verdict.reason == (
            "the left finger pressed on transformer with 12 N on the approach to switch_2 "
            "at 0.17 s; the limit is 0.05 N"
        )
        evidence = verdict.evidence
        assert evidence["bodies"] == ["left finger", "transformer"]
        assert evidence["force_n"] == 12.0
        assert (evidence["during"], evidence["at_s"]) == ("the approach to switch_2", 0.166667)
        assert evidence["limits"] == {"force_n": 0.05, "moved_mm": 1.0}

    @pytest.mark.parametrize(("after", "at_s"), [(10, 28.166667), (11, 20.166667)])
    def test_a_dwell_before_a_collision_is_in_its_time(self, task, after, at_s):
        """As in the rows of the trace; one that comes later is not."""
        pressing = {("transformer", "left finger"): bump(8, 12.0)}
        record = a_record(task, pairs_n=pressing, begin_s=20.0, pauses=((after, 8.0),))
        assert simulation.ContactPairsDetector(task).verdict_on(record).evidence["at_s"] == at_s

    def test_what_touches_by_its_side_is_told_how_much_room_it_needs(self, task):
        pair = ("switch_2", "transformer")
        pressing = a_record(task, pairs_n={pair: bump(8, 0.6)}, beside=frozenset([pair]))
        reason = simulation.ContactPairsDetector(task).verdict_on(pressing).reason
        assert reason.endswith("; the limit is 0.05 N; leave 0.3 mm between them")

    def test_a_touch_of_one_frame_is_none(self, task):
        """Averaged over six frames it stays below the threshold; the figure is told."""
        touch = {("left finger", "transformer"): bump(1, 0.29)}
        verdict = simulation.ContactPairsDetector(task).verdict_on(a_record(task, pairs_n=touch))
        assert verdict.is_feasible
        assert verdict.evidence["readings"]["force_n"] == 0.048333
        assert verdict.evidence["peak_n"] == 0.29

    @given(st.integers(1, 12), st.floats(0.01, 1.0))
    def test_the_mean_of_six_frames_decides(self, frames, force_n):
        """Frames beyond the sixth add nothing."""
        board = assembly(config_content("inverter_board"))
        record = a_record(board, pairs_n={("left finger", "pcb"): bump(frames, force_n)})
        verdict = simulation.ContactPairsDetector(board).verdict_on(record)
        mean_n = force_n * min(frames, 6) / 6
        if abs(mean_n - 0.05) > 1e-9:
            assert verdict.is_infeasible == (mean_n > 0.05)

    def test_what_is_pushed_aside_without_a_force_is_a_collision(self, task):
        """At any moment, also where it comes back."""
        moved = {"pcb": np.zeros(30), "transformer": bump(1, 0.0021, begin=25)}
        verdict = simulation.ContactPairsDetector(task).verdict_on(a_record(task, moved_m=moved))
        assert verdict.reason == (
            "transformer was pushed 2.1 mm aside on the retreat from switch_2 at 0.42 s; "
            "the limit is 1 mm"
        )
        assert verdict.evidence["moved_mm"] == {"transformer": 2.1}

    def test_what_came_first_is_the_reason(self, task):
        """The rest stands in the evidence."""
        pairs = {
            ("left finger", "transformer"): bump(10, 3.0, begin=15),
            ("switch_2", "pcb"): bump(10, 80.0, begin=18),
        }
        moved = {"pcb": np.zeros(30), "transformer": bump(5, 0.004, begin=12)}
        detector = simulation.ContactPairsDetector(task)
        pushed = detector.verdict_on(a_record(task, pairs_n=pairs, moved_m=moved))
        assert pushed.reason.startswith("transformer was pushed 4.0 mm aside")
        pressed = detector.verdict_on(a_record(task, pairs_n=pairs))
        assert pressed.reason.startswith("the left finger pressed on transformer with 3 N")
        assert pressed.evidence["readings"]["force_n"] == 80.0

    def test_limits_are_options(self, task):
        """Threshold, frames and displacement."""
        pairs = {("left finger", "transformer"): bump(2, 6.0)}
        moved = {"pcb": np.full(30, 0.0005), "transformer": np.zeros(30)}
        record = a_record(task, pairs_n=pairs, moved_m=moved)
        options = simulation.ContactPairsDetector.Options
        lenient = options(threshold_n=2.5)
        assert simulation.ContactPairsDetector(task, lenient).verdict_on(record).is_feasible
        brief = options(threshold_n=2.5, frames=2)
        assert simulation.ContactPairsDetector(task, brief).verdict_on(record).is_infeasible
        strict = options(threshold_n=2.5, displacement_m=0.0004)
        assert simulation.ContactPairsDetector(task, strict).verdict_on(record).is_infeasible

    def test_a_record_that_broke_off_at_once_is_read_as_far_as_it_goes(self, task):
        """No frames, no contact."""
        record = a_record(
            task,
            forces_n={"pcb": np.zeros((0, 3))},
            pairs_n={("left finger", "pcb"): np.zeros(0)},
            moved_m={"pcb": np.zeros(0)},
        )
        assert simulation.ContactPairsDetector(task).verdict_on(record).is_feasible
        assert ContactForceDetector(task).verdict_on(record).is_feasible


class TestContactForce:
    def test_a_resting_part_fires_only_to_the_letter(self, task):
        """The paper's detector takes the weight of 250 g for a collision."""
        forces = {"transformer": np.tile([0.0, 0.0, 2.4525], (30, 1))}
        record = a_record(task, forces_n=forces)
        assert ContactForceDetector(task).verdict_on(record).is_feasible
        literal = ContactForceDetector.Options(weight_compensated=False)
        verdict = ContactForceDetector(task, literal).verdict_on(record)
        assert verdict.reason.startswith(
            "the net contact force on transformer averaged 2.45 N along z over 6 frames on "
        )
        assert verdict.evidence["readings"]["force_n"] == 2.4525

    def test_what_something_else_than_a_contact_carries_reads_nothing(self, task):
        """Under suction no contact carries the pcb, and none is missed."""
        record = a_record(task, forces_n={"pcb": np.zeros((30, 3))})
        verdict = ContactForceDetector(task).verdict_on(record)
        assert verdict.evidence["readings"]["force_n"] == 0.0

    @pytest.mark.parametrize(("axis", "name"), [(0, "x"), (1, "y"), (2, "z")])
    @pytest.mark.parametrize("sign", [1, -1])
    def test_a_force_along_any_axis_counts_either_way(self, task, axis, name, sign):
        """Its absolute value, apart from the other axes."""
        force = np.zeros((30, 3))
        force[10:20, axis] = sign * 5.0
        verdict = ContactForceDetector(task).verdict_on(
            a_record(task, forces_n={"switch_2": force})
        )
        assert name == verdict.evidence["axis"]
        expected_n = 5.0 - (0.2943 if (name, sign) == ("z", 1) else 0.0)
        assert expected_n == pytest.approx(verdict.evidence["force_n"], abs=1e-6)

    def test_forces_that_cancel_are_not_seen(self, task):
        """The net force of a jammed part may be nothing: what the pairs show."""
        record = a_record(task, pairs_n={("switch_2", "transformer"): bump(20, 30.0)})
        assert ContactForceDetector(task).verdict_on(record).is_feasible
        assert simulation.ContactPairsDetector(task).verdict_on(record).is_infeasible

    def test_only_parts_of_the_product_are_watched(self, task):
        """Not the tools, nor the robot."""
        force = np.full((30, 3), 50.0)
        record = a_record(task, forces_n={"screwdriver": force})
        assert ContactForceDetector(task).verdict_on(record).is_feasible
        record = a_record(task, forces_n={"switch_2": force})
        assert ContactForceDetector(task).verdict_on(record).is_infeasible


# What is taken out of collision touches nothing, whatever bodies were told before and after.


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
    world.part("block", [simulation.ROBOT])
    world.join("block", [simulation.ROBOT])


def touching(world: World, first: str, other: str) -> set[int]:
    """Return the links of one body that touch another after a step."""
    world.step()
    points = pybullet.getContactPoints(
        world.numbers[first], world.numbers[other], physicsClientId=world.client
    )
    return {point[3] for point in points}


def on_block(arm: SimulatedArm) -> set[int]:
    """Return which links of hand and fingers touch the block."""
    return touching(arm.world, simulation.ROBOT, "block") & set(arm.link_names)


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
        arm.world.part("block", [simulation.ROBOT])
        arm.show_hand(True)
        assert on_block(arm) == set()
        arm.world.join("block", [simulation.ROBOT])
        assert on_block(arm)


class TestADockedTool:
    @pytest.fixture
    def tools(self, arm):
        """Return a robot that has just left its screwdriver where it is."""
        robot = Robot("robot", (0.0, 0.0, 0.0), 0.8, 0.2, {}, tools=(SCREWDRIVER,))
        scene = Scene((), (robot,))
        changer = simulation.ToolChanger(arm.world, arm, scene, SCREWDRIVER)
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
        assert touching(arm.world, simulation.ROBOT, "screwdriver") == set()
