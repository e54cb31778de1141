"""The arm goes the way that swept has checked: the same nodes in a check, in a plan, in a trace."""

from __future__ import annotations

import numpy as np
import pytest

from situations import assembly
from skillplan.checks import introduce
from skillplan.task import VerdictStatus
from skillplan_pinocchio import SweptDetector
from skillplan_pybullet import PybulletEngine
from skillplan_simulation import ContactPairsDetector

PLAN = ("pick(base)", "place(base)", "pick(tower)", "place(tower)")


def block(start_m, goal_m, size_m, mass_kg):
    return {
        "tool": "gripper",
        "mass_kg": mass_kg,
        "size_m": size_m,
        "start_m": start_m,
        "goal_m": goal_m,
    }


@pytest.fixture(scope="module")
def task():
    """Return a board where a tower stands between the place of a part and its goal."""
    return assembly(
        {
            "kind": "assembly",
            "name": "past-a-tower",
            "robot": {"home_m": [0.35, 0.0], "safe_height_m": 0.15},
            "tools": {"gripper": {"holder_m": [0.6, -0.3]}},
            "initial_tool": "gripper",
            "parts": {
                "base": block([0.4, -0.25], [0.5, 0.0], [0.06, 0.05, 0.02], 0.1),
                "tower": block([0.45, -0.12], [0.6, 0.3], [0.03, 0.03, 0.25], 0.15),
            },
            "step_limit": 10,
        }
    )


@pytest.fixture(scope="module")
def past_the_tower(task):
    """Return the skill and the state whose straight travel the tower blocks."""
    return task.skill("place(base)"), task.skill("pick(base)").prediction.apply(task.initial)


def test_an_execution_and_swept_have_the_same_nodes(task, past_the_tower):
    """To the bit, though each has a planner of its own."""
    engine, detector = PybulletEngine(task), SweptDetector(task)
    planned = engine.workcell.paths.of(*past_the_tower)
    checked = detector.paths.paths(*past_the_tower)
    assert len(planned.motions) == len(checked.motions) == 1
    assert np.array_equal(planned.begin_rad, checked.begin_rad)
    for tracked, motion in zip(planned.motions, checked.motions, strict=True):
        assert np.array_equal(tracked.travel.nodes_rad, motion.travel.path.nodes)
        assert len(motion.travel.path.nodes) > 2
    verdict = detector.check(*past_the_tower)
    assert verdict.is_feasible
    assert list(planned.travels) == verdict.evidence["travels"]


def test_a_tracked_travel_takes_as_long_as_the_fastest_run_along_its_nodes(task, past_the_tower):
    """Within the joints' limits, times the same share of them."""
    engine = PybulletEngine(task)
    (motion,) = engine.workcell.paths.of(*past_the_tower).motions
    limits = engine.workcell.paths.limits
    times_s = np.linspace(0.0, motion.travel.duration_s, 200).tolist()
    for time_s in times_s:
        rates = motion.travel.at(time_s).joints
        assert (np.abs(rates.speeds_rad_per_s) <= np.array(limits.speed_rad_per_s) + 1e-6).all()
        assert (
            np.abs(rates.accelerations_rad_per_s2)
            <= np.array(limits.acceleration_rad_per_s2) + 1e-6
        ).all()


def test_a_way_that_is_not_found_within_the_budget_leaves_the_engine_without_a_verdict(
    task, past_the_tower
):
    """Unknown for the reason that swept names; never infeasible."""
    engine = PybulletEngine(task, PybulletEngine.Options(travel_checks=1))
    detector = SweptDetector(task, SweptDetector.Options(travel_checks=1))
    expected = detector.check(*past_the_tower)
    assert expected.status is VerdictStatus.UNKNOWN
    verdict = engine.check(*past_the_tower)
    assert verdict.status is VerdictStatus.UNKNOWN
    assert verdict.reason == expected.reason


@pytest.mark.slow(reason="executes a plan of four skills; the nodes of its travels in every run")
def test_a_plan_past_a_tower_runs_through_by_the_way_that_was_checked(task, past_the_tower):
    """What search grants, `simulate` executes; the trace says where it goes round."""
    engine, pairs, swept = PybulletEngine(task), ContactPairsDetector(task), SweptDetector(task)
    introduce([engine, pairs])
    checked = engine.check(*past_the_tower)
    assert checked.is_feasible, checked.reason
    assert pairs.check(*past_the_tower).is_feasible
    samples = []
    perform = engine.perform([task.skill(name) for name in PLAN], note=samples.append)
    assert perform.failed is None, perform.failed
    assert all(arrival.offset_m < 5e-4 for arrival in perform.arrivals)
    expected = swept.check(*past_the_tower).evidence["travels"]
    assert checked.evidence["travels"] == expected
    assert perform.skills[1].verdict.evidence["travels"] == expected
    phases = [sample.phase for sample in samples if sample.skill == "place(base)"]
    assert "the travel to base round tower" in phases
    nodes = np.array(expected[0]["nodes_rad"])
    near = [
        min(float(np.abs(np.array(item.joints_rad) - node).max()) for item in samples)
        for node in nodes
    ]
    # Between two rows of the trace a joint goes by a few hundredths.
    assert max(near) < 0.03
