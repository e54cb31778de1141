"""Zones among swept paths: what may not enter goes round, and the tip is slow near people."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan import load_problem
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.robots import PANDA
from skillplan_pinocchio import (
    ArmModel,
    JointLimits,
    JointPath,
    SlowZones,
    SweptDetector,
    find_fastest_trajectory,
)
from yaml_data import yaml_text

CELL = """
kind: assembly
name: cell
robot: {{name: panda, home_m: [0.35, 0.0], safe_height_m: 0.22}}
tools: {{gripper: {{type: gripper, opening_m: 0.08, holder_m: [0.25, 0.4]}}}}
initial_tool: gripper
cost: time
zones: {{{zones}}}
parts:
  part: {{tool: gripper, size_m: [0.05, 0.04, 0.03], start_m: [0.6, 0.3], goal_m: [0.6, -0.3]}}
"""
LIMITS = JointLimits.of(PANDA).scaled(0.5)


@pytest.fixture
def cell(tmp_path):
    """Return the task of a cell with some zones, its detector, and the state with the part held."""

    def load(zones):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL.format(zones=zones))
        (task,) = load_problem(path).tasks
        held = task.skill("pick(part)").prediction_in(task.initial).apply(task.initial)
        return task, SweptDetector(task), held

    return load


def test_a_travel_leads_round_a_zone_and_says_so(cell):
    task, detector, held = cell("column: {min_m: [0.58, -0.05], max_m: [0.75, 0.05]}")
    verdict = detector.check(task.skill("place(part)"), held)
    assert verdict.is_feasible
    assert [travel["around"] for travel in verdict.evidence["travels"]] == [["the zone column"]]
    (zone,), arm = task.scene.zones, detector.paths.planner.arm
    (motion,) = detector.paths.paths(task.skill("place(part)"), held).motions
    planned = [motion.travel.path.at(share) for share in np.linspace(0, 1, 200).tolist()]
    straight = JointPath([planned[0], planned[-1]])
    assert not any(zone.holds(tuple(arm.tip(posture)[0])) for posture in planned)
    assert any(zone.holds(tuple(arm.tip(straight.at(share))[0])) for share in np.linspace(0, 1, 50))


@pytest.mark.parametrize(
    ("keeps_out", "height_m", "reason"),
    [
        ("arm", [0.05, 0.15], "a finger runs into the zone roof on the approach"),
        ("load", [0.05, 0.15], "part runs into the zone roof on the approach"),
        ("all", [0.4, 2.0], "link 5 of the arm runs into the zone roof on the approach"),
        ("load", [0.6, 2.0], None),
        ("arm", [0.0, 0.004], None),
    ],
)
def test_a_zone_keeps_out_the_arm_or_the_load(cell, keeps_out, height_m, reason):
    zone = "{{min_m: [0.5, -0.4], max_m: [0.8, -0.2], height_m: {}, keeps_out: {}}}"
    task, detector, held = cell(f"roof: {zone.format(height_m, keeps_out)}")
    verdict = detector.check(task.skill("place(part)"), held)
    assert (None if verdict.is_feasible else verdict.reason) == reason
    if reason is not None:
        assert verdict.status == "infeasible"
        assert verdict.evidence["bodies"] == ["the zone roof"]
        hulls = detector.hulls(task.skill("place(part)"), held).hulls
        assert any(hull.name == "the zone roof" for hull in hulls)


def test_a_zone_bears_nothing(cell):
    """A part that would stand on its top has nothing beneath it."""
    zones = "shelf: {min_m: [0.5, -0.4], max_m: [0.7, -0.2], height_m: [-0.1, 0.0]}"
    task, detector, held = cell(zones)
    assert detector.check(task.skill("place(part)"), held).is_feasible
    names = {
        contact.body
        for supports in detector._swept_motion(task.skill("place(part)"), held).supports
        for contact in supports.contacts
    }
    assert names == {"the table"}


@settings(max_examples=examples(15), deadline=None)
@given(
    begin=st.floats(0.25, 0.45),
    width=st.floats(0.02, 0.4),
    speed=st.floats(0.03, 0.5),
    turn=st.floats(0.2, 1.2),
)
def test_the_tip_keeps_the_limit_inside_and_the_joints_theirs_everywhere(begin, width, speed, turn):
    """A run with an area of people takes no less time than one without."""
    zones = f"aisle: {{min_m: [0.0, {-width / 2}], max_m: [0.9, {width / 2}]}}"
    task = load_text(zones.replace("}", f", speed_m_per_s: {speed}}}"))
    robot = task.scene.robots[0]
    slow, arm = SlowZones.of(task.scene, robot), ArmModel.of(robot)
    home = np.array(arm.home_rad)
    first, last = home.copy(), home.copy()
    first[0], last[0] = -turn, turn
    last[3] += begin - 0.35
    path = JointPath([first, last])
    run = find_fastest_trajectory(path, LIMITS, slow)
    assert run.duration_s >= find_fastest_trajectory(path, LIMITS).duration_s - 1e-9
    times_s = np.linspace(0.0, run.duration_s, 500)
    rows = [run.at(time_s) for time_s in times_s.tolist()]
    tips = np.array([arm.tip(joints)[0] for joints, _, _ in rows])
    speeds = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(times_s)
    (zone,) = task.scene.zones
    inside = [zone.holds(tuple(tip)) for tip in tips]
    both = np.logical_and(inside[:-1], inside[1:])
    assert speeds[both].max(initial=0.0) <= 1.01 * speed
    for values, most in (
        ([row[1] for row in rows], LIMITS.speed_rad_per_s),
        ([row[2] for row in rows], LIMITS.acceleration_rad_per_s2),
    ):
        assert (np.abs(values) <= np.array(most) * (1 + 1e-6)).all()


def load_text(zones):
    """Return the task of a cell with some zones."""
    config = AssemblyConfig.model_validate(yaml_text(CELL.format(zones=zones)))
    (task,) = AssemblyDomain().ground(config, "")
    return task


def test_a_bound_is_never_above_a_time_with_slow_areas_and_playback_takes_that_time(cell):
    free, _, _ = cell("")
    task, detector, held = cell(
        "aisle: {min_m: [0.2, -0.1], max_m: [0.9, 0.1], speed_m_per_s: 0.05}"
    )
    place, every = task.skill("place(part)"), task.facts.all_bits
    slow_s = detector.duration_s(place, held)
    # 0.2 m and more at 50 mm/s.
    assert slow_s > SweptDetector(free).duration_s(free.skill("place(part)"), held) + 3.0
    for known in (0, held.bits, every):
        bound_s = detector.least_duration_s(place, held.bits & known, ~held.bits & known & every)
        assert bound_s <= slow_s
    (sentence,) = detector.not_checked()
    assert sentence == "speed of links behind the tip in aisle: the limit is the tip's"
    skills = [task.skill("pick(part)"), place]
    played = detector.planned_motion(skills, 20).skills[1]
    assert played.end_s - played.begin_s == pytest.approx(slow_s, abs=0.01)


@pytest.mark.parametrize(
    ("length_m", "height_m", "is_slow"), [(0.34, [0.2, 0.26], True), (0.08, [0.15, 0.21], False)]
)
def test_the_limit_holds_for_the_tip_of_the_tool(length_m, height_m, is_slow):
    """The tip of the arm is above that of a long tool, and below that of a short one."""
    text = CELL.replace("opening_m: 0.08", f"length_m: {length_m}")
    area = f"min_m: [0.2, -0.1], max_m: [0.9, 0.1], height_m: {height_m}"
    zone = f"aisle: {{{area}, speed_m_per_s: 0.05}}"
    times_s = []
    for zones in ("", zone):
        config = AssemblyConfig.model_validate(yaml_text(text.format(zones=zones)))
        (task,) = AssemblyDomain().ground(config, "")
        pick, place = task.skill("pick(part)"), task.skill("place(part)")
        held = pick.prediction_in(task.initial).apply(task.initial)
        detector = SweptDetector(task)
        times_s.append(detector.duration_s(place, held))
        played = detector.planned_motion([pick, place], 20).skills[1]
        assert played.end_s - played.begin_s == pytest.approx(times_s[-1], abs=0.01)
        assert detector.least_duration_s(place, 0, 0) <= times_s[-1]
    assert (times_s[1] > times_s[0] + 3.0) == is_slow
    assert is_slow or times_s[0] == times_s[1]
