"""What tools do, how parts are held, and what an assembly makes of shapes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import assembly, config_content
from skillplan import Setup, make_model, solve
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain, get_layout
from skillplan.physics import choose_grasp, grasp_boxes
from skillplan.task import AXES, Box, Cylinder, Grasp, GraspKind, ToolKind
from skillplan.testing import lid_content

CYLINDER = {"diameter_m": 0.03, "height_m": 0.02}
STEPS = [
    {"size_m": [0.06, 0.04, 0.01], "centre_m": [0.0, 0.0, 0.005]},
    {"size_m": [0.02, 0.03, 0.02], "centre_m": [0.02, 0.0, 0.02]},
]


def content_of(shape=None, *, tool=None, **grasp):
    """Return an assembly of a single part."""
    return {
        "kind": "assembly",
        "name": "single",
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {"hand": {"holder_m": [0.5, 0.3], **(tool or {})}},
        "initial_tool": "hand",
        "parts": {
            "part": {
                "tool": "hand",
                **(shape or {"size_m": [0.02, 0.04, 0.03]}),
                "grasp": grasp,
                "start_m": [0.3, 0.2],
                "goal_m": [0.5, 0.0],
            }
        },
        "step_limit": 2,
    }


def grasp_in(*arguments, **changes):
    """Return the grasp of the single part."""
    return assembly(content_of(*arguments, **changes)).scene.body("part").grasp


def issues_of(*arguments, **changes):
    """Return path and message of what is wrong with the single part."""
    config = AssemblyConfig.model_validate(content_of(*arguments, **changes))
    return [(issue.path, issue.message) for issue in AssemblyDomain().issues(config)]


def test_a_part_is_held_across_its_narrower_side():
    """Half-way down, 12 mm at most: the tip is above the middle of the part."""
    assert grasp_in() == Grasp(GraspKind.JAWS, (0.0, 0.0, 0.03 - 0.012), AXES["x"], 0.02)
    low = grasp_in({"size_m": [0.05, 0.04, 0.01]})
    assert low == Grasp(GraspKind.JAWS, (0.0, 0.0, 0.005), AXES["y"], 0.04)


def test_what_the_file_says_of_a_grasp_goes_before():
    """Axis, depth and place, each by itself."""
    assert grasp_in(closing_axis="y").width_m == 0.04
    assert grasp_in(depth_m=0.02).tip[2] == pytest.approx(0.01)
    assert grasp_in(at_m=[0.0, 0.012]).tip == (0.0, 0.012, 0.03 - 0.012)
    assert grasp_in(closing_axis="auto") == grasp_in()


def test_the_width_is_that_of_what_is_between_the_jaws():
    """What ends below the fingers does not count."""
    by_the_step = grasp_in({"boxes": STEPS})
    assert by_the_step.tip == pytest.approx((0.02, 0.0, 0.02))
    assert (by_the_step.closing_axis, by_the_step.width_m) == ("x", pytest.approx(0.02))
    deep = grasp_in({"boxes": STEPS}, depth_m=0.025)
    assert deep.width_m == pytest.approx(0.04)
    assert deep.closing_axis == "y"


def test_a_cylinder_is_as_wide_as_its_diameter():
    """Along both axes."""
    assert grasp_in({"cylinder": CYLINDER}).width_m == 0.03
    assert grasp_in({"cylinder": CYLINDER}, closing_axis="y").width_m == 0.03


def test_the_hands_own_choice_is_the_file_s():
    """What the task leaves out and what back ends make of a body without a grasp agree."""
    for name in ("inverter_board", "motor_drive"):
        content = config_content(name)
        for part in content["parts"].values():
            part.pop("grasp", None)
        content["tools"] = {
            tool: {"holder_m": entry["holder_m"]} for tool, entry in content["tools"].items()
        }
        for body in assembly(content).scene.bodies:
            if body.grasp is not None:
                assert body.grasp == grasp_boxes(body.boxes) == choose_grasp(body)


def test_suction_holds_from_above():
    """On what is highest there."""
    assert grasp_in(type="suction") == Grasp(GraspKind.SUCTION, (0.0, 0.0, 0.03), AXES["y"])
    assert grasp_in({"boxes": STEPS}, type="suction").tip == (0.0, 0.0, 0.01)
    assert grasp_in({"boxes": STEPS}, type="suction", at_m=[0.02, 0.01]).tip == (0.02, 0.01, 0.03)


def test_a_part_is_held_as_its_tool_holds():
    """A cup by suction, a gripper by its jaws; a gripper may have a cup as well."""
    assert grasp_in(tool={"type": "suction"}).kind is GraspKind.SUCTION
    assert grasp_in(tool={"type": "gripper"}).kind is GraspKind.JAWS
    assert grasp_in(tool={"type": "gripper"}, type="suction").kind is GraspKind.SUCTION


def test_a_tool_is_what_it_is_used_for_where_the_file_does_not_say():
    """One that drives screws and holds no part is a screwdriver."""
    robot = assembly(lid_content()).scene.robots[0]
    kinds = {tool.name: (tool.kind, tool.opening_m) for tool in robot.tools}
    content = lid_content()
    for part in content["parts"].values():
        part["tool"] = "gripper"
    for screw in content.get("screws", {}).values():
        screw["tool"] = "gripper"
    both = assembly(content).scene.robots[0].tools
    assert kinds["gripper"] == (ToolKind.GRIPPER, None)
    assert ToolKind.SCREWDRIVER in {kind for kind, _ in kinds.values()}
    assert all(tool.kind is ToolKind.GRIPPER for tool in both)


def test_the_board_is_held_as_a_hand_can_hold_it(board_task):
    """The PCB is wider than the jaws open; the brace is held by its bar."""
    tools = {tool.name: tool for tool in board_task.scene.robots[0].tools}
    assert (tools["gripper"].kind, tools["gripper"].opening_m) == (ToolKind.GRIPPER, 0.08)
    assert tools["screwdriver"].kind is ToolKind.SCREWDRIVER
    grasps = {body.name: body.grasp for body in board_task.scene.bodies}
    assert grasps["pcb"] == Grasp(GraspKind.SUCTION, (0.0, 0.0, 0.006), AXES["y"])
    assert grasps["brace"].width_m == 0.02
    assert grasps["brace"].tip == pytest.approx((0.0, 0.0, 0.042))
    closing = {name: grasp.closing_axis for name, grasp in grasps.items() if grasp}
    assert {name for name, axis in closing.items() if axis == "y"} == {
        "pcb",
        "switch_1",
        "switch_2",
        "transformer",
    }
    assert grasps["screw_1"] is None


def test_the_head_of_a_screw_is_a_cylinder(board_task):
    """As wide and high as the file says."""
    (head,) = board_task.scene.body("screw_1").shapes
    assert head == Cylinder(0.006, 0.002, (0.0, 0.0, 0.001))
    assert board_task.scene.body("screw_1").boxes == (
        Box((0.006, 0.006, 0.002), (0.0, 0.0, 0.001)),
    )


@given(width_m=st.floats(0.001, 0.2), depth_m=st.floats(0.001, 0.2), opening_m=st.floats(0.01, 0.2))
def test_a_part_fits_between_the_jaws_or_is_refused(width_m, depth_m, opening_m):
    """By 2 mm, across its narrower side."""
    shape = {"size_m": [width_m, depth_m, 0.02]}
    issues = issues_of(shape, tool={"opening_m": opening_m})
    narrower_m = min(width_m, depth_m)
    if abs(narrower_m - (opening_m - 0.002)) > 1e-8:
        assert bool(issues) == (narrower_m > opening_m - 0.002)
    if issues:
        ((path, message),) = issues
        assert path == ("parts", "part", "size_m")
        assert "give grasp: {type: suction}." in message


def test_the_other_axis_is_named_only_where_it_fits():
    """Else suction alone."""
    tool = {"opening_m": 0.08}
    ((path, message),) = issues_of({"size_m": [0.1, 0.04, 0.02]}, tool=tool, closing_axis="x")
    assert path == ("parts", "part", "grasp")
    assert message == (
        "0.100 m wide where the jaws of 'hand' open 0.080 m; "
        "give grasp: {closing_axis: y} or {type: suction}."
    )
    ((_, message),) = issues_of({"size_m": [0.1, 0.1, 0.02]}, tool=tool, closing_axis="x")
    assert "closing_axis" not in message


def test_jaws_that_close_on_nothing_are_refused():
    """Between two towers, where the tip would be by itself."""
    towers = [
        {"size_m": [0.01, 0.02, 0.03], "centre_m": [side * 0.02, 0.0, 0.015]} for side in (-1, 1)
    ]
    ((path, message),) = issues_of({"boxes": towers}, closing_axis="y")
    assert path == ("parts", "part", "boxes")
    assert "nothing of the part is under the jaws" in message
    assert issues_of({"boxes": towers}, closing_axis="y", at_m=[0.02, 0.0]) == []
    assert issues_of({"boxes": towers}, closing_axis="x") == []


def test_an_assembly_that_models_no_hand_is_not_asked_for_one():
    """Neither opening nor grasp: wide parts and towers are as good as any."""
    assert issues_of({"size_m": [0.5, 0.5, 0.02]}) == []


def test_cylinders_may_stand_where_only_the_boxes_about_them_overlap():
    """Diagonally, a little apart."""
    content = content_of({"cylinder": CYLINDER})
    part = content["parts"]["part"]
    content["parts"]["other"] = {**part, "start_m": [0.323, 0.223], "goal_m": [0.523, 0.023]}
    content["step_limit"] = 4
    config = AssemblyConfig.model_validate(content)
    assert [] == list(AssemblyDomain().issues(config))
    content["parts"]["other"]["goal_m"] = [0.51, 0.01]
    config = AssemblyConfig.model_validate(content)
    (issue,) = AssemblyDomain().issues(config)
    assert "overlap by 15.9 mm at their goals" in issue.message


FRAME = [
    {"size_m": [0.1, 0.008, 0.02], "centre_m": [0.0, side * 0.046, 0.01]} for side in (-1, 1)
] + [{"size_m": [0.008, 0.084, 0.02], "centre_m": [side * 0.046, 0.0, 0.01]} for side in (-1, 1)]


def test_a_wall_is_held_where_it_is():
    """The jaws are centred on the wall; without a place, on the far one."""
    near = grasp_in({"boxes": FRAME}, hold="wall", closing_axis="y", at_m=[0.0, -0.043])
    assert near.tip[:2] == pytest.approx((0.0, -0.046))
    assert (near.width_m, near.is_inner) == (pytest.approx(0.008), False)
    far = grasp_in({"boxes": FRAME}, hold="wall", closing_axis="y")
    assert far.tip[1] == pytest.approx(0.046)


def test_a_hole_is_held_from_inside():
    """The width is that of the hole, and the jaws are as thick as at their depth."""
    grasp = grasp_in({"boxes": FRAME}, hold="inner", closing_axis="x")
    assert grasp.tip[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert (grasp.width_m, grasp.inside_m) == pytest.approx((0.084, 2 * 0.0144))
    deeper = grasp_in({"boxes": FRAME}, hold="inner", closing_axis="x", depth_m=0.015)
    assert deeper.inside_m > grasp.inside_m


@pytest.mark.parametrize(
    ("grasp", "key", "words"),
    [
        ({"hold": "wall", "closing_axis": "y", "at_m": [0.0, 0.0]}, "at_m", "no wall there"),
        ({"hold": "inner", "closing_axis": "y", "at_m": [0.0, 0.046]}, "at_m", "no hole there"),
        ({"hold": "inner", "closing_axis": "y", "type": "suction"}, "closing_axis", "suction"),
    ],
)
def test_a_wall_or_hole_that_is_not_there_is_a_fault(grasp, key, words):
    path, message = issues_of({"boxes": FRAME}, **grasp)[0]
    assert path[-1] == key
    assert words in message


def test_a_hole_must_be_within_the_range_of_the_jaws():
    """Both jaws fit in closed, and reach its walls open."""
    frame = [
        {"size_m": [0.03, 0.06, 0.02], "centre_m": [side * 0.025, 0.0, 0.01]} for side in (-1, 1)
    ] + [{"size_m": [0.02, 0.02, 0.02], "centre_m": [0.0, side * 0.02, 0.01]} for side in (-1, 1)]
    ((path, message),) = issues_of({"boxes": frame}, hold="inner", closing_axis="x")
    assert path[-1] == "hold"
    assert "the hole is 0.0200 m wide" in message
    assert "hold from inside 0.0308 m to 0.1088 m" in message


def test_auto_tries_walls_and_holes_of_what_is_too_wide():
    """Check lists what it keeps and what it refuses, and so does explain by the task's notes."""
    content = content_of({"boxes": FRAME}, tool={"opening_m": 0.06})
    content["parts"]["part"]["grasp"] = "auto"
    config = AssemblyConfig.model_validate(content)
    (tried,) = AssemblyDomain().overview(config).document["automatic_grasps"]
    assert "top closing along x from inside" in tried["kept"]
    assert any("0.100 m wide" in reason for reason in tried["refused"])
    notes = assembly(content).notes["pick(part)"]
    assert any("top closing along x" in note and "0.100 m wide" in note for note in notes)


# Fits of parts: what a file may say of them, and what check and boxes make of it.


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


def fitted_content(fit, width_m=0.0206, **block):
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
    return AssemblyConfig.model_validate(fitted_content(*arguments, **block))


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
    content = fitted_content(fit, buffers="bench", grasp=[{"closing_axis": axis} for axis in "xy"])
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
    content = fitted_content(PRESS, insert_along=[1, 0, 0], insert_m=0.03)
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
