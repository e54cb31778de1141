"""Settings chosen by Optuna, by one process or by many, and what becomes of them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, ClassVar

import pytest

from same_process import studies_in_this_process
from skillplan import sweep
from skillplan.errors import OptionError
from skillplan.pipeline import load_problem
from skillplan.records import Span, SweepRecord
from skillplan.testing import SamplerSuite

CASES = Path(__file__).parents[3] / "configs" / "swarmitfix_cases.yaml"
PATIENCE_S = 60
WORDS = (
    *("sweep", str(CASES), "--solver", "sarsa", "--sampler", "optuna", "--starts", "C20"),
    *("-O", "episodes=50:300", "-O", "alpha=0.01:1:log", "--runs", "2"),
)


@pytest.fixture
def in_this_process():
    """Runs of studies take no processes."""
    with studies_in_this_process():
        yield


class TestOptunaSampler(SamplerSuite):
    sampler: ClassVar[str] = "optuna"


class TestRandomSampler(SamplerSuite):
    sampler: ClassVar[str] = "optuna"
    options: ClassVar = {"method": "random"}


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "skillplan", *WORDS, *words]


def document(*words: str) -> Any:
    created = subprocess.run(
        command(*words, "--format", "json"), capture_output=True, text=True, check=False
    )
    assert created.returncode == 0, created.stderr
    assert created.stderr == ""
    return json.loads(created.stdout)


def test_it_finds_what_is_good(tmp_path):
    """The least of a bowl within 0.15 of 4 after 60 trials, where even spacing has 0.17."""
    question = sweep.Question((Span("x", 0.0, 10.0), Span("y", 0.0, 10.0)), {}, {}, seed=1)
    trials = sweep.make_sampler("optuna", {}).join(tmp_path, question)
    for _ in range(60):
        trial = trials.ask()
        x, y = float(trial.values["x"] or 0), float(trial.values["y"] or 0)
        trials.tell(trial, (x - 3) ** 2 + (y - 7) ** 2, [])
    best = min(trials.finished(), key=lambda first: first.value or 0.0)
    assert best.value is not None
    assert best.value < 0.5


def test_one_process_repeats_itself(tmp_path):
    """As long as trials end in the order in which they began."""
    results = []
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        question = sweep.Question((Span("x", 0.0, 1.0),), {}, {}, seed=3)
        trials = sweep.make_sampler("optuna", {"startup": 2}).join(tmp_path / name, question)
        for _ in range(6):
            trial = trials.ask()
            trials.tell(trial, float(trial.values["x"] or 0), [])
        results.append([item.trial.values for item in trials.finished()])
    assert results[0] == results[1]


def joined(folder: Path) -> sweep.SharedTrials:
    return sweep.make_sampler("optuna", {}).join(
        folder, sweep.Question((Span("x", 0.0, 1.0),), {}, {}, seed=3)
    )


def test_a_line_that_was_cut_off_is_dropped(tmp_path):
    """And the trials before it are kept."""
    trials = joined(tmp_path)
    trials.tell(trials.ask(), 1.0, ["kept"])
    path = tmp_path / "trials.jsonl"
    with path.open("ab") as file:
        file.write(b'{"op_code": 4, "tri')
    again = joined(tmp_path)
    assert [item.lines for item in again.finished()] == [("kept",)]
    again.tell(again.ask(), 2.0, [])
    assert joined(tmp_path).done() == 2


def test_damage_is_one_message(tmp_path):
    """It names the file, and what instead."""
    trials = joined(tmp_path)
    trials.tell(trials.ask(), 1.0, [])
    path = tmp_path / "trials.jsonl"
    content = path.read_bytes()
    for damage in (b"no journal\n", b"[]\n", b"\xff\xfe\n", b'{"op_code": 77}\n'):
        path.write_bytes(damage + content)
        with pytest.raises(OptionError, match="is damaged") as caught:
            joined(tmp_path).finished()
        assert path.name in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.slow(reason="starts processes; two trials of one journal in every run")
def test_processes_share_a_study_and_each_shows_all_of_it(tmp_path):
    """Twelve trials by two processes, at most one more than asked for, and none twice."""
    study = str(tmp_path / "study")
    words = command("--out", study, "--trials", "12", "--format", "json")
    both = [subprocess.Popen(words, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
    shown = document("--out", study, "--trials", "12")
    numbers = [setting["trial"] for setting in shown["settings"]]
    assert 12 <= len(numbers) <= 13
    assert len(set(numbers)) == len(numbers)
    assert shown == json.loads((tmp_path / "study" / "sweep.json").read_text("utf-8"))
    journal = (tmp_path / "study" / "trials.jsonl").read_text("utf-8")
    assert len({json.loads(line)["worker_id"] for line in journal.splitlines()}) >= 2


@pytest.mark.slow(reason="starts processes; Ctrl-C of studies and cut journals in every run")
@pytest.mark.parametrize("blow", [signal.SIGINT, signal.SIGKILL])
def test_whatever_ends_it_finished_trials_are_kept(tmp_path, blow):
    study = tmp_path / "study"
    words = command("--out", str(study), "--trials", "5000", "--format", "json")
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        end_s = time.monotonic() + PATIENCE_S
        journal = study / "trials.jsonl"
        while time.monotonic() < end_s:
            if journal.exists() and journal.read_bytes().count(b'"lines"') >= 3:
                break
            time.sleep(0.05)
        os.kill(process.pid, blow)
        printed, _ = process.communicate(timeout=PATIENCE_S)
    if blow is signal.SIGINT:
        assert process.returncode == 130
        shown = json.loads(printed)
        assert shown["interrupted"]
        assert len(shown["settings"]) >= 3
    there = journal.read_bytes().count(b'"lines"')
    shown = document("--out", str(study), "--trials", str(there + 2))
    assert len(shown["settings"]) == there + 2
    assert not shown["interrupted"]


@pytest.fixture(scope="module")
def study():
    task = load_problem(CASES).part("base-1")
    values = [("episodes", "50:300"), ("gamma", "0.9:0.99")]
    return sweep.plan_sampled(task, "sarsa", values, sampler="optuna", starts=["C20"], runs=2)


@pytest.fixture(scope="module")
def tried(study, tmp_path_factory):
    """A folder with one trial of the study; to be copied by who changes it."""
    folder = tmp_path_factory.mktemp("tried")
    with studies_in_this_process():
        sweep.do_sampled(
            *study, sweep.open_trials(str(folder), study[0], sweep.make_sampler("optuna", {}), 0), 1
        )
    return folder


def test_another_study_is_refused_and_what_differs_is_named(study, tried):
    plan, job = study
    sampler = sweep.make_sampler("optuna", {})
    task = next(iter(job.tasks.values()))
    other, _ = sweep.plan_sampled(
        task, "sarsa", [("episodes", "50:400"), ("gamma", "0.9:0.99")], sampler="optuna", runs=2
    )
    with pytest.raises(OptionError, match=r"in the ranges of the options: 300 there, 400 now"):
        sweep.open_trials(str(tried), other, sampler, 0)
    with pytest.raises(OptionError, match=r"in the options of the sampler: \"tpe\" there"):
        sweep.open_trials(str(tried), plan, sweep.make_sampler("optuna", {"method": "random"}), 0)


@pytest.mark.usefixtures("in_this_process")
def test_trials_with_failed_runs_are_done_again(study, tried, tmp_path):
    """Also those of which only some runs failed; the study ends with as many trials as before."""
    plan, job = study
    sampler = sweep.make_sampler("optuna", {})
    folder = str(shutil.copytree(tried, tmp_path / "study"))
    trials = sweep.open_trials(folder, plan, sampler, 0)
    arrived = trials.finished()[0].lines[0]
    failed = [SweepRecord(0, seed, error="out of memory").line() for seed in plan.seeds]
    settings = []
    for lines, value in ((failed, None), ([arrived, failed[1]], 5e8)):
        trial = trials.ask()
        settings.append(trial.values)
        trials.tell(trial, value, lines)
    again = sweep.open_trials(folder, plan, sampler, 0)
    assert again.done() == 1
    result = sweep.do_sampled(plan, job, again, 3)
    assert result.failed == []
    assert all(values in result.plan.settings for values in settings)


def test_a_folder_of_something_else_is_left_alone(study, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OptionError, match=r"is not empty, and holds no trials of optuna"):
        sweep.open_trials(str(tmp_path), study[0], sweep.make_sampler("optuna", {}), 0)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.usefixtures("in_this_process")
def test_runs_in_the_journal_that_are_none_are_refused(study, tried, tmp_path):
    plan, job = study
    sampler = sweep.make_sampler("optuna", {})
    folder = shutil.copytree(tried, tmp_path / "study")
    path = folder / sampler.keeps
    whole = path.read_text("utf-8")
    assert '\\"seed\\": 1' in whole
    for was, then in (
        ('\\"seed\\": 1', '\\"seed\\": 7'),
        ('\\"status\\"', '\\"state\\"'),
        ('"values":{"', '"values":{"no_'),
    ):
        path.write_text(whole.replace(was, then), "utf-8")
        with pytest.raises(OptionError, match="damaged"):
            sweep.do_sampled(plan, job, sweep.open_trials(str(folder), plan, sampler, 0), 1)
