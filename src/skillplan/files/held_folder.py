"""A folder of ``--out`` that one program writes into, and no other meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from skillplan.errors import OptionError
from skillplan.files.folder_lock import FolderLock


class HeldFolder:
    """Base of the folders that results are written into; a context manager.

    Parameters
    ----------
    out
        The folder, as the user named it.

    Attributes
    ----------
    path
        The folder.
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
        """Let others write."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    @contextmanager
    def _opening(self, what: str) -> Iterator[None]:
        """Make and lock the folder; where anything is raised within, it is let go.

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
