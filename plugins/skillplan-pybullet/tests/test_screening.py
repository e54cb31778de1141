"""Geometry before simulated execution: who is asked, and what it spares."""

from __future__ import annotations

import json

import pytest

from board_situations import BOARD
from skillplan.cli import main
from skillplan.pipeline import Setup, load_problem, solve
from skillplan.records import Status
from skillplan.task import Task

pytest.importorskip("skillplan_pinocchio", reason="geometry is asked by swept hulls")

PHYSICS = Setup("pybullet", ("contact-pairs",), screening=True, with_chart=False)
# Two parts so near to each other that the second one's finger finds no room, whichever it is.
TIGHT = """
kind: assembly
name: tight
robot:
  name: arm
  base_m: [0, 0, 0]
  reach_m: 0.855
  safe_height_m: 0.2
  home_m: [0.5, 0.0]
  travel_speed_m_per_s: 0.25
tools:
  gripper: {holder_m: [0.3, 0.3], holder_height_m: 0.1}
initial_tool: gripper
parts:
  left:
    tool: gripper
    size_m: [0.02, 0.03, 0.06]
    start_m: [0.4, -0.2]
    goal_m: [0.5, 0.1]
    grasp: {closing_axis: x, depth_m: 0.04}
  right:
    tool: gripper
    size_m: [0.02, 0.03, 0.06]
    start_m: [0.6, -0.2]
    goal_m: [0.527, 0.1]
    grasp: {closing_axis: x, depth_m: 0.04}
"""


@pytest.fixture
def tight(tmp_path):
    """A product that cannot be built."""
    (tmp_path / "tight.yaml").write_text(TIGHT)
    return load_problem(tmp_path / "tight.yaml").task


def names(setup: Setup, task: Task) -> list[str]:
    """Return the detectors that are asked."""
    return [choice.name for choice in setup.collision_choices(task)]


@pytest.fixture(scope="module")
def board():
    """The inverter board."""
    return load_problem(BOARD).task


class TestWhoIsAsked:
    def test_hulls_come_before_an_engine_that_executes(self, board):
        assert names(PHYSICS, board) == ["swept", "contact-pairs"]
        assert [back_end.name for back_end in PHYSICS.back_ends(board) if back_end.screens] == [
            "swept"
        ]

    @pytest.mark.parametrize(
        "setup",
        [
            Setup("pybullet", ("contact-pairs",), with_chart=False),
            Setup("kinematic", ("aabb",), screening=True, with_chart=False),
            Setup("pybullet", ("aabb", "swept"), screening=True, with_chart=False),
        ],
        ids=["not asked for", "nothing to execute", "named anyway"],
    )
    def test_otherwise_only_what_was_named_is_asked(self, board, setup):
        assert names(setup, board) == list(setup.collision)
        assert not any(back_end.screens for back_end in setup.back_ends(board))


def test_a_product_that_cannot_be_built_is_said_without_a_search_by_execution(tight):
    result = solve(tight, "exact", PHYSICS)
    assert result.status is Status.INFEASIBLE
    assert result.trace["screening"] == {"refused": 2, "executed": 2}
    assert "right is in the way of place(left) at its goal" in result.reason


@pytest.mark.slow(
    reason="executes what hulls refuse; they agree on every pair in test_agreement.py"
)
def test_execution_alone_says_the_same(tight):
    result = solve(tight, "exact", Setup("pybullet", ("contact-pairs",)))
    assert result.status is Status.INFEASIBLE


@pytest.mark.slow(reason="executes the board; hulls alone prove its optimum in every run")
def test_the_board_keeps_its_proved_optimum():
    result = solve(load_problem(BOARD).task, "exact", PHYSICS)
    assert (result.status, round(result.cost or 0.0, 5)) == (Status.OPTIMAL, 1.86709)
    assert result.trace["screening"]["executed"] == 2


ASKED = ["--physics", "pybullet", "--collision", "contact-pairs", "--no-cache"]


@pytest.mark.slow(reason="executes a chart; a search is screened in every run")
def test_a_chart_is_derived_by_geometry_first_and_a_sample_executed(tmp_path, capsys):
    """What geometry refuses names it, and not the engine."""
    (tmp_path / "tight.yaml").write_text(TIGHT, "utf-8")
    with pytest.raises(SystemExit, match="0"):
        main(["chart", str(tmp_path / "tight.yaml"), *ASKED, "--format", "json"])
    chart = json.loads(capsys.readouterr().out)
    assert chart["back_ends"] == ["swept", "contact-pairs", "pybullet"]
    stages = {relation["evidence"]["stage"] for relation in chart["relations"]}
    assert stages == {"swept"}


@pytest.mark.slow(reason="learns from a simulation; a chart is screened in every run")
def test_a_training_says_in_its_folder_that_geometry_was_asked_first(tmp_path):
    """And what evaluates it asks the same."""
    (tmp_path / "tight.yaml").write_text(TIGHT, "utf-8")
    task, out = str(tmp_path / "tight.yaml"), tmp_path / "run"
    words = ["train", task, *ASKED, "--solver", "dqn", "--runs", "1", "--out", str(out)]
    with pytest.raises(SystemExit):
        main([*words, "--steps", "100"])
    manifest = json.loads((out / "manifest.json").read_text("utf-8"))
    assert manifest["screening"] is True
    assert manifest["collision"] == ["contact-pairs"]
    result = json.loads((out / "result.json").read_text("utf-8"))
    assert result["collision"] == "swept,contact-pairs"
