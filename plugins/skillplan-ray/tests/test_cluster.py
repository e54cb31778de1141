"""Clusters of several nodes, all on this machine: the same answers, losses, and what is refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skillplan.checks.feasibility import Feasibility
from skillplan.errors import SkillplanError
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.setup import Setup
from skillplan.task.verdict import Verdict
from skillplan.testing import lid_task, reachable_states
from skillplan.testing.executor_suite import ExpensiveBoxes
from skillplan.workers.executor import Answer, Ended, Executor, Worker, packed
from skillplan.workers.executor_choice import ExecutorChoice
from skillplan_ray.fingerprint import differences, fingerprint

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"
OPTIMUM_M = 1.8670860141568904
PATIENCE_S = 60.0
# In so long Ctrl-C ends all actors [s].
ENDED_S = 2.0

slow = pytest.mark.slow(reason="starts two nodes of Ray; what machines differ in is in every run")


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A cluster of two nodes with a CPU each; this process is not connected to it."""
    yield from two_nodes()


def two_nodes() -> Iterator[Any]:
    """Start both, and end them after the test."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray
    from ray.cluster_utils import Cluster

    ray.shutdown()
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    made.second = made.add_node(num_cpus=1)
    yield made
    ray.shutdown()
    made.shutdown()


def at(cluster: Any) -> Setup:
    """Return the choice of a cluster."""
    return Setup(executor=ExecutorChoice("ray", cluster.address))


def executor_at(cluster: Any, slots: int = 2) -> Executor:
    make = at(cluster).make_executor
    assert make is not None
    return make(slots)


def queries() -> tuple[Any, list[Any]]:
    """Return a task and all that can be asked of it."""
    task = lid_task()
    states = reachable_states(SkillModel(Feasibility(task)), 20)
    return task, [(k, s) for s in states for k in task.skills if k.applicable(s)]


def heard(executor: Executor, worker: Worker) -> Any:
    """Return the next thing that a worker says."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        for ready in executor.first_ready([worker], 1.0):
            said = ready.answer()
            if said is not None:
                return said
    raise AssertionError("nothing was heard")


def node_of(executor: Executor, worker: Worker) -> str:
    """Return the node that a worker is on."""
    worker.take("__import__('ray').get_runtime_context().get_node_id()")
    answer = heard(executor, worker)
    assert isinstance(answer, Answer)
    return str(answer.content)


def workers_of(executor: Executor) -> dict[str, Worker]:
    """Return a worker on each node, which evaluates what it is given."""
    from functools import partial

    made = [executor.start(partial, packed(eval, "tests"), "tests") for _ in range(2)]
    return {node_of(executor, one): one for one in made}


@slow
def test_workers_are_spread_over_nodes_and_answers_are_the_same(cluster: Any) -> None:
    """Verdicts and all that is counted."""
    executor = executor_at(cluster)
    nodes = {cluster.head_node.node_id, cluster.second.node_id}
    assert nodes == set(workers_of(executor))
    executor.close()
    task, asked = queries()

    def outcome(setup: Setup) -> tuple[list[Verdict], int, int, int]:
        checks = Feasibility(
            task, [ExpensiveBoxes(task)], jobs=2, make_executor=setup.make_executor
        )
        verdicts = checks.verdicts(asked)
        checks.close()
        return verdicts, checks.checks, checks.hits, checks.executions

    assert outcome(Setup()) == outcome(at(cluster))


@pytest.mark.release(reason="kills a node; that of a process is told in every run")
def test_the_loss_of_a_node_is_told_in_words_and_costs_its_check_only(cluster: Any) -> None:
    """SIGKILL for the node and all that runs there; the check is made once more elsewhere."""
    executor = executor_at(cluster)
    workers = workers_of(executor)
    lost = workers[cluster.second.node_id]
    lost.take("__import__('time').sleep(600)")
    task, asked = queries()
    options = ExpensiveBoxes.Options(check_s=0.2)
    checks = Feasibility(
        task, [ExpensiveBoxes(task, options)], jobs=2, make_executor=at(cluster).make_executor
    )

    def poll() -> None:
        if cluster.second is not None and checks.queried["aabb"] > 6:
            cluster.remove_node(cluster.second, allow_graceful=False)
            cluster.second = None

    verdicts = checks.verdicts(asked, poll)
    assert cluster.second is None
    ended = heard(executor, lost)
    assert isinstance(ended, Ended)
    assert (ended.started, ended.killed) == (True, True)
    assert ended.how.startswith("the loss of its ")
    assert verdicts == Feasibility(task, [ExpensiveBoxes(task)]).verdicts(asked)
    checks.close()
    executor.close()


def processes_of(node: Any) -> list[int]:
    """Return the processes of a node, its actors too, but for what keeps track of the cluster."""
    own = [
        info.process.pid
        for kind, infos in node.all_processes.items()
        for info in infos
        if kind != "gcs_server"
    ]
    found = list(own)
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if parent in own:
            found.append(int(path.parent.name))
    return found


@pytest.fixture
def impatient_cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The same, in which a node counts as lost after some seconds of silence."""
    monkeypatch.setenv("RAY_health_check_initial_delay_ms", "5000")
    monkeypatch.setenv("RAY_health_check_period_ms", "1000")
    monkeypatch.setenv("RAY_health_check_timeout_ms", "4000")
    monkeypatch.setenv("RAY_health_check_failure_threshold", "3")
    yield from two_nodes()


@pytest.mark.release(reason="silences a node for seconds; its loss is told in the whole suite")
def test_a_node_whose_network_falls_silent_costs_its_check_only(impatient_cluster: Any) -> None:
    """Its processes stand still: nothing is closed, nothing answers; the check is made elsewhere.

    Nor does it matter that the node comes back later.
    """
    cluster = impatient_cluster
    task, asked = queries()
    options = ExpensiveBoxes.Options(check_s=0.2)
    checks = Feasibility(
        task, [ExpensiveBoxes(task, options)], jobs=2, make_executor=at(cluster).make_executor
    )
    executor = executor_at(cluster)
    workers = workers_of(executor)
    workers[cluster.second.node_id].take("__import__('time').sleep(600)")
    silenced: list[int] = []

    def poll() -> None:
        if not silenced and len(actors()) == 4:
            silenced.extend(processes_of(cluster.second))
            for process in silenced:
                os.kill(process, signal.SIGSTOP)

    try:
        verdicts = checks.verdicts(asked, poll)
        ended = heard(executor, workers[cluster.second.node_id])
    finally:
        for process in silenced:
            os.kill(process, signal.SIGCONT)
    assert len(silenced) >= 3
    assert isinstance(ended, Ended)
    assert ended.how.startswith("the loss of its machine")
    assert verdicts == Feasibility(task, [ExpensiveBoxes(task)]).verdicts(asked)
    checks.close()
    executor.close()


@slow
def test_a_cluster_of_mixed_versions_is_refused_in_words(cluster: Any, tmp_path: Path) -> None:
    """Before anything is done: what differs, and where."""
    about = tmp_path / "skillplan-9.9.9.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: skillplan\nVersion: 9.9.9\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    cluster.add_node(num_cpus=1, env_vars={"PYTHONPATH": path})
    with pytest.raises(SkillplanError, match=r"mixed.*: skillplan 9\.9\.9 \(here 0\.2\.0\)"):
        executor_at(cluster).start(int, packed("1", "tests"), "tests")


def actors() -> set[int]:
    """Return the processes of actors on this machine."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if path.read_bytes().startswith(b"ray::ListeningActor"):
                found.add(int(path.parent.name))
        except OSError:
            continue
    return found


def search(cluster: Any, tmp_path: Path) -> subprocess.Popen[str]:
    """Return a search of the board by physics that has its actors on a cluster."""
    words = ["search-optimal", str(BOARD), "--physics", "pybullet", "--collision", "contact-pairs"]
    words += ["--no-cache", "--no-screening", "--format", "json", "--jobs", "2"]
    return subprocess.Popen(
        [sys.executable, "-m", "skillplan", *words, "--executor", f"ray:{cluster.address}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def new_actors(before: set[int]) -> set[int]:
    """Return the actors that were not there before, as soon as there are any."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        found = actors() - before
        if found:
            return found
        time.sleep(0.1)
    raise AssertionError("there are no actors")


@pytest.mark.release(reason="a search by physics with actors; a lost node in the whole suite")
def test_a_search_loses_actors_and_proves_the_same(cluster: Any, tmp_path: Path) -> None:
    """One by SIGKILL; stdout is one document all the same."""
    pytest.importorskip("pybullet")
    before = actors()
    process = search(cluster, tmp_path)
    os.kill(min(new_actors(before)), signal.SIGKILL)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert json.loads(out)["cost"] == OPTIMUM_M


@pytest.mark.release(reason="a search by physics with actors; local processes in the whole suite")
def test_ctrl_c_ends_all_actors_at_once(cluster: Any, tmp_path: Path) -> None:
    """Within two seconds none is left, and the search says what it has."""
    pytest.importorskip("pybullet")
    before = actors()
    process = search(cluster, tmp_path)
    new_actors(before)
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    end_s = time.monotonic() + ENDED_S
    while actors() - before and time.monotonic() < end_s:
        time.sleep(0.05)
    left = actors() - before
    out, err = process.communicate(timeout=60)
    assert set() == left
    assert process.returncode == 130, err
    assert json.loads(out)["schema"] == "skillplan.result/1"


def learned(folder: Path) -> dict[str, bytes]:
    """Return what is learned and noted, by path; progress and events hold times of day."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.name.endswith((".safetensors", "metrics.jsonl")) or path.name == "policy.json"
    }


@pytest.mark.release(reason="trains twice; that files come back is in every run")
def test_what_is_learned_on_a_cluster_is_the_same(cluster: Any, tmp_path: Path) -> None:
    """Weights and metrics, file by file."""
    pytest.importorskip("skillplan_torch")
    words = ["train", str(BOARD), "--solver", "dqn", "--runs", "6", "--steps", "400", "--no-cache"]
    words += ["--jobs", "2", "--format", "json"]
    for name, more in (("here", []), ("there", ["--executor", f"ray:{cluster.address}"])):
        out = ["--out", str(tmp_path / name)]
        call = [sys.executable, "-m", "skillplan", *words, *more, *out]
        done = subprocess.run(call, capture_output=True, text=True, timeout=300)
        assert done.returncode in (0, 1), done.stderr
        assert len(json.loads(done.stdout)["runs"]) == 6
    assert len(learned(tmp_path / "here")) >= 12
    assert learned(tmp_path / "here") == learned(tmp_path / "there")


class TestMixedMachines:
    def test_the_same_machine_does_not_differ(self) -> None:
        """What is compared is the same every time."""
        found = fingerprint()
        assert {"processor", "Python", "numpy", "skillplan", "source of skillplan"} <= set(found)
        assert differences(found, fingerprint()) == []

    def test_what_differs_is_named(self) -> None:
        """Versions with both, what is missing there, and another source of the same version."""
        here = {"numpy": "2.4.6", "pybullet": "3.2.7", "skillplan": "1", "source of skillplan": "a"}
        there = {"numpy": "2.4.5", "skillplan": "1", "source of skillplan": "b"}
        assert differences(here, there) == [
            "numpy 2.4.5 (here 2.4.6)",
            "pybullet is not installed (here 3.2.7)",
            "another source of skillplan 1",
        ]
