"""Trainings whose groups are driven where the folder is not: everything comes back to it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any, ClassVar

import pytest

from same_process import SameProcess, SameProcessWorker
from skillplan.pipeline import registry
from skillplan.records import RunFolder
from skillplan.training import FileChange, apply_changes
from skillplan.workers import Answer, Ended, ExecutorChoice, Prepare
from thinned import slow_case
from training_situations import counts, event_lengths, learned_bytes, train

pytestmark = pytest.mark.usefixtures("learner", "elsewhere")

ELSEWHERE = ExecutorChoice("elsewhere")


class OnAnotherMachine(SameProcess):
    """Its workers do not share the files of this machine, and some are lost."""

    name = "elsewhere"
    shares_files = False
    lost_after: ClassVar[list[int]] = []

    def start(self, prepare: Prepare, content: bytes, what: str) -> SameProcessWorker:
        worker = super().start(prepare, content, what)
        if not self.lost_after:
            return worker
        return Lost(what, worker.work, self.lost_after.pop(0))


class Lost(SameProcessWorker):
    """Its machine is lost after so many answers."""

    def __init__(self, what: str, work: Callable[[Any], Any], answers: int) -> None:
        super().__init__(what, work)
        self.answers = answers

    def answer(self) -> Answer:
        if self.answers == 0:
            return Ended(None, started=True, cause="the loss of its machine")  # type: ignore[return-value]
        self.answers -= 1
        return super().answer()


@pytest.fixture
def elsewhere(monkeypatch):
    """Registered from outside."""
    known = registry.load
    chosen = OnAnotherMachine
    monkeypatch.setattr(
        registry, "load", lambda kind, name: chosen if name == chosen.name else known(kind, name)
    )
    monkeypatch.setattr(chosen, "lost_after", [])


@pytest.fixture(scope="module")
def kept(learner, tmp_path_factory):
    """The folder of a training of this process."""
    folder = tmp_path_factory.mktemp("kept") / "whole"
    train(folder)
    return folder


@pytest.mark.slow(reason="two trainings; one that is lost goes on in every run")
def test_what_is_learned_elsewhere_is_the_same_file_by_file(kept, tmp_path):
    """Policies, metrics and checkpoints; events up to the time of day."""
    train(tmp_path / "sent", jobs=2, executor=ELSEWHERE)
    assert learned_bytes(kept) == learned_bytes(tmp_path / "sent")
    assert event_lengths(kept) == event_lengths(tmp_path / "sent")


def test_what_is_counted_elsewhere_is_what_is_counted_here(kept, tmp_path):
    """Of every group: checks, executions and how often each back end was asked."""
    train(tmp_path / "sent", jobs=2, executor=ELSEWHERE)
    assert counts(kept) == counts(tmp_path / "sent")
    assert all(count["checks"] > 0 for count in counts(kept))


@pytest.mark.slow(reason="two trainings; one that is lost goes on in every run")
def test_a_training_that_was_stopped_goes_on_elsewhere(kept, tmp_path):
    """And what was begun elsewhere goes on here: the folder is the same."""
    train(tmp_path / "sent", executor=ELSEWHERE, stop_after=3)
    shutil.copytree(tmp_path / "sent", tmp_path / "here")
    train(tmp_path / "here", resume=True)
    train(tmp_path / "sent", executor=ELSEWHERE, resume=True)
    for folder in (tmp_path / "sent", tmp_path / "here"):
        assert learned_bytes(kept) == learned_bytes(folder)
        assert event_lengths(kept) == event_lengths(folder)


def test_after_a_stop_no_worker_is_started(tmp_path, monkeypatch):
    """A group that had begun before, and has none, hands over here what it has learned."""
    train(tmp_path / "a", stop_after=5)
    started: list[str] = []
    start = OnAnotherMachine.start

    def noted(self: OnAnotherMachine, *words: Any) -> SameProcessWorker:
        started.append(words[2])
        return start(self, *words)

    monkeypatch.setattr(OnAnotherMachine, "start", noted)
    result = train(tmp_path / "a", executor=ELSEWHERE, resume=True, stop_after=1)
    assert ["the training"] == started
    assert result.interrupted
    assert all(outcome.last is not None for outcome in result.outcomes)
    steps = [run.steps for run in RunFolder(tmp_path / "a").runs()]
    assert [400] * 4 + [100] * 3 == steps


# What is lost closes no files.
lossy = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@lossy
@pytest.mark.parametrize(
    "answers",
    [
        slow_case(0, reason="trains twice; lost later in every run"),
        1,
        slow_case(3, reason="trains twice; lost earlier in every run"),
    ],
)
def test_a_training_whose_machine_is_lost_goes_on_from_its_checkpoint(
    kept, tmp_path, monkeypatch, answers
):
    """On another machine, from what has come back until then."""
    monkeypatch.setattr(OnAnotherMachine, "lost_after", [answers])
    result = train(tmp_path / "sent", executor=ELSEWHERE)
    assert [] == result.failed
    assert learned_bytes(kept) == learned_bytes(tmp_path / "sent")
    assert event_lengths(kept) == event_lengths(tmp_path / "sent")


@pytest.mark.slow(reason="trains in processes; the first loss in every run")
@lossy
def test_a_second_loss_costs_the_runs_of_the_group(tmp_path, monkeypatch):
    """The other group has learned."""
    monkeypatch.setattr(OnAnotherMachine, "lost_after", [1, 0])
    result = train(tmp_path / "sent", executor=ELSEWHERE)
    assert [0, 1, 2, 3] == [failure.run for failure in result.failed]
    assert "its process was ended twice, by the loss of its machine" == result.failed[0].reason


def test_what_has_grown_is_put_at_the_end_and_what_was_replaced_in_its_place(tmp_path):
    """A piece that was written before is written over."""
    (tmp_path / "log").write_bytes(b"one, tw")
    apply_changes(tmp_path, [FileChange("log", 5, b"two"), FileChange("sub/whole", None, b"all")])
    assert b"one, two" == (tmp_path / "log").read_bytes()
    assert b"all" == (tmp_path / "sub" / "whole").read_bytes()
