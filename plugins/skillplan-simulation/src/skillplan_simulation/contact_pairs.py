"""Collisions by who presses on whom: normal forces of pairs that are not expected to touch."""

from __future__ import annotations

from pydantic import Field

from skillplan.task.verdict import Verdict
from skillplan_simulation.contact_detector import ContactDetector, WindowOptions
from skillplan_simulation.record import Record
from skillplan_simulation.verdicts.contact_threshold import DISPLACEMENT_M, FORCE_N
from skillplan_simulation.verdicts.pair_verdict import PairLimits, pair_verdict


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
    version = "2"

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
        limits = PairLimits(options.threshold_n, options.displacement_m, options.frames)
        return pair_verdict(record, limits, self.parts)
