"""All errors that users or plugin authors can fix, and the exit codes.

Situations of a robot (a blocked place, a missing support) are never errors: they are a
:class:`~skillplan.task.verdict.Verdict`.

::

    SkillplanError                exit code 2
    ├── TaskError                 a task file is wrong: all its issues, each with file:line:column
    ├── OptionError               an option, a skill name or a sequence is wrong
    ├── PluginError               an unknown, doubled, broken or unfit plugin
    ├── ModelTooLarge             an array export would exceed its limit
    ├── NotASequencing            a model is not a sequencing problem
    ├── ChainBroken               the result of a stage leaves the next one no choice
    ├── SolverError               a solver raised, or did not return a solution
    └── BackEndError              a physics or collision back end failed        exit code 3

    SearchStopped                 exit code 130: a stop reached a solver that does not poll for it
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

# Exit codes of the commands; see `exit_code`.
EXIT_SOLVED = 0
EXIT_NO_PLAN = 1
EXIT_WRONG_INPUT = 2
EXIT_BACK_END = 3
EXIT_INTERRUPTED = 130


def exit_code(
    error: BaseException | None = None,
    *,
    solved: bool = True,
    back_end_failed: bool = False,
    wrong: bool = False,
    interrupted: bool = False,
) -> int:
    """Return the exit code of a command; the only function that decides it.

    If several apply, the first of these parameters counts.

    Parameters
    ----------
    error
        Exception, or None: errors of this module have a code; Ctrl-C or a stop is an interruption;
        anything else is a failure of the program, ``EXIT_BACK_END``.
    interrupted
        True if the command was interrupted: ``EXIT_INTERRUPTED``.
    back_end_failed
        True if checks failed, or two proofs contradict each other: ``EXIT_BACK_END``.
    wrong
        True if the input or a claim is wrong: ``EXIT_WRONG_INPUT``.
    solved
        True if there is a plan or another result: ``EXIT_SOLVED``, else ``EXIT_NO_PLAN``.
    """
    if isinstance(error, SkillplanError):
        return error.exit_code
    if interrupted or isinstance(error, KeyboardInterrupt | SearchStopped):
        return EXIT_INTERRUPTED
    if back_end_failed:
        return EXIT_BACK_END
    if wrong:
        return EXIT_WRONG_INPUT
    if error is not None:
        return EXIT_BACK_END
    return EXIT_SOLVED if solved else EXIT_NO_PLAN


class SkillplanError(Exception):
    """Base of all errors; ``str(error)`` is the message for the user.

    Attributes
    ----------
    remote_traceback
        Traceback from another process; else empty.
    """

    exit_code: ClassVar[int] = EXIT_WRONG_INPUT
    remote_traceback: str = ""


@dataclass(frozen=True, slots=True)
class Issue:
    """A fault of a task file.

    Parameters
    ----------
    message
        Fault and remedy.
    path
        Keys and indices from the root of the document.
    line, column
        Position in the file, from 1; 0 if unknown.
    at_key
        True if the fault is in the last key of the path rather than in its value.
    """

    message: str
    path: tuple[str | int, ...] = ()
    line: int = 0
    column: int = 0
    at_key: bool = False

    def under(self, *path: str | int) -> Issue:
        """Return the issue with `path` put before its own."""
        return replace(self, path=(*path, *self.path))

    def __str__(self) -> str:
        where = format_path(self.path)
        return f"{where}: {self.message}" if where else self.message


class TaskError(SkillplanError):
    """A task file cannot be used; with all its issues.

    Parameters
    ----------
    source
        The file as given by the user.
    issues
        Issues, at least one; printed in the order of their positions.
    """

    def __init__(self, source: str, issues: Iterable[Issue]) -> None:
        self.source = source
        self.issues = tuple(sorted(issues, key=lambda issue: (issue.line, issue.column)))
        super().__init__("\n".join(self.lines()))

    def lines(self) -> list[str]:
        """One line ``file:line:column: key.path: message`` for each issue."""
        return [
            f"{self.source}:{issue.line}:{issue.column}: {issue}"
            if issue.line
            else f"{self.source}: {issue}"
            for issue in self.issues
        ]


class OptionError(SkillplanError):
    """An option, skill name or sequence given on the command line is wrong."""


class PluginError(SkillplanError):
    """A plugin is unknown, provided twice, cannot be imported or has the wrong base class."""


class ModelTooLarge(SkillplanError):
    """A model has more states than an array export may hold."""


class NotASequencing(SkillplanError):
    """A model does not have the structure of a sequencing problem."""


class ChainBroken(SkillplanError):
    """The result of a stage leaves no choice for the next stage of a chain."""


class SolverError(SkillplanError):
    """A solver raised, or did not return a solution."""


class BackEndError(SkillplanError):
    """A physics or collision back end raised instead of returning a verdict."""

    exit_code = EXIT_BACK_END


class SearchStopped(BaseException):
    """Raised by the model in a solver that is overdue.

    Not derived from `Exception`, so that no handler of a solver catches it.
    """


def format_path(path: Sequence[str | int]) -> str:
    """Return ``parts.pcb.size_m[2]`` for ``("parts", "pcb", "size_m", 2)``.

    Other keys are quoted in brackets, so that paths stay unique and on one line.
    """
    text = ""
    for key in path:
        if isinstance(key, int):
            text += f"[{key}]"
        elif key.replace("-", "_").replace("_", "a").isalnum() and len(key) <= 64:
            text += f".{key}" if text else key
        else:
            text += f"[{key if len(key) <= 48 else key[:45] + '...'!r}]"
    return text


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the most similar known name, or None."""
    names = list(known)
    matches = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if matches:
        return matches[0]
    # An abbreviated name, such as 'serch' for 'search-optimal'.
    beginnings = {known_name[: len(name) + 1]: known_name for known_name in names if len(name) > 3}
    matches = difflib.get_close_matches(name, list(beginnings), n=1, cutoff=0.7)
    return beginnings[matches[0]] if matches else None


def name_hint(name: str, known: Iterable[str], *, most: int = 12) -> str:
    """Return a hint for an unknown name: the most similar one, or all names.

    Examples
    --------
    >>> name_hint("exat", ["exact", "exhaustive"])
    "Did you mean 'exact'?"
    """
    names = sorted(set(known))
    match = nearest(name, names)
    if match is not None:
        return f"Did you mean {match!r}?"
    if not names:
        return "There is none."
    shown = ", ".join(names[:most])
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return f"Known: {shown}{rest}."
