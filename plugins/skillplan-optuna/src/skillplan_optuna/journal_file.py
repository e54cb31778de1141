"""The journal of a study, checked before Optuna reads it."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock

from skillplan.errors import OptionError
from skillplan.files.atomic_file import GrowingFile
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import read_bytes

# Greatest size of a journal; a trial takes about 2 kB.
_MOST_BYTES = 1024**3
# Age of a lock [s] after which others break it, because its process was killed.
_GRACE_S = 30


def opened(path: Path) -> JournalFileBackend:
    """Return the journal, created if needed; an incomplete last line is cut off.

    Raises
    ------
    OptionError
        If a line is damaged.
    OSError
        If it cannot be read or written.
    """
    lock = JournalFileSymlinkLock(str(path), grace_period=_GRACE_S)
    if path.exists() or path.is_symlink():
        content = read_bytes(path, _MOST_BYTES, within=path.parent)
        if content and not content.endswith(b"\n"):
            _cut(path, lock)
            content = read_bytes(path, _MOST_BYTES, within=path.parent)
        _check(path, content)
    return JournalFileBackend(str(path), lock_obj=lock)


def _cut(path: Path, lock: JournalFileSymlinkLock) -> None:
    """Cut off the incomplete line of a killed process.

    Under the lock, because then no other process is writing.
    """
    lock.acquire()
    try:
        content = read_bytes(path, _MOST_BYTES, within=path.parent)
        with closing(GrowingFile(path, path.parent)) as file:
            file.cut(content.rfind(b"\n") + 1)
    finally:
        lock.release()


def _check(path: Path, content: bytes) -> None:
    """Check that every line is a JSON object."""
    whole = content[: content.rfind(b"\n") + 1]
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            entry = parse_json(line)
        except ValueError as error:
            raise OptionError(damaged(path, f"line {number}: {error}")) from None
        if not isinstance(entry, dict):
            raise OptionError(damaged(path, f"line {number} is not an entry of a journal"))


def damaged(path: Path, why: str) -> str:
    """Return the error about a damaged journal."""
    return f"{path}: is damaged: {why}. Begin in a new folder, or put back a copy of the file."
