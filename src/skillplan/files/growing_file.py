"""Files that grow by whole records, and can be cut to a length that is known to be sound."""

from __future__ import annotations

import os
from pathlib import Path

from skillplan.files.regular_file import RefusedFile, open_regular


class GrowingFile:
    """A file that is appended to, made where there is none.

    Nothing is buffered: what could not be written is never tried again when it is closed.

    Parameters
    ----------
    path
        The file.
    within
        The folder that it must lie in, with no link on the way to it.

    Raises
    ------
    OSError
        If it cannot be opened, is no regular file, there is a link on the way, or it has another
        name by which it would change, too.
    """

    def __init__(self, path: Path, within: Path) -> None:
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
        self._file = os.fdopen(open_regular(path, flags, within=within), "ab", buffering=0)
        if os.fstat(self._file.fileno()).st_nlink > 1:
            self._file.close()
            raise RefusedFile("shared", path)

    @property
    def length(self) -> int:
        """How long it is [B]."""
        return os.fstat(self._file.fileno()).st_size

    def append(self, content: bytes) -> None:
        """Append a record.

        Raises
        ------
        OSError
            If it cannot be written; a piece of it may have been.
        """
        rest = memoryview(content)
        while rest:
            rest = rest[self._file.write(rest) :]

    def cut(self, length: int) -> None:
        """Shorten it to a length [B]."""
        self._file.truncate(length)

    def sync(self) -> None:
        """Force all of it to disk.

        Raises
        ------
        OSError
            If that fails.
        """
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()
