"""The verdict on contacts that were not expected, for single skills and whole plans alike."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from skillplan.task.verdict import Verdict
from skillplan_simulation.record import Pair, Record
from skillplan_simulation.simulator import TABLE
from skillplan_simulation.verdicts.contact_threshold import (
    CLEARANCE_MM,
    DISPLACEMENT_M,
    FORCE_N,
    FRAMES,
    mean_forces,
    presses,
    pushes,
    rounded,
)


@dataclass(frozen=True, slots=True)
class PairLimits:
    """From when on an unexpected contact is a collision.

    Parameters
    ----------
    force_n
        Mean normal force of an unexpected pair [N].
    displacement_m
        Displacement of a body that is not handled [m].
    frames
        Over how many frames of 1/60 s the force is averaged [-].
    """

    force_n: float = FORCE_N
    displacement_m: float = DISPLACEMENT_M
    frames: int = FRAMES


def pair_verdict(record: Record, limits: PairLimits, parts: Collection[str]) -> Verdict:
    """Return the verdict; the pair or displacement that came first is the reason.

    Parameters
    ----------
    record
        Of an execution that ran to its end.
    limits
        What its figures are compared with.
    parts
        Names of the task's bodies; what is none of them has an article in a sentence.
    """
    pressing = presses(record, limits.force_n, limits.frames)
    pushed = pushes(record, limits.displacement_m)
    evidence = _readings(record, limits)
    if not pressing and not pushed:
        return Verdict.feasible(record.present, record.absent, evidence)
    press = min(pressing, key=lambda one: (one.frame, -one.most_n, one.pair), default=None)
    moved = min(pushed, key=lambda name: (pushed[name], name), default=None)
    if press is not None and (moved is None or press.frame <= pushed[moved]):
        frame, bodies = press.frame, _mover_first(press.pair, record, parts)
        mover, other = (name if name in parts else f"the {name}" for name in bodies)
        said = f"{mover} pressed on {other} with {_shown(press.most_n)} N"
        limit = f"{limits.force_n:g} N"
        if press.pair in record.beside:
            limit += f"; leave {CLEARANCE_MM:g} mm between them"
        found: dict[str, Any] = {"bodies": list(bodies), "force_n": rounded(press.most_n)}
    else:
        assert moved is not None
        frame, furthest_m = pushed[moved], float(record.moved_m[moved].max())
        said = f"{moved} was pushed {1000 * furthest_m:.1f} mm aside"
        limit = f"{1000 * limits.displacement_m:g} mm"
        found = {"bodies": [moved]}
    phase, at_s = record.phase(frame), record.time_s(frame)
    found |= {"during": phase, "at_s": rounded(at_s)}
    found["moved_mm"] = {
        name: rounded(1000 * record.moved_m[name].max()) for name in sorted(pushed)
    }
    when = f"on {phase} at {at_s:.2f} s" if phase else f"at {at_s:.2f} s"
    reason = f"{said} {when}; the limit is {limit}"
    return Verdict.infeasible(reason, record.present, record.absent, {**found, **evidence})


def _readings(record: Record, limits: PairLimits) -> dict[str, Any]:
    """Return the greatest figures seen beside the limits that they are compared with."""
    means = mean_forces(record, limits.frames)
    most_n = max((mean.max() for mean in means.values()), default=0.0)
    peak_n = max((one.max() for one in record.pairs_n.values() if len(one)), default=0.0)
    most_m = max((one.max() for one in record.moved_m.values() if len(one)), default=0.0)
    return {
        "peak_n": rounded(peak_n),
        "readings": {"force_n": rounded(most_n), "moved_mm": rounded(1000 * most_m)},
        "limits": {
            "force_n": limits.force_n,
            "moved_mm": rounded(1000 * limits.displacement_m),
        },
    }


def _mover_first(pair: Pair, record: Record, parts: Collection[str]) -> Pair:
    """Return a pair with what moved first: the robot, else what it handles."""

    def rank(name: str) -> int:
        if name in record.moved_m:
            return 3
        if name == TABLE:
            return 2
        return 1 if name in parts else 0

    first, second = sorted(pair, key=rank)
    return first, second


def _shown(force_n: float) -> str:
    """Return a force with three figures, without an exponent."""
    return f"{force_n:.0f}" if force_n >= 100 else f"{force_n:.3g}"
