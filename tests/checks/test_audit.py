"""Detectors that rest on too few facts, or change their mind, are found out after a search."""

from __future__ import annotations

import random
import shutil
from pathlib import Path
from typing import Any

import pytest

from audits import audit
from expensive_back_ends import ExpensiveEngine
from situations import fake_back_end
from skillplan.checks import DiskVerdictCache, Feasibility, VerdictFolder, draw_kept, recheck_kept
from skillplan.collision import Detector
from skillplan.errors import BackEndError
from skillplan.model import enumerate_feasibility
from skillplan.pipeline import load_problem, solve
from skillplan.task import Skill, State, Task, Verdict
from skillplan.testing import lid_task
from thinned import slow_case

BOARD = str(Path(__file__).parents[2] / "configs/inverter_board.yaml")


@pytest.fixture(scope="module")
def task():
    """The inverter board."""
    return load_problem(BOARD).task


class Honest(Detector):
    """Refuses the clock once the brace is placed, and says so."""

    name = "honest"

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict."""
        return self.rule(skill, state, named=True)

    def rule(self, skill: Skill, state: State, *, named: bool) -> Verdict:
        """Return the verdict, with or without the fact that it rests on."""
        nothing = self.task.facts.of()
        brace = self.task.facts.of("placed(brace)")
        if skill.name != "place(clock)":
            return Verdict.feasible(nothing, nothing)
        there = "placed(brace)" in state
        present, absent = (brace, nothing) if there else (nothing, brace)
        if not named:
            present = absent = nothing
        if there:
            return Verdict.infeasible("the brace is in the way", present, absent)
        return Verdict.feasible(present, absent)


class RestsOnTooFew(Honest):
    """Names another fact than the one it looks at."""

    name = "too-few"

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict, resting on the circuit board only."""
        verdict = self.rule(skill, state, named=False)
        board = self.task.facts.of("placed(pcb)")
        nothing = self.task.facts.of()
        here, gone = (board, nothing) if "placed(pcb)" in state else (nothing, board)
        return Verdict(verdict.status, verdict.reason, "", here, gone)


class RestsOnNothing(Honest):
    """Says that its verdict holds everywhere."""

    name = "nothing"

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict without a fact."""
        return self.rule(skill, state, named=False)


class ChangesItsMind(Detector):
    """Answers otherwise the second time."""

    name = "fickle"

    def __init__(self, task: Task, options: Any = None) -> None:
        super().__init__(task, options)
        self.asked: set[tuple[str, State]] = set()

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return that the skill can be executed, once."""
        key = (skill.name, state)
        if key in self.asked:
            return Verdict.infeasible("not again")
        self.asked.add(key)
        return Verdict.feasible()


class Random(Detector):
    """Throws a coin."""

    name = "coin"

    def __init__(self, task: Task, options: Any = None) -> None:
        super().__init__(task, options)
        self.coin = random.Random(1)

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return either."""
        return Verdict.feasible() if self.coin.random() < 0.5 else Verdict.infeasible("tails")


def walked(task: Task, detector: type[Detector]) -> Feasibility:
    """Return checks with which every reachable state was looked at."""
    feasibility = Feasibility(task, [detector(task)])
    enumerate_feasibility(feasibility)
    return feasibility


def found_out(task: Task, detector: type[Detector]) -> str:
    """Return what an audit says of a lying detector."""
    feasibility = walked(task, detector)
    with pytest.raises(BackEndError) as caught:
        audit_often(feasibility, 64)
    return str(caught.value)


def audit_often(feasibility: Feasibility, size: int) -> None:
    """Ask about other samples, too: one may miss the lie."""
    for seed in range(20):
        audit(feasibility, size, seed, expensive=False)


class TestRestingOnTooFewFacts:
    def test_the_fact_is_named_with_the_skill_and_both_states(self, task):
        """The smallest difference that turns the answer."""
        message = found_out(task, RestsOnTooFew)
        assert message.startswith("Back end 'too-few' contradicts itself about place(clock): ")
        assert "feasible in {" in message
        assert "infeasible (the brace is in the way) in {" in message
        assert "placed(brace)" in message.rpartition("should have named")[2]

    def test_resting_on_nothing_is_too_few(self, task):
        """A verdict that claims to hold everywhere."""
        message = found_out(task, RestsOnNothing)
        assert "resting on no fact" in message
        assert "placed(brace)" in message.rpartition("should have named")[2]

    def test_an_honest_detector_passes(self, task):
        """Whatever is drawn."""
        feasibility = walked(task, Honest)
        assert [64] * 5 == [audit(feasibility, 64, seed, expensive=False) for seed in range(5)]


class TestAnsweringDifferently:
    @pytest.mark.parametrize("detector", [ChangesItsMind, Random])
    def test_the_second_answer_in_one_state_is_held_against_the_first(self, task, detector):
        """Though no verdict of theirs is ever reused."""
        feasibility = Feasibility(task, [detector(task)])
        for skill in task.skills:
            if skill.applicable(task.initial):
                feasibility.verdict(skill, task.initial)
        with pytest.raises(BackEndError) as caught:
            audit_often(feasibility, 4)
        assert f"{detector.name!r} answers differently the second time: " in str(caught.value)
        assert "both in {" in str(caught.value)


class TestSampling:
    def test_no_size_asks_nothing(self, task):
        """Even of one who lies."""
        assert 0 == audit(walked(task, RestsOnNothing), 0, 0, expensive=False)

    def test_expensive_back_ends_are_asked_only_when_wanted(self, task, monkeypatch):
        """A handful costs seconds there."""
        monkeypatch.setattr(Honest, "expensive", True)
        feasibility = walked(task, Honest)
        assert 0 == audit(feasibility, 4, 0, expensive=False)
        assert 4 == audit(feasibility, 4, 0, expensive=True)

    def test_the_sample_stays_small_and_covers_the_whole_search(self, task):
        """Early reuses as well as late ones."""
        feasibility = walked(task, Honest)
        rows = feasibility.reused.by_skill()
        assert feasibility.reused.count > 500
        assert max(map(len, rows)) < 8
        assert len({entry.skill.name for row in rows for entry in row}) == len(rows) > 10
        assert len({entry.state for row in rows for entry in row}) > 30


def test_a_search_asks_again_by_itself(task, monkeypatch):
    """With the default sample."""

    class Coin(Random):
        name = "coin"

    def search_often() -> None:
        for seed in range(10):
            coin = Coin(task)
            coin.coin = random.Random(seed)
            solve(task, "exact", seed=seed, back_ends=[coin])

    with pytest.raises(BackEndError, match="answers differently the second time"):
        search_often()


# Kept verdicts checked again.


TASK = lid_task()


def engine():
    return ExpensiveEngine(TASK)


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    """What an engine says of the task, on disk."""
    folder = tmp_path_factory.mktemp("answered")
    enumerate_feasibility(Feasibility(TASK, [engine()], DiskVerdictCache(folder)))
    return folder


@pytest.fixture
def folder(answered, tmp_path):
    """The same, to be changed freely."""
    shutil.copytree(answered, tmp_path, dirs_exist_ok=True)
    return VerdictFolder(tmp_path)


def test_a_sample_depends_on_the_seed_only(folder):
    """Without repetition, in the order of the files; all where there are fewer."""
    kept = folder.kept_for([engine()])
    drawn = draw_kept(kept, 3, seed=4)
    assert drawn == draw_kept(kept, 3, seed=4)
    assert len({pair.path for _, pair in drawn}) == 3
    assert {tuple(item.path for _, item in draw_kept(kept, 3, seed=s)) for s in range(8)} != {
        tuple(entry.path for _, entry in drawn)
    }
    assert [record for _, record in draw_kept(kept, 10_000, seed=0)] == kept[0]


@pytest.mark.parametrize("jobs", [1, slow_case(2, reason="one process in every run")])
def test_sound_verdicts_are_the_same_bit_for_bit(folder, jobs):
    """Of every skill, in one process or several."""
    drawn = draw_kept(folder.kept_for([engine()]), 10_000, seed=0)
    done = []
    trials = recheck_kept(
        Feasibility(TASK, [engine()]), drawn, jobs=jobs, on_trial=lambda: done.append(1)
    )
    assert len(trials) == len(drawn) == len(done) > 3
    assert all(trial.same for trial in trials)


def answering(verdict):
    """Return an engine-like back end under the engine's name that says something else."""
    return fake_back_end(TASK, verdict, name="expensive-engine", expensive=True)


@pytest.mark.parametrize(
    ("change", "differs_in"),
    [
        (lambda v: v, ()),
        (lambda v: Verdict.infeasible("else", v.present, v.absent, v.evidence), "status reason"),
        (lambda v: Verdict.feasible(evidence=v.evidence), "facts"),
        (
            lambda v: Verdict.feasible(v.present, v.absent, {**v.evidence, "luck": 0.5, "n": 1}),
            "evidence: luck|evidence: n",
        ),
        (lambda v: Verdict.feasible(v.present, v.absent), "evidence: facts|evidence: luck"),
    ],
)
def test_a_difference_says_in_what(folder, change, differs_in):
    """In status, reason, facts or an entry of the evidence."""
    kept = folder.kept_for([engine()])
    feasible = [record for record in kept[0] if record.record.status == "feasible"]
    verdict = feasible[0].record.verdict(TASK.facts)
    fresh = Feasibility(TASK, [answering(change(verdict))])
    (trial,) = recheck_kept(fresh, [(0, feasible[0])])
    parts = differs_in if isinstance(differs_in, tuple) else tuple(differs_in.split("|"))
    assert trial.differs_in == (("status", "reason") if parts == ("status reason",) else parts)
    assert trial.same == (not differs_in)


@pytest.mark.parametrize("jobs", [1, slow_case(2, reason="one process in every run")])
def test_a_trial_can_be_ended_early(folder, jobs):
    """What has been tried by then is returned."""
    drawn = draw_kept(folder.kept_for([engine()]), 10_000, seed=0)
    done = []
    trials = recheck_kept(
        Feasibility(TASK, [engine()]),
        drawn,
        jobs=jobs,
        stopped=lambda: len(done) >= 2,
        on_trial=lambda: done.append(1),
    )
    assert 2 <= len(trials) < len(drawn)


@pytest.mark.parametrize("jobs", [1, slow_case(2, reason="one process in every run")])
def test_a_back_end_that_raises_is_named(folder, tmp_path, jobs):
    """It is no difference."""
    log = tmp_path / "log"
    log.mkdir()
    (index, item), *_ = draw_kept(folder.kept_for([engine()]), 1, seed=0)
    options = ExpensiveEngine.Options(log=str(log), fail_on=item.record.skill, how="raise")
    with pytest.raises(BackEndError, match="the simulator has gone away"):
        recheck_kept(
            Feasibility(TASK, [ExpensiveEngine(TASK, options)]), [(index, item)], jobs=jobs
        )
