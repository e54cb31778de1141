"""Grasps that hold nothing are refused: jaws on air, cups over holes and edges."""

from __future__ import annotations

import pytest

from situations import assembly
from skillplan.pipeline import Setup, make_feasibility

# An angle of two walls, 10 mm thick, and a ring of four bars, 12 mm wide.
ANGLE = [
    {"size_m": [0.05, 0.01, 0.08], "centre_m": [0.0, -0.025, 0.04]},
    {"size_m": [0.01, 0.05, 0.08], "centre_m": [-0.02, 0.005, 0.04]},
]
RING = [
    {"size_m": [0.012, 0.06, 0.01], "centre_m": [sign * 0.024, 0.0, 0.005]} for sign in (-1, 1)
] + [{"size_m": [0.06, 0.012, 0.01], "centre_m": [0.0, sign * 0.024, 0.005]} for sign in (-1, 1)]


def pick(boxes, grasp, tool=None):
    """Return the verdict of swept on the pick of one part."""
    content = {
        "kind": "assembly",
        "name": "one",
        "robot": {"home_m": [0.4, 0.0]},
        "tools": {"hand": {"holder_m": [0.3, 0.4], **(tool or {"opening_m": 0.08})}},
        "initial_tool": "hand",
        "parts": {
            "part": {
                "tool": "hand",
                "boxes": boxes,
                "grasp": grasp,
                "start_m": [0.5, -0.2],
                "goal_m": [0.5, 0.1],
            }
        },
    }
    task = assembly(content)
    feasibility = make_feasibility(task, Setup(collision=("swept",)))
    return feasibility.verdict(task.skill("pick(part)"), task.initial)


def test_jaws_that_meet_no_material_on_a_side_are_refused():
    """The box about the angle is 50 mm wide, and there is a wall on one side of it only."""
    on_air = pick(ANGLE, {"closing_axis": "x", "at_m": [0.0, 0.01]})
    assert not on_air.is_feasible
    assert "the jaws close on air: they meet" in on_air.reason
    at_wall = {"closing_axis": "x", "at_m": [-0.02, 0.008], "width_m": 0.01}
    assert pick(ANGLE, at_wall).is_feasible
    beside = pick(ANGLE, {**at_wall, "width_m": 0.014})
    assert "0.0 and 0.0 mm2 of part" in beside.reason


@pytest.mark.parametrize(
    ("at_m", "diameter_m", "held"),
    [([0.0, 0.0175], 0.016, False), ([0.024, 0.0], 0.016, False), ([0.024, 0.0], 0.008, True)],
    ids=["over the hole", "too wide for the rim", "on the rim"],
)
def test_a_cup_stands_on_material_all_round(at_m, diameter_m, held):
    verdict = pick(RING, {"at_m": at_m}, {"type": "suction", "cup_diameter_m": diameter_m})
    assert verdict.is_feasible == held
    if not held:
        assert "the suction cup covers a hole or an edge of part" in verdict.reason


def test_a_narrow_cup_has_a_narrow_stem():
    """A wall 10 mm beside it and 30 mm high is in the way of the shank of a wide one."""
    well = [*RING, {"size_m": [0.002, 0.06, 0.03], "centre_m": [0.0375, 0.0, 0.015]}]
    narrow = {"type": "suction", "cup_diameter_m": 0.006}
    assert pick(well, {"at_m": [0.024, 0.0]}, narrow).is_feasible
    wide = [{"size_m": [0.03, 0.06, 0.01], "centre_m": [0.02, 0.0, 0.005]}, well[-1]]
    assert "hand runs into part" in pick(wide, {"at_m": [0.02, 0.0]}, {"type": "suction"}).reason
