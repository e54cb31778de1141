"""Folders of runs and of results that somebody else has made are data: nothing more is done."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from run_folders import OPTIMAL, changed, write_runs
from same_process import studies_in_this_process
from skillplan.cli import main
from skillplan.training import read_checkpoint
from tabular_learner import learner_installed
from thinned import thinned

ROOT = Path(__file__).parents[2]
BOARD = str(ROOT / "configs" / "inverter_board.yaml")
STUDY = ("sweep", BOARD, "-O", "episodes=20", "--runs", "1")
QUICK = ("--solver", "tabular", "--runs", "2", "--steps", "200", "--checkpoint", "100")
EVENTS = "tensorboard/run-00/events.out.tfevents.skillplan"
FOLDERS = ("runs", "groups", "tensorboard", "runs/00", "groups/0")
GROWING = ("runs/00/metrics.jsonl", EVENTS)
READ = (
    "manifest.json",
    "task.json",
    "groups/0/checkpoint.safetensors",
    "groups/0/progress.json",
    "runs/00/metrics.jsonl",
    "runs/00/policy.json",
    "runs/00/policy.safetensors",
    "runs/00/last.json",
    "runs/00/last.safetensors",
)
READ_ALWAYS = ("groups/0/checkpoint.safetensors", "runs/00/metrics.jsonl")
SECRET = "hunter2"


@pytest.fixture(autouse=True, scope="module")
def _learner(tmp_path_factory):
    """A learner that is quick and exact."""
    site = tmp_path_factory.mktemp("site") / "site"
    with pytest.MonkeyPatch.context() as patch, learner_installed(site, patch):
        yield


@pytest.fixture
def _in_this_process():
    """Studies without processes."""
    with studies_in_this_process():
        yield


@pytest.fixture(scope="module")
def trained(_learner, tmp_path_factory):
    """The folder of a short training of two runs, for all tests."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    with contextlib.redirect_stdout(io.StringIO()), pytest.raises(SystemExit) as ended:
        main(["train", BOARD, *QUICK, "--out", str(folder)])
    assert ended.value.code in (0, 1)
    return folder


@pytest.fixture
def run_dir(trained, tmp_path):
    """The same, as received: to be changed freely."""
    return Path(shutil.copytree(trained, tmp_path / "received" / "run"))


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    """A run whose policy completes the board, for all tests."""
    return write_runs(tmp_path_factory.mktemp("learned") / "run", BOARD, [OPTIMAL], steps=500)


@pytest.fixture
def runs(learned, tmp_path):
    """The same, as received: to be changed freely."""
    return Path(shutil.copytree(learned, tmp_path / "received" / "run"))


@pytest.fixture
def result(solved_board, tmp_path):
    """A folder of a result, as received: to be changed freely."""
    return Path(shutil.copytree(solved_board, tmp_path / "received" / "result"))


def refused(outcome: Any) -> str:
    """Return the one message of a command that refused what it was given."""
    assert (2, "") == (outcome.code, outcome.out), outcome
    assert 1 == len(outcome.err.splitlines()), outcome.err
    return str(outcome.err)


def resume(cli: Any, folder: Path) -> Any:
    """Go on with a training."""
    return cli("train", BOARD, *QUICK, "--out", str(folder), "--resume")


class TestLinks:
    @pytest.mark.parametrize("name", GROWING)
    @pytest.mark.parametrize("hard", [False, True])
    def test_resume_neither_cuts_nor_extends_a_file_elsewhere(
        self, cli, run_dir, tmp_path, name, hard
    ):
        """Whether the name is a link to it, or another name of it."""
        content = (run_dir / name).read_bytes() + b"precious\n" * 1000
        outside = tmp_path / "outside"
        outside.write_bytes(content)
        (run_dir / name).unlink()
        (os.link if hard else os.symlink)(outside, run_dir / name)
        message = refused(resume(cli, run_dir))
        assert f"{name} cannot be written: " in message
        assert content == outside.read_bytes()

    @pytest.mark.parametrize("name", GROWING)
    def test_nor_another_file_of_the_folder(self, cli, run_dir, name):
        """A link to the manifest would let the cut destroy that."""
        before = (run_dir / "manifest.json").read_bytes()
        (run_dir / name).unlink()
        (run_dir / name).symlink_to(run_dir / "manifest.json")
        assert "there is a link on the way to it" in refused(resume(cli, run_dir))
        assert before == (run_dir / "manifest.json").read_bytes()

    @pytest.mark.parametrize("name", thinned(FOLDERS, "runs", "tensorboard"))
    @pytest.mark.parametrize("inside", [False, True])
    def test_a_folder_of_it_is_no_link(self, cli, run_dir, tmp_path, name, inside):
        """Nothing is made, written or removed where it leads."""
        target = (run_dir if inside else tmp_path) / "elsewhere"
        (run_dir / name).rename(target)
        (run_dir / name).symlink_to(target, target_is_directory=True)
        (target / ".policy.json.0123456789abcdef.tmp").write_text("somebody's")
        before = {item: item.read_bytes() for item in sorted(target.rglob("*")) if item.is_file()}
        message = refused(resume(cli, run_dir))
        words = "there is a link on the way" if inside else "a link leads out of the folder"
        assert words in message
        after = {
            entry: entry.read_bytes() for entry in sorted(target.rglob("*")) if entry.is_file()
        }
        assert before == after

    def test_files_that_are_written_whole_take_the_place_of_links(self, cli, run_dir, tmp_path):
        """Where those lead stays as it is."""
        outside = tmp_path / "outside"
        outside.write_text("precious")
        names = ("metrics.jsonl", "result.json")
        for name in names:
            (run_dir / name).unlink()
            (run_dir / name).symlink_to(outside)
        assert resume(cli, run_dir).code in (0, 1)
        assert "precious" == outside.read_text()
        assert not any((run_dir / name).is_symlink() for name in names)

    @pytest.mark.parametrize("name", ["runs/00/policy.json", "runs/00/policy.safetensors"])
    def test_a_policy_is_not_read_through_a_link(self, cli, runs, tmp_path, name):
        """Not even one that stays in the folder."""
        (runs / name).rename(runs / "aside")
        (runs / name).symlink_to(runs / "aside")
        outcome = cli("evaluate", str(runs))
        assert 1 == outcome.code
        assert "there is a link on the way to it" in outcome.out

    @pytest.mark.parametrize("command", [("evaluate",), ("plot", "success", "--out")])
    def test_nor_the_copy_of_the_task(self, cli, runs, tmp_path, command):
        """Where the user's file is gone and the copy is to serve."""
        secret = tmp_path / "secret.yaml"
        secret.write_text(f"password: {SECRET}\n")
        changed(runs / "manifest.json", "task", "path", to=str(tmp_path / "gone.yaml"))
        (runs / "task.yaml").unlink()
        (runs / "task.yaml").symlink_to(secret)
        more = (command[1], *command[2:], str(tmp_path / "a.png")) if command[1:] else ()
        message = refused(cli(command[0], str(runs), *more))
        assert "task.yaml: cannot be read: a link leads out of the folder" in message
        assert SECRET not in message

    def test_nor_a_result_or_its_policies(self, cli, result, tmp_path):
        """Of the folder that search-optimal wrote."""
        policies = tmp_path / "policies.json"
        policies.write_text(f'{{"schema": "{SECRET}"}}')
        (result / "policies.json").symlink_to(policies)
        words = ("evaluate", BOARD, "--policy", str(result))
        assert "a link leads out of the folder" in refused(cli(*words))
        (result / "result.json").rename(tmp_path / "result.json")
        (result / "result.json").symlink_to(tmp_path / "result.json")
        for command in ("verify", "evaluate"):
            assert "a link leads out of the folder" in refused(cli(command, str(result)))

    @pytest.mark.slow(reason="runs a study; links in a folder of runs are in every run")
    @pytest.mark.usefixtures("_in_this_process")
    def test_a_study_is_not_gone_on_with_through_links(self, cli, tmp_path):
        """Neither its runs nor its manifest."""
        out = ("--out", str(tmp_path / "study"))
        assert cli(*STUDY, *out).code in (0, 1)
        for name in ("runs.jsonl", "manifest.json"):
            outside = tmp_path / name
            (tmp_path / "study" / name).rename(outside)
            (tmp_path / "study" / name).symlink_to(outside)
            before = outside.read_bytes()
            assert "a link leads out of" in refused(cli(*STUDY, *out, "--resume"))
            assert before == outside.read_bytes()
            (tmp_path / "study" / name).unlink()
            outside.rename(tmp_path / "study" / name)


class TestPipesAndDevices:
    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
    @pytest.mark.parametrize("name", thinned(READ, *READ_ALWAYS))
    def test_no_reader_waits_for_a_pipe(self, cli, run_dir, name):
        """In any of the files, whoever reads."""
        (run_dir / name).unlink()
        os.mkfifo(run_dir / name)
        picture = str(run_dir.parent / "a.png")
        for outcome in (
            resume(cli, run_dir),
            cli("evaluate", str(run_dir)),
            cli("plot", str(run_dir), "success", "--out", picture),
        ):
            assert outcome.code in (0, 1, 2)
            assert len(outcome.err.splitlines()) <= 3

    @pytest.mark.parametrize("name", thinned(READ, *READ_ALWAYS))
    def test_no_reader_reads_a_device_without_end(self, cli, run_dir, name):
        """Nor is it read through a link."""
        (run_dir / name).unlink()
        (run_dir / name).symlink_to("/dev/zero")
        outcomes = cli("evaluate", str(run_dir)), resume(cli, run_dir)
        assert {outcome.code for outcome in outcomes} <= {0, 1, 2}
        message = "".join(outcome.out + outcome.err for outcome in outcomes)
        assert "a link leads out of the folder" in message

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
    @pytest.mark.parametrize("name", ["result.json", "policies.json", "task.yaml"])
    def test_nor_in_the_folder_of_a_result(self, cli, result, name):
        """Whatever is made of it."""
        (result / name).unlink(missing_ok=True)
        os.mkfifo(result / name)
        changed(result / "result.json", "origin", "file", to="task.yaml") if name[0] == "t" else 0
        for command in ("verify", "evaluate"):
            outcome = cli(command, str(result))
            # No reader waits; what lies beside a result in the place of its policies is not valid.
            codes = {"verify": 1, "evaluate": 0} if name == "policies.json" else {}
            assert codes.get(command, 2) == outcome.code, outcome


class TestBounds:
    @pytest.mark.parametrize(
        ("path", "value", "message"),
        [
            (("family",), {"count": 10**12, "seed": 0}, "family.count: must be <= 10000, not 1000"),
            (("seeds",), list(range(200_000)), "seeds: must have at most 1000 entries, not 200000"),
            (("steps",), 10**15, "steps: must be <= 1000000000, not 1000000000000000"),
            (("checkpoint_steps",), 10**15, "checkpoint_steps: must be <= 1000000000, not 10000"),
            (("seed",), -1, "seed: must be >= 0, not -1"),
            (("seeds",), [-1, 0], "seeds[0]: must be >= 0, not -1"),
            (("groups",), [[0], [1], []], "groups[2]: must have at least 1 entry, not 0"),
            (("groups",), [[0]] * 5_000, "groups: must have at most 1000 entries"),
            (("groups",), [[1], [0]], "the groups do not hold every run once"),
            (("task", "path"), "a" * 100_000, "task.path: must have at most 4096 characters, not"),
            (("task", "source"), "a" * 100_000, "task.source: must have at most 4096 characters"),
            (("solver",), "a" * 100_000, "solver: must have at most 4096 characters"),
        ],
    )
    def test_a_manifest_is_bounded(self, cli, run_dir, path, value, message):
        """What is beyond is named at once, whoever reads it."""
        changed(run_dir / "manifest.json", *path, to=value)
        messages = refused(cli("evaluate", str(run_dir)))
        assert f"manifest.json: is damaged: {message}" in messages
        assert len(messages) < 500

    def test_resume_knows_the_bounds_too(self, cli, run_dir):
        """Before it makes anything."""
        changed(run_dir / "manifest.json", "seeds", to=list(range(200_000)))
        assert "seeds: must have at most 1000 entries" in refused(resume(cli, run_dir))

    def test_a_path_that_no_system_takes_is_nowhere(self, cli, runs):
        """A name may have 255 bytes; the copy serves."""
        changed(runs / "manifest.json", "task", "path", to=f"/{'a' * 4000}.yaml")
        assert 0 == cli("evaluate", str(runs), "--episodes", "1").code

    def test_so_is_that_of_a_result(self, cli, result):
        """Which is one message."""
        changed(result / "result.json", "origin", "file", to="a" * 100_000)
        message = refused(cli("verify", str(result)))
        assert "origin.file: must have at most 4096 characters, not 100000" in message
        changed(result / "result.json", "origin", "file", to="a" * 4_000)
        assert "is neither here nor beside it" in refused(cli("verify", str(result)))
        for words in (("verify",), ("evaluate",), ("simulate",)):
            refused(cli(*words, "a" * 100_000))

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"steps": "many"}, "steps: must be a whole number"),
            ({"lengths": [1]}, "lengths: must be a mapping"),
            ({"lengths": {"runs/00/metrics.jsonl": -1}}, "must be >= 0, not -1"),
            ({"notes": 1}, "notes: must be a mapping"),
            ({"surplus": 1}, "unknown key 'surplus'"),
        ],
    )
    def test_a_checkpoint_whose_hash_fits_may_be_wrong_all_the_same(self, run_dir, change, message):
        """Whoever makes one can make the hash."""
        from safetensors.numpy import save

        content = {"schema": "skillplan.checkpoint/1", "steps": 1, "lengths": {}, "notes": {}}
        text = json.dumps({**content, **change})
        arrays = {"a": np.zeros(1, dtype=np.float32)}
        digest = hashlib.sha256(text.encode() + b"a <f4 (1,);" + arrays["a"].tobytes()).hexdigest()
        header = json.dumps({"content": text, "sha256": digest})
        path = run_dir / "groups" / "0" / "checkpoint.safetensors"
        path.write_bytes(save(arrays, {"skillplan": header}))
        with pytest.raises(Exception, match="is damaged: ") as caught:
            read_checkpoint(path)
        assert message in str(caught.value)


PRIVATE = {
    "no YAML": f"{SECRET}: [{SECRET}\n",
    "a tag": f"!{SECRET} {SECRET}\n",
    "another kind": f"kind: {SECRET}\n",
    "a key twice": f"{SECRET}: 1\n{SECRET}: 2\n",
    "wrong keys": f"kind: assembly\n{SECRET}: {SECRET}\n",
    "no mapping": f"root:x:0:0:{SECRET}:/root:/bin/bash\n",
}


def board_with_secret() -> str:
    """Return a sound task that is another one than was learned, with a secret in it."""
    text = Path(BOARD).read_text("utf-8")
    return text.replace("name: inverter-board", f"name: {SECRET}").replace(
        "mass_kg: 0.120", "mass_kg: 0.12345"
    )


class TestFilesOfTheReader:
    """A received document may name any file: its content is not told."""

    @pytest.fixture(autouse=True)
    def _elsewhere(self, tmp_path, monkeypatch):
        (tmp_path / "cwd").mkdir()
        monkeypatch.chdir(tmp_path / "cwd")

    @pytest.mark.parametrize("what", thinned(PRIVATE, "no YAML", "wrong keys"))
    @pytest.mark.parametrize("near", [False, True])
    def test_evaluate_quotes_none_that_the_manifest_names(self, cli, runs, tmp_path, what, near):
        """Only where it is wrong, and how the user can see more."""
        secret = (runs.parent if near else tmp_path) / "private.yaml"
        secret.write_text(PRIVATE[what])
        changed(runs / "manifest.json", "task", "path", to=str(secret))
        message = refused(cli("evaluate", str(runs)))
        assert f"{secret}:1:" in message or f"{secret}:2:" in message
        assert f"skillplan check {secret}" in message
        assert SECRET not in message

    @pytest.mark.parametrize("what", thinned(PRIVATE, "no YAML", "wrong keys"))
    def test_plot_takes_the_copy_instead(self, cli, runs, tmp_path, what):
        """The figure is of what was learned."""
        (tmp_path / "private.yaml").write_text(PRIVATE[what])
        changed(runs / "manifest.json", "task", "path", to=str(tmp_path / "private.yaml"))
        outcome = cli("plot", str(runs), "success", "--out", str(tmp_path / "a.svg"))
        assert SECRET not in outcome.out + outcome.err + (tmp_path / "a.svg").read_text()
        assert 0 == outcome.code

    @pytest.mark.parametrize("what", thinned(PRIVATE, "no YAML", "wrong keys"))
    @pytest.mark.parametrize("command", thinned(("verify", "evaluate", "simulate"), "verify"))
    def test_nor_one_that_a_result_names(self, cli, result, tmp_path, what, command):
        """Whoever loads it."""
        (tmp_path / "private.yaml").write_text(PRIVATE[what])
        changed(result / "result.json", "origin", "file", to=str(tmp_path / "private.yaml"))
        message = refused(cli(command, str(result)))
        assert "is no sound task file here" in message
        assert SECRET not in message

    def test_a_sound_task_that_is_another_is_not_quoted_either(self, cli, runs, result, tmp_path):
        """Unless the user names it."""
        private = tmp_path / "private.yaml"
        private.write_text(board_with_secret())
        changed(runs / "manifest.json", "task", "path", to=str(private))
        changed(result / "result.json", "origin", "file", to=str(private))
        for words in (
            ("evaluate", str(runs)),
            ("evaluate", str(runs), "--changed-task"),
            ("evaluate", str(result), "--changed-task"),
            ("verify", str(result)),
        ):
            message = refused(cli(*words))
            assert SECRET not in message
            assert "0.12345" not in message
            assert "--task" in message
        assert "0.12345" in refused(cli("evaluate", str(runs), "--task", str(private)))

    def test_what_the_manifest_changes_does_not_ask_a_file_for_its_keys(self, cli, runs, tmp_path):
        """The hint after an unknown key names those that there are."""
        private = tmp_path / "private.yaml"
        private.write_text(f"kind: assembly\n{SECRET}: 1\n")
        changed(runs / "manifest.json", "task", "path", to=str(private))
        changed(runs / "manifest.json", "task", "changes", to={"hunter": "1", "a.b.c": "1"})
        assert SECRET not in refused(cli("evaluate", str(runs)))

    def test_one_that_the_user_names_is_quoted(self, cli, runs, tmp_path):
        """As in any other command."""
        (tmp_path / "mine.yaml").write_text(PRIVATE["wrong keys"])
        outcome = cli("evaluate", str(runs), "--task", str(tmp_path / "mine.yaml"))
        assert SECRET in outcome.err


def test_pieces_of_killed_programs_are_removed_by_the_next(cli, run_dir, tmp_path):
    """In the folders that a training has, and of the names that we give."""
    name = ".file.0123456789abcdef.tmp"
    ours = [run_dir / folder / name for folder in (".", "runs/00", "runs/01", "groups/0")]
    others = [run_dir / ".mine.tmp", run_dir / "runs" / "07" / name]
    others[1].parent.mkdir()
    for path in (*ours, *others):
        path.write_text("piece")
    assert resume(cli, run_dir).code in (0, 1)
    assert [False] * 4 == [path.exists() for path in ours]
    assert [True] * 2 == [path.exists() for path in others]
