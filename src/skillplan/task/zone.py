"""Zones of a cell: prisms that arm or load stay out of, or in which the arm moves slowly."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, Literal

from skillplan.task.pose import Point

if TYPE_CHECKING:
    from skillplan.task.scene import Scene

Mover = Literal["arm", "load"]

CEILING_M: Final = 5.0
"""Height of a zone without an upper end [m], above any arm."""

# Overlap in area that is rounding [m2].
_ROUNDING_M2 = 1e-12


@dataclass(frozen=True)
class Zone:
    """An upright prism over a polygon.

    Parameters
    ----------
    name
        Unique in the scene.
    corners
        Corners of the polygon in order [m], three at least; its sides do not cross.
    low_m, high_m
        Heights of bottom and top [m], low < high.
    keeps_out
        What must not enter: ``arm`` (links, hand and tool), ``load`` (carried parts and screws).
    speed_m_per_s
        Greatest speed of the tip while it is inside [m/s], > 0; None for no limit.

    Raises
    ------
    ValueError
        If the polygon or a number is out of range, or if the zone has no effect.
    """

    name: str
    corners: tuple[tuple[float, float], ...]
    low_m: float
    high_m: float
    keeps_out: tuple[Mover, ...] = ("arm", "load")
    speed_m_per_s: float | None = None

    def __post_init__(self) -> None:
        if len(self.corners) < 3:
            raise ValueError(f"Zone {self.name!r} needs at least three corners.")
        if not (math.isfinite(self.low_m) and self.low_m < self.high_m < math.inf):
            raise ValueError(f"Zone {self.name!r}: low_m must be below high_m.")
        if self.speed_m_per_s is not None and not 0 < self.speed_m_per_s < math.inf:
            raise ValueError(f"Zone {self.name!r}: speed must be > 0, not {self.speed_m_per_s}.")
        if not self.keeps_out and self.speed_m_per_s is None:
            raise ValueError(f"Zone {self.name!r} neither keeps anything out nor slows the arm.")

    @property
    def label(self) -> str:
        """Name in sentences; no body can have it."""
        return f"the zone {self.name}"

    @cached_property
    def polygon(self) -> Any:
        """The polygon as `shapely.Polygon`."""
        # Imports numpy.
        import shapely

        return shapely.Polygon(self.corners)

    @cached_property
    def pieces(self) -> tuple[tuple[tuple[float, float], ...], ...]:
        """Corners of convex polygons that make up the polygon [m]."""
        import shapely

        if self.polygon.convex_hull.area - self.polygon.area <= _ROUNDING_M2:
            return (self.corners,)
        triangles = shapely.constrained_delaunay_triangles(self.polygon)
        return tuple(tuple(triangle.exterior.coords[:3]) for triangle in triangles.geoms)

    def cut(
        self, low: tuple[float, float], high: tuple[float, float]
    ) -> list[list[tuple[float, float]]]:
        """Return the outlines of the polygon within a rectangle, for pictures [m]."""
        import shapely

        visible = shapely.intersection(self.polygon, shapely.box(*low, *high))
        pieces = getattr(visible, "geoms", [visible])
        return [[*piece.exterior.coords][:-1] for piece in pieces if piece.area > 0]

    def holds(self, point: Point) -> bool:
        """Return True if a point [m] is inside, not on the border."""
        import shapely

        inside = self.low_m < point[2] < self.high_m
        return inside and bool(self.polygon.contains_properly(shapely.Point(point[:2])))

    def meets(
        self, footprint: Sequence[Sequence[float]], low_m: float, high_m: float, tolerance_m: float
    ) -> bool:
        """Return True if an upright prism overlaps the zone by more than a tolerance.

        Parameters
        ----------
        footprint
            Points whose convex hull is the base of the prism, as x and y [m].
        low_m, high_m
            Heights of its bottom and top [m].
        """
        import shapely

        if low_m + tolerance_m >= self.high_m or high_m - tolerance_m <= self.low_m:
            return False
        hull = shapely.MultiPoint([point[:2] for point in footprint]).convex_hull
        shared = shapely.intersection(hull, self.polygon)
        return bool(shared.buffer(-tolerance_m).area > _ROUNDING_M2)


def list_keep_outs(scene: Scene, mover: Mover) -> list[Zone]:
    """Return the zones that keep the arm, or its load, out."""
    return [zone for zone in scene.zones if mover in zone.keeps_out]


def list_slow_zones(scene: Scene) -> list[Zone]:
    """Return the zones that limit the speed of the tip."""
    return [zone for zone in scene.zones if zone.speed_m_per_s is not None]


def describe_unchecked_speeds(scene: Scene) -> tuple[str, ...]:
    """Return that limits of speed hold for the tip only, if there are any."""
    names = ", ".join(zone.name for zone in list_slow_zones(scene))
    return (f"speed of links behind the tip in {names}: the limit is the tip's",) if names else ()


class SlowTravel:
    """Additional cost of straight travels at one height through zones with a speed limit.

    Parameters
    ----------
    zones
        Zones at the height of the travels, each with a speed limit.
    per_m
        Cost per metre outside of the zones [s/m]; a zone that allows more speed costs nothing.
    """

    def __init__(self, zones: Iterable[Zone], per_m: float) -> None:
        import shapely

        self._excess: list[tuple[Any, float]] = []
        covered = shapely.Polygon()
        for zone in sorted(zones, key=lambda zone: zone.speed_m_per_s or math.inf):
            # The slowest of several zones counts.
            left = shapely.difference(zone.polygon, covered)
            covered = shapely.union(covered, zone.polygon)
            excess = 1 / (zone.speed_m_per_s or math.inf) - per_m
            if excess > 0:
                self._excess.append((left, excess))

    def cost_s(self, *stops: Point) -> float:
        """Return the additional time of a travel along straight lines between stops [s], >= 0."""
        import shapely

        total_s = 0.0
        for begin, end in pairwise(stops):
            if begin[:2] != end[:2]:
                line = shapely.LineString([begin[:2], end[:2]])
                total_s += math.fsum(
                    excess * shapely.intersection(line, area).length
                    for area, excess in self._excess
                )
        return total_s
