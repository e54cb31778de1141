"""Screws: head, pitch and mass follow from the size, the time from the thread; shanks need room."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path

import pytest
import trimesh
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from example_count import examples
from situations import assembly
from skillplan import Setup, load_problem, make_model, solve
from skillplan.collision import Solid
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain, get_layout
from skillplan.errors import TaskError
from skillplan.task import Box, Pose

BOXES = Setup(collision=("aabb",))
CONFIGS = Path(__file__).parents[3] / "configs"
BLOCK = {
    "kind": "assembly",
    "name": "block",
    "robot": {"home_m": [0.3, 0.0]},
    "tools": {
        "cup": {"type": "suction", "holder_m": [0.3, 0.4]},
        "driver": {"type": "screwdriver", "holder_m": [0.4, 0.4], "speed_rpm": 300},
    },
    "initial_tool": "cup",
    "feeders": {"rack": {"position_m": [0.5, 0.3], "height_m": 0.05}},
    "parts": {
        "base": {"fixed": True, "size_m": [0.1, 0.1, 0.03], "goal_m": [0.5, 0.0]},
        "lid": {
            "tool": "cup",
            "size_m": [0.1, 0.1, 0.008],
            "start_m": [0.45, -0.25],
            "goal_m": [0.5, 0.0],
            "goal_on": "base",
        },
    },
    "screws": {
        "bolt": {
            "tool": "driver",
            "through": "lid",
            "into": "base",
            "feeder": "rack",
            "hole_m": [0.53, 0.03],
            "size": "M4",
            "length_m": 0.02,
        }
    },
}


def content_of(**screw):
    """Return a lid with one M4 x 20, with other keys of the screw; None drops a key."""
    content = copy.deepcopy(BLOCK)
    bolt = content["screws"]["bolt"] | screw
    content["screws"]["bolt"] = {key: value for key, value in bolt.items() if value is not None}
    return content


def faults_of(content):
    return [str(issue) for issue in AssemblyDomain().issues(AssemblyConfig.model_validate(content))]


def screw_of(**screw):
    return AssemblyConfig.model_validate(content_of(**screw)).screws["bolt"]


@pytest.mark.parametrize(
    ("size", "head", "pitch_mm", "head_mm"),
    [
        ("M2", "socket", 0.4, (3.8, 2.0)),
        ("M2.5", "pan", 0.45, (5.0, 2.1)),
        ("M4", None, 0.7, (7.0, 4.0)),
        ("M6", "button", 1.0, (10.5, 3.3)),
        ("M12", "hex", 1.75, (18.0 * 2 / math.sqrt(3), 7.5)),
    ],
)
def test_pitch_and_head_are_those_of_the_standards(size, head, pitch_mm, head_mm):
    screw = screw_of(size=size, head=head)
    assert screw.thread_pitch_m * 1e3 == pytest.approx(pitch_mm)
    assert screw.head_diameter_m * 1e3 == pytest.approx(head_mm[0])
    assert screw.head_height_m * 1e3 == pytest.approx(head_mm[1])


def test_mass_follows_from_the_size_unless_it_is_given():
    # 20 mm of 4 mm and a head of 7 mm by 4 mm, of steel.
    steel_kg = 7850 * math.pi / 4 * (4**2 * 20 + 7**2 * 4) * 1e-9
    assert screw_of().mass_kg == pytest.approx(steel_kg, rel=1e-3)
    assert screw_of(mass_kg=0.004).mass_kg == 0.004
    assert screw_of(head_diameter_m=0.009).head_diameter_m == 0.009


@settings(max_examples=examples(12))
@given(
    length_mm=st.integers(10, 30), pitch_um=st.integers(300, 2000), speed_rpm=st.integers(50, 900)
)
def test_a_screw_is_driven_by_its_thread_at_the_speed_of_its_tool(length_mm, pitch_um, speed_rpm):
    content = content_of(length_m=length_mm / 1e3, pitch_m=pitch_um / 1e6)
    content["tools"]["driver"]["speed_rpm"] = speed_rpm
    _, drive = assembly(content).skill("fasten(bolt)").motion.routes[0].visits
    # What is below the lid, 8 mm thick, is in the thread.
    turns = (length_mm - 8) * 1e3 / pitch_um
    assert drive.dwell_s == pytest.approx(60 * turns / speed_rpm, rel=1e-3)


@pytest.mark.parametrize(
    ("path", "takes_s"),
    [
        (("screws", "bolt", "durations_s"), 7.0),
        (("tools", "driver", "durations_s"), 7.0),
        (("durations_s",), 7.0),
        (("screws", "bolt", "engagement_m"), 60 * 0.007 / 0.0007 / 300),
    ],
)
def test_a_given_time_or_engagement_comes_first(path, takes_s):
    content = content_of()
    *above, key = path
    owner = content
    for name in above:
        owner = owner[name]
    owner[key] = 0.007 if key == "engagement_m" else {"fasten": 7.0}
    _, drive = assembly(content).skill("fasten(bolt)").motion.routes[0].visits
    assert drive.dwell_s == pytest.approx(takes_s)


def test_the_result_says_what_the_time_is_from():
    content = content_of()
    task = assembly(content)
    result = solve(task, setup=BOXES)
    words = "screws.bolt: 17.1 turns over 12.0 mm, pitch 0.7 mm, at 300 rpm"
    assert result.dwells_from == (words, "durations_s")
    assert result.status == "optimal"


def test_a_screw_waits_for_the_part_with_its_thread():
    task = assembly(content_of())
    assert "placed(base)" in task.skill("fasten(bolt)").precondition.requires


@pytest.mark.parametrize(
    ("screw", "words"),
    [
        ({"into": None}, "the shank of 'bolt' is 12.0 mm deep in 'base'"),
        ({"length_m": 0.04}, "the shank of 'bolt' is 2.0 mm deep in the table"),
        ({"length_m": 0.006}, "does not reach 'base', which is 8.0 mm below its head"),
        ({"hole_depth_m": 0.015}, "20.0 mm is longer than the hole, 15.0 mm"),
        ({"torque_nm": 6.0}, "6 N m is more than 'driver' brings, 5 N m"),
        ({"torque_nm": 4.0, "other_tools": ["weak"]}, "4 N m is more than 'weak' brings, 1 N m"),
        ({"tool": "ram"}, "'ram' is a press, which turns no screw"),
        ({"into": "lid"}, "is 'through' already"),
        ({"into": "bse"}, "unknown part or fixture 'bse'"),
    ],
)
def test_check_names_what_is_wrong_with_a_hole(screw, words):
    content = content_of(**screw)
    driver = content["tools"]["driver"]
    driver["torque_nm"] = 5.0
    if "other_tools" in screw:
        content["tools"]["weak"] = driver | {"torque_nm": 1.0, "holder_m": [0.6, 0.4]}
    if "tool" in screw:
        content["tools"]["ram"] = {"type": "press", "holder_m": [0.6, 0.4]}
    if "length_m" in screw:
        content["feeders"]["rack"]["height_m"] = 0.05
    (fault,) = faults_of(content)
    assert words in fault


def test_a_level_screw_follows_its_axis_over_a_given_stretch():
    level = {"axis": [1.0, 0.0, 0.0], "hole_m": [0.5, 0.0, 0.01], "insert_m": 0.08}
    config = AssemblyConfig.model_validate(content_of(**level))
    (task,) = AssemblyDomain().ground(config, "")
    assert task.skill("fasten(bolt)").motion.routes[0].visits[-1].insert_m == 0.08
    with pytest.raises(ValidationError, match="comes along its axis anyway"):
        AssemblyConfig.model_validate(content_of(insert_m=0.08))


def test_a_feeder_is_as_high_as_the_shank_is_long():
    content = content_of()
    content["feeders"]["rack"]["height_m"] = 0.0
    (fault,) = faults_of(content)
    assert "its shank is 0.02 m long. Give a height of 0.02 m or more." in fault


def test_a_rack_has_holes_for_the_screws_that_stand_in_it():
    content = content_of()
    content["fixtures"] = {"block": {"size_m": [0.06, 0.06, 0.05], "at_m": [0.5, 0.3]}}
    assert faults_of(content) == []
    assert solve(assembly(content), setup=BOXES).status == "optimal"


def test_a_shank_that_stands_out_below_runs_into_what_lies_there():
    content = content_of(into=None)
    content["parts"]["base"] = {
        "tool": "cup",
        "size_m": [0.1, 0.1, 0.03],
        "start_m": [0.5, 0.0],
        "goal_m": [0.6, -0.3],
    }
    content["parts"]["lid"] |= {"goal_m": [0.5, 0.0, 0.03], "goal_on": "frame"}
    content["fixtures"] = {"frame": {"size_m": [0.02, 0.1, 0.03], "at_m": [0.44, 0.0]}}
    model = make_model(assembly(content), BOXES)
    facts = "at_start(base)", "placed(lid)", "hand_free", "tool(driver)", "at(home)", "fixed"
    state = model.task.facts.of(*facts)
    verdict = model.verdict(state, model.task.skill("fasten(bolt)"))
    assert "the shank of bolt runs into base on the approach" in verdict.reason
    away = model.task.facts.of("placed(base)", *facts[1:])
    assert model.verdict(away, model.task.skill("fasten(bolt)")).is_feasible


def test_a_shank_runs_into_its_own_part_anywhere_but_in_the_hole():
    """A ledge over the hole in the side of a post is in the way of the shank, not of the head."""
    content = copy.deepcopy(BLOCK)
    content["robot"]["safe_height_m"] = 0.35
    content["feeders"]["rack"] = {"position_m": [0.45, -0.4], "height_m": 0.06}
    ledge = {"size_m": [0.03, 0.06, 0.01], "centre_m": [-0.045, 0.0, 0.185]}
    boxes = [{"size_m": [0.06, 0.06, 0.2], "centre_m": [0.0, 0.0, 0.1]}, ledge]
    content["parts"] = {"post": {"fixed": True, "goal_m": [0.75, 0.0], "boxes": boxes}}
    content["screws"] = {
        "side": {
            "tool": "driver",
            "feeder": "rack",
            "through": "post",
            "hole_m": [0.72, 0.0, 0.1],
            "axis": [1, 0, 0],
            "size": "M3",
            "length_m": 0.05,
        }
    }
    reasons = []
    for content["parts"]["post"]["boxes"] in (boxes, boxes[:1]):
        model = make_model(assembly(content), BOXES)
        state = model.task.facts.of("hand_free", "tool(driver)", "at(home)", "placed(post)")
        reasons.append(model.verdict(state, model.task.skill("fasten(side)")).reason)
    assert reasons == ["the shank of side runs into post on the approach", ""]


def test_a_shank_is_carried_above_all_that_is_lower_than_the_safe_height():
    """A wall 20 mm below this height, and a shank of 25 mm, from every place of the arm."""
    content = content_of(length_m=0.025)
    content["robot"] |= {"home_m": [0.5, 0.1], "safe_height_m": 0.1}
    content["fixtures"] = {"wall": {"size_m": [0.3, 0.01, 0.08], "at_m": [0.5, 0.2]}}
    model = make_model(assembly(content), BOXES)
    for place in ("home", "driver.holder"):
        state = model.task.facts.of(
            "fixed", "placed(lid)", "placed(base)", "hand_free", "tool(driver)", f"at({place})"
        )
        assert model.verdict(state, model.task.skill("fasten(bolt)")).reason == ""


@pytest.fixture
def flange_file(tmp_path):
    """A file of a lid with a flange: a hole of 6.6 mm in it, and a roof 30 mm high beside it."""
    sizes_m = {"beside": [0.0167, 0.04, 0.006], "before": [0.0066, 0.0167, 0.006]}
    for name, size_m in {**sizes_m, "roof": [0.01, 0.02, 0.03]}.items():
        trimesh.creation.box(size_m).export(tmp_path / f"{name}.stl")
    content = content_of(into=None, size="M6", hole_m=[0.5, 0.0], length_m=0.006)
    content["parts"]["lid"] = {
        "tool": "cup",
        "meshes": [
            *({"file": "beside.stl", "centre_m": [x_m, 0, 0.003]} for x_m in (-0.01165, 0.01165)),
            *({"file": "before.stl", "centre_m": [0, y_m, 0.003]} for y_m in (-0.01165, 0.01165)),
            {"file": "roof.stl", "centre_m": [0.02, 0, 0.015]},
        ],
        "grasp": {"at_m": [0.02, 0.0]},
        "start_m": [0.45, -0.25],
        "goal_m": [0.5, 0.0],
        "goal_on": "base",
    }
    return tmp_path / "flange.yaml", content


def write(path, content):
    path.write_text(json.dumps(content))
    return load_problem(path)


def test_a_hole_in_a_flange_is_found_at_its_rim(flange_file):
    path, content = flange_file
    config = write(path, content).config
    assert get_layout(config).hole(config.screws["bolt"]) == pytest.approx((0.5, 0.0, 0.036))


@pytest.mark.parametrize(
    ("screw", "words"),
    [
        ({"size": "M8", "length_m": 0.006}, "is narrower than the shank of 'bolt', 8.0 mm"),
        ({"size": "M3"}, "the head of 'bolt', 5.5 mm wide, falls into the hole"),
        ({"length_m": 0.012}, "the shank of 'bolt' is 6.0 mm deep in 'base'"),
    ],
)
def test_a_modelled_hole_fits_head_and_shank(flange_file, screw, words):
    path, content = flange_file
    content["screws"]["bolt"] |= screw
    with pytest.raises(TaskError, match=words):
        write(path, content)


def test_a_hole_that_is_open_below_is_found_from_below():
    content = content_of(hole_m=[0.5, 0.0], axis=[0, 0, 1], into=None, through="lid")
    content["parts"]["lid"] |= {"goal_m": [0.5, 0.0, 0.3], "goal_on": None}
    config = AssemblyConfig.model_validate(content)
    assert get_layout(config).hole(config.screws["bolt"])[2] == pytest.approx(0.3)


def test_spans_of_a_line_are_those_within_a_body():
    plates = Solid(
        (Box((1.0, 1.0, 0.1), (0, 0, 0.05)), Box((1.0, 1.0, 0.2), (0, 0, 0.5))), Pose((0, 0, 0))
    )
    assert plates.spans_m((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)) == [
        pytest.approx((0.4, 0.6)),
        pytest.approx((0.9, 1.0)),
    ]


def nut(**changes):
    """Return a plate on a bolt of the base, and the nut that a socket drives onto it."""
    content = yaml.safe_load((CONFIGS / "cell_nut.yaml").read_text("utf-8"))
    for path, value in changes.items():
        section, name, key = path.split("__")
        content[section][name][key] = value
    return content


def test_a_nut_is_a_ring_that_a_socket_turns():
    """Of ISO 4032: 4.7 mm high and 8 mm across flats for M5, driven over its height."""
    config = AssemblyConfig.model_validate(nut())
    assert [issue.message for issue in AssemblyDomain().issues(config)] == []
    (task,) = AssemblyDomain().ground(config, "")
    body = task.scene.body("nut")
    assert body.height_m == pytest.approx(0.0047)
    assert max(shape.reach_m((1.0, 0.0, 0.0)) for shape in body.shapes) == pytest.approx(
        0.004 / math.cos(math.pi / 6)
    )
    # Room for the bolt, and a socket that the nut fits in.
    assert min(math.hypot(*corner[:2]) for s in body.shapes for corner in s.corners) > 0.0025
    (spindle,) = (tool for tool in task.scene.robots[0].tools if tool.name == "spindle")
    walls = [s for s in spindle.shapes if s.box.centre[2] - s.box.size[2] / 2 < -0.002]
    assert min(math.hypot(*c[:2]) for s in walls for c in s.corners) > 0.004 / math.cos(math.pi / 6)
    visits = task.skill("fasten(nut)").motion.routes[0].visits
    assert visits[-1].dwell_s == pytest.approx(4.7 / 0.8 / 340 * 60)
    assert "placed(plate)" not in task.skill("fasten(nut)").precondition.requires
    assert "placed(base)" in task.skill("fasten(nut)").precondition.requires


def test_a_socket_is_as_deep_as_given():
    """So its rim stays above what a thin nut lies on."""
    (task,) = AssemblyDomain().ground(
        AssemblyConfig.model_validate(nut(tools__spindle__socket_depth_m=0.0015)), ""
    )
    (spindle,) = (tool for tool in task.scene.robots[0].tools if tool.name == "spindle")
    rim_m = min(shape.box.centre[2] - shape.box.size[2] / 2 for shape in spindle.shapes)
    assert rim_m == pytest.approx(-0.0015)


def test_a_thread_of_no_size_is_as_drawn():
    content = nut(screws__nut__thread_m=0.0054, screws__nut__head_height_m=0.005)
    content["screws"]["nut"]["head_diameter_m"] = 0.016 / math.sqrt(3)
    del content["screws"]["nut"]["size"]
    config = AssemblyConfig.model_validate(content)
    assert [issue.message for issue in AssemblyDomain().issues(config)] == []
    assert config.screws["nut"].describe() == "5.4 mm nut"
    inner_m = min(math.hypot(*c[:2]) for s in config.screws["nut"].shapes for c in s.corners)
    assert 0.0027 < inner_m < 0.0035


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"screws__nut__size": "M6"}, "a socket of 8 mm, and 'nut' is 10 mm wide"),
        (
            {"screws__nut__head": "pan", "screws__nut__length_m": 0.012},
            "a socket, which turns head: hex or nut",
        ),
        ({"tools__spindle__model": "screwdriver_spindle"}, "a nut needs a socket"),
        ({"screws__nut__into": None}, "give 'into', the part with the bolt"),
        ({"screws__nut__length_m": 0.01}, "a nut has no shank"),
        ({"screws__nut__thread_m": 0.0054}, "give 'size' instead, or 'head_diameter_m'"),
        ({"screws__nut__hole_m": [0.54, 0.0]}, "'base' has no bolt on its axis"),
        ({"screws__nut__torque_nm": 6.0}, "more than 'spindle' brings"),
        ({"tools__spindle__bit_diameter_m": 0.009}, "is no socket about 0.008 m"),
        ({"tools__spindle__type": "press"}, "only a screwdriver has a socket"),
        ({"tools__spindle__socket_depth_m": 0.005}, "5 mm deep, and 'nut' is 4.7 mm high"),
    ],
)
def test_a_nut_without_its_bolt_or_socket_is_a_fault(changes, words):
    try:
        issues = AssemblyDomain().issues(AssemblyConfig.model_validate(nut(**changes)))
        messages = [issue.message for issue in issues]
    except ValidationError as error:
        messages = [str(error)]
    assert any(words in message for message in messages)
