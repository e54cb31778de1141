"""Fits of parts: what a file may say of them, and what check and boxes make of it."""

from __future__ import annotations

import pytest

from skillplan import Setup, make_model, solve
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain, get_layout

BOXES = Setup(collision=("aabb",))
# A pocket of 20 mm in walls of 8 mm on a floor of 10 mm.
HOUSING = [{"size_m": [0.06, 0.06, 0.01], "centre_m": [0.0, 0.0, 0.005]}] + [
    {"size_m": size, "centre_m": [x, y, 0.014]}
    for size, x, y in (
        ([0.02, 0.06, 0.008], 0.02, 0.0),
        ([0.02, 0.06, 0.008], -0.02, 0.0),
        ([0.02, 0.02, 0.008], 0.0, 0.02),
        ([0.02, 0.02, 0.008], 0.0, -0.02),
    )
]
PRESS = {"kind": "press", "drawn_m": -0.0003, "force_n": 20.0, "lead_in_m": 0.0005}
GLUE = {"kind": "glued", "drawn_m": 0.0001, "wait_s": 20.0}


def content_of(fit, width_m=0.0206, **block):
    """Return a block that goes into the pocket of a fixed housing."""
    return {
        "kind": "assembly",
        "name": "fit",
        "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.15},
        "tools": {"hand": {"holder_m": [0.3, 0.4], "type": "gripper", "force_n": 70.0}},
        "initial_tool": "hand",
        "cost": "time",
        "parts": {
            "housing": {"fixed": True, "boxes": HOUSING, "goal_m": [0.5, 0.1]},
            "block": {
                "tool": "hand",
                "size_m": [width_m, width_m, 0.02],
                "start_m": [0.5, -0.2],
                "goal_m": [0.5, 0.1],
                "goal_on": "housing",
                **({} if fit is None else {"fits": {"housing": fit}}),
                **block,
            },
        },
    }


def config_of(*arguments, **block):
    return AssemblyConfig.model_validate(content_of(*arguments, **block))


def messages(*arguments, **block):
    return [issue.message for issue in AssemblyDomain().issues(config_of(*arguments, **block))]


def solution_of(*arguments, **block):
    (task,) = AssemblyDomain().ground(config_of(*arguments, **block), "")
    return solve(task, setup=BOXES)


def test_a_part_rests_as_deep_as_its_fit_lets_it_in():
    """With a smaller overlap, the walls hold it up, and check gives both numbers."""
    assert get_layout(config_of(PRESS)).goal("block").pose.position[2] == pytest.approx(0.01)
    assert messages(PRESS) == []
    (message,) = messages({**PRESS, "drawn_m": -0.0001})
    assert "0.3" in message
    assert "where its fit states 0.1 mm" in message


def test_only_the_stated_overlap_is_allowed():
    """At a given height without the fit it overlaps; with it, boxes let it in."""
    (message,) = messages(None, goal_m=[0.5, 0.1, 0.01])
    assert "overlap by 0.3 mm" in message
    assert solution_of(PRESS).status == "optimal"


def test_the_stated_overlap_is_one_of_the_sides():
    """A block of 20.6 mm may be wider than its pocket, but not 6 mm deep in a floor."""
    deep = {"kind": "snap", "drawn_m": -0.0065, "force_n": 25.0, "stop": "arm"}
    (message,) = messages(deep, goal_m=[0.5, 0.1, 0.004])
    assert "'block' is 6.0 mm deep in 'housing' along its insertion" in message
    assert solution_of(deep, goal_m=[0.5, 0.1, 0.004]).status == "infeasible"


def test_a_fit_in_a_part_that_is_elsewhere_is_a_fault():
    (message,) = messages(PRESS, goal_m=[0.6, 0.1], goal_on=None)
    assert "is 59.7 mm from 'block' at its goal" in message


def test_a_press_fit_holds_a_part_that_nothing_bears():
    """Higher than the floor of its pocket; a sliding part floats there."""
    assert messages({**PRESS, "stop": "arm"}, goal_m=[0.5, 0.1, 0.012]) == []
    assert solution_of({**PRESS, "stop": "arm"}, goal_m=[0.5, 0.1, 0.012]).status == "optimal"
    (message,) = messages({"kind": "clearance", "drawn_m": 0.0}, 0.0198, goal_m=[0.5, 0.1, 0.012])
    assert "floats 2.0 mm above 'housing'" in message


def test_a_fit_does_not_act_in_a_buffer():
    """A block that is put down 5 mm deep in the side of the housing runs into it."""
    fit = {"kind": "snap", "drawn_m": -0.006, "force_n": 25.0}
    content = content_of(fit, buffers="bench", grasp=[{"closing_axis": axis} for axis in "xy"])
    content["buffers"] = {"bench": {"at_m": [0.5, 0.1353]}}
    content["parts"]["housing"] |= {"fixed": False, "tool": "hand", "start_m": [0.4, -0.35]}
    (task,) = AssemblyDomain().ground(AssemblyConfig.model_validate(content), "")
    state = task.facts.of(
        "placed(housing)", "held(block)", "grasp(block.top_x)", "tool(hand)", "at(home)"
    )
    model = make_model(task, BOXES)
    verdict = model.verdict(state, task.skill("place(block.bench)"))
    assert verdict.reason == "block runs into housing on the approach"
    assert model.verdict(state, task.skill("place(block)")).is_feasible


def test_a_fit_acts_on_the_last_stretch_alone():
    """A ledge is 0.4 mm in the way down to where a block is pushed in from the side."""
    ledge = {"size_m": [0.02, 0.06, 0.01], "centre_m": [-0.0499, 0.0, 0.055]}
    content = content_of(PRESS, insert_along=[1, 0, 0], insert_m=0.03)
    reasons = []
    for boxes in ([HOUSING[0], ledge], HOUSING[:1]):
        content["parts"]["housing"]["boxes"] = boxes
        (task,) = AssemblyDomain().ground(AssemblyConfig.model_validate(content), "")
        state = task.facts.of("placed(housing)", "held(block)", "tool(hand)", "at(home)")
        reasons.append(make_model(task, BOXES).verdict(state, task.skill("place(block)")).reason)
    assert reasons == ["block runs into housing on the approach", ""]


def test_glue_costs_its_waiting_time():
    sliding = {"kind": "clearance", "drawn_m": 0.0001}
    longer_s = solution_of(GLUE, 0.0198).cost - solution_of(sliding, 0.0198).cost
    assert longer_s == pytest.approx(20.0)


def test_the_stop_that_boxes_do_not_check_is_named():
    result = solution_of(PRESS)
    assert any("stops of fits" in line for line in result.not_checked)


@pytest.mark.parametrize(
    ("fit", "words"),
    [
        ({**PRESS, "drawn_m": 0.0}, "must be below 0"),
        ({"kind": "snap", "drawn_m": -0.0003}, "'force_n' is missing"),
        ({"kind": "clearance", "drawn_m": -0.0003}, "Give press, snap or compliant"),
        ({"kind": "glued", "drawn_m": 0.0}, "'wait_s' is missing"),
        ({**PRESS, "wait_s": 3.0}, "is for glue"),
        ({"kind": "clearance", "drawn_m": 0.0, "stop": "arm"}, "nothing would hold the part"),
        ({"drawn_m": 0.0}, "give 'kind', or 'play_m'"),
        ({"drawn_m": 0.0, "play_m": 0.0, "force_n": 3.0}, "needs 'kind'"),
        ({**PRESS, "play_m": 0.0001}, "pieces without a kind"),
    ],
)
def test_a_fit_that_contradicts_itself_is_a_fault(fit, words):
    with pytest.raises(ValueError, match=words):
        config_of(fit)
