"""Files that a task file names: where they may lie, and how they are read."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

from skillplan.files.regular_file import RefusedFile, read_bytes, real_path_within


class CompanionFileError(Exception):
    """A file that a task file names cannot be used; says why and what to do instead."""


def companion_in(folder: Path, name: str) -> Path:
    """Return the path of a file that must lie in the task file's folder, or in a folder of it.

    Parameters
    ----------
    folder
        The task file's folder.
    name
        Relative to `folder`, with slashes.

    Raises
    ------
    CompanionFileError
        If the name is absolute, leads out of the folder by ``..``, or a link leads out of it.
    """
    if not name.strip() or not name.isprintable():
        raise CompanionFileError("This names no file; give one.")
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).drive or "\\" in name:
        message = (
            "The path must be relative to the task file, with slashes; copy the file beside it."
        )
        raise CompanionFileError(message)
    outside = "The file lies outside the task file's folder; copy it there."
    if ".." in PurePosixPath(name).parts:
        raise CompanionFileError(outside)
    try:
        return real_path_within(folder / name, folder)
    except RefusedFile:
        raise CompanionFileError(outside) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CompanionFileError(f"The file cannot be found ({reason}); give another.") from None


def read_companion(path: Path, most_bytes: int, what: str) -> bytes:
    """Return the content of a regular file that is not empty.

    Parameters
    ----------
    path
        Of the file.
    most_bytes
        Greatest size.
    what
        What the file is there to hold, for messages: ``trajectory``.

    Raises
    ------
    CompanionFileError
        If there is none, it may not be read, it is larger than `most_bytes` or empty.
    """
    try:
        content = read_bytes(path, most_bytes)
    except FileNotFoundError:
        message = "There is no such file; give the path of one that exists."
        raise CompanionFileError(message) from None
    except PermissionError:
        message = "The file may not be read; give yourself the permission to."
        raise CompanionFileError(message) from None
    except RefusedFile as refused:
        raise CompanionFileError(_refusal(refused, most_bytes, what)) from None
    except OSError as error:
        message = f"The file cannot be read ({error.strerror}); give another."
        raise CompanionFileError(message) from None
    if not content.strip():
        raise CompanionFileError(f"The file is empty; give one with a {what}.")
    return content


def _refusal(refused: RefusedFile, most_bytes: int, what: str) -> str:
    if refused.why == "large":
        return f"The file is larger than {most_bytes // 1024**2} MiB; keep the {what} alone."
    if refused.why == "folder":
        return "This is a folder; give a file in it."
    return "This is no regular file; give one."
