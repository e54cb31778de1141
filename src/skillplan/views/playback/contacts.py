"""Contacts of a trace in few entries: each is there for a while, as strong as at its peak."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from skillplan.physics.performance import Contact, Sample
from skillplan.views.playback.tracks import FRAMES_PER_S

# What is weaker is not shown [N].
_LEAST_N = 1.0
# One entry stands for forces and places that differ by no more [N, share, m].
_OFF_N, _OFF_SHARE, _OFF_M = 2.0, 0.3, 0.02
# A touch that is lost for no more frames goes on.
_GAP_FRAMES = 3
_MOST = 600

_Frames = list[tuple[int, Contact]]


def contact_entries(samples: Sequence[Sample], most: int = _MOST) -> list[dict[str, Any]]:
    """Return the contacts of a trace, by time, in at most `most` entries.

    Parameters
    ----------
    samples
        One a frame.
    most
        How many entries; where there are more, they are made coarser.
    """
    pairs: dict[tuple[str, str], _Frames] = {}
    for frame, sample in enumerate(samples):
        for contact in sample.contacts:
            if math.hypot(*contact.force_n) >= _LEAST_N:
                pairs.setdefault(contact.bodies, []).append((frame, contact))
    coarse = 1.0
    while True:
        runs = [run for frames in pairs.values() for run in _runs(frames, coarse)]
        if len(runs) <= most or coarse > 64:
            break
        coarse *= 1.5
    # The strongest, where even coarse ones are too many.
    runs = sorted(runs, key=lambda run: -_force_n(_peak(run)))[:most]
    return sorted(map(_entry, runs), key=lambda entry: float(entry["time_s"]))


def _runs(frames: _Frames, coarse: float) -> list[_Frames]:
    """Return frames in a row whose contacts are alike."""
    found: list[_Frames] = []
    for frame, contact in frames:
        if found:
            run = found[-1]
            last, first = run[-1][0], run[0][1]
            off_n = max(_OFF_N, _OFF_SHARE * _force_n(first)) * coarse
            if (
                frame - last <= _GAP_FRAMES * coarse
                and math.dist(contact.force_n, first.force_n) <= off_n
                and math.dist(contact.position, first.position) <= _OFF_M * coarse
            ):
                run.append((frame, contact))
                continue
        found.append([(frame, contact)])
    return found


def _peak(run: _Frames) -> Contact:
    return max((contact for _, contact in run), key=_force_n)


def _force_n(contact: Contact) -> float:
    return math.hypot(*contact.force_n)


def _entry(run: _Frames) -> dict[str, Any]:
    peak = _peak(run)
    return {
        "time_s": round(run[0][0] / FRAMES_PER_S, 4),
        "until_s": round(run[-1][0] / FRAMES_PER_S, 4),
        "position_m": [round(value, 4) + 0.0 for value in peak.position],
        "force_n": [round(value, 1) + 0.0 for value in peak.force_n],
        "bodies": list(peak.bodies),
    }
