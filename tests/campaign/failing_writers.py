"""Every writer of files, failing or killed at every call: what was there stays, or all is new."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from failing_io import MODES, failing
from tally import Tally, progress

from skillplan.files import is_unfinished, replace_file, write_as_one, write_new, write_whole

OLD, NEW = b"old" * 1000, b"new" * 2000
KILL = "kill"


def _replace(folder: Path) -> None:
    with replace_file(folder / "a") as file:
        file.write(NEW[:3000])
        file.write(NEW[3000:])


def _write_whole(folder: Path) -> None:
    write_whole(folder / "a", NEW, within=folder)


def _write_new(folder: Path) -> None:
    (folder / "a").unlink(missing_ok=True)
    write_new(folder / "a", NEW)


def _write_as_one(folder: Path) -> None:
    write_as_one(folder, {"b": NEW, "c": NEW, "a": NEW}, within=folder)


WRITERS: dict[str, Callable[[Path], None]] = {
    "replace_file": _replace,
    "write_whole": _write_whole,
    "write_new": _write_new,
    "write_as_one": _write_as_one,
}


def _filled(folder: Path) -> Path:
    """Return an empty folder in which the file ``a`` is there already."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "a").write_bytes(OLD)
    return folder


def _killed(write: Callable[[Path], None], folder: Path, counter: Path, number: int) -> None:
    """Write in a process of its own that ends at a call, without any tidying."""
    process = os.fork()
    if process == 0:
        with failing(folder, counter, number, KILL):
            write(folder)
        os._exit(0)
    os.waitpid(process, 0)


def _is_sound(folder: Path, *, killed: bool, together: bool) -> None:
    """Assert that ``a`` is missing, old or new, and that nothing else is left behind."""
    names = {path.name for path in folder.iterdir()}
    pieces = {name for name in names if is_unfinished(name)}
    assert killed or not pieces, f"left behind: {sorted(pieces)}"
    content = {name: (folder / name).read_bytes() for name in names - pieces}
    assert content.get("a", OLD) in (OLD, NEW), "a is neither the old nor the new one"
    if together and content.get("a") == NEW:
        assert {"a": NEW, "b": NEW, "c": NEW} == content, "the last file is there, others are not"
    elif not together:
        assert set(content) <= {"a"}, f"left behind: {sorted(content)}"


def fail_every_call_of_writers(tally: Tally) -> None:
    """Let every call of every writer fail in every mode, or end the process."""
    progress("fail-writer: every call")
    index = 0
    with tempfile.TemporaryDirectory(prefix="campaign-writers-") as name:
        folder, counter = Path(name) / "files", Path(name) / "calls"
        for writer, write in WRITERS.items():
            with failing(_filled(folder), counter, 0, "EIO"):
                write(folder)
            calls = counter.stat().st_size
            assert calls > 0, "the shim saw no calls"
            for mode in (*MODES, KILL):
                for number in range(1, calls + 1):

                    def check(
                        _: object,
                        writer: str = writer,
                        write: Callable[[Path], None] = write,
                        mode: str = mode,
                        number: int = number,
                    ) -> None:
                        counter.unlink(missing_ok=True)
                        _filled(folder)
                        if mode == KILL:
                            _killed(write, folder, counter, number)
                        else:
                            try:
                                with failing(folder, counter, number, mode):
                                    write(folder)
                            except OSError:
                                pass
                        together = writer == "write_as_one"
                        _is_sound(folder, killed=mode == KILL, together=together)

                    tally.case("fail-writer", index, check)
                    index += 1
            counter.unlink(missing_ok=True)
