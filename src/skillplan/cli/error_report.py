"""Reports of errors: messages on stderr, and with ``--format json`` one document on stdout."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any

import typer

from skillplan.cli.writing import tell, write_out
from skillplan.errors import SkillplanError, TaskError, exit_code
from skillplan.plugins.blame import format_traceback

_MOST_LINES = 200


def report_usage(error: typer.TyperException, words: Sequence[str]) -> int:
    """Report a wrong command line; return the exit code.

    Parameters
    ----------
    error
        The error of Typer.
    words
        The command line.
    """
    near = getattr(error, "possibilities", None)
    if near:
        error.message = f"No such option {error.option_name!r}. "  # type: ignore[attr-defined]
        error.message += f"Did you mean {' or '.join(map(repr, near))}?"
        error.possibilities = None  # type: ignore[attr-defined]
    # Without any words the help has been printed already.
    if type(error).__name__ != "NoArgsIsHelpError":
        shown = io.StringIO()
        error.show(file=shown)  # type: ignore[attr-defined]
        tell(shown.getvalue(), end="")
    _print_document(make_error_document(error), words)
    return error.exit_code


def report_error(error: SkillplanError, words: Sequence[str]) -> int:
    """Report an error that the user or a plugin author has to fix; return the exit code.

    Parameters
    ----------
    error
        The error, with a message or the faults of a file.
    words
        The command line.
    """
    lines = error.lines() if isinstance(error, TaskError) else [str(error)]
    shown = lines[:_MOST_LINES]
    for line in shown:
        tell(f"skillplan: error: {line}")
    if len(lines) > len(shown):
        tell(f"skillplan: and {len(lines) - len(shown)} more faults")
    tell(format_traceback(error), end="")
    _print_document(make_error_document(error), words)
    return error.exit_code


def report_bug(error: BaseException, words: Sequence[str]) -> None:
    """Report an error that is a bug of skillplan."""
    tell(
        f"skillplan: internal error: {type(error).__name__}: {error}\n"
        "This is a bug in skillplan. Set SKILLPLAN_DEBUG=1 to see where, and report it."
    )
    _print_document(make_error_document(error), words)


def make_error_document(error: BaseException) -> dict[str, Any]:
    """Return the JSON document ``skillplan.error/1``."""
    from skillplan.records import schemas

    issues = []
    if isinstance(error, TaskError):
        issues = [
            {
                "file": error.source,
                "line": issue.line or None,
                "column": issue.column or None,
                "path": list(issue.path),
                "message": issue.message,
            }
            for issue in error.issues
        ]
    usage = isinstance(error, typer.TyperException)
    return {
        "schema": schemas.ERROR,
        "error": type(error).__name__,
        "message": error.format_message() if usage else str(error),  # type: ignore[attr-defined]
        "exit_code": error.exit_code if usage else exit_code(error),  # type: ignore[attr-defined]
        "issues": issues,
    }


def _print_document(document: dict[str, Any], words: Sequence[str]) -> None:
    if _wants_json(words):
        with suppress(SkillplanError):
            write_out(f"{json.dumps(document, indent=2)}\n")


def _wants_json(words: Sequence[str]) -> bool:
    return "--format=json" in words or any(pair == ("--format", "json") for pair in pairwise(words))
