"""Plans of trainings: which runs learn side by side."""

import pytest

from skillplan.checks import DiskVerdictCache, VerdictCache
from skillplan.pipeline import Setup, load_problem
from skillplan.records import RunFolder
from skillplan.sweep import StudyJob
from skillplan.training import (
    GROUP_RUNS,
    GroupJob,
    make_even_groups,
    make_group_cache,
    training_plan,
)
from training_situations import BOARD, a_plan, learned_bytes, train

pytestmark = pytest.mark.usefixtures("learner")


@pytest.mark.parametrize(
    ("runs", "groups"),
    [
        (1, ((0,),)),
        (2, ((0,), (1,))),
        (3, ((0, 1), (2,))),
        (5, ((0, 1, 2), (3, 4))),
        (7, ((0, 1, 2, 3), (4, 5, 6))),
        (10, ((0, 1, 2, 3, 4), (5, 6, 7, 8, 9))),
        (11, ((0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10))),
    ],
)
def test_runs_are_shared_out_evenly_among_two_groups_or_more(runs, groups):
    assert groups == make_even_groups(runs)
    assert groups == a_plan(load_problem(BOARD), runs=runs).groups


@pytest.mark.parametrize("runs", range(2, 65))
def test_two_processes_are_filled_and_no_group_is_larger_than_others(runs):
    """Every run is in one group; sizes differ by one at most."""
    groups = make_even_groups(runs)
    sizes = [len(group) for group in groups]
    assert list(range(runs)) == [run for group in groups for run in group]
    assert len(groups) >= 2
    assert max(sizes) <= GROUP_RUNS
    assert max(sizes) - min(sizes) <= 1


def test_a_training_goes_on_in_the_groups_that_it_was_begun_with(tmp_path, monkeypatch):
    """Its checkpoints are theirs; what is learned is the same."""
    more = {"runs": 3, "steps": 200, "checkpoint_steps": 100}
    train(tmp_path / "whole", **more)
    with monkeypatch.context() as patch:
        patch.setattr(training_plan, "LEAST_GROUPS", 1)
        stopped = train(tmp_path / "a", stop_after=1, **more)
    assert stopped.interrupted
    assert not train(tmp_path / "a", resume=True, **more).interrupted
    run_folder = RunFolder(tmp_path / "a")
    assert ((0, 1, 2),) == run_folder.manifest.groups
    assert ((0, 1), (2,)) == RunFolder(tmp_path / "whole").manifest.groups
    assert not (tmp_path / "a" / "groups" / "1").exists()
    whole, gone_on = (
        {name: content for name, content in learned_bytes(folder).items() if "groups/" not in name}
        for folder in (tmp_path / "whole", tmp_path / "a")
    )
    assert whole == gone_on


@pytest.mark.parametrize(("shared", "kind"), [(True, DiskVerdictCache), (False, VerdictCache)])
def test_only_where_files_are_those_of_the_head_verdicts_are_kept_on_disk(
    monkeypatch, tmp_path, shared, kind
):
    """Of warm trainings and studies alike: another machine keeps them in memory."""
    for module in ("skillplan.training.groups", "skillplan.sweep.study_runs"):
        monkeypatch.setattr(f"{module}.shares_files", lambda: shared)
    task = load_problem(BOARD).task
    job = GroupJob(a_plan(load_problem(BOARD), warm=True), tmp_path, 0)
    study = StudyJob({"start": task}, "exact", Setup(), warm=True)
    assert [kind, kind] == [type(make_group_cache(job)), type(study.cache())]
