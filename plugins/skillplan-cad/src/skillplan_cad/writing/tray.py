"""Where parts lie at the start, and where the product goes, within an arm's reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Place = tuple[float, float]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

# Between the boxes about parts: room for fingers, and for a hand beside what reaches up to it.
_APART_M = 0.04
_BESIDE_TALL_M = 0.13
_TALL_M = 0.035
_BESIDE_PRODUCT_M = 0.14
_GRID_M = 0.02
_NEAREST_M, _FARTHEST_M = 0.30, 0.72
_SPREAD_RAD = math.radians(110)
HOLDERS: tuple[Place, ...] = ((0.20, 0.50), (0.28, 0.50), (0.36, 0.50))
HOME: Place = (0.35, 0.0)


@dataclass(frozen=True, slots=True)
class Item:
    """What needs a place: a part, or a feeder of identical ones.

    Parameters
    ----------
    name
        Of the part or feeder.
    size_m
        Extents of the box about it, x y z.
    """

    name: str
    size_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Tray:
    """A layout of the table.

    Parameters
    ----------
    product_m
        Where the middle of the product's box goes.
    places
        Where items lie, by name.
    without
        Names of items for which there is no room in reach.
    """

    product_m: Place
    places: dict[str, Place] = field(default_factory=dict)
    without: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Taken:
    """A rectangle of the table that is taken."""

    middle: Place
    half: Place
    room: float

    def is_near(self, middles: Floats, half: Place, room: float) -> Bools:
        """Return of each row whether a rectangle there would come too near."""
        least = np.add(half, self.half) + (max(room, self.room) - 1e-9)
        near: Bools = np.all(np.abs(middles - self.middle) < least, axis=1)
        return near


def tray(product_size_m: tuple[float, float, float], items: Sequence[Item], reach_m: float) -> Tray:
    """Return a layout: the product before the arm to its left, items as near to it as can be.

    Parameters
    ----------
    product_size_m
        Extents of the product as it stands, x y z.
    items
        What needs a place; the largest are placed first.
    reach_m
        Greatest distance from the arm's base to its tip.
    """
    farthest = min(_FARTHEST_M, 0.85 * reach_m)
    goal = _goal(product_size_m, farthest)
    half = (product_size_m[0] / 2, product_size_m[1] / 2)
    taken = [_Taken(goal, half, _BESIDE_PRODUCT_M)]
    taken += [_Taken(place, (0.03, 0.03), 0.06) for place in HOLDERS]
    spots = _spots(farthest, goal)
    places: dict[str, Place] = {}
    without = []
    order = sorted(items, key=lambda item: (-item.size_m[0] * item.size_m[1], item.name))
    for item in order:
        size = (item.size_m[0] / 2, item.size_m[1] / 2)
        room = _BESIDE_TALL_M if item.size_m[2] > _TALL_M else _APART_M
        free = np.flatnonzero(_fits(spots, size, room, taken, farthest))
        if not len(free):
            without.append(item.name)
            continue
        spot = (float(spots[free[0], 0]), float(spots[free[0], 1]))
        places[item.name] = spot
        taken.append(_Taken(spot, size, room))
    return Tray(goal, places, tuple(sorted(without)))


def _goal(size_m: tuple[float, float, float], farthest_m: float) -> Place:
    """Return where the product goes: half a metre before the arm, a little to its left."""
    y_m = min(0.12 + size_m[1] / 2, 0.25)
    x_m = max(0.50, _NEAREST_M + size_m[0] / 2)
    corner = math.hypot(x_m, abs(y_m) + size_m[1] / 2)
    if corner > farthest_m:
        x_m = max(_NEAREST_M + size_m[0] / 2, x_m - (corner - farthest_m))
    return round(x_m, 3), round(y_m, 3)


def _spots(farthest_m: float, goal: Place) -> Floats:
    """Return places on a grid within reach, those nearest to the product first."""
    count = int(farthest_m / _GRID_M)
    found = []
    for i in range(-count, count + 1):
        for j in range(-count, count + 1):
            x, y = round(i * _GRID_M, 3), round(j * _GRID_M, 3)
            inside = _NEAREST_M <= math.hypot(x, y) <= farthest_m
            if inside and abs(math.atan2(y, x)) <= _SPREAD_RAD:
                found.append((x, y))
    found.sort(key=lambda one: (round(math.dist(one, goal), 6), one))
    return np.array(found).reshape(-1, 2)


def _fits(
    spots: Floats, half: Place, room: float, taken: Sequence[_Taken], farthest_m: float
) -> Bools:
    """Return of each place whether a rectangle there is in reach and away from all others."""
    x_m, y_m = np.abs(spots).T
    corners = [np.hypot(x_m + sign * half[0], y_m + half[1]) for sign in (-1, 1)]
    near = np.hypot(np.maximum(spots[:, 0] - half[0], 0), np.maximum(y_m - half[1], 0))
    fits: Bools = (np.maximum(*corners) <= farthest_m + 0.05) & (near >= _NEAREST_M - 0.08)
    for one in taken:
        fits &= ~one.is_near(spots, half, room)
    return fits
