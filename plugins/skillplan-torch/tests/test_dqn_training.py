"""Trainings of DQN by the command line: killed at random instants, they lose nothing."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skillplan.cli.app import main
from training_situations import BOARD, learned_bytes

PATIENCE_S = 240


def command(folder: Path, runs: int, steps: int) -> list[str]:
    """Return the call that trains in a folder."""
    words = [sys.executable, "-m", "skillplan", "train", str(BOARD), "--solver", "dqn"]
    words += ["--runs", str(runs), "--steps", str(steps), "--checkpoint", "100"]
    return [*words, "--out", str(folder)]


def train(folder: Path, runs: int, steps: int, *more: str) -> int:
    """Train to the end, in this process; return 0, or 1 where no run completes the task."""
    words = [*command(folder, runs, steps)[3:], "--jobs", "1", *more]
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code in (0, 1)
    return int(ended.value.code)


def noted_bytes(folder: Path) -> int:
    """Return how much all runs have noted [bytes]."""
    return sum(path.stat().st_size for path in folder.glob("runs/*/metrics.jsonl"))


def checkpoints(folder: Path) -> dict[str, bytes]:
    """Return the checkpoints of all groups."""
    found = sorted(folder.glob("groups/*/checkpoint.safetensors"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


@pytest.mark.parametrize(
    ("runs", "steps", "kills"),
    [
        (2, 600, 1),
        pytest.param(6, 3_000, 20, marks=pytest.mark.slow(reason="20 kills; one in every run")),
    ],
)
def test_sigkill_at_random_instants_changes_nothing(
    tmp_path: Path, runs: int, steps: int, kills: int
) -> None:
    """Of the whole group: metrics, policies and checkpoints are the same to the byte."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    code = train(whole, runs, steps)
    chance, done = random.Random(kills), 0
    for _ in range(kills):
        size, deadline_s = noted_bytes(cut), time.monotonic() + PATIENCE_S
        process = subprocess.Popen(
            [*command(cut, runs, steps), "--jobs", "2", "--resume"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            # Until it has noted something, or cut off what is beyond its checkpoint.
            while noted_bytes(cut) == size and process.poll() is None:
                assert time.monotonic() < deadline_s
                time.sleep(0.01)
            time.sleep(chance.uniform(0.0, 0.3))
            done += process.poll() is None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    # The machine may be so fast that the last ones found it done.
    assert done >= kills // 2 + 1
    assert train(cut, runs, steps, "--resume") == code
    ours, theirs = learned_bytes(cut), learned_bytes(whole)
    assert sum("policy.safetensors" in name for name in ours) == runs
    assert ours == theirs
    assert len(checkpoints(cut)) == (runs + 4) // 5
    assert checkpoints(cut) == checkpoints(whole)
