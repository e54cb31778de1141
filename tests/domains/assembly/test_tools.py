"""Tools of the changer: length, shapes and facts, and the checks that follow them."""

import json
import math

import pytest
from pydantic import ValidationError

from situations import assembly
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain, find_hints
from skillplan.physics import plan_linear_motions
from skillplan.robots import STANDARD_HAND
from skillplan.task import ToolKind

WEDGE = """v 0 -0.01 0
v 0 0.01 0
v 0.01 -0.01 0
v 0.01 0.01 0
v 0 -0.01 0.05
v 0 0.01 0.05
f 1 2 4 3
f 1 5 6 2
f 3 4 6 5
f 1 3 5
f 2 6 4
"""
OWN = """kind: tool
name: wedges
type: gripper
opening_m: 0.05
fingers: {meshes: [{file: wedge.obj, centre_m: [0.005, 0, 0.025]}]}
body: {size_m: [0.08, 0.05, 0.07]}
"""
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


# Facts of data sheets: type, opening or diameter, force and mass.
FACTS = {
    "cup": (ToolKind.SUCTION, 0.030, 42, 0.35),
    "four_cups": (ToolKind.SUCTION, 0.020, 75, 0.5),
    "franka_hand": (ToolKind.GRIPPER, 0.080, 70, 0.73),
    "robotiq_2f85": (ToolKind.GRIPPER, 0.085, 235, 0.925),
    "robotiq_2f140": (ToolKind.GRIPPER, 0.140, 125, 1.025),
    "long_jaws": (ToolKind.GRIPPER, 0.200, 500, 6),
    "wide_jaws": (ToolKind.GRIPPER, 0.400, 500, 10),
    "screwdriver_spindle": (ToolKind.SCREWDRIVER, 0.0073, None, 2.5),
    "socket_spindle": (ToolKind.SCREWDRIVER, 0.008, None, 2.5),
    "press_cylinder": (ToolKind.PRESS, 0.016, 188, 0.45),
    "needle_dispenser": (ToolKind.DISPENSER, 0.0009, None, 0.35),
}
LENGTHS_M = {"franka_hand": 0.11225, "robotiq_2f85": 0.1628, "robotiq_2f140": 0.2328}


def test_the_catalogue_has_the_facts_of_data_sheets_and_says_whence(check):
    _, _, unknown = check("robotiq_2f84")
    assert "Did you mean 'robotiq_2f85'?" in unknown
    for name, facts in FACTS.items():
        code, out, err = check(name, "--format", "json")
        document = json.loads(out)
        assert (code, err, document["schema"]) == (0, "", "skillplan.tool/1")
        assert document["sources"]
        own = document["facts"]
        sizes = ("opening_m", "cup_diameter_m", "socket_m", "bit_diameter_m")
        size = next(own[key] for key in sizes if key in own)
        assert (own["type"], size, own.get("force_n"), own["mass_kg"]) == facts
        assert own["length_m"] == pytest.approx(LENGTHS_M.get(name, own["length_m"]))


def test_keys_of_the_task_come_before_those_of_the_model():
    content = content_of({"model": "robotiq_2f140", "force_n": 60})
    (tool,) = assembly(content).scene.robots[0].tools
    assert (tool.force_n, tool.mass_kg, tool.opening_m) == (60, 1.025, 0.140)
    assert tool.beyond_m == pytest.approx(0.2328 - 0.11225)
    spelled_out = AssemblyConfig.model_validate(content).model_dump()
    assert "model" not in spelled_out["tools"]["hand"]


def test_a_file_beside_the_task_is_a_tool(tmp_path, check):
    """Its meshes are beside it, and its faults have the place where the task names it."""
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "wedge.obj").write_text(WEDGE, "utf-8")
    own = tmp_path / "tools" / "own.yaml"
    own.write_text(OWN, "utf-8")
    content = content_of({"model": "tools/own.yaml"})
    config = AssemblyConfig.model_validate(content, context={"folder": tmp_path})
    hand = config.tools["hand"].hand_on(STANDARD_HAND)
    assert [len(piece) for piece in hand.jaw] == [6]
    assert hand.tip_m == pytest.approx(0.05 + 0.07)
    own.write_text(OWN.replace("opening_m", "openning_m"), "utf-8")
    with pytest.raises(ValidationError, match=r"own.yaml': openning_m"):
        AssemblyConfig.model_validate(content, context={"folder": tmp_path})
    code, _, err = check(own)
    assert (code, "opening_m" in err) == (2, True)


def test_suction_bears_mass_and_acceleration_with_a_safety_factor():
    """The load cases of the maker: below the cup, and at its side."""

    def heaviest(grasp, **tool):
        content = content_of({"model": "cup", **tool}, grasp=grasp)
        messages = []
        for mass_kg in (0.5, 1.0, 1.2):
            content["parts"]["part"]["mass_kg"] = mass_kg
            messages.append([message for _, message in issues_of(content)])
        return [not any("of suction" in line for line in lines) for lines in messages]

    # 42 N / (2 x (9.81 + 5 / 0.5) m/s2) = 1.06 kg
    assert heaviest({}) == [True, True, False]
    assert heaviest({}, safety_factor=1, acceleration_m_per_s2=0) == [True] * 3
    # 42 N / (2 x (9.81 + 5) / 0.5 m/s2) = 0.71 kg
    assert heaviest({"approach": [1, 0, 0]}) == [True, False, False]


@pytest.mark.parametrize(
    ("tool", "path", "words"),
    [
        ({"bit_length_m": 0.1}, ("bit_length_m",), "has no bit"),
        ({"cups_m": [[0, 0]]}, ("cups_m",), "has no cups"),
        ({"outer_grip_m": [0.04, 0.06]}, None, "holds 0.04 to 0.06 m from outside"),
        ({"length_m": 0.1}, ("length_m",), "shorter than the arm's hand"),
        ({"type": "suction", "safety_factor": 2}, ("safety_factor",), "without 'force_n'"),
    ],
)
def test_a_key_without_effect_is_a_fault(tool, path, words):
    found = issues_of(content_of(tool))
    assert any(words in message for _, message in found)
    assert path is None or any(place == ("tools", "hand", *path) for place, _ in found)


def test_cups_have_opposite_ones_and_all_of_them_land():
    with pytest.raises(ValidationError, match="no cup is opposite"):
        AssemblyConfig.model_validate(content_of({"type": "suction", "cups_m": [[0.01, 0.0]]}))
    cups = {"type": "suction", "cups_m": [[0.02, 0.0], [-0.02, 0.0]]}
    assert any("nothing of the part" in message for _, message in issues_of(content_of(cups)))


def glued(**bead):
    """Return a lid that comes on a base after a bead, and is pressed then."""
    content = content_of()
    box = content["parts"].pop("part")
    content["parts"] = {
        "base": {**box, "size_m": [0.06, 0.06, 0.02]},
        "lid": {**box, "size_m": [0.04, 0.04, 0.01], "start_m": [0.4, -0.2], "goal_on": "base"},
    }
    content["tools"] |= {
        "glue": {"type": "dispenser", "holder_m": [0.3, 0.3], "length_m": 0.15},
        "ram": {"type": "press", "holder_m": [0.3, -0.3], "force_n": 60},
    }
    path = {"path_m": [[0.48, 0.0], [0.52, 0.0], [0.52, 0.02]]}
    content["works"] = {
        "bead": {"tool": "glue", "part": "base", "before": ["lid"], **(bead or path)},
        "bond": {"tool": "ram", "part": "lid", "at_m": [0.5, 0.0], "force_n": 50},
    }
    del content["step_limit"]
    return content


def test_a_dispenser_follows_its_path_above_the_part_before_the_next_comes():
    task = assembly(glued())
    skills = {skill.name: skill for skill in task.skills}
    assert "dispensed(bead)" in skills["place(lid)"].precondition.requires
    assert {"pressed(bond)", "dispensed(bead)"} <= set(task.goal.requires)
    state = skills["dispense(bead)"].precondition.requires | task.facts.of("at(home)")
    (motion,) = plan_linear_motions(task, skills["dispense(bead)"], state)
    # 1 mm above the base, which is 0.02 m high; the arm stays behind the needle.
    xy = [(0.48, 0.0), (0.52, 0.0), (0.52, 0.02)]
    behind_m = 0.15 - 0.11225
    assert [point[:2] for point in motion.approach] == [xy[0], *xy]
    assert motion.approach[-1][2] == pytest.approx(0.021 + behind_m)
    # 60 mm at 0.05 m/s, not at the speed of travels, too.
    first_s = math.dist(task.scene.robots[0].places["at(home)"][:2], xy[0]) / 0.25
    assert skills["dispense(bead)"].duration_s.at(state) == pytest.approx(first_s + 0.06 / 0.05)
    state = skills["press(bond)"].precondition.requires | task.facts.of("at(home)")
    (pressed,) = plan_linear_motions(task, skills["press(bond)"], state)
    assert (pressed.visit.press_n, pressed.tip[2]) == (50, pytest.approx(0.03))


@pytest.mark.parametrize(
    ("work", "path", "words"),
    [
        ({"at_m": [0.6, 0.0]}, ("at_m",), "not lie over the top of 'base'"),
        ({"at_m": [0.5, 0.0], "tool": "hand"}, ("tool",), "no press or dispenser"),
        ({"at_m": [0.5, 0.0], "force_n": 9}, ("force_n",), "does not press"),
        ({"at_m": [0.5, 0.0], "before": ["base"]}, ("before", 0), "can come later"),
        ({"at_m": [0.5, 0.0], "tool": "ram"}, ("force_n",), "needs its force"),
        ({"at_m": [0.5, 0.0], "tool": "ram", "force_n": 99}, ("force_n",), "more than 'ram' has"),
        ({"at_m": [0.5, 0.0], "part": "bse"}, ("part",), "Did you mean 'base'?"),
    ],
)
def test_faults_of_works_have_their_key(work, path, words):
    content = glued(**work)
    assert any(
        words in message and place == ("works", "bead", *path)
        for place, message in issues_of(content)
    )


def duo(**changes):
    """Return a part that a cup on the side of a gripper holds, and one that the gripper holds."""
    content = content_of({"type": "gripper", "length_m": 0.15})
    cup = {
        "type": "suction",
        "mounted_on": "hand",
        "mount_m": [0.0, 0.04, 0.05],
        "mount_rpy_rad": [-math.pi / 2, 0.0, 0.0],
        "length_m": 0.06,
        "mass_kg": 0.2,
        **changes,
    }
    content["tools"]["cup"] = {key: value for key, value in cup.items() if value is not None}
    content["parts"]["lid"] = {
        **content["parts"]["part"],
        "tool": "cup",
        "start_m": [0.4, -0.2],
        "goal_m": [0.6, 0.0],
    }
    del content["step_limit"]
    return content


def test_two_tools_on_a_hand_are_attached_at_once():
    """The tip of the acting one is at the part; the hand lies level with the cup across it."""
    task = assembly(duo())
    assert [skill.name for skill in task.skills if "load" in skill.name] == ["load(hand)"]
    skill = task.skill("pick(lid)")
    assert "tool(hand)" in skill.precondition.requires
    state = skill.precondition.requires | task.facts.of("at(home)")
    (motion,) = plan_linear_motions(task, skill, state)
    target = skill.motion.visits(state)[0].pose.apply(task.scene.body("lid").grasp.tip)
    assert motion.tool_tip == pytest.approx(target, abs=1e-9)
    assert motion.tool_points == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
    assert motion.points[2] == pytest.approx(0.0, abs=1e-9)
    # The flange is 0.05 + 0.06 m above the rim, and 0.05 m behind the axis of the cup.
    flange = motion.hand.apply((0.0, 0.0, -STANDARD_HAND.tip_on_flange.xyz_m[2]))
    assert flange[2] - target[2] == pytest.approx(0.04 + 0.06)
    assert math.dist(flange[:2], target[:2]) == pytest.approx(0.05)
    # Also the hand, which lies level, is at the safe height above the target.
    assert motion.above[2] - 0.09 > task.scene.robots[0].safe_height_m


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mounted_on": None}, "needs 'mounted_on'"),
        ({"mounted_on": "hnd"}, "unknown tool 'hnd'. Did you mean 'hand'"),
        ({"holder_m": [0.3, 0.3]}, "is that of the tool that it is mounted on"),
        ({"mass_kg": None}, "key 'mass_kg' is missing"),
        ({"envelope_m": [0.1, 0.1, 0.1]}, "give 'body' instead"),
        ({"type": "gripper"}, "a gripper is on the flange itself"),
    ],
)
def test_a_mounted_tool_without_its_keys_is_a_fault(changes, words):
    try:
        messages = [message for _, message in issues_of(duo(**changes))]
    except ValidationError as error:
        messages = [str(error)]
    assert any(words in message for message in messages)


def test_a_part_is_for_one_of_the_tools_on_a_hand():
    """Else one of them might place what the other one has picked."""
    content = duo()
    content["parts"]["lid"]["other_tools"] = ["hand"]
    assert issues_of(content) == [
        (
            ("parts", "lid", "other_tools", 0),
            "'hand' and 'cup' are on one hand, and one of them has to pick and place the part. "
            "Name only one.",
        )
    ]


def test_a_dwell_of_another_tool_has_an_effect():
    content = content_of()
    content["tools"]["cup"] = {"type": "suction", "holder_m": [0.3, 0.4]}
    content["tools"]["cup"]["durations_s"] = {"pick": 1.0}
    content["parts"]["part"]["other_tools"] = ["cup"]
    assert not list(find_hints(AssemblyConfig.model_validate(content)))


def test_a_hand_with_a_driver_on_its_side_lies_away_from_the_base():
    """The turn about a bit is free, and the arm reaches farthest outwards."""
    content = duo(type="screwdriver")
    del content["parts"]["lid"]
    content["screws"] = {"screw": {"tool": "cup", "hole_m": [0.5, 0.01], "through": "part"}}
    task = assembly(content)
    skill = task.skill("fasten(screw)")
    state = skill.precondition.requires | task.facts.of("at(home)")
    (motion,) = plan_linear_motions(task, skill, state)
    away = math.hypot(0.5, 0.01)
    assert motion.points == pytest.approx((0.5 / away, 0.01 / away, 0.0), abs=1e-9)
    assert motion.tool_points == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
