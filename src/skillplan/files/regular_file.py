"""Safe reading: regular files only, up to a limit, and without following links in a folder.

Folders, pipes, sockets and devices are refused before a read could block. If a file must lie in a
folder that may come from others, no link in that folder is followed.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from io import FileIO
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Literal

Refusal = Literal["folder", "irregular", "large", "memory", "outside", "link", "shared"]

_CHUNK_BYTES = 1024 * 1024
# Opening never blocks, takes no terminal, and child processes inherit nothing.
_CAREFUL = os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC if os.name == "posix" else 0
_BINARY = getattr(os, "O_BINARY", 0)
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
# Folders on the path need not be readable.
_PASS = getattr(os, "O_PATH", os.O_RDONLY) | getattr(os, "O_DIRECTORY", 0) | _NO_LINK

_WORDS: dict[Refusal, tuple[int, str]] = {
    "folder": (errno.EISDIR, "it is a folder"),
    "irregular": (errno.EINVAL, "it is no regular file"),
    "large": (errno.EFBIG, "it is larger than the {most_bytes:,} bytes that it may have"),
    "memory": (errno.ENOMEM, "its arrays take more memory than the {most_bytes:,} bytes there are"),
    "outside": (errno.ELOOP, "a link leads out of the folder"),
    "shared": (errno.EMLINK, "the same file has another name, a hard link; copy it"),
    "link": (errno.ELOOP, "there is a link on the way to it"),
}


class RefusedFile(OSError):
    """A file that exists but is refused; `strerror` gives the reason.

    Parameters
    ----------
    why
        Kind of the refusal.
    most_bytes
        The limit, if it is exceeded.
    """

    def __init__(self, why: Refusal, path: str | os.PathLike[str], most_bytes: int = 0) -> None:
        number, words = _WORDS[why]
        super().__init__(number, words.format(most_bytes=most_bytes), os.fspath(path))
        self.why = why


def read_bytes(
    path: str | os.PathLike[str], most_bytes: int, *, within: str | os.PathLike[str] | None = None
) -> bytes:
    """Return the content of a regular file.

    Parameters
    ----------
    most_bytes
        Greatest size [bytes], >= 0. At most one further byte is read.
    within
        Folder that must contain the file, with no link on the way; None for any.

    Raises
    ------
    RefusedFile
        If it is not a regular file, is too large, or there is a link below `within`.
    OSError
        If it cannot be read.
    """
    with os.fdopen(open_regular(path, os.O_RDONLY, within=within), "rb", buffering=0) as file:
        return read_rest(file, path, most_bytes)


def read_rest(file: FileIO, path: str | os.PathLike[str], most_bytes: int) -> bytes:
    """Return the rest of an open file; raises as `read_bytes`."""
    size = os.fstat(file.fileno()).st_size
    if size > most_bytes:
        raise RefusedFile("large", path, most_bytes)
    pieces: list[bytes] = []
    left, chunk = most_bytes + 1, size + 1
    # A file may grow meanwhile, and files of the process file system have no size.
    while left and (piece := file.read(min(left, chunk))):
        pieces.append(piece)
        left, chunk = left - len(piece), _CHUNK_BYTES
    if not left:
        raise RefusedFile("large", path, most_bytes)
    return b"".join(pieces)


def open_regular(
    path: str | os.PathLike[str], flags: int, *, within: str | os.PathLike[str] | None = None
) -> int:
    """Return the descriptor of a regular file.

    Parameters
    ----------
    flags
        As for `os.open`; ``O_CREAT`` creates the file.
    within
        Folder that must contain the file, with no link on the way; None for any.

    Raises
    ------
    RefusedFile
        If it is not a regular file, or there is a link below `within`.
    OSError
        If it cannot be opened.
    """
    try:
        if within is not None:
            descriptor = _opened_within(path, flags, within)
        else:
            # Opening a device or a pipe has side effects.
            _refuse_irregular(path, _status(path))
            descriptor = os.open(path, flags | _CAREFUL | _BINARY, 0o666)
    except ValueError as error:
        # An impossible name, such as one with a NUL.
        raise OSError(errno.EINVAL, str(error), os.fspath(path)) from None
    try:
        _refuse_irregular(path, os.fstat(descriptor))
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def resolve_within(path: str | os.PathLike[str], folder: str | os.PathLike[str]) -> Path:
    """Return the real path of a file that must lie in a folder; it need not exist.

    Raises
    ------
    RefusedFile
        If a link or ``..`` leads out of the folder.
    """
    real = Path(os.path.realpath(path))
    if not real.is_relative_to(os.path.realpath(folder)):
        raise RefusedFile("outside", path)
    return real


def resolve_plainly_within(path: str | os.PathLike[str], folder: str | os.PathLike[str]) -> Path:
    """Return the real path of a file in a folder; only the folder itself may be a link.

    Parameters
    ----------
    folder
        The folder, as in the path or as its real path.

    Raises
    ------
    RefusedFile
        If ``..`` leads out of the folder, or there is a link on the way.
    """
    real, root = resolve_within(path, folder), Path(os.path.realpath(folder))
    named = Path(os.path.abspath(path))
    for start in (Path(os.path.abspath(folder)), root):
        if named.is_relative_to(start):
            if root / named.relative_to(start) != real:
                break
            return real
    raise RefusedFile("link", path)


def is_folder(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is a folder; False for impossible names."""
    return _has_kind(path, stat.S_ISDIR)


def is_regular(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is a regular file; False for impossible names."""
    return _has_kind(path, stat.S_ISREG)


def _has_kind(path: str | os.PathLike[str], is_kind: Callable[[int], bool]) -> bool:
    try:
        return is_kind(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def _opened_within(path: str | os.PathLike[str], flags: int, within: str | os.PathLike[str]) -> int:
    """Open a file of a folder, step by step and without following links."""
    real = resolve_plainly_within(path, within)
    _refuse_irregular(path, _status(real))
    if os.open not in os.supports_dir_fd:
        return os.open(real, flags | _CAREFUL | _BINARY, 0o666)
    root = Path(os.path.realpath(within))
    *folders, name = real.relative_to(root).parts or ("",)
    # Step by step, so that a link created meanwhile is not followed.
    here = os.open(root, _PASS)
    try:
        for folder in folders:
            step = os.open(folder, _PASS, dir_fd=here)
            os.close(here)
            here = step
        return os.open(name, flags | _CAREFUL | _NO_LINK, 0o666, dir_fd=here)
    finally:
        os.close(here)


def _status(path: str | os.PathLike[str]) -> os.stat_result | None:
    try:
        return os.stat(path)
    except FileNotFoundError:
        return None


def _refuse_irregular(path: str | os.PathLike[str], status: os.stat_result | None) -> None:
    if status is not None and not stat.S_ISREG(status.st_mode):
        raise RefusedFile("folder" if stat.S_ISDIR(status.st_mode) else "irregular", path)


class CompanionFileError(Exception):
    """A file named in a task file cannot be used; the message gives the reason and a remedy."""


def find_companion(folder: Path, name: str) -> Path:
    """Return the path of a file below the folder of a task file.

    Parameters
    ----------
    name
        Path relative to `folder`, with slashes.

    Raises
    ------
    CompanionFileError
        If the name is absolute, or ``..`` or a link leads out of the folder.
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
        return resolve_within(folder / name, folder)
    except RefusedFile:
        raise CompanionFileError(outside) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CompanionFileError(f"The file cannot be found ({reason}); give another.") from None


def read_companion(path: Path, most_bytes: int, what: str) -> bytes:
    """Return the content of a regular file, which must not be empty.

    Parameters
    ----------
    what
        Kind of the content, for messages: ``trajectory``.

    Raises
    ------
    CompanionFileError
        If it is missing, unreadable, empty or larger than `most_bytes`.
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
