"""Atomic writing: a file is complete or absent, even after a crash; and files that grow by records.

The content is written to a temporary file in the same folder, forced to disk, and renamed to the
target; then the folder is forced to disk.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from skillplan.files.folder import sync_folder
from skillplan.files.regular_file import RefusedFile, open_regular, resolve_plainly_within

# Names have at most 255 bytes, and the temporary file needs some of them.
_KEPT_NAME_BYTES = 160
_UNFINISHED = re.compile(r"\..+\.[0-9a-f]+\.tmp", re.DOTALL)


def write_whole(
    path: Path, content: str | bytes, *, within: str | os.PathLike[str] | None = None
) -> None:
    """Write a file atomically, replacing an earlier one.

    Parameters
    ----------
    within
        Folder that must contain the file, with no link on the way; None for any.

    Raises
    ------
    OSError
        If it cannot be written; then nothing changes.
    """
    with replace_file(path, within=within) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_new(path: Path, content: str | bytes) -> None:
    """Write a file atomically if it does not exist; of two concurrent programs, one succeeds.

    Raises
    ------
    FileExistsError
        If the name exists, even as a broken link.
    OSError
        If it cannot be written. In both cases nothing changes.
    """
    temporary = _temporary_name(path)
    _write_piece(temporary, content)
    try:
        try:
            # Unlike a rename, a new hard link never replaces a file.
            os.link(temporary, path)
        except FileExistsError:
            raise
        except OSError:
            _put_in_free_place(temporary, path)
        sync_folder(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def replace_file(
    path: Path, *, within: str | os.PathLike[str] | None = None
) -> Iterator[IO[bytes]]:
    """Yield a file that replaces another one when the block ends.

    Parameters
    ----------
    within
        Folder that must contain the file, with no link on the way; None for any.

    Raises
    ------
    OSError
        If it cannot be written; after any exception, nothing changes.
    """
    if within is not None:
        path = resolve_plainly_within(path.parent, within) / path.name
    temporary = _temporary_name(path)
    with _piece(temporary) as file:
        yield file
    try:
        _put_in_place(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def write_beside(path: Path) -> Iterator[Path]:
    """Yield the path of a new file for another program, which then replaces `path`.

    Raises
    ------
    OSError
        If it cannot be written; after any exception, nothing changes.
    """
    temporary = _temporary_name(path)
    temporary.open("xb").close()
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        _put_in_place(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_as_one(
    folder: Path, contents: Mapping[str, str | bytes], *, within: str | os.PathLike[str]
) -> None:
    """Write several files of a folder; the last one marks them as complete.

    All files are on disk before the first is renamed, and an earlier last file is removed first. A
    program that ends in between leaves no last file but a temporary one, which `is_unfinished`
    detects.

    Parameters
    ----------
    contents
        Contents by name; text is written as UTF-8.
    within
        Folder that must contain it, with no link on the way.

    Raises
    ------
    OSError
        If a file cannot be written; `filename` names it. If the disk is full, the earlier files
        stay; else none is left.
    """
    folder = resolve_plainly_within(folder, within)
    *names, last = contents
    # The temporary file of the last one comes first and goes last: while it exists, the others may
    # be new.
    pieces = {name: _temporary_name(folder / name) for name in (last, *names)}
    placed: list[Path] = []
    try:
        for name, piece in pieces.items():
            with _blaming(folder / name):
                _write_piece(piece, contents[name])
        sync_folder(folder)
        (folder / last).unlink(missing_ok=True)
        for name in (*names, last):
            with _blaming(folder / name):
                if name == last:
                    sync_folder(folder)
                os.replace(pieces[name], folder / name)
            placed.append(folder / name)
        sync_folder(folder)
    except BaseException:
        for path in (*reversed(placed), *reversed(pieces.values())):
            path.unlink(missing_ok=True)
        raise


@contextmanager
def _piece(path: Path) -> Iterator[IO[bytes]]:
    """Yield a new file that is on disk when the block ends; it is removed after an exception."""
    file = path.open("xb")
    try:
        with file:
            yield file
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def _write_piece(path: Path, content: str | bytes) -> None:
    with _piece(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def _blaming(path: Path) -> Iterator[None]:
    """Name the target in an error, instead of the temporary file."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), os.fspath(path)) from None


def remove_unfinished(folder: Path, *, within: str | os.PathLike[str]) -> None:
    """Remove the temporary files of killed programs from a folder.

    Parameters
    ----------
    folder
        Folder; nothing happens if it is missing.
    within
        Folder that must contain it, with no link on the way.

    Raises
    ------
    OSError
        If it cannot be read or written, or there is a link on the way.
    """
    folder = resolve_plainly_within(folder, within)
    with suppress(FileNotFoundError):
        for name in os.listdir(folder):
            if is_unfinished(name):
                (folder / name).unlink(missing_ok=True)


def is_unfinished(name: str, of: str | None = None) -> bool:
    """Return whether a file name is that of a temporary file of a killed program.

    Parameters
    ----------
    of
        Name of its target; None for any.
    """
    known = _UNFINISHED if of is None else re.compile(rf"\.{re.escape(of)}\.[0-9a-f]+\.tmp")
    return known.fullmatch(name) is not None


def _temporary_name(path: Path) -> Path:
    kept = os.fsdecode(os.fsencode(path.name)[:_KEPT_NAME_BYTES])
    # Random, so that no other program can have created it.
    return path.with_name(f".{kept}.{os.urandom(8).hex()}.tmp")


def _put_in_free_place(temporary: Path, path: Path) -> None:
    """Create a file on file systems without hard links."""
    path.open("xb").close()
    try:
        os.replace(temporary, path)
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def _put_in_place(temporary: Path, path: Path) -> None:
    os.replace(temporary, path)
    sync_folder(path.parent)


class GrowingFile:
    """A file that grows by whole records; created if it does not exist.

    Nothing is buffered, so closing it never repeats a failed write.

    Parameters
    ----------
    within
        Folder that must contain the file, with no link on the way.

    Raises
    ------
    OSError
        If it cannot be opened, is not a regular file, there is a link on the way, or it has another
        hard link.
    """

    def __init__(self, path: Path, within: Path) -> None:
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
        self._file = os.fdopen(open_regular(path, flags, within=within), "ab", buffering=0)
        if os.fstat(self._file.fileno()).st_nlink > 1:
            self._file.close()
            raise RefusedFile("shared", path)

    @property
    def length(self) -> int:
        """Length [bytes]."""
        return os.fstat(self._file.fileno()).st_size

    def append(self, content: bytes) -> None:
        """Append a record.

        Raises
        ------
        OSError
            If it cannot be written; a part of it may have been.
        """
        rest = memoryview(content)
        while rest:
            rest = rest[self._file.write(rest) :]

    def cut(self, length: int) -> None:
        """Truncate the file to a length [bytes]."""
        self._file.truncate(length)

    def sync(self) -> None:
        """Force the file to disk.

        Raises
        ------
        OSError
            If the disk fails.
        """
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()
