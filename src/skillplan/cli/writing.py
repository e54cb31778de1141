"""Standard streams: stdout is reserved for documents, and a lost reader or a full disk is handled.

All text is escaped, except the marks that make lines of a table bold.
"""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from skillplan.errors import OptionError
from skillplan.views.text.wording import escape
from skillplan.workers.supervised import report_printed


class _Documents:
    """The stream of documents after stdout was reserved for them."""

    stream: TextIO | None = None


_documents = _Documents()


def reserve_stdout() -> None:
    """Reserve stdout for documents: anything else that is printed there goes to stderr.

    File descriptor 1 is redirected, so that this holds for plugins, libraries in C and programs
    that they start.
    """
    before = sys.stdout
    before.flush()
    number = os.dup(1)
    os.dup2(2, 1)
    _documents.stream = open(  # noqa: SIM115
        number, "w", encoding=before.encoding, errors=before.errors
    )
    if isinstance(before, io.TextIOWrapper):
        before.reconfigure(line_buffering=True)


def document_stream() -> TextIO:
    """Return the stream that documents are written to."""
    return sys.stdout if _documents.stream is None else _documents.stream


def write_out(text: str, *, marked: bool = False) -> None:
    """Write to stdout; a reader that has gone, as with ``| head``, is not an error.

    Parameters
    ----------
    text
        The text.
    marked
        True if it contains marks for a terminal, and foreign text in it is escaped already.

    Raises
    ------
    OptionError
        If the output cannot be written, for example on a full disk.
    """
    stream = document_stream()
    with _guarded(stream):
        _write(stream, text if marked else escape(text))
    report_printed()


@contextmanager
def guard_stdout() -> Iterator[None]:
    """Let Typer and rich write to stdout; a reader that has gone is not an error.

    Raises
    ------
    OptionError
        If the output cannot be written.
    """
    with restore_stdout(), _guarded(sys.stdout):
        yield


@contextmanager
def restore_stdout() -> Iterator[None]:
    """Let libraries print help and completions to stdout while it is reserved."""
    stream = _documents.stream
    if stream is None:
        yield
        return
    # Not another `sys.stdout`, as libraries get the width of the terminal from file descriptor 1.
    aside = os.dup(1)
    os.dup2(stream.fileno(), 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(aside, 1)
        os.close(aside)


@contextmanager
def _guarded(stream: TextIO) -> Iterator[None]:
    try:
        yield
        stream.flush()
    except OSError as error:
        # Nothing more can be written there, not even what Python flushes when it ends.
        _mute(stream)
        if not isinstance(error, BrokenPipeError):
            raise OptionError(f"The output cannot be written: {error.strerror}.") from None
    except SystemExit:
        # Raised by rich if the reader has gone.
        _mute(stream)


def as_json(document: dict[str, Any]) -> str:
    """Return a document as JSON; a number that is not finite is a bug and raises ValueError."""
    # The only control character that JSON does not escape.
    return json.dumps(document, indent=2, allow_nan=False).replace("\x7f", "\\u007f")


def tell(text: str, end: str = "\n") -> None:
    """Write to stderr; nothing happens if it is closed or full."""
    try:
        _write(sys.stderr, escape(text) + end)
    except (OSError, ValueError):
        # Closed or full: the rest of the text must not fail when Python ends.
        _mute(sys.stderr)


def _write(stream: TextIO, text: str) -> None:
    encoding = stream.encoding or "utf-8"
    # Names may contain characters that the terminal cannot print.
    stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
    stream.flush()


def _mute(stream: TextIO) -> None:
    """Discard the buffered text of a stream and all later text."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


# Modes of the null device for stdin, stdout and stderr. For stdout it is opened for
# reading, so that writing fails and is reported; messages on a closed stderr are discarded.
_MODES = (os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)


def open_standard_streams() -> None:
    """Open the null device for each closed standard stream.

    Otherwise the next opened file would get its number, and output of a library would be written
    into that file.
    """
    for number, flags in enumerate(_MODES):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is taken, which is this one.
            os.open(os.devnull, flags)
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115


def escape_warnings() -> None:
    """Escape Python's warnings on stderr, because they may quote a document."""
    warnings.showwarning = _show_warning


def _show_warning(
    message: Any, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any
) -> None:
    tell(warnings.formatwarning(message, category, filename, lineno), end="")
