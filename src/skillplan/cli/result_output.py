"""The folder of a result, which is held during the search and written as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_as_one
from skillplan.files.folder import HeldFolder
from skillplan.records.stored.result_folder import RESULT, list_leftovers


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
