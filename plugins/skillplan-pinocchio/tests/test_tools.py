"""Length and shape of tools, paths of dispensers and forces of presses, by the swept hulls."""

from pathlib import Path

import pytest

from skillplan.pipeline import load_problem
from skillplan_pinocchio import SweptDetector

CONFIGS = Path(__file__).parents[3] / "configs"
CELL = CONFIGS / "cell_tools.yaml"
TWO_TOOLS = CONFIGS / "cell_two_tools.yaml"
PLAN = ("pick(housing)", "place(housing)", "load(glue)")


def reason(skill, *before, cell=CELL, **changes):
    """Return why `swept` refuses a skill of a cell after others; empty if it does not."""
    (task,) = load_problem(cell, changes=changes).tasks
    skills = {item.name: item for item in task.skills}
    state = task.initial
    for name in before:
        state = skills[name].prediction_in(state).apply(state)
    verdict = SweptDetector(task).check(skills[skill], state)
    return "" if verdict.is_feasible else verdict.reason


def test_a_dispenser_is_checked_along_its_path():
    assert reason("dispense(bead)", *PLAN) == ""
    high = {"works.bead.path_m": "[[0.43, -0.05], [0.47, -0.05]]"}
    before = (*PLAN[:2], "load(tongs)", "pick(pin)", "place(pin)", "load(glue)")
    assert "glue runs into pin on the path" in reason("dispense(bead)", *before, **high)


def test_a_dispenser_takes_the_time_of_its_path_once():
    """Three lines of 60 mm at 0.05 m/s, and at half the speed."""
    durations_s = []
    for speed in ("0.05", "0.025"):
        (task,) = load_problem(CELL, changes={"works.bead.speed_m_per_s": speed}).tasks
        state = task.facts.of("placed(housing)", "tool(glue)", "hand_free", "at(glue.holder)")
        skill = task.skill("dispense(bead)")
        durations_s.append(SweptDetector(task).duration_s(skill, state))
        least_s = SweptDetector(task).least_duration_s(skill, state.bits, 0)
        assert 0.5 * durations_s[-1] < least_s <= durations_s[-1]
    assert durations_s[1] - durations_s[0] == pytest.approx(0.18 / 0.05)


def test_joints_bear_the_force_of_a_press():
    assert reason("press(bond)", "load(ram)") == ""
    strong = {"works.bond.force_n": "900", "tools.ram.force_n": "1000"}
    assert "would bear" in reason("press(bond)", "load(ram)", **strong)


@pytest.mark.parametrize(("length_m", "free"), [("0.13", False), ("0.20", True)])
def test_a_longer_tool_keeps_the_wrist_away(length_m, free):
    """A wall beside the pin meets the hand of short tongs, not that of long ones."""
    wall = "{wall: {size_m: [0.02, 0.10, 0.10], at_m: [0.275, 0.12]}}"
    changes = {"fixtures": wall, "tools.tongs.length_m": length_m, "tools.tongs.body": "null"}
    assert (reason("pick(pin)", "load(tongs)", **changes) == "") is free


@pytest.mark.parametrize(
    ("skill", "at_m", "words"),
    [
        ("pick(clip)", "[0.55, 0.08]", "cup runs into post"),
        ("pick(clip)", "[0.55, 0.28]", ""),
        ("pick(chip)", "[0.45, -0.10]", "the hand runs into post"),
        ("pick(chip)", "[0.35, -0.10]", ""),
    ],
)
def test_all_tools_on_a_hand_are_checked(skill, at_m, words):
    """The cup on one side of the gripper, and the gripper that lies level for the cup."""
    fixtures = f"{{post: {{size_m: [0.02, 0.02, 0.13], at_m: {at_m}}}}}"
    why = reason(skill, cell=TWO_TOOLS, fixtures=fixtures)
    assert why.startswith(words)
    assert bool(why) is bool(words)
