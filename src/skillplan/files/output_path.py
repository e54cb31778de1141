"""Checks of output paths, before any expensive work."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillplan.errors import OptionError


def check_output_path(option: str, out: str, suffixes: Collection[str], what: str) -> Path:
    """Return the path of an output, after checks that it can be written.

    Parameters
    ----------
    option
        Option that gives the file, such as ``--out``.
    out
        The file as given by the user.
    suffixes
        Suffixes of the available formats, in lower case.
    what
        Kind of the content, in the plural.

    Raises
    ------
    OptionError
        If the suffix is unknown, or the folder is missing or not writable.
    """
    path = Path(out)
    suffix = path.suffix
    if suffix.lower() not in suffixes:
        fault = f"{what} are not saved as {suffix}" if suffix else "does not say which format"
        raise OptionError(f"{option} {out}: {fault}; end it in {' or '.join(suffixes)}.")
    return check_output_file(option, out)


def check_output_file(option: str, out: str) -> Path:
    """Return the path of an output with any suffix, after the same checks.

    Raises
    ------
    OptionError
        If it is a folder, or its folder is missing or not writable.
    """
    path = Path(out)
    try:
        # `is_dir` returns False for an impossible name, such as one with a NUL.
        with suppress(FileNotFoundError, NotADirectoryError):
            path.lstat()
        if path.is_dir():
            raise OptionError(f"{option} {out}: is a folder. Name a file.")
        if not path.parent.is_dir():
            raise OptionError(f"{option} {out}: there is no folder {path.parent}. Make it first.")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OptionError(f"{option} {out}: cannot be used: {reason}.") from None
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OptionError(f"{option} {out}: the folder {path.parent} cannot be written to.")
    return path


def check_output_folder(option: str, out: str) -> Path:
    """Return the folder for several files, after checks that it can be created.

    Parameters
    ----------
    option
        Option that gives the folder, such as ``--out``.
    out
        The folder as given by the user.

    Raises
    ------
    OptionError
        If the path exists and is not an empty folder, or its parent is missing or not writable.
    """
    path = Path(out)
    try:
        if path.is_dir():
            if any(path.iterdir()):
                raise OptionError(f"{option} {out}: is not empty. Name a new folder.")
        elif path.exists() or path.is_symlink():
            raise OptionError(f"{option} {out}: is a file. Name a new folder.")
        elif not path.parent.is_dir():
            raise OptionError(f"{option} {out}: there is no folder {path.parent}. Make it first.")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OptionError(f"{option} {out}: cannot be used: {reason}.") from None
    there = path if path.is_dir() else path.parent
    if not os.access(there, os.W_OK | os.X_OK):
        raise OptionError(f"{option} {out}: the folder {there} cannot be written to.")
    return path


@contextmanager
def report_write_errors(option: str, path: Path) -> Iterator[None]:
    """Turn a failure to write into a clear message.

    Raises
    ------
    OptionError
        If the block raises an OSError.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).strip().splitlines()[0]
        raise OptionError(f"{option} {path}: cannot be written: {reason}.") from None
