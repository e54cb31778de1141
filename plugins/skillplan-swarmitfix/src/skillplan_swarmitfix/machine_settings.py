"""Bench and machine of a file, with the real machine's figures as defaults."""

from __future__ import annotations

from skillplan_swarmitfix.bench.bench import Bench, Timings
from skillplan_swarmitfix.pkm.reach import Mount, PkmLimits
from skillplan_swarmitfix.schema import SwarmitfixConfig


def bench_of(config: SwarmitfixConfig) -> Bench:
    """Return the lattice of a file."""
    bench = config.bench
    return Bench(bench.rows, bench.cols, bench.pitch_m, bench.actions)


def mount_of(config: SwarmitfixConfig) -> Mount:
    """Return the mount of the parallel kinematic machine of a file.

    Raises
    ------
    ValueError
        If the sheet lies below it.
    """
    height_m = config.pkm.sheet_height_m
    return Mount() if height_m is None else Mount(sheet_m=height_m)


def limits_of(config: SwarmitfixConfig) -> PkmLimits:
    """Return the limits of the legs of a file, by default the calibrated ones."""
    given = config.pkm.leg_limits_m
    limits = {
        f"leg_{leg.lower()}_m": (value[0], value[1])
        for leg in "ABC"
        if (value := getattr(given, leg)) is not None
    }
    return PkmLimits(**limits)


def timings_of(config: SwarmitfixConfig) -> Timings:
    """Return the durations of a file, by default the real machine's."""
    given = config.timings
    default = Timings()
    swing_s = dict(default.swing_s)
    swing_s |= {int(angle): time_s for angle, time_s in (given.swing_s or {}).items()}
    steps = {
        name: getattr(default if getattr(given, name) is None else given, name)
        for name in ("retract_s", "park_s", "approach_s", "support_s")
    }
    return Timings(swing_s, **steps)
