"""Checks made ahead by idle processes: time is all that they change."""

import random
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from expensive_back_ends import CheapDetector, ExpensiveDetector, ExpensiveEngine
from processes_in_any_order import AnyOrder, AnyOrderOfMortals, Silent
from situations import small_tasks
from skillplan.checks import DiskVerdictCache, Feasibility, check_workers
from skillplan.errors import BackEndError
from skillplan.model import SkillModel
from skillplan.solvers import ExactSolver
from skillplan.task import Verdict
from skillplan.testing import lid_task

TASK = lid_task()
SEEDS = st.integers(0, 2**32)


def searched(task, jobs, folder=None, *, executor=AnyOrder, seed=0, **options):
    """Return what exact search finds, what was counted, what is kept, and its foresight."""
    back_ends = [
        plugin(task, plugin.Options(seed=seed, **options))
        for plugin in (CheapDetector, ExpensiveEngine, ExpensiveDetector)
    ]
    cache = None if folder is None else DiskVerdictCache(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(AnyOrder, "rng", random.Random(seed))
        patch.setattr(check_workers, "LocalProcesses", executor)
        feasibility = Feasibility(task, back_ends, cache, jobs=jobs)
        with closing(feasibility):
            solution = ExactSolver().solve(SkillModel(feasibility))
    counts = (feasibility.checks, feasibility.hits, feasibility.executions, feasibility.reached)
    kept = {
        str(path.relative_to(folder)): path.read_text("utf-8").partition('"took_s"')[0]
        for path in (Path(folder).rglob("*.json") if folder else ())
    }
    return (solution, counts, dict(feasibility.queried), kept), feasibility.foresight


@settings(max_examples=examples(40))
@given(task=small_tasks(), seed=SEEDS, jobs=st.integers(2, 4))
def test_solution_counts_and_cache_are_those_of_one_process(tmp_path_factory, task, seed, jobs):
    """Whatever was checked ahead, and whichever process is the faster."""
    folder = tmp_path_factory.mktemp("ahead")
    item, _ = searched(task, 1, folder / "1", seed=seed)
    assert searched(task, jobs, folder / "n", seed=seed)[0] == item


class Granting(ExpensiveEngine):
    """Grants everything, each time for one state only."""

    name = "granting"

    def check(self, skill, state):
        """Grant it."""
        return Verdict.feasible(state, TASK.facts.state(TASK.facts.all_bits) - state)


def test_what_is_checked_ahead_is_what_is_asked_next(monkeypatch):
    """Where everything is feasible, most of it is of use."""
    monkeypatch.setattr(check_workers, "LocalProcesses", AnyOrder)
    feasibility = Feasibility(TASK, [Granting(TASK)], jobs=2)
    ExactSolver().solve(SkillModel(feasibility))
    assert feasibility.foresight.useful > feasibility.executions / 3
    assert feasibility.foresight.useful > feasibility.foresight.wasted


def test_one_process_checks_nothing_ahead():
    """There is none that idles."""
    assert searched(TASK, 1)[1] is None


@settings(max_examples=examples(15))
@given(task=small_tasks(), seed=SEEDS)
def test_a_process_lost_while_it_checks_ahead_changes_nothing(task, seed):
    """It is checked once more when it is asked for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("processes_in_any_order.Mortal.deaths", set())
        lossy, _ = searched(task, 3, executor=AnyOrderOfMortals, seed=seed)
    assert lossy == searched(task, 1, seed=seed)[0]


@pytest.mark.parametrize("skill", [skill.name for skill in TASK.skills])
def test_a_back_end_that_fails_ahead_fails_where_it_is_asked_or_not_at_all(tmp_path, skill):
    """The search comes to what it comes to in one process."""
    results = []
    for jobs in (1, 3):
        try:
            results.append(searched(TASK, jobs, fail_on=skill, how="raise", log=str(tmp_path))[0])
        except BackEndError as error:
            results.append(str(error))
    assert results[0] == results[1]


def test_who_ends_the_waiting_ends_what_is_checked_ahead(monkeypatch):
    """No process is left with a check that nobody waits for."""
    started = []
    monkeypatch.setattr(Silent, "started", started)
    monkeypatch.setattr(check_workers, "LocalProcesses", Silent)
    feasibility = Feasibility(TASK, [ExpensiveEngine(TASK)], jobs=2)
    first, second = [skill for skill in TASK.skills if skill.applicable(TASK.initial)][:2]
    polls = iter(range(3))

    def poll():
        if next(polls) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        feasibility.verdict(first, TASK.initial, poll, lambda: iter([(TASK.initial, second)]))
    assert len(started) == 2
    assert not any(worker.alive for worker in started)
