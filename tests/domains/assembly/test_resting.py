"""Where parts rest without a height of their own, in space and in cases; what they rest on."""

import math

import pytest

from skillplan import load_problem
from skillplan.domains.assembly import (
    TABLE,
    AssemblyConfig,
    AssemblyDomain,
    find_bearers,
    find_goal_rests,
    get_layout,
)
from skillplan.errors import TaskError
from skillplan.task import Pose

QUARTER = math.pi / 2
FLOOR_M = 0.003
CASE = {
    "boxes": [
        {"size_m": [0.20, 0.16, FLOOR_M], "centre_m": [0.0, 0.0, FLOOR_M / 2]},
        {"size_m": [0.20, 0.004, 0.05], "centre_m": [0.0, 0.078, 0.025]},
        {"size_m": [0.20, 0.004, 0.05], "centre_m": [0.0, -0.078, 0.025]},
        {"size_m": [0.004, 0.152, 0.05], "centre_m": [0.098, 0.0, 0.025]},
        {"size_m": [0.004, 0.152, 0.05], "centre_m": [-0.098, 0.0, 0.025]},
    ],
    "goal_m": [0.5, 0.0],
    "start_m": [0.4, 0.4],
}
BOARD = {"size_m": [0.12, 0.10, 0.002], "goal_m": [0.5, 0.0], "goal_on": "case"}
SHAFT = {"cylinder": {"diameter_m": 0.02, "height_m": 0.06}}


def config_of(parts, **changes):
    """Return an assembly of some parts, which lie apart at the start unless they say where."""
    created = {}
    for number, (name, part) in enumerate(parts.items()):
        place = {} if {"start_m", "start_on"} & part.keys() else {"start_m": [0.2, 0.2 * number]}
        created[name] = {"tool": "hand", "goal_m": [0.5, 0.0], **place, **part}
    content = {
        "kind": "assembly",
        "name": "resting",
        "robot": {"home_m": [0.3, 0.0], "reach_m": 2.0},
        "tools": {"hand": {"holder_m": [0.5, 0.5], "type": "suction"}},
        "initial_tool": "hand",
        "parts": created,
        **changes,
    }
    return AssemblyConfig.model_validate(content)


def messages(config):
    """Return what is wrong with an assembly."""
    return [issue.message for issue in AssemblyDomain().issues(config)]


def test_a_board_rests_on_the_floor_of_a_case_between_its_walls():
    """Not on the walls' height; and a chip on the board rests on the board."""
    chip = {"size_m": [0.01, 0.01, 0.001], "goal_m": [0.52, 0.02], "goal_on": "board"}
    config = config_of({"case": CASE, "board": BOARD, "chip": chip})
    assert [] == messages(config)
    assert (0.5, 0.0, 0.003) == get_layout(config).goal("board").pose.position
    assert (0.52, 0.02, 0.005) == get_layout(config).goal("chip").pose.position
    (rest,) = find_goal_rests(config, "board")
    assert ("case", pytest.approx(12_000)) == (rest.on, rest.area_m2 * 1e6)


def test_a_part_over_a_wall_rests_on_the_wall():
    """A cover as long as the case; it stands on its four walls."""
    cover = {"size_m": [0.20, 0.16, 0.002], "goal_on": "case"}
    config = config_of({"case": CASE, "cover": cover})
    assert [] == messages(config)
    assert 0.05 == get_layout(config).goal("cover").pose.position[2]
    (rest,) = find_goal_rests(config, "cover")
    assert pytest.approx(2 * 200 * 4 + 2 * 152 * 4) == rest.area_m2 * 1e6


def test_a_bridge_rests_on_all_that_a_list_names():
    """And on nothing that the list leaves out, which it is told of in millimetres."""
    posts = {
        "one": {"size_m": [0.02, 0.02, 0.04], "goal_m": [0.45, 0.0]},
        "two": {"size_m": [0.02, 0.02, 0.04], "goal_m": [0.55, 0.0]},
        "low": {"size_m": [0.02, 0.02, 0.03], "goal_m": [0.50, 0.0]},
    }
    bridge = {"size_m": [0.14, 0.02, 0.01], "goal_on": ["one", "two"]}
    config = config_of({**posts, "bridge": bridge})
    assert [] == messages(config)
    assert 0.04 == get_layout(config).goal("bridge").pose.position[2]
    assert {"one", "two"} == {rest.on for rest in find_goal_rests(config, "bridge")}
    config = config_of({**posts, "bridge": {**bridge, "goal_on": ["one", "two", "low"]}})
    message = "'bridge' does not lie on 'low', but 10.0 mm above it. Leave it out."
    assert [message] == messages(config)


def test_a_turned_part_without_z_rests_with_its_lowest_point():
    """The origin of its frame, the centre of its upright bottom, is where the file says x and y."""
    lying = {**SHAFT, "goal_rpy_rad": [0.0, QUARTER, 0.0], "goal_m": [0.47, 0.0], "goal_on": "case"}
    config = config_of({"case": CASE, "shaft": {**lying, "start_rpy_rad": [QUARTER, 0.0, 0.0]}})
    assert [] == messages(config)
    assert get_layout(config).goal("shaft").pose == Pose.turned(
        (0.47, 0.0, 0.013), (0.0, QUARTER, 0.0)
    )
    assert get_layout(config).start("shaft").pose.position == (0.2, 0.2, 0.01)
    assert [("case", 0.0)] == [(r.on, r.area_m2) for r in find_goal_rests(config, "shaft")]


def test_with_three_numbers_a_part_is_where_they_say():
    """In a bore that bears it from below; it is told what it lies on."""
    block = {
        "boxes": [
            {"size_m": [0.04, 0.06, 0.02], "centre_m": [0.0, 0.0, 0.01]},
            {"size_m": [0.04, 0.06, 0.02], "centre_m": [0.0, 0.0, 0.05]},
        ]
    }
    shaft = {**SHAFT, "goal_m": [0.46, 0.0, 0.03], "goal_rpy_rad": [0.0, QUARTER, 0.0]}
    config = config_of({"block": block, "shaft": shaft})
    assert [] == messages(config)
    assert ["block"] == [rest.on for rest in find_goal_rests(config, "shaft")]
    config = config_of({"block": block, "shaft": {**shaft, "goal_m": [0.46, 0.0, 0.0335]}})
    (message,) = messages(config)
    assert "'shaft' and 'block' overlap by 3.5 mm at their goals. Move one." == message


def test_a_part_at_the_start_may_lie_anywhere_on_another():
    """On what start_on names at start_m, or at a height; then it has to go first."""
    tray = {"size_m": [0.2, 0.1, 0.01], "start_m": [0.3, 0.4], "goal_m": [0.7, 0.3]}
    for given in ({"start_on": "tray", "start_m": [0.35, 0.41]}, {"start_m": [0.35, 0.41, 0.01]}):
        chip = {"size_m": [0.01, 0.01, 0.002], **given}
        config = config_of({"tray": tray, "chip": chip})
        assert [] == messages(config)
        assert (0.35, 0.41, 0.01) == get_layout(config).start("chip").pose.position
        assert ["tray"] == find_bearers(config, "chip")
        (task,) = AssemblyDomain().ground(config, "")
        pick = next(skill for skill in task.skills if skill.name == "pick(tray)")
        assert task.facts.bit("at_start(chip)") & pick.precondition.forbids.bits


def test_old_files_keep_the_table_where_goal_on_is_left_out():
    """Also where something else is beneath, which is told as an overlap."""
    config = config_of({"case": CASE, "board": {**BOARD, "goal_on": None}})
    assert 0.0 == get_layout(config).goal("board").pose.position[2]
    assert ["'board' and 'case' overlap by 2.0 mm at their goals. Move one."] == messages(config)


def test_a_hole_is_where_the_part_it_goes_through_ends():
    """Of a case the floor, not the walls."""
    screws = {"bolt": {"tool": "driver", "hole_m": [0.52, 0.03], "through": "case"}}
    tools = {
        "hand": {"holder_m": [0.5, 0.5], "type": "suction"},
        "driver": {"holder_m": [0.6, 0.5]},
    }
    config = config_of({"case": CASE}, screws=screws, tools=tools)
    assert [] == messages(config)
    assert (0.52, 0.03, FLOOR_M) == get_layout(config).hole(config.screws["bolt"])


def test_a_hole_through_a_flange_is_at_the_face_about_it(tmp_path):
    """Not at the top of the dome beside it."""
    dome = "      - {{size_m: [0.01, 0.01, 0.03], centre_m: [-0.015, 0.015, 0.025]}}\nscrews:"
    text = DRILLED.replace("    start_m:", "START", 1).replace("screws:", "screws:", 1)
    text = text.replace("START", f"{dome.removesuffix('screws:')}    start_m:")
    path = tmp_path / "flange.yaml"
    path.write_text(text.format(hole="hole_m: [0.5, 0.0]", head_m=0.0084), "utf-8")
    config = load_problem(path).config
    assert get_layout(config).hole(config.screws["screw"]) == (0.5, 0.0, 0.01)


def test_check_says_what_every_part_rests_on():
    """In words and as JSON values, with the area."""
    config = config_of({"case": CASE, "board": BOARD})
    overview = AssemblyDomain().overview(config)
    line = f"rests      board on case (12,000.0 mm2); at the start on {TABLE} (12,000.0 mm2)"
    assert line == overview.lines[1]
    entry = overview.document["rests"][1]
    assert entry == {
        "part": "board",
        "start": [{"on": TABLE, "area_mm2": 12_000.0}],
        "goal": [{"on": "case", "area_mm2": 12_000.0}],
    }


DRILLED = """
kind: assembly
name: drilled
robot: {{home_m: [0.3, 0.0]}}
tools: {{gripper: {{holder_m: [0.6, 0.2]}}, driver: {{holder_m: [0.6, -0.2]}}}}
parts:
  plate:           # four bars about a hole of 5 mm, and two rails 5 mm apart with a stop
    tool: gripper
    boxes:
      - {{size_m: [0.04, 0.002, 0.01], centre_m: [-0.06, 0.0035, 0.005]}}
      - {{size_m: [0.04, 0.002, 0.01], centre_m: [-0.06, -0.0035, 0.005]}}
      - {{size_m: [0.0044, 0.009, 0.02], centre_m: [-0.0778, 0.0, 0.01]}}
      - {{size_m: [0.0175, 0.040, 0.01], centre_m: [-0.01125, 0.0, 0.005]}}
      - {{size_m: [0.0175, 0.040, 0.01], centre_m: [0.01125, 0.0, 0.005]}}
      - {{size_m: [0.005, 0.0175, 0.01], centre_m: [0.0, -0.01125, 0.005]}}
      - {{size_m: [0.005, 0.0175, 0.01], centre_m: [0.0, 0.01125, 0.005]}}
    start_m: [0.4, -0.2]
    goal_m: [0.5, 0.0]
screws:
  screw: {{tool: driver, {hole}, through: plate, head_diameter_m: {head_m}}}
"""
UPRIGHT = "hole_m: [0.5, 0.0, 0.01]"
ASKEW = "hole_m: [0.4825, 0.0, 0.005], axis: [1, 0, 0]"


@pytest.mark.parametrize(
    ("hole", "head_m", "message"),
    [
        (UPRIGHT, 0.0084, None),
        (UPRIGHT, 0.0045, "the head of 'screw', 4.5 mm wide, falls into the hole in 'plate'"),
        (UPRIGHT, 0.048, None),
        ("hole_m: [0.5, 0.0]", 0.0084, None),
        (UPRIGHT.replace("0.5", "0.517"), 0.0084, None),
        (UPRIGHT.replace("0.01]", "0.012]"), 0.0084, "the hole does not lie over the top"),
        (UPRIGHT.replace("0.5", "0.5012"), 0.0084, None),
        (UPRIGHT.replace("0.5", "0.5018"), 0.0084, "the hole does not lie over the top"),
        # On two rails, and on one of them.
        (UPRIGHT.replace("0.5", "0.44"), 0.0084, None),
        ("hole_m: [0.44, 0.0022, 0.01]", 0.0084, "the hole does not lie over the top"),
        ("hole_m: [0.428, 0.0, 0.01]", 0.0084, "the head of 'screw', 8.4 mm wide, runs into"),
        (ASKEW.replace("0.4825", "0.48"), 0.006, None),
        (ASKEW, 0.006, "the hole does not lie on a surface of 'plate'"),
    ],
)
def test_a_head_rests_on_the_rim_of_a_real_hole_or_on_what_is_drawn_without_one(
    tmp_path, hole, head_m, message
):
    path = tmp_path / "drilled.yaml"
    path.write_text(DRILLED.format(hole=hole, head_m=head_m), "utf-8")
    if message is None:
        assert load_problem(path).task.name == "drilled"
        return
    with pytest.raises(TaskError, match=message):
        load_problem(path)


SHELF = {"size_m": [0.10, 0.10, 0.05], "goal_m": [0.5, 0.0]}
LONG = {"size_m": [0.20, 0.04, 0.01], "goal_m": [0.56, 0.0], "goal_on": "shelf"}


def test_check_names_parts_that_tip_at_their_goals():
    """Another part beneath its end bears it, or a holder keeps it."""
    hints = list(AssemblyDomain().hints(config_of({"shelf": SHELF, "long": LONG})))
    assert [hint.path for hint in hints] == [("parts", "long", "goal_m")]
    (tipping,) = hints
    assert tipping.message == (
        "at its goal 'long' tips towards +x: nothing bears it on that side. A holder or a fit has "
        "to keep it."
    )
    foot = {"size_m": [0.02, 0.04, 0.05], "goal_m": [0.64, 0.0]}
    assert not list(AssemblyDomain().hints(config_of({"shelf": SHELF, "foot": foot, "long": LONG})))
    holders = {"fork": {"kind": "hold", "parts": "long"}}
    held = config_of({"shelf": SHELF, "long": LONG}, holders=holders)
    assert not list(AssemblyDomain().hints(held))
