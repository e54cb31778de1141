"""Task files that a received document names: used, but not quoted.

A manifest or a result may come from anybody, and may name any file of the reader. So what is wrong
with such a file is told by its place alone, and what it holds otherwise only where it lies beside
the document or in the current folder, or is the task that the document is of.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from skillplan.errors import Issue, OptionError, PluginError, TaskError


@contextmanager
def unquoted(document: str, file: str) -> Iterator[None]:
    """Word what is wrong with a file so that nothing of its content is told.

    Parameters
    ----------
    document
        What names the file.
    file
        The file.

    Raises
    ------
    TaskError
        If anything within raises one: the same file and place, without what stands there.
    OptionError
        Likewise.
    """
    try:
        yield
    except TaskError as error:
        if isinstance(error.__cause__, PluginError):
            raise  # it quotes the kind alone, which is a known one
        first = error.issues[0]
        message = (
            f"is no sound task file here. {document} names it, so it is not quoted: see "
            f"'skillplan check {file}', or name another by --task."
        )
        raise TaskError(error.source, [Issue(message, (), first.line, first.column)]) from None
    except OptionError:
        raise OptionError(
            f"{document}: what it says was changed of {file} does not fit that file, which is not "
            "quoted. Name the task file by --task."
        ) from None


def is_near(file: str, document_folder: Path) -> bool:
    """Whether a file lies in the current folder, or in the one that holds a document's folder.

    Parameters
    ----------
    file
        The file.
    document_folder
        The folder of the document that names it.
    """
    real = Path(os.path.realpath(file))
    beside = os.path.realpath(document_folder / os.pardir)
    try:
        here = os.getcwd()
    except OSError:
        return real.is_relative_to(beside)
    return real.is_relative_to(beside) or real.is_relative_to(here)
