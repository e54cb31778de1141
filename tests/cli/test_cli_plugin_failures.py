"""Plugins of others that raise: named with the line of their own code, and no harm to the rest."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from skillplan.pipeline import registry
from thinned import slow_case, thinned

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
HANG = """
import time
while True:
    try:
        time.sleep(600)
    except BaseException:
        pass
"""
POLICY_THAT_EXITS = """
    def solve(self, model, *, seed=0):
        import sys
        from skillplan import Policy

        class Exiting(Policy):
            def get(self, state, default=None):
                sys.exit(0)

        return Solution(Exiting({}))
"""
PATIENCE_S = 60
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
def not_debugging(monkeypatch):
    """Whoever runs the tests may be debugging; the tests are not."""
    monkeypatch.delenv("SKILLPLAN_DEBUG", raising=False)


@pytest.fixture
def faulty(install):
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
    def test_it_is_named_with_its_own_line(self, cli, board, faulty, method):
        """Whatever of ours called it; the traceback is offered and not shown."""
        place = faulty("solver", method)
        refusal = cli("search-optimal", board, "--solver", "faulty").refusal
        assert (
            "skillplan: error: The solver 'faulty' failed: LookupError: no table "
            f"({place}; SKILLPLAN_DEBUG=1 shows the traceback)\n" == refusal
        )

    @pytest.mark.slow(reason="walks all sequences; a failed row is in every run")
    @pytest.mark.parametrize(
        "method",
        [
            "solve",
            slow_case("constructor", reason="walks the board again; a failing search in every run"),
        ],
    )
    def test_in_a_comparison_it_is_a_row_and_the_others_run_on(self, cli, board, faulty, method):
        """The exit code tells of it at the end."""
        place = faulty("solver", method)
        solvers = "exact,faulty,exhaustive"
        outcome = cli("compare", board, "--solvers", solvers, "--format", "json")
        rows = outcome.document["rows"]
        assert 2 == outcome.code
        assert ["optimal", "failed", "optimal"] == [row["status"] for row in rows]
        assert f"LookupError: no table ({place};" in rows[1]["reason"]
        assert "" == outcome.err

    def test_the_table_of_a_comparison_says_why(self, cli, board, faulty):
        """Below the rows, as of a refusal."""
        faulty("solver", "solve")
        outcome = cli("compare", board, "--solvers", "faulty,exact")
        assert 2 == outcome.code
        assert "failed" in outcome.out
        assert "LookupError: no table" in outcome.out

    def test_so_it_is_with_a_chain(self, cli, faulty, root):
        """The row of the chain names the task that it failed on."""
        faulty("solver", "solve")
        job = str(root / "configs" / "swarmitfix_cases.yaml")
        outcome = cli("compare", job, "--solvers", "faulty,exact", "--format", "json")
        failed, solved = outcome.document["rows"]
        assert 2 == outcome.code
        assert ("failed", "optimal") == (failed["status"], solved["status"])
        assert failed["reason"].startswith("base-1: The solver 'faulty' failed: LookupError")

    def test_debugging_shows_the_traceback(self, cli, board, faulty, monkeypatch):
        """After the message, and nothing offers it any more."""
        place = faulty("solver", "solve")
        monkeypatch.setenv("SKILLPLAN_DEBUG", "1")
        refusal = cli("search-optimal", board, "--solver", "faulty").refusal
        first, *rest = refusal.splitlines()
        assert first.endswith(f"failed: LookupError: no table ({place})")
        assert "Traceback (most recent call last):" == rest[0]
        assert "LookupError: no table" == rest[-1]

    def test_debugging_shows_it_in_a_comparison_too(self, cli, board, faulty, monkeypatch, caplog):
        """In the log; the document stays one."""
        faulty("solver", "solve")
        monkeypatch.setenv("SKILLPLAN_DEBUG", "1")
        outcome = cli("compare", board, "--solvers", "faulty", "--format", "json")
        assert "failed" == outcome.document["rows"][0]["status"]
        assert "Traceback (most recent call last):" in caplog.text

    def test_a_wrong_option_stops_a_comparison_before_it_starts(self, cli, board):
        """It is the user's to repair, and no row."""
        words = ("--solvers", "exact,exhaustive", "-O", "exact.max_labels=-1")
        assert "max_labels" in cli("compare", board, *words).refusal


class TestABackEnd:
    @pytest.mark.parametrize("method", ["check", "refuses", "constructor", "beside", "faults"])
    def test_it_is_named_with_its_own_line(self, cli, board, faulty, method):
        """Whenever it raises; the exit code is that of a back end."""
        place = faulty("collision", method)
        outcome = cli("search-optimal", board, "--collision", "faulty")
        assert 3 == outcome.code
        assert "'faulty' failed" in outcome.err
        assert outcome.err.endswith(
            f"LookupError: no table ({place}; SKILLPLAN_DEBUG=1 shows the traceback)\n"
        )

    def test_in_a_comparison_every_solver_that_meets_it_is_a_row(self, cli, board, faulty):
        """None of them ends the command; the exit code is that of a back end, as elsewhere."""
        place = faulty("collision", "check")
        solvers = ("--solvers", "exact,exhaustive")
        outcome = cli("compare", board, *solvers, "--collision", "faulty", "--format", "json")
        rows = outcome.document["rows"]
        assert 3 == outcome.code
        assert ["failed", "failed"] == [row["status"] for row in rows]
        assert all(place in row["reason"] for row in rows)

    @pytest.mark.slow(reason="a process; in this one in every run")
    def test_so_it_is_in_a_process_of_its_own(self, cli, board, faulty, monkeypatch):
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
    def _signals_are_heard_by_the_command_line(self):
        """As in a process of its own, where Ctrl-C is no KeyboardInterrupt of Python's making."""
        before = signal.signal(signal.SIGINT, lambda *_: None)
        yield
        signal.signal(signal.SIGINT, before)

    @pytest.mark.parametrize("method", ["solve", "refuses", "constructor"])
    def test_a_solver_has_failed(self, cli, board, faulty, method, raised):
        """It is named like one that raises an error; nothing ends without a word."""
        faulty("solver", method, raised=raised)
        assert (
            f"The solver 'faulty' failed: {NO_EXCEPTIONS[raised]} ("
            in cli("search-optimal", board, "--solver", "faulty").refusal
        )

    def test_the_other_solvers_of_a_comparison_run_on(self, cli, board, faulty, raised):
        """It is a row."""
        faulty("solver", "solve", raised=raised)
        outcome = cli("compare", board, "--solvers", "faulty,exact", "--format", "json")
        assert 2 == outcome.code
        assert ["failed", "optimal"] == [row["status"] for row in outcome.document["rows"]]

    @pytest.mark.parametrize("method", ["check", "refuses", "constructor", "beside", "faults"])
    def test_a_back_end_has_failed(self, cli, board, faulty, method, raised):
        """The exit code is that of a back end."""
        faulty("collision", method, raised=raised)
        outcome = cli("search-optimal", board, "--collision", "faulty")
        assert 3 == outcome.code
        assert "'faulty' failed" in outcome.err
        assert NO_EXCEPTIONS[raised] in outcome.err

    def test_a_plugin_that_cannot_be_imported_is_broken(self, cli, board, install, raised):
        """Importing runs its code, too."""
        install("solver", "faulty", "faulty_plugin:Faulty", f"raise {raised}")
        assert "cannot be imported" in cli("search-optimal", board, "--solver", "faulty").refusal

    def test_a_kind_of_task_has_failed(self, cli, tmp_path, install, raised):
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
        assert (
            f"{file}: the kind 'faulty' failed: {NO_EXCEPTIONS[raised]} ("
            in cli("check", str(file)).refusal
        )


@pytest.mark.parametrize(
    "raised",
    thinned(["SystemExit(0)", "KeyboardInterrupt"], "SystemExit(0)", why="one in every run"),
)
def test_nor_does_a_back_end_end_a_process_of_its_own(cli, board, faulty, raised):
    """There, too, it has failed."""
    faulty("collision", "check", expensive=True, raised=raised)
    outcome = cli("search-optimal", board, "--collision", "faulty", "--jobs", "2", "--no-cache")
    assert 3 == outcome.code
    assert NO_EXCEPTIONS[raised] in outcome.err


ENDINGS = {
    "exit": ("import os; os._exit(0)", "exit code 0"),
    "crash": ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "signal 11 (SIGSEGV)"),
}


def run_process(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own."""
    command = [sys.executable, "-m", "skillplan", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)


@pytest.fixture
def ending(install):
    """Install a plugin that executes something in one method, or on import."""

    def put(kind: str, method: str, text: str) -> None:
        source = (SOLVER if kind == "solver" else DETECTOR).replace("DEAR", "False")
        if kind == "solver" and method != "solve":
            source += REST_OF_A_SOLVER
        if method == "import":
            source = f"{text}\n{source}"
        else:
            source += f"\n    {RAISES[method]}\n        {text}\n"
        install(kind, "faulty", "faulty_plugin:Faulty", source)

    return put


class TestTheProcess:
    """Run as a user does: a plugin acts on the process in which the command runs."""

    @pytest.mark.parametrize("end", ["exit", "crash"])
    @pytest.mark.parametrize(
        ("kind", "method", "code", "where"),
        [
            ("solver", "import", 2, "the import of the solver 'faulty' of faulty-plugin 1.5"),
            ("solver", "solve", 3, "the search by the solver 'faulty' with kinematic, precedence"),
            ("collision", "check", 3, "a check of pick(pcb) by the back end 'faulty'"),
        ],
    )
    def test_that_ends_without_an_answer_has_failed(
        self, board, ending, end, kind, method, code, where
    ):
        """With exit code 0 of its own as with a crash; the document is that of an error."""
        text, how = ENDINGS[end]
        ending(kind, method, text)
        words = ("search-optimal", board, f"--{kind}", "faulty", "--format", "json")
        done = run_process(*words)
        message = f"The process ended without an answer, by {how} in {where}"
        assert code == done.returncode
        assert done.stderr.startswith(f"skillplan: error: {message}")
        document = json.loads(done.stdout)
        assert ("skillplan.error/1", code) == (document["schema"], document["exit_code"])
        assert document["message"].startswith(message)

    @pytest.mark.slow(reason="many processes; search-optimal in every run")
    @pytest.mark.parametrize(
        "words",
        [
            ("check", "BOARD", "--collision", "faulty"),
            ("evaluate", "BOARD", "--sequence", "0,1,2", "--collision", "faulty"),
            ("compare", "BOARD", "--solvers", "exact,greedy", "--collision", "faulty"),
            ("chart", "BOARD", "--collision", "faulty"),
            ("train", "BOARD", "--steps", "200", "--collision", "faulty", "--out", "NEW"),
            ("report", "BOARD", "--collision", "faulty", "--out", "NEW.html"),
            ("sweep", "BOARD", "--collision", "faulty", "-O", "episodes=9,10", "--out", "NEW"),
        ],
        ids=lambda words: words[0],
    )
    def test_so_it_is_in_every_command(self, board, ending, tmp_path, words):
        """Nothing is written."""
        ending("collision", "check", ENDINGS["exit"][0])
        new = str(tmp_path / "new")
        done = run_process(*(word.replace("BOARD", board).replace("NEW", new) for word in words))
        assert (3, "") == (done.returncode, done.stdout)
        assert "by exit code 0 in a check of " in done.stderr
        assert not (tmp_path / "new.html").exists()

    def test_prints_nothing_into_a_document(self, board, ending):
        """Neither through Python, nor the file descriptor, nor a program that it starts."""
        text = "import os; print('print'); os.write(1, b'raw\\n'); os.system('echo program')"
        ending("collision", "check", f"{text}; return Verdict.feasible()")
        words = ("--collision", "faulty", "--set", "step_limit=15", "--format", "json")
        done = run_process("search-optimal", board, *words)
        assert 0 == done.returncode
        assert "optimal" == json.loads(done.stdout)["status"]
        assert {"print", "raw", "program"} == set(done.stderr.split())

    @pytest.mark.slow(reason="waits two seconds; limits of activities in every run")
    def test_does_not_hang_on_import_past_the_time_limit(self, board, ending):
        """Though it swallows every exception."""
        ending("solver", "import", HANG)
        done = run_process("search-optimal", board, "--solver", "faulty", "--time-limit", "0.1")
        assert (2, "") == (done.returncode, done.stdout)
        assert done.stderr == (
            "skillplan: error: Stopped by the time limit: the import of the solver 'faulty' of "
            "faulty-plugin 1.5 (faulty_plugin:Faulty) took longer than 2.1 s and was ended.\n"
        )

    @pytest.mark.slow(reason="waits three seconds; a program that hangs in every run")
    @pytest.mark.parametrize(
        ("words", "number"),
        [
            (("search-optimal", "BOARD", "--solver", "faulty"), signal.SIGINT),
            (("plugins",), signal.SIGTERM),
            (("compare", "BOARD", "--solvers", "faulty"), signal.SIGHUP),
        ],
        ids=["search-optimal", "plugins", "compare"],
    )
    def test_that_hangs_is_ended_by_the_first_signal(self, board, ending, words, number):
        """Within four seconds, though it swallows every exception."""
        ending("solver", "import", f"import sys; print('hangs', file=sys.stderr)\n{HANG}")
        line = [word.replace("BOARD", board) for word in words]
        command = [sys.executable, "-m", "skillplan", *line]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        with process:
            assert process.stderr is not None
            assert "hangs\n" == process.stderr.readline()
            process.send_signal(number)
            out, err = process.communicate(timeout=PATIENCE_S)
        assert (130, "", "skillplan: interrupted\n") == (process.returncode, out, err)

    def test_whose_policy_ends_the_program_is_named(self, cli, board, install):
        """`SystemExit` of a policy is a failure of the solver as any exception is."""
        source = SOLVER + POLICY_THAT_EXITS
        install("solver", "faulty", "faulty_plugin:Faulty", source)
        outcome = cli("search-optimal", board, "--solver", "faulty")
        assert 2 == outcome.code
        assert "SystemExit" in outcome.out + outcome.err
        assert "internal error" not in outcome.err


class TestADistributionWhoseEntryPointsCannotBeRead:
    @pytest.mark.parametrize(
        "content",
        [b"\xff\xfe\x00[[[\n=\n", b"[skillplan.solver]\nno value\n"],
        ids=["bytes", "syntax"],
    )
    def test_it_stops_nothing_and_is_listed(self, cli, board, install, content):
        """As broken, with the reason."""
        folder = install("solver", "faulty", "faulty_plugin:Faulty", SOLVER + REST_OF_A_SOLVER)
        (folder / "faulty_plugin-1.5.dist-info" / "entry_points.txt").write_bytes(content)
        registry.refresh()
        assert 0 == cli("search-optimal", board).code
        listed = cli("plugins", "--format", "json").document["plugins"]
        (broken,) = [row for row in listed if row["distribution"] == "faulty-plugin"]
        assert ("unknown", "1.5") == (broken["kind"], broken["version"])
        assert broken["problem"].startswith("its entry_points.txt cannot be read: ")

    @pytest.mark.slow(reason="loads numba and networkx; the command itself in every run")
    def test_libraries_that_read_entry_points_work(self, install):
        """Which they do when they are imported."""
        folder = install("solver", "faulty", "faulty_plugin:Faulty", SOLVER + REST_OF_A_SOLVER)
        path = folder / "faulty_plugin-1.5.dist-info" / "entry_points.txt"
        path.write_bytes(b"\xff")
        code = "from skillplan.plugins import installed; print(len(installed.unreadable()))"
        code += "; import numba, networkx"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert (0, "1\n") == (done.returncode, done.stdout), done.stderr
