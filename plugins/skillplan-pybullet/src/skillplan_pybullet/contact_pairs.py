"""Collisions by who presses on whom: normal forces of pairs that are not expected to touch."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from skillplan.task.verdict import Verdict
from skillplan_pybullet.contact_detector import ContactDetector, WindowOptions, rounded
from skillplan_pybullet.record import FRAMES_PER_S, Pair, Record
from skillplan_pybullet.simulator.world import TABLE
from skillplan_pybullet.verdicts.contact_threshold import (
    DISPLACEMENT_M,
    FORCE_N,
    mean_forces,
    presses,
    pushes,
)


class ContactPairsDetector(ContactDetector):
    """A verdict on forces between bodies that should not touch, and on bodies pushed aside.

    A skill is infeasible where the normal force of an unexpected pair, averaged over the last
    frames, exceeds the threshold, or where a body that the skill does not handle moves further
    than the displacement at any moment. What is expected is the same for every task: bodies
    that touch when the skill begins, the hand and what it handles, what was let go or is being
    driven and whatever it lands on. A right execution thus reads 0 N, so that a threshold below
    the friction of the lightest part will do; a part so light that it is swept aside without a
    force is betrayed by its displacement.
    """

    name = "contact-pairs"

    class Options(WindowOptions):
        """Options of the pairs."""

        threshold_n: float = Field(
            default=FORCE_N,
            gt=0,
            le=100,
            description="mean normal force of an unexpected pair that is a collision [N]",
        )
        displacement_m: float = Field(
            default=DISPLACEMENT_M,
            gt=0,
            le=0.1,
            description="displacement of a body that is not handled that is a collision [m]",
        )

    options: Options

    def contact_verdict(self, record: Record) -> Verdict:
        """Return it; the pair or displacement that came first is the reason."""
        options = self.options
        pressing = presses(record, options.threshold_n, options.frames)
        pushed = pushes(record, options.displacement_m)
        evidence = self._readings(record)
        if not pressing and not pushed:
            return Verdict.feasible(record.present, record.absent, evidence)
        press = min(pressing, key=lambda one: (one.frame, -one.most_n, one.pair), default=None)
        moved = min(pushed, key=lambda name: (pushed[name], name), default=None)
        if press is not None and (moved is None or press.frame <= pushed[moved]):
            frame, bodies = press.frame, self._mover_first(press.pair, record)
            mover, other = (self.in_words(name) for name in bodies)
            said = f"{mover} pressed on {other} with {_shown(press.most_n)} N"
            found: dict[str, Any] = {"bodies": list(bodies), "force_n": rounded(press.most_n)}
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

    def _readings(self, record: Record) -> dict[str, Any]:
        """Return the greatest figures seen beside the limits that they are compared with."""
        means = mean_forces(record, self.options.frames)
        most_n = max((mean.max() for mean in means.values()), default=0.0)
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
