"""Files that are there whole or not at all, whatever ends the program in between."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file through a temporary one beside it, and replace what was there.

    Raises
    ------
    OSError
        If it cannot be written; nothing is left behind, and what was there stays.
    """
    with written_beside(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file that replaces `path` once it has been written.

    Raises
    ------
    OSError
        If it cannot; where anything is raised nothing is left behind, and what was there stays.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
