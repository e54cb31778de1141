"""The files in the folder of a result, and the meaning of a path that the user gives.

All files are written as one, with the document last. A folder without it belongs to a search that
has not finished.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from skillplan.errors import OptionError
from skillplan.files.atomic_file import is_unfinished
from skillplan.files.regular_file import is_folder, is_regular

RESULT = "result.json"
"""The document in the folder of a result, and in that of training runs."""
PLAN = "plan.csv"
"""File with the steps of the plan."""
POLICIES = "policies.json"
"""File with the learned policies."""
FRONT_POINTS, FRONT_PICTURE = "front.csv", "front.svg"
"""Files with the points of a Pareto front, and its picture."""
MANIFEST = "manifest.json"
"""Marks a folder of training runs, or of a study."""
RELATIONAL = "relational.json"
"""A policy that carries over to other tasks; it lies in a folder of its own."""

# Files that a killed search may leave without the document.
_BESIDE = {PLAN, POLICIES, FRONT_POINTS, FRONT_PICTURE, "timeline.csv"}


def list_leftovers(folder: Path) -> list[Path] | None:
    """Return the files of a search that was killed while it wrote; None if there are other files.

    The file that marks the others as leftovers is the last one, to be removed last.

    Parameters
    ----------
    folder
        Folder of a result.

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
    """Check that the search of a folder has finished.

    Raises
    ------
    OptionError
        If the folder is empty, or holds list_leftovers of a search.
    """
    if not is_folder(path):
        return
    try:
        left = list_leftovers(Path(path))
    except OSError:
        return  # reading a file reports the error
    if left is not None:
        lacks = f"holds no {RESULT}" if left else "is empty"
        raise OptionError(
            f"{path}: {lacks}: the command that was to write there has not finished. Repeat it "
            "with the same --out."
        )


def find_result_path(path: str) -> Path:
    """Return the result file of a path, which is a file or a folder with result.json."""
    named = Path(path)
    return named / RESULT if is_folder(named) else named


def is_result(path: str) -> bool:
    """Return whether a path is a result of search-optimal: a folder with one, or JSON.

    Raises
    ------
    OptionError
        If it is a folder whose search has not finished.
    """
    if find_run_folder(path) is not None:
        return False
    named = Path(path)
    return is_regular(named / RESULT) if is_folder(named) else named.suffix == ".json"


def find_run_folder(path: str) -> str | None:
    """Return the folder of training runs of a path, which is the folder or its result.json.

    Raises
    ------
    OptionError
        If it is the folder of a search that has not finished.
    """
    named = Path(path)
    if is_folder(named):
        check_finished(path)
        return None if is_regular(named / RESULT) and not _is_there(named / MANIFEST) else path
    of_runs = named.name == RESULT and _is_there(named.parent / MANIFEST)
    return str(named.parent) if of_runs else None


def find_run_folders(paths: Sequence[str], command: str) -> tuple[list[str], list[str]]:
    """Return the folders of training runs of paths, each once, and notes on repeated ones.

    Both are empty if a single path is no such folder.

    Parameters
    ----------
    command
        Name of the command, for messages.

    Raises
    ------
    OptionError
        If one of several paths does not exist or is no folder of runs, or a search has not
        finished.
    """
    folders: dict[str, str] = {}
    notes = []
    for path in paths:
        folder = find_run_folder(path)
        if folder is None:
            if len(paths) == 1:
                return [], []
            if not os.path.exists(path):
                raise OptionError(f"{path}: no such file or folder.")
            raise OptionError(
                f"{path} is not a folder of training runs, so {command} takes it alone."
            )
        place = os.path.realpath(folder)
        if place in folders:
            notes.append(f"{path} is the folder {folders[place]} again: it counts once")
        else:
            folders[place] = folder
    return list(folders.values()), notes


def is_relational(path: str) -> bool:
    """Return whether a path is a folder with a policy that carries over to other tasks."""
    return is_regular(Path(path) / RELATIONAL)


def find_policies_path(path: str) -> str:
    """Return the policy file of a path, which is a file or a folder with policies.json."""
    named = Path(path)
    return str(named / POLICIES) if is_folder(named) else path


def _is_there(path: Path) -> bool:
    return is_regular(path) or is_folder(path)


def find_file_beside(path: str, name: str) -> Path | None:
    """Return another file in the folder of a result; None if it, or the folder, is missing."""
    result = find_result_path(path)
    beside = result.parent / name
    there = beside.exists() or beside.is_symlink()
    return beside if result.name == RESULT and there else None
