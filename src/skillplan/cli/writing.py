"""Writing to stdout, where the reader may have gone and the disk may be full."""

from __future__ import annotations

import os
import sys

from skillplan.errors import OptionError


def write_out(text: str) -> None:
    """Write to stdout; a reader who has gone, as with ``| head``, is no fault.

    Raises
    ------
    OptionError
        If the output cannot be written, for want of space for example.
    """
    encoding = sys.stdout.encoding or "utf-8"
    try:
        # A name may hold what the terminal cannot print.
        sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))
        sys.stdout.flush()
    except OSError as error:
        # Nothing more can be said on stdout, not even what Python flushes when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise OptionError(f"The output cannot be written: {error.strerror}.") from None
