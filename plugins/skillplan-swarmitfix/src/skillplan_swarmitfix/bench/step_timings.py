"""How long the steps of the locomotion take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

_SWING_S = MappingProxyType({60: 7.47, 120: 11.63, 180: 15.80, 240: 19.97, 300: 24.13})


@dataclass(frozen=True, slots=True)
class Timings:
    """How long each step takes.

    The durations of swings are those of the real machine's plans (2012). Of the PKM these give
    only 0.75 to 1.62 s for a whole reposition; how that is shared out is our choice, such that
    a reposition lies in that range both without parking (1.05 s) and with it (1.50 s).

    Parameters
    ----------
    swing_s
        Duration by the angle of the swing [deg] [s], each > 0.
    retract_s, park_s, approach_s, support_s
        Durations of the other steps [s], each >= 0.

    Raises
    ------
    ValueError
        If a duration is out of range or not finite, or there is no swing.
    """

    swing_s: Mapping[int, float] = field(default_factory=lambda: _SWING_S, hash=False)
    retract_s: float = 0.30
    park_s: float = 0.45
    approach_s: float = 0.45
    support_s: float = 0.30

    def __post_init__(self) -> None:
        if not self.swing_s:
            raise ValueError("Timings swing_s needs at least one angle.")
        for angle_deg, duration_s in self.swing_s.items():
            if not (math.isfinite(duration_s) and duration_s > 0):
                raise ValueError(
                    f"Timings swing_s of {angle_deg} degrees must be finite and > 0, "
                    f"not {duration_s}."
                )
        for name in ("retract_s", "park_s", "approach_s", "support_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"Timings {name} must be finite and >= 0, not {value}.")

    def of_swing(self, angle_deg: int) -> float:
        """Return the duration of a swing by an angle [deg] in seconds.

        Raises
        ------
        ValueError
            If no duration is given for the angle.
        """
        if angle_deg not in self.swing_s:
            known = ", ".join(map(str, sorted(self.swing_s)))
            raise ValueError(f"Timings know no swing of {angle_deg} degrees; they know {known}.")
        return self.swing_s[angle_deg]
