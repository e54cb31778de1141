"""Folders: made without following a link in another, and forced to disk."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from skillplan.files.regular_file import plain_path_within

# File systems that cannot force a folder to disk say so by these.
_NOT_FOR_FOLDERS = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)


def make_folder(path: Path, *, within: Path) -> None:
    """Make a folder, and those above it, where there is none.

    Parameters
    ----------
    path
        The folder.
    within
        One that it must lie in, with no link on the way to it.

    Raises
    ------
    OSError
        If it cannot be made, or there is a link on the way.
    """
    plain_path_within(path, within).mkdir(parents=True, exist_ok=True)


def sync_folder(folder: Path) -> None:
    """Force to disk which files a folder has.

    Raises
    ------
    OSError
        If the disk fails.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    except OSError:
        # Not every system opens folders, nor may every folder be read that may be written to.
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NOT_FOR_FOLDERS:
            raise
    finally:
        os.close(descriptor)
