"""The contact threshold: from what force or displacement on a contact is a collision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_simulation.record import Pair, Record

# A mean force above this is a collision [N], and it is averaged over this many frames [-]; as in
# Moller et al., section 4.3, those up to each.
FORCE_N = 0.05
FRAMES = 6
# A body that is not handled and moves by more than this was pushed [m].
DISPLACEMENT_M = 0.001
# So much room on each side of a hole the shipped products have, which is enough [mm].
CLEARANCE_MM = 0.3


@dataclass(frozen=True, slots=True)
class Press:
    """A pair that should not touch: when its mean force first exceeds a threshold.

    Parameters
    ----------
    frame
        Number of the frame.
    pair
        Names of the two.
    most_n
        The greatest mean force [N].
    """

    frame: int
    pair: Pair
    most_n: float


def mean_forces(record: Record, frames: int = FRAMES) -> dict[Pair, NDArray[np.float64]]:
    """Return the mean forces of all pairs that touched unexpectedly [N], shape (frames,)."""
    means = {pair: frame_means(forces, frames) for pair, forces in record.pairs_n.items()}
    return {pair: mean for pair, mean in means.items() if len(mean)}


def presses(record: Record, force_n: float = FORCE_N, frames: int = FRAMES) -> list[Press]:
    """Return the pairs whose mean force exceeds a threshold, in the order of the record."""
    return [
        Press(int(np.argmax(mean > force_n)), pair, float(mean.max()))
        for pair, mean in mean_forces(record, frames).items()
        if mean.max() > force_n
    ]


def pushes(record: Record, displacement_m: float = DISPLACEMENT_M) -> dict[str, int]:
    """Return the bodies that moved too far, and the frame at which they first had."""
    return {
        name: int(np.argmax(moved > displacement_m))
        for name, moved in record.moved_m.items()
        if len(moved) and moved.max() > displacement_m
    }


def frame_means(values: NDArray[np.float64], frames: int) -> NDArray[np.float64]:
    """Return, at every frame, the mean over it and those before it.

    Parameters
    ----------
    values
        Shape (n, ...).
    frames
        How many are averaged, >= 1; before the first nothing touched.

    Returns
    -------
    numpy.ndarray
        Of the same shape.
    """
    padding = np.zeros((frames - 1, *values.shape[1:]))
    padded = np.concatenate([padding, values])
    total = np.zeros(values.shape)
    for shift in range(frames):
        total += padded[shift : shift + len(values)]
    return total / frames


def rounded(value: float) -> float:
    """Return a reading as it goes into evidence: to a millionth, and never minus zero."""
    return round(float(value), 6) + 0.0
