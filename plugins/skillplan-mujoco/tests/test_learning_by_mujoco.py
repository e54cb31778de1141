"""Learning from executions in MuJoCo: several worlds at once, in processes, change no bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from skillplan.cli import main

BLOCK = {"tool": "gripper", "mass_kg": 0.05, "size_m": [0.02, 0.02, 0.02]}
# Two blocks, of which the second stands on the first.
STACK: dict[str, Any] = {
    "kind": "assembly",
    "name": "stack",
    "robot": {"home_m": [0.307, 0.0], "safe_height_m": 0.15},
    "tools": {"gripper": {"type": "gripper", "opening_m": 0.08, "holder_m": [0.6, -0.3]}},
    "initial_tool": "gripper",
    "parts": {
        "lower": {**BLOCK, "start_m": [0.4, -0.1], "goal_m": [0.5, 0.1]},
        "upper": {**BLOCK, "start_m": [0.4, 0.0], "goal_m": [0.5, 0.1], "goal_on": "lower"},
    },
    "step_limit": 6,
    "reward": {"complete": 10.0, "infeasible": -10.0},
}


@pytest.mark.slow(reason="two trainings in processes; answers in other processes in every run")
def test_runs_in_two_processes_learn_what_they_learn_in_one(tmp_path, monkeypatch, capfd):
    """Each process executes skills in a world of its own; metrics and policies are equal."""
    pytest.importorskip("skillplan_torch", reason="what learns is a plugin of its own")
    file = tmp_path / "stack.yaml"
    file.write_text(yaml.safe_dump(STACK), "utf-8")
    folders = []
    for jobs in ("1", "2"):
        monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / f"cache {jobs}"))
        out = tmp_path / f"runs {jobs}"
        words = ["train", str(file), "--solver", "dqn", "--runs", "6", "--steps", "150"]
        words += ["--physics", "mujoco", "--collision", "contact-pairs", "--jobs", jobs]
        with pytest.raises(SystemExit) as ended:
            main([*words, "--out", str(out), "--format", "json"])
        readouterr = capfd.readouterr()
        assert ended.value.code == 0, readouterr.err
        assert json.loads(readouterr.out)["completed_runs"] == 6
        folders.append(out)
    first, other = folders
    kept = sorted(path.relative_to(first) for path in first.rglob("*.safetensors"))
    assert len(kept) >= 6
    for path in (Path("metrics.jsonl"), *kept):
        assert (first / path).read_bytes() == (other / path).read_bytes(), path
