"""The process that the user started: it runs the command in a child, and ends it if needed.

A plugin may end the process with exit code 0 before there is an answer, crash it, or hang. So only
the exit code counts that the child reports through a pipe as its last action. This process handles
signals, limits and hanging children; it loads no plugin and no library. A fork at this point takes
less than a millisecond.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from skillplan.errors import exit_code
from skillplan.workers import supervised
from skillplan.workers.processes import measure_resident_bytes_of

# Times from the first signal, or a limit, to an exception in the child, and to its end [s].
_PATIENCE_S, _LAST_PATIENCE_S = 2.0, 1.0
# Time for evaluation and output after a search stopped at a signal [s].
_FINISHING_S = 30.0
# Time from the reported exit code to the end of the process [s].
_EXIT_S = 5.0
# Two signals within this time count once: one goes to the process, one to its group [s].
_SAME_SIGNAL_S = 0.1
# Delay before a lost exception of a signal is raised again [s].
_AGAIN_S = 0.05
# Interval of memory measurements, if memory is limited [s].
_MEMORY_EVERY_S = 0.1

Command = Callable[[], int]
# Reports a failure: message, exit code, and whether a document may still be printed.
Report = Callable[[str, int, bool], None]


def supervise(
    load: Callable[[], Command],
    report: Report,
    request: Callable[..., None],
    mask: Iterable[int] | None = None,
) -> int:
    """Run a command in a child process and return its exit code; never returns in the child.

    A signal that arrives after the end of the command does not change the exit code.

    Parameters
    ----------
    load
        Imports and returns the command; called in the child.
    report
        Called if the child fails or is killed.
    request
        Signal handler of the child outside of searches.
    mask
        Signals that stay blocked after handlers are set; None for those blocked now.
    """
    # Signals that are ignored, as by nohup or in the background of a shell, stay ignored.
    heard = [number for number in supervised.SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    requests: Iterable[int] = heard
    is_child = False
    if supervised.REQUEST is not None and hasattr(os, "fork"):
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, heard)
        mask = blocked if mask is None else mask
        try:
            watch = _fork(heard, mask, report)
        except OSError:
            # Without a process or pipe, the command runs without a supervisor.
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            mask = None
        else:
            if watch is not None:
                return watch.conclude(watch.until_end())
            is_child, requests = True, supervised.requests()
    code: int | None = None
    while True:
        try:
            if code is None:
                for number in requests:
                    signal.signal(number, request)
                if mask is not None:
                    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
                code = load()()
            _ignore_requests()
        except KeyboardInterrupt:
            if code is None:
                os.write(2, b"skillplan: interrupted\n")
                code = exit_code(interrupted=True)
            continue
        except BaseException:
            # Errors arrive here with SKILLPLAN_DEBUG.
            sys.excepthook(*sys.exc_info())
            code = exit_code(back_end_failed=True)
            continue
        break
    if is_child:
        supervised.report_done(code)
        sys.exit(code)
    return code


def _fork(heard: list[signal.Signals], mask: Iterable[int], report: Report) -> _Watch | None:
    """Start the child; return its watch in this process, and None in the child.

    Raises
    ------
    OSError
        If no process or pipe is to be had.
    """
    # Before the fork: a child leaves no exit code if its parent ignores SIGCHLD.
    on_child = signal.signal(signal.SIGCHLD, _nothing)
    folder = _temporary_folder()
    near, far = os.pipe()
    alive, parent = os.pipe()
    wake, woken = os.pipe()
    process = os.fork()
    if process == 0:
        signal.signal(signal.SIGCHLD, on_child)
        if folder:
            os.environ["TMPDIR"] = folder
        for number in (near, parent, wake, woken):
            os.close(number)
        _die_with_parent(alive)
        supervised.connect(far)
        sys.unraisablehook = _report_unraisable
        for number in heard:
            signal.signal(number, _nothing)
        return None
    os.close(far)
    os.close(alive)
    os.set_blocking(woken, False)
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
    for number in heard:
        signal.signal(number, _nothing)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    return _Watch(process, near, wake, set(heard), report, folder)


def _temporary_folder() -> str:
    """Return a new folder for temporary files, which is removed even if the child is killed.

    Empty if the disk is full; then the child uses the default folder.
    """
    for place in (os.environ.get("TMPDIR", ""), "/tmp", "/var/tmp"):
        # The current folder may be gone; then a relative path is useless.
        with suppress(OSError):
            if place:
                folder = os.path.join(os.path.abspath(place), f"skillplan-{os.urandom(6).hex()}")
                os.mkdir(folder, 0o700)
                return folder
    return ""


def _remove(folder: str) -> None:
    try:
        os.rmdir(folder)
    except OSError:
        import shutil

        shutil.rmtree(folder, ignore_errors=True)


def _report_unraisable(unraisable: sys.UnraisableHookArgs) -> None:
    """Print an exception that cannot be raised, unless it is that of a signal."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        supervised.report_swallowed()
    else:
        sys.__unraisablehook__(unraisable)


def _ignore_requests() -> None:
    for number in supervised.requests():
        signal.signal(number, signal.SIG_IGN)


def _die_with_parent(alive: int) -> None:
    """Kill this process as soon as the other end of a pipe is closed, as by SIGKILL."""
    import fcntl

    if hasattr(fcntl, "F_SETSIG"):
        with suppress(OSError):
            fcntl.fcntl(alive, fcntl.F_SETOWN, os.getpid())
            fcntl.fcntl(alive, fcntl.F_SETSIG, signal.SIGKILL)
            fcntl.fcntl(alive, fcntl.F_SETFL, os.O_ASYNC)
            return
    import threading

    threading.Thread(target=_await_end, args=(alive,), daemon=True).start()


def _await_end(alive: int) -> None:
    os.read(alive, 1)
    os._exit(1)


def _nothing(number: int, frame: object) -> None:
    """Do nothing: the signal is in the wake-up pipe, or another process handles it."""


def _exit_interrupted(number: int, frame: object) -> None:
    os._exit(exit_code(interrupted=True))


class _Activity(NamedTuple):
    """An activity of the child: see `supervised.doing`."""

    deadline_s: float | None
    limit_s: float
    forced: bool
    exit_code: int
    name: str


class _Watch:
    """A child process, its reports, and its time limits.

    Parameters
    ----------
    process
        Process id of the child.
    line
        Pipe with its reports.
    wake
        Pipe with the numbers of signals.
    heard
        Signals that interrupt.
    folder
        Temporary folder of the child, removed after it; empty for none.
    """

    def __init__(
        self,
        process: int,
        line: int,
        wake: int,
        heard: set[signal.Signals],
        report: Report,
        folder: str = "",
    ) -> None:
        self._folder = folder
        self._process = process
        self._line = line
        self._wake = wake
        self._heard = heard
        self._report = report
        self._text = b""
        self._code: int | None = None
        self._printed = False
        # The last one is the innermost.
        self._activities: list[_Activity] = []
        self._deadline_s: float | None = None
        self._limit_s = 0.0
        self._memory_limit_bytes: int | None = None
        self._signalled_s: float | None = None
        self._again_s: float | None = None
        # Time and reason of the next step against a child that does not stop.
        self._next_s: float | None = None
        self._is_last = False
        self._why = ""

    def until_end(self) -> int:
        """Return the exit code of the child after its end, or minus the signal."""
        poll = select.poll()
        for number in (self._line, self._wake):
            poll.register(number, select.POLLIN)
        while True:
            for number, event in poll.poll(self._pause_ms()):
                if number == self._wake:
                    self._hear_signals()
                elif not self._read() and event:
                    poll.unregister(self._line)
            ended, status = os.waitpid(self._process, os.WNOHANG)
            if ended:
                while self._read():
                    pass
                if self._folder:
                    _remove(self._folder)
                return os.waitstatus_to_exitcode(status)
            self._act(time.monotonic())

    def _pause_ms(self) -> float | None:
        """Return the time until the next step [ms], or None."""
        due = [
            self._again_s,
            self._next_s,
            self._deadline_s,
            *(activity.deadline_s for activity in self._activities),
        ]
        if self._memory_limit_bytes is not None:
            due.append(time.monotonic() + _MEMORY_EVERY_S)
        known = [time_s for time_s in due if time_s is not None]
        return max(0.0, (min(known) - time.monotonic()) * 1000 + 1) if known else None

    def _hear_signals(self) -> None:
        with suppress(BlockingIOError):
            for number in os.read(self._wake, 4096):
                if number in self._heard:
                    self._interrupt(time.monotonic())

    def _interrupt(self, now_s: float) -> None:
        if self._signalled_s is not None and now_s < self._signalled_s + _SAME_SIGNAL_S:
            return
        again, self._signalled_s = self._signalled_s is not None, now_s
        if self._code is not None:
            self._kill()
            return
        self._send(supervised.REQUEST)
        self._is_last = again
        self._next_s = now_s + (_LAST_PATIENCE_S if again else _PATIENCE_S)

    def _act(self, now_s: float) -> None:
        """Take the next step if it is due."""
        if self._again_s is not None and now_s >= self._again_s:
            self._again_s = None
            self._send(supervised.REQUEST)
        if self._next_s is not None and now_s >= self._next_s:
            if self._is_last:
                self._kill()
            else:
                self._send_last(now_s)
        elif self._next_s is None and self._code is None:
            self._keep_limits(now_s)
        if self._is_memory_short() and not self._why:
            size = f"{(self._memory_limit_bytes or 0) / 2**20:.0f} MiB"
            self._why = f"The command held more memory than --memory-limit, {size}, and was ended."
            self._kill()

    def _keep_limits(self, now_s: float) -> None:
        """End the child if it, or its activity, exceeds its time limit."""
        late = self._late_activity(now_s)
        if self._deadline_s is not None and now_s >= self._deadline_s:
            self._why = supervised.format_time_limit(self._limit_s)
            self._send_last(now_s)
        elif late is not None:
            self._why = f"{late.name} took longer than {late.limit_s:.1f} s and was ended."
            self._why = f"Stopped by the time limit: {self._why}"
            if late.forced:
                self._kill()
            else:
                self._send_last(now_s)

    def _late_activity(self, now_s: float) -> _Activity | None:
        late = (
            activity
            for activity in self._activities
            if activity.deadline_s is not None and now_s >= activity.deadline_s
        )
        return next(late, None)

    def _is_memory_short(self) -> bool:
        limit = self._memory_limit_bytes
        return limit is not None and measure_tree_bytes(self._process) > limit

    def _send_last(self, now_s: float) -> None:
        self._send(supervised.LAST_REQUEST)
        self._is_last = True
        self._next_s = now_s + _LAST_PATIENCE_S

    def _send(self, number: int | None) -> None:
        if number is not None:
            with suppress(ProcessLookupError):
                os.kill(self._process, number)

    def _kill(self) -> None:
        """Kill the child and all its processes."""
        # Stopped first, so that it starts no more.
        self._send(signal.SIGSTOP)
        for number in (*list_descendants(self._process), self._process):
            with suppress(ProcessLookupError, PermissionError):
                os.kill(number, signal.SIGKILL)
        self._next_s = None
        self._deadline_s = None
        self._memory_limit_bytes = None
        self._activities = [activity._replace(deadline_s=None) for activity in self._activities]

    def _read(self) -> bool:
        """Read some reports, and return whether there may be more."""
        ready = select.select([self._line], [], [], 0)[0]
        content = os.read(self._line, 65536) if ready else b""
        *lines, self._text = (self._text + content).split(b"\n")
        for line in lines:
            # An unreadable line comes from a plugin that wrote to the pipe.
            with suppress(ValueError):
                self._note(line[:1], line[1:])
        return bool(content)

    def _note(self, kind: bytes, text: bytes) -> None:
        now_s = time.monotonic()
        if kind == supervised.BEGUN:
            limit, forced, code, name = text.split(b" ", 3)
            limit_s = _number(limit)
            deadline_s = None if limit_s is None else now_s + limit_s
            words = name.decode("utf-8", "replace")
            self._activities.append(
                _Activity(deadline_s, limit_s or 0.0, forced == b"1", int(code), words)
            )
        elif kind == supervised.ENDED:
            del self._activities[-1:]
            self._forgive(now_s)
        elif kind == supervised.LIMITS:
            self._deadline_s, command_s, memory = map(_number, text.split())
            self._limit_s = command_s or 0.0
            self._memory_limit_bytes = None if memory is None else int(memory)
        elif kind == supervised.FINISHING:
            if self._signalled_s is not None:
                self._next_s, self._is_last = now_s + _FINISHING_S, True
        elif kind == supervised.SWALLOWED:
            self._again_s = now_s + _AGAIN_S
        elif kind == supervised.PRINTED:
            self._printed = True
        elif kind == supervised.DONE:
            self._code = int(text)
            self._next_s, self._is_last = now_s + _EXIT_S, True

    def _forgive(self, now_s: float) -> None:
        """Withdraw a time-out if the activity has ended after all."""
        late = self._late_activity(now_s) is not None
        late |= self._deadline_s is not None and now_s >= self._deadline_s
        if self._why and self._signalled_s is None and not late:
            self._why, self._next_s, self._is_last = "", None, False

    def conclude(self, status: int) -> int:
        """Return the exit code of the command after the end of its child."""
        if self._code is not None:
            return self._code
        for number in self._heard:
            signal.signal(number, _exit_interrupted)
        if self._signalled_s is not None:
            with suppress(OSError):
                os.write(2, b"skillplan: interrupted\n")
            return exit_code(interrupted=True)
        message, code = self._why, exit_code(wrong=True)
        if not message:
            last = self._activities[-1] if self._activities else None
            code = exit_code(back_end_failed=True) if last is None else last.exit_code
            where = "" if last is None else f" in {last.name}"
            message = f"The process ended without an answer, by {_how(status)}{where}."
        self._report(message, code, not self._printed)
        return code


def _number(text: bytes) -> float | None:
    return None if text == supervised.NO_LIMIT else float(text)


def _how(status: int) -> str:
    if status >= 0:
        return f"exit code {status}"
    with suppress(ValueError):
        name = signal.Signals(-status).name
        return f"signal {-status} ({name}{', maybe for want of memory' if status == -9 else ''})"
    return f"signal {-status}"


def measure_tree_bytes(process: int) -> int:
    """Return the memory of a process and its descendants [bytes].

    Zero if the system does not report it. Shared file mappings, such as libraries, count once.
    """
    own = [
        measure_resident_bytes_of(number, private=True) or 0 for number in list_descendants(process)
    ]
    return (measure_resident_bytes_of(process) or 0) + sum(own)


def list_descendants(process: int) -> list[int]:
    """Return the ids of the descendants of a process.

    Empty if the system does not list them.
    """
    known: list[int] = []
    waiting = [process]
    while waiting:
        for path in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            with suppress(OSError, ValueError):
                numbers = [int(word) for word in path.read_bytes().split()]
                known += numbers
                waiting += numbers
    return known
