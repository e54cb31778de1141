"""Clusters of several nodes, all on this machine: the same answers, losses, and what is refused."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import skillplan
from ray_clusters import PATIENCE_S, actors, first_actors, processes_of, two_nodes
from skillplan.checks import Feasibility
from skillplan.errors import SkillplanError
from skillplan.model import SkillModel
from skillplan.pipeline import Setup
from skillplan.task import Verdict
from skillplan.testing import ExpensiveBoxes, lid_task, reachable_states
from skillplan.workers import Answer, Ended, Executor, ExecutorChoice, Worker, pack_content

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"
OPTIMUM_M = 1.8670860141568904
# In so long Ctrl-C ends all actors [s].
ENDED_S = 2.0

slow = pytest.mark.slow(reason="starts two nodes of Ray; what machines differ in is in every run")


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
            answer = ready.answer()
            if answer is not None:
                return answer
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

    created = [executor.start(partial, pack_content(eval, "tests"), "tests") for _ in range(2)]
    return {node_of(executor, item): item for item in created}


@pytest.fixture(scope="module")
def kept_cluster():
    """A cluster for tests that leave it as it was."""
    yield from two_nodes()


@slow
def test_workers_are_spread_over_nodes_and_answers_are_the_same(kept_cluster):
    """Verdicts and all that is counted."""
    cluster = kept_cluster
    executor = executor_at(cluster)
    nodes = {cluster.head_node.node_id, cluster.second.node_id}
    assert nodes == set(workers_of(executor))
    executor.close()
    task, request = queries()

    def outcome(setup: Setup) -> tuple[list[Verdict], int, int, int]:
        checks = Feasibility(
            task, [ExpensiveBoxes(task)], jobs=2, make_executor=setup.make_executor
        )
        verdicts = checks.verdicts(request)
        checks.close()
        return verdicts, checks.checks, checks.hits, checks.executions

    assert outcome(Setup()) == outcome(at(cluster))


@pytest.mark.release(reason="kills a node; that of a process is told in every run")
def test_the_loss_of_a_node_is_told_in_words_and_costs_its_check_only(cluster):
    """SIGKILL for the node and all that runs there; the check is made once more elsewhere."""
    executor = executor_at(cluster)
    workers = workers_of(executor)
    lost = workers[cluster.second.node_id]
    lost.take("__import__('time').sleep(600)")
    task, request = queries()
    options = ExpensiveBoxes.Options(check_s=0.2)
    checks = Feasibility(
        task, [ExpensiveBoxes(task, options)], jobs=2, make_executor=at(cluster).make_executor
    )

    def poll() -> None:
        if cluster.second is not None and checks.queried["aabb"] > 6:
            cluster.remove_node(cluster.second, allow_graceful=False)
            cluster.second = None

    verdicts = checks.verdicts(request, poll)
    assert cluster.second is None
    ended = heard(executor, lost)
    assert isinstance(ended, Ended)
    assert (ended.started, ended.killed) == (True, True)
    assert ended.how.startswith("the loss of its ")
    assert verdicts == Feasibility(task, [ExpensiveBoxes(task)]).verdicts(request)
    checks.close()
    executor.close()


@pytest.mark.release(reason="silences a node for seconds; its loss is told in the whole suite")
def test_a_node_whose_network_falls_silent_costs_its_check_only(impatient_cluster):
    """Its processes stand still: nothing is closed, nothing answers; the check is made elsewhere.

    Nor does it matter that the node comes back later.
    """
    cluster = impatient_cluster
    task, request = queries()
    options = ExpensiveBoxes.Options(check_s=0.2)
    checks = Feasibility(
        task, [ExpensiveBoxes(task, options)], jobs=2, make_executor=at(cluster).make_executor
    )
    executor = executor_at(cluster)
    workers = workers_of(executor)
    workers[cluster.second.node_id].take("__import__('time').sleep(600)")
    silenced: list[int] = []

    def poll() -> None:
        if not silenced and len(actors(cluster)) == 4:
            silenced.extend(processes_of(cluster.second))
            for process in silenced:
                os.kill(process, signal.SIGSTOP)

    try:
        verdicts = checks.verdicts(request, poll)
        ended = heard(executor, workers[cluster.second.node_id])
    finally:
        for process in silenced:
            os.kill(process, signal.SIGCONT)
    assert len(silenced) >= 3
    assert isinstance(ended, Ended)
    assert ended.how.startswith("the loss of its machine")
    assert verdicts == Feasibility(task, [ExpensiveBoxes(task)]).verdicts(request)
    checks.close()
    executor.close()


@slow
def test_a_cluster_of_mixed_versions_is_refused_in_words(kept_cluster, tmp_path):
    """Before anything is done: what differs, and where."""
    about = tmp_path / "skillplan-9.9.9.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: skillplan\nVersion: 9.9.9\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    import ray

    ray.shutdown()
    node = kept_cluster.add_node(num_cpus=1, env_vars={"PYTHONPATH": path})
    here = re.escape(skillplan.__version__)
    with pytest.raises(SkillplanError, match=rf"mixed.*: skillplan 9\.9\.9 \(here {here}\)"):
        executor_at(kept_cluster).start(int, pack_content("1", "tests"), "tests")
    kept_cluster.remove_node(node)


SEARCH = ["search-optimal", str(BOARD), "--physics", "pybullet", "--collision", "contact-pairs"]
SEARCH += ["--no-cache", "--no-screening"]
TRAINING = ["train", str(BOARD), "--solver", "dqn", "--runs", "2", "--steps", "20000"]
STUDY = ["sweep", str(BOARD), "--solver", "sarsa", "-O", "episodes=2000,4000", "--runs", "200"]


def started(words: list[str], cluster: Any) -> subprocess.Popen[str]:
    """Return a command that has its actors on a cluster."""
    words = [*words, "--format", "json", "--jobs", "2", "--executor", f"ray:{cluster.address}"]
    return subprocess.Popen(
        [sys.executable, "-m", "skillplan", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.mark.release(reason="a search by physics with actors; a lost node in the whole suite")
def test_a_search_loses_actors_and_proves_the_same(cluster, tmp_path):
    """One by SIGKILL; stdout is one document all the same."""
    pytest.importorskip("pybullet")
    process = started(SEARCH, cluster)
    os.kill(min(first_actors(cluster)), signal.SIGKILL)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert json.loads(out)["cost"] == OPTIMUM_M


@pytest.mark.release(reason="commands with actors; local processes in the whole suite")
@pytest.mark.parametrize(
    ("words", "plugin", "wait_s", "schema"),
    [
        pytest.param(SEARCH, "pybullet", 2.5, "skillplan.result/1", id="a search"),
        pytest.param(TRAINING, "skillplan_torch", 6.0, "skillplan.training/1", id="a training"),
        pytest.param(STUDY, "numpy", 6.0, "skillplan.sweep/1", id="a study"),
    ],
)
def test_ctrl_c_ends_all_actors_at_once(words, plugin, wait_s, schema, cluster, tmp_path):
    """Within two seconds none is left, and the command says what it has."""
    pytest.importorskip(plugin)
    out = ["--out", str(tmp_path / "out")]
    process = started([*words, *out], cluster)
    first_actors(cluster)
    time.sleep(wait_s)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    begun_s = time.monotonic()
    while actors(cluster) and time.monotonic() < begun_s + PATIENCE_S:
        time.sleep(0.05)
    took_s = time.monotonic() - begun_s
    errors, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert json.loads(errors)["schema"] == schema
    assert took_s <= ENDED_S
    assert set() == actors(cluster)
