"""Where two parts touch, and how."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from skillplan_cad.product import Vector

ContactKind = Literal["plane", "cylinder", "thread", "free"]


@dataclass(frozen=True, slots=True)
class Contact:
    """Two parts that touch, or overlap.

    Parameters
    ----------
    parts
        Names, in the order of the product.
    kind
        ``plane``; ``cylinder`` for one in another; ``thread`` for a fastener in what it is
        screwed into; ``free`` for all else.
    area_m2
        How much of the first part's surface lies on the second.
    normals
        Unit vectors out of the first part's surface where it touches, the distinct ones.
    axis, axis_point_m
        Of a cylinder or thread; None else.
    radius_m, radius_difference_m
        Of the inner cylinder, and the outer one's radius minus it (negative for a press fit); None
        where there is none.
    points_m
        Points of the contact, spread over it: at most 32.
    overlap_m3
        Volume that both parts claim.
    overlap_allowed_m3
        How much of that the chords of curved faces explain; more is interference.
    overlap_point_m
        Where the overlap is; None without one.
    overlap_surface_m2
        Surface of that volume.
    """

    parts: tuple[str, str]
    kind: ContactKind
    area_m2: float
    normals: tuple[Vector, ...]
    axis: Vector | None = None
    axis_point_m: Vector | None = None
    radius_m: float | None = None
    radius_difference_m: float | None = None
    points_m: tuple[Vector, ...] = ()
    overlap_m3: float = 0.0
    overlap_allowed_m3: float = 0.0
    overlap_point_m: Vector | None = None
    overlap_surface_m2: float = 0.0

    @property
    def interferes(self) -> bool:
        """Whether the parts overlap by more than chords explain; a thread does on purpose."""
        return self.kind != "thread" and self.overlap_m3 > self.overlap_allowed_m3
