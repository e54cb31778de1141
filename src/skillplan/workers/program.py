"""Programs of others, such as ffmpeg and git: started without a shell, deaf to Ctrl-C."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence


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
