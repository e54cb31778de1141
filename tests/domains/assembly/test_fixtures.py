"""Fixtures: bodies that stay where they are, on which parts lie and which nothing may run into."""

from __future__ import annotations

import pytest

from skillplan import Setup, load_problem, solve
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain, find_goal_rests, get_layout
from skillplan.errors import TaskError

BOXES = Setup(collision=("aabb",))
PART = {"tool": "hand", "size_m": [0.04, 0.04, 0.02], "start_m": [0.4, 0.3], "goal_m": [0.5, 0.0]}
JIG = {"size_m": [0.10, 0.10, 0.03], "at_m": [0.5, 0.0]}


def config_of(fixtures, others=None, **part):
    """Return an assembly of a part, some fixtures and perhaps other parts."""
    return AssemblyConfig.model_validate(
        {
            "kind": "assembly",
            "name": "cell",
            "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.2},
            "tools": {"hand": {"holder_m": [0.3, 0.4], "type": "suction"}},
            "initial_tool": "hand",
            "fixtures": fixtures,
            "parts": {**(others or {}), "part": {**PART, **part}},
        }
    )


def messages(config):
    return [str(issue) for issue in AssemblyDomain().issues(config)]


def task_of(config):
    assert messages(config) == []
    (task,) = AssemblyDomain().ground(config, "")
    return task


def test_a_part_rests_on_a_fixture_at_its_goal_and_at_the_start():
    rack = {"size_m": [0.1, 0.1, 0.08], "at_m": [0.4, 0.3]}
    config = config_of({"jig": JIG, "rack": rack}, goal_on="jig", start_on="rack")
    layout = get_layout(config)
    assert layout.goal("part").pose.position[2] == pytest.approx(0.03)
    assert layout.start("part").pose.position[2] == pytest.approx(0.08)
    assert [rest.on for rest in find_goal_rests(config, "part")] == ["jig"]
    assert messages(config) == []


def test_fixtures_stand_on_each_other():
    shelf = {"size_m": [0.08, 0.08, 0.01], "at_m": [0.5, 0.0], "stands_on": "jig"}
    config = config_of({"shelf": shelf, "jig": JIG}, goal_on="shelf")
    assert get_layout(config).goal("part").pose.position[2] == pytest.approx(0.04)


def test_they_are_there_in_every_state_and_no_skill_moves_them():
    task = task_of(config_of({"jig": JIG}, goal_on="jig"))
    body = task.scene.body("jig")
    assert body.fixed
    assert [skill.name for skill in task.skills] == ["pick(part)", "place(part)", "load(hand)"]
    result = solve(task, setup=BOXES)
    state = task.initial
    for step in result.steps:
        assert task.scene.at(state)["jig"] == body.placements[0].pose
        state = task.skill(step.skill).prediction_in(state).apply(state)
    assert result.cost == pytest.approx(solve(task_of(config_of({})), setup=BOXES).cost)


def test_a_fixed_part_is_held_still_as_a_fixture_is():
    base = {"fixed": True, "size_m": [0.1, 0.1, 0.02], "goal_m": [0.5, 0.0]}
    task = task_of(config_of({}, {"base": base}, goal_on="base"))
    assert [body.name for body in task.scene.bodies if body.fixed] == ["base"]


def test_nothing_is_placed_through_a_fixture():
    beam = {"size_m": [0.4, 0.04, 0.04], "at_m": [0.5, 0.0, 0.1]}
    result = solve(task_of(config_of({"beam": beam})), setup=BOXES)
    assert result.status == "infeasible"
    assert "place(part) is never feasible: aabb: part runs into beam" in result.reason


@pytest.mark.parametrize(
    ("fixtures", "part", "words"),
    [
        ({"jig": JIG}, {"goal_on": "jog"}, "unknown part or fixture 'jog'. Did you mean 'jig'?"),
        ({"jig": JIG}, {}, "'part' and 'jig' overlap by"),
        ({"part": JIG}, {}, "the name 'part' is taken in 'fixtures'"),
        ({"jig": {**JIG, "stands_on": "rack"}}, {}, "unknown fixture 'rack'"),
        (
            {"a": {**JIG, "stands_on": "b"}, "b": {**JIG, "stands_on": "a"}},
            {"goal_m": [0.6, 0.3]},
            "fixtures stand on each other in a cycle",
        ),
        (
            {"jig": {"boxes": [{"size_m": [0.1] * 3, "centre_m": [0, 0, 0.5]}], "at_m": [0.6, 0]}},
            {},
            "not at the fixture's bottom",
        ),
    ],
)
def test_a_fault_of_a_fixture_is_reported(fixtures, part, words):
    assert any(words in message for message in messages(config_of(fixtures, **part)))


def test_fixtures_may_overlap_each_other_and_the_table():
    sunk = {"size_m": [0.1, 0.1, 0.1], "at_m": [0.55, 0.0, -0.07]}
    assert messages(config_of({"jig": JIG, "sunk": sunk}, goal_on="jig")) == []


def test_a_file_without_fixtures_keeps_its_hash(tmp_path):
    text = """
kind: assembly
name: cell
robot: {home_m: [0.3, 0.0]}
tools: {hand: {holder_m: [0.3, 0.4], type: suction}}
parts: {part: {tool: hand, size_m: [0.04, 0.04, 0.02], start_m: [0.4, 0.3], goal_m: [0.5, 0.0]}}
"""
    path = tmp_path / "cell.yaml"
    path.write_text(text)
    before = load_problem(path).sha256
    path.write_text(text + "fixtures: {}\n")
    assert load_problem(path).sha256 == before


def test_a_fixture_needs_one_shape_and_one_turn(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(
        "kind: assembly\nname: c\nrobot: {home_m: [0.3, 0.0]}\n"
        "tools: {hand: {holder_m: [0.3, 0.4], type: suction}}\n"
        "fixtures:\n  wall: {at_m: [0.2, 0.5]}\n"
        "  post: {size_m: [0.1, 0.1, 0.1], at_m: [0.2, -0.5], yaw_rad: 1, rpy_rad: [0, 0, 1]}\n"
        "parts:\n"
        "  p: {tool: hand, size_m: [0.04, 0.04, 0.02], start_m: [0.4, 0.3], goal_m: [0.5, 0]}\n"
    )
    with pytest.raises(TaskError) as error:
        load_problem(path)
    assert "give one of 'size_m', 'boxes', 'cylinder' and 'meshes'" in str(error.value)
    assert "give one of 'yaw_rad' and 'rpy_rad', not both" in str(error.value)
