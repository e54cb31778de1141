"""`skillplan train`: what it prints, what it keeps, and how it ends."""

from __future__ import annotations

import csv
import io
import json
import os
import pty
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skillplan.cli import main
from tabular_learner import learner_installed
from thinned import release_case, slow_case
from training_situations import event_lengths, learned_bytes

ROOT = Path(__file__).parents[2]
BOARD = str(ROOT / "configs" / "inverter_board.yaml")
QUICK = ("--solver", "tabular", "--runs", "3", "--steps", "600", "--checkpoint", "200")
PATIENCE_S = 120


@pytest.fixture(autouse=True, scope="module")
def _learner(tmp_path_factory):
    """A learner that is quick and exact, here and in child processes."""
    with (
        pytest.MonkeyPatch.context() as patch,
        learner_installed(tmp_path_factory.mktemp("site") / "site", patch),
    ):
        yield


@pytest.fixture(scope="module")
def kept(_learner, tmp_path_factory):
    """The folder of a training that nothing happened to, for all tests."""
    folder = tmp_path_factory.mktemp("kept") / "run"
    with pytest.raises(SystemExit) as ended:
        main(["train", BOARD, *QUICK, "--out", str(folder)])
    assert 0 == ended.value.code
    return folder


@pytest.fixture
def run_dir(kept, tmp_path):
    """The same, to be changed freely."""
    shutil.copytree(kept, tmp_path / "run")
    return tmp_path / "run"


class TestOutput:
    def test_json_is_one_document_that_is_kept_too(self, cli, tmp_path):
        outcome = cli("train", BOARD, *QUICK, "--out", str(tmp_path / "a"), "--format", "json")
        assert (0, "derived from the task: horizon 20\n") == (outcome.code, outcome.err)
        document = outcome.document
        assert "skillplan.training/1" == document["schema"]
        assert [0, 1, 2] == [run["seed"] for run in document["runs"]]
        assert (600, 600) == (document["steps"], document["options"]["steps"])
        assert document["optimum"] == pytest.approx(1.86709, abs=1e-5)
        assert document == json.loads((tmp_path / "a" / "result.json").read_text())

    def test_csv_has_a_row_for_every_run(self, cli, tmp_path):
        words = ("--out", str(tmp_path / "a"), "--format", "csv")
        rows = list(csv.DictReader(io.StringIO(cli("train", BOARD, *QUICK, *words).out)))
        assert ["0", "1", "2"] == [row["run"] for row in rows]

    @pytest.mark.slow(reason="two trainings; every run has the names of folders that are free")
    def test_without_a_name_the_folder_is_the_next_free_one(self, cli, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        for number in (1, 2):
            name = str(Path("runs") / f"inverter-board-tabular-{number}")
            message = cli("train", BOARD, *QUICK).err.splitlines()
            assert [f"writing to {name}", "derived from the task: horizon 20"] == message
            assert (Path(name) / "result.json").is_file()

    @pytest.mark.slow(reason="a training; the other endings in every run")
    def test_a_training_in_which_no_run_completes_ends_with_1(self, cli, tmp_path):
        words = ("-O", "mask=none", "-O", "epsilon=1", "--out", str(tmp_path / "a"))
        outcome = cli("train", BOARD, *QUICK, *words, "--format", "json")
        assert 1 == outcome.code
        assert 0 == outcome.document["completed_runs"]

    @pytest.mark.slow(
        reason="a training on a terminal; every run shows the progress of a search there"
    )
    def test_on_a_terminal_it_shows_how_the_runs_stand(self, tmp_path):
        words = [*QUICK[:-4], "--steps", "800", "-O", "pause_s=0.001", "--out"]
        command = [sys.executable, "-m", "skillplan", "train", BOARD, *words, str(tmp_path / "a")]
        main, terminal = pty.openpty()
        environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=terminal, env=environment
        )
        os.close(terminal)
        shown = b""
        while True:
            try:
                piece = os.read(main, 65536)
            except OSError:
                break
            if not piece:
                break
            shown += piece
        os.close(main)
        assert 0 == process.wait(PATIENCE_S)
        text = shown.decode()
        for words_shown in ("tabular, 3 runs", "episodes", "% success", "steps/s", "left"):
            assert words_shown in text
        assert "gap 0.00 %" in text or "best 1.8" in text


class TestInterruption:
    @pytest.mark.slow(
        reason="trains in a process, and goes on; in every run a training stops between strides, "
        "and a search hears Ctrl-C"
    )
    def test_ctrl_c_keeps_what_there_is_and_says_how_to_go_on(
        self, cli, kept, environment, tmp_path
    ):
        """To the whole group, as a terminal sends it."""
        folder = tmp_path / "run"
        # A pause changes nothing but an option; both trainings have it.
        words = [*QUICK, "-O", "pause_s=0.002", "--out", str(folder)]
        command = [sys.executable, "-m", "skillplan", "train", BOARD, *words]
        process = subprocess.Popen(
            [*command, "--format", "json"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        )
        try:
            wait_for_metrics(folder, 0)
            os.killpg(process.pid, signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
            process.communicate()
        assert 130 == process.returncode
        _, message = err.splitlines()
        assert message.startswith("interrupted; go on with: skillplan train ")
        document = json.loads(out)
        assert document["interrupted"]
        assert {run["steps"] for run in document["runs"]} < set(range(0, 600, 100))
        assert (folder / "runs" / "01" / "policy.safetensors").is_file()
        again = shlex.split(message.partition("go on with: skillplan ")[2])
        assert 0 == cli(*again).code
        assert same_run("metrics.jsonl", kept, folder)
        assert same_run("policy.safetensors", kept, folder)

    def test_resume_needs_the_folder(self, cli):
        assert "--resume needs --out DIR" in cli("train", BOARD, *QUICK, "--resume").refusal

    def test_without_time_left_it_can_go_on(self, cli, kept, tmp_path):
        """Its folder is whole, and what it learns in the end is the same."""
        cut = str(tmp_path / "cut")
        outcome = cli("train", BOARD, *QUICK, "--out", cut, "--time-limit", "0.001")
        assert 1 == outcome.code
        assert "ended by --time-limit 0.001; go on with: skillplan " in outcome.err
        assert 0 == cli("train", BOARD, *QUICK, "--out", cut, "--resume").code
        assert learned_bytes(kept) == learned_bytes(Path(cut))

    def test_the_proof_has_a_limit_of_its_own(self, cli, tmp_path):
        """The runs are done all the same."""
        words = ("--proof-time-limit", "1e-9", "--out", str(tmp_path / "a"), "--format", "json")
        outcome = cli("train", BOARD, *QUICK, *words)
        assert outcome.document["optimum"] is None
        assert [True] * 3 == [run["actions"] != [] for run in outcome.document["runs"]]

    @pytest.mark.parametrize(
        ("kills", "steps"),
        [
            slow_case(1, 600, reason="a killed program; one that is interrupted in every run"),
            release_case(20, 20_000, reason="20 kills"),
            release_case(3, 3_000, reason="three kills; one in the whole suite"),
        ],
    )
    def test_sigkill_at_random_instants_changes_nothing(
        self, cli, environment, tmp_path, kills, steps
    ):
        """Of the whole group, so that processes for groups of runs are ended, too."""
        words = ["--solver", "tabular", "--runs", "6", "--steps", str(steps), "--checkpoint", "200"]
        words += ["-O", "pause_s=0.0005", "--proof-time-limit", "5"]
        command = [sys.executable, "-m", "skillplan", "train", BOARD, *words, "--out"]
        whole, cut = tmp_path / "whole", tmp_path / "cut"
        assert 0 == cli("train", BOARD, *words, "--out", str(whole)).code
        chance, done = random.Random(kills), 0
        while done < kills:
            size = metrics_size(cut)
            process = subprocess.Popen(
                [*command, str(cut), "--resume", "--jobs", "2"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=environment,
                start_new_session=True,
            )
            try:
                wait_for_metrics(cut, size)
                time.sleep(chance.uniform(0.0, 0.8))
            finally:
                assert process.poll() is None, "it was done before it could be killed"
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            done += 1
        assert 0 == cli("train", BOARD, *words, "--out", str(cut), "--resume").code
        assert learned_bytes(whole) == learned_bytes(cut)
        assert event_lengths(whole) == event_lengths(cut)

    @pytest.mark.slow(reason="a killed program; one whose processes check is killed in every run")
    def test_sigkill_of_the_program_alone_ends_its_processes_before_another_goes_on(
        self, cli, environment, tmp_path
    ):
        words = ["--solver", "tabular", "--runs", "6", "--steps", "300", "--checkpoint", "100"]
        words += ["-O", "pause_s=0.002", "--out"]
        whole, cut = tmp_path / "whole", tmp_path / "cut"
        assert 0 == cli("train", BOARD, *words, str(whole)).code
        process = subprocess.Popen(
            [sys.executable, "-m", "skillplan", "train", BOARD, *words, str(cut), "--jobs", "2"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        try:
            wait_for_metrics(cut, 0)
        finally:
            process.kill()
            process.wait()
        assert 0 == cli("train", BOARD, *words, str(cut), "--resume").code
        assert learned_bytes(whole) == learned_bytes(cut)


class TestFaults:
    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--runs", "0"), "0 is not in the range"),
            (("--steps", "0"), "0 is not in the range"),
            (("--steps", "-3"), "-3 is not in the range"),
            (("--checkpoint", "0"), "0 is not in the range"),
            (("--jobs", "0"), "0 is not in the range"),
            (("-O", "alfa=1"), "Did you mean 'alpha'?"),
            (("-O", "alpha=2"), "alpha: must be <= 1"),
            (("-O", "steps=0"), "steps: must be >= 1"),
            (("-O", "exact.gap=1"), "No plugin 'exact' takes part"),
            (("--solver", "exact"), "Learners installed: "),
            (("--solver", "tabula"), "Did you mean 'tabular'?"),
            (("--physics", "kinematics"), "Did you mean 'kinematic'?"),
        ],
    )
    def test_a_wrong_word_is_one_clear_error(self, cli, tmp_path, words, message):
        folder = tmp_path / "a"
        outcome = cli("train", BOARD, *QUICK, *words, "--out", str(folder))
        assert 2 == outcome.code
        assert message in outcome.err
        assert "" == outcome.out
        assert not folder.exists()

    @pytest.mark.slow(reason="goes on from each; damaged checkpoints are in every run")
    @pytest.mark.parametrize(
        "how",
        [
            "cut",
            slow_case("changed", reason="two ways in every run"),
            slow_case("emptied", reason="two ways in every run"),
            slow_case(
                "other version",
                reason="goes on from each damaged file; every run has those that are cut",
            ),
        ],
    )
    def test_every_damaged_file_is_named_or_made_anew(self, cli, kept, run_dir, how):
        """Those that a training goes on from are named; those that it makes are made again."""
        whole = learned_bytes(kept)
        named = set()
        for path in sorted(kept.rglob("*")):
            # The other runs have the same files as the first.
            if not path.is_file() or "tfevents" in path.name or path.parts[-2] in ("01", "02"):
                continue
            content = path.read_bytes()
            if how == "other version" and b"/1" not in content:
                continue
            damaged = {
                "cut": content[: len(content) // 2],
                "changed": content.replace(b"1", b"}").replace(b"\0\0", b"\0\1"),
                "emptied": b"",
                "other version": content.replace(b"/1", b"/7", 1),
            }[how]
            shutil.rmtree(run_dir)
            shutil.copytree(kept, run_dir)
            there = run_dir / path.relative_to(kept)
            there.write_bytes(damaged)
            outcome = cli("train", BOARD, *QUICK, "--out", str(run_dir), "--resume")
            if outcome.code == 2:
                assert str(there) in outcome.err
                assert 1 == outcome.err.count("skillplan: error: "), outcome.err
                named.add(path.name)
            else:
                assert 0 == outcome.code, outcome.err
                ours = learned_bytes(run_dir, lambda name: name != "task.yaml")
                assert ours.items() <= whole.items(), path.name
        gone_on_from = {"manifest.json", "task.json", "checkpoint.safetensors", "progress.json"}
        assert named >= gone_on_from
        assert not named & {"policy.json", "last.json", "result.json", "policy.safetensors"}

    @pytest.mark.parametrize(
        "jobs",
        [
            slow_case(
                "1", reason="a process; every run ends one at a write, and tells of a full disk"
            ),
            slow_case("2", reason="two processes; one in every run"),
        ],
    )
    def test_a_full_disk_is_one_message_and_the_checkpoint_is_intact(
        self, cli, kept, environment, tmp_path, jobs
    ):
        """Files may not grow beyond 16 KiB: at first all goes well."""
        folder = tmp_path / "run"
        words = ["train", BOARD, *QUICK, "--jobs", jobs, "--out", str(folder)]
        command = f"exec {sys.executable} -m skillplan {shlex.join(words)}"
        environment = {**environment, "PYTHONDONTWRITEBYTECODE": "1"}
        limited = subprocess.run(
            ["bash", "-c", f"ulimit -f 16; {command}"],
            capture_output=True,
            text=True,
            env=environment,
        )
        assert (2, "") == (limited.returncode, limited.stdout)
        assert 1 == limited.stderr.count("skillplan: error: ")
        assert (
            "cannot be written: File too large. The last checkpoints are intact" in limited.stderr
        )
        assert 0 == cli(*words, "--resume").code
        assert learned_bytes(kept) == learned_bytes(folder)

    def test_a_run_that_fails_is_named_and_the_others_are_shown(self, cli, tmp_path):
        words = ("-O", "fails=1@250", "--out", str(tmp_path / "a"))
        outcome = cli("train", BOARD, *QUICK, *words)
        assert 0 == outcome.code
        assert "its values are not finite" in outcome.out

    def test_where_the_back_end_fails_everywhere_it_ends_with_3(
        self, cli, bursting_detector, tmp_path
    ):
        words = ("--collision", bursting_detector, "--out", str(tmp_path / "a"))
        outcome = cli("train", BOARD, *QUICK, *words, "--format", "json")
        assert 3 == outcome.code
        assert {"failed"} == {run["status"] for run in outcome.document["runs"]}
        assert "the simulator has gone away" in outcome.document["runs"][0]["reason"]

    @pytest.mark.slow(reason="a process that trains; the same from Python in every run")
    def test_a_folder_in_use_is_not_written_to(self, cli, run_dir, environment):
        words = ["--solver", "tabular", "--runs", "1", "-O", "pause_s=0.002", "--out"]
        folder = run_dir.parent / "busy"
        command = [sys.executable, "-m", "skillplan", "train", BOARD, *words, str(folder)]
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment
        )
        try:
            wait_for_metrics(folder, 0)
            outcome = cli("train", BOARD, *words, str(folder), "--resume")
        finally:
            process.kill()
            process.wait()
        assert 2 == outcome.code
        assert "another training is writing there just now" in outcome.err


def metrics_size(folder: Path) -> int:
    """Return how much all runs have noted [bytes]."""
    return sum(path.stat().st_size for path in folder.glob("runs/*/metrics.jsonl"))


def wait_for_metrics(folder: Path, size: int) -> None:
    """Wait until the runs have noted anything beyond so many bytes, or been cut to less."""
    deadline_s = time.monotonic() + PATIENCE_S
    while metrics_size(folder) == size:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def same_run(name: str, first: Path, other: Path) -> bool:
    """Whether a file of every run is the same in two folders."""
    paths = sorted(path.relative_to(first) for path in first.glob(f"runs/*/{name}"))
    return bool(paths) and all(
        (first / path).read_bytes() == (other / path).read_bytes() for path in paths
    )
