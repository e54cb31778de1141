"""Folders: creation without following links, locks, forced writes, and the cache folder."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from filelock import lock_descriptor, unlock_descriptor

from skillplan.errors import OptionError
from skillplan.files.regular_file import resolve_plainly_within

# Error codes of file systems that cannot force a folder to disk.
_NOT_FOR_FOLDERS = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)


def make_folder(path: Path, *, within: Path) -> None:
    """Create a folder and its parents.

    Parameters
    ----------
    within
        Folder that must contain it, with no link on the way.

    Raises
    ------
    OSError
        If it cannot be created, or there is a link on the way.
    """
    resolve_plainly_within(path, within).mkdir(parents=True, exist_ok=True)


def sync_folder(folder: Path) -> None:
    """Force the entries of a folder to disk.

    Raises
    ------
    OSError
        If the disk fails.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    except OSError:
        # Not every system can open folders, and a writable folder may be unreadable.
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NOT_FOR_FOLDERS:
            raise
    finally:
        os.close(descriptor)


_POLL_S = 0.05


class FolderLock:
    """A lock that keeps other programs from writing to a folder.

    The lock is on the folder itself, needs no file, and ends with the process. Some systems and
    file systems have no such locks; there, it has no effect.

    Parameters
    ----------
    folder
        An existing folder.
    writer
        Kind of the writer, for messages: ``training``.
    patience_s
        Time to wait for another program [s].

    Raises
    ------
    OptionError
        If another program holds the lock.
    """

    def __init__(self, folder: Path, writer: str, patience_s: float = 0.0) -> None:
        self._descriptor: int | None = None
        self._held = False
        try:
            self._descriptor = os.open(folder, os.O_RDONLY)
            self._held = self._acquired(time.monotonic() + patience_s)
        except OSError:
            return
        if not self._held:
            self.release()
            raise OptionError(f"--out {folder}: another {writer} is writing there just now.")

    def _acquired(self, deadline_s: float) -> bool:
        assert self._descriptor is not None
        while not lock_descriptor(self._descriptor, blocking=False):
            if time.monotonic() >= deadline_s:
                return False
            time.sleep(_POLL_S)
        return True

    def release(self) -> None:
        """Release the lock."""
        if self._descriptor is not None:
            if self._held:
                # A forked process shares the descriptor.
                unlock_descriptor(self._descriptor)
            os.close(self._descriptor)
            self._descriptor, self._held = None, False


class HeldFolder:
    """Base of output folders; a context manager that holds the lock.

    Parameters
    ----------
    out
        The folder as given by the user.
    """

    def __init__(self, out: str) -> None:
        self._out = out
        self.path = Path(out)
        self._lock: FolderLock | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the lock."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    @contextmanager
    def _opening(self, what: str) -> Iterator[None]:
        """Create and lock the folder; an exception inside releases it.

        Raises
        ------
        OptionError
            If it cannot be used, or another program writes there.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = FolderLock(self.path, what)
            yield
        except BaseException as error:
            self.close()
            if not isinstance(error, OSError | ValueError):
                raise
            reason = getattr(error, "strerror", None) or str(error)
            raise OptionError(f"--out {self._out}: cannot be used: {reason}.") from None


def get_cache_folder() -> Path:
    """Return the folder for caches: ``SKILLPLAN_CACHE_DIR``, or the user's cache."""
    chosen = os.environ.get("SKILLPLAN_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("skillplan")
