"""Motions of bodies as few and short numbers: what lies on a straight line is left out."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.views.playback.turns import Numbers, hemisphere

FRAMES_PER_S = 60
"""As many as engines note samples."""

# How far off a pose may be between two that are kept [m], and a component of its quaternion.
_OFF_M, _OFF_TURN = 5e-5, 4e-4


@dataclass
class Tracks:
    """Motions, each of as many frames.

    Parameters
    ----------
    frames
        How many, >= 1.
    """

    frames: int
    _rows: list[Numbers] = field(default_factory=list)
    _keys: list[NDArray[np.int64]] = field(default_factory=list)
    hidden: list[tuple[int, int, int]] = field(default_factory=list)

    def add(self, rows: Numbers, off_m: float = _OFF_M) -> int:
        """Add a motion and return its number.

        Parameters
        ----------
        rows
            Position and quaternion of every frame, shape (frames, 7); NaN where the body is
            nowhere, which is not everywhere.
        off_m
            How far off it may be played back [m].

        Raises
        ------
        ValueError
            If there are more or fewer rows than frames, or no pose.
        """
        known: NDArray[np.bool_] = np.asarray(~np.isnan(rows).any(axis=1))
        if len(rows) != self.frames or not known.any():
            raise ValueError("A motion has a pose in some frame, and a row for each.")
        number = len(self._keys)
        self.hidden += [(number, first, last) for first, last in _runs(~known)]
        filled = rows[_nearest(known)]
        filled = np.hstack([filled[:, :3], hemisphere(filled[:, 3:])])
        kept = _kept(filled, np.array([off_m] * 3 + [_OFF_TURN] * 4))
        # Where a body appears it does not come from anywhere.
        ends = [end for _, first, last in self.hidden if _ == number for end in (first, last)]
        near = [k for end in ends for k in (end - 1, end, end + 1) if 0 <= k < self.frames]
        keys = np.union1d(kept, np.array(near, dtype=np.int64))
        self._keys.append(keys)
        self._rows.append(filled[keys])
        return number

    def document(self) -> dict[str, Any]:
        """Return the tracks as JSON values."""
        rows = np.concatenate(self._rows) if self._rows else np.zeros((0, 7))
        low = rows[:, :3].min(axis=0) if len(rows) else np.zeros(3)
        high = rows[:, :3].max(axis=0) if len(rows) else np.zeros(3)
        offset = (low + high) / 2
        scale = max(float((high - low).max()) / 2 / 32767, 1e-9)
        wide = self.frames > 0xFFFF
        keys = np.concatenate(self._keys) if self._keys else np.zeros(0, dtype=np.int64)
        return {
            "count": len(self._keys),
            "position_scale_m": scale,
            "position_offset_m": [float(value) for value in offset],
            "positions": packed(np.round((rows[:, :3] - offset) / scale), "<i2"),
            "orientations": packed(np.round(rows[:, 3:] * 32767), "<i2"),
            "keys": packed(keys, "<u4" if wide else "<u2"),
            "wide_keys": wide,
            "key_counts": [len(one) for one in self._keys],
            "hidden": [list(one) for one in self.hidden],
        }


def packed(values: NDArray[Any], kind: str) -> str:
    """Return numbers as base64 of their bytes."""
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")


def _kept(rows: Numbers, tolerance: Numbers) -> NDArray[np.int64]:
    """Return the rows between which all others lie on lines, within a tolerance.

    After Douglas and Peucker (1973), with time as the parameter.
    """
    keep = {0, len(rows) - 1}
    todo = [(0, len(rows) - 1)]
    while todo:
        first, last = todo.pop()
        if last - first < 2:
            continue
        share = np.arange(1, last - first)[:, None] / (last - first)
        line = rows[first] + share * (rows[last] - rows[first])
        off = (np.abs(rows[first + 1 : last] - line) / tolerance).max(axis=1)
        worst = int(off.argmax())
        if off[worst] > 1.0:
            middle = first + 1 + worst
            keep.add(middle)
            todo += [(first, middle), (middle, last)]
    return np.array(sorted(keep), dtype=np.int64)


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _nearest(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return for every frame the nearest one with a pose."""
    at = np.flatnonzero(known)
    after = np.clip(np.searchsorted(at, np.arange(len(known))), 0, len(at) - 1)
    before = np.clip(after - 1, 0, len(at) - 1)
    frames = np.arange(len(known))
    nearer = np.abs(at[before] - frames) < np.abs(at[after] - frames)
    return np.where(nearer, at[before], at[after]).astype(np.int64)
