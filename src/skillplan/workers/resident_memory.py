"""How much memory this process holds at the moment, and how much more there is."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

_STATM = Path("/proc/self/statm")
_MEMINFO = Path("/proc/meminfo")


def resident_bytes() -> int | None:
    """Return the resident size of this process [B], or None where that is unknown.

    Read from the process file system; where there is none, the largest size so far, which the
    system keeps count of, stands for it.
    """
    with suppress(OSError, ValueError, IndexError):
        return int(_STATM.read_bytes().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return _largest_bytes()


def resident_bytes_of(process: int | None, *, private: bool = False) -> int | None:
    """Return the resident size of another process [B], or None where that is unknown.

    Parameters
    ----------
    process
        Its number.
    private
        Whether to leave out pages of files and memory that it may share with others.
    """
    with suppress(OSError, ValueError, IndexError):
        _, held, shared, *_ = Path(f"/proc/{process}/statm").read_bytes().split()
        pages = int(held) - (int(shared) if private else 0)
        return pages * os.sysconf("SC_PAGE_SIZE")
    return None


def _largest_bytes() -> int | None:
    try:
        import resource
    except ImportError:
        return None
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Counted in kibibytes, but for macOS.
    return largest if sys.platform == "darwin" else largest * 1024


def available_bytes() -> int | None:
    """Return how much memory the system could still give [B], or None where that is unknown."""
    with suppress(OSError, ValueError):
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return None
