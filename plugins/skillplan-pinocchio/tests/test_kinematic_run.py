"""A plan along its planned paths: where tip and parts are, how long it takes, what is refused."""

from pathlib import Path

import numpy as np
import pytest

from skillplan import Setup, load_problem, make_model
from skillplan.model import replay
from skillplan.physics import MotionPlans, plan_linear_motions
from skillplan_pinocchio import SweptDetector

TENTH_OF_A_MM = 1e-4
FRAMES_PER_S = 60
PLAN = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"


@pytest.fixture(scope="module")
def skills(board):
    return board.parse_sequence(PLAN)


@pytest.fixture(scope="module")
def detector(board):
    return SweptDetector(board)


@pytest.fixture(scope="module")
def motion(detector, skills):
    assert isinstance(detector, MotionPlans)
    return detector.planned_motion(skills, FRAMES_PER_S)


@pytest.fixture(scope="module")
def states(board, skills):
    """Return the state in which each skill begins, by name."""
    results, state = {}, board.initial
    for skill in skills:
        results[skill.name] = state
        state = skill.prediction_in(state).apply(state)
    return results


def off_line(point, ends):
    """Return how far a point is from a straight stretch [m]."""
    begin, end = np.array(ends)
    along = (end - begin) / np.linalg.norm(end - begin)
    return np.linalg.norm((point - begin) - np.dot(point - begin, along) * along)


def test_there_is_a_sample_for_every_frame_and_the_arm_goes_on_from_where_it_is(motion):
    times_s = [sample.time_s for sample in motion.samples]
    assert np.allclose(np.arange(1, len(times_s) + 1) / FRAMES_PER_S, times_s)
    assert 1 / FRAMES_PER_S >= times_s[-1] - motion.skills[-1].end_s >= 0
    begins = [skill.begin_s for skill in motion.skills]
    assert [0.0, *(item.end_s for item in motion.skills[:-1])] == begins


def test_down_and_up_the_tip_is_within_a_tenth_of_a_millimetre_of_its_line(
    board, motion, skills, states
):
    checked = 0
    for skill in skills:
        lines = {
            linear_motion.visit.subject: linear_motion.approach[-2:]
            for linear_motion in plan_linear_motions(board, skill, states[skill.name], 0.001)
        }
        for sample in motion.samples:
            words, _, subject = sample.phase.rpartition(" ")
            if sample.skill == skill.name and words in ("the approach to", "the retreat from"):
                assert off_line(np.array(sample.tip), lines[subject]) < TENTH_OF_A_MM
                checked += 1
    assert checked > 500


def test_a_part_is_let_go_straight_above_its_goal_and_comes_to_rest_on_it(
    board, motion, skills, states
):
    """By the height that a part is let go at, and no more than a tenth of a millimetre aside."""
    goals = board.scene.at(board.goal.requires)
    placed = [skill for skill in skills if "part" in skill.parameters and skill.kind == "place"]
    assert placed
    for skill in placed:
        part = skill.parameters["part"]
        let_go = next(
            sample.bodies[part].position
            for sample in motion.samples
            if (sample.skill, sample.phase) == (skill.name, f"the release of {part}")
        )
        x_m, y_m, z_m = np.subtract(let_go, goals[part].position)
        assert np.hypot(x_m, y_m) < TENTH_OF_A_MM
        # It comes down within half a second: by a thirtieth of the way in the first frame.
        assert 0.0009 < z_m < 0.001 + TENTH_OF_A_MM
    last = motion.samples[-1].bodies
    for name, goal in goals.items():
        assert np.allclose(goal.position, last[name].position, atol=1e-9), name


def test_nothing_jumps(motion):
    """Not even where the hand takes a part, or lets it go: 1.5 m/s are 25 mm a frame."""
    for sample, other in zip(motion.samples, motion.samples[1:], strict=False):
        assert np.linalg.norm(np.subtract(sample.tip, other.tip)) < 0.025
        for name in sample.bodies.keys() & other.bodies.keys():
            gone = np.subtract(sample.bodies[name].position, other.bodies[name].position)
            assert np.linalg.norm(gone) < 0.025, (name, other.skill, other.phase)


def test_joints_keep_their_limits_and_skills_take_the_times_of_cost_by_time(
    detector, motion, states, board
):
    joints = np.array([sample.joints_rad for sample in motion.samples])
    speeds = np.abs(np.diff(joints, axis=0)) * FRAMES_PER_S
    limits = np.array(board.scene.robots[0].model.speed_rad_per_s)
    assert np.all(speeds <= limits * detector.options.speed_fraction * 1.001)
    for skill in motion.skills:
        # No travel of this plan leads round anything.
        told_s = detector.duration_s(board.skill(skill.skill), states[skill.skill])
        assert told_s == pytest.approx(skill.end_s - skill.begin_s, abs=1e-6), skill.skill


@pytest.mark.slow(reason="a plan of 16 skills; costs with waits in every run")
def test_the_arm_waits_for_parts_and_feeders_as_long_as_the_costs_say():
    cell = load_problem(Path(__file__).parents[3] / "configs/cell_arrivals.yaml").task
    skills = cell.parse_sequence("0,1,10,11,8,9,2,3,12,13,4,5,15,16,6,7")
    walked = replay(make_model(cell, Setup(collision=("swept",))), skills)
    played = SweptDetector(cell).planned_motion(skills, 10)
    assert [s.end_s - s.begin_s for s in played.skills] == pytest.approx(
        [step.duration_s for step in walked.steps], abs=1e-6
    )
    waited = {step.skill for step in walked.steps if step.wait_s}
    assert waited == {"pick(nut_1)", "pick(box_1)", "pick(box_2)", "pick(box_3)"}


def test_nothing_touches_in_it(motion):
    assert not any(sample.contacts or sample.contact_n for sample in motion.samples)


def test_what_swept_does_not_grant_has_no_planned_motion(board):
    """The brace stands above where the transformer is to go."""
    plan = "0,1,10,11,8,9"
    early = board.parse_sequence(plan)
    with pytest.raises(ValueError, match="swept does not grant"):
        SweptDetector(board).planned_motion(early, FRAMES_PER_S)
