"""`export`: what is written where, and what is refused before anything is."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from run_folders import HOPELESS, OPTIMAL, SWITCHED, changed, write_runs
from skillplan.judge import PlannerAnswer, fast_downward

PLAN = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"


def test_a_plan_and_a_task_are_handed_over(cli, board, solved_board, tmp_path):
    """From a result or by --sequence the same; a format of several files is a folder."""
    item, same, folder = tmp_path / "one.csv", tmp_path / "same.csv", tmp_path / "pddl"
    outcome = cli("export", str(solved_board), "--to", "csv", "--out", str(item))
    assert (0, f"{item}: 15 skills, cost 1.86709 m\n") == (outcome.code, outcome.out)
    assert 0 == cli("export", board, "--to", "csv", "--out", str(same), "--sequence", PLAN).code
    assert item.read_text("utf-8") == same.read_text("utf-8")
    assert 0 == cli("export", board, "--to", "pddl", "--out", str(folder)).code
    assert {"domain.pddl", "problem.pddl"} == {path.name for path in folder.iterdir()}
    assert {"one.csv", "same.csv", "pddl"} == {path.name for path in tmp_path.iterdir()}


def test_a_plan_is_handed_over_with_what_was_not_checked(cli, solved_board, tmp_path):
    """The board's detector is the chart alone."""
    outcome = cli("export", str(solved_board), "--to", "csv", "--out", str(tmp_path / "plan.csv"))
    assert 0 == outcome.code
    assert "note: not checked: geometry" in outcome.err


def test_of_what_may_fail_by_chance_the_cost_is_that_of_no_failure(cli, tmp_path):
    """A behaviour tree tries again, which costs more."""
    words = ["--to", "btcpp", "--sequence", PLAN, "--out", str(tmp_path / "tree.xml")]
    outcome = cli("export", "configs/inverter_grasps.yaml", *words)
    assert (0, True) == (outcome.code, outcome.out.endswith("m if nothing fails\n"))


@pytest.mark.parametrize(
    ("words", "message", "code"),
    [
        (["--to", "cvs", "--out", "f.csv"], "Unknown exporter 'cvs'. Did you mean 'csv'?", 2),
        (["--to", "groot", "--out", "f.csv"], "Unknown exporter 'groot'.", 2),
        (["--to", "csv", "--out", "no/f.csv"], "there is no folder no", 2),
        (["--to", "csv", "--out", "there.csv", "--sequence", PLAN], "is there already", 2),
        (["--to", "pddl", "--out", "there.csv"], "is a file. Name a new folder", 2),
        (["--to", "pddl", "--out", "full"], "is not empty. Name a new folder", 2),
        (["--to", "st", "--out", "f.st"], "hands over a plan: give a RESULT", 2),
        (["--to", "st", "--out", "f.st", "-O", "size=3"], "has no option 'size'", 2),
        (["--to", "st", "--out", "f.st", "--sequence", "0,1"], "its end: the goal is not", 1),
        (["--to", "st", "--out", "f.st", "--sequence", "1,0"], "step 1, place(pcb)", 1),
    ],
)
def test_what_does_not_go_is_one_message(cli, board, tmp_path, monkeypatch, words, message, code):
    """And nothing is written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.csv").write_text("kept")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    outcome = cli("export", board, *words)
    assert (code, "") == (outcome.code, outcome.out)
    assert message in outcome.err
    assert {"there.csv", "full"} == {path.name for path in tmp_path.iterdir()}
    assert "kept" == (tmp_path / "there.csv").read_text()


class TestVerifyWithFastDownward:
    def test_the_optimum_is_proved_by_a_planner_of_others(self, cli, solved_board):
        """It stands beside our own second proof."""
        if find_spec("up_fast_downward") is None:
            pytest.skip("needs skillplan[planner]")
        outcome = cli("verify", str(solved_board), "--with", "fast-downward", "--format", "json")
        assert 0 == outcome.code
        claim = outcome.document["claims"][-1]
        assert ("optimal", "holds", "fast-downward") == (
            claim["claim"],
            claim["outcome"],
            claim["method"],
        )
        assert "it proves 1.86709 m, rounded by at most 7.5e-06" in claim["detail"]

    def test_a_lower_proved_cost_is_a_contradiction_and_exit_code_3(
        self, cli, solved_board, monkeypatch
    ):
        """Though everything else holds."""
        lower = PlannerAnswer(1_800_000, ("pick(pcb)", "place(pcb)"))
        monkeypatch.setattr(fast_downward, "find_driver", lambda: Path())
        monkeypatch.setattr(fast_downward, "run_planner", lambda task, limit_s: lower)
        outcome = cli("verify", str(solved_board), "--with", "fast-downward", "--format", "json")
        assert (3, False) == (outcome.code, outcome.document["valid"])
        claim = outcome.document["claims"][-1]
        assert ("fails", "fast-downward") == (claim["outcome"], claim["method"])

    def test_an_unknown_referee_and_one_that_is_not_installed_are_messages(
        self, cli, solved_board, monkeypatch
    ):
        """Exit code 2, and the extra that has it."""
        outcome = cli("verify", str(solved_board), "--with", "enhsp")
        assert (2, True) == (outcome.code, "no such referee" in outcome.err)
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        outcome = cli("verify", str(solved_board), "--with", "fast-downward")
        assert (2, True) == (outcome.code, "pip install 'skillplan[planner]'" in outcome.err)


@pytest.mark.parametrize("to", ["csv", "btcpp", "st"])
@pytest.mark.parametrize("name", ["plan", "plan.of.mine", "plan.txt"])
def test_a_file_may_have_any_name(cli, board, tmp_path, to, name):
    path = tmp_path / name
    outcome = cli("export", board, "--to", to, "--sequence", PLAN, "--out", str(path))
    assert outcome.code == 0
    assert path.stat().st_size


def test_a_file_may_hold_the_list_that_sequence_takes(cli, board, tmp_path):
    """Numbers or names, over one line or several."""
    names = "pick(pcb), place(pcb),\npick(switch_1)\nplace(switch_1)\n"
    for text, steps in ((PLAN, 15), (PLAN.replace(",", "\n"), 15), (names, 4)):
        (tmp_path / "list").write_text(text)
        outcome = cli("evaluate", board, "--sequence", f"@{tmp_path / 'list'}", "--format", "json")
        assert outcome.document["feasible"], text
        assert outcome.document["complete"] == (steps == 15)


def test_a_policy_is_exported_from_its_folder_of_runs_only(cli, board, tmp_path):
    """As ONNX; what else is given gets one message that says what to give."""
    pytest.importorskip("onnx")
    runs = str(write_runs(tmp_path / "runs", board, [SWITCHED, OPTIMAL]))
    out = tmp_path / "policy.onnx"
    outcome = cli("export", runs, "--to", "onnx", "--out", str(out))
    assert 0 == outcome.code
    assert "policy of run 1 of look-up" in outcome.err
    assert out.read_bytes()
    for words, message in (
        ((board, "--to", "onnx"), "onnx exports a policy: give a folder of train"),
        ((runs, "--to", "csv"), "--to onnx exports a policy"),
        ((runs, "--to", "onnx", "-O", "onnx.run=2"), "runs with a policy are 0, 1"),
    ):
        refused = cli("export", *words, "--out", str(tmp_path / "other"))
        assert 2 == refused.code
        assert message in refused.err


def test_under_chance_the_policy_of_least_expected_cost_is_exported(cli, tmp_path):
    """A training keeps no cost then: one episode does not show it."""
    pytest.importorskip("onnx")
    task, sequences = "configs/inverter_grasps.yaml", [HOPELESS, SWITCHED, OPTIMAL]
    runs = write_runs(tmp_path / "runs", task, sequences, observation="paper")
    for run in range(3):
        changed(runs / "runs" / f"0{run}" / "policy.json", "cost", to=None)

    def told(*words: str) -> tuple[str, str]:
        out = str(tmp_path / f"{len(list(tmp_path.iterdir()))}.onnx")
        outcome = cli("export", str(runs), "--to", "onnx", "--out", out, *words)
        assert 0 == outcome.code, outcome.err
        first, second = re.findall("note: (.*)", outcome.err)[:2]
        return first.partition(" of look-up")[0], second

    best, least = told()
    assert "policy of run 2" == best
    assert re.fullmatch(r"expected cost 2\.\d+ m, the least of 3 runs", least)
    assert re.fullmatch(r"expected cost 2\.\d+ m", told("-O", "onnx.run=1")[1])
    assert told("-O", "onnx.run=0")[1].startswith("this policy has no cost: ")
