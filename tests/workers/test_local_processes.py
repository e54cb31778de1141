"""Processes that do jobs: each is given a built-in function, and calls it on its jobs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from skillplan.errors import SkillplanError
from skillplan.workers import (
    Answer,
    Ended,
    FedProgram,
    LocalProcesses,
    Worker,
    pack_content,
    read_output,
)


@pytest.fixture
def executor():
    """Of two slots; what is left of its processes is ended."""
    local_processes = LocalProcesses(2)
    yield local_processes
    local_processes.close()


def started(executor: LocalProcesses, function: Callable[..., Any]) -> Worker:
    """Return a process that calls a function on its jobs."""
    return executor.start(partial, pack_content(function, "tests"), "tests")


def heard(executor: LocalProcesses, worker: Worker) -> Answer | Ended:
    """Return the next thing that a process answers, once it is ready."""
    while True:
        for ready in executor.first_ready([worker], 30.0):
            answer = ready.answer()
            if answer is not None:
                return answer


class TestJobs:
    def test_a_job_is_done_elsewhere(self, executor):
        """One after another, in a process that has another number."""
        worker = started(executor, eval)
        worker.take("__import__('os').getpid()")
        answer = heard(executor, worker)
        assert isinstance(answer, Answer)
        assert worker.number == answer.content != os.getpid()
        worker.take("6 * 7")
        assert Answer(42) == heard(executor, worker)

    def test_only_those_are_ready_that_have_answered(self, executor):
        """The other is still at its job."""
        slow, quick = started(executor, time.sleep), started(executor, len)
        slow.take(600)
        quick.take("four")
        assert Answer(4) == heard(executor, quick)
        quick.take("again")
        answers: list[Answer | Ended] = []
        while not answers:
            for worker in executor.first_ready([slow, quick]):
                answer = worker.answer()
                if answer is not None:
                    assert worker is quick
                    answers.append(answer)
        assert [Answer(5)] == answers

    def test_nothing_is_ready_among_none(self, executor):
        """And nobody waits."""
        assert [] == executor.first_ready([], 600.0)


class TestEnds:
    def test_one_that_exits_says_so_by_its_code(self, executor):
        """It had been ready."""
        worker = started(executor, os._exit)
        worker.take(7)
        ended = heard(executor, worker)
        assert Ended(7, started=True) == ended
        assert ("exit code 7", False) == (ended.how, ended.killed)

    def test_one_that_is_killed_says_so_by_the_signal(self, executor):
        """As where memory runs out."""
        worker = started(executor, time.sleep)
        worker.take(600)
        assert worker.number is not None
        os.kill(worker.number, signal.SIGKILL)
        ended = heard(executor, worker)
        assert isinstance(ended, Ended)
        assert ("signal 9", True) == (ended.how, ended.killed)
        assert not worker.alive

    def test_one_whose_client_is_killed_as_it_starts_prints_nothing(self):
        """Its arguments were cut off once, and Python prints a traceback of that."""
        program = (
            "import os, signal, threading\n"
            "from functools import partial\n"
            "from skillplan.workers import LocalProcesses, pack_content\n"
            "content = pack_content(bytes(10_000_000), 'tests')\n"
            "end = (os.getpid(), signal.SIGKILL)\n"
            "threading.Timer(0.1, os.kill, end).start()\n"
            "LocalProcesses(1).start(partial, content, 'tests')\n"
        )
        ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert -signal.SIGKILL == ended.returncode
        assert "" == ended.stderr

    def test_what_cannot_make_itself_ready_is_an_error_in_words(self, executor):
        """`partial` refuses what cannot be called."""
        worker = executor.start(partial, pack_content("no function", "tests"), "tests")
        with pytest.raises(SkillplanError, match="could not make itself ready: TypeError"):
            heard(executor, worker)

    def test_a_connection_that_its_preparation_lost_is_an_error_in_words(self, executor):
        """It is not taken for the end of the client."""
        words = "raise ConnectionError('the licence server is gone')"
        worker = executor.start(exec, pack_content(words, "tests"), "tests")
        with pytest.raises(SkillplanError, match="ConnectionError: the licence server is gone"):
            heard(executor, worker)

    def test_closing_ends_all_whatever_they_are_at(self):
        """At once, and more can be started afterwards."""
        executor = LocalProcesses(2)
        workers = [started(executor, time.sleep) for _ in range(2)]
        for worker in workers:
            worker.take(600)
        executor.close()
        assert [False, False] == [worker.alive for worker in workers]
        again = started(executor, len)
        again.take("once more")
        assert Answer(9) == heard(executor, again)
        executor.close()

    def test_to_end_one_twice_does_nothing(self, executor):
        """So that whoever cleans up need not know what was ended before."""
        worker = started(executor, len)
        worker.end(gently=False)
        worker.end()
        assert not worker.alive


class TestRefusals:
    def test_there_is_a_slot_at_least(self):
        """Otherwise nothing would ever be done."""
        with pytest.raises(ValueError, match="at least one process, not 0"):
            LocalProcesses(0)

    def test_a_process_for_jobs_starts_no_others(self, executor):
        """It says why; this one may."""
        assert "" == executor.refusal
        worker = started(executor, eval)
        module = "__import__('skillplan.workers.local_processes', fromlist=['_'])"
        worker.take(f"{module}.LocalProcesses(1).refusal")
        assert Answer("a process for jobs may not start others") == heard(executor, worker)

    def test_what_cannot_be_sent_is_an_error_in_words(self):
        """Before anything is started."""
        with pytest.raises(SkillplanError, match="processes for tests start from cannot be sent"):
            pack_content(lambda: None, "tests")


class TestPrograms:
    def test_what_is_fed_arrives(self, tmp_path):
        """Once it has finished, all is there."""
        path = tmp_path / "copy"
        words = "import sys; open(sys.argv[1], 'wb').write(sys.stdin.buffer.read())"
        program = FedProgram([sys.executable, "-c", words, str(path)])
        program.feed(b"one ")
        program.feed(b"two")
        program.finish()
        assert b"one two" == path.read_bytes()

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            ("import sys; sys.exit('line one\\nno such codec')", "no such codec"),
            ("import sys; sys.exit(3)", "the program failed and printed nothing"),
        ],
    )
    def test_one_that_fails_is_an_error_in_its_words(self, words, message):
        """By the last line that it printed."""
        program = FedProgram([sys.executable, "-c", words])
        with pytest.raises(OSError, match=message):
            program.finish()

    def test_the_output_of_a_program(self):
        """None where it fails or is not there."""
        assert "here\n" == read_output([sys.executable, "-c", "print('here')"])
        assert read_output([sys.executable, "-c", "raise SystemExit(1)"]) is None
        assert read_output(["no-such-program-anywhere"]) is None
