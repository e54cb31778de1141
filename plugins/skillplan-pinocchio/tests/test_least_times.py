"""Bounds on times: never above what a trajectory takes, and near it where one joint goes alone."""

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_pinocchio as arm
from example_count import examples
from skillplan.robots import PANDA

LIMITS = arm.JointLimits.of(PANDA).scaled(0.5)
POSTURES = st.lists(
    st.lists(st.floats(-1.5, 1.5), min_size=7, max_size=7).map(np.array), min_size=2, max_size=4
)


@settings(max_examples=examples(100))
@given(nodes=POSTURES)
def test_no_trajectory_between_two_postures_takes_less(nodes):
    """Whatever lies between them."""
    taken_s = arm.find_fastest_trajectory(arm.JointPath(nodes), LIMITS).duration_s
    assert arm.bound_duration_s(nodes[0], nodes[-1], LIMITS) <= taken_s + 1e-9


@pytest.mark.parametrize("way_rad", [0.01, 0.3, 2.0])
@pytest.mark.parametrize("joint", [0, 3, 6])
def test_a_joint_that_goes_alone_takes_no_more(joint, way_rad):
    """With and without reaching its greatest speed; to 0.2 %."""
    start, end = np.zeros(7), np.zeros(7)
    end[joint] = way_rad
    taken_s = arm.find_fastest_trajectory(arm.JointPath([start, end]), LIMITS).duration_s
    assert taken_s == pytest.approx(arm.bound_duration_s(start, end, LIMITS), rel=2e-3)


def test_staying_takes_no_time():
    """The bound is 0."""
    assert arm.bound_duration_s(np.ones(7), np.ones(7), LIMITS) == 0.0


def pairs(task):
    """Yield every skill with a state for each place and tool from which it may be done."""
    robot, facts = task.scene.robots[0], task.facts
    for skill in task.skills:
        for place in robot.places:
            for tool in robot.tools:
                others = [other.fact for other in robot.tools if other is not tool]
                state = skill.precondition.requires | facts.of(place, tool.fact)
                if not (state & skill.precondition.forbids or state & facts.of(*others)):
                    yield skill, state


def check_bounds(task, chosen):
    """Hold the bound of each against its time; return their ratios."""
    detector, ratios = arm.SweptDetector(task), []
    every = task.facts.all_bits
    for skill, state in chosen:
        least_s = detector.least_duration_s(skill, state.bits, every & ~state.bits)
        taken_s = detector.duration_s(skill, state)
        assert taken_s is not None
        assert least_s <= taken_s
        anywhere_s = detector.least_duration_s(skill, skill.precondition.requires.bits, 0)
        assert anywhere_s <= least_s
        assert detector.least_duration_s(skill, 0, 0) <= anywhere_s
        ratios.append(least_s / taken_s)
    return ratios


def test_the_bound_holds_for_some_pairs_of_the_board(board):
    """Drawn at random; it is not far from the time."""
    ratios = check_bounds(board, random.Random(1).sample(list(pairs(board)), 30))
    assert np.mean(ratios) > 0.6


@pytest.mark.slow(reason="hundreds of trajectories a board; every run draws thirty of one")
@pytest.mark.parametrize("name", ["inverter_board", "inverter_grasps", "motor_drive"])
def test_the_bound_holds_for_all_pairs_of_boards(product_task, name):
    """Any skill from any place, also after failed grasps; of the board of many tools 400 drawn."""
    task = product_task(name)
    every = list(pairs(task))
    check_bounds(task, random.Random(2).sample(every, min(400, len(every))))


def test_times_and_bounds_are_the_same_in_any_order(board):
    """To the bit, whatever was asked before."""
    chosen = random.Random(3).sample(list(pairs(board)), 12)
    detectors, every = [arm.SweptDetector(board), arm.SweptDetector(board)], board.facts.all_bits
    results = [{}, {}]
    for detector, answers, order in zip(detectors, results, (chosen, chosen[::-1]), strict=True):
        for skill, state in order:
            least_s = detector.least_duration_s(skill, state.bits, every & ~state.bits)
            answers[skill.name, state.bits] = (detector.duration_s(skill, state), least_s)
    assert results[0] == results[1]


def test_a_bound_computes_no_trajectory(board, monkeypatch):
    """Neither of the travel nor of the strokes."""

    def boom(*question):
        raise AssertionError("a trajectory was computed")

    monkeypatch.setattr("skillplan_pinocchio.timing.skill_times.find_fastest_trajectory", boom)
    detector = arm.SweptDetector(board)
    for skill in board.skills:
        assert detector.least_duration_s(skill, board.initial.bits, 0) > 0


def test_what_the_arm_never_does_has_no_bound(board):
    """Where it says no time, it bounds none: a place in the stead of two tools at once."""
    load = board.skill("load(screwdriver)")
    both = board.facts.of(*(tool.fact for tool in board.scene.robots[0].tools)).bits
    assert arm.SweptDetector(board).least_duration_s(load, both, 0) == np.inf


def test_after_a_miss_the_way_to_look_is_counted_by_the_next_skill(product_task):
    """As the distance is: there is no skill that goes it. Here the arm looks from its home."""
    task = product_task("inverter_grasps")
    detector, facts, pick = arm.SweptDetector(task), task.facts, task.skill("pick(transformer)")
    (missed,) = (outcome for outcome in pick.outcomes if outcome is not pick.prediction)
    (looks,) = (fact for fact in missed.add if fact in task.scene.robots[0].places)
    held = pick.precondition.requires | facts.of("tool(gripper)")
    from_home_s, again_s, from_there_s = (
        detector.duration_s(pick, held | facts.of(place))
        for place in ("at(home)", looks, "at(transformer.start)")
    )
    there_s = from_home_s - from_there_s
    assert again_s - from_home_s == pytest.approx(there_s, rel=0.05)
    bits = (held | facts.of(looks)).bits
    least_s = detector.least_duration_s(pick, bits, facts.all_bits & ~bits)
    assert from_there_s < least_s <= again_s
