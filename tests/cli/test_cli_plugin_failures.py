"""Plugins of others that raise: named with the line of their own code, and no harm to the rest."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from thinned import thinned

SOLVER = '''
from skillplan import Solution, Solver


class Faulty(Solver):
    """Raise in one of its methods."""

    name = "faulty"
'''
DETECTOR = '''
from skillplan import Detector, Verdict


class Faulty(Detector):
    """Raise in one of its methods."""

    name = "faulty"
    expensive = DEAR

    def check(self, skill, state):
        return Verdict.feasible()
'''
RAISES = {
    "solve": "def solve(self, model, *, seed=0):",
    "check": "def check(self, skill, state):",
    "constructor": "def __init__(self, *arguments):",
    "refuses": "def refuses(self, *arguments):",
    "beside": "def beside(self, others):",
    "faults": "def faults(self):",
}
REST_OF_A_SOLVER = """
    def solve(self, model, *, seed=0):
        return Solution(None)
"""


@pytest.fixture(autouse=True)
def not_debugging(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever runs the tests may be debugging; the tests are not."""
    monkeypatch.delenv("SKILLPLAN_DEBUG", raising=False)


@pytest.fixture
def faulty(install: Any) -> Any:
    """Put on the path a solver or detector that raises in one method; return where."""

    def put(
        kind: str, method: str, *, expensive: bool = False, raised: str = "LookupError('no table')"
    ) -> str:
        text = (SOLVER if kind == "solver" else DETECTOR).replace("DEAR", str(expensive))
        if kind == "solver" and method != "solve":
            text += REST_OF_A_SOLVER
        text += f"\n    {RAISES[method]}\n        raise {raised}\n"
        folder = install(kind, "faulty", "faulty_plugin:Faulty", text)
        return f"{folder / 'faulty_plugin.py'}:{len(text.splitlines())}"

    return put


class TestASolver:
    @pytest.mark.parametrize("method", ["solve", "refuses", "constructor"])
    def test_it_is_named_with_its_own_line(
        self, cli: Any, board: str, faulty: Any, method: str
    ) -> None:
        """Whatever of ours called it; the traceback is offered and not shown."""
        place = faulty("solver", method)
        outcome = cli("search-optimal", board, "--solver", "faulty")
        assert 2 == outcome.code
        assert (
            "skillplan: error: The solver 'faulty' failed: LookupError: no table "
            f"({place}; SKILLPLAN_DEBUG=1 shows the traceback)\n" == outcome.err
        )

    @pytest.mark.slow(reason="walks all sequences; a failed row is in every run")
    @pytest.mark.parametrize(
        "method",
        [
            "solve",
            pytest.param(
                "constructor",
                marks=pytest.mark.slow(
                    reason="walks the board again; a failing search in every run"
                ),
            ),
        ],
    )
    def test_in_a_comparison_it_is_a_row_and_the_others_run_on(
        self, cli: Any, board: str, faulty: Any, method: str
    ) -> None:
        """The exit code tells of it at the end."""
        place = faulty("solver", method)
        solvers = "exact,faulty,exhaustive"
        outcome = cli("compare", board, "--solvers", solvers, "--format", "json")
        rows = outcome.document["rows"]
        assert 2 == outcome.code
        assert ["optimal", "failed", "optimal"] == [row["status"] for row in rows]
        assert f"LookupError: no table ({place};" in rows[1]["reason"]
        assert "" == outcome.err

    def test_the_table_of_a_comparison_says_why(self, cli: Any, board: str, faulty: Any) -> None:
        """Below the rows, as of a refusal."""
        faulty("solver", "solve")
        outcome = cli("compare", board, "--solvers", "faulty,exact")
        assert 2 == outcome.code
        assert "failed" in outcome.out
        assert "LookupError: no table" in outcome.out

    def test_so_it_is_with_a_chain(self, cli: Any, faulty: Any, root: Path) -> None:
        """The row of the chain names the task that it failed on."""
        faulty("solver", "solve")
        job = str(root / "configs" / "swarmitfix_cases.yaml")
        outcome = cli("compare", job, "--solvers", "faulty,exact", "--format", "json")
        failed, solved = outcome.document["rows"]
        assert 2 == outcome.code
        assert ("failed", "optimal") == (failed["status"], solved["status"])
        assert failed["reason"].startswith("base-1: The solver 'faulty' failed: LookupError")

    def test_debugging_shows_the_traceback(
        self, cli: Any, board: str, faulty: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """After the message, and nothing offers it any more."""
        place = faulty("solver", "solve")
        monkeypatch.setenv("SKILLPLAN_DEBUG", "1")
        outcome = cli("search-optimal", board, "--solver", "faulty")
        assert 2 == outcome.code
        first, *rest = outcome.err.splitlines()
        assert first.endswith(f"failed: LookupError: no table ({place})")
        assert "Traceback (most recent call last):" == rest[0]
        assert "LookupError: no table" == rest[-1]

    def test_debugging_shows_it_in_a_comparison_too(
        self,
        cli: Any,
        board: str,
        faulty: Any,
        monkeypatch: pytest.MonkeyPatch,
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        """In the log; the document stays one."""
        faulty("solver", "solve")
        monkeypatch.setenv("SKILLPLAN_DEBUG", "1")
        outcome = cli("compare", board, "--solvers", "faulty", "--format", "json")
        assert "failed" == outcome.document["rows"][0]["status"]
        assert "Traceback (most recent call last):" in caplog.text

    def test_a_wrong_option_stops_a_comparison_before_it_starts(self, cli: Any, board: str) -> None:
        """It is the user's to repair, and no row."""
        words = ("--solvers", "exact,exhaustive", "-O", "exact.max_labels=-1")
        outcome = cli("compare", board, *words)
        assert (2, "") == (outcome.code, outcome.out)
        assert "max_labels" in outcome.err


class TestABackEnd:
    @pytest.mark.parametrize("method", ["check", "refuses", "constructor", "beside", "faults"])
    def test_it_is_named_with_its_own_line(
        self, cli: Any, board: str, faulty: Any, method: str
    ) -> None:
        """Whenever it raises; the exit code is that of a back end."""
        place = faulty("collision", method)
        outcome = cli("search-optimal", board, "--collision", "faulty")
        assert 3 == outcome.code
        assert "'faulty' failed" in outcome.err
        assert outcome.err.endswith(
            f"LookupError: no table ({place}; SKILLPLAN_DEBUG=1 shows the traceback)\n"
        )

    def test_in_a_comparison_every_solver_that_meets_it_is_a_row(
        self, cli: Any, board: str, faulty: Any
    ) -> None:
        """None of them ends the command; the exit code is that of a back end, as elsewhere."""
        place = faulty("collision", "check")
        solvers = ("--solvers", "exact,exhaustive")
        outcome = cli("compare", board, *solvers, "--collision", "faulty", "--format", "json")
        rows = outcome.document["rows"]
        assert 3 == outcome.code
        assert ["failed", "failed"] == [row["status"] for row in rows]
        assert all(place in row["reason"] for row in rows)

    @pytest.mark.slow(reason="a process; in this one in every run")
    def test_so_it_is_in_a_process_of_its_own(
        self, cli: Any, board: str, faulty: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The traceback comes from there, too."""
        place = faulty("collision", "check", expensive=True)
        words = ("search-optimal", board, "--collision", "faulty", "--jobs", "2", "--no-cache")
        monkeypatch.setenv("SKILLPLAN_DEBUG", "1")
        outcome = cli(*words)
        assert 3 == outcome.code
        assert f"LookupError: no table ({place})" in outcome.err
        assert "Traceback (most recent call last):" in outcome.err


# What no `except Exception` catches, and what it is called in the message.
NO_EXCEPTIONS = {
    "SystemExit(0)": "SystemExit: 0",
    "SystemExit": "SystemExit",
    "KeyboardInterrupt": "KeyboardInterrupt",
    "GeneratorExit": "GeneratorExit",
    "BaseException('enough')": "BaseException: enough",
}


@pytest.mark.parametrize("raised", NO_EXCEPTIONS)
class TestNobodyEndsTheProgramButWe:
    @pytest.fixture(autouse=True)
    def _signals_are_heard_by_the_command_line(self) -> Iterator[None]:
        """As in a process of its own, where Ctrl-C is no KeyboardInterrupt of Python's making."""
        before = signal.signal(signal.SIGINT, lambda *_: None)
        yield
        signal.signal(signal.SIGINT, before)

    @pytest.mark.parametrize("method", ["solve", "refuses", "constructor"])
    def test_a_solver_has_failed(
        self, cli: Any, board: str, faulty: Any, method: str, raised: str
    ) -> None:
        """It is named like one that raises an error; nothing ends without a word."""
        faulty("solver", method, raised=raised)
        outcome = cli("search-optimal", board, "--solver", "faulty")
        assert 2 == outcome.code
        assert f"The solver 'faulty' failed: {NO_EXCEPTIONS[raised]} (" in outcome.err

    def test_the_other_solvers_of_a_comparison_run_on(
        self, cli: Any, board: str, faulty: Any, raised: str
    ) -> None:
        """It is a row."""
        faulty("solver", "solve", raised=raised)
        outcome = cli("compare", board, "--solvers", "faulty,exact", "--format", "json")
        assert 2 == outcome.code
        assert ["failed", "optimal"] == [row["status"] for row in outcome.document["rows"]]

    @pytest.mark.parametrize("method", ["check", "refuses", "constructor", "beside", "faults"])
    def test_a_back_end_has_failed(
        self, cli: Any, board: str, faulty: Any, method: str, raised: str
    ) -> None:
        """The exit code is that of a back end."""
        faulty("collision", method, raised=raised)
        outcome = cli("search-optimal", board, "--collision", "faulty")
        assert 3 == outcome.code
        assert "'faulty' failed" in outcome.err
        assert NO_EXCEPTIONS[raised] in outcome.err

    def test_a_plugin_that_cannot_be_imported_is_broken(
        self, cli: Any, board: str, install: Any, raised: str
    ) -> None:
        """Importing runs its code, too."""
        install("solver", "faulty", "faulty_plugin:Faulty", f"raise {raised}")
        outcome = cli("search-optimal", board, "--solver", "faulty")
        assert 2 == outcome.code
        assert "cannot be imported" in outcome.err

    def test_a_kind_of_task_has_failed(
        self, cli: Any, tmp_path: Path, install: Any, raised: str
    ) -> None:
        """The file is named with it."""
        source = f"""
            from pydantic import BaseModel
            from skillplan import Domain

            class Config(BaseModel):
                kind: str

            class Faulty(Domain):
                kind = "faulty"
                Config = Config

                def ground(self, config, sha256=""):
                    raise {raised}
        """
        install("domain", "faulty", "faulty_plugin:Faulty", source)
        file = tmp_path / "task.yaml"
        file.write_text("kind: faulty\n")
        outcome = cli("check", str(file))
        assert 2 == outcome.code
        assert f"{file}: the kind 'faulty' failed: {NO_EXCEPTIONS[raised]} (" in outcome.err


@pytest.mark.parametrize(
    "raised",
    thinned(["SystemExit(0)", "KeyboardInterrupt"], "SystemExit(0)", why="one in every run"),
)
def test_nor_does_a_back_end_end_a_process_of_its_own(
    cli: Any, board: str, faulty: Any, raised: str
) -> None:
    """There, too, it has failed."""
    faulty("collision", "check", expensive=True, raised=raised)
    outcome = cli("search-optimal", board, "--collision", "faulty", "--jobs", "2", "--no-cache")
    assert 3 == outcome.code
    assert NO_EXCEPTIONS[raised] in outcome.err
