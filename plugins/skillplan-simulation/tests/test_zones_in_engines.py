"""Zones in both engines, on the motion that they measure: nothing stops the arm there."""

from __future__ import annotations

import numpy as np
import pytest

from skillplan import load_problem
from skillplan.pipeline import registry

CELL = """
kind: assembly
name: cell
robot: {{name: panda, home_m: [0.6, 0.3], safe_height_m: 0.22}}
tools: {{gripper: {{type: gripper, opening_m: 0.08, holder_m: [0.25, 0.4]}}}}
initial_tool: gripper
zones: {{z: {zone}}}
parts:
  part: {{tool: gripper, size_m: [0.05, 0.04, 0.03], start_m: [0.6, 0.3], goal_m: [0.6, -0.1]}}
"""
PLAN = ("pick(part)", "place(part)")

pytestmark = pytest.mark.slow(reason="executes picks and places in both engines")


@pytest.fixture(params=["mujoco", "pybullet"])
def execute(request, tmp_path):
    """Return the performance of the plan in a cell with a zone, and its samples."""

    def run(zone, gripper="opening_m: 0.08"):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL.format(zone=zone).replace("opening_m: 0.08", gripper))
        (task,) = load_problem(path).tasks
        engine = registry.load("physics", request.param)(task)
        samples = []
        skills = [task.skill(name) for name in PLAN]
        return engine.perform(skills, note=samples.append), samples

    return run


@pytest.mark.parametrize(
    ("keeps_out", "reason"),
    [
        ("arm", "a finger enters the zone z on the approach to part"),
        ("load", "part enters the zone z on the approach to part"),
    ],
)
def test_an_entry_fails_the_skill_whose_contacts_are_all_expected(execute, keeps_out, reason):
    zone = "{{min_m: [0.61, -0.2], max_m: [0.8, 0.0], height_m: [0.05, 0.15], keeps_out: {}}}"
    performance, samples = execute(zone.format(keeps_out))
    assert performance.failed is not None
    assert performance.failed.skill == "place(part)"
    assert performance.failed.verdict.reason == reason
    assert max(sample.contact_n for sample in samples) == 0.0
    (arrival,) = performance.arrivals
    assert arrival.offset_m < 5e-4


def test_the_measured_tip_is_slow_inside_and_quick_outside(execute):
    performance, samples = execute("{min_m: [0, 0], max_m: [1, 0.2], speed_m_per_s: 0.1}")
    assert performance.failed is None
    tips = np.array([sample.tip for sample in samples])
    times_s = np.array([sample.time_s for sample in samples])
    speeds = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(times_s)
    inside = (tips[:, 1] > 0.0) & (tips[:, 1] < 0.2)
    assert 0.09 < speeds[inside[1:] & inside[:-1]].max() < 0.103
    assert speeds[~inside[1:] & ~inside[:-1]].max() > 0.2


def test_a_stroke_is_slow_where_the_tip_of_a_long_tool_is_inside(execute):
    """The zone ends below the tip of the arm."""
    zone = "{min_m: [0.5, -0.2], max_m: [0.7, 0.4], height_m: [0.0, 0.1], speed_m_per_s: 0.05}"
    performance, samples = execute(zone, "length_m: 0.34")
    assert performance.failed is None
    strokes = [sample for sample in samples if sample.phase == "the approach to part"]
    heights = np.array([sample.tip[2] for sample in strokes])
    times_s = np.array([sample.time_s for sample in strokes])
    speeds = np.abs(np.diff(heights)) / np.diff(times_s)
    assert 0.04 < speeds[np.diff(times_s) < 0.1].max() < 0.053
