"""What lies in the folder of a result, and which folder or file a user means by a path."""

from __future__ import annotations

from pathlib import Path

RESULT = "result.json"
"""The document in the folder of a result, and in that of training runs."""
PLAN = "plan.csv"
"""The steps of the plan, beside the document."""
POLICIES = "policies.json"
"""What a solver has learned, beside the document."""
MANIFEST = "manifest.json"
"""Only a folder of training runs, or of a study, has it beside."""


def result_path(path: str) -> Path:
    """Return the file that a user means: the file itself, or result.json in a folder."""
    named = Path(path)
    return named / RESULT if named.is_dir() else named


def is_result(path: str) -> bool:
    """Return whether a path means a result of search-optimal: a folder that has one, or JSON."""
    if run_folder(path) is not None:
        return False
    named = Path(path)
    return (named / RESULT).is_file() if named.is_dir() else named.suffix == ".json"


def run_folder(path: str) -> str | None:
    """Return the folder of training runs that a path means: itself, or that of its result.json."""
    named = Path(path)
    if named.is_dir():
        return None if (named / RESULT).is_file() and not (named / MANIFEST).exists() else path
    of_runs = named.name == RESULT and (named.parent / MANIFEST).exists()
    return str(named.parent) if of_runs else None


def policies_path(path: str) -> str:
    """Return the file that a user means: the file itself, or policies.json in a folder."""
    named = Path(path)
    return str(named / POLICIES) if named.is_dir() else path
