"""Programs of others, such as ffmpeg and git: started without a shell, deaf to Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress


class FedProgram:
    """A program that is fed through its stdin and writes to a file of its own.

    Parameters
    ----------
    words
        The program and its arguments.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(self, words: Sequence[str]) -> None:
        # In a session of its own Ctrl-C does not reach it: what was begun is finished.
        self._process = subprocess.Popen(
            list(words),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )

    def feed(self, content: bytes) -> None:
        """Hand over more.

        Raises
        ------
        OSError
            If the program is gone.
        """
        assert self._process.stdin is not None
        self._process.stdin.write(content)

    def finish(self) -> None:
        """Let it come to its end.

        Raises
        ------
        OSError
            If it failed, with the last line of what it printed to stderr.
        """
        _, printed = self._process.communicate()
        if self._process.returncode:
            lines = printed.decode("utf-8", "replace").strip().splitlines()
            raise OSError(lines[-1] if lines else "the program failed and printed nothing")


def output_of(words: Sequence[str]) -> str | None:
    """Return what a program prints to stdout; None where it is missing or fails."""
    try:
        done = subprocess.run(list(words), capture_output=True, text=True, check=True)
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
    return done.stdout


def exit_code_of(
    words: Sequence[str], folder: str | os.PathLike[str], limit_s: float
) -> int | None:
    """Return the exit code of a program; what it prints is lost.

    Parameters
    ----------
    words
        The program and its arguments.
    folder
        Where it runs.
    limit_s
        When it is killed, with all that it started [s].

    Returns
    -------
    int | None
        None where it was killed.

    Raises
    ------
    OSError
        If it cannot be started.
    """
    process = subprocess.Popen(
        list(words),
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return process.wait(limit_s)
    except subprocess.TimeoutExpired:
        return None
    finally:
        with suppress(ProcessLookupError, PermissionError):
            # Of a session of its own, so that what it started goes, too.
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
