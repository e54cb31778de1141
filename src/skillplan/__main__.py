"""``python -m skillplan``, and the command of that name."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from types import FrameType


def main() -> None:
    """Run the command line in a child of this process; a signal ends it with exit code 130."""
    before = None
    if hasattr(signal, "pthread_sigmask"):
        # Signals wait until the supervisor handles them.
        numbers = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
        before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    # Importing makes a hundred thousand objects and no garbage.
    gc.set_threshold(200_000, *gc.get_threshold()[1:])
    # Matrices are small: threads that share one mostly wait for each other.
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from skillplan.cli.writing import open_standard_streams
    from skillplan.workers.supervisor import supervise

    open_standard_streams()
    try:
        sys.exit(supervise(_load, _report, _interrupt, before))
    finally:
        # The objects end with the process and need not be searched for cycles.
        gc.freeze()


def _load() -> Callable[[], int]:
    """Import the command line in the child; return the function that runs it."""
    from skillplan.cli.writing import escape_warnings, reserve_stdout

    reserve_stdout()
    escape_warnings()
    from skillplan.cli.app import run

    return partial(run, sys.argv[1:])


def _report(message: str, code: int, may_print: bool) -> None:
    """Report in the supervisor that the command failed without a message of its own."""
    from skillplan.cli.error_report import report_error
    from skillplan.errors import BackEndError, SkillplanError

    error = BackEndError if code == BackEndError.exit_code else SkillplanError
    report_error(error(message), sys.argv[1:] if may_print else ())


def _interrupt(number: int, frame: FrameType | None) -> None:
    # Nothing is imported here, as the signal may interrupt an import. As long as this module is
    # not loaded, no plugin is, and its exceptions cannot be confused with a signal.
    supervised = sys.modules.get("skillplan.workers.supervised")
    if supervised is not None:
        supervised.note_interrupt()
    blame = sys.modules.get("skillplan.plugins.blame")
    raise getattr(blame, "Interrupted", KeyboardInterrupt)


if __name__ == "__main__":
    main()
