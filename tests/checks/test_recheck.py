"""Kept verdicts checked again."""

import shutil

import pytest

from expensive_back_ends import ExpensiveEngine
from situations import fake_back_end
from skillplan.checks import DiskVerdictCache, Feasibility, VerdictFolder, draw_kept, recheck_kept
from skillplan.errors import BackEndError
from skillplan.model import enumerate_feasibility
from skillplan.task import Verdict
from skillplan.testing import lid_task
from thinned import slow_case

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
