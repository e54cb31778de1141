"""Conformance suite of executors.

Each worker receives the name of a function in `executor_jobs`, and calls it with the content of its
jobs.
"""

from __future__ import annotations

import os
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any, ClassVar

import pytest
from pydantic import Field

from skillplan.checks.feasibility import Feasibility
from skillplan.collision.aabb import AabbDetector
from skillplan.errors import SkillplanError
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.setup import make_executor
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict
from skillplan.testing.tasks import assert_options_described, lid_task, reachable_states
from skillplan.workers.executor import (
    Answer,
    Ended,
    Executor,
    ExecutorChoice,
    News,
    Worker,
    pack_content,
    set_stop_handler,
    tell,
)
from skillplan.workers.local_processes import LocalProcesses


def here() -> tuple[str, int]:
    """Return machine and process id of this process."""
    return platform.node(), os.getpid()


def prepare(function: str) -> Callable[[Any], Any]:
    """Return the function with a name; called by a worker."""
    return _FUNCTIONS[function]


def _echo(job: Any) -> tuple[Any, tuple[str, int]]:
    return job, here()


def _count(job: int) -> int:
    for number in range(job):
        tell(number)
    return job


def _wait(job: float) -> str:
    event = threading.Event()
    set_stop_handler(event.set)
    tell("listening")
    end_s = time.monotonic() + job
    while not event.is_set() and time.monotonic() < end_s:
        time.sleep(0.01)
    set_stop_handler(None)
    return "asked to stop" if event.is_set() else "heard nothing"


def _busy(job: float) -> None:
    tell(here())
    end_s = time.monotonic() + job
    while time.monotonic() < end_s:
        sum(range(10_000))


def _kill(job: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _refusal(job: None) -> str:
    return LocalProcesses(1).refusal


_FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "echo": _echo,
    "sleep": time.sleep,
    "count": _count,
    "wait": _wait,
    "busy": _busy,
    "exit": os._exit,
    "kill": _kill,
    "refusal": _refusal,
    "any": lambda job: _FUNCTIONS[job[0]](job[1]),
}


_Idle = tuple[Executor, Worker]
_WHAT = "tests"
_PATIENCE_S = 60.0
# Time in which an ended worker is gone [s].
_GONE_S = 2.0


class ExecutorSuite:
    """Requirements on every executor."""

    executor: ClassVar[str]
    address: ClassVar[str] = ""
    options: ClassVar[dict[str, Any]] = {}

    def make(self, slots: int = 2) -> Executor:
        """Return a new executor, as the command line does."""
        return make_executor(ExecutorChoice(self.executor, self.address, self.options), slots)

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry has it under its name, with a summary and described options."""
        plugin = registry.load("executor", self.executor)
        assert plugin.name == self.executor
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()

    def test_there_is_a_slot_at_least(self) -> None:
        """Otherwise nothing would ever be done."""
        with pytest.raises(ValueError, match="at least one process, not 0"):
            self.make(0)

    @pytest.fixture(scope="class")
    @classmethod
    def idle(cls) -> Iterator[_Idle]:
        """Yield an executor and a worker that calls any function; each test leaves it idle."""
        with closing(cls().make()) as executor:
            yield executor, _started(executor, "any")

    def test_jobs_are_done_elsewhere_one_after_another(self, idle: _Idle) -> None:
        """By one process, which is not this one, with content of any size."""
        executor, worker = idle
        jobs = (("echo", "one"), ("echo", b"\0" * 3_000_000))
        first, second = (_done(executor, worker, job) for job in jobs)
        assert first[0] == "one"
        assert len(second[0]) == 3_000_000
        assert first[1] == second[1] != here()
        assert worker.number in (None, first[1][1])
        assert worker.alive

    def test_only_those_are_ready_that_have_answered(self, idle: _Idle) -> None:
        """The other is busy; an empty list returns at once."""
        executor, quick = idle
        assert executor.first_ready([], 600.0) == []
        slow = _started(executor, "sleep")
        slow.take(600)
        quick.take(("echo", "quick"))
        heard: list[Worker] = []
        end_s = time.monotonic() + _PATIENCE_S
        while not heard and time.monotonic() < end_s:
            for worker in executor.first_ready([slow, quick]):
                if worker.answer() is not None:
                    heard.append(worker)
        assert [quick] == heard
        slow.end(gently=False)

    def test_news_come_before_the_answer_in_order(self, idle: _Idle) -> None:
        """All news of code in a worker arrives."""
        executor, worker = idle
        worker.take(("count", 3))
        messages = [_heard(executor, worker) for _ in range(4)]
        assert messages == [News(0), News(1), News(2), Answer(3)]

    def test_a_worker_hears_that_it_shall_stop(self, idle: _Idle) -> None:
        """If its code listens."""
        executor, worker = idle
        worker.take(("wait", 30))
        assert News("listening") == _heard(executor, worker)
        worker.ask_to_stop()
        assert Answer("asked to stop") == _heard(executor, worker)

    def test_what_cannot_make_itself_ready_is_an_error_in_words(self) -> None:
        """The message contains the exception."""
        with closing(self.make(1)) as executor:
            worker = _started(executor, "no such function")
            with pytest.raises(SkillplanError, match="could not make itself ready: KeyError"):
                _heard(executor, worker)

    @pytest.mark.parametrize("job", ["exit", "kill"])
    def test_one_that_breaks_down_says_so_and_harms_no_other(self, job: str, idle: _Idle) -> None:
        """It was ready; a fresh worker replaces it, and the other goes on."""
        executor, other = idle
        worker = _started(executor, job)
        worker.take(7)
        ended = _heard(executor, worker)
        assert isinstance(ended, Ended)
        assert ended.started
        assert ended.how
        assert ended.killed or job == "exit"
        assert not worker.alive
        worker.end()
        assert _done(executor, other, ("echo", "other"))[0] == "other"
        fresh = _started(executor, "echo")
        assert _done(executor, fresh, "again")[0] == "again"
        fresh.end()

    def test_to_end_one_leaves_nothing_and_twice_does_nothing(self) -> None:
        """In any state, so that clean-up code may end it again."""
        with closing(self.make(1)) as executor:
            worker = _started(executor, "busy")
            worker.take(600)
            place = _heard(executor, worker)
            assert isinstance(place, News)
            worker.end(gently=False)
            worker.end()
            assert not worker.alive
            assert _gone(place.content)

    def test_closing_ends_all_and_more_can_be_started(self) -> None:
        """At once, in any state."""
        executor = self.make()
        workers = [_started(executor, "busy") for _ in range(2)]
        for worker in workers:
            worker.take(600)
        places = [_heard(executor, worker) for worker in workers]
        executor.close()
        assert [worker.alive for worker in workers] == [False, False]
        assert all(isinstance(place, News) and _gone(place.content) for place in places)
        with closing(executor):
            assert _done(executor, _started(executor, "echo"), "more")[0] == "more"

    def test_a_worker_starts_no_others(self, idle: _Idle) -> None:
        """With the reason."""
        assert "may not start others" in _done(*idle, ("refusal", None))

    def test_verdicts_and_counts_are_those_of_this_process(self) -> None:
        """Checks of a task by workers, with one slot and with two."""
        task = lid_task()
        states = reachable_states(SkillModel(Feasibility(task)), 20)
        queries = [(k, s) for s in states for k in task.skills if k.applicable(s)]

        def outcome(slots: int) -> tuple[list[Verdict], int, int, int]:
            maker = self.make if slots else None
            checks = Feasibility(
                task, [ExpensiveBoxes(task)], jobs=max(1, slots), make_executor=maker
            )
            with closing(checks):
                verdicts = checks.verdicts(queries)
            return verdicts, checks.checks, checks.hits, checks.executions

        assert outcome(0) == outcome(1) == outcome(2)


class ExpensiveBoxes(AabbDetector):
    """The detector of boxes, marked as expensive."""

    expensive = True

    class Options(AabbDetector.Options):
        """Duration of a check."""

        check_s: float = Field(default=0.0, ge=0, description="so long a check takes at least [s]")

    options: Options

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict of the detector of boxes, after a while."""
        time.sleep(self.options.check_s)
        return super().check(skill, state)


def _started(executor: Executor, function: str) -> Worker:
    return executor.start(prepare, pack_content(function, _WHAT), _WHAT)


def _done(executor: Executor, worker: Worker, job: Any) -> Any:
    """Return the answer of a worker to a job."""
    worker.take(job)
    answer = _heard(executor, worker)
    assert isinstance(answer, Answer)
    return answer.content


def _heard(executor: Executor, worker: Worker) -> Answer | News | Ended:
    """Return the next message of a worker, once it is ready."""
    end_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end_s:
        for ready in executor.first_ready([worker], 1.0):
            answer = ready.answer()
            if answer is not None:
                return answer
    raise AssertionError(f"nothing was heard for {_PATIENCE_S:g} s")


def _gone(place: tuple[str, int]) -> bool:
    """Return whether a process is gone; unknown for other machines."""
    machine, number = place
    if machine != platform.node():
        return True
    end_s = time.monotonic() + _GONE_S
    while time.monotonic() < end_s:
        try:
            os.kill(number, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False
