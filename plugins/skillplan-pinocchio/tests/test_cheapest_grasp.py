"""With time as cost, the grasp of a part is the one whose pick and place take least."""

from __future__ import annotations

import pytest

from situations import assembly
from skillplan.pipeline import Setup, solve

PEDESTAL = {"size_m": [0.08, 0.08, 0.12]}
TOP, SIDE = {"closing_axis": "y"}, {"approach": [1, 0, 0], "closing_axis": "y"}


def plan_of(grasps, cost):
    """Return the plan of a peg from one pedestal to another, and its time [s]."""
    content = {
        "kind": "assembly",
        "name": "choice",
        "robot": {"name": "panda", "home_m": [0.4, 0.0], "safe_height_m": 0.28},
        "tools": {"hand": {"holder_m": [0.3, 0.4], "type": "gripper"}},
        "initial_tool": "hand",
        "cost": cost,
        "fixtures": {
            "first": {**PEDESTAL, "at_m": [0.56, -0.08]},
            "second": {**PEDESTAL, "at_m": [0.58, 0.2]},
        },
        "parts": {
            "peg": {
                "tool": "hand",
                "size_m": [0.024, 0.024, 0.07],
                "grasp": grasps,
                "start_m": [0.56, -0.08],
                "start_on": "first",
                "goal_m": [0.58, 0.2],
                "goal_on": "second",
            }
        },
    }
    result = solve(assembly(content), setup=Setup(collision=("swept",)))
    assert result.status == "optimal"
    return [step.way for step in result.steps], sum(step.duration_s for step in result.steps)


@pytest.mark.slow(
    reason="plans trajectories by both grasps; a cheaper choice of directions in every run"
)
def test_the_cheaper_grasp_is_taken_wherever_it_stands():
    """With a distance, which no grasp changes, the first is."""
    side = {**SIDE, "at_m": [0.0, 0.0, 0.045]}
    ways, taken_s = plan_of([side, TOP], "time")
    assert ways == ["grasp top", "grasp top"]
    assert plan_of(side, "time")[1] > taken_s
    assert plan_of([side, TOP], "distance")[0] == ["grasp -x", "grasp -x"]
