"""The executor `ray`, on clusters of this machine."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, ClassVar

import pytest

import expensive_back_ends
from expensive_back_ends import ExpensiveEngine, checks_in
from skillplan.checks import Feasibility
from skillplan.model import SkillModel
from skillplan.pipeline import Setup, solve
from skillplan.solvers.ordering import portfolio
from skillplan.task import Verdict
from skillplan.testing import ExecutorSuite, lid_task, reachable_states
from skillplan.workers import ExecutorChoice
from skillplan_ray import RayExecutor
from skillplan_ray import executor as executors
from sop_instances import instance

OPTIONS: dict[str, Any] = {"cpus": 0}


@pytest.fixture(scope="module")
def ray():
    """The choice of Ray, whose actors can import the back ends of tests."""
    import ray

    ray.shutdown()
    folders = [str(Path(expensive_back_ends.__file__).parent), os.environ.get("PYTHONPATH", "")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, folders)))
        yield Setup(executor=ExecutorChoice("ray", "", OPTIONS))
    ray.shutdown()


@pytest.mark.slow(reason="starts a Ray cluster and an actor a test; local ones in every run")
@pytest.mark.usefixtures("ray")
class TestRayExecutor(ExecutorSuite):
    executor = "ray"
    options: ClassVar[dict[str, Any]] = OPTIONS


@pytest.mark.parametrize("connected", [False, True])
def test_only_the_first_worker_waits_for_ray(connected, monkeypatch):
    """To start a cluster takes longer than to join one."""
    monkeypatch.setattr(executors, "is_connected", lambda: connected)
    here, there = RayExecutor(1), RayExecutor(1, address="head:6379")
    if connected:
        assert here.start_up_s == there.start_up_s == 0.0
    else:
        assert here.start_up_s > there.start_up_s > 0.0


FATAL = "pick(fuse)"


def checked(setup: Setup, options: dict[str, Any]) -> dict[str, Verdict]:
    """Return what an engine says of the first question on each skill."""
    task = lid_task()
    states = reachable_states(SkillModel(Feasibility(task)), 60)
    items = list({k.name: (k, s) for s in states for k in task.skills if k.applicable(s)}.values())
    engine = ExpensiveEngine(task, ExpensiveEngine.Options(**options))
    checks = Feasibility(task, [engine], jobs=2, make_executor=setup.make_executor)
    verdicts = checks.verdicts(items)
    checks.close()
    return {skill.name: verdict for (skill, _), verdict in zip(items, verdicts, strict=True)}


@pytest.mark.slow(reason="a Ray cluster, two actors lost; a local process killed in every run")
@pytest.mark.parametrize("once", [True, False])
def test_a_check_whose_actor_is_killed_is_made_once_more_and_then_unknown(once, ray, tmp_path):
    """SIGKILL in the middle of it: once costs one more execution, and no other check anything."""
    log = {"log": str(tmp_path)}
    result = checked(ray, {**log, "fail_on": FATAL, "how": "kill", "once": once})
    created = [check for check in checks_in(tmp_path) if check[1] == FATAL]
    assert len(created) == 2
    # In different actors.
    assert len({process for *_, process in created}) == 2
    assert len(checks_in(tmp_path)) == len(result) + 1
    expected = checked(Setup(), {})
    if not once:
        lost = result.pop(FATAL)
        assert lost.status == "unknown"
        assert lost.reason.startswith("the process that checked it was ended by the loss of its ")
        assert lost.reason.endswith(", twice")
        del expected[FATAL]
    assert result == expected


@pytest.mark.slow(reason="a search of seconds twice; local processes in every run")
def test_the_portfolio_finds_the_same_order_and_bound_on_ray(ray, monkeypatch):
    """Plan, proof and all counts; an actor takes its share, and none is lost."""
    # Subtrees are dealt before a single process would have proved the optimum.
    monkeypatch.setattr(portfolio, "_FIRST_WORK", 1_000_000)
    results = [solve(instance("ESC47").tasks[-1], "portfolio", to, jobs=2) for to in (Setup(), ray)]
    here, there = ((result.steps, result.cost, result.trace) for result in results)
    assert here == there
    assert results[0].status == "optimal"
    assert results[0].trace["processes"] == 2
    assert "lost_processes" not in results[0].trace
