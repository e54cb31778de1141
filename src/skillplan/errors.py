"""Every error a user or plugin author has to repair, and the exit code of every outcome.

What a robot may meet (a blocked place, a missing support) is never an error: it is a
:class:`~skillplan.task.verdict.Verdict`.

::

    SkillplanError                exit code 2
    ├── TaskError                 a task file is wrong: all its issues, each with file:line:column
    ├── OptionError               an option, a skill name or a sequence is wrong
    ├── PluginError               an unknown, doubled, broken or unfit plugin
    ├── ModelTooLarge             an array export would exceed its limit
    ├── NotASequencing            a model is not a sequencing problem
    ├── ChainBroken               what a stage of a chain gave leaves nothing for the next
    ├── SolverError               a solver raised, or returned what is no solution
    └── BackEndError              a physics or collision back end failed        exit code 3

    SearchStopped                 exit code 130: a stop reached a solver that does not poll for it
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

# What every command ends with; `exit_code` says when.
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
    """Return the exit code of a command; the only place that knows which it is.

    Where several hold, what stands first below counts.

    Parameters
    ----------
    error
        What was raised, if anything: an error of this module says its code itself, Ctrl-C or a stop
        is an interruption, and anything else is a failure of the program, ``EXIT_BACK_END``.
    interrupted
        Whether it was stopped before its end: ``EXIT_INTERRUPTED``.
    back_end_failed
        Whether physics or collision checks failed, or two proofs contradict each other:
        ``EXIT_BACK_END``. No claim can be held against those.
    wrong
        Whether what was given or claimed is wrong: ``EXIT_WRONG_INPUT``.
    solved
        Whether there is a plan, or whatever else was wanted: ``EXIT_SOLVED``, else
        ``EXIT_NO_PLAN``.
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
        Where a plugin raised in another process; empty where it did in this one.
    """

    exit_code: ClassVar[int] = EXIT_WRONG_INPUT
    remote_traceback: str = ""


@dataclass(frozen=True, slots=True)
class Issue:
    """One fault of a task file.

    Parameters
    ----------
    message
        What is wrong and what to write instead.
    path
        Keys and indices from the root of the document to the fault.
    line, column
        Position in the file, both from 1; 0 while unknown.
    at_key
        Whether the fault is in the key that ends the path rather than in its value.
    """

    message: str
    path: tuple[str | int, ...] = ()
    line: int = 0
    column: int = 0
    at_key: bool = False

    def under(self, *path: str | int) -> Issue:
        """Return the issue with its path continued from `path`."""
        return replace(self, path=(*path, *self.path))

    def __str__(self) -> str:
        where = format_path(self.path)
        return f"{where}: {self.message}" if where else self.message


class TaskError(SkillplanError):
    """A task file cannot be used; carries all of its issues at once.

    Parameters
    ----------
    source
        The file as the user named it.
    issues
        At least one issue, printed in the order of their positions.
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
    """What one stage of a chain gave leaves the next without anything to choose from."""


class SolverError(SkillplanError):
    """A solver raised, or returned something else than a solution."""


class BackEndError(SkillplanError):
    """A physics or collision back end raised instead of returning a verdict."""

    exit_code = EXIT_BACK_END


class SearchStopped(BaseException):
    """Raised by the model in a solver that goes on long after it should have stopped.

    No `Exception`: what a solver does about its own errors must not swallow it.
    """


def format_path(path: Sequence[str | int]) -> str:
    """Return ``parts.pcb.size_m[2]`` for ``("parts", "pcb", "size_m", 2)``.

    A key that is no plain word stands quoted in brackets, so that it cannot pass for another
    path nor break the line.
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
    """Return the known name most like `name`, or None where none is near."""
    names = list(known)
    matches = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if matches:
        return matches[0]
    # A name cut short, with or without a slip: 'serch' for 'search-optimal'.
    beginnings = {known_name[: len(name) + 1]: known_name for known_name in names if len(name) > 3}
    matches = difflib.get_close_matches(name, list(beginnings), n=1, cutoff=0.7)
    return beginnings[matches[0]] if matches else None


def name_hint(name: str, known: Iterable[str], *, most: int = 12) -> str:
    """Return the sentence that helps after an unknown name: the nearest, else what there is.

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
