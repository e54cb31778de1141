"""Printing of documents and tables, and saving of results."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skillplan.cli.writing import write_out
from skillplan.errors import (
    EXIT_INTERRUPTED,
    EXIT_NO_PLAN,
    EXIT_SOLVED,
    EXIT_WRONG_INPUT,
    OptionError,
)
from skillplan.files.atomic_file import write_whole
from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result, Status
from skillplan.views.tables.rendering import render
from skillplan.views.tables.table import Table

_EXIT = {
    Status.OPTIMAL: EXIT_SOLVED,
    Status.SOLVED: EXIT_SOLVED,
    Status.INFEASIBLE: EXIT_NO_PLAN,
    Status.UNSOLVED: EXIT_NO_PLAN,
    Status.REFUSED: EXIT_WRONG_INPUT,
    Status.WRONG: EXIT_WRONG_INPUT,
    Status.FAILED: EXIT_WRONG_INPUT,
}


def emit(
    style: str, document: dict[str, Any], tables: Sequence[Table], *, failed: bool = False
) -> None:
    """Print one JSON document, or tables, to stdout.

    CSV holds rows only: where the command has `failed`, what the table would say below them
    goes to stderr.
    """
    write_out(f"{as_json(document)}\n" if style == "json" else render(tables, style, sys.stdout))
    if style == "csv" and failed:
        for note in (note for table in tables for note in table.notes):
            print(note, file=sys.stderr)


def as_json(document: dict[str, Any]) -> str:
    """Return a document as JSON; a number that is not finite is a bug and raises ValueError."""
    return json.dumps(document, indent=2, allow_nan=False)


def exit_code(results: Sequence[Result | ChainResult]) -> int:
    """Return the exit code of a command that printed these results.

    Interrupted wins, then a wrong claim or a plugin that failed, then any solved result.
    """
    if any(result.interrupted for result in results):
        return EXIT_INTERRUPTED
    if any(result.status in (Status.WRONG, Status.FAILED) for result in results):
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
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OptionError(f"--out {out}: cannot be used: {reason}.") from None
    if occupied is not None:
        raise OptionError(f"--out {out}: is not empty. Name a new folder.")
    return folder


def save(folder: Path, name: str, text: str) -> None:
    """Write a file in one piece: it is there whole or not at all.

    Raises
    ------
    OptionError
        If it cannot be written.
    """
    try:
        write_whole(folder / name, text)
    except OSError as error:
        raise OptionError(f"--out {folder}: {name} cannot be written: {error.strerror}.") from None
