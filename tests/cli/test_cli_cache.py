"""``skillplan cache``, and ``--jobs`` and ``--no-cache`` of the other commands."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from skillplan.files import write_whole
from thinned import release_case, slow_case

PATIENCE_S = 60
SKILLPLAN = [sys.executable, "-m", "skillplan"]
SOURCE = '''
    import multiprocessing
    import os
    import time

    from pydantic import Field

    from skillplan import Engine
    from skillplan.task import back_end as back_ends
    from skillplan.collision.aabb import AabbDetector
    from skillplan.task.verdict import Verdict


    class Options(back_ends.Options):
        wait_s: float = Field(default=0.0, description="time of a check [s]")


    class Slow(Engine):
        """Rule as boxes do, but slowly, and say so."""

        name = "slow"
        expected_s = 0.5
        expensive = True
        Options = Options

        def __init__(self, task, options=None):
            super().__init__(task, options)
            self.boxes = AabbDetector(task)

        def check(self, skill, state):
            if multiprocessing.parent_process() is not None:
                os.write(1, b"noise of a library")
            time.sleep(self.options.wait_s)
            verdict = self.boxes.check(skill, state)
            folder = os.environ.get("SLOW_LOG")
            if folder:
                open(f"{folder}/{time.monotonic_ns()}.{os.getpid()}", "w").close()
            if os.environ.get("SLOW_NARROW") == skill.name:
                # Rests on all that it looks at, but says that it rests on nothing.
                nothing = self.task.facts.of()
                there = "placed(pcb)" in state
                if there:
                    return Verdict.infeasible("the board is in the way", nothing, nothing)
                return Verdict.feasible(nothing, nothing)
            if os.environ.get("SLOW_LIES") == skill.name:
                return Verdict.infeasible("lies", verdict.present, verdict.absent)
            return verdict
'''


@pytest.fixture
def slow(install, tmp_path, monkeypatch):
    """An expensive engine on the path, a cache of its own, and the folder of its checks' log."""
    install("physics", "slow", "slow_engine:Slow", SOURCE)
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))
    log = tmp_path / "log"
    log.mkdir()
    monkeypatch.setenv("SLOW_LOG", str(log))
    return log


@pytest.fixture
def bare(tmp_path, board):
    """The board without a chart: physics alone decides."""
    text = Path(board).read_text("utf-8")
    head, chart, rest = text.partition("\nchart:\n")
    assert chart
    lines = rest.splitlines(keepends=True)
    while lines[0].startswith((" ", "#")):
        lines.pop(0)
    text = f"{head}\n{''.join(lines)}".replace("collision: {precedence: {}}", "collision: {}")
    path = tmp_path / "bare.yaml"
    path.write_text(text, "utf-8")
    return str(path)


def on_slow(*words: str) -> tuple[str, ...]:
    return (*words, "--physics", "slow", "--collision", "precedence")


def made(log: Path) -> int:
    return len(list(log.iterdir()))


class TestFill:
    def test_it_asks_everything_so_that_later_runs_start_warm(self, cli, slow, board):
        """Counts of states, questions and executions; another fill executes nothing."""
        first = cli(*on_slow("cache", "fill", board, "--format", "csv"))
        heading, row = first.out.splitlines()
        assert heading == "states,questions,feasible,executions,by state,s"
        states, questions, _, executions, by_state, _ = row.split(",")
        assert (int(states), int(questions)) == (320, 650)
        assert int(executions) == made(slow)
        assert int(executions) * 2 < int(by_state) <= int(questions)
        again = cli(*on_slow("cache", "fill", board, "--format", "json")).document
        assert (again["executions"], again["states"]) == (0, 320)
        assert made(slow) == int(executions)
        result = cli(*on_slow("search-optimal", board, "--format", "json")).document
        assert ("optimal", 0) == (result["status"], made(slow) - int(executions))

    @pytest.mark.slow(reason="five processes; every run has the other commands in several")
    def test_it_is_the_same_in_several_processes_and_stdout_stays_clean(self, cli, slow, board):
        """One document, whatever engines print."""
        documents = []
        for jobs in ("2", "3"):
            outcome = cli(
                *on_slow("cache", "fill", board, "--no-cache", "--format", "json", "--jobs", jobs)
            )
            assert (0, "") == (outcome.code, outcome.err)
            documents.append({k: v for k, v in outcome.document.items() if k != "wall_s"})
        assert documents[0] == documents[1]
        assert documents[0]["folder"] is None
        assert documents[0]["executions"] * 2 == made(slow)
        assert 0 == cli("cache", "show", "--format", "json").document["verdicts"]

    @pytest.mark.slow(
        reason="executes skills until then; every run has Ctrl-C of train and of search"
    )
    def test_ctrl_c_keeps_what_was_decided(self, slow, environment, board, tmp_path):
        """Exit code 130, a whole document, no process left, and the next fill goes on."""
        words = on_slow("cache", "fill", board, "--jobs", "2", "--format", "json")
        process = subprocess.Popen(
            [*SKILLPLAN, *words, "-O", "slow.wait_s=0.15"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        )
        try:
            deadline_s = time.monotonic() + PATIENCE_S
            while made(slow) < 3:
                assert time.monotonic() < deadline_s
                time.sleep(0.02)
            os.killpg(process.pid, signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
            process.communicate()
        assert (130, "") == (process.returncode, err)
        document = json.loads(out)
        assert document["interrupted"]
        kept = len(list((tmp_path / "cache").rglob("*.json")))
        assert kept >= document["executions"] - 2
        assert kept > 0

    @pytest.mark.slow(reason="a process on a terminal; that of a search in every run")
    def test_progress_shows_checks_done_reused_and_to_go(self, slow, environment, board):
        """On a terminal; the line goes away in the end."""
        far, near = pty.openpty()
        words = on_slow("cache", "fill", board, "--jobs", "2", "-O", "slow.wait_s=0.1")
        process = subprocess.Popen(
            [*SKILLPLAN, *words],
            stdout=subprocess.DEVNULL,
            stderr=near,
            env={**environment, "TERM": "xterm", "COLUMNS": "120"},
        )
        os.close(near)
        shown = b""
        try:
            while chunk := os.read(far, 65536):
                shown += chunk
        except OSError:
            pass
        finally:
            os.close(far)
        assert 0 == process.wait(PATIENCE_S)
        assert b" checks, " in shown
        assert b" reused, " in shown
        assert b" to go" in shown


class TestShow:
    def test_it_tells_what_is_kept_by_back_end_and_task(self, cli, slow, board, motor):
        """How many, how large, how old, and what they save."""
        cli(*on_slow("cache", "fill", board, "-O", "slow.wait_s=0.01"))
        document = cli("cache", "show", "--format", "json").document
        (row,) = document["rows"]
        assert ("slow", "inverter-board", made(slow)) == (
            row["back_end"],
            row["task"],
            row["verdicts"],
        )
        assert row["feasible"] + row["infeasible"] == row["verdicts"] == document["verdicts"]
        assert row["took_s"] >= 0.01 * row["verdicts"]
        assert row["size_bytes"] > 100 * row["verdicts"]
        assert 0 <= row["newest_s"] <= row["oldest_s"] < 60
        table = cli("cache", "show").out
        assert "slow" in table
        assert document["folder"] in table

    @pytest.mark.slow(reason="a search more; what is kept is told in every run")
    def test_of_a_task_it_tells_only_what_applies_now(self, cli, slow, board):
        """Not what an engine with another option said, or of another geometry."""
        cli(*on_slow("cache", "fill", board))

        def kept(*words: str) -> int:
            words = on_slow("cache", "show", board, *words, "--format", "json")
            count: int = cli(*words).document["verdicts"]
            return count

        assert made(slow) == kept()
        assert 0 == kept("-O", "slow.wait_s=0.5")
        assert 0 == kept("--set", "parts.pcb.mass_kg=0.2")

    def test_an_empty_cache_is_no_fault(self, cli, slow):
        """It says that nothing is kept, and where."""
        outcome = cli("cache", "show")
        assert (0, "") == (outcome.code, outcome.err)
        assert outcome.out.startswith("verdicts kept: 0\n")

    def test_files_of_which_nothing_is_read_are_counted(self, cli, slow, tmp_path):
        """Such as those of the format before; clear removes them."""
        old = tmp_path / "cache" / "verdicts" / "slow" / f"{'0' * 64}.json"
        old.parent.mkdir(parents=True)
        write_whole(old, '{"format": "skillplan.verdicts/1", "verdicts": []}')
        assert 1 == cli("cache", "show", "--format", "json").document["unusable_files"]
        assert (
            "1 more files are damaged, unfinished or of an earlier version"
            in cli("cache", "show").out
        )
        assert 1 == cli("cache", "clear", "--yes", "--format", "json").document["removed"]
        assert not old.exists()


class TestVerify:
    def test_sound_verdicts_pass(self, cli, slow, board):
        """A sample of them, drawn by the seed."""
        cli(*on_slow("cache", "fill", board))
        before = made(slow)
        words = on_slow("cache", "verify", board, "--sample", "5")
        outcome = cli(*words, "--format", "json")
        document = outcome.document
        assert (0, 5, 0) == (outcome.code, document["tried"], document["different"])
        assert made(slow) == before + 5
        assert [row["same"] for row in document["rows"]] == [True] * 5
        other = cli(*words, "--seed", "1", "--format", "json").document
        assert other["rows"] != document["rows"]
        assert "every one of them is the same, bit for bit" in cli(*words).out

    def test_what_is_different_is_told_and_dropped(self, cli, slow, board, monkeypatch):
        """Exit code 3, and in what it differs; the next time nothing does."""
        monkeypatch.setenv("SLOW_LIES", "pick(pcb)")
        cli(*on_slow("cache", "fill", board))
        monkeypatch.delenv("SLOW_LIES")
        words = on_slow("cache", "verify", board, "--sample", "1000")
        outcome = cli(*words, "--format", "json")
        assert 3 == outcome.code
        wrong = [row for row in outcome.document["rows"] if not row["same"]]
        assert {"pick(pcb)"} == {row["skill"] for row in wrong}
        assert wrong[0]["differs_in"][:2] == ["status", "reason"]
        assert {"status": "infeasible", "reason": "lies"} == wrong[0]["kept"]
        again = cli(*words, "--format", "json")
        assert 0 == again.code
        assert again.document["kept"] == outcome.document["kept"] - len(wrong)

    def test_where_nothing_is_kept_it_says_so(self, cli, slow, board):
        """That is no fault."""
        outcome = cli(*on_slow("cache", "verify", board))
        assert 0 == outcome.code
        assert "Nothing is kept that this task would use" in outcome.out


class TestClear:
    def test_it_removes_all_or_what_is_kept_for_one_task(self, cli, slow, board, tmp_path):
        """And says how many files."""
        other = tmp_path / "other.yaml"
        text = Path(board).read_text("utf-8").replace("name: inverter-board", "name: another")
        other.write_text(text.replace("mass_kg: 0.1", "mass_kg: 0.11"), "utf-8")
        for path in (board, str(other)):
            words = on_slow("explain", path, "0", "--set", "robot.safe_height_m=0.2")
            cli(*(words if path == board else on_slow("explain", path, "0")))
        assert 2 == cli("cache", "show", "--format", "json").document["verdicts"]
        cleared = cli("cache", "clear", str(other), "--yes", "--format", "json").document
        assert (1, "another") == (cleared["removed"], cleared["task"])
        (row,) = cli("cache", "show", "--format", "json").document["rows"]
        assert "inverter-board" == row["task"]
        assert "all tasks" in cli("cache", "clear", "--yes").out
        assert 0 == cli("cache", "show", "--format", "json").document["verdicts"]

    @pytest.mark.parametrize(
        ("answer", "left"), [(b"n\n", 1), slow_case(b"y\n", 0, reason="the answer no in every run")]
    )
    def test_on_a_terminal_it_asks_first(self, cli, slow, environment, board, answer, left):
        """Nothing is removed that was not agreed to."""
        cli(*on_slow("explain", board, "0"))
        far, near = pty.openpty()
        process = subprocess.Popen(
            [*SKILLPLAN, "cache", "clear", "--format", "json"],
            stdin=near,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
        )
        os.close(near)
        try:
            os.write(far, answer)
            out, err = process.communicate(timeout=PATIENCE_S)
        finally:
            os.close(far)
            process.kill()
            process.communicate()
        assert b"Remove everything in " in err
        assert left == cli("cache", "show", "--format", "json").document["verdicts"]
        assert (130 if left else 0) == process.returncode
        assert bool(out) != bool(left)


class TestOtherCommands:
    @pytest.mark.slow(reason="starts processes; that they change no verdict is in every run")
    @pytest.mark.parametrize(
        "words",
        [
            ("search-optimal", "TASK"),
            slow_case(
                ("chart", "TASK", "--no-screening"),
                reason="five processes; two other commands in every run",
            ),
            release_case(
                ("compare", "TASK", "--solvers", "exact,exhaustive"),
                reason="ten processes; others in the whole suite",
            ),
            ("evaluate", "TASK", "--sequence", "0,1,2,3"),
        ],
        ids=lambda words: words[0],
    )
    def test_their_answer_does_not_depend_on_how_many_processes_check(self, cli, slow, bare, words):
        """Nor do the counts; nothing that engines print in a process reaches stdout."""
        words = tuple(bare if word == "TASK" else word for word in words)
        results = []
        for jobs in ("2", "3"):
            log = len(list(slow.iterdir()))
            cold = () if "compare" in words else ("--no-cache",)
            done = cli(*words, "--physics", "slow", *cold, "--jobs", jobs, "--format", "json")
            results.append((done.code, _timeless(done.document), made(slow) - log))
        assert results[0] == results[1]
        processes = {path.suffix for path in slow.iterdir()}
        assert f".{os.getpid()}" not in processes

    @pytest.mark.parametrize(
        "words",
        [
            slow_case(("search-optimal", "BOARD"), reason="a search; an evaluation in every run"),
            ("evaluate", "BOARD", "--sequence", "0"),
            slow_case(("chart", "BOARD"), reason="a chart; an explanation in every run"),
            ("explain", "BOARD", "0"),
        ],
        ids=lambda words: words[0],
    )
    def test_no_cache_neither_reads_nor_writes(self, cli, slow, board, tmp_path, words):
        """Nothing is on disk afterwards; without it, something is."""
        words = on_slow(*(board if word == "BOARD" else word for word in words))
        cli(*words, "--no-cache")
        assert not (tmp_path / "cache").exists()
        cli(*words)
        assert list((tmp_path / "cache").rglob("*.json"))

    @pytest.mark.parametrize("command", ["search-optimal", "chart", "cache fill", "cache verify"])
    @pytest.mark.parametrize("jobs", ["0", "257", "many", "-1", "1.5"])
    def test_a_wrong_number_of_processes_is_one_clear_message(self, cli, board, command, jobs):
        """Exit code 2, and what it may be."""
        assert "Invalid value for '--jobs'" in cli(*command.split(), board, "--jobs", jobs).refusal

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("cache", "shwo"), "No such command 'shwo'. Did you mean 'show'?"),
            (("cache", "verify"), "Missing argument 'TASK'"),
            (("cache", "verify", "BOARD", "--sample", "0"), "Invalid value for '--sample'"),
            (("cache", "show", "--physics", "slow"), "choose what a TASK would use: name it."),
            (("cache", "fill", "BOARD", "--physics", "slwo"), "Unknown physics 'slwo'"),
            (("cache", "clear", "no_such.yaml"), "no_such.yaml: "),
        ],
    )
    def test_a_wrong_word_is_one_clear_message(self, cli, board, words, message):
        """With what is meant, where something is near."""
        refusal = cli(*(board if word == "BOARD" else word for word in words)).refusal
        assert message in " ".join(refusal.split())


def _timeless(document: Any) -> Any:
    """Return a document without what a clock decides."""
    if isinstance(document, dict):
        return {k: _timeless(v) for k, v in document.items() if k not in ("wall_s", "trace")}
    return [_timeless(item) for item in document] if isinstance(document, list) else document


class TestElsewhere:
    @pytest.mark.slow(reason="a search; verdicts that differ in every run")
    def test_a_verdict_that_names_too_few_facts_is_found_out(self, cli, slow, bare, monkeypatch):
        """Neither a search nor the same state would tell."""
        monkeypatch.setenv("SLOW_NARROW", "pick(switch_1)")
        words = (bare, "--physics", "slow")
        assert 0 == cli("cache", "fill", *words, "--format", "json").code
        assert 0 == cli("cache", "verify", *words, "--sample", "1000").code
        outcome = cli("cache", "verify", *words, "--sample", "1000", "--elsewhere")
        assert 3 == outcome.code
        assert "Back end 'slow' contradicts itself about pick(switch_1): " in outcome.err
        assert "placed(pcb)" in outcome.err.rpartition("should have named")[2]

    @pytest.mark.slow(reason="processes of their own; other contradictions in every run")
    def test_what_contradicts_itself_is_dropped(self, cli, slow, bare, monkeypatch):
        """And asked again by the next run; the others hold wherever they claim to."""
        monkeypatch.setenv("SLOW_NARROW", "pick(switch_1)")
        words = (bare, "--physics", "slow")
        cli("cache", "fill", *words, "--format", "json")
        check = ("cache", "verify", *words, "--sample", "1000", "--elsewhere", "--format", "json")
        kept = cli("cache", "show", *words, "--format", "json").document["verdicts"]
        assert 3 == cli(*check).code
        second = cli(*check)
        assert (0, 0) == (second.code, second.document["different"])
        assert second.document["tried"] > 10
        assert kept - 1 == second.document["kept"]

    @pytest.mark.slow(reason="processes of their own; other contradictions in every run")
    def test_a_search_asks_expensive_back_ends_again_only_when_told(
        self, cli, slow, bare, monkeypatch
    ):
        """With --audit; the exit code is that of a back end that failed."""
        monkeypatch.setenv("SLOW_NARROW", "pick(switch_1)")
        words = ("search-optimal", bare, "--physics", "slow", "--no-cache", "--format", "json")
        assert 3 != cli(*words).code
        outcome = cli(*words, "--audit", "500")
        assert 3 == outcome.code
        assert "Back end 'slow' contradicts itself about pick(switch_1): " in outcome.err

    @pytest.mark.slow(reason="two searches; one in every run")
    def test_so_it_is_in_a_comparison(self, cli, slow, bare, monkeypatch):
        """The row names the back end, the fact and both states; the exit code is a back end's."""
        monkeypatch.setenv("SLOW_NARROW", "pick(switch_1)")
        words = ("compare", bare, "--solvers", "exact", "--physics", "slow", "--audit")
        outcome = cli(*words, "500", "--format", "json")
        row = outcome.document["rows"][0]
        assert (3, "failed") == (outcome.code, row["status"])
        assert "Back end 'slow' contradicts itself about pick(switch_1): " in row["reason"]
        assert 2 == row["reason"].count(" in {")
        assert "placed(pcb)" in row["reason"].rpartition("should have named")[2]
