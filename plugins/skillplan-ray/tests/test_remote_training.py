"""Trainings on a cluster: what comes back meanwhile, and what the loss of a node costs."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ray_clusters import PATIENCE_S
from skillplan.records import CHECKPOINT
from skillplan.training import read_checkpoint

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"
# Of many strides, each of which takes a while.
WORDS = ["--solver", "dqn", "--runs", "2", "--steps", "2000", "--checkpoint", "200", "--no-cache"]


def training(folder: Path, *more: str) -> subprocess.Popen[str]:
    """Return a training in two processes."""
    words = ["train", str(BOARD), *WORDS, "--jobs", "2", "--format", "json", *more]
    return subprocess.Popen(
        [sys.executable, "-m", "skillplan", *words, "--out", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def steps_kept(folder: Path) -> list[int]:
    """Return the steps of the checkpoints that have come, each of them whole."""
    paths = sorted(folder.glob(f"groups/*/{CHECKPOINT}"))
    results = [read_checkpoint(path, within=folder) for path in paths]
    return [result.steps for result in results if result is not None]


def learned(folder: Path) -> dict[str, bytes]:
    """Return what is learned, noted and kept, by path."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.name.endswith((".safetensors", "metrics.jsonl")) or path.name == "policy.json"
    }


@pytest.mark.release(reason="trains twice; a loss in the middle without a cluster in every run")
def test_a_training_goes_on_from_its_checkpoint_when_its_node_is_killed(cluster, tmp_path):
    """On the node that is left, to the bit; every checkpoint that is seen before is a whole one."""
    pytest.importorskip("skillplan_torch")
    here, there = tmp_path / "here", tmp_path / "there"
    process = training(there, "--executor", f"ray:{cluster.address}")
    seen = [steps_kept(there)]
    end_s = time.monotonic() + PATIENCE_S
    while len(seen[-1]) < 2 or min(seen[-1]) < 400:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s, seen[-1]
        seen.append(steps_kept(there))
        time.sleep(0.05)
    cluster.remove_node(cluster.second, allow_graceful=False)
    out, err = process.communicate(timeout=300)
    assert process.returncode in (0, 1), err
    assert [run["steps"] for run in json.loads(out)["runs"]] == [2000, 2000]
    # They came while it was learning, not at its end.
    assert len({tuple(item) for item in seen}) >= 3
    assert max(seen[-1]) < 2000
    alone = training(here)
    alone.communicate(timeout=300)
    assert learned(here) == learned(there)
    assert len(learned(here)) >= 10
