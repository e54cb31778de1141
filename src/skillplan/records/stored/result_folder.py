"""What lies in the folder of a result, and which folder or file a user means by a path.

All of it is written as one, with the document last: a folder without it is of a search that has
not finished.
"""

from __future__ import annotations

import os
from pathlib import Path

from skillplan.errors import OptionError
from skillplan.files.atomic_file import is_unfinished
from skillplan.files.regular_file import is_folder, is_regular

RESULT = "result.json"
"""The document in the folder of a result, and in that of training runs."""
PLAN = "plan.csv"
"""The steps of the plan, beside the document."""
POLICIES = "policies.json"
"""What a solver has learned, beside the document."""
MANIFEST = "manifest.json"
"""Only a folder of training runs, or of a study, has it beside."""
RELATIONAL = "relational.json"
"""A policy that carries over to other tasks; it lies in a folder of its own."""

# What may lie beside the document, and which a search that was killed may leave without it.
_BESIDE = {PLAN, POLICIES, "timeline.csv"}


def leftovers(folder: Path) -> list[Path] | None:
    """Return what a search has left that was killed while it wrote; None if anything else is there.

    What is to be removed last comes last: as long as it is there, the others are leftovers.

    Parameters
    ----------
    folder
        Of a result.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    names = set()
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name not in _BESIDE and not is_unfinished(entry.name):
                return None
            names.add(entry.name)
    last = sorted(name for name in names if is_unfinished(name, RESULT))
    if not last and names & _BESIDE:
        return None
    return [folder / name for name in (*sorted(names.difference(last)), *last)]


def check_finished(path: str) -> None:
    """See that a folder is not that of a search that was killed, or is under way.

    Raises
    ------
    OptionError
        If it is empty, or holds what such a search leaves.
    """
    if not is_folder(path):
        return
    try:
        left = leftovers(Path(path))
    except OSError:
        return  # whoever reads a file of it says so
    if left is not None:
        lacks = f"holds no {RESULT}" if left else "is empty"
        raise OptionError(
            f"{path}: {lacks}: the command that was to write there has not finished. Repeat it "
            "with the same --out."
        )


def result_path(path: str) -> Path:
    """Return the file that a user means: the file itself, or result.json in a folder."""
    named = Path(path)
    return named / RESULT if is_folder(named) else named


def is_result(path: str) -> bool:
    """Return whether a path means a result of search-optimal: a folder that has one, or JSON.

    Raises
    ------
    OptionError
        If it is a folder whose search has not finished.
    """
    if run_folder(path) is not None:
        return False
    named = Path(path)
    return is_regular(named / RESULT) if is_folder(named) else named.suffix == ".json"


def run_folder(path: str) -> str | None:
    """Return the folder of training runs that a path means: itself, or that of its result.json.

    Raises
    ------
    OptionError
        If it is a folder of a search that has not finished.
    """
    named = Path(path)
    if is_folder(named):
        check_finished(path)
        return None if is_regular(named / RESULT) and not _is_there(named / MANIFEST) else path
    of_runs = named.name == RESULT and _is_there(named.parent / MANIFEST)
    return str(named.parent) if of_runs else None


def is_relational(path: str) -> bool:
    """Return whether a path is a folder with a policy that carries over to other tasks."""
    return is_regular(Path(path) / RELATIONAL)


def policies_path(path: str) -> str:
    """Return the file that a user means: the file itself, or policies.json in a folder."""
    named = Path(path)
    return str(named / POLICIES) if is_folder(named) else path


def _is_there(path: Path) -> bool:
    return is_regular(path) or is_folder(path)


def file_beside(path: str, name: str) -> Path | None:
    """Return a file beside a result; None where there is none, or the result is in no folder."""
    result = result_path(path)
    beside = result.parent / name
    there = beside.exists() or beside.is_symlink()
    return beside if result.name == RESULT and there else None
