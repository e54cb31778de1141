"""Bodies of bench and bases, and the motion of a base that swings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillplan.task.pose import Pose
from skillplan.views.playback.document import Playback, box, cylinder
from skillplan.views.playback.meshes import hull_mesh
from skillplan.views.playback.tracks import Numbers
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.bench.swings import Direction

BASE_TOP_M = 0.2
"""Height of a base [m]; an assumption, as it is not published."""

_PIN_M, _LEG_M = 0.012, 0.03


@dataclass(frozen=True, slots=True)
class Turning:
    """A base that turns about a docked leg, from one time to another [s], by an angle [rad]."""

    begin_s: float
    end_s: float
    pivot_m: tuple[float, float]
    angle_rad: float


def turning(bench: Bench, start: int, action: int, begin_s: float, end_s: float) -> Turning | None:
    """Return the swing that an action makes, spread over a time; None for staying."""
    swing = bench.swing(start, action)
    if swing is None:
        return None
    angle = math.radians(swing.turn.angle_deg)
    x, y = bench.pins_m[swing.pivot].tolist()
    signed = angle if swing.turn.direction is Direction.CCW else -angle
    return Turning(begin_s, end_s, (x, y), signed)


def base_rows(
    bench: Bench, start: int, turnings: Sequence[Turning], times_s: Numbers
) -> tuple[Numbers, Numbers, Numbers]:
    """Return the centre x, y [m] and the rotation [rad] of a base at ascending times [s].

    Parameters
    ----------
    bench
        The lattice.
    start
        First position.
    turnings
        Swings in order of time.
    times_s
        Ascending times.
    """
    x, y = bench.centroids_m[start].tolist()
    toward = bench.pins_m[bench.legs[start][0]] - bench.centroids_m[start]
    yaw = math.atan2(toward[1], toward[0])
    xs, ys, yaws = (np.full(len(times_s), value) for value in (x, y, yaw))
    for turn in turnings:
        share = np.clip((times_s - turn.begin_s) / max(turn.end_s - turn.begin_s, 1e-9), 0, 1)
        moving = times_s >= turn.begin_s
        # Smooth acceleration and deceleration.
        angles = turn.angle_rad * (3 * share**2 - 2 * share**3)
        px, py = turn.pivot_m
        dx, dy = x - px, y - py
        xs = np.where(moving, px + dx * np.cos(angles) - dy * np.sin(angles), xs)
        ys = np.where(moving, py + dx * np.sin(angles) + dy * np.cos(angles), ys)
        yaws = np.where(moving, yaw + angles, yaws)
        c, s = math.cos(turn.angle_rad), math.sin(turn.angle_rad)
        x, y = px + dx * c - dy * s, py + dx * s + dy * c
        yaw += turn.angle_rad
    return xs, ys, yaws


def upright_rows(xs: Numbers, ys: Numbers, yaws: Numbers, z_m: float = 0.0) -> Numbers:
    """Return upright poses, shape (n, 7)."""
    zero = np.zeros(len(xs))
    return np.stack([xs, ys, zero + z_m, zero, zero, np.sin(yaws / 2), np.cos(yaws / 2)], axis=1)


def add_bench(playback: Playback, bench: Bench) -> None:
    """Add the plate of the bench and its pins."""
    low, high = bench.pins_m.min(axis=0) - 0.15, bench.pins_m.max(axis=0) + 0.15
    middle = ((low + high) / 2).tolist()
    size = (*(high - low).tolist(), 0.03)
    plate = box(size, Pose((middle[0], middle[1], -0.015)))
    playback.add_body("bench", "environment", [plate])
    pins = [cylinder(_PIN_M, 0.012, Pose((x, y, 0.006))) for x, y in bench.pins_m.tolist()]
    playback.add_body("pins", "dock", pins)
    far = float(max(high - low))
    playback.view = (
        (middle[0], middle[1], 0.25),
        (middle[0] - 0.28 * far, middle[1] - 1.15 * far, 0.86 * far),
    )


def add_base(
    playback: Playback, bench: Bench, name: str, rows: Numbers, color: str | None = None
) -> None:
    """Add the body of a base: a plate on three legs."""
    radius_m = bench.pitch_m / math.sqrt(3)
    feet = [
        (radius_m * math.cos(2 * math.pi * k / 3), radius_m * math.sin(2 * math.pi * k / 3))
        for k in range(3)
    ]
    plate = []
    for x, y in feet:
        for turn in range(8):
            angle = 2 * math.pi * turn / 8
            corner = (x + 0.045 * math.cos(angle), y + 0.045 * math.sin(angle))
            plate += [(*corner, BASE_TOP_M - 0.08), (*corner, BASE_TOP_M)]
    shapes = [playback.mesh(*hull_mesh(plate))]
    shapes += [
        cylinder(_LEG_M, BASE_TOP_M - 0.06, Pose((x, y, (BASE_TOP_M - 0.06) / 2))) for x, y in feet
    ]
    playback.add_body(name, "base", shapes, rows=rows, label=True, color=color)
