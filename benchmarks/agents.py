"""`skillplan benchmark` with limits and times in CPU seconds, for a machine that others use, too.

It takes the words of that command: ``python benchmarks/agents.py exact cp-sat --only 'board-1*'``.
Fast Downward limits its own CPU time; the time of its process counts when it has ended.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from skillplan.benchmark import Row, runs
from skillplan.cli.app import run
from skillplan.judge import fast_downward
from skillplan.pipeline import solving
from skillplan.solvers import stop

# A run is not ended by the clock on the wall [s].
PATIENCE_S = 3_600.0


def cpu_s() -> float:
    """Return the CPU time of this process and its ended children [s]."""
    return sum(os.times()[:4])


def prepare(_: Any) -> Callable[[runs.Run], Row]:
    """Let searches count CPU time in a worker process, and return the function that does runs."""
    for module in (stop, fast_downward):
        vars(module)["time"] = SimpleNamespace(monotonic=cpu_s)
    vars(solving)["time"] = SimpleNamespace(perf_counter=cpu_s)
    fast_downward._GRACE_S = PATIENCE_S
    return runs.do_run


if __name__ == "__main__":
    runs._prepare = prepare
    runs._GRACE_S = PATIENCE_S
    sys.exit(run(["benchmark", *sys.argv[1:]]))
