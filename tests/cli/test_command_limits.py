"""Limits of a whole command: it ends in time, with what there is or with one message."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skillplan.cli import Deadline
from skillplan.workers import measure_resident_bytes_of

SKILLPLAN = [sys.executable, "-m", "skillplan"]
LARGE = ("--parts", "40", "--density", "0.1", "--tools", "1", "--seed", "1")
SLOW = pytest.mark.slow(reason="starts a process more; two in every run")
COMMANDS = {
    "check": ("check", "TASK"),
    "plot": ("plot", "TASK", "precedence", "--out", "OUT.svg"),
    "report": ("report", "TASK", "--out", "OUT.html"),
    "simulate": ("simulate", "TASK", "--sequence", "0", "--trace", "OUT.csv"),
    "train": ("train", "TASK", "--out", "OUT"),
    "import-cad": ("import-cad", "PARTS", "--unit", "mm", "--out", "OUT"),
}


def words_of(name: str, board: str, folder: Path) -> list[str]:
    """Return a command line with real files in the places of TASK, PARTS and OUT."""
    parts = folder / "parts"
    parts.mkdir()
    for number in range(2):
        corners = [(x + 10 * number, y, z) for x in (0, 10) for y in (0, 10) for z in (0, 10)]
        faces = ((1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2))
        faces += ((3, 4, 8), (3, 8, 7), (1, 3, 7), (1, 7, 5), (2, 6, 8), (2, 8, 4))
        lines = ["v {} {} {}".format(*corner) for corner in corners]
        lines += ["f {} {} {}".format(*face) for face in faces]
        (parts / f"part_{number}.obj").write_text("\n".join(lines), "utf-8")
    places = {"TASK": board, "PARTS": str(parts)}
    return [places.get(word, word.replace("OUT", str(folder / "out"))) for word in COMMANDS[name]]


def fail_by_limit(words: list[str], environment: dict[str, str], folder: Path) -> str:
    """Return the only message of a command that its limit ends; it leaves nothing behind."""
    ended = subprocess.run(
        [*SKILLPLAN, *words], capture_output=True, text=True, env=environment, timeout=60
    )
    assert (2, "") == (ended.returncode, ended.stdout)
    assert 1 == ended.stderr.count("error: ")
    assert "Traceback" not in ended.stderr
    assert ["parts"] == [path.name for path in folder.iterdir()]
    return " ".join(ended.stderr.split())


@pytest.mark.skipif(not measure_resident_bytes_of(1), reason="the system does not report sizes")
@pytest.mark.parametrize(
    "name",
    [
        "plot",
        "report",
        *(pytest.param(item, marks=SLOW) for item in ("simulate", "train", "import-cad")),
    ],
)
def test_memory_of_a_whole_command_is_limited(name, board, environment, tmp_path):
    """Here by less than its libraries take."""
    words = [*words_of(name, board, tmp_path), "--memory-limit", "64MiB"]
    message = fail_by_limit(words, environment, tmp_path)
    assert "The command held more memory than --memory-limit, 64 MiB, and was ended." in message


@pytest.mark.parametrize("name", ["check", pytest.param("import-cad", marks=SLOW)])
def test_a_command_without_a_partial_result_ends_with_a_message(name, board, environment, tmp_path):
    words = [*words_of(name, board, tmp_path), "--time-limit", "0.01"]
    message = fail_by_limit(words, environment, tmp_path)
    assert "The command took longer than --time-limit 0.01 and was ended." in message


@pytest.mark.slow(reason="takes as long as its limit; one without pictures in every run")
def test_a_report_of_a_large_board_is_written_in_time(cli, environment, tmp_path):
    """What there is no time for is left out, and the page says so."""
    board, page = tmp_path / "board.yaml", tmp_path / "page.html"
    outcome = cli("generate", "assembly", *LARGE, "--out", str(board))
    assert 0 == outcome.code
    words = ["report", str(board), "--time-limit", "2", "--out", str(page)]
    begin_s = time.monotonic()
    ended = subprocess.run([*SKILLPLAN, *words], capture_output=True, text=True, env=environment)
    assert time.monotonic() - begin_s < 60, "not a minute, as without a limit"
    assert ended.returncode in (0, 2)
    assert ended.returncode == 2 or "--time-limit" in page.read_text("utf-8") + ended.stderr


def test_a_report_without_time_shows_what_there_is(cli, solved_board, tmp_path):
    """Neither simulation nor precedence, and it is told."""
    page = tmp_path / "page.html"
    outcome = cli("report", str(solved_board), "--time-limit", "0.001", "--out", str(page))
    assert page.exists()
    assert "the precedence relation is not derived: --time-limit was over" in outcome.err
    assert "it was left out, as --time-limit 0.001 was over" in page.read_text("utf-8")


class TestDeadline:
    def test_what_takes_longer_is_interrupted(self):
        """Also a loop that polls nothing; the handler of before is back after it."""
        before = signal.getsignal(signal.SIGALRM)
        deadline = Deadline(0.05, graceful=True)

        def count_for_ever() -> int:
            number = 0
            while True:
                number += 1

        assert deadline.attempt(count_for_ever) is None
        assert deadline.is_over()
        assert signal.getsignal(signal.SIGALRM) is before

    def test_what_is_in_time_is_returned(self):
        assert 3 == Deadline(60.0, graceful=True).attempt(lambda: 3)
        assert 3 == Deadline(None, graceful=True).attempt(lambda: 3)

    def test_an_attempt_within_another_has_its_own_share_of_the_time(self):
        """The inner one ends first, and the outer one is still interrupted."""
        deadline, ended = Deadline(0.5, graceful=True), []

        def attempt_inner() -> None:
            ended.append(deadline.attempt(lambda: time.sleep(10), 0.1))
            time.sleep(10)

        assert deadline.attempt(attempt_inner, 0.4) is None
        assert ended == [None]
        assert not deadline.is_over()

    def test_nothing_is_begun_after_it(self):
        deadline = Deadline(1e-9, graceful=True)
        assert deadline.attempt(lambda: pytest.fail("it was called")) is None

    def test_errors_are_raised_as_they_are(self):
        with pytest.raises(ZeroDivisionError):
            Deadline(60.0, graceful=True).attempt(lambda: 1 // 0)

    def test_a_share_of_the_time_is_never_more_than_there_is(self):
        assert Deadline(None, graceful=True).share_s() is None
        assert Deadline(None, graceful=True).share_s(most_s=10.0) == 10.0
        assert 5.0 < (Deadline(10.0, graceful=True).share_s(0.6) or 0.0) <= 6.0
        assert 0.0 < (Deadline(1e-9, graceful=True).share_s() or 0.0) <= 1e-3
