"""Executors by name: the one of this machine, and who may choose another."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import pytest

from same_process import SameProcess
from skillplan.pipeline import (
    Setup,
    compare_solvers,
    load_problem,
    make_feasibility,
    registry,
    solve,
)
from skillplan.sweep import do_study, plan_study
from skillplan.testing import ExecutorSuite, ExpensiveBoxes, lid_task
from skillplan.training import Trainer, TrainingFolder, plan_training
from skillplan.workers import Ended, ExecutorChoice, Prepare, Worker
from tabular_learner import learner_installed
from training_situations import BOARD

pytestmark = pytest.mark.slow(reason="processes of its own; checks in several in every run")


class TestLocalProcesses(ExecutorSuite):
    executor = "local"


class Elsewhere(SameProcess):
    """An executor of somebody else's: it notes for what it was asked for workers."""

    name = "elsewhere"
    takes_address = True
    started: ClassVar[list[str]] = []

    def start(self, prepare: Prepare, content: bytes, what: str) -> Worker:
        self.started.append(f"{what}, {self.slots} slots at {self.address}")
        return super().start(prepare, content, what)


SOLVERS = ("exact", "value-iteration")
ELSEWHERE = Setup(executor=ExecutorChoice("elsewhere", "there"))


@pytest.fixture
def elsewhere(monkeypatch):
    """An executor that is registered from outside; returns what was asked of it."""
    known = registry.load
    ours = {"elsewhere": Elsewhere, ExpensiveBoxes.name: ExpensiveBoxes}
    monkeypatch.setattr(
        registry, "load", lambda kind, name: ours[name] if name in ours else known(kind, name)
    )
    monkeypatch.setattr(Elsewhere, "started", [])
    return Elsewhere.started


def purposes(started: list[str]) -> list[str]:
    """Return what workers were started for."""
    return [words.partition(",")[0] for words in started]


@pytest.fixture
def learner(tmp_path, monkeypatch):
    """The name of a learner that is quick."""
    with learner_installed(tmp_path / "site", monkeypatch) as name:
        yield name


class TestWhoeverHasJobs:
    """Takes the executor of the setup, even for a single job."""

    def test_checks(self, elsewhere):
        task = lid_task()
        checks = make_feasibility(task, ELSEWHERE, jobs=3, back_ends=[ExpensiveBoxes(task)])
        alone = make_feasibility(task, back_ends=[ExpensiveBoxes(task)])
        queries = [(skill, task.initial) for skill in task.skills if skill.applicable(task.initial)]
        assert alone.verdicts(queries) == checks.verdicts(queries)
        assert {"checks, 3 slots at there"} == set(elsewhere)

    def test_searches(self, elsewhere):
        """The cost is the one that is proved here."""
        task = lid_task()
        here, there = (
            solve(task, "exact", setup, back_ends=[ExpensiveBoxes(task)])
            for setup in (Setup(), ELSEWHERE)
        )
        assert (here.cost, here.checks) == (there.cost, there.checks)
        assert {"checks, 1 slots at there"} == set(elsewhere)

    def test_studies(self, elsewhere):
        """With the runs that are done here."""
        plan, job = plan_study(lid_task(), "exact", setup=ELSEWHERE, runs=2)
        result = do_study(plan, job, jobs=2)
        assert 2 == len(result.records)
        assert ["the runs, 2 slots at there"] * 2 == elsewhere

    def test_what_is_sent_elsewhere_names_the_executor_by_data_alone(self):
        """No process is asked for, or connected to, before there are jobs."""
        assert Setup().make_executor is None
        assert Setup(executor=ExecutorChoice("local")).make_executor is None


class TestWhatIsSentElsewhere:
    """Makes its expensive checks itself: whatever runs in a worker starts no others."""

    setup = replace(ELSEWHERE, collision=(ExpensiveBoxes.name,))

    def test_studies(self, elsewhere):
        """The optimum is proved before, by checks elsewhere."""
        plan, job = plan_study(lid_task(), "exact", setup=self.setup, runs=2)
        result = do_study(plan, job, jobs=2)
        assert [None, None] == [record.error for record in result.records]
        assert ["checks", "the runs", "the runs"] == purposes(elsewhere)

    def test_comparisons(self, elsewhere):
        """Rows as they are in turn."""
        problem = load_problem(BOARD)
        here = compare_solvers(problem, SOLVERS, replace(self.setup, executor=ExecutorChoice()))
        there = compare_solvers(problem, SOLVERS, self.setup, jobs=2)
        assert [row.checks for row in here] == [row.checks for row in there]
        assert ["optimal", "optimal"] == [row.status for row in there]
        assert ["the comparison"] * 2 == purposes(elsewhere)

    def test_trainings(self, elsewhere, learner, tmp_path):
        """The optimum is proved afterwards, by checks elsewhere."""
        problem = load_problem(BOARD)
        plan = plan_training(problem, learner, self.setup, runs=2, steps=100)
        with TrainingFolder(str(tmp_path / "run"), plan, problem) as folder:
            result = Trainer(folder.plan, folder, jobs=2).train()
        assert [] == result.failed
        assert ["the training", "the training", "checks"] == purposes(elsewhere)


def test_a_lost_machine_is_told_from_a_process_that_failed():
    """By words, as there is no exit code."""
    lost = Ended(None, started=True, cause="the loss of node 7")
    assert (True, "the loss of node 7") == (lost.killed, lost.how)
    assert "the loss of its machine" == Ended(None, started=False).how
