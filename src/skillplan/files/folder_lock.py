"""One writer a folder: a lock that goes with the process that holds it."""

from __future__ import annotations

import os
import time
from pathlib import Path

from filelock import lock_descriptor, unlock_descriptor

from skillplan.errors import OptionError

_POLL_S = 0.05


class FolderLock:
    """Keeps other programs from writing into a folder.

    The lock is on the folder itself, so that no file is made in it, and ends with the process,
    however that ends. Neither every system nor every file system has such locks; without them
    nobody is kept out.

    Parameters
    ----------
    folder
        The folder, which must be there.
    writer
        What writes into such a folder, for the message: ``training``.
    patience_s
        How long to wait for another program to let go [s].

    Raises
    ------
    OptionError
        If another program holds it.
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
        """Let others write."""
        if self._descriptor is not None:
            if self._held:
                # A process that was forked meanwhile has the descriptor, too.
                unlock_descriptor(self._descriptor)
            os.close(self._descriptor)
            self._descriptor, self._held = None, False
