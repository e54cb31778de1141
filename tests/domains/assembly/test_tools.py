"""Tools of the changer: length, shapes and facts, and the checks that follow them."""

import pytest

from situations import assembly
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.physics import plan_linear_motions

BY_SIDE = {"approach": [1.0, 0.0, 0.0], "closing_axis": "y"}


def content_of(tool=None, *, grasp=None, goal_m=(0.5, 0.0), **robot):
    """Return an assembly of one part with one tool."""
    return {
        "kind": "assembly",
        "name": "single",
        "robot": {"home_m": [0.4, 0.0], **robot},
        "tools": {"hand": {"holder_m": [0.5, 0.3], **(tool or {})}},
        "initial_tool": "hand",
        "parts": {
            "part": {
                "tool": "hand",
                "size_m": [0.03, 0.03, 0.06],
                "grasp": grasp or {},
                "start_m": [0.4, 0.2],
                "goal_m": list(goal_m),
            }
        },
        "step_limit": 2,
    }


def motions_of(task):
    """Return the motions of picking and placing the part."""
    state, motions = task.initial, []
    for name in ("pick(part)", "place(part)"):
        skill = next(skill for skill in task.skills if skill.name == name)
        motions += plan_linear_motions(task, skill, state)
        state = skill.prediction_in(state).apply(state)
    return motions


def issues_of(content):
    """Return path and message of the faults of a task."""
    config = AssemblyConfig.model_validate(content)
    return [(issue.path, issue.message) for issue in AssemblyDomain().issues(config)]


@pytest.mark.parametrize("grasp", [{}, BY_SIDE], ids=["from above", "from the side"])
@pytest.mark.parametrize("length_m", [0.112, 0.2])
def test_the_tip_of_a_tool_goes_where_the_hand_would_and_the_arm_stays_behind(grasp, length_m):
    own = motions_of(assembly(content_of(grasp=grasp)))
    longer = motions_of(assembly(content_of({"length_m": length_m}, grasp=grasp)))
    beyond_m = length_m - 0.11225
    for motion, before in zip(longer, own, strict=True):
        assert motion.tool_tip == pytest.approx(before.tip)
        behind = [a - b for a, b in zip(before.tip, motion.tip, strict=True)]
        assert behind == pytest.approx([beyond_m * axis for axis in motion.points])
