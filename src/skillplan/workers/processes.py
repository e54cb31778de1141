"""Processes of the system: external programs such as ffmpeg and git, and memory in use."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

# subprocess is imported where it is used: the supervisor of every command needs the rest only.

_STATM = Path("/proc/self/statm")
_MEMINFO = Path("/proc/meminfo")


class FedProgram:
    """A program that reads from its stdin and writes to a file of its own.

    Raises
    ------
    OSError
        If it cannot be started.
    """

    def __init__(self, words: Sequence[str]) -> None:
        import subprocess

        # Ctrl-C does not reach a session of its own, so the program finishes its file.
        self._process = subprocess.Popen(
            list(words),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )

    def feed(self, content: bytes) -> None:
        """Write to the stdin of the program.

        Raises
        ------
        OSError
            If the program has ended.
        """
        assert self._process.stdin is not None
        self._process.stdin.write(content)

    def finish(self) -> None:
        """Close the stdin and wait for the program to end.

        Raises
        ------
        OSError
            If it failed; with the last line of its stderr.
        """
        _, printed = self._process.communicate()
        if self._process.returncode:
            lines = printed.decode("utf-8", "replace").strip().splitlines()
            raise OSError(lines[-1] if lines else "the program failed and printed nothing")


def read_output(words: Sequence[str]) -> str | None:
    """Return the stdout of a program, or None if it is missing or fails."""
    import subprocess

    try:
        completed = subprocess.run(list(words), capture_output=True, text=True, check=True)
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
    return completed.stdout


def run_program(words: Sequence[str], folder: str | os.PathLike[str], limit_s: float) -> int | None:
    """Return the exit code of a program, or None if it was killed; its output is discarded.

    Parameters
    ----------
    limit_s
        Time after which the program and its children are killed [s].

    Raises
    ------
    OSError
        If it cannot be started.
    """
    import subprocess

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
            # Its session is its own, so this kills its children, too.
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def measure_resident_bytes() -> int | None:
    """Return the resident memory of this process [bytes], or None if it is unknown.

    Without a process file system, this is the largest size so far.
    """
    with suppress(OSError, ValueError, IndexError):
        return int(_STATM.read_bytes().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    try:
        import resource
    except ImportError:
        return None
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Bytes on macOS, kibibytes elsewhere.
    return largest if sys.platform == "darwin" else largest * 1024


def measure_resident_bytes_of(process: int | None, *, private: bool = False) -> int | None:
    """Return the resident memory of another process [bytes], or None if it is unknown.

    Parameters
    ----------
    private
        True to leave out pages that the process may share with others.
    """
    with suppress(OSError, ValueError, IndexError):
        _, resident, shared, *_ = Path(f"/proc/{process}/statm").read_bytes().split()
        pages = int(resident) - (int(shared) if private else 0)
        return pages * os.sysconf("SC_PAGE_SIZE")
    return None


def measure_cpu_s_of(process: int | None) -> float | None:
    """Return the CPU time of another process since its start [s], or None if it is unknown."""
    with suppress(OSError, ValueError, IndexError):
        # The name of the program, in parentheses, may hold spaces.
        fields = Path(f"/proc/{process}/stat").read_bytes().rpartition(b")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return None


def get_available_bytes() -> int | None:
    """Return the memory that the system can still provide [bytes], or None if it is unknown."""
    with suppress(OSError, ValueError):
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return None
