"""Trainings: what they keep, and that nothing that happens to them changes what is learned."""

from __future__ import annotations

import json
import os
import shutil
import time
from dataclasses import replace
from typing import Any

import pytest

from skillplan.collision import PrecedenceDetector
from skillplan.errors import OptionError, PluginError
from skillplan.pipeline import Setup, load_problem
from skillplan.plugins import Interrupted
from skillplan.records import RunFolder, RunStatus
from skillplan.training import GroupTraining, TrainingFolder, plan_training
from thinned import slow_case, thinned
from training_situations import BOARD, a_plan, counts, event_lengths, learned_bytes, train

pytestmark = pytest.mark.usefixtures("learner")


@pytest.fixture(scope="module")
def kept(learner, tmp_path_factory):
    """The folder of a training that nothing happened to, for all tests."""
    folder = tmp_path_factory.mktemp("kept") / "whole"
    train(folder)
    return folder


@pytest.fixture
def whole(kept, tmp_path):
    """The same, to be changed freely."""
    shutil.copytree(kept, tmp_path / "whole")
    return tmp_path / "whole"


class TestWhatIsKept:
    def test_every_run_has_its_files(self, whole):
        folder = RunFolder(whole)
        assert ((0, 1, 2, 3), (4, 5, 6)) == folder.manifest.groups
        assert tuple(range(7)) == folder.manifest.seeds
        for run in folder.runs():
            assert ("", 400) == (run.failure, run.steps)
            assert run.policy is not None
            assert run.last is not None
            assert (400, "last") == (run.last.content.step, run.last.kept)
            assert list(range(100, 401, 100)) == [figure.step for figure in run.figures]
            assert run.episodes[-1].step <= 400
            assert all(set(item.figures) == {"states"} for item in run.figures)

    def test_the_result_is_that_of_the_files(self, tmp_path):
        result = train(tmp_path / "a", runs=3)
        folder = RunFolder(tmp_path / "a")
        assert json.loads(json.dumps(result.document())) == folder.result()
        assert not result.interrupted
        assert 1.86709 == pytest.approx(result.optimum.cost, abs=1e-5)
        for outcome, run in zip(result.outcomes, folder.runs(), strict=True):
            assert outcome.training is not None
            assert len(run.episodes) == outcome.training.every.episodes
            assert (outcome.best is None) == (run.best is None)

    def test_all_metrics_stand_in_one_file_with_their_run(self, whole):
        lines = [json.loads(line) for line in (whole / "metrics.jsonl").read_text().splitlines()]
        assert sorted(element["run"] for element in lines) == [entry["run"] for entry in lines]
        first = [
            {k: v for k, v in item.items() if k != "run"} for item in lines if item["run"] == 0
        ]
        own = (whole / "runs" / "00" / "metrics.jsonl").read_text().splitlines()
        assert [json.loads(line) for line in own] == first

    def test_the_option_steps_is_the_number_of_steps_wherever_it_stands(self, tmp_path):
        problem = load_problem(BOARD)
        for options, steps, expected in (
            ({}, None, 5_000),
            ({"steps": None}, None, 5_000),
            ({"steps": 300}, None, 300),
            ({"steps": 300}, 500, 500),
            ({"steps": "300"}, None, 300),
        ):
            plan = a_plan(problem, options, steps=steps)
            assert (expected, expected) == (plan.steps, plan.options["steps"])

    def test_the_task_is_kept_as_it_was(self, whole):
        assert BOARD.read_bytes() == (whole / "task.yaml").read_bytes()
        folder = RunFolder(whole)
        assert load_problem(BOARD).sha256 == folder.manifest.task.sha256
        assert "inverter-board" == folder.config["name"]
        assert str(BOARD) == folder.source

    def test_a_run_learns_the_same_alone(self, whole, tmp_path):
        train(tmp_path / "alone", runs=1, seed=3)
        first, other = (
            (folder / "runs" / run / "metrics.jsonl").read_bytes()
            for folder, run in ((whole, "03"), (tmp_path / "alone", "00"))
        )
        assert first == other


class TestWhatHappens:
    @pytest.mark.slow(reason="two processes; one process in every run, and searches in several")
    def test_processes_change_nothing(self, whole, tmp_path):
        train(tmp_path / "two", jobs=2)
        assert learned_bytes(whole) == learned_bytes(tmp_path / "two")
        assert counts(whole) == counts(tmp_path / "two")

    @pytest.mark.slow(reason="another training; every run stops and goes on with one")
    def test_how_often_a_checkpoint_is_kept_changes_nothing(self, whole, tmp_path):
        train(tmp_path / "rare", checkpoint_steps=10_000)
        assert learned_bytes(whole) == learned_bytes(tmp_path / "rare")

    @pytest.mark.parametrize(
        ("jobs", "reports"),
        [
            slow_case(1, 1, reason="two others in every run"),
            (1, 3),
            slow_case(1, 6, reason="another stop in every run"),
            slow_case(1, 7, reason="two others in every run"),
            slow_case(2, 5, reason="two processes; one in every run"),
        ],
    )
    def test_a_stop_between_two_strides_changes_nothing(self, whole, tmp_path, jobs, reports):
        stopped = train(tmp_path / "a", jobs=jobs, stop_after=reports)
        assert stopped.interrupted
        started = [run for run in RunFolder(tmp_path / "a").runs() if run.policy is not None]
        assert started
        assert all(
            item.steps == item.last.content.step for item in started if item.last is not None
        )
        gone_on = train(tmp_path / "a", jobs=jobs, resume=True)
        assert not gone_on.interrupted
        assert learned_bytes(whole) == learned_bytes(tmp_path / "a")
        assert event_lengths(whole) == event_lengths(tmp_path / "a")

    @pytest.mark.parametrize(
        "nth",
        [
            pytest.param(nth, marks=[pytest.mark.slow(reason="one of them in every run")])
            if nth != 29
            else nth
            for nth in range(1, 60, 7)
        ],
    )
    def test_an_end_at_any_write_changes_nothing(self, whole, tmp_path, monkeypatch, nth):
        """As SIGKILL ends it: before something is forced to disk, or before it is renamed."""

        class Ended(Interrupted):
            """What a plugin made up would be its own failure, and end nothing."""

        counted = 0

        def counting(call: Any) -> Any:
            def do(*args: Any) -> Any:
                nonlocal counted
                counted += 1
                if counted == nth:
                    raise Ended
                return call(*args)

            return do

        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", counting(os.fsync))
            patch.setattr(os, "replace", counting(os.replace))
            with pytest.raises(Ended):
                train(tmp_path / "a")
        train(tmp_path / "a", resume=True)
        assert learned_bytes(whole) == learned_bytes(tmp_path / "a")

    @pytest.mark.slow(reason="waits for a process to be ended; every run ends one")
    @pytest.mark.parametrize(
        "jobs",
        [
            slow_case(1, reason="waits for a stride; every run stops between two strides"),
            slow_case(2, reason="one process in every run"),
        ],
    )
    def test_a_stride_that_takes_too_long_after_a_stop_is_given_up(
        self, tmp_path, monkeypatch, jobs
    ):
        """What the last checkpoint knows counts, and nothing else changes."""
        slow = {"pause_s": 0.004}
        more = {"runs": 1, "steps": 200, "checkpoint_steps": 100}
        train(tmp_path / "whole", slow, **more)
        monkeypatch.setattr("skillplan.training.groups.GRACE_S", 0.05)
        begun_s = time.monotonic()
        stopped = train(tmp_path / "a", slow, jobs=jobs, stop_after=1, delay_s=0.1, **more)
        assert time.monotonic() - begun_s < 30
        assert {100} == {run.steps for run in RunFolder(tmp_path / "a").runs()}
        assert stopped.interrupted
        assert all(outcome.last is not None for outcome in stopped.outcomes)
        train(tmp_path / "a", slow, jobs=jobs, resume=True, **more)
        assert learned_bytes(tmp_path / "whole") == learned_bytes(tmp_path / "a")

    @pytest.mark.slow(reason="trains on several layouts; one layout in every run")
    def test_layouts_of_a_family_are_learned_and_gone_on_with(self, tmp_path):
        """The policies are judged on the file's own layout."""
        more = {"runs": 2, "steps": 400, "family": 3}
        whole = train(tmp_path / "whole", **more)
        assert load_problem(BOARD).sha256 == whole.task.sha256
        manifest = RunFolder(tmp_path / "whole").manifest
        assert manifest.family is not None
        assert (3, 0) == (manifest.family.count, manifest.family.seed)
        train(tmp_path / "a", stop_after=3, **more)
        train(tmp_path / "a", resume=True, **more)
        assert learned_bytes(tmp_path / "whole") == learned_bytes(tmp_path / "a")
        train(tmp_path / "own", runs=2, steps=400)
        own, other = (
            (tmp_path / name / "runs" / "00" / "metrics.jsonl").read_bytes()
            for name in ("own", "whole")
        )
        assert own != other

    @pytest.mark.slow(reason="goes on with a training; every run goes on with one that was stopped")
    def test_pieces_of_lines_beyond_the_checkpoint_are_cut_off(self, whole, tmp_path):
        train(tmp_path / "a", stop_after=3)
        for path in (tmp_path / "a").rglob("*.tfevents.*"):
            path.write_bytes(path.read_bytes() + b"\x07piece")
        for path in (tmp_path / "a" / "runs").rglob("metrics.jsonl"):
            path.write_bytes(path.read_bytes() + b'{"kind":"episode","st')
        train(tmp_path / "a", resume=True)
        assert learned_bytes(whole) == learned_bytes(tmp_path / "a")
        assert event_lengths(whole) == event_lengths(tmp_path / "a")

    def test_what_is_done_is_not_done_again(self, whole, monkeypatch):
        before, effort = learned_bytes(whole), RunFolder(whole).progress(0)

        def never(*_: object) -> None:
            raise AssertionError("it did another stride")

        monkeypatch.setattr(GroupTraining, "_keep", never)
        result = train(whole, resume=True)
        assert 7 * 400 == sum(
            outcome.training.steps for outcome in result.outcomes if outcome.training
        )
        assert before == learned_bytes(whole)
        assert effort == RunFolder(whole).progress(0)


class TestFailures:
    def test_a_run_that_cannot_go_on_is_named_and_the_others_do(self, whole, tmp_path):
        result = train(tmp_path / "a", {"fails": "1@250"})
        # In either group there is a run of this number.
        assert [1, 5] == [failure.run for failure in result.failed]
        assert "its values are not finite" == result.outcomes[1].reason
        for run in ("00", "02", "06"):
            first, other = (
                folder / "runs" / run / "metrics.jsonl" for folder in (whole, tmp_path / "a")
            )
            assert first.read_bytes() == other.read_bytes()
        assert not result.interrupted

    @pytest.mark.parametrize(
        "jobs",
        [
            slow_case(1, reason="a group that raises; a run that cannot go on in every run"),
            slow_case(2, reason="one process in every run"),
        ],
    )
    def test_a_group_that_raises_does_not_take_the_others_along(self, whole, tmp_path, jobs):
        result = train(tmp_path / "a", {"raises": "5@350"}, jobs=jobs)
        assert [4, 5, 6] == [item.run for item in result.failed]
        (reason,) = {failure.reason for failure in result.failed}
        assert reason.startswith("The solver 'tabular' failed: RuntimeError: no memory left (")
        assert "tabular_learner.py:" in reason
        assert RunStatus.FAILED is result.outcomes[6].status
        stored = RunFolder(tmp_path / "a")
        assert (200, reason) == (stored.run(5).steps, stored.run(5).failure)
        assert learned_bytes(whole, lambda name: name == "last.safetensors").items() >= {
            (name, content)
            for name, content in learned_bytes(
                tmp_path / "a", lambda name: name == "last.safetensors"
            ).items()
        }
        again = train(tmp_path / "a", {"raises": "5@350"}, jobs=jobs, resume=True)
        assert [4, 5, 6] == [entry.run for entry in again.failed]

    @pytest.mark.slow(reason="starts three processes; killed processes of checks are in every run")
    def test_a_process_that_is_killed_twice_costs_its_runs_only(self, tmp_path):
        result = train(tmp_path / "a", {"dies": "5@350"}, jobs=2)
        assert [4, 5, 6] == [failure.run for failure in result.failed]
        assert "its process was ended twice, by signal 9" == result.failed[0].reason
        assert 400 == RunFolder(tmp_path / "a").run(0).steps

    @pytest.mark.slow(reason="killed twice in every run")
    def test_a_process_that_is_killed_once_is_started_again(self, whole, tmp_path, monkeypatch):
        """The first start dies; by the second, the cause has gone."""
        cause = tmp_path / "cause"
        cause.touch()
        monkeypatch.setenv("TABULAR_DIES_WHILE", str(cause))
        result = train(tmp_path / "a", jobs=2)
        assert not cause.exists()
        assert [] == result.failed
        assert learned_bytes(whole) == learned_bytes(tmp_path / "a")


class TestFolders:
    def test_a_second_training_is_kept_out(self, whole):
        problem = load_problem(BOARD)
        plan = a_plan(problem)
        with (
            TrainingFolder(str(whole), plan, problem, resume=True),
            pytest.raises(OptionError, match="another training is writing there just now"),
        ):
            TrainingFolder(str(whole), plan, problem, resume=True)
        TrainingFolder(str(whole), plan, problem, resume=True).close()

    def test_a_folder_with_anything_in_it_is_not_begun_in(self, tmp_path):
        (tmp_path / "letter.txt").write_text("expensive")
        with pytest.raises(OptionError, match=r"is not empty. Name a new folder, or go on"):
            train(tmp_path)
        with pytest.raises(OptionError, match=r"holds no manifest.json, so nothing to resume"):
            train(tmp_path, resume=True)

    @pytest.mark.parametrize(
        ("more", "message"),
        thinned(
            [
                ({"runs": 8}, "in the runs: 7 from seed 0 there, 8 from seed 0 now"),
                ({"seed": 2}, "in the runs: 7 from seed 0 there, 7 from seed 2 now"),
                ({"steps": 300}, "in the solver's options: steps: 400 there, 300 now"),
                (
                    {"steps": 800, "options": {"schedule_steps": 300}},
                    "schedule_steps: 400 there, 300",
                ),
                ({"options": {"alpha": 0.1}}, "in the solver's options: alpha: 0.5 there, 0.1 now"),
            ],
            ({"runs": 8}, "in the runs: 7 from seed 0 there, 8 from seed 0 now"),
            ({"steps": 800, "options": {"schedule_steps": 300}}, "schedule_steps: 400 there, 300"),
        ),
    )
    def test_another_training_is_refused_by_what_differs(self, whole, more, message):
        before = learned_bytes(whole)
        with pytest.raises(OptionError) as caught:
            train(whole, resume=True, **more)
        assert message in str(caught.value)
        assert before == learned_bytes(whole)

    def test_a_training_that_is_extended_is_the_one_that_was_asked_for_in_whole(self, tmp_path):
        """To the byte, though cut off before; all steps are in its result, and in its manifest."""
        lasting = {"schedule_steps": 300}
        train(tmp_path / "whole", lasting, steps=600)
        train(tmp_path / "grown", lasting, steps=400, stop_after=3)
        result = train(tmp_path / "grown", lasting, steps=600, resume=True)
        assert learned_bytes(tmp_path / "whole") == learned_bytes(tmp_path / "grown")
        assert (600, False) == (result.steps, result.interrupted)
        manifests = [RunFolder(tmp_path / name).manifest for name in ("whole", "grown")]
        assert manifests[0] == manifests[1].model_copy(update={"command": manifests[0].command})

    def test_a_training_of_which_nobody_thought_it_would_be_extended_is_so_too(self, tmp_path):
        """Cut off, and done: as if its schedules had been asked for over its first steps."""
        train(tmp_path / "whole", {"schedule_steps": 300}, steps=600)
        train(tmp_path / "grown", {}, steps=300, stop_after=2)
        train(tmp_path / "grown", {}, steps=400, resume=True)
        result = train(tmp_path / "grown", {}, steps=600, resume=True)
        assert learned_bytes(tmp_path / "whole") == learned_bytes(tmp_path / "grown")
        assert (600, 300) == (result.steps, result.options["schedule_steps"])
        manifests = [RunFolder(tmp_path / name).manifest for name in ("whole", "grown")]
        assert manifests[0] == manifests[1].model_copy(update={"command": manifests[0].command})

    def test_more_steps_that_nobody_asked_for_are_not_done(self, tmp_path):
        """The learner's default of steps extends nothing."""
        train(tmp_path / "a", {}, steps=200)
        problem = load_problem(BOARD)
        plan = replace(a_plan(problem, steps=400), steps_said=False)
        with pytest.raises(OptionError, match=r"is of 200 steps\. Give --steps 200 to go on"):
            TrainingFolder(str(tmp_path / "a"), plan, problem, resume=True)
        assert 200 == RunFolder(tmp_path / "a").manifest.steps

    def test_what_ends_between_two_hundreds_is_not_extended(self, tmp_path):
        train(tmp_path / "a", {"schedule_steps": 300}, steps=250)
        with pytest.raises(OptionError, match="has 250 steps, and only whole hundreds can be"):
            train(tmp_path / "a", {"schedule_steps": 300}, steps=400, resume=True)
        assert 250 == RunFolder(tmp_path / "a").manifest.steps

    def test_another_task_is_refused_by_the_keys_that_changed(self, whole, tmp_path):
        text = BOARD.read_text("utf-8")
        other = BOARD.with_name("other.yaml")
        changed = tmp_path / other.name
        changed.write_text(text.replace("step_limit: 20", "step_limit: 21"), "utf-8")
        (tmp_path / "meshes").symlink_to(BOARD.parent / "meshes")
        with pytest.raises(OptionError, match="in the task: step_limit: 20 there, 21 now"):
            train(whole, resume=True, source=changed)

    def test_a_training_of_another_version_is_refused(self, whole):
        store_version(whole, "0.1.0")
        with pytest.raises(
            OptionError, match=r'in the versions: skillplan: "0.1.0" there, ".*" now'
        ):
            train(whole, resume=True)

    def test_a_training_of_version_0_2_0_is_resumed(self, whole):
        store_version(whole, "0.2.0")
        assert not train(whole, resume=True).interrupted


def store_version(folder, number):
    """Write another version of skillplan into the manifest of a training."""
    manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
    manifest["versions"]["skillplan"] = number
    (folder / "manifest.json").write_text(json.dumps(manifest), "utf-8")


class TestPlans:
    def test_a_solver_that_does_not_learn_is_told_who_does(self):
        with pytest.raises(OptionError, match=r"'sarsa' trains no policies step by step. Learners"):
            plan_training(load_problem(BOARD), "sarsa")
        with pytest.raises(PluginError, match=r"Unknown solver 'tabula'. Did you mean 'tabular'\?"):
            plan_training(load_problem(BOARD), "tabula")

    def test_back_ends_that_were_made_to_read_the_file_are_not_made_again(self, monkeypatch):
        created = []
        begin = PrecedenceDetector.__init__

        def noted(self: PrecedenceDetector, *words: Any, **options: Any) -> None:
            created.append(self)
            begin(self, *words, **options)

        monkeypatch.setattr(PrecedenceDetector, "__init__", noted)
        plan_training(load_problem(BOARD), "tabular")
        assert len(created) == 1

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"alfa": 1}, "has no option 'alfa'. Did you mean 'alpha'"),
            ({"epsilon": 1.5}, "epsilon: must be <= 1"),
            ({"observation": "all"}, "observation: must be"),
            ({"steps": 0}, "steps: must be >= 1"),
        ],
    )
    def test_a_wrong_option_is_one_clear_error(self, options, message):
        with pytest.raises(OptionError) as caught:
            plan_training(load_problem(BOARD), "tabular", Setup(options={"tabular": options}))
        assert message in str(caught.value)


@pytest.mark.slow(reason="four trainings; links out of a folder in test_run_folder.py of every run")
def test_a_training_writes_nothing_through_a_link_out_of_its_folder(tmp_path):
    """A folder of runs that somebody else has sent."""
    train(tmp_path / "kept", steps=200, stop_after=1)
    for name in ("runs", "groups", "tensorboard"):
        folder, outside = tmp_path / f"sent-{name}", tmp_path / f"outside-{name}"
        shutil.copytree(tmp_path / "kept", folder)
        (folder / name).rename(outside)
        (folder / name).symlink_to(outside, target_is_directory=True)
        before = {path: path.read_bytes() for path in outside.rglob("*") if path.is_file()}
        with pytest.raises(OptionError, match="a link leads out of the folder"):
            train(folder, steps=200, resume=True)
        assert before == {path: path.read_bytes() for path in before}
