"""Reports of a command to its supervisor process, if there is one.

The command line runs in a child of the process that the user started
(`skillplan.workers.supervisor`). The child writes lines to a pipe: its activity, its limits, and at
last its exit code. A process that ends without this code has failed.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from skillplan.errors import BackEndError

BEGUN, ENDED, LIMITS, FINISHING, PRINTED, DONE = b"+", b"-", b"L", b"F", b"P", b"D"
SWALLOWED = b"S"
NO_LIMIT = b"none"
# Longer lines would not be written atomically.
_LINE_BYTES = 1000

# Signals from the supervisor: a request to stop, and the last one before it kills the process.
# Signals such as Ctrl-C also reach the child if they go to the process group; it ignores them, so
# that none counts twice.
REQUEST = getattr(signal, "SIGUSR1", None)
LAST_REQUEST = getattr(signal, "SIGUSR2", None)
# Ctrl-C, the interrupt of batch systems, and a closed terminal.
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


# Import time; this is one of the first modules that a command imports.
_IMPORTED_S = time.monotonic()


class _Line:
    """The pipe to the supervisor, and the reported limits."""

    number: int | None = None
    deadline_s: float | None = None
    limit_s: float | None = None
    # Time limit for the import of a plugin [s]; None for no limit.
    import_limit_s: float | None = None
    # Number of activities in progress, and whether a stop was requested.
    activities: int = 0
    is_stopping: bool = False
    # True if a signal has raised an exception, even if a library replaced it.
    is_interrupted: bool = False


_line = _Line()


def connect(number: int) -> None:
    """Use a pipe for reports from now on."""
    _line.number = number


def requests() -> tuple[signal.Signals, ...]:
    """Return the signals that request this process to stop."""
    if _line.number is None or REQUEST is None or LAST_REQUEST is None:
        return SIGNALS
    return (REQUEST, LAST_REQUEST)


def get_command_age_s() -> float:
    """Return the time since the start of the command [s]; 0 without a supervisor."""
    return 0.0 if _line.number is None else time.monotonic() - _IMPORTED_S


def limit_command(
    time_limit_s: float | None = None, memory_limit_bytes: int | None = None, grace_s: float = 0.0
) -> None:
    """Limit time and memory of the whole command.

    Past time limit and grace, an exception ends the command. If it still runs a second later, or
    exceeds the memory limit, it is killed with all its child processes. In both cases the exit code
    is 2, and a message names the limit.

    Parameters
    ----------
    time_limit_s
        Time from the start of the command [s], > 0; None for no limit.
    memory_limit_bytes
        Memory of the command and its processes together [bytes], > 0; None for no limit.
    grace_s
        Time after the limit for a regular end [s], >= 0.
    """
    if _line.number is None:
        return
    _line.limit_s = time_limit_s
    begun_s = time.monotonic() - get_command_age_s()
    _line.deadline_s = None if time_limit_s is None else begun_s + time_limit_s + grace_s
    texts = [
        NO_LIMIT if value is None else repr(value).encode()
        for value in (_line.deadline_s, time_limit_s, memory_limit_bytes)
    ]
    _report(LIMITS, b" ".join(texts))


def limit_imports(time_limit_s: float | None) -> None:
    """Limit the time for the import of a plugin [s]; None for no limit."""
    _line.import_limit_s = time_limit_s


def get_import_limit_s() -> float | None:
    """Return the limit set by `limit_imports`."""
    return _line.import_limit_s


def describe_passed_limit() -> str:
    """Return the message if the time limit has passed; else empty."""
    if _line.deadline_s is None or time.monotonic() < _line.deadline_s:
        return ""
    return format_time_limit(_line.limit_s or 0.0)


def format_time_limit(limit_s: float) -> str:
    """Return the message for a command that exceeded its time limit."""
    return f"The command took longer than --time-limit {limit_s:g} and was ended. Allow more time."


@contextmanager
def doing(
    activity: str,
    *,
    limit_s: float | None = None,
    forced: bool = False,
    exit_code: int = BackEndError.exit_code,
) -> Iterator[None]:
    """Name the present activity, for the message if the process dies in it.

    Parameters
    ----------
    activity
        Completes "while ...", such as ``importing the solver 'x' of x 1.0``.
    limit_s
        Time after which the supervisor ends the activity [s], > 0; None for no limit.
    forced
        True if it kills the process at once, without an exception before.
    exit_code
        Exit code of the command if the process dies here.
    """
    if _line.number is None:
        yield
        return
    limit = NO_LIMIT if limit_s is None else repr(limit_s).encode()
    name = activity.encode("utf-8", "replace")
    _report(BEGUN, b"%s %d %d %s" % (limit, forced, exit_code, name))
    _line.activities += 1
    try:
        yield
    finally:
        _line.activities -= 1
        _report(ENDED)
        if _line.is_stopping:
            report_stopping()


def note_interrupt() -> None:
    """Note that an exception is raised by a signal handler."""
    _line.is_interrupted = True


def is_interrupted() -> bool:
    """Return whether an exception was raised by a signal handler."""
    return _line.is_interrupted


def report_stopping() -> None:
    """Report that a request to stop was heard.

    Without an activity, only evaluation and output are left, for which the supervisor allows more
    time.
    """
    _line.is_stopping = True
    if _line.activities == 0:
        _report(FINISHING)


def report_swallowed() -> None:
    """Report that a callback lost the exception of a signal; it is raised again."""
    _report(SWALLOWED)


def report_printed() -> None:
    """Report that the document was printed, so that the supervisor prints none."""
    _report(PRINTED)


def report_done(exit_code: int) -> None:
    """Report the exit code; later events do not change it."""
    _report(DONE, b"%d" % exit_code)


def _report(kind: bytes, text: bytes = b"") -> None:
    if _line.number is not None:
        # This process ends with its supervisor anyway.
        with suppress(OSError):
            os.write(_line.number, kind + text.replace(b"\n", b" ")[:_LINE_BYTES] + b"\n")
