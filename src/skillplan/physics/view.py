"""From where a camera looks at a workplace."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skillplan.task.motion import Point

# From the side that the arm does not hide.
_AZIMUTH_DEG, _ELEVATION_DEG = 52.0, 28.0
# Of half the picture's width and height so much is filled by what has to be seen, from no nearer.
FILLED = 0.92
NEAREST_M = 0.3
CLOSE_UP_M = 0.62
FIELD_OF_VIEW_DEG = 45.0
WIDTH, HEIGHT = 1280, 720


@dataclass(frozen=True, slots=True)
class Angle:
    """From which side a camera looks, and from how far off.

    Parameters
    ----------
    azimuth_deg
        Of the direction in which it looks, about the vertical, from y towards -x [deg].
    elevation_deg
        How far above what it looks at it stands [deg], -90 to 90.
    distance_m
        From how far off [m]; left out: from as near as shows all.

    Raises
    ------
    ValueError
        If the elevation or the distance is not in its range.
    """

    azimuth_deg: float = _AZIMUTH_DEG
    elevation_deg: float = _ELEVATION_DEG
    distance_m: float | None = None

    def __post_init__(self) -> None:
        values = (self.azimuth_deg, self.elevation_deg, self.distance_m or 0.0)
        if not all(math.isfinite(value) for value in values):
            raise ValueError("An angle of a camera is of finite numbers.")
        if not -90 <= self.elevation_deg <= 90:
            raise ValueError(f"A camera is -90 to 90 degrees high, not {self.elevation_deg:g}.")
        if self.distance_m is not None and not 0 < self.distance_m <= 20:
            raise ValueError(f"A camera is 0 to 20 m off, not {self.distance_m:g} m.")

    @classmethod
    def parse(cls, text: str) -> Angle:
        """Return what a name or numbers say: `front`, or `AZIMUTH,ELEVATION,DISTANCE`.

        Raises
        ------
        ValueError
            If it is neither, in words.
        """
        if text in NAMED:
            return NAMED[text]
        try:
            azimuth_deg, elevation_deg, distance_m = map(float, text.split(","))
        except ValueError:
            known = ", ".join(NAMED)
            raise ValueError(
                f"{text!r} is no camera: {known}, or AZIMUTH,ELEVATION,DISTANCE in degrees and m"
            ) from None
        return cls(azimuth_deg, elevation_deg, distance_m)

    @property
    def axes(self) -> tuple[Point, Point, Point]:
        """To the right, up, and back to the camera, in the world."""
        a, e = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        right = (math.cos(a), math.sin(a), 0.0)
        back = (math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e))
        up = (-math.sin(a) * math.sin(e), math.cos(a) * math.sin(e), math.cos(e))
        return right, up, back


NAMED = {
    "front": Angle(90.0, 22.0),
    "side": Angle(0.0, 22.0),
    "top": Angle(90.0, 89.0),
}


@dataclass(frozen=True, slots=True)
class View:
    """What a camera looks at, from where.

    Parameters
    ----------
    target
        What is in the middle [m].
    angle
        From which side.
    distance_m
        From how far off [m].
    """

    target: Point
    angle: Angle
    distance_m: float

    @classmethod
    def close_up(cls, target: Point) -> View:
        """Return a view of a point and what is about it."""
        return cls(target, Angle(), CLOSE_UP_M)

    @classmethod
    def about(cls, points: list[Point], angle: Angle | None = None) -> View:
        """Return a view of all of some points, from as near as it can be, unless that is said."""
        angle = angle or Angle()
        low = [min(point[axis] for point in points) for axis in range(3)]
        high = [max(point[axis] for point in points) for axis in range(3)]
        middle = tuple((one + other) / 2 for one, other in zip(low, high, strict=True))
        target = (middle[0], middle[1], middle[2])
        if angle.distance_m is not None:
            return cls(target, angle, angle.distance_m)
        half = math.tan(math.radians(FIELD_OF_VIEW_DEG) / 2) * FILLED
        distance_m = NEAREST_M
        for point in points:
            away = [one - other for one, other in zip(point, target, strict=True)]
            x, y, z = (
                sum(own * one for own, one in zip(axis, away, strict=True)) for axis in angle.axes
            )
            # A point at the middle's depth plus its own must lie within the pyramid of view.
            wide_m, high_m = abs(x) / (half * WIDTH / HEIGHT) + z, abs(y) / half + z
            distance_m = max(distance_m, wide_m, high_m)
        return cls(target, angle, distance_m)
