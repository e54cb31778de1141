"""The same answers in one process, in two, with two actors of Ray and on a cluster of two nodes.

Whole commands, as users call them; what they print and keep is compared but for times.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ray_clusters import places
from skillplan.checks import Feasibility
from skillplan.model import SkillModel
from skillplan.pipeline import Setup, load_problem, make_feasibility
from skillplan.testing import reachable_states
from skillplan.workers import ExecutorChoice

CONFIGS = Path(__file__).parents[3] / "configs"
BOARD = CONFIGS / "inverter_board.yaml"
PHYSICS = ("--physics", "mujoco")
# Where it was, and what idle processes did in vain.
_ELSE = ("folder", "run_dir", "ahead")

release = pytest.mark.release(reason="whole commands at four places; two of them in every run")


@pytest.fixture
def generated(tmp_path):
    """A board at random."""
    path = tmp_path / "generated.yaml"
    words = ["generate", "assembly", "--parts", "6", "--density", "0.3", "--seed", "1"]
    called([*words, "--out", str(path)], tmp_path)
    return path


def called(words: list[str], folder: Path) -> str:
    """Return what a command prints, with a cache of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "skillplan", *words],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "SKILLPLAN_CACHE_DIR": str(folder / "cache")},
    )
    assert done.returncode in (0, 1), done.stderr
    return done.stdout


def timeless(content: Any) -> Any:
    """Return a document without times and places, which its keys announce."""
    if isinstance(content, list):
        return [timeless(item) for item in content]
    if not isinstance(content, dict):
        return content
    return {
        key: timeless(value)
        for key, value in content.items()
        if key not in _ELSE and not key.endswith(("_s", "_per_s"))
    }


def answers(words: list[str], folder: Path) -> Any:
    """Return the document that a command prints."""
    return timeless(json.loads(called([*words, "--format", "json"], folder)))


def verdicts(folder: Path) -> dict[str, Any]:
    """Return the verdicts kept on disk by the hashes in their paths, but for their times."""
    results = {}
    for path in sorted((folder / "cache").rglob("*.json")):
        content = json.loads(path.read_text())
        name = path.relative_to(folder).as_posix()
        results[name] = (content["key"], content["skill"], content["state"], content["verdict"])
    return results


def same_everywhere(words: list[str], cluster: Any, tmp_path: Path) -> dict[str, Path]:
    """Call a command at every place and compare what it prints; return the folders by place."""
    folders, results = {}, {}
    for name, place in places(cluster).items():
        folders[name] = tmp_path / name
        folders[name].mkdir()
        out = [word.replace("OUT", str(folders[name])) for word in words]
        results[name] = answers([*out, *place], folders[name])
    assert len(results) == 4
    for name, result in results.items():
        assert results["local 1"] == result, name
    return folders


@release
def test_searches_by_physics(cluster, tmp_path):
    """Plan, proof, verdicts reused and all counts."""
    pytest.importorskip("mujoco")
    words = ["search-optimal", str(BOARD), *PHYSICS, "--no-cache", "--no-screening"]
    same_everywhere(words, cluster, tmp_path)


@release
def test_verdicts_that_are_kept(cluster, tmp_path):
    """Whoever made them, the head has written them: same files, same figures in them."""
    pytest.importorskip("mujoco")
    folders = same_everywhere(["cache", "fill", str(BOARD), *PHYSICS], cluster, tmp_path)
    kept = verdicts(folders["local 1"])
    assert len(kept) == 21
    for name, folder in folders.items():
        assert kept == verdicts(folder), name


@release
def test_sweeps_of_a_generated_board(generated, cluster, tmp_path):
    """Records and what they show."""
    words = ["sweep", str(generated), "--solver", "sarsa", "-O", "alpha=0.1,0.5", "--runs", "2"]
    same_everywhere(words, cluster, tmp_path)


@release
def test_solvers_side_by_side_on_a_generated_board(generated, cluster, tmp_path):
    """A row each."""
    words = ["compare", str(generated), "--solvers", "exact,sarsa,value-iteration"]
    same_everywhere(words, cluster, tmp_path)


@release
def test_trainings(cluster, tmp_path):
    """Weights, metrics and counts, physics in the loop; two runs fill two slots."""
    pytest.importorskip("mujoco")
    pytest.importorskip("skillplan_torch")
    words = ["train", str(BOARD), "--solver", "dqn", "--runs", "2", "--steps", "400", *PHYSICS]
    folders = same_everywhere([*words, "--no-cache", "--out", "OUT/run"], cluster, tmp_path)
    here = learned(folders["local 1"] / "run")
    assert len(here) >= 8
    for name, folder in folders.items():
        assert here == learned(folder / "run"), name


def learned(folder: Path) -> dict[str, bytes]:
    """Return what is learned and noted, by path; progress and events hold times of day."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.name.endswith((".safetensors", "metrics.jsonl")) or path.name == "policy.json"
    }


@pytest.mark.release(reason="a check by an engine on a cluster; what is sent once in every run")
@pytest.mark.parametrize("config", ["inverter_board.yaml", "inverter_ur5e.yaml"])
def test_nodes_need_no_files_of_the_head(config, cluster, tmp_path):
    """Task, meshes and the description of the arm travel: the folder is gone before a check."""
    pytest.importorskip("mujoco")
    there = tmp_path / "configs"
    shutil.copytree(CONFIGS, there)
    problem = load_problem(str(there / config), {"physics": ["mujoco"]})
    task = problem.tasks[-1]
    shutil.rmtree(there)
    states = reachable_states(SkillModel(Feasibility(task)), 4)
    queries = [(k, s) for s in states for k in task.skills if k.applicable(s)][:6]
    results = []
    for executor in (ExecutorChoice(), ExecutorChoice("ray", cluster.address)):
        setup = Setup("mujoco", ("contact-pairs",), executor=executor)
        checks = make_feasibility(task, setup, jobs=2)
        results.append((checks.verdicts(queries), checks.executions))
        checks.close()
    assert results[0] == results[1]
    assert results[0][1] > 0
