"""Several bases that walk on one bench at a time, as a schedule says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from skillplan.domains.swarmitfix.bench.bench import Bench
from skillplan.views.figures.figure_style import PALETTE
from skillplan.views.playback.document import Playback
from skillplan.views.playback.tracks import FRAMES_PER_S
from skillplan.views.report.swarmitfix.bases import (
    Turning,
    add_base,
    add_bench,
    base_rows,
    turning,
    upright_rows,
)


def fleet_playback(name: str, bench: Bench, known: Mapping[str, Any]) -> Playback:
    """Return the motion of a fleet, every parallel step as long as the mean.

    Parameters
    ----------
    name
        Of the task.
    bench
        The lattice.
    known
        What the domain says of the solved file, with a schedule.
    """
    schedule = known["schedule"]
    whole_s = float(known["parallel_s"])
    step_s = whole_s / max(1, len(schedule))
    frames = 1 + round(whole_s * FRAMES_PER_S)
    playback = Playback(name, frames, "kinematic, by the times of the schedule; not simulated")
    add_bench(playback, bench)
    times_s = np.arange(frames) / FRAMES_PER_S
    for number, entry in enumerate(known["robots"]):
        robot, start = entry["robot"], bench.position(entry["start"])
        moves: list[Turning] = []
        for index, row in enumerate(schedule):
            for who, action, begin, end in row:
                if who != robot:
                    continue
                times = (index * step_s, (index + 1) * step_s)
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
