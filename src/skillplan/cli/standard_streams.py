"""Standard streams: opened where they were closed, as by ``>&-``, and warnings on stderr."""

from __future__ import annotations

import os
import sys
import warnings
from typing import Any

from skillplan.cli.writing import tell

# How the null device takes the place of stdin, stdout and stderr. Of stdout it is opened for
# reading, so that writing fails and is reported; who closes stderr wants to hear nothing.
_MODES = (os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)


def open_standard_streams() -> None:
    """Put the null device where a stream is closed.

    Else the next file to be opened would get its number, and what a library prints would be
    written into that file.
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
    """Have Python's warnings, whose words may be a document's, written as all is on stderr."""
    warnings.showwarning = _show_warning


def _show_warning(
    message: Any, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any
) -> None:
    tell(warnings.formatwarning(message, category, filename, lineno), end="")
