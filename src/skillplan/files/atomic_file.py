"""Files that are there whole or not at all, whatever ends the program in between.

The content goes to a new file beside the target, is forced to disk, and takes the target's place in
one step; then the folder is forced to disk, too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from skillplan.files.folder import sync_folder
from skillplan.files.regular_file import RefusedFile, open_regular, plain_path_within

# A name has 255 bytes at most, of which the temporary file needs some.
_KEPT_NAME_BYTES = 160
_UNFINISHED = re.compile(r"\..+\.[0-9a-f]+\.tmp", re.DOTALL)


def write_whole(
    path: Path, content: str | bytes, *, within: str | os.PathLike[str] | None = None
) -> None:
    """Write a file in one piece, replacing what was there.

    Parameters
    ----------
    path
        The file.
    content
        Text is written as UTF-8.
    within
        A folder that the file must lie in, with no link on the way to it; None for anywhere.

    Raises
    ------
    OSError
        If it cannot be written; nothing is left behind, and what was there stays.
    """
    with replacing(path, within=within) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_new(path: Path, content: str | bytes) -> None:
    """Write a file in one piece where there is none yet; of two programs that try, one does.

    Parameters
    ----------
    path
        The file.
    content
        Text is written as UTF-8.

    Raises
    ------
    FileExistsError
        If there is something of that name, be it a link that leads nowhere.
    OSError
        If it cannot be written. In either case nothing is left behind, and what was there stays.
    """
    temporary = _temporary_name(path)
    _write_piece(temporary, content)
    try:
        try:
            # Unlike a renamed file, another name takes nobody's place.
            os.link(temporary, path)
        except FileExistsError:
            raise
        except OSError:
            _put_in_free_place(temporary, path)
        sync_folder(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def replacing(path: Path, *, within: str | os.PathLike[str] | None = None) -> Iterator[IO[bytes]]:
    """Yield a file that takes the place of another once all has been written to it.

    Parameters
    ----------
    path
        The file to be replaced; need not be there.
    within
        A folder that it must lie in, with no link on the way to it; None for anywhere.

    Raises
    ------
    OSError
        If it cannot be written; where anything is raised nothing is left behind, and what was
        there stays.
    """
    if within is not None:
        path = plain_path_within(path.parent, within) / path.name
    temporary = _temporary_name(path)
    with _piece(temporary) as file:
        yield file
    try:
        _put_in_place(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Yield the path of a new file, for another program to write, that then replaces `path`.

    Raises
    ------
    OSError
        If it cannot; where anything is raised nothing is left behind, and what was there stays.
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
    """Write several files of a folder, the last of which says that all are there.

    Everything is on disk before anything takes its place, and an earlier last file is gone before
    another takes its own. So a program that ends in between leaves no last file, but a piece of it,
    by which `is_unfinished` knows.

    Parameters
    ----------
    folder
        Of the files.
    contents
        By name; text is written as UTF-8.
    within
        A folder that it must lie in, with no link on the way to it.

    Raises
    ------
    OSError
        If one cannot be written; its `filename` is the file. Where there is no room, what was there
        before stays; else none of them is left.
    """
    folder = plain_path_within(folder, within)
    *names, last = contents
    # That of the last file comes first and goes last: while it is there, the others may be ours.
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
    """Yield a new file that is on disk once all has been written to it, and else gone."""
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
    """Say of a failure which file could not be written, rather than a piece of it."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), os.fspath(path)) from None


def remove_unfinished(folder: Path, *, within: str | os.PathLike[str]) -> None:
    """Remove what programs left in a folder that were killed while they wrote.

    Parameters
    ----------
    folder
        The folder; where it is missing there is nothing to do.
    within
        A folder that it must lie in, with no link on the way to it.

    Raises
    ------
    OSError
        If it cannot be read or written, or there is a link on the way.
    """
    folder = plain_path_within(folder, within)
    with suppress(FileNotFoundError):
        for name in os.listdir(folder):
            if is_unfinished(name):
                (folder / name).unlink(missing_ok=True)


def is_unfinished(name: str, of: str | None = None) -> bool:
    """Whether a file of this name is what a program left that was killed while it wrote.

    Parameters
    ----------
    name
        Of the file.
    of
        The name of the file that was to be replaced; None for any.
    """
    known = _UNFINISHED if of is None else re.compile(rf"\.{re.escape(of)}\.[0-9a-f]+\.tmp")
    return known.fullmatch(name) is not None


def _temporary_name(path: Path) -> Path:
    kept = os.fsdecode(os.fsencode(path.name)[:_KEPT_NAME_BYTES])
    # By chance, so that nobody can have put anything there.
    return path.with_name(f".{kept}.{os.urandom(8).hex()}.tmp")


def _put_in_free_place(temporary: Path, path: Path) -> None:
    """Take a place that is free where the file system has no hard links."""
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
