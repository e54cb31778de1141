"""Hands as data: their outline, how far their jaws open, and how hard they close."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skillplan.robots.arm_description import Transform, Triple

_NOWHERE = Transform()

JawProfile = tuple[tuple[float, float, float, float], ...]
"""See :attr:`Hand.jaw_m`."""


@dataclass(frozen=True, slots=True)
class Hand:
    """A hand with two jaws that close along the y of its frame; z points out of it.

    Parameters
    ----------
    opening_m
        Greatest distance between the jaws [m], > 0.
    tip_m
        From the hand's frame to the ends of its jaws along z [m], > 0.
    force_n
        With how much its jaws can close [N], > 0.
    jaw_m
        A jaw, from its end upwards: height above the end, half its width across the closing axis,
        and how far behind its face it begins and ends along that axis [m]. Convex between.
    body_m
        The body, from its underside upwards: depth in the hand's frame, half its extent along the
        closing axis, and half its extent across it [m]. Convex between.
    on_flange
        Where its frame is on the flange.
    jaw_corners_m
        Of a jaw more exactly, if not empty: how far behind its face, along the closing axis, where
        across it, and how high above its end.
    body_corners_m
        Of the body more exactly, if not empty: where along the closing axis, across it, and how
        deep in the hand's frame. It need not be the same turned by half a turn.
    mass_kg
        Mass [kg], >= 0; 0 if unknown.

    Raises
    ------
    ValueError
        If a length or the force is not positive, or an outline has fewer than two heights.
    """

    opening_m: float
    tip_m: float
    force_n: float
    jaw_m: JawProfile
    body_m: tuple[tuple[float, float, float], ...]
    on_flange: Transform = _NOWHERE
    jaw_corners_m: tuple[Triple, ...] = ()
    body_corners_m: tuple[Triple, ...] = ()
    mass_kg: float = 0.0

    def __post_init__(self) -> None:
        for what in ("opening_m", "tip_m", "force_n"):
            value = getattr(self, what)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"Hand {what} must be > 0, not {value}.")
        if not (math.isfinite(self.mass_kg) and self.mass_kg >= 0):
            raise ValueError(f"Hand mass_kg must be >= 0, not {self.mass_kg}.")
        for what, rows in (("jaw_m", self.jaw_m), ("body_m", self.body_m)):
            if len(rows) < 2 or not all(math.isfinite(one) for row in rows for one in row):
                raise ValueError(f"Hand {what} needs two heights at least, all of them finite.")

    @property
    def tip_on_flange(self) -> Transform:
        """Where the ends of its jaws are on the flange.

        Hands are mounted along the axis of the flange: their frame is turned about it only.
        """
        x_m, y_m, z_m = self.on_flange.xyz_m
        return Transform((x_m, y_m, z_m + self.tip_m), self.on_flange.rpy_rad)

    @property
    def jaw(self) -> tuple[Triple, ...]:
        """Corners of a jaw: behind its face, across the closing axis, above its end [m]."""
        return self.jaw_corners_m or tuple(
            (behind_m, side * half_m, height_m)
            for height_m, half_m, begin_m, end_m in self.jaw_m
            for behind_m in (begin_m, end_m)
            for side in (-1, 1)
        )

    @property
    def body(self) -> tuple[tuple[Triple, ...], ...]:
        """Corners of convex pieces of the body: along the closing axis, across it, depth [m].

        Jaws close alike with the hand turned by half a turn, so that its body may be either way
        round: one piece is the body as it is described, the other the same turned.
        """
        if self.body_corners_m:
            turned = tuple((-x_m, -y_m, z_m) for x_m, y_m, z_m in self.body_corners_m)
            return (self.body_corners_m, turned)
        corners = tuple(
            (a * length_m, b * width_m, depth_m)
            for depth_m, length_m, width_m in self.body_m
            for a in (-1, 1)
            for b in (-1, 1)
        )
        return (corners,)

    @property
    def underside_m(self) -> float:
        """How deep in the hand's frame its body ends [m]."""
        return max(row[0] for row in self.body_m)

    @property
    def half_length_m(self) -> float:
        """Half the extent of its body along the closing axis [m]."""
        return max(row[1] for row in self.body_m)

    @property
    def half_width_m(self) -> float:
        """Half the extent of its body across the closing axis [m]."""
        return max(row[2] for row in self.body_m)

    @property
    def jaw_half_width_m(self) -> float:
        """Half the width of the end of a jaw [m]."""
        return self.jaw_m[0][1]
