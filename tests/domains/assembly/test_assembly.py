"""The assembly domain: from content to tasks."""

import math
from typing import Any

import pytest

from situations import assembly, config_content
from skillplan.domains.assembly import MOST_STEPS, AssemblyConfig, AssemblyDomain
from skillplan.model import replay
from skillplan.pipeline import Setup, make_model
from skillplan.testing import DomainSuite, lid_content, reachable_states


class TestAssemblyDomain(DomainSuite):
    domain = "assembly"
    content = lid_content()


class TestAssemblyDomainOnTheBoard(DomainSuite):
    domain = "assembly"
    content = config_content("inverter_board")


class TestAssemblyDomainOnTheMotorDrive(DomainSuite):
    domain = "assembly"
    content = config_content("motor_drive")


def test_the_board_has_the_actions_of_figure_6(board_task):
    """Sixteen, in its order."""
    parts = ("pcb", "switch_1", "switch_2", "clock", "transformer", "brace")
    expected = [f"{kind}({part})" for part in parts for kind in ("pick", "place")]
    expected += ["load(gripper)", "load(screwdriver)", "fasten(screw_1)", "fasten(screw_2)"]
    assert expected == [skill.name for skill in board_task.skills]


def test_the_board_has_the_observation_of_figure_5(board_task):
    """Seventeen bits: two for each part, screws, tool, tool state, last action."""
    state = board_task.initial
    assert board_task.observe(state) == (1, 0) * 6 + (0, 0, 0, 0, 0)
    state = board_task.skill("pick(pcb)").prediction.apply(state)
    assert board_task.observe(state) == (0, 0) + (1, 0) * 5 + (0, 0, 0, 1, 0)
    state = board_task.skill("place(pcb)").prediction.apply(state)
    assert board_task.observe(state) == (0, 1) + (1, 0) * 5 + (0, 0, 0, 0, 0)
    state = board_task.skill("load(screwdriver)").prediction.apply(state)
    assert board_task.observe(state) == (0, 1) + (1, 0) * 5 + (0, 0, 1, 0, 1)
    state = board_task.skill("fasten(screw_2)").prediction.apply(state)
    assert board_task.observe(state)[-5:] == (0, 1, 1, 0, 0)


SKILLS = {
    # Table I: precondition, what is added, what no longer holds of the facts required.
    "pick(clock)": (
        "at_start(clock) and tool(gripper) and hand_free",
        {"held(clock)", "at(clock.start)"},
        {"at_start(clock)", "hand_free"},
    ),
    "place(clock)": (
        "held(clock) and tool(gripper)",
        {"placed(clock)", "hand_free", "at(clock.goal)"},
        {"held(clock)"},
    ),
    "load(screwdriver)": (
        "hand_free and not tool(screwdriver)",
        {"tool(screwdriver)", "changed_tool", "at(screwdriver.holder)"},
        {"tool(gripper)"},
    ),
    "fasten(screw_1)": (
        "tool(screwdriver) and hand_free and not fastened(screw_1)",
        {"fastened(screw_1)", "at(screw_1)"},
        set(),
    ),
}


@pytest.mark.parametrize("name", SKILLS)
def test_a_skill_of_the_board_is_that_of_table_1(board_task, name):
    """Precondition and prediction."""
    condition, added, deleted = SKILLS[name]
    skill = board_task.skill(name)
    assert str(skill.precondition) == condition
    assert set(skill.prediction.add) == added
    stands = {fact for fact in board_task.facts.names if fact.startswith("at(")}
    assert set(skill.prediction.delete) - stands - {"changed_tool"} == deleted
    assert (stands | {"changed_tool"}) - added <= set(skill.prediction.delete)


def test_separate_tool_changes_are_offload_and_load(motor_drive_task):
    """The fifth skill of Table I."""
    offload = motor_drive_task.skill("offload(gripper)")
    assert str(offload.precondition) == "tool(gripper) and hand_free"
    assert {"no_tool", "at(gripper.holder)"} == set(offload.prediction.add)
    load = motor_drive_task.skill("load(screwdriver)")
    assert str(load.precondition) == "no_tool and hand_free"


@pytest.mark.parametrize("reload", [False, True])
def test_loading_the_attached_tool_may_be_tried_only_if_the_task_says_so(reload):
    """It would put the tool back and take it again."""
    content = config_content("inverter_board")
    content["tool_change"]["reload"] = reload
    task = assembly(content)
    assert task.skill("load(gripper)").precondition.holds(task.initial) is reload


def test_a_swap_runs_by_the_holder_of_the_tool_that_is_put_back():
    """The way there counts, from wherever the arm stands."""
    content = config_content("inverter_board")
    content["tools"]["screwdriver"]["holder_m"] = [0.642, 0.070]
    task = assembly(content)
    load = task.skill("load(screwdriver)")
    assert [visit.subject for visit in load.motion.visits(task.initial)] == [
        "gripper",
        "screwdriver",
    ]
    expected = math.dist((0.307, 0.0), (0.642, -0.030)) + 0.1
    assert load.cost.at(task.initial) == pytest.approx(expected)


def test_an_arm_without_a_tool_loads_without_putting_one_back():
    """It goes straight to the holder."""
    content = config_content("inverter_board")
    content["initial_tool"] = None
    task = assembly(content)
    assert "no_tool" in task.initial
    load = task.skill("load(screwdriver)")
    assert load.precondition.holds(task.initial)
    assert [visit.subject for visit in load.motion.visits(task.initial)] == ["screwdriver"]
    assert "no_tool" not in load.prediction.apply(task.initial)


def test_a_screw_from_a_feeder_is_fetched_on_the_way(motor_drive_task):
    """The detour costs."""
    skill = motor_drive_task.skill("fasten(shield_screw_1)")
    assert [str(visit.event) for visit in skill.motion.visits(motor_drive_task.initial)] == [
        "fetch",
        "drive",
    ]
    detour = math.dist((0.3, 0.0), (0.64, 0.18)) + math.dist((0.64, 0.18), (0.414, -0.056))
    assert skill.cost.at(motor_drive_task.initial) == pytest.approx(detour)


def test_what_lies_beneath_another_is_picked_after_it(motor_drive_task):
    """The bridge lies on the heat sink."""
    pick = motor_drive_task.skill("pick(heat_sink)")
    assert pick.precondition.why_not(motor_drive_task.initial) == ["not at_start(bridge)"]
    assert motor_drive_task.scene.at(motor_drive_task.initial)["bridge"].position[2] == 0.03


def test_heights_of_goals_add_up(motor_drive_task):
    """Housing 10 mm, board 4 mm, shield 38 mm, board 3 mm: a clip ends at 55 mm."""
    goals = {
        body.name: placement.pose.position[2]
        for body in motor_drive_task.scene.bodies
        for placement in body.placements
        if placement.fact.startswith(("placed(", "fastened("))
    }
    assert goals["power_board"] == pytest.approx(0.010)
    assert goals["shield"] == pytest.approx(0.014)
    assert goals["shield_screw_1"] == goals["control_board"] == pytest.approx(0.052)
    assert goals["clip_1"] == pytest.approx(0.055)


def test_a_goal_may_be_less_than_everything():
    """Then the rest is left where it is."""
    content = config_content("inverter_board")
    content["goal"] = ["placed(pcb)", "placed(clock)"]
    task = assembly(content)
    model = make_model(task, Setup(collision=("precedence",)))
    assert replay(model, task.parse_sequence("0,1,6,7")).complete
    assert not replay(model, task.parse_sequence("0,1,6")).complete


def test_the_arm_stands_at_one_place_with_one_tool_and_one_hand(motor_drive_task):
    """Exactly one fact of each such group holds in every reachable state."""
    groups = [
        group
        for group in motor_drive_task.facts.exclusive
        if group[0].startswith(("at(", "tool(", "hand_free", "at_start("))
    ]
    assert len(groups) == 3 + 12
    for state in reachable_states(make_model(motor_drive_task), 500):
        for group in groups:
            assert sum(fact in state for fact in group) == 1


def test_a_fixed_part_stands_from_the_start_and_no_skill_moves_it():
    """A base of 40 kg, which no arm has to carry; what stands on it is placed as ever."""
    task = assembly(
        {
            "kind": "assembly",
            "name": "heavy-base",
            "robot": {"home_m": [0.35, 0.0]},
            "tools": {"gripper": {"holder_m": [0.2, 0.5]}},
            "initial_tool": "gripper",
            "parts": {
                "base": {
                    "fixed": True,
                    "mass_kg": 40,
                    "size_m": [0.2, 0.1, 0.03],
                    "goal_m": [0.5, 0.2],
                },
                "block": {
                    "tool": "gripper",
                    "size_m": [0.04, 0.03, 0.02],
                    "start_m": [0.4, -0.2],
                    "goal_m": [0.5, 0.2],
                    "goal_on": "base",
                },
            },
        }
    )
    assert {skill.name for skill in task.skills} == {"pick(block)", "place(block)", "load(gripper)"}
    assert "placed(base)" in task.initial
    assert task.operations == {"block": "placed(block)"}
    placements = task.scene.body("base").placements
    assert [placement.fact for placement in placements] == ["placed(base)"]


# A part that lies where a feeder hands out is told of before anything is planned.


def hints(lying: dict[str, Any], handed_out: dict[str, Any] | None = None) -> list[str]:
    """Return what is said of a box that lies near a feeder at [0.4, 0.2]."""
    box = {"tool": "gripper", "size_m": [0.04, 0.04, 0.02], "goal_m": [0.5, -0.2]}
    chip = {"tool": "gripper", "size_m": [0.01, 0.01, 0.01], "goal_m": [0.4, -0.2]}
    content: dict[str, Any] = {
        "kind": "assembly",
        "name": "feeder",
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
        "initial_tool": "gripper",
        "feeders": {"tray": {"position_m": [0.4, 0.2]}},
        "parts": {"box": {**box, **lying}},
    }
    content["parts"] |= {"chip": {**chip, "feeder": "tray"}} if handed_out is None else {}
    config = AssemblyConfig.model_validate({**content, **(handed_out or {})})
    return [str(hint) for hint in AssemblyDomain().hints(config)]


@pytest.mark.parametrize("start_m", [[0.4, 0.2], [0.42, 0.2], [0.4, 0.224]])
def test_a_part_upon_a_feeder_is_told_of_with_what_waits(start_m):
    """Whatever of the two boxes meets."""
    assert hints({"start_m": start_m}) == [
        "parts.box.start_m: 'box' lies where 'tray' hands out 'chip', which cannot be taken before "
        "it is gone. Move one of them."
    ]


@pytest.mark.parametrize("start_m", [[0.43, 0.2], [0.4, 0.23], [0.3, 0.0]])
def test_a_part_beside_a_feeder_is_not(start_m):
    """Nothing of it is over what is handed out."""
    assert hints({"start_m": start_m}) == []


def test_a_screw_s_feeder_is_blocked_as_well():
    """Screws wait like parts."""
    screw = {"tool": "driver", "hole_m": [0.5, -0.2], "through": "box", "feeder": "tray"}
    tools = {"gripper": {"holder_m": [0.6, 0.3]}, "driver": {"holder_m": [0.6, -0.3]}}
    (hint,) = hints({"start_m": [0.41, 0.2]}, {"screws": {"bolt": screw}, "tools": tools})
    assert "where 'tray' hands out 'bolt'" in hint


def test_a_part_over_a_low_feeder_is_told_of_by_the_way_up():
    """What is handed out at the table's height is lifted through a bridge."""
    bridge = {
        "size_m": None,
        "boxes": [
            {"size_m": [0.01, 0.06, 0.04], "centre_m": [-0.05, 0, 0.02]},
            {"size_m": [0.01, 0.06, 0.04], "centre_m": [0.05, 0, 0.02]},
            {"size_m": [0.11, 0.06, 0.01], "centre_m": [0, 0, 0.045]},
        ],
    }
    assert len(hints({"start_m": [0.4, 0.2], **bridge})) == 1


def test_what_nobody_takes_is_not_blocked():
    """A feeder that hands out nothing has nothing to wait for."""
    assert hints({"start_m": [0.4, 0.2]}, {"screws": {}}) == []


# The step limit of a file that gives none is enough for every order of its skills.


BOARD = "inverter_board"


def limit_of(name: str = BOARD, **changes: Any) -> int:
    """Return the step limit of a shipped file that says none."""
    content = config_content(name)
    content.pop("step_limit")
    return assembly({**content, **changes}).step_limit


def failing(probability: float) -> dict[str, Any]:
    parts = config_content(BOARD)["parts"]
    parts["pcb"]["grasp_failure"] = probability
    return parts


class TestTheDefault:
    def test_is_every_skill_once_and_a_change_before_each(self):
        """Six picks, six places, two screws; a swap before each of these eight, and a last one."""
        assert limit_of() == 6 + 6 + 2 + (8 + 1)

    def test_counts_two_skills_a_change_where_tools_are_returned_first(self):
        """Offload and load."""
        assert limit_of(tool_change={"style": "separate"}) == 6 + 6 + 2 + 2 * (8 + 1)

    def test_has_one_change_where_there_is_one_tool(self):
        """Which may have to be attached first."""
        content = config_content(BOARD)
        content = {k: v for k, v in content.items() if k not in ("chart", "actions", "observation")}
        content["tools"].pop("screwdriver")
        content |= {"screws": {}, "step_limit": None, "collision": {}, "reward": None}
        assert assembly(content).step_limit == 6 + 6 + 1

    @pytest.mark.parametrize(("probability", "tries"), [(0.05, 3), (0.1, 3), (0.5, 10)])
    def test_has_room_for_grasps_that_fail(self, probability, tries):
        """So many tries that the part is left lying once in 1,000 times at most."""
        assert limit_of(parts=failing(probability)) == limit_of() + tries - 1
        assert probability**tries <= 1e-3 * (1 + 1e-9) < probability ** (tries - 1)

    def test_is_never_more_than_a_file_may_give(self):
        """However hopeless a grasp is."""
        assert limit_of(parts=failing(1 - 1e-9)) == MOST_STEPS


def test_a_given_limit_holds(board_task):
    """The default is for files that say none."""
    assert board_task.step_limit == 20
