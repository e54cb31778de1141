"""The command line as a process: signals, pipes, terminals."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from skillplan import __version__
from thinned import slow_case

fcntl = pytest.importorskip("fcntl")
termios = pytest.importorskip("termios")

PATIENCE_S = 30
SKILLPLAN = [sys.executable, "-m", "skillplan"]


class Terminal:
    """A pseudo terminal of which we hold the far end."""

    def __init__(self, columns: int) -> None:
        self.far, self.near = pty.openpty()
        fcntl.ioctl(self.near, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
        os.set_blocking(self.far, False)
        self.text = ""

    def read(self) -> str:
        """Return all that has been shown so far."""
        try:
            while chunk := os.read(self.far, 65536):
                self.text += chunk.decode()
        except OSError:
            pass
        return self.text

    def wait_for(self, pattern: str) -> None:
        """Return once something that matches has been shown."""
        deadline_s = time.monotonic() + PATIENCE_S
        while re.search(pattern, self.read()) is None:
            assert time.monotonic() < deadline_s, f"no {pattern!r} in {self.text!r}"
            time.sleep(0.01)


@contextmanager
def terminal(columns: int = 80) -> Iterator[Terminal]:
    screen = Terminal(columns)
    try:
        yield screen
    finally:
        os.close(screen.far)
        os.close(screen.near)


def on_a_terminal(words: list[str], columns: int, environment: dict[str, str]) -> str:
    """Return what a command shows whose stdout is a terminal so wide."""
    with terminal(columns) as screen:
        process = subprocess.Popen(
            [*SKILLPLAN, *words],
            stdout=screen.near,
            stderr=subprocess.PIPE,
            env={**environment, "TERM": "xterm"},
        )
        while process.poll() is None:
            screen.read()
            time.sleep(0.01)
        shown = screen.read()
        assert process.stderr is not None
        with process.stderr:
            assert b"" == process.stderr.read()
    return re.sub(r"\x1b\[[0-9;]*m", "", shown).replace("\r\n", "\n")


class TestAsAModule:
    @pytest.mark.slow(reason="a process; every run has the exit codes of that module")
    def test_python_m_is_the_same_program(self, environment, board):
        """`python -m skillplan` solves, prints one document, and is silent on stderr."""
        command = [*SKILLPLAN, "search-optimal", board, "--format", "json"]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert (0, "") == (done.returncode, done.stderr)
        assert "optimal" == json.loads(done.stdout)["status"]

    def test_the_installed_script_is_the_same_program(self, environment):
        """The entry point of the distribution."""
        script = Path(sys.executable).parent / "skillplan"
        done = subprocess.run(
            [script, "--version"], capture_output=True, text=True, env=environment
        )
        assert (0, f"skillplan, version {__version__}\n") == (done.returncode, done.stdout)

    @pytest.mark.slow(reason="several processes; exit codes of all commands are in every run")
    def test_exit_codes_reach_the_shell(self, environment, board):
        """1 and 2, as real statuses."""
        for code, words in ((1, ["explain", board, "1"]), (2, ["explain", board, "x"])):
            done = subprocess.run([*SKILLPLAN, *words], capture_output=True, env=environment)
            assert code == done.returncode


class TestInterruption:
    @pytest.fixture
    def long_search(self, environment, motor):
        """Brute force on the larger board, which would take for ever; stderr is a terminal."""
        words = ["search-optimal", motor, "--solver", "exhaustive", "--format", "json"]
        with terminal() as screen:
            process = subprocess.Popen(
                [*SKILLPLAN, *words],
                stdout=subprocess.PIPE,
                stderr=screen.near,
                text=True,
                env={**environment, "TERM": "xterm"},
            )
            try:
                yield process, screen
            finally:
                process.kill()
                process.communicate()

    def test_ctrl_c_prints_the_best_so_far(self, long_search):
        """One whole document with the proved bound, and exit code 130."""
        process, screen = long_search
        screen.wait_for("nodes")
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=PATIENCE_S)
        document = json.loads(out)
        assert 130 == process.returncode
        assert ("unsolved", "interrupted: no plan was found") == (
            document["status"],
            document["reason"],
        )
        assert document["lower_bound"] > 0
        assert document["stats"]["expanded"] > 0
        assert "Traceback" not in screen.read()

    @pytest.mark.slow(
        reason="a process; every run waits for the progress before it interrupts a search"
    )
    def test_progress_shows_on_the_terminal_and_goes_away(self, long_search):
        """Solver, bound and nodes while it runs; the line is wiped in the end."""
        process, screen = long_search
        screen.wait_for("nodes")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
        shown = screen.read()
        assert "exhaustive" in shown
        assert "bound 0." in shown
        assert "\x1b[2K" in shown[-20:]

    @pytest.mark.slow(
        reason="searches for more than a second; every run shows the progress on a terminal"
    )
    def test_progress_shows_the_speed_after_a_second(self, long_search):
        """Nodes in a second, beside the time that has passed."""
        process, screen = long_search
        screen.wait_for(r"[\d,]+ nodes/s")
        assert re.search(r"0:00:\d\d", screen.read())
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)
        assert 130 == process.returncode

    @pytest.mark.slow(
        reason="a process of two searches; a single search that is interrupted in every run"
    )
    def test_an_interrupted_comparison_keeps_what_is_done(self, environment, motor, deaf_solver):
        """The solver that had ended and the one that was interrupted; the third never starts."""
        solvers = f"exact,exhaustive,{deaf_solver}"
        words = ["compare", motor, "--solvers", solvers, "--format", "json"]
        with terminal() as screen:
            process = subprocess.Popen(
                [*SKILLPLAN, *words],
                stdout=subprocess.PIPE,
                stderr=screen.near,
                text=True,
                env={**environment, "TERM": "xterm", "PYTHONPATH": os.environ["PYTHONPATH"]},
            )
            try:
                screen.wait_for("exhaustive[^\r\n]* nodes")
                process.send_signal(signal.SIGINT)
                out, _ = process.communicate(timeout=PATIENCE_S)
            finally:
                process.kill()
                process.communicate()
        assert 130 == process.returncode
        rows = json.loads(out)["rows"]
        assert [("exact", "optimal"), ("exhaustive", "unsolved")] == [
            (row["solver"], row["status"]) for row in rows
        ]

    @pytest.mark.slow(reason="waits for a process; one Ctrl-C is in every run")
    def test_a_second_ctrl_c_ends_it(self, environment, board, deaf_solver):
        """A solver that heeds nothing is ended, without a traceback and without a result."""
        process = subprocess.Popen(
            [*SKILLPLAN, "search-optimal", board, "--solver", deaf_solver],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**environment, "PYTHONPATH": os.environ["PYTHONPATH"]},
        )
        try:
            assert process.stderr is not None
            assert "asleep\n" == process.stderr.readline()
            process.send_signal(signal.SIGINT)
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(0.3)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
            process.communicate()
        assert 130 == process.returncode
        assert "" == out
        assert "skillplan: interrupted\n" == err.lstrip("\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order_before_the_command_is_even_imported(number):
    """From the first line of ours on: with the code of an interruption and without a traceback."""
    words = [sys.executable, "-X", "importtime", "-m", "skillplan", "check", "none.yaml"]
    process = subprocess.Popen(
        words,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # It cannot run ahead of who reads what it imports: there is no room in the pipe.
        pipesize=4096,
        # A shell that runs the suite in the background has all of it ignore Ctrl-C.
        preexec_fn=partial(signal.signal, number, signal.SIG_DFL),
    )
    assert process.stderr is not None
    with process.stderr as heard:
        message = next(line for line in heard if "typer" in line)
        process.send_signal(number)
        message += heard.read()
    assert 130 == process.wait(PATIENCE_S)
    assert message.endswith("skillplan: interrupted\n")
    assert "Traceback" not in message


@pytest.mark.slow(reason="waits two seconds; an exception that is lost in every run")
def test_an_exception_of_a_signal_that_a_library_wraps_is_an_interruption(install, board):
    """As pydantic does while it builds what reads a file."""
    source = """
        import sys, time

        print("imports", file=sys.stderr)
        try:
            time.sleep(600)
        except BaseException as error:
            raise ValueError("a field") from error
    """
    install("solver", "wrapping", "wrapping_solver:Wrapping", source)
    words = ["search-optimal", board, "--solver", "wrapping"]
    process = subprocess.Popen([*SKILLPLAN, *words], stderr=subprocess.PIPE, text=True)
    with process:
        assert process.stderr is not None
        assert "imports\n" == process.stderr.readline()
        process.terminate()
        assert "skillplan: interrupted\n" == process.communicate(timeout=PATIENCE_S)[1]
    assert 130 == process.returncode


class TestPipes:
    @pytest.mark.parametrize(
        "style",
        [
            slow_case("table", reason="JSON in every run"),
            "json",
            slow_case("csv", reason="two formats in every run"),
            slow_case("md", reason="two formats in every run"),
        ],
    )
    def test_a_reader_who_has_gone_is_no_fault(self, environment, board, style):
        """As with `| head -1`: nothing on stderr, and the exit code of the search."""
        gone, ours = os.pipe()
        os.close(gone)
        try:
            done = subprocess.run(
                [*SKILLPLAN, "search-optimal", board, "--format", style],
                stdout=ours,
                stderr=subprocess.PIPE,
                env=environment,
            )
        finally:
            os.close(ours)
        assert (0, b"") == (done.returncode, done.stderr)

    @pytest.mark.slow(reason="a process in a pipe; a reader who has gone in every run")
    def test_head_gets_its_line(self, environment, board):
        """In a real shell pipeline."""
        shell = f"'{sys.executable}' -m skillplan check '{board}' | head -1"
        done = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, env=environment)
        assert (0, "inverter-board: valid\n", "") == (done.returncode, done.stdout, done.stderr)

    @pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
    def test_a_full_disk_is_told(self, environment, board):
        """In words, with exit code 2."""
        with open("/dev/full", "w") as full:
            command = [*SKILLPLAN, "check", board]
            done = subprocess.run(
                command, stdout=full, stderr=subprocess.PIPE, text=True, env=environment
            )
        assert 2 == done.returncode
        assert done.stderr.startswith("skillplan: error: The output cannot be written: ")
        assert 1 == len(done.stderr.splitlines())

    @pytest.mark.parametrize(
        "encoding",
        [
            "ascii",
            slow_case("latin-1", reason="two encodings in every run"),
            slow_case("utf-8", reason="ASCII in every run"),
        ],
    )
    def test_any_encoding_of_stdout_will_do(self, environment, board, encoding):
        """Old terminals get a table without box characters."""
        command = [*SKILLPLAN, "check", board]
        done = subprocess.run(
            command, capture_output=True, env={**environment, "PYTHONIOENCODING": encoding}
        )
        assert (0, b"") == (done.returncode, done.stderr)
        lines = done.stdout.decode(encoding).splitlines()
        assert {"─" if encoding == "utf-8" else "-"} == set(lines[2]) - {"+"}

    @pytest.mark.slow(reason="a process; every run has output that is redirected without colour")
    def test_no_progress_where_stderr_is_no_terminal(self, environment, motor):
        """A search of a second leaves nothing on a redirected stderr, even in colour."""
        words = ["search-optimal", motor, "--solver", "exhaustive", "--time-limit", "0.3"]
        done = subprocess.run(
            [*SKILLPLAN, *words], capture_output=True, env={**environment, "FORCE_COLOR": "1"}
        )
        assert (1, b"") == (done.returncode, done.stderr)

    @pytest.mark.slow(
        reason="a process; redirected tables are not cut in every run, in this process"
    )
    def test_redirected_output_is_plain_and_loses_nothing(self, environment, motor):
        """COLUMNS holds there too, FORCE_COLOR does not; the sequence wraps and stays whole."""
        command = [*SKILLPLAN, "compare", motor, "--solvers", "exact"]
        forced = {**environment, "COLUMNS": "40", "FORCE_COLOR": "1"}
        done = subprocess.run(command, capture_output=True, text=True, env=forced)
        assert "\x1b" not in done.stdout
        assert all(len(line) <= 40 for line in done.stdout.splitlines())
        sequence = re.sub(r"\s", "", done.stdout.partition("sequence")[2])
        assert 41 == len(sequence.split(","))
        assert sequence.endswith(",20,21,22,23")


class TestTerminals:
    @pytest.mark.slow(reason="a process on a terminal; a comparison fits 80 columns in every run")
    def test_a_plan_fits_80_columns(self, environment, motor):
        """A line for each step, none of them wrapped; the sequence wraps between its actions."""
        shown = on_a_terminal(["search-optimal", motor], 80, environment)
        lines = shown.splitlines()
        first = next(n for n, line in enumerate(lines) if line.startswith("sequence"))
        assert lines[first].endswith(",")
        assert 41 == len((lines[first] + lines[first + 1]).split(","))
        assert all(len(line) <= 80 for line in lines)
        assert 41 == len([line for line in lines if re.match(r" *\d+ +\d+ +[a-z]+\(\S+\) ", line)])

    @pytest.mark.slow(reason="a process of its own; tables fit in every run")
    def test_a_comparison_fits_80_columns(self, environment, board):
        """No figure is cut; what is long stands below the table."""
        words = ["compare", board, "--solvers", "exact,exhaustive", "--set", "step_limit=15"]
        lines = on_a_terminal(words, 80, environment).splitlines()
        rows = [line for line in lines if line.startswith(("exact ", "exhaustive "))]
        assert all(["optimal", "1.86709", "0.00", "%"] == row.split()[1:5] for row in rows)
        assert 2 == len(rows)
        sequence = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
        assert f"exact: makespan [s] 74.5; sequence {sequence}" in lines
        assert all(len(line) <= 80 for line in lines)

    @pytest.mark.slow(reason="a process on a terminal; a comparison on a narrower one in every run")
    def test_a_wide_terminal_has_all_in_one_table(self, environment, board):
        """Nothing is moved below where it fits."""
        words = ["compare", board, "--solvers", "exact"]
        lines = on_a_terminal(words, 160, environment).splitlines()
        assert lines[1].split()[-1] == "sequence"
        assert lines[3].rstrip().endswith("0,1,2,3,4,5,8,9,10,11,6,7,13,14,15")

    @pytest.mark.slow(reason="a process for each width; tables fit in every run")
    @pytest.mark.parametrize(
        "columns",
        [
            30,
            slow_case(70, reason="two other widths in every run"),
            slow_case(80, reason="30 columns in every run"),
            slow_case(120, reason="two other widths in every run"),
        ],
    )
    def test_nothing_is_cut_in_any_width(self, environment, board, columns):
        """Where there is little room columns stand in blocks, each with the step; figures stay."""
        words = ["evaluate", board, "--sequence", "0,1,2,3"]
        table, _, notes = on_a_terminal(words, columns, environment).partition("feasible")
        wide, _, _ = on_a_terminal(words, 200, environment).partition("feasible")
        expected, actual = (Counter(re.findall(r"[\d.]+", text)) for text in (wide, table))
        assert Counter() == expected - actual
        assert set(expected) == set(actual)
        assert "so far     0.40262 m, 13.6 s\n" in notes

    @pytest.mark.slow(reason="a process on a terminal; a comparison fits 80 columns in every run")
    def test_an_explanation_is_readable_in_80_columns(self, environment, board):
        """Facts are not broken in the middle of a name."""
        words = ["explain", board, "place(brace)", "--after", "0,1,10"]
        lines = on_a_terminal(words, 80, environment).splitlines()
        assert all(len(line) <= 80 for line in lines)
        text = "\n".join(lines)
        for fact in ("placed(pcb)", "not placed(transformer)", "at_start(switch_2)"):
            assert fact in text
