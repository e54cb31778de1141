"""The assembly domain: from content to tasks."""

import math

import pytest

from situations import assembly, config_content
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
