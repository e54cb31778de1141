"""The process that the user starts: only an exit code that the command reports counts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from textwrap import dedent, indent

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")

PATIENCE_S = 30
PROGRAM = """\
import os, signal, sys, threading, time
from skillplan.workers import supervisor
from skillplan.workers.supervised import doing, limit_command
from skillplan.workers.supervisor import supervise
from skillplan.cli.interruption import handle_signals
from skillplan.errors import SearchStopped


def command():
{body}


def report(message, code, may_print):
    print(f"{{code}}: {{message}}", flush=True)


def interrupt(number, frame):
    raise KeyboardInterrupt


# Shorter than in the product, so that tests do not wait.
supervisor._PATIENCE_S, supervisor._LAST_PATIENCE_S, supervisor._EXIT_S = 0.4, 0.6, 1.0
sys.exit(supervise(lambda: command, report, interrupt))
"""
SEGFAULT = "os.kill(os.getpid(), signal.SIGSEGV)"


def start(body: str) -> subprocess.Popen[str]:
    """Start a program whose command has this body."""
    code = PROGRAM.format(body=indent(dedent(body), "    "))
    words = [sys.executable, "-c", code]
    return subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def run(body: str) -> tuple[int, str, str]:
    """Return exit code and output of a program whose command has this body."""
    process = start(body)
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, out, err


def wait_for_line(process: subprocess.Popen[str], line: str) -> None:
    """Return once the program has printed a line."""
    assert process.stdout is not None
    assert f"{line}\n" == process.stdout.readline()


def is_running(number: int) -> bool:
    """Whether a process is there and has not ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def await_end(number: int) -> None:
    """Return once a process has ended."""
    deadline_s = time.monotonic() + PATIENCE_S
    while is_running(number):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


class TestExitCodes:
    @pytest.mark.parametrize("code", [0, 1, 130])
    def test_the_code_of_the_command_is_that_of_the_program(self, code):
        """Nothing is reported."""
        assert (code, "", "") == run(f"return {code}")

    @pytest.mark.parametrize(
        ("end", "how"),
        [
            ("os._exit(0)", "exit code 0"),
            ("os._exit(7)", "exit code 7"),
            (SEGFAULT, "signal 11 (SIGSEGV)"),
            ("os.kill(os.getpid(), 9)", "signal 9 (SIGKILL, maybe for want of memory)"),
        ],
    )
    def test_a_process_that_ends_without_a_code_has_failed(self, end, how):
        """Its own exit code does not count, 0 least of all."""
        message = f"3: The process ended without an answer, by {how}.\n"
        assert (3, message, "") == run(end)

    def test_the_message_names_the_innermost_activity(self):
        """Which also decides on the exit code."""
        body = f"""
            with doing("the search"):
                with doing("the import of x", exit_code=2):
                    {SEGFAULT}
        """
        code, out, _ = run(body)
        assert 2 == code
        assert out.endswith("by signal 11 (SIGSEGV) in the import of x.\n")

    def test_an_activity_that_is_over_is_not_named(self):
        """An exception ends it, too."""
        body = """
            try:
                with doing("the search"):
                    raise ValueError
            except ValueError:
                os._exit(0)
        """
        assert "search" not in run(body)[1]

    @pytest.mark.parametrize("end", ["os._exit(3)", SEGFAULT])
    def test_a_crash_after_the_code_was_reported_changes_nothing(self, end):
        """Libraries crash while the interpreter ends."""
        assert (1, "", "") == run(f"import atexit\natexit.register(lambda: {end})\nreturn 1")

    def test_a_thread_does_not_keep_the_program(self):
        """It is killed some time after the command has ended."""
        begin_s = time.monotonic()
        assert 0 == run("threading.Thread(target=time.sleep, args=(600,)).start()\nreturn 0")[0]
        assert time.monotonic() - begin_s < PATIENCE_S


class TestSignals:
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
    @pytest.mark.parametrize("to_group", [False, True])
    def test_the_first_ends_the_program(self, number, to_group):
        """To the process, or to its whole group as a terminal sends it."""
        process = start("print('begun', flush=True)\ntime.sleep(600)")
        wait_for_line(process, "begun")
        (os.killpg if to_group else os.kill)(process.pid, number)
        assert ("", "skillplan: interrupted\n") == process.communicate(timeout=PATIENCE_S)
        assert 130 == process.returncode

    def test_it_ends_a_command_that_swallows_every_exception(self):
        """By force, with the processes that it has started."""
        body = """
            import subprocess
            other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"],
                                     start_new_session=True)
            print(other.pid, flush=True)
            while True:
                try:
                    time.sleep(600)
                except BaseException:
                    pass
        """
        process = start(body)
        assert process.stdout is not None
        other = int(process.stdout.readline())
        process.terminate()
        assert ("", "skillplan: interrupted\n") == process.communicate(timeout=PATIENCE_S)
        assert 130 == process.returncode
        await_end(other)

    @pytest.mark.slow(reason="waits seconds; a command without a reaction is in every run")
    def test_a_command_that_writes_its_result_is_given_time(self):
        """Longer than a search that does not stop at all."""
        body = """
            requested = []
            with handle_signals(lambda: requested.append(True)):
                with doing("the search"):
                    print("begun", flush=True)
                    while not requested:
                        time.sleep(0.01)
                time.sleep(1.5)
            return 0
        """
        process = start(body)
        wait_for_line(process, "begun")
        process.send_signal(signal.SIGINT)
        assert ("", "") == process.communicate(timeout=PATIENCE_S)
        assert 0 == process.returncode

    @pytest.mark.slow(reason="waits seconds; a command that hangs in every run")
    def test_a_search_that_does_not_stop_is_left_by_an_exception(self):
        """Which leaves what it has found so far."""
        body = """
            with handle_signals(lambda: None):
                try:
                    with doing("the search"):
                        print("begun", flush=True)
                        time.sleep(600)
                except SearchStopped:
                    time.sleep(1)
                    return 0
        """
        process = start(body)
        wait_for_line(process, "begun")
        process.send_signal(signal.SIGINT)
        assert ("", "") == process.communicate(timeout=PATIENCE_S)
        assert 0 == process.returncode

    def test_an_exception_that_is_lost_in_a_callback_is_raised_again(self):
        """Without a traceback; libraries in C call back, and so does the end of an object."""
        body = """
            class Loud:
                def __del__(self):
                    print("begun", flush=True)
                    time.sleep(600)
            Loud()
            time.sleep(600)
        """
        process = start(body)
        wait_for_line(process, "begun")
        process.terminate()
        assert ("", "skillplan: interrupted\n") == process.communicate(timeout=PATIENCE_S)
        assert 130 == process.returncode

    def test_a_time_limit_is_no_interruption(self):
        """So the exit code is not that of Ctrl-C."""
        body = """
            requested = []
            with handle_signals(lambda: requested.append(True)):
                try:
                    with doing("the search", limit_s=0.2):
                        time.sleep(600)
                except SearchStopped:
                    return 1 if requested else 0
        """
        assert (0, "", "") == run(body)

    def test_a_time_limit_waits_until_llvm_has_been_answered(self):
        """An exception in its call to Python would be printed and lost, and the code with it."""
        body = """
            import ctypes

            @ctypes.CFUNCTYPE(None)
            def _raw_object_cache_notify():
                while not signal.getitimer(signal.ITIMER_VIRTUAL)[0]:
                    pass

            with handle_signals(lambda: None):
                try:
                    with doing("the search", limit_s=0.2):
                        _raw_object_cache_notify()
                        while True:
                            pass
                except SearchStopped:
                    return 0
        """
        assert (0, "", "") == run(body)

    def test_an_ignored_signal_stays_ignored(self):
        """As under nohup."""
        body = "print('begun', flush=True)\ntime.sleep(0.5)\nreturn 0"
        before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
        try:
            process = start(body)
        finally:
            signal.signal(signal.SIGHUP, before)
        wait_for_line(process, "begun")
        process.send_signal(signal.SIGHUP)
        process.communicate(timeout=PATIENCE_S)
        assert 0 == process.returncode

    def test_a_program_that_ignores_the_end_of_children_still_gets_the_code(self):
        """As if it was started by a service that leaves no zombies."""
        before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        try:
            process = start("return 1")
        finally:
            signal.signal(signal.SIGCHLD, before)
        process.communicate(timeout=PATIENCE_S)
        assert 1 == process.returncode

    @pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no process file system")
    def test_sigkill_takes_the_command_along(self):
        """Even if it is deep in a loop that runs no handler."""
        body = """
            signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 32))
            print(os.getpid(), flush=True)
            while True:
                pass
        """
        process = start(body)
        assert process.stdout is not None
        command = int(process.stdout.readline())
        process.kill()
        process.communicate(timeout=PATIENCE_S)
        await_end(command)


class TestLimits:
    def test_past_the_time_limit_an_exception_ends_the_command(self, tmp_path):
        """So that it tidies up."""
        path = tmp_path / "tidied"
        body = f"""
            limit_command(0.3)
            try:
                time.sleep(600)
            finally:
                open({str(path)!r}, "w").close()
        """
        code, _, _ = run(body)
        assert 130 == code
        assert path.exists()

    def test_one_that_goes_on_is_killed(self):
        """With a message that names the limit; the exit code is that of wrong input."""
        body = """
            limit_command(0.3)
            while True:
                try:
                    time.sleep(600)
                except BaseException:
                    pass
        """
        message = "The command took longer than --time-limit 0.3 and was ended. Allow more time."
        assert (2, f"2: {message}\n", "") == run(body)

    @pytest.mark.parametrize("where", ["here", "in a process of its own"])
    def test_past_the_memory_limit_it_is_killed(self, where):
        """Memory of the processes that it has started counts."""
        hog = "x = bytearray(200 * 2**20); import time; time.sleep(600)"
        other = f"import subprocess; subprocess.run([sys.executable, '-c', {hog!r}])"
        code, out, _ = run(f"limit_command(None, 150 * 2**20)\n{hog if where == 'here' else other}")
        assert 2 == code
        assert (
            "2: The command held more memory than --memory-limit, 150 MiB, and was ended.\n" == out
        )

    def test_an_activity_is_ended_by_its_own_limit(self):
        """At once if it is of no use to raise an exception in it."""
        body = """
            with doing("the import of x", limit_s=0.3, forced=True):
                time.sleep(600)
        """
        code, out, _ = run(body)
        assert 2 == code
        assert "the import of x took longer than 0.3 s" in out

    def test_an_activity_that_ends_past_its_limit_after_all_is_forgiven(self):
        """A solver returns its best plan at the exception."""
        body = """
            try:
                with doing("the search", limit_s=0.3):
                    time.sleep(600)
            except KeyboardInterrupt:
                time.sleep(0.3)
                return 0
        """
        assert (0, "", "") == run(body)
