"""What a plugin raises, in words that name it with file and line; and who ends the program.

Nothing that a plugin raises ends the program: neither `SystemExit` nor a `KeyboardInterrupt` of its
own making. What does are signals, whose handlers raise `Interrupted`, and `SearchStopped`.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from skillplan.errors import SearchStopped, SkillplanError


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, SIGTERM or SIGHUP, as the handlers of the command line raise it."""


def blame(
    error: BaseException,
    plugin: type,
    say: Callable[[str], str],
    made: type[SkillplanError],
    ours: type[SkillplanError] = SkillplanError,
) -> NoReturn:
    """Raise what a plugin raised, as an error that names it.

    Parameters
    ----------
    error
        What came out of the call.
    plugin
        The class of the plugin.
    say
        Returns the message, given what was raised in words.
    made
        The class of the error that blames the plugin; `error` becomes its cause.
    ours
        Errors of this class are in words already and are raised as they are. So are signals.
    """
    if isinstance(error, ours) or ends_program(error):
        raise error
    raise made(say(raised_by(plugin, error))) from error


def ends_program(error: BaseException) -> bool:
    """Whether an error is a signal or a stop, and not what a plugin made up."""
    if isinstance(error, (SearchStopped, Interrupted)):
        return True
    # Without handlers of ours, as in a script, Ctrl-C is Python's own.
    return isinstance(error, KeyboardInterrupt) and _python_hears_ctrl_c()


def raised_by(plugin: type, error: BaseException) -> str:
    """Return what a plugin raised, with file and line of the plugin's own code.

    Parameters
    ----------
    plugin
        The class of the plugin.
    error
        What it raised. One of ours is in words already and is returned as it is.
    """
    if isinstance(error, SkillplanError):
        return str(error)
    name, words = type(error).__name__, _words(error)
    words = f"{name}: {words}" if words else name
    place = _place_of(plugin, error)
    if not place:
        return words
    hint = "" if debugging() else "; SKILLPLAN_DEBUG=1 shows the traceback"
    return f"{words} ({place}{hint})"


def debugging() -> bool:
    """Whether ``SKILLPLAN_DEBUG`` demands tracebacks."""
    return bool(os.environ.get("SKILLPLAN_DEBUG"))


def traceback_text(error: SkillplanError) -> str:
    """Return the traceback of what a plugin raised where `debugging`; empty otherwise."""
    if not debugging():
        return ""
    if error.remote_traceback or error.__cause__ is None:
        return error.remote_traceback
    import traceback

    return "".join(traceback.format_exception(error.__cause__))


def _words(error: BaseException) -> str:
    try:
        return str(error)
    except Exception as worse:
        return f"its message cannot be read, {type(worse).__name__}"


def _python_hears_ctrl_c() -> bool:
    return signal.getsignal(signal.SIGINT) is signal.default_int_handler


def _place_of(plugin: type, error: BaseException) -> str:
    """Return ``FILE:LINE`` of the innermost code of a plugin's package that an error went through.

    Where none of it is, as for a call with a wrong number of arguments, that of the innermost.
    """
    module = sys.modules.get(plugin.__module__.partition(".")[0])
    file = getattr(module, "__file__", None)
    root = None if file is None else Path(file)
    if root is not None and root.name == "__init__.py":
        root = root.parent
    own = last = ""
    step = error.__traceback__
    while step is not None:
        last = f"{step.tb_frame.f_code.co_filename}:{step.tb_lineno}"
        if root is not None and Path(step.tb_frame.f_code.co_filename).is_relative_to(root):
            own = last
        step = step.tb_next
    return own or last
