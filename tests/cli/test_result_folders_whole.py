"""The folder of a result is written as one: whole, by one search, with the document last."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from same_process import studies_in_this_process
from skillplan.files import FolderLock, write_as_one
from thinned import thinned

ROOT = Path(__file__).parents[2]
BOARD = str(ROOT / "configs" / "inverter_board.yaml")
STUDY = ("sweep", BOARD, "-O", "episodes=20", "--runs", "1")
EXACT = ("--solver", "exact")
WHOLE = ["plan.csv", "result.json"]


class Killed(BaseException):
    """Stands for SIGKILL: nothing that would be done after it is done."""


def names(folder: Path) -> list[str]:
    """Return what a folder holds."""
    return sorted(path.name for path in folder.iterdir())


def search(cli: Any, folder: Path) -> Any:
    """Search with a folder for the result."""
    return cli("search-optimal", BOARD, *EXACT, "--out", str(folder))


def killed_at(
    nth: int, monkeypatch: pytest.MonkeyPatch, write: Callable[[], object]
) -> Exception | None:
    """Call what writes, and end it at its n-th write, rename, unlink or fsync, as SIGKILL does."""
    counted = 0

    def counting(call: Any) -> Any:
        def do(*args: Any, **more: Any) -> Any:
            nonlocal counted
            counted += 1
            if counted >= nth:
                raise Killed
            return call(*args, **more)

        return do

    with monkeypatch.context() as patch:
        for name in ("fsync", "replace", "unlink", "open"):
            patch.setattr(os, name, counting(getattr(os, name)))
        try:
            write()
        except Killed:
            return None
    return RuntimeError("it came to its end")


class TestTwoSearches:
    def test_the_second_is_told_and_touches_nothing(self, cli, tmp_path):
        """While the first one searches."""
        folder = tmp_path / "run"
        folder.mkdir()
        lock = FolderLock(folder, "search")
        try:
            outcome = search(cli, folder)
        finally:
            lock.release()
        assert (2, "") == (outcome.code, outcome.out)
        assert ["another search is writing there just now."] == [
            line.partition("run: ")[2] for line in outcome.err.splitlines()
        ]
        assert [] == names(folder)

    def test_the_lock_is_held_from_before_the_search_until_all_is_written(
        self, cli, tmp_path, monkeypatch
    ):
        """A second search at the last rename is refused, and the first result is whole."""
        folder = tmp_path / "run"
        seen: list[None] = []
        replace = os.replace

        def interrupted(source: Any, target: Any) -> None:
            if Path(target).name == "result.json" and not seen:
                seen.append(None)
                with pytest.raises(Exception, match="another search is writing there just now"):
                    FolderLock(folder, "search")
                seen.append(None)
            replace(source, target)

        monkeypatch.setattr(os, "replace", interrupted)
        assert 0 == search(cli, folder).code
        assert 2 == len(seen)
        assert WHOLE == names(folder)

    def test_of_two_at_once_one_succeeds(self, tmp_path):
        """However they meet."""
        from skillplan.cli import ResultFolder
        from skillplan.errors import OptionError

        folder, messages, start = tmp_path / "run", [], threading.Barrier(4)

        def write(text: str) -> None:
            start.wait()
            try:
                with ResultFolder(str(folder)) as opened:
                    opened.finish({"plan.csv": text}, text)
            except OptionError as error:
                messages.append(str(error))

        threads = [threading.Thread(target=write, args=(str(n),)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert 3 == len(messages)
        assert all(
            "another search is" in message or "is not empty" in message for message in messages
        )
        assert (folder / "plan.csv").read_text() == (folder / "result.json").read_text()

    def test_a_finished_result_is_never_touched(self, cli, solved_board):
        """By a second search with the same folder."""
        before = {path: path.stat().st_mtime_ns for path in solved_board.iterdir()}
        outcome = search(cli, solved_board)
        assert 2 == outcome.code
        assert "is not empty. Name a new folder." in outcome.err
        assert before == {path: path.stat().st_mtime_ns for path in solved_board.iterdir()}


class TestKilledSearches:
    def test_wherever_it_is_killed_the_folder_is_whole_or_known_to_be_none(
        self, cli, tmp_path, monkeypatch
    ):
        """A killed one is told by those that read, and may be repeated into the same folder."""
        from skillplan.cli import ResultFolder
        from skillplan.records import check_finished

        texts = {"plan.csv": "plan\n", "policies.json": "{}", "timeline.csv": "time\n"}
        states = set()
        for nth in range(1, 100):
            folder = tmp_path / f"killed-{nth}"
            folder.mkdir()
            whole = self._left(folder, {**texts, "result.json": "{}"}, nth, monkeypatch)
            if whole:
                break
            states.add(tuple(name for name in names(folder) if not name.startswith(".")))
            if (folder / "result.json").exists():
                assert sorted([*texts, "result.json"]) == names(folder)
                continue
            with pytest.raises(Exception, match="has not finished"):
                check_finished(str(folder))
            with ResultFolder(str(folder)) as opened:
                assert [] == names(folder)
                opened.finish(texts, "{}")
            assert sorted([*texts, "result.json"]) == names(folder)
        assert nth > 15
        # It was killed between any two of the renames.
        assert {0, 1, 2, 3, 4} == {len(state) for state in states}

    def _left(
        self, folder: Path, contents: dict[str, str], nth: int, patch: pytest.MonkeyPatch
    ) -> bool:
        """Write and be killed; nothing is tidied up after the kill, as that unlinks, too."""
        return (
            killed_at(nth, patch, lambda: write_as_one(folder, contents, within=folder)) is not None
        )

    @pytest.mark.parametrize("command", ["verify", "evaluate", "plot", "simulate"])
    @pytest.mark.parametrize("left", [(), (".result.json.0123456789abcdef.tmp", "plan.csv")])
    def test_who_reads_an_unfinished_folder_says_so(self, cli, tmp_path, command, left):
        """In one message, and what to do."""
        folder = tmp_path / "run"
        folder.mkdir()
        for name in left:
            (folder / name).write_text("index,skill\n")
        more = ("rewards",) if command == "plot" else ()
        outcome = cli(command, str(folder), *more)
        assert (2, "", 1) == (outcome.code, outcome.out, len(outcome.err.splitlines()))
        lacks = "holds no result.json" if left else "is empty"
        assert f"{folder}: {lacks}: the command that was to write there has not" in outcome.err
        assert "Repeat it with the same --out." in outcome.err

    def test_the_command_is_repeated_into_it_and_leftovers_go(self, cli, tmp_path):
        """Of the killed search."""
        folder = tmp_path / "run"
        folder.mkdir()
        for name in (".result.json.0123456789abcdef.tmp", ".plan.csv.00ff.tmp", "plan.csv"):
            (folder / name).write_text("old")
        assert 0 == search(cli, folder).code
        assert WHOLE == names(folder)
        assert 0 == cli("verify", str(folder)).code

    @pytest.mark.parametrize(
        "left",
        [
            ("plan.csv",),
            (".result.json.00ff.tmp", "letter.txt"),
            (".result.json.00ff.tmp", ".letter.tmp"),
            ("policies.json", ".plan.csv.00ff.tmp"),
        ],
    )
    def test_what_no_killed_search_has_left_stays(self, cli, tmp_path, left):
        """A file of somebody else's may have the same name as one of ours."""
        for name in left:
            (tmp_path / name).write_text("expensive")
        outcome = search(cli, tmp_path)
        assert 2 == outcome.code
        assert "is not empty. Name a new folder." in outcome.err
        assert sorted(left) == names(tmp_path)


class TestFullDisks:
    @pytest.mark.parametrize(
        "call", thinned(["fsync", "replace"], "replace", why="the other in every run")
    )
    def test_nothing_is_left_and_the_command_may_be_repeated(
        self, cli, tmp_path, monkeypatch, call
    ):
        """At any of the files; the message names it."""
        folder, message = tmp_path / "run", set()
        real = getattr(os, call)
        for nth in range(1, 12):
            counted = iter(range(1, 1000))

            def full(*args: Any, nth: int = nth, counted: Any = counted, **more: Any) -> Any:
                if next(counted) == nth:
                    raise OSError(28, "No space left on device")
                return real(*args, **more)

            with monkeypatch.context() as patch:
                patch.setattr(os, call, full)
                outcome = search(cli, folder)
            if outcome.code == 0:
                break
            assert (2, [], "") == (outcome.code, names(folder), outcome.out)
            assert "cannot be written: No space left on device." in outcome.err
            message.add(outcome.err.partition("run: ")[2].partition(" ")[0])
        assert {"plan.csv", "result.json"} <= message
        assert WHOLE == names(folder)

    def test_an_earlier_document_stays_where_there_is_no_room_for_the_next(
        self, tmp_path, monkeypatch
    ):
        """Of what is resumed: old and new never stand side by side."""
        write_as_one(tmp_path, {"a.csv": "old", "result.json": "old"}, within=tmp_path)

        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", full)
            with pytest.raises(OSError, match="No space"):
                write_as_one(tmp_path, {"a.csv": "new", "result.json": "new"}, within=tmp_path)
        assert ["a.csv", "result.json"] == names(tmp_path)
        assert {"old"} == {path.read_text() for path in tmp_path.iterdir()}

    def test_old_and_new_never_stand_side_by_side(self, tmp_path, monkeypatch):
        """Wherever a program that resumes is killed: without the document, or all of one kind."""
        for nth in range(1, 60):
            folder = tmp_path / str(nth)
            folder.mkdir()
            write_as_one(folder, {"a.csv": "old", "result.json": "old"}, within=folder)
            new = {"a.csv": "new", "result.json": "new"}
            ended = killed_at(nth, monkeypatch, partial(write_as_one, folder, new, within=folder))
            if (folder / "result.json").exists():
                text = (folder / "result.json").read_text()
                assert text == (folder / "a.csv").read_text()
            if ended is not None:
                break
        assert "new" == text


def test_a_study_writes_its_document_last(cli, tmp_path):
    """And removes what a killed one has left."""
    out = ("--out", str(tmp_path / "study"))
    with studies_in_this_process():
        assert cli(*STUDY, *out).code in (0, 1)
    for name in (".sweep.json.00ff.tmp", ".starts.csv.00ff.tmp"):
        (tmp_path / "study" / name).write_text("piece")
    shutil.copy(tmp_path / "study" / "sweep.json", tmp_path / "before.json")
    with studies_in_this_process():
        assert cli(*STUDY, *out, "--resume").code in (0, 1)
    assert ["manifest.json", "runs.jsonl", "starts.csv", "sweep.json"] == names(tmp_path / "study")
    stamps = [
        (tmp_path / "study" / name).stat().st_ctime_ns for name in ("starts.csv", "sweep.json")
    ]
    assert sorted(stamps) == stamps
    before, after = (
        json.loads(path.read_text())["settings"]
        for path in (tmp_path / "before.json", tmp_path / "study" / "sweep.json")
    )
    assert before == after
