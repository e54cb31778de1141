"""Errors of plugins: messages that name the plugin with file and line.

No exception of a plugin ends the program, not even `SystemExit` or a `KeyboardInterrupt`. Only
signals, whose handlers raise `Interrupted`, and `SearchStopped` do.
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
    """Ctrl-C, SIGTERM or SIGHUP; raised by the handlers of the command line."""


def blame(
    error: BaseException,
    plugin: type,
    describe: Callable[[str], str],
    error_class: type[SkillplanError],
    ours: type[SkillplanError] = SkillplanError,
) -> NoReturn:
    """Raise an exception of a plugin as an error that names the plugin.

    Parameters
    ----------
    describe
        Returns the message for a description of the exception.
    error_class
        Class of the new error; `error` becomes its cause.
    ours
        Class of errors that are raised unchanged, as signals are.
    """
    if isinstance(error, ours) or ends_program(error):
        raise error
    raise error_class(describe(describe_exception(plugin, error))) from error


def ends_program(error: BaseException) -> bool:
    """Return whether an exception is a signal or a stop."""
    if isinstance(error, (SearchStopped, Interrupted)):
        return True
    # Without our handlers, as in a script, Python itself raises it for Ctrl-C.
    return isinstance(error, KeyboardInterrupt) and _python_hears_ctrl_c()


def describe_exception(plugin: type, error: BaseException) -> str:
    """Return the description of an exception, with file and line in the plugin.

    Parameters
    ----------
    error
        Exception; the message of our own errors is returned unchanged.
    """
    if isinstance(error, SkillplanError):
        return str(error)
    name, words = type(error).__name__, _words(error)
    words = f"{name}: {words}" if words else name
    place = _place_of(plugin, error)
    if not place:
        return words
    hint = "" if is_debugging() else "; SKILLPLAN_DEBUG=1 shows the traceback"
    return f"{words} ({place}{hint})"


def is_debugging() -> bool:
    """Return whether ``SKILLPLAN_DEBUG`` requests tracebacks."""
    return bool(os.environ.get("SKILLPLAN_DEBUG"))


def format_traceback(error: SkillplanError) -> str:
    """Return the traceback of a plugin's exception if `is_debugging`; else empty."""
    if not is_debugging():
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
    """Return ``FILE:LINE`` of the innermost frame in a plugin's package.

    If there is none, as for a call with a wrong number of arguments, that of the innermost frame.
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
