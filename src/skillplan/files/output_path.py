"""Where an output goes, checked before anything expensive is done."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from skillplan.errors import OptionError


def output_path(option: str, out: str, suffixes: Collection[str], what: str) -> Path:
    """Return where an output goes, having seen that it can go there.

    Parameters
    ----------
    option
        The option that names the file, such as ``--out``.
    out
        The file as the user named it.
    suffixes
        Of the formats there are, in lower case.
    what
        What is written, in the plural.

    Raises
    ------
    OptionError
        If the suffix is unknown, or the folder is missing or closed to writing.
    """
    path = Path(out)
    suffix = path.suffix
    if suffix.lower() not in suffixes:
        said = f"{what} are not saved as {suffix}" if suffix else "does not say which format"
        raise OptionError(f"{option} {out}: {said}; end it in {' or '.join(suffixes)}.")
    return output_file(option, out)


def output_file(option: str, out: str) -> Path:
    """Return the file that an output goes to, whatever its suffix, after the same checks.

    Parameters
    ----------
    option, out
        As in `output_path`.

    Raises
    ------
    OptionError
        If the name is of a folder, or the folder is missing or closed to writing.
    """
    path = Path(out)
    try:
        # A name that no file can have, such as one with a NUL, is for `is_dir` just none.
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


def output_folder(option: str, out: str) -> Path:
    """Return a folder that several files go into, having seen that they can; makes nothing.

    Parameters
    ----------
    option
        The option that names it, such as ``--out``.
    out
        The folder as the user named it.

    Raises
    ------
    OptionError
        If there is something of the name but an empty folder, or the folder above is missing or
        closed to writing.
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
def refusing(option: str, path: Path) -> Iterator[None]:
    """Turn a failure to write into one clear message.

    Raises
    ------
    OptionError
        If anything within raises an OSError.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error).strip().splitlines()[0]
        raise OptionError(f"{option} {path}: cannot be written: {reason}.") from None
