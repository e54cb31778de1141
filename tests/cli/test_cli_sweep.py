"""`skillplan sweep`: what it prints, what it keeps, and how it ends."""

import csv
import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from same_process import studies_in_this_process
from thinned import slow_case

CASES = str(Path(__file__).parents[2] / "configs" / "swarmitfix_cases.yaml")
PATIENCE_S = 60


@pytest.fixture
def fragile_solver(install):
    """A solver that raises, or takes its process with it, where its option says so."""
    source = '''
        import os
        import signal
        from typing import Literal

        from pydantic import BaseModel, Field

        from skillplan import Plan, Solution, Solver
        from skillplan.errors import BackEndError

        class Fragile(Solver):
            """Answer, raise or die."""

            name = "fragile"

            class Options(BaseModel):
                """How it ends."""

                how: Literal["well", "raise", "die", "blame"] = Field("well", description="[-]")

            def solve(self, model, *, seed=0):
                if self.options.how == "raise":
                    raise RuntimeError("no memory left")
                if self.options.how == "blame":
                    raise BackEndError("the engine has failed")
                if self.options.how == "die":
                    os.kill(os.getpid(), signal.SIGKILL)
                return Solution(Plan(("B1", "B9", "B9", "B9")))
    '''
    install("solver", "fragile", "fragile_solver:Fragile", source)
    return "fragile"


QUICK = ("-O", "episodes=200,300", "--starts", "C20,C6", "--runs", "2")


@pytest.fixture
def in_this_process():
    """No processes for the runs."""
    with studies_in_this_process():
        yield


@pytest.mark.usefixtures("in_this_process")
class TestOutput:
    @pytest.mark.slow(reason="a study; csv and the table in every run")
    def test_json_is_one_document_with_all_runs(self, cli):
        outcome = cli("sweep", CASES, *QUICK, "--format", "json")
        assert (0, "") == (outcome.code, outcome.err)
        document = outcome.document
        assert "skillplan.sweep/1" == document["schema"]
        assert "five-cases" == document["name"]
        assert (4, 0, 0) == (len(document["runs"]), document["failed"], document["missing"])
        assert [200, 300] == [setting["options"]["episodes"] for setting in document["settings"]]
        assert ["C20", "C6"] == [start["start"] for start in document["settings"][0]["starts"]]

    def test_csv_has_a_row_for_every_setting_and_start(self, cli):
        rows = list(csv.DictReader(io.StringIO(cli("sweep", CASES, *QUICK, "--format", "csv").out)))
        assert [("200", "C20"), ("200", "C6"), ("300", "C20"), ("300", "C6")] == [
            (row["episodes"], row["start"]) for row in rows
        ]
        assert {"2"} == {row["runs"] for row in rows}

    @pytest.mark.parametrize(
        "style", ["table", slow_case("md", reason="another format in every run")]
    )
    def test_the_table_has_a_row_for_every_setting(self, cli, style):
        out = cli("sweep", CASES, *QUICK, "--format", style).out
        assert "five-cases: sarsa, 2 settings of 2 runs, one-at-a-time" in out
        assert "C20 4, C6 3 steps, proved by exact search" in out

    @pytest.mark.slow(reason="draws a study; every run has the columns of that figure")
    def test_a_figure_is_drawn(self, cli, tmp_path):
        picture = tmp_path / "study.png"
        assert 0 == cli("sweep", CASES, *QUICK, "--plot", str(picture)).code
        assert picture.read_bytes().startswith(b"\x89PNG")

    def test_seeds_of_a_planner_get_no_interval(self, cli, board):
        """As in the tables of train and evaluate."""
        words = ("--solver", "learned-model", "-O", "steps=60", "--runs", "3")
        document = cli("sweep", board, *words, "--format", "json").document
        assert [True] * 3 == [run["planned"] for run in document["runs"]]
        (setting,) = document["settings"]
        assert 3 == setting["arrived"]
        for figure in ("arrived_share", "best_share", "steps", "excess"):
            assert setting[figure].get("ci95") is None, figure
        assert setting["learning_s"]["ci95"] is not None

    def test_a_step_limit_can_be_set(self, cli):
        """From a start that takes longer, the solver has failed."""
        words = ("--starts", "C20,C78", "--set", "step_limit=5", "--runs", "1")
        document = cli("sweep", CASES, *words, "--format", "json").document
        assert ["solved", "unsolved"] == [
            outcome["status"] for outcome in document["runs"][0]["outcomes"]
        ]


class TestFolder:
    @pytest.mark.usefixtures("in_this_process")
    def test_what_is_kept_can_be_gone_on_with(self, cli, tmp_path):
        folder = tmp_path / "study"
        first = cli("sweep", CASES, *QUICK, "--out", str(folder), "--format", "json")
        assert {"manifest.json", "runs.jsonl", "sweep.json", "starts.csv"} == {
            path.name for path in folder.iterdir()
        }
        manifest = json.loads((folder / "manifest.json").read_text())
        assert first.document["task"] == manifest["task"]
        assert first.document == json.loads((folder / "sweep.json").read_text())
        again = cli("sweep", CASES, *QUICK, "--out", str(folder), "--resume", "--format", "json")
        assert first.document == again.document

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--seed", "1"), "the seeds: 0 there, 1 now"),
            slow_case(
                ("--set", "bench.pitch_m=0.3"),
                "differs in the task",
                reason="other seeds in every run",
            ),
            slow_case(
                ("--design", "grid"),
                'the design: "one-at-a-time" there, "grid" now',
                reason="other seeds in every run",
            ),
            slow_case(
                ("-O", "alpha=0.2"),
                "differs in the fixed options",
                reason="other seeds in every run",
            ),
        ],
    )
    @pytest.mark.usefixtures("in_this_process")
    def test_another_study_is_refused_in_words(self, cli, tmp_path, words, message):
        folder = ("--out", str(tmp_path / "study"))
        cli("sweep", CASES, *QUICK, *folder)
        refusal = cli("sweep", CASES, *QUICK, *words, *folder, "--resume").refusal
        assert message in refusal
        assert 1 == refusal.count("\n")


class TestFaults:
    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("-O", "gamma=0.8:0.9"), "has the form FROM:TO:COUNT"),
            (("-O", "gama=0.8:0.9:3"), "Did you mean 'gamma'?"),
            (("-O", "gamma"), "must have the form [PLUGIN.]KEY=VALUE"),
            (("-O", "exact.gap=1"), "No plugin 'exact' takes part"),
            (("--starts", "C99"), "--starts C99: no place"),
            (("--starts", ","), "--starts names no start"),
            (("--resume",), "--resume needs --out DIR"),
            (("--plot", "study.gif"), "--plot study.gif: figures are not saved as .gif"),
            (("--runs", "0"), "0 is not in the range"),
            (("--jobs", "0"), "0 is not in the range"),
            (("--solver", "sarsaa"), "Did you mean 'sarsa'?"),
        ],
    )
    def test_a_wrong_word_is_one_clear_error(self, cli, words, message):
        outcome = cli("sweep", CASES, *words)
        assert 2 == outcome.code
        assert message in outcome.err
        assert "" == outcome.out

    @pytest.mark.slow(reason="starts processes; failed runs are in every run in this one")
    @pytest.mark.parametrize("jobs", ["1", slow_case("2", reason="one process in every run")])
    def test_a_run_that_fails_is_named_and_the_others_go_on(self, cli, fragile_solver, jobs):
        words = ("--solver", fragile_solver, "-O", "how=raise,die,well", "--runs", "1")
        outcome = cli("sweep", CASES, *words, "--jobs", jobs, "--format", "json")
        assert 3 == outcome.code
        document = outcome.document
        assert (2, 0) == (document["failed"], document["missing"])
        errors = {run["setting"]: run["error"] for run in document["runs"]}
        assert "RuntimeError: no memory left" in errors[0]
        assert "its process ended by signal 9" == errors[1]
        assert errors[2] is None
        shown = cli("sweep", CASES, *words, "--jobs", jobs).out
        assert "how = die, seed 0: its process ended by signal 9" in shown

    @pytest.mark.usefixtures("in_this_process")
    def test_a_study_with_a_failed_run_keeps_the_others_and_ends_with_2_or_3(
        self, cli, fragile_solver, tmp_path
    ):
        """The code is 2 if the solver raised; 3 is for back ends and processes."""
        study = str(tmp_path / "study")
        words = ("--solver", fragile_solver, "--runs", "1", "--format", "json", "--out", study)
        raised = cli("sweep", CASES, *words, "-O", "how=raise,well")
        assert 2 == raised.code
        assert [False, False] == [run["back_end_failed"] for run in raised.document["runs"]]
        assert "no memory left" in raised.document["runs"][0]["error"]
        assert 1 == raised.document["settings"][1]["arrived"]
        again = cli("sweep", CASES, *words, "-O", "how=raise,well", "--resume")
        assert raised.document["runs"][0] == again.document["runs"][0]
        blamed = cli("sweep", CASES, *words[:-1], f"{study}-2", "-O", "how=blame,well")
        assert 3 == blamed.code
        assert [True, False] == [run["back_end_failed"] for run in blamed.document["runs"]]

    @pytest.mark.usefixtures("in_this_process")
    def test_a_study_in_which_nothing_arrives_ends_with_1(self, cli):
        words = ("--set", "step_limit=1", "-O", "episodes=10", "--runs", "1")
        outcome = cli("sweep", CASES, *words, "--format", "json")
        assert 1 == outcome.code
        assert [0] == [setting["arrived"] for setting in outcome.document["settings"]]

    @pytest.mark.slow(reason="waits for processes; a training that is interrupted in every run")
    def test_ctrl_c_prints_what_is_done(self, environment, tmp_path):
        """To the whole group, as a terminal sends it: one document, no noise, exit code 130."""
        values = ["-O", "episodes=100,100000000", "--runs", "3", "--jobs", "2"]
        command = [sys.executable, "-m", "skillplan", "sweep", CASES, *values]
        process = subprocess.Popen(
            [*command, "--out", str(tmp_path / "study"), "--format", "json"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        )
        runs = tmp_path / "study" / "runs.jsonl"
        deadline_s = time.monotonic() + PATIENCE_S
        try:
            while not runs.exists() or not runs.read_bytes():
                assert time.monotonic() < deadline_s
                time.sleep(0.05)
            os.killpg(process.pid, signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
            process.communicate()
        assert (130, "") == (process.returncode, err)
        document = json.loads(out)
        assert document["interrupted"]
        assert 6 == document["missing"] + len(document["runs"])
        assert document["runs"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--sampler", "optuna"), "--sampler optuna needs --out DIR"),
        (("--sampler", "optuna", "--design", "grid", "--out", "x"), "leave out --sampler"),
        (("--sampler", "optima", "--out", "x"), "Unknown sampler 'optima'"),
        (("--sampler", "optuna", "--out", "x", "--minimise", "luck"), "luck"),
        (("--sampler", "optuna", "--out", "x", "--trials", "0"), "--trials"),
    ],
)
def test_a_sampler_asked_for_wrongly_is_one_message(cli, words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refusal = cli("sweep", CASES, "--solver", "sarsa", "-O", "gamma=0.8:0.9", *words).refusal
    assert message in refusal
    assert "Traceback" not in refusal
    assert list(tmp_path.iterdir()) == []
