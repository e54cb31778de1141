"""Collisions by the net contact force on every part: Moller et al., section 4.3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.task.verdict import Verdict
from skillplan_pybullet.engine import PybulletEngine
from skillplan_simulation.contact_detectors import ContactDetector, WindowOptions
from skillplan_simulation.record import FRAMES_PER_S, Record
from skillplan_simulation.verdicts import average_frames, round_reading

_AXES = "xyz"


class ContactForceDetector(ContactDetector):
    """A verdict on the mean of the absolute net contact force on every part, axis by axis.

    As in Moller et al. (section 4.3), forces are averaged over the last 6 frames and compared with
    a threshold of 1. Exactly as published (``weight_compensated=false``), it fires on any resting
    part above 102 g, whose net contact force is its weight. Compensation subtracts an upward force
    up to the weight: all of it for a resting part, none if suction carries it. The detector still
    measures accelerations only: it misses forces that cancel, as on a jammed part, and a rough
    landing may exceed a jam. A screw, held by the bit without contact, shows the force that presses
    it. Contacts of the robot with the table do not count. It serves comparisons by ``skillplan
    compare TASK --detectors``.
    """

    name = "contact-force"
    version = "2"
    engine_alone = PybulletEngine

    class Options(WindowOptions):
        """Options of the net force."""

        threshold_n: float = Field(
            default=1.0,
            gt=0,
            le=1000,
            description="mean absolute net contact force along an axis that is a collision [N]",
        )
        weight_compensated: bool = Field(
            default=True, description="subtract the upward force that a part's weight explains [-]"
        )

    options: Options

    def contact_verdict(self, record: Record) -> Verdict:
        """Return the verdict; it names the part whose mean exceeds the threshold first."""
        threshold_n = self.options.threshold_n
        means = {
            name: average_frames(np.abs(self._unexplained(record, name)), self.options.frames)
            for name in sorted(self.parts & set(record.forces_n))
        }
        means = {name: mean for name, mean in means.items() if len(mean)}
        most_n = max((float(mean.max()) for mean in means.values()), default=0.0)
        readings = {
            "readings": {"force_n": round_reading(most_n)},
            "limits": {"force_n": threshold_n},
        }
        above = {name: mean for name, mean in means.items() if mean.max() > threshold_n}
        if not above:
            return Verdict.feasible(record.present, record.absent, readings)
        first = {
            name: int(np.argmax((mean > threshold_n).any(axis=1))) for name, mean in above.items()
        }
        name = min(first, key=lambda part: (first[part], part))
        frame, greatest_n = first[name], float(above[name].max())
        at_s = record.begin_s + frame / FRAMES_PER_S
        axis = int(np.argmax(above[name].max(axis=0)))
        phase = record.phase(frame)
        reason = (
            f"the net contact force on {name} averaged {greatest_n:.3g} N along {_AXES[axis]} "
            f"over {self.options.frames} frames"
        )
        evidence = {
            "bodies": [name],
            "axis": _AXES[axis],
            "force_n": round_reading(greatest_n),
            "during": phase,
            "at_s": round_reading(at_s),
            **readings,
        }
        when = f"on {phase} at {at_s:.2f} s" if phase else f"at {at_s:.2f} s"
        reason = f"{reason} {when}; the limit is {threshold_n:g} N"
        return Verdict.infeasible(reason, record.present, record.absent, evidence)

    def _unexplained(self, record: Record, name: str) -> NDArray[np.float64]:
        """Return the net force on a part without its weight [N], (frames, 3)."""
        force_n = record.forces_n[name]
        if not self.options.weight_compensated:
            return force_n
        explained_n = np.zeros_like(force_n)
        explained_n[:, 2] = np.clip(force_n[:, 2], 0.0, record.weights_n[name])
        return force_n - explained_n
