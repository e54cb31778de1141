"""Printing of documents and tables, and saving of single files."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from skillplan import errors
from skillplan.cli.writing import as_json, document_stream, tell, write_out
from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_new
from skillplan.files.output_path import check_output_path, report_write_errors
from skillplan.records.result import Result, Status
from skillplan.views.text.table import Table, render

if TYPE_CHECKING:
    from skillplan.records.chain_result import ChainResult


def emit(
    style: str, document: dict[str, Any], tables: Sequence[Table], *, failed: bool = False
) -> None:
    """Print one JSON document, or tables, to stdout.

    CSV holds rows only: where the command has `failed`, what the table would say below them
    goes to stderr.
    """
    if style == "json":
        write_out(f"{as_json(document)}\n")
    else:
        # What is marked for a terminal is escaped before.
        write_out(render(tables, style, document_stream()), marked=style == "table")
    if style == "csv" and failed:
        for note in (note for table in tables for note in table.notes):
            tell(note)


def exit_code(results: Sequence[Result | ChainResult]) -> int:
    """Return the exit code of a command that printed these results.

    Interrupted wins, then a back end that failed, then a wrong claim or a solver that failed, then
    any solved result; where all were refused, what was given does not fit.
    """
    found = {result.status for result in results}
    return errors.exit_code(
        solved=bool(found & {Status.OPTIMAL, Status.SOLVED}),
        wrong=bool(found & {Status.WRONG, Status.FAILED}) or found == {Status.REFUSED},
        back_end_failed=any(result.back_end_failed for result in results),
        interrupted=any(result.interrupted for result in results),
    )


def write_new_file(out: str, text: str, suffixes: Collection[str], what: str) -> None:
    """Write a file that is not there yet, in one piece.

    Parameters
    ----------
    out
        The file as ``--out`` names it.
    text
        What it is to hold.
    suffixes
        Those it may have.
    what
        What is written, in the plural.

    Raises
    ------
    OptionError
        If it is there already, or cannot be written.
    """
    path = check_output_path("--out", out, suffixes, what)
    with report_write_errors("--out", path):
        try:
            write_new(path, text)
        except FileExistsError:
            raise OptionError(f"--out {out}: is there already. Name a new file.") from None
