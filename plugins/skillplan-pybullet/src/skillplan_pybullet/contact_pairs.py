"""Collisions by who presses on whom: normal forces of pairs that are not expected to touch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from skillplan.task.verdict import Verdict
from skillplan_pybullet.contact_detector import (
    ContactDetector,
    WindowOptions,
    frame_means,
    rounded,
)
from skillplan_pybullet.record import FRAMES_PER_S, Pair, Record
from skillplan_pybullet.world import TABLE


@dataclass(frozen=True, slots=True)
class _Press:
    """A pair that should not touch: when its mean force first exceeds the threshold."""

    frame: int
    pair: Pair
    mean_n: float


class ContactPairsDetector(ContactDetector):
    """Rule on forces between bodies that should not touch, and on bodies pushed aside.

    A skill is infeasible where the normal force of an unexpected pair, averaged over the last
    frames, exceeds the threshold, or where a body that the skill does not handle moves further
    than the displacement at any moment. What is expected is the same for every task: bodies
    that touch when the skill begins, the hand and what it handles, what was let go and
    whatever it lands on, a tool and what it fastens while it presses. A right execution thus
    reads 0 N, so that a threshold below the friction of the lightest part will do; a part so
    light that it is swept aside without a force is betrayed by its displacement.
    """

    name = "contact-pairs"

    class Options(WindowOptions):
        """Options of the pairs."""

        threshold_n: float = Field(
            default=0.05,
            gt=0,
            le=100,
            description="mean normal force of an unexpected pair that is a collision [N]",
        )
        displacement_m: float = Field(
            default=0.001,
            gt=0,
            le=0.1,
            description="displacement of a body that is not handled that is a collision [m]",
        )

    options: Options

    def rule_on_contacts(self, record: Record) -> Verdict:
        """Rule on pairs and displacements; the one that came first is the reason."""
        options = self.options
        means = {
            pair: frame_means(forces, options.frames) for pair, forces in record.pairs_n.items()
        }
        pressing = [
            _Press(int(np.argmax(mean > options.threshold_n)), pair, float(mean.max()))
            for pair, mean in means.items()
            if len(mean) and mean.max() > options.threshold_n
        ]
        pushed = {
            name: int(np.argmax(moved > options.displacement_m))
            for name, moved in record.moved_m.items()
            if len(moved) and moved.max() > options.displacement_m
        }
        evidence = self._readings(record, means)
        if not pressing and not pushed:
            return Verdict.feasible(record.present, record.absent, evidence)
        press = min(pressing, key=lambda one: (one.frame, -one.mean_n, one.pair), default=None)
        moved = min(pushed, key=lambda name: (pushed[name], name), default=None)
        if press is not None and (moved is None or press.frame <= pushed[moved]):
            frame, bodies = press.frame, self._mover_first(press.pair, record)
            mover, other = (self.in_words(name) for name in bodies)
            said = f"{mover} pressed on {other} with {_shown(press.mean_n)} N"
            found: dict[str, Any] = {"bodies": list(bodies), "force_n": rounded(press.mean_n)}
        else:
            assert moved is not None
            frame, furthest_m = pushed[moved], float(record.moved_m[moved].max())
            said = f"{moved} was pushed {1000 * furthest_m:.1f} mm aside"
            found = {"bodies": [moved]}
        phase = record.phase(frame)
        found |= {"during": phase, "at_s": rounded(frame / FRAMES_PER_S)}
        found["moved_mm"] = {
            name: rounded(1000 * record.moved_m[name].max()) for name in sorted(pushed)
        }
        reason = f"{said} on {phase}" if phase else said
        return Verdict.infeasible(reason, record.present, record.absent, {**found, **evidence})

    def _readings(self, record: Record, means: Mapping[Pair, Any]) -> dict[str, Any]:
        """Return the greatest figures seen beside the limits that they are held against."""
        most_n = max((mean.max() for mean in means.values() if len(mean)), default=0.0)
        peak_n = max((one.max() for one in record.pairs_n.values() if len(one)), default=0.0)
        most_m = max((one.max() for one in record.moved_m.values() if len(one)), default=0.0)
        return {
            "peak_n": rounded(peak_n),
            "readings": {"force_n": rounded(most_n), "moved_mm": rounded(1000 * most_m)},
            "limits": {
                "force_n": self.options.threshold_n,
                "moved_mm": rounded(1000 * self.options.displacement_m),
            },
        }

    def _mover_first(self, pair: Pair, record: Record) -> Pair:
        """Return a pair with what moved first: the robot, else what it handles."""
        parts = {body.name for body in self.task.scene.bodies}

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
