"""Printing of documents and tables, and writing of files and of the folder of a result."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillplan import errors
from skillplan.cli.writing import as_json, document_stream, tell, write_out
from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_as_one, write_new
from skillplan.files.folder import HeldFolder
from skillplan.files.output_path import check_output_path, report_write_errors
from skillplan.files.regular_file import read_bytes
from skillplan.records.result import Result, Status
from skillplan.records.stored.result_folder import RESULT, list_leftovers
from skillplan.views.text.table import Table, render

if TYPE_CHECKING:
    from skillplan.records.chain_result import ChainResult


class ResultFolder(HeldFolder):
    """A folder that one search will write its result into; a context manager.

    Parameters
    ----------
    out
        The folder, which is made if need be.

    Raises
    ------
    OptionError
        If it cannot be made, another search writes there, or it is not empty. Leftovers of a killed
        search are removed; an earlier result is never overwritten.
    """

    def __init__(self, out: str) -> None:
        super().__init__(out)
        with self._opening("search"):
            self._clear()

    def finish(self, beside: Mapping[str, str], document: str) -> None:
        """Write all files, the document last.

        Parameters
        ----------
        beside
            Content of the other files by name.
        document
            The result.

        Raises
        ------
        OptionError
            If a file cannot be written; none is left then.
        """
        write_folder(self.path, {**beside, RESULT: document})

    def _clear(self) -> None:
        left = list_leftovers(self.path)
        if left is None:
            raise OptionError(f"--out {self.path}: is not empty. Name a new folder.")
        for path in left:
            path.unlink(missing_ok=True)


def write_folder(folder: Path, contents: Mapping[str, str]) -> None:
    """Write the files of a folder as a whole; the last file marks the others as complete.

    Raises
    ------
    OptionError
        If a file cannot be written.
    """
    for name in contents:
        if Path(name).name != name:
            raise OptionError(f"--out {folder}: {name!r} is no name of a file in it.")
    try:
        write_as_one(folder, contents, within=folder)
    except OSError as error:
        name = Path(str(error.filename or folder)).name
        raise OptionError(f"--out {folder}: {name} cannot be written: {error.strerror}.") from None


def emit(
    style: str, document: dict[str, Any], tables: Sequence[Table], *, failed: bool = False
) -> None:
    """Print one JSON document, or tables, to stdout.

    CSV has rows only. If the command has `failed`, the notes of the tables go to stderr.
    """
    if style == "json":
        write_out(f"{as_json(document)}\n")
    else:
        # Text with marks for a terminal is escaped before.
        write_out(render(tables, style, document_stream()), marked=style == "table")
    if style == "csv" and failed:
        for note in (note for table in tables for note in table.notes):
            tell(note)


def exit_code(results: Sequence[Result | ChainResult]) -> int:
    """Return the exit code of a command that printed these results.

    An interruption comes first, then a failed back end, then a wrong claim or a failed solver, then
    any solved result. If all solvers refused, the input is wrong.
    """
    statuses = {result.status for result in results}
    return errors.exit_code(
        solved=bool(statuses & {Status.OPTIMAL, Status.SOLVED}),
        wrong=bool(statuses & {Status.WRONG, Status.FAILED}) or statuses == {Status.REFUSED},
        back_end_failed=any(result.back_end_failed for result in results),
        interrupted=any(result.interrupted for result in results),
    )


def write_new_files_beside(
    out: str, files: Mapping[str, bytes], suffixes: Collection[str], what: str
) -> None:
    """Write new files into the folder of ``--out``; one that has this content already stays.

    Parameters
    ----------
    files
        Contents by path, relative to the folder.
    suffixes, what
        As of `write_new_file`, for ``--out`` itself.

    Raises
    ------
    OptionError
        If a file exists already with other content, or cannot be written.
    """
    path = check_output_path("--out", out, suffixes, what)
    targets = {path.parent / name: content for name, content in files.items()}
    for target, content in targets.items():
        if target.exists() and (
            target.stat().st_size != len(content) or read_bytes(target, len(content)) != content
        ):
            raise OptionError(f"--out {out}: {target} is there already. Name another folder.")
    for target, content in targets.items():
        with report_write_errors("--out", target):
            target.parent.mkdir(parents=True, exist_ok=True)
            if not target.exists():
                write_new(target, content)


def write_new_file(out: str, text: str, suffixes: Collection[str], what: str) -> None:
    """Write a new file as a whole.

    Parameters
    ----------
    out
        The file of ``--out``.
    text
        Content of the file.
    suffixes
        Allowed suffixes.
    what
        Kind of content in the plural, for messages.

    Raises
    ------
    OptionError
        If it exists already, or cannot be written.
    """
    path = check_output_path("--out", out, suffixes, what)
    with report_write_errors("--out", path):
        try:
            write_new(path, text)
        except FileExistsError:
            raise OptionError(f"--out {out}: is there already. Name a new file.") from None
