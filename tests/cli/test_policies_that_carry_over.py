"""`train --family generated:A-B`, and `evaluate` of a policy that carries over, on any task."""

import sys
from pathlib import Path

import pytest

from relational_runs import nearest_first_run
from thinned import slow_case

CONFIGS = Path(__file__).parents[2] / "configs"
BOARD = str(CONFIGS / "inverter_board.yaml")
FAMILY = ("--family", "generated:3-4")


@pytest.fixture
def run(tmp_path):
    return str(nearest_first_run(tmp_path / "run"))


@pytest.mark.parametrize(
    "task",
    ["board", "seven", slow_case("motor", reason="a search of seconds; two boards in every run")],
)
def test_a_policy_is_tried_on_any_task(request, cli, run, task):
    """And held against the proved optimum, as a sequence is."""
    task = request.getfixturevalue(task)
    shown = cli("evaluate", run, "--task", task, "--format", "json")
    assert 0 == shown.code
    assert shown.document["complete"]
    assert 0 <= shown.document["deviation"] < 0.5
    names = ",".join(step["skill"] for step in shown.document["steps"])
    again = cli("evaluate", task, "--sequence", names, "--format", "json")
    assert shown.document["cost"] == again.document["cost"]


def test_it_answers_without_torch(cli, run, monkeypatch):
    """As where the plugin that trains is not installed."""
    for name in [module for module in sys.modules if module.partition(".")[0] == "skillplan_torch"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    outcome = cli("evaluate", run, "--task", BOARD, "--format", "json")
    assert (0, "") == (outcome.code, outcome.err)
    assert outcome.document["complete"]


def test_a_task_that_it_cannot_act_on_is_refused(cli, run):
    assert (
        "cannot act on br17.10"
        in cli("evaluate", run, "--task", str(CONFIGS / "br17.10.sop")).refusal
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "name the task to try it on by --task"),
        (("--task", BOARD, "--sequence", "0"), "--sequence is for a task file"),
        (("--task", BOARD, "--episodes", "3"), "--episodes is for a folder of runs, not for a"),
    ],
)
def test_what_does_not_go_with_it_is_named(cli, run, words, message):
    assert message in cli("evaluate", run, *words).refusal


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((BOARD, *FAMILY), "no TASK goes with --family generated:3-4"),
        ((*FAMILY, "--runs", "2"), "--runs is for a task file, not for --family generated:3-4"),
        ((*FAMILY, "--resume"), "--resume is for a task file, not for --family generated:3-4"),
        ((*FAMILY, "--solver", "exact"), "'exact' learns no policy that carries over"),
        ((*FAMILY, "--solver", "exat"), "Unknown solver 'exat'"),
        (("--family", "generated:4-3"), "1 <= LEAST <= MOST"),
        (("--family", "generated:x"), "such as generated:6-12"),
        ((BOARD, "--family", "some"), "neither a whole number nor a family"),
        ((BOARD, "--family", "0"), "0 is not in the range"),
        ((), "Missing TASK"),
    ],
)
def test_a_training_that_cannot_be_is_refused(cli, words, message):
    refusal = cli("train", *words).refusal
    assert message in " ".join(refusal.replace("│", " ").split())
