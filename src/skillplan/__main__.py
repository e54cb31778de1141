"""``python -m skillplan``, and the command of that name."""

from __future__ import annotations

import gc
import signal
import sys
from types import FrameType

# Ctrl-C, and what a batch system interrupts by.
SIGNALS = (signal.SIGINT, signal.SIGTERM)


def main() -> None:
    """Run the command line; a signal ends it with exit code 130 from the first instant on."""
    # Importing makes a hundred thousand objects and no garbage.
    gc.set_threshold(200_000, *gc.get_threshold()[1:])
    # What is to be ignored, as by a shell's job in the background, stays so.
    heard = [one for one in SIGNALS if signal.getsignal(one) is not signal.SIG_IGN]
    try:
        for number in heard:
            signal.signal(number, _interrupt)
        from skillplan.cli.standard_streams import escape_warnings, open_standard_streams

        open_standard_streams()
        escape_warnings()
        from skillplan.cli.app import run

        code = run(sys.argv[1:])
    except KeyboardInterrupt:
        # Before the command line was there to say so.
        sys.stderr.write("skillplan: interrupted\n")
        code = 130
    # It is over: a signal that comes now must not change what it came to.
    for number in heard:
        signal.signal(number, signal.SIG_IGN)
    # What is left ends with the process: nobody need search it for cycles.
    gc.freeze()
    sys.exit(code)


def _interrupt(number: int, frame: FrameType | None) -> None:
    # Nothing is imported here: an import may be what is being interrupted. As long as this module
    # is not there, no plugin is, from whose exceptions a signal would have to be told apart.
    blame = sys.modules.get("skillplan.plugins.blame")
    raise getattr(blame, "Interrupted", KeyboardInterrupt)


if __name__ == "__main__":
    main()
