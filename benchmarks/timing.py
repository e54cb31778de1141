"""Whole-process timing in turns: A, B, A, B, so that a drifting machine does not decide."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

BASELINE = (sys.executable, "-c", "pass")


@dataclass(frozen=True)
class Timing:
    """Median wall time of a command [s], and its median ratio to the baseline run before it."""

    wall_s: float
    ratio: float


def against_baseline(command: Sequence[str], runs: int = 15) -> Timing:
    """Time a command against ``python -c pass``, after one uncounted run of each."""
    pairs = [(_wall_s(BASELINE), _wall_s(command)) for _ in range(runs + 1)][1:]
    return Timing(
        statistics.median(own for _, own in pairs),
        statistics.median(own / base for base, own in pairs),
    )


def _wall_s(command: Sequence[str]) -> float:
    begin_s = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin_s
