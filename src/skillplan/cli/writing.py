"""Writing to stdout and stderr, where the reader may have gone and the disk may be full.

Whatever is written goes through `escaped`, but for the marks that make a table's lines bold.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from skillplan.errors import OptionError
from skillplan.views.text.escaping import escaped


def write_out(text: str, *, marked: bool = False) -> None:
    """Write to stdout; a reader who has gone, as with ``| head``, is no fault.

    Parameters
    ----------
    text
        What is written.
    marked
        Whether it holds marks for a terminal, and all that is not ours in it is escaped already.

    Raises
    ------
    OptionError
        If the output cannot be written, for want of space for example.
    """
    with guarded_stdout():
        _write(sys.stdout, text if marked else escaped(text))


@contextmanager
def guarded_stdout() -> Iterator[None]:
    """Let others write to stdout; a reader who has gone is no fault.

    Raises
    ------
    OptionError
        If the output cannot be written.
    """
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        # Nothing more can be said on stdout, not even what Python flushes when it ends.
        _mute(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            raise OptionError(f"The output cannot be written: {error.strerror}.") from None
    except SystemExit:
        # So rich says that the reader has gone.
        _mute(sys.stdout)


def as_json(document: dict[str, Any]) -> str:
    """Return a document as JSON; a number that is not finite is a bug and raises ValueError."""
    # JSON escapes all that is not ASCII, and of ASCII all but this.
    return json.dumps(document, indent=2, allow_nan=False).replace("\x7f", "\\u007f")


def tell(text: str, end: str = "\n") -> None:
    """Write to stderr; where it is closed or full there is nobody to tell, and that is no fault.

    Parameters
    ----------
    text
        What is written.
    end
        What comes behind it.
    """
    try:
        _write(sys.stderr, escaped(text) + end)
    except (OSError, ValueError):
        # Closed, full, or nobody reads: what is left of it must not fail when Python ends.
        _mute(sys.stderr)


def _write(stream: TextIO, text: str) -> None:
    encoding = stream.encoding or "utf-8"
    # A name may hold what the terminal cannot print.
    stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
    stream.flush()


def _mute(stream: TextIO) -> None:
    """Send all that a stream still holds, and all that follows, nowhere."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
