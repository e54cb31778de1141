"""Trainings that begin with the networks of earlier ones, of the same task or another."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from skillplan.cli import main
from skillplan.records import RunFolder
from training_situations import learned_bytes

LEARNERS = ("dqn", "ppo")


def call(*words: str) -> int:
    """Run a command here; return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    return int(ended.value.code or 0)


def train(solver: str, board: Path, out: Path, *more: str, steps: int = 300) -> int:
    words = ("--solver", solver, "--runs", "2", "--steps", str(steps), "--checkpoint", "100")
    small = ("-O", f"{solver}.width=32", "-O", f"{solver}.schedule_steps=300")
    return call("train", str(board), *words, *small, "--out", str(out), *more)


def result(folder: Path) -> dict[str, Any]:
    loads: dict[str, Any] = json.loads((folder / "result.json").read_text("utf-8"))
    return loads


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Boards of two and of three parts, whose first parts have the same names."""
    folder = tmp_path_factory.mktemp("boards")
    results = {}
    for parts in (2, 3):
        results[parts] = folder / f"{parts}.yaml"
        size = ("--parts", str(parts), "--density", "0.3", "--tools", "1")
        assert call("generate", "assembly", *size, "--out", str(results[parts])) == 0
    return results


@pytest.fixture(scope="module", params=LEARNERS)
def earlier(request, boards, tmp_path_factory):
    """A learner, and a training of it on two parts that completes the board."""
    folder = tmp_path_factory.mktemp("earlier") / request.param
    assert train(request.param, boards[2], folder) == 0
    return request.param, folder


def test_the_first_episode_does_what_was_learned(earlier, boards, tmp_path):
    """On the same task every run completes it at once, for what it cost there."""
    solver, folder = earlier
    before = result(folder)["runs"]
    assert train(solver, boards[2], tmp_path / "again", "--from", str(folder), steps=100) == 0
    for run in RunFolder(tmp_path / "again").runs():
        first = run.episodes[0]
        assert first.success
        assert before[run.run]["cost"] == pytest.approx(first.cost)
        assert run.best is not None


def test_another_task_begins_with_what_it_has_in_common(earlier, boards, tmp_path, capsys):
    solver, folder = earlier
    train(solver, boards[3], tmp_path / "more", "--from", str(folder))
    started = result(tmp_path / "more")["warm_start"]
    assert (started["skills_known"], started["skills"]) == (5, 7)
    assert started["runs"] == [0, 1]
    assert 0 < started["features_known"] < started["features"]
    assert started == RunFolder(tmp_path / "more").manifest.warm_start.model_dump(mode="json")  # type: ignore[union-attr]
    assert "begun      from networks of" in capsys.readouterr().out


def test_what_is_cut_off_goes_on_bit_for_bit(earlier, boards, tmp_path):
    solver, folder = earlier
    start = ("--from", str(folder))
    train(solver, boards[3], tmp_path / "whole", *start)
    train(solver, boards[3], tmp_path / "grown", *start, steps=100)
    train(solver, boards[3], tmp_path / "grown", *start, "--resume")
    assert learned_bytes(tmp_path / "whole") == learned_bytes(tmp_path / "grown")
    train(solver, boards[3], tmp_path / "drawn")
    assert learned_bytes(tmp_path / "whole") != learned_bytes(tmp_path / "drawn")


def test_going_on_with_another_beginning_is_refused(earlier, boards, tmp_path, capsys):
    solver, folder = earlier
    train(solver, boards[2], tmp_path / "a", steps=100)
    capsys.readouterr()
    assert train(solver, boards[2], tmp_path / "a", "--from", str(folder), "--resume") == 2
    assert "the networks that the runs start from" in capsys.readouterr().err


def test_what_does_not_fit_is_refused_before_a_folder_is_made(earlier, boards, tmp_path, capsys):
    solver, folder = earlier
    other = next(item for item in LEARNERS if item != solver)
    board = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"
    for words, message in (
        ((solver, boards[2], "--from", "nix"), "--from nix: there is no such folder"),
        ((other, boards[2], "--from", str(folder)), f"has networks of {solver}, not of {other}"),
        ((solver, boards[2], "--from", str(folder), "-O", f"{solver}.width=64"), "32 units"),
        ((solver, board, "--from", str(folder)), "no skill of"),
    ):
        capsys.readouterr()
        assert train(words[0], Path(words[1]), tmp_path / "none", *map(str, words[2:])) == 2
        assert message in capsys.readouterr().err
        assert not (tmp_path / "none").exists()


# PyTorch asks for the current folder while it is imported: one that is gone is told of.


BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"


@pytest.mark.slow(reason="imports PyTorch in a process; other solvers there in test_cli_outward")
@pytest.mark.parametrize("command", ["search-optimal", "train"])
def test_a_vanished_current_folder_is_one_message(command, tmp_path):
    """What to do is in it, and the exit code is that of wrong input."""
    script = 'cd "$0" && rmdir "$0" && exec "$@"'
    words = [sys.executable, "-m", "skillplan", command, str(BOARD), "--solver", "dqn"]
    gone = tmp_path / "gone"
    gone.mkdir()
    # An empty entry stands for the current folder, without which Python itself does not start.
    path = os.pathsep.join(entry for entry in sys.path if entry)
    done = subprocess.run(
        ["bash", "-c", script, str(gone), *words],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("skillplan: error: The solver 'dqn' ")
    assert done.stderr.endswith(
        "the current folder is gone, and PyTorch needs one; change to a folder that exists\n"
    )
