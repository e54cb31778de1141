"""Printing of documents and tables, and saving of results."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skillplan.errors import (
    EXIT_INTERRUPTED,
    EXIT_NO_PLAN,
    EXIT_SOLVED,
    EXIT_WRONG_INPUT,
    OptionError,
)
from skillplan.report.result import Result, Status
from skillplan.report.table import Table, show

_EXIT = {
    Status.OPTIMAL: EXIT_SOLVED,
    Status.SOLVED: EXIT_SOLVED,
    Status.INFEASIBLE: EXIT_NO_PLAN,
    Status.UNSOLVED: EXIT_NO_PLAN,
    Status.REFUSED: EXIT_WRONG_INPUT,
    Status.WRONG: EXIT_WRONG_INPUT,
}


def emit(style: str, document: dict[str, Any], tables: Sequence[Table]) -> None:
    """Print one JSON document, or tables, to stdout."""
    if style == "json":
        print(as_json(document))
    else:
        show(tables, style, sys.stdout)


def as_json(document: dict[str, Any]) -> str:
    """Return a document as JSON; a number that is not finite is a bug and raises ValueError."""
    return json.dumps(document, indent=2, allow_nan=False)


def exit_code(results: Sequence[Result]) -> int:
    """Return the exit code of a command that printed these results.

    Interrupted wins, then a wrong claim, then any solved result.
    """
    if any(result.interrupted for result in results):
        return EXIT_INTERRUPTED
    if any(result.status is Status.WRONG for result in results):
        return EXIT_WRONG_INPUT
    return min((_EXIT[result.status] for result in results), default=EXIT_NO_PLAN)


def prepare_folder(out: str | None) -> Path | None:
    """Return the folder for results, made if need be.

    Raises
    ------
    OptionError
        If it cannot be made or holds something already: no earlier result is ever overwritten.
    """
    if out is None:
        return None
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        occupied = next(folder.iterdir(), None)
    except OSError as error:
        raise OptionError(f"--out {out}: cannot be used: {error.strerror}.") from None
    if occupied is not None:
        raise OptionError(f"--out {out}: is not empty. Name a new folder.")
    return folder


def save(folder: Path, name: str, text: str) -> None:
    """Write a file in one piece: it is there whole or not at all."""
    handle, temporary = tempfile.mkstemp(dir=folder, suffix=".tmp")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, folder / name)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
