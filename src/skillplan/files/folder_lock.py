"""One writer a folder: a lock that goes with the process that holds it."""

from __future__ import annotations

import os
import time
from pathlib import Path

from skillplan.errors import OptionError

_POLL_S = 0.05


class FolderLock:
    """Keeps other programs from writing into a folder.

    Neither every system nor every file system has locks; without them nobody is kept out.

    Parameters
    ----------
    folder
        The folder, which must be there; no file is made in it.
    patience_s
        How long to wait for another program to let go [s].

    Raises
    ------
    OptionError
        If another program holds it.
    """

    def __init__(self, folder: Path, patience_s: float = 0.0) -> None:
        self._descriptor: int | None = None
        try:
            import fcntl

            self._descriptor = os.open(folder, os.O_RDONLY)
        except (ImportError, OSError):
            return
        deadline_s = time.monotonic() + patience_s
        while True:
            try:
                fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                if time.monotonic() >= deadline_s:
                    self.release()
                    raise OptionError(
                        f"--out {folder}: another training is writing there just now."
                    ) from None
                time.sleep(_POLL_S)
            except OSError:
                return

    def release(self) -> None:
        """Let others write."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
