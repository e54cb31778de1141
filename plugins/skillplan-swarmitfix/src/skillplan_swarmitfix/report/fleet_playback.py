"""Several bases that walk on one bench at a time, as a schedule says."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from skillplan.views.figures.figure_style import PALETTE
from skillplan.views.playback.document import Playback
from skillplan.views.playback.tracks import FRAMES_PER_S
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.report.bases import (
    Turning,
    add_base,
    add_bench,
    base_rows,
    turning,
    upright_rows,
)


def fleet_playback(name: str, bench: Bench, known: Mapping[str, Any]) -> Playback:
    """Return the motion of a fleet: in every step each swing takes its own time.

    Parameters
    ----------
    name
        Of the task.
    bench
        The lattice.
    known
        What the domain says of the solved file, with a schedule.
    """
    whole_s = float(known["parallel_s"])
    frames = 1 + round(whole_s * FRAMES_PER_S)
    playback = Playback(name, frames, "kinematic, by the times of the schedule; not simulated")
    add_bench(playback, bench)
    times_s = np.arange(frames) / FRAMES_PER_S
    for number, entry in enumerate(known["robots"]):
        robot, start = entry["robot"], bench.position(entry["start"])
        moves: list[Turning] = []
        for _, who, action, (begin, end), times in swings_of(known):
            if who != robot:
                continue
            made = turning(bench, bench.position(begin), int(action[1:]), *times)
            if made is not None:
                moves.append(made)
            playback.skills.append(
                {
                    "name": f"{robot}: {action}",
                    "start_s": times[0],
                    "end_s": times[1],
                    "arm": robot,
                    "tool": None,
                    "subject": robot,
                    "note": f"{begin} to {end}",
                }
            )
        rows = upright_rows(*base_rows(bench, start, moves, times_s))
        add_base(playback, bench, robot, rows, PALETTE[number % len(PALETTE)])
    playback.skills.sort(key=lambda one: one["start_s"])
    return playback


def swings_of(
    known: Mapping[str, Any],
) -> Iterator[tuple[int, str, str, tuple[str, str], tuple[float, float]]]:
    """Yield step from 1, robot, action, positions and times [s] of every swing of a schedule.

    A step begins when the longest swing of the one before has ended.
    """
    begin_s = 0.0
    steps = zip(known["schedule"], known["swings_s"], known["steps_s"], strict=True)
    for number, (moves, swings_s, step_s) in enumerate(steps, start=1):
        for (robot, action, start, end), swing_s in zip(moves, swings_s, strict=True):
            yield number, robot, action, (start, end), (begin_s, begin_s + swing_s)
        begin_s += step_s
