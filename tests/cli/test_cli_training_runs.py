"""``evaluate RUN`` and ``plot RUN``: tables, documents, figures, and what is refused."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from relational_runs import nearest_first_run
from run_folders import HOPELESS, OPTIMAL, SWITCHED, changed, write_runs
from tabular_learner import learner_installed
from thinned import slow_case

CONFIGS = Path(__file__).parents[2] / "configs"
BOARD = str(CONFIGS / "inverter_board.yaml")
GRASPS = str(CONFIGS / "inverter_grasps.yaml")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Three runs on a copy of the board, of which two complete it, for all tests."""
    folder, sequences = tmp_path_factory.mktemp("kept"), [OPTIMAL, SWITCHED, HOPELESS]
    return write_runs(folder / "runs", BOARD, sequences, steps=1_000, copy=True)


@pytest.fixture
def runs(kept, tmp_path):
    """The same, to be changed freely."""
    folder = Path(shutil.copytree(kept.parent, tmp_path, dirs_exist_ok=True)) / "runs"
    learned = str(tmp_path / "learned.yaml")
    changed(folder / "manifest.json", "task", "source", to=learned)
    changed(folder / "manifest.json", "task", "path", to=str(Path(learned).resolve()))
    return folder


@pytest.fixture
def learner(tmp_path, monkeypatch):
    """The name of a learner that is quick and exact."""
    with learner_installed(tmp_path / "site", monkeypatch) as name:
        yield name


def texts(path: Path) -> set[str]:
    """Return the texts of an SVG file."""
    tags = ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")
    return {(tag.text or "").strip() for tag in tags}


class TestEvaluate:
    def test_the_document_says_what_every_run_comes_to(self, cli, runs):
        outcome = cli("evaluate", str(runs), "--temperature", "0.01", "--format", "json")
        document = outcome.document
        assert (0, "") == (outcome.code, outcome.err)
        assert "skillplan.training/1" == document["schema"]
        assert [OPTIMAL, SWITCHED] == [
            ",".join(map(str, run["actions"])) for run in document["runs"][:2]
        ]
        assert ["complete", "complete", "incomplete"] == [run["status"] for run in document["runs"]]
        assert [0.0, None] == [document["runs"][i]["deviation"] for i in (0, 2)]
        assert (2, 1, 2) == (
            document["completed_runs"],
            document["optimal_runs"],
            document["one_percent_runs"],
        )
        assert [100, 100, 100] == [run["sampled_episodes"] for run in document["runs"]]
        assert 300 == document["random_baseline"]["episodes"]
        assert 10 == len(document["published"])
        assert pytest.approx(1.86709, abs=5e-6) == document["optimum"]

    @pytest.mark.parametrize("style", ["table", "csv", "md"])
    def test_the_table_has_every_run_and_pairs_none_with_the_paper(self, cli, runs, style):
        out = cli("evaluate", str(runs), "--format", style).out
        assert OPTIMAL in out
        assert "paper dev." not in out
        assert "N/A" in out

    def test_a_folder_named_twice_counts_once(self, cli, runs):
        again = f"{runs.parent}/./{runs.name}"
        outcome = cli("evaluate", str(runs), again, "--format", "json")
        assert (0, "skillplan.training/1") == (outcome.code, outcome.document["schema"])
        assert f"{again} is the folder {runs} again: it counts once" in outcome.err

    @pytest.mark.parametrize("command", ["evaluate", "plot"])
    def test_what_stands_beside_a_folder_of_runs_is_one_too(self, cli, runs, command):
        nowhere = str(runs.parent / "nope")
        refusal = cli(command, nowhere, str(runs)).refusal
        assert f"{nowhere}: no such file or folder" in refusal
        alone = f"{BOARD} is not a folder of training runs, so {command} takes it alone"
        assert alone in cli(command, str(runs), BOARD).refusal

    @pytest.mark.slow(reason="four evaluations; the roll-out itself in every run")
    def test_it_is_the_same_every_time_and_the_seed_decides(self, cli, runs):
        def told(*words: str) -> Any:
            out = cli("evaluate", str(runs), "--temperature", "0.4", *words, "--format", "json")
            return [run["success_rate"] for run in out.document["runs"]]

        assert told() == told()
        assert told() != told("--seed", "1")

    def test_no_run_that_completes_is_no_plan(self, cli, tmp_path):
        path = write_runs(tmp_path / "hopeless", BOARD, [HOPELESS])
        outcome = cli("evaluate", str(path))
        assert 1 == outcome.code
        assert "0 of 1 complete" in outcome.out

    def test_a_changed_task_is_refused_unless_told_otherwise(self, cli, runs):
        learned = runs.parent / "learned.yaml"
        learned.write_text(learned.read_text().replace("mass_kg: 0.120", "mass_kg: 0.125"))
        assert "parts.pcb.mass_kg: 0.12 there, 0.125 now" in cli("evaluate", str(runs)).refusal
        assert 0 == cli("evaluate", str(runs), "--changed-task").code
        assert 0 == cli("evaluate", str(runs), "--task", str(runs / "task.yaml")).code

    def test_where_the_task_file_is_gone_the_copy_serves(self, cli, runs):
        (runs.parent / "learned.yaml").unlink()
        outcome = cli("evaluate", str(runs), "--format", "json")
        assert 0 == outcome.code
        assert [OPTIMAL, SWITCHED] == [
            ",".join(map(str, run["actions"])) for run in outcome.document["runs"][:2]
        ]

    @pytest.mark.slow(reason="two evaluations; a changed task in every run")
    def test_back_ends_are_those_of_the_training_unless_named(self, cli, runs):
        words = ("evaluate", str(runs), "--format", "json")
        assert "precedence" == cli(*words).document["collision"]
        named = cli(*words, "--collision", "aabb").document
        assert "aabb,precedence" == named["collision"]

    @pytest.mark.parametrize(
        ("break_it", "told"),
        [
            (lambda path: (path / "manifest.json").unlink(), "holds no manifest.json"),
            (lambda path: (path / "manifest.json").write_text('{"schema":'), "is damaged"),
            (
                lambda path: changed(path / "manifest.json", "schema", to="skillplan.run/7"),
                "is of another version, skillplan.run/7",
            ),
            (lambda path: changed(path / "manifest.json", "steps", to=0), "steps"),
            (lambda path: (path / "task.json").unlink(), "task.json: cannot be read"),
        ],
    )
    def test_a_folder_that_is_no_sound_one_is_one_message(self, cli, runs, break_it, told):
        break_it(runs)
        for command in ("evaluate", "plot"):
            outcome = cli(command, str(runs))
            assert (2, "", 1) == (outcome.code, outcome.out, len(outcome.err.splitlines()))
            assert told in outcome.err

    def test_a_broken_run_is_named_and_the_others_are_shown(self, cli, runs):
        (runs / "runs" / "01" / "policy.json").write_text("")
        outcome = cli("evaluate", str(runs), "--format", "csv")
        assert 0 == outcome.code
        assert 4 == len(outcome.out.splitlines())
        assert "run 1      failed: " in outcome.err
        assert "policy.json: is damaged" in outcome.err

    @pytest.mark.parametrize(
        "words", [("--sequence", "0"), ("--policy", "x"), ("--from", "C1"), ("--part", "p")]
    )
    def test_what_a_task_takes_a_folder_does_not(self, cli, runs, words):
        refusal = cli("evaluate", str(runs), *words).refusal
        assert f"{words[0]} is for a task file" in refusal
        assert ", not for a folder of runs." in refusal

    @pytest.mark.parametrize(
        "words",
        [
            ("--episodes", "3"),
            ("--temperature", "1"),
            ("--seed", "1"),
            ("--changed-task",),
            ("--task", "x"),
        ],
    )
    def test_what_a_folder_takes_a_task_does_not(self, cli, words):
        refusal = cli("evaluate", BOARD, "--sequence", "0", *words).refusal
        assert f"{words[0]} is for a " in refusal
        assert "folder of runs, not for a task file." in refusal

    @pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "warm"])
    def test_a_temperature_is_above_0(self, cli, runs, value):
        assert "--temperature" in cli("evaluate", str(runs), "--temperature", value).refusal


class TestAfterTraining:
    @pytest.mark.slow(reason="evaluates twice; the evaluation of runs is in every run")
    def test_evaluate_finds_what_train_has_said(self, cli, tmp_path, learner):
        """The same sequences at the same cost, from the files alone."""
        runs = str(tmp_path / "runs")
        words = ("--solver", learner, "--runs", "2", "--steps", "2400", "--out", runs)
        trained = cli("train", BOARD, *words, "--format", "json").document
        tried = cli("evaluate", runs, "--format", "json").document
        assert trained["completed_runs"] == tried["completed_runs"] > 0
        same = (
            "run seed status actions skills cost deviation kept kept_step last best_cost_seen "
            "best_actions_seen training_success_rate completed_step episodes steps"
        )
        for message, result in zip(trained["runs"], tried["runs"], strict=True):
            assert {key: message[key] for key in same.split()} == {
                key: result[key] for key in same.split()
            }
        assert ("training", "sampled") == (trained["success_of"], tried["success_of"])
        assert trained["optimum"] == tried["optimum"]
        assert 0 == cli("plot", runs).code

    @pytest.mark.slow(
        reason="trains on three layouts; runs of one board are tried on others in every run"
    )
    def test_runs_of_a_family_are_tried_on_layouts_they_have_not_seen(self, cli, tmp_path, learner):
        """Numbered after those that were learned on; with the time of proof and answer."""
        runs = str(tmp_path / "runs")
        words = ("--solver", learner, "--runs", "2", "--steps", "1000", "--family", "3")
        cli("train", BOARD, *words, "--out", runs)
        result = cli("evaluate", runs, "--layouts", "4", "--format", "json").document["layouts"]
        assert [f"inverter-board/{number}" for number in (3, 4, 5, 6)] == [
            row["name"] for row in result["rows"]
        ]
        assert (3, 8) == (result["learned_on"], result["answers"])
        for row in result["rows"]:
            assert row["optimum"] > 0
            assert all(deviation is None or deviation >= 0 for deviation in row["deviations"])
        assert min(result["answer_s"], result["proof_s"], result["training_s"]) > 0
        shown = cli("evaluate", runs, "--layouts", "1").out
        assert "1 layouts that no run has seen" not in shown
        assert "1 layout that no run has seen, learned on 3 others" in shown


class TestLayouts:
    def test_those_of_a_file_without_a_family_are_refused_before_anything_is_done(
        self, cli, tmp_path
    ):
        path = write_runs(tmp_path / "runs", GRASPS, [OPTIMAL], observation="paper")
        assert "describes no family" in cli("evaluate", str(path), "--layouts", "3").refusal

    @pytest.mark.slow(reason="draws a family; one layout in every run")
    def test_runs_of_one_board_may_be_tried_on_its_family(self, cli, runs):
        """The same sequence on other layouts: complete, and seldom optimal."""
        result = cli("evaluate", str(runs), "--layouts", "3", "--format", "json").document[
            "layouts"
        ]
        assert (0, 9) == (result["learned_on"], result["answers"])
        for row in result["rows"]:
            assert 2 == row["completed"]
            assert row["deviations"][0] >= 0

    def test_a_run_of_one_board_is_tried_on_none_unless_asked(self, cli, runs):
        assert cli("evaluate", str(runs), "--format", "json").document["layouts"] is None


class TestChance:
    @pytest.mark.slow(
        reason="draws and solves a task of chance; every run holds others to the optimum"
    )
    def test_policies_are_held_to_the_least_expected_cost(self, cli, tmp_path):
        """A lucky episode costs less, and is no deviation."""
        path = write_runs(tmp_path / "runs", GRASPS, [OPTIMAL], observation="paper")
        document = cli("evaluate", str(path), "--format", "json").document
        (run,) = document["runs"]
        assert "value-iteration" == document["optimum_solver"]
        assert 0 < run["deviation"] < 0.1
        assert run["best_cost_seen"] < document["optimum"] < run["cost"]
        assert run["best_deviation_seen"] is None
        assert 0 == cli("plot", str(path), "distances", "--out", str(path / "d.svg")).code
        assert any(text.startswith("least expected 2.2") for text in texts(path / "d.svg"))


class TestPlot:
    @pytest.mark.slow(reason="draws two figures; both are drawn by tests of views in every run")
    def test_both_figures_are_drawn_into_the_folder(self, cli, runs):
        outcome = cli("plot", str(runs))
        names = ["success.png", "success.svg", "distances.png", "distances.svg"]
        assert (0, [str(runs / name) for name in names], "") == (
            outcome.code,
            outcome.out.splitlines(),
            outcome.err,
        )
        assert {"Moller et al.: about 40 %", "environment step [-]"} <= texts(runs / "success.svg")
        assert {"proved optimum 1.86709 m", "run 2, seed 9: none"} <= texts(runs / "distances.svg")
        assert (runs / "success.png").read_bytes().startswith(b"\x89PNG")

    def test_one_figure_is_drawn_where_it_is_wanted(self, cli, runs):
        target = runs.parent / "f.svg"
        words = ("plot", str(runs), "success", "--against", "episodes", "--out", str(target))
        outcome = cli(*words)
        assert (0, f"{target}\n") == (outcome.code, outcome.out)
        assert "episode [-]" in texts(target)
        assert not (runs / "success.png").exists()

    @pytest.mark.slow(reason="draws two figures; every run draws both with the proved optimum")
    def test_what_is_known_of_the_optimum_is_not_proved_again(self, cli, runs):
        """It stands in result.json."""
        result = {"schema": "skillplan.training/1", "optimum": 1.5}
        (runs / "result.json").write_text(json.dumps(result))
        assert 0 == cli("plot", str(runs)).code
        assert "proved optimum 1.50000 m" in texts(runs / "distances.svg")
        assert not any("Moller" in text for text in texts(runs / "success.svg"))

    @pytest.mark.slow(reason="draws a figure; both are drawn in every run")
    def test_without_a_completed_sequence_the_other_figure_is_drawn(self, cli, tmp_path):
        path = write_runs(tmp_path / "hopeless", BOARD, [HOPELESS])
        outcome = cli("plot", str(path))
        assert (0, 2) == (outcome.code, len(outcome.out.splitlines()))
        assert "no run has completed the task" in outcome.err
        assert 2 == cli("plot", str(path), "distances").code

    def test_before_the_first_episode_there_is_nothing_to_draw(self, cli, tmp_path):
        path = write_runs(tmp_path / "new", BOARD, [None], done=0)
        assert "no run has ended an episode yet" in cli("plot", str(path)).refusal

    @pytest.mark.parametrize(
        ("words", "told"),
        [
            (("policy",), "Figure 'policy' is of a task file"),
            (("--out", "f.png"), "--out is for one figure; name it: success or distances"),
            (("success", "--seeds", "3"), "--seeds is for a task file"),
            (("success", "--out", "f.pdf"), "end it in .png or .svg"),
            (("sucess",), "Did you mean 'success'?"),
        ],
    )
    def test_what_does_not_fit_a_folder_is_refused(self, cli, runs, words, told):
        assert told in cli("plot", str(runs), *words).refusal

    @pytest.mark.parametrize(
        ("words", "told"),
        [
            ((), "Name a figure of the task: learning, "),
            (("success",), "Figure 'success' is of a folder of runs, which train writes"),
            (("rewards", "--against", "steps"), "--against is for a folder of runs"),
        ],
    )
    def test_what_does_not_fit_a_task_is_refused(self, cli, words, told):
        assert told in cli("plot", BOARD, *words).refusal


def test_a_profile_is_drawn_of_finished_trainings(cli, runs):
    """Asked for by name, what is missing or damaged is one message."""
    unfinished = cli("plot", str(runs), "profile")
    assert (2, True) == (unfinished.code, "has no result yet" in unfinished.err)
    document = {
        "schema": "skillplan.training/1",
        "optimum": 1.5,
        "task": {"name": "board", "sha256": "0"},
        "solver": "dqn",
        "options": {},
        "runs": [{"cost": 1.5}, {"cost": 2.0}, {"cost": None}],
    }
    (runs / "result.json").write_text(json.dumps(document))
    drawn = cli("plot", str(runs), "profile", "--out", str(runs / "profile.svg"))
    assert 0 == drawn.code
    assert "P(" not in (runs / "profile.svg").read_text("utf-8")
    for damage in ({"runs": [{}]}, {"optimum": "much"}, {"runs": 3}):
        (runs / "result.json").write_text(json.dumps(document | damage))
        outcome = cli("plot", str(runs), "profile")
        assert (2, True) == (outcome.code, "result.json is damaged" in outcome.err), outcome.err


# `train --family generated:A-B`, and `evaluate` of a policy that carries over, on any task.


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
