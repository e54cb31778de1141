"""What leaves the program: nothing raw, and no fault where nobody listens."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest

from run_folders import OPTIMAL, write_runs
from skillplan.cli import writing
from skillplan.errors import OptionError

PROGRAM = [sys.executable, "-m", "skillplan"]
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
HOSTILE = "\x1b[31m\x9b2J\x7f\u202e\u2066\u200b\u2028[red][/]"
FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")

# A back end whose verdict, and a solver whose exception, hold what a terminal would obey.
DETECTOR = '''
    from skillplan import Detector, Verdict

    class Rude(Detector):
        """Refuse with a reason that colours the screen."""

        name = "rude"

        def check(self, skill, state):
            nothing = self.task.facts.none
            return Verdict.infeasible("\\x1b[31mred\\u202e[bold]\\x7f", nothing, nothing)
'''
SOLVER = '''
    from skillplan import Solver

    class Rude(Solver):
        """Fail with words that colour the screen."""

        name = "rude"

        def solve(self, model, *, seed=0):
            raise RuntimeError("\\x1b[31mred\\u202e[bold]\\x7f")
'''


def both(outcome: Any) -> str:
    """Return all that was printed."""
    return str(outcome.out + outcome.err)


class TestNothingRaw:
    def test_a_file_name_is_written_out(self, cli):
        """In the message that there is no such file."""
        outcome = cli("check", f"{HOSTILE}.yaml")
        assert 2 == outcome.code
        assert r"\x1b[31m" in outcome.err
        assert None is RAW.search(both(outcome))

    @pytest.mark.parametrize("words", [("check", f"--{HOSTILE}"), (HOSTILE,), ("check",)])
    def test_a_line_that_is_not_understood_is_written_out(self, cli, words):
        """Unknown options and commands, as Typer finds them."""
        outcome = cli(*words)
        assert 2 == outcome.code
        assert None is RAW.search(both(outcome))

    @pytest.mark.parametrize("style", ["table", "csv", "md", "json"])
    def test_a_name_in_a_task_file_is_written_out(self, cli, board, tmp_path, style):
        """Of a description, which may be any text."""
        text = Path(board).read_text("utf-8")
        named = re.sub(
            r"(?m)^description:.*$", 'description: "\\\\x1b[31m\\\\u202e[red]\\\\x7f"', text
        )
        path = tmp_path / "board\x1b\u202e.yaml"
        path.write_text(named, "utf-8")
        for words in (("check", str(path)), ("evaluate", str(path), "--sequence", "0")):
            outcome = cli(*words, "--format", style)
            assert outcome.code in (0, 1)
            assert None is RAW.search(both(outcome))

    @pytest.mark.parametrize("style", ["table", "csv", "md", "json"])
    def test_an_exception_of_a_plugin_is_written_out(self, cli, board, install, style):
        """Its brackets are no markup, and JSON holds the words whole."""
        install("solver", "rude", "rude_solver:Rude", SOLVER)
        outcome = cli("compare", board, "--solvers", "rude", "--format", style)
        assert 2 == outcome.code
        assert None is RAW.search(both(outcome))
        if style == "json":
            assert "\x1b[31mred\u202e[bold]\x7f" in outcome.document["rows"][0]["reason"]
        elif style != "csv":
            assert r"[31mred\u202e" in outcome.out.replace("\\\\", "\\")

    @pytest.mark.parametrize("style", ["table", "csv", "md", "json"])
    @pytest.mark.parametrize(
        "words",
        [
            ("evaluate", "BOARD", "--sequence", "0"),
            ("explain", "BOARD", "pick(pcb)"),
            ("search-optimal", "BOARD", "--audit", "0"),
        ],
        ids=lambda words: words[0],
    )
    def test_a_verdict_is_written_out(self, cli, board, install, words, style):
        """Its reason, wherever it is shown."""
        install("collision", "rude", "rude_detector:Rude", DETECTOR)
        given = (word.replace("BOARD", board) for word in words)
        outcome = cli(*given, "--collision", "rude", "--format", style)
        assert 1 == outcome.code
        assert None is RAW.search(both(outcome))
        assert "red" in both(outcome)

    @pytest.mark.parametrize("style", ["table", "csv", "md", "json"])
    @pytest.mark.parametrize("words", [("verify", "--verbose"), ("evaluate",)])
    def test_a_document_is_written_out(self, cli, solved_board, tmp_path, words, style):
        """Of a result: what its words hold is shown where they do not hold."""
        folder = Path(shutil.copytree(solved_board, tmp_path / "result"))
        path = folder / "result.json"
        document = json.loads(path.read_text("utf-8"))
        for key in ("solver", "reason", "cost_unit", "bound_method"):
            document[key] = HOSTILE
        document["trace"] = {HOSTILE: HOSTILE}
        path.write_text(json.dumps(document), "utf-8")
        command, *more = words
        outcome = cli(command, str(folder), *(more if style == "table" else ()), "--format", style)
        assert outcome.code in (0, 1, 2)
        assert None is RAW.search(both(outcome))

    @pytest.mark.parametrize("style", ["table", "csv", "md", "json"])
    def test_a_manifest_is_written_out(self, cli, board, tmp_path, style):
        """Of a training: names, paths, solver."""
        folder = write_runs(tmp_path / "run", board, [OPTIMAL], steps=500)
        path = folder / "manifest.json"
        manifest = json.loads(path.read_text("utf-8"))
        manifest["solver"] = HOSTILE
        manifest["task"].update(name=HOSTILE, source=HOSTILE)
        path.write_text(json.dumps(manifest), "utf-8")
        outcome = cli("evaluate", str(folder), "--episodes", "1", "--format", style)
        assert outcome.code in (0, 1, 2)
        assert both(outcome)
        assert None is RAW.search(both(outcome))

    def test_a_traceback_is_written_out(self, cli, board, install, monkeypatch):
        """With SKILLPLAN_DEBUG."""
        monkeypatch.setenv("SKILLPLAN_DEBUG", "1")
        install("solver", "rude", "rude_solver:Rude", SOLVER)
        outcome = cli("search-optimal", board, "--solver", "rude")
        assert "Traceback" in outcome.err
        assert None is RAW.search(both(outcome))


def test_a_warning_of_python_is_written_out(capsys, monkeypatch):
    """Of a library that quotes what it was given."""
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    writing.escape_warnings()
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.warn("\x1b[31mred", UserWarning, stacklevel=1)
    assert r"UserWarning: \x1b[31mred" in capsys.readouterr().err


class Broken:
    """A stream that cannot be written to."""

    encoding = "utf-8"

    def __init__(self, error: OSError) -> None:
        self.error = error

    def write(self, text: str) -> int:
        raise self.error

    def flush(self) -> None:
        """Hold nothing."""

    def fileno(self) -> int:
        raise OSError("no descriptor")


def test_a_full_stderr_is_no_fault(monkeypatch):
    """There is nobody to tell."""
    monkeypatch.setattr(sys, "stderr", Broken(OSError(28, "No space left on device")))
    writing.tell("anything")


def test_a_full_stdout_is_an_error(monkeypatch):
    """Else a file would be half written without a word."""
    monkeypatch.setattr(sys, "stdout", Broken(OSError(28, "No space left on device")))
    with pytest.raises(OptionError, match="cannot be written: No space left"):
        writing.write_out("anything")


def test_a_reader_who_has_gone_is_no_fault(monkeypatch):
    """As with ``| head``."""
    monkeypatch.setattr(sys, "stdout", Broken(BrokenPipeError()))
    writing.write_out("anything")


def in_a_shell(line: str, environment: dict[str, str], cwd: Path) -> tuple[int, str]:
    """Return exit code and all that stderr shows of ``skillplan LINE``."""
    script = f"{line.replace('skillplan', ' '.join(PROGRAM))}"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, env=environment, cwd=cwd
    )
    return done.returncode, done.stderr


BAD_NUMBER = "skillplan: error: The output cannot be written: Bad file descriptor.\n"
NO_SPACE = "skillplan: error: The output cannot be written: No space left on device.\n"


@FULL
def test_closed_streams_end_with_the_documented_code(environment, tmp_path):
    """A closed stdout is an error; a closed stderr is silence, and nothing else changes."""
    assert (2, "") == in_a_shell("skillplan check no.yaml 2>&-", environment, tmp_path)
    assert (2, BAD_NUMBER) == in_a_shell("skillplan --version >&-", environment, tmp_path)


@FULL
@pytest.mark.slow(reason="a dozen processes")
@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        ("skillplan check BOARD >&-", 2, BAD_NUMBER),
        ("skillplan check BOARD >/dev/full", 2, NO_SPACE),
        ("skillplan --help >/dev/full", 2, NO_SPACE),
        ("skillplan --version >/dev/full", 2, NO_SPACE),
        ("skillplan check --help >&-", 2, BAD_NUMBER),
        ("skillplan check BOARD 2>&-", 0, ""),
        ("skillplan check no.yaml 2>/dev/full", 2, ""),
        ("skillplan check no.yaml --format json >/dev/full 2>/dev/full", 2, ""),
        ("skillplan --nonsense 2>/dev/full", 2, ""),
        ("skillplan --help | true; exit ${PIPESTATUS[0]}", 0, ""),
        ("skillplan check --help | head -1; exit ${PIPESTATUS[0]}", 0, ""),
        ("skillplan check BOARD 0<&- 1>&- 2>&-", 2, ""),
        ("LC_ALL=POSIX PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 skillplan --help", 0, ""),
        ("LC_ALL=POSIX PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 skillplan check BOARD", 0, ""),
        ("ulimit -n 16; skillplan search-optimal BOARD", 0, ""),
        ("ulimit -n 16; skillplan compare BOARD --solvers exact", 0, ""),
        ("mkdir gone; cd gone; rmdir ../gone; skillplan search-optimal BOARD", 0, ""),
        ("mkdir gone; cd gone; rmdir ../gone; skillplan check BOARD", 0, ""),
        ("env -i PYTHONPATH=$PYTHONPATH skillplan search-optimal BOARD", 0, ""),
    ],
)
def test_no_surroundings_are_too_poor(environment, board, tmp_path, line, code, message):
    """Closed and full streams, few files, no folder, no HOME, no locale."""
    assert (code, message) == in_a_shell(line.replace("BOARD", board), environment, tmp_path)
