"""Choices for the search: other goals and tools, optional parts, and orders of which one counts."""

from __future__ import annotations

from itertools import product

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from skillplan import Setup, Status, load_problem, solve
from skillplan.errors import TaskError

BOXES = Setup(collision=("aabb",))
BOARD = {"tool": "cup", "size_m": [0.24, 0.16, 0.01], "start_m": [0.5, 0.35], "goal_m": [0.5, 0.05]}
CHIP = {
    "tool": "cup",
    "size_m": [0.02, 0.02, 0.01],
    "start_m": [0.35, -0.3],
    "goal_m": [0.42, 0.05],
    "goal_on": "board",
}
SCREW = {"tool": "driver", "hole_m": [0.58, 0.0], "through": "board"}
CELL = {
    "kind": "assembly",
    "name": "cell",
    "robot": {"home_m": [0.35, 0.0], "safe_height_m": 0.2},
    "tools": {
        "cup": {"type": "suction", "holder_m": [0.25, 0.4]},
        "driver": {"type": "screwdriver", "holder_m": [0.33, 0.4]},
        "near": {"type": "screwdriver", "holder_m": [0.6, -0.1]},
    },
    "initial_tool": "cup",
}


def load_cell(path, chip=None, **sections):
    parts = {"board": BOARD, "chip": {**CHIP, **(chip or {})}}
    path.write_text(yaml.safe_dump({**CELL, "parts": parts, **sections}))
    return load_problem(path)


@pytest.fixture
def load(tmp_path):
    return lambda chip=None, **sections: load_cell(tmp_path / "cell.yaml", chip, **sections)


def solved(problem):
    result = solve(problem.task, setup=BOXES)
    assert result.status is Status.OPTIMAL
    return result.cost, [step.skill for step in result.steps]


spots = st.tuples(st.sampled_from([0.40, 0.46, 0.54, 0.60]), st.sampled_from([0.0, 0.1]))


@settings(max_examples=5, deadline=None)
@given(goals=st.lists(spots, min_size=2, max_size=3, unique=True))
def test_a_choice_costs_as_much_as_the_best_file_with_one_goal_and_one_tool(
    tmp_path_factory, goals
):
    path = tmp_path_factory.mktemp("choice") / "cell.yaml"
    first, *others = [list(goal) for goal in goals]
    others = [{"goal_m": goal, "goal_on": "board"} for goal in others]
    both = {**SCREW, "tool": ["driver", "near"]}
    chosen, _ = solved(
        load_cell(path, {"goal_m": first, "other_goals": others}, screws={"screw": both})
    )
    single = [
        solved(load_cell(path, {"goal_m": list(goal)}, screws={"screw": {**SCREW, "tool": tool}}))
        for goal, tool in product(goals, ("driver", "near"))
    ]
    assert chosen == pytest.approx(min(cost for cost, _ in single), abs=1e-9)


def test_the_skills_of_a_choice_have_the_tool_and_the_place_in_their_names(load):
    other = [{"goal_m": [0.42, 0.0], "goal_on": "board"}]
    screws = {"screw": {**SCREW, "tool": ["near", "driver"]}}
    _, skills = solved(load({"other_goals": other}, screws=screws))
    assert "place(chip@2)" in skills
    assert "fasten(screw:driver)" in skills
    assert "load(driver)" in skills


def test_an_optional_part_is_left_out_unless_the_goal_names_it(load):
    _, skills = solved(load({"optional": True}))
    assert skills == ["pick(board)", "place(board)"]
    _, skills = solved(load({"optional": True}, goal=["placed(board)", "placed(chip)"]))
    assert "place(chip)" in skills


def test_a_zone_rules_out_the_goal_in_it_and_no_other(load):
    """It is a fault if no other goal is left."""
    chip = {"goal_m": [0.5, -0.3], "goal_on": None, "other_goals": [{"goal_m": [0.6, -0.1]}]}
    zone = {"min_m": [0.45, -0.35], "max_m": [0.55, -0.25], "keeps_out": "load"}
    problem = load(chip, zones={"view": zone})
    _, skills = solved(problem)
    assert "place(chip@2)" in skills
    assert "place(chip)" not in [skill.name for skill in problem.task.skills]
    assert "zone view" in problem.task.notes["pick(chip)"][0]
    with pytest.raises(TaskError, match="is in the zone view"):
        load(chip, zones={"view": {**zone, "max_m": [0.65, -0.05]}})


def test_a_blocked_first_choice_is_no_proof_that_there_is_no_order(load):
    """Another tool drives the screw, and an optional part may stay where it is."""
    wall = {"size_m": [0.01, 0.1, 0.1], "at_m": [0.625, 0.0]}
    tools = {name: dict(tool) for name, tool in CELL["tools"].items()}
    tools["driver"]["envelope_m"] = [0.1, 0.1, 0.1]
    screw = {**SCREW, "tool": ["driver", "near"]}
    problem = load(tools=tools, fixtures={"wall": wall}, screws={"screw": screw})
    assert solved(problem)[1][-1] == "fasten(screw:near)"
    assert "2 skills bring about" in solve(problem.task, "portfolio", setup=BOXES).reason


def test_one_of_several_comes_first(load):
    screws = {
        "screw": {**SCREW, "count": 2, "hole_pattern": {"grid": [2, 1], "pitch_m": [-0.1, 0.1]}}
    }
    _, free = solved(load(screws=screws))
    _, skills = solved(load(screws=screws, chart=[{"any_of": ["screw"], "after": ["chip"]}]))
    assert not any("fasten" in skill for skill in free[: free.index("place(chip)")])
    assert any("fasten" in skill for skill in skills[: skills.index("place(chip)")])


@pytest.mark.parametrize(
    ("chip", "sections", "message"),
    [
        ({"tool": ["cup", "cup"]}, {}, "'cup' stands twice. Keep one."),
        ({"tool": ["cup", "cups"]}, {}, "unknown tool 'cups'. Did you mean 'cup'?"),
        (
            {"other_goals": [{"goal_m": [0.6, 0.3], "goal_on": "board"}]},
            {},
            "'chip' does not lie over 'board', of which no face is beneath it. Move it.",
        ),
        (
            {"other_goals": [{"goal_m": [0.42, 0.0], "goal_on": "board"}]},
            {"screws": {"screw": {**SCREW, "through": "chip", "hole_m": [0.42, 0.05]}}},
            "'screw' stands on or goes through it, so it has one goal. Leave it out.",
        ),
        (
            {"other_goals": [{"goal_m": [0.6, 0.3]}], "release_m": 0.01},
            {},
            "says how far above one place it is let go. Leave out 'other_goals' or this.",
        ),
        ({}, {"chart": [{"after": ["chip"]}]}, "give one of 'before' and 'any_of'."),
    ],
)
def test_faults_of_choices_are_told(load, chip, sections, message):
    with pytest.raises(TaskError) as raised:
        load(chip, **sections)
    assert message in [issue.message for issue in raised.value.issues]
