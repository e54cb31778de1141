"""What a command reports to the process that supervises it; without a supervisor, to nothing.

The command line runs in a child of the process that the user started (`skillplan.workers.
supervisor`). The child writes lines to a pipe: what it is doing, its limits, and its exit code as
the last one. A process that ends without that code has failed, whatever its own code.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from skillplan.errors import BackEndError

# First letters of the lines.
BEGUN, ENDED, LIMITS, FINISHING, PRINTED, DONE = b"+", b"-", b"L", b"F", b"P", b"D"
SWALLOWED = b"S"
NO_LIMIT = b"none"
# A longer line would not be written in one piece.
_LINE_BYTES = 1000

# How the supervisor passes a signal on: as a request to stop, and as the last one before it ends
# the process. The signals themselves also reach the child if they go to the group of processes, as
# Ctrl-C does; it does not react to them, so that none counts twice.
REQUEST = getattr(signal, "SIGUSR1", None)
LAST_REQUEST = getattr(signal, "SIGUSR2", None)
# Ctrl-C, what a batch system interrupts by, and a terminal that is closed.
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


# One of the first modules that a command imports.
_IMPORTED_S = time.monotonic()


class _Line:
    """The pipe to the supervisor, and the limits that were reported through it."""

    number: int | None = None
    deadline_s: float | None = None
    limit_s: float | None = None
    # So long a plugin may take to be imported [s]; None for no limit.
    import_limit_s: float | None = None
    # How many activities are under way, and whether they were requested to stop.
    activities: int = 0
    is_stopping: bool = False
    # Whether a signal has raised an exception, which a library may have wrapped in its own.
    is_interrupted: bool = False


_line = _Line()


def connect(number: int) -> None:
    """Report through a pipe from now on."""
    _line.number = number


def is_supervised() -> bool:
    """Whether another process supervises this one."""
    return _line.number is not None


def requests() -> tuple[signal.Signals, ...]:
    """Return the signals that request this process to stop."""
    if _line.number is None or REQUEST is None or LAST_REQUEST is None:
        return SIGNALS
    return (REQUEST, LAST_REQUEST)


def command_age_s() -> float:
    """Return the time since the command was started [s]; 0 without a supervisor."""
    return 0.0 if _line.number is None else time.monotonic() - _IMPORTED_S


def limit_command(
    time_limit_s: float | None = None,
    memory_limit_bytes: int | None = None,
    grace_s: float = 0.0,
) -> None:
    """Have the whole command ended once it takes too long or holds too much memory.

    Past time limit and grace an exception ends the command; if it is still there a second later,
    or past the memory limit, it is killed with all processes that it has started. In both cases
    the exit code is 2 and a message names the limit.

    Parameters
    ----------
    time_limit_s
        Time from the start of the command [s], > 0; None for no limit.
    memory_limit_bytes
        Memory of the command and all its processes together [B], > 0; None for no limit.
    grace_s
        Time after the limit in which the command may still end by itself [s], >= 0.
    """
    if _line.number is None:
        return
    _line.limit_s = time_limit_s
    begun_s = time.monotonic() - command_age_s()
    _line.deadline_s = None if time_limit_s is None else begun_s + time_limit_s + grace_s
    texts = [
        NO_LIMIT if value is None else repr(value).encode()
        for value in (_line.deadline_s, time_limit_s, memory_limit_bytes)
    ]
    _report(LIMITS, b" ".join(texts))


def limit_imports(time_limit_s: float | None) -> None:
    """Limit how long the import of a single plugin may take [s]; None for no limit."""
    _line.import_limit_s = time_limit_s


def import_limit_s() -> float | None:
    """Return the limit of `limit_imports`."""
    return _line.import_limit_s


def passed_limit() -> str:
    """Return the message if the time limit of the whole command has passed; else empty."""
    if _line.deadline_s is None or time.monotonic() < _line.deadline_s:
        return ""
    return time_limit_message(_line.limit_s or 0.0)


def time_limit_message(limit_s: float) -> str:
    """Return the message for a command that was ended by its time limit."""
    return f"The command took longer than --time-limit {limit_s:g} and was ended. Allow more time."


@contextmanager
def doing(
    activity: str,
    *,
    limit_s: float | None = None,
    forced: bool = False,
    exit_code: int = BackEndError.exit_code,
) -> Iterator[None]:
    """Name the present activity, for the message if the process does not survive it.

    Parameters
    ----------
    activity
        Completes "while ...", such as ``importing the solver 'x' of x 1.0``.
    limit_s
        Time after which the supervisor ends the activity [s], > 0; None for no limit.
    forced
        Whether it then kills the process at once, and does not raise an exception in it first.
    exit_code
        Exit code of the command if the process ends here.
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
    """Whether an exception was raised by a signal handler."""
    return _line.is_interrupted


def report_stopping() -> None:
    """Report that a request to stop was heard.

    If no activity is under way, only its result is left to be judged and written, for which the
    supervisor gives more time than for the activity itself.
    """
    _line.is_stopping = True
    if _line.activities == 0:
        _report(FINISHING)


def report_swallowed() -> None:
    """Report that the exception of a signal was lost in a callback, so that it is raised again."""
    _report(SWALLOWED)


def report_printed() -> None:
    """Report that the document was printed, so that the supervisor prints none."""
    _report(PRINTED)


def report_done(exit_code: int) -> None:
    """Report the exit code; whatever happens to the process afterwards does not matter."""
    _report(DONE, b"%d" % exit_code)


def _report(kind: bytes, text: bytes = b"") -> None:
    if _line.number is not None:
        # A supervisor that is gone takes this process with it.
        with suppress(OSError):
            os.write(_line.number, kind + text.replace(b"\n", b" ")[:_LINE_BYTES] + b"\n")
