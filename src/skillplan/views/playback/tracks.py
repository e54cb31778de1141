"""Motions of bodies in compact form, without poses that can be interpolated."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.robots import link_frames
from skillplan.robots.arm_description import ArmDescription
from skillplan.task.pose import Pose

Numbers = NDArray[np.float64]


def make_pose_matrix(pose: Pose) -> Numbers:
    """Return a pose as a matrix, shape (4, 4)."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = np.array(pose.rotation), np.array(pose.position)
    return transform


def compute_link_frames(arm: ArmDescription, mount: Pose, joints_rad: Numbers) -> list[Numbers]:
    """Return the frames of base, links and flange of a mounted arm, each of shape (n, 4, 4).

    Parameters
    ----------
    mount
        Pose of its base in the world.
    joints_rad
        Joint angles, shape (n, joints).
    """
    return link_frames.compute_link_frames(arm, joints_rad, make_pose_matrix(mount))


def make_rows(frames: Numbers) -> Numbers:
    """Return frames as positions and continuous quaternions, shape (n, 7)."""
    r = frames[:, :3, :3]
    trace = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    # Each frame uses the formula with the largest divisor (Shepperd).
    choice = np.argmax(np.stack([r[:, 0, 0], r[:, 1, 1], r[:, 2, 2], trace], axis=1), axis=1)
    q = np.empty((len(r), 4))
    for axis in range(3):
        own = choice == axis
        j, k = (axis + 1) % 3, (axis + 2) % 3
        q[own, axis] = 1 + 2 * r[own, axis, axis] - trace[own]
        q[own, j] = r[own, j, axis] + r[own, axis, j]
        q[own, k] = r[own, k, axis] + r[own, axis, k]
        q[own, 3] = r[own, k, j] - r[own, j, k]
    own = choice == 3
    q[own, 0] = r[own, 2, 1] - r[own, 1, 2]
    q[own, 1] = r[own, 0, 2] - r[own, 2, 0]
    q[own, 2] = r[own, 1, 0] - r[own, 0, 1]
    q[own, 3] = 1 + trace[own]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return np.hstack([frames[:, :3, 3], make_continuous(q)])


def make_continuous(quaternions: Numbers) -> Numbers:
    """Return the same rotations, with signs that make the quaternions continuous."""
    if len(quaternions) < 2:
        return quaternions
    flips = np.sign(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))
    flips[flips == 0] = 1
    return np.asarray(quaternions * np.concatenate([[1.0], np.cumprod(flips)])[:, None])


FRAMES_PER_S = 60
"""Sampling rate of the engines."""

# Largest errors of interpolated positions [m] and of components of quaternions.
_OFF_M, _OFF_TURN = 5e-5, 4e-4


@dataclass
class Tracks:
    """Motions of equal length.

    Parameters
    ----------
    frames
        Number of frames, >= 1.
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
            Position and quaternion of every frame, shape (frames, 7); NaN in frames without the
            body.
        off_m
            Largest error of the playback [m].

        Raises
        ------
        ValueError
            If the number of rows differs from the number of frames, or all rows are NaN.
        """
        known: NDArray[np.bool_] = np.asarray(~np.isnan(rows).any(axis=1))
        if len(rows) != self.frames or not known.any():
            raise ValueError("A motion has a pose in some frame, and a row for each.")
        number = len(self._keys)
        self.hidden += [(number, first, last) for first, last in _find_runs(~known)]
        filled = rows[_find_nearest(known)]
        filled = np.hstack([filled[:, :3], make_continuous(filled[:, 3:])])
        kept = _select_rows(filled, np.array([off_m] * 3 + [_OFF_TURN] * 4))
        # Frames around an appearance are kept: a body does not move there from elsewhere.
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
            "positions": pack(np.round((rows[:, :3] - offset) / scale), "<i2"),
            "orientations": pack(np.round(rows[:, 3:] * 32767), "<i2"),
            "keys": pack(keys, "<u4" if wide else "<u2"),
            "wide_keys": wide,
            "key_counts": [len(keys) for keys in self._keys],
            "hidden": [list(frames) for frames in self.hidden],
        }


def pack(values: NDArray[Any], kind: str) -> str:
    """Return the bytes of numbers as base64."""
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")


def _select_rows(rows: Numbers, tolerance: Numbers) -> NDArray[np.int64]:
    """Return the rows from which all others can be interpolated within a tolerance.

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


def _find_runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _find_nearest(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the nearest frame with a pose for every frame."""
    at = np.flatnonzero(known)
    after = np.clip(np.searchsorted(at, np.arange(len(known))), 0, len(at) - 1)
    before = np.clip(after - 1, 0, len(at) - 1)
    frames = np.arange(len(known))
    nearer = np.abs(at[before] - frames) < np.abs(at[after] - frames)
    return np.where(nearer, at[before], at[after]).astype(np.int64)
