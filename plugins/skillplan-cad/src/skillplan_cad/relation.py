"""The blocking relation of a product: "part, moved along direction, is blocked by `by`"."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Points, Vector

ContactKind = Literal["plane", "cylinder", "thread", "free"]
FitKind = Literal[
    "press fit",
    "thread",
    "seal",
    "teeth",
    "overlap",
    "thread in solid",
    "no hole",
    "sunk",
    "squeezed",
    "pins in solid",
]


@dataclass(frozen=True, slots=True)
class Fit:
    """An overlap that is drawn on purpose.

    Parameters
    ----------
    depth_m
        Depth of the overlap, on each side [m].
    allowed_m
        Greatest depth that is a fit [m].
    volume_m3
        Volume that both parts claim [m3].
    """

    kind: FitKind
    depth_m: float
    allowed_m: float
    volume_m3: float


@dataclass(frozen=True, slots=True)
class Contact:
    """Two parts that touch or overlap.

    Parameters
    ----------
    parts
        Names, in the order of the product.
    kind
        ``plane``; ``cylinder`` for a shaft in a hole; ``thread`` for a fastener in its thread;
        ``free`` otherwise.
    area_m2
        Area of the first part's surface that lies on the second.
    normals
        Distinct outward unit normals of the first part at the contact.
    axis, axis_point_m
        Axis of a cylinder or thread; None otherwise.
    radius_m
        Radius of the inner cylinder; None without one.
    radius_difference_m
        Outer minus inner radius, negative for a press fit; None without cylinder.
    points_m
        At most 32 points spread over the contact.
    overlap_m3
        Volume shared by both parts.
    overlap_allowed_m3
        Share of that volume explained by the chords of curved faces; more is interference.
    overlap_point_m
        Centre of the overlap's largest piece; None without one.
    overlap_depth_m
        Distance between the parts' surfaces across the overlap; 0 if chords explain it.
    overlap_thickness_m
        As overlap_depth_m, for half of the overlap: parts of it may be deeper.
    overlap_section_m
        Second smallest side of the overlap's box; 0 if chords explain it.
    fit
        The fit that the overlap is; None for interference or without one.
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
    overlap_depth_m: float = 0.0
    overlap_thickness_m: float = 0.0
    overlap_section_m: float = 0.0
    fit: Fit | None = None

    @property
    def interferes(self) -> bool:
        """True if the parts overlap by more than chords explain, and not as a fit."""
        if self.kind == "thread" or self.fit is not None:
            return False
        return self.overlap_m3 > self.overlap_allowed_m3


PartKind = Literal["part", "screw", "nut", "washer", "pin"]

Reason = Literal[
    "stuck",
    "not examined",
    "surface",
    "sub-assembly",
    "several moves",
    "hangs lower",
    "not level",
    "tips",
    "floats",
    "from below",
    "closed in",
    "turns",
    "follows",
    "too heavy",
    "no grasp",
    "no head",
    "unreachable",
    "no place",
    "refused",
    "no order",
]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A part that is not in the task.

    Parameters
    ----------
    kind
        Kind of reason; ``follows`` if it depends on other parts that are left out.
    text
        Clause that follows the part's name, without a full stop.
    by
        Names of the parts that cause it.
    """

    part: str
    kind: Reason
    text: str
    by: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RelationPart:
    """A part of the relation.

    Parameters
    ----------
    name
        As in `Part.name`.
    kind
        Kind of fastener, or part.
    identical_to
        Name of the first part of the same shape; None for that part itself.
    mirror_of
        Name of the first part whose mirror image this part is, or None.
    """

    name: str
    kind: PartKind
    identical_to: str | None
    mirror_of: str | None
    mass_kg: float


# Width of a screw, in diameters of its shank, up to which it has no head.
_HEADLESS = 1.15


@dataclass(frozen=True, slots=True)
class Fastener:
    """A screw, nut, washer or pin.

    Parameters
    ----------
    axis
        Unit vector of its removal: from the tip of a screw to its head.
    point_m
        Point of the axis at which the driver meets the head.
    diameter_m
        Nominal diameter of thread or shank; of the hole for nuts and washers.
    length_m
        Length along the axis, without the head.
    joins
        Names of the parts it holds together, from the head on.
    threaded_in
        Names of the parts its thread grips, which do not block it along its axis.
    by
        Features by which it was recognised, such as ``name``, ``head``, ``tapped hole``; not empty.
    held
        True if a pocket keeps it from turning: a hand places it, and a driver turns its mate.
    """

    part: str
    kind: PartKind
    axis: Vector
    point_m: Vector
    diameter_m: float
    length_m: float
    joins: tuple[str, ...]
    threaded_in: tuple[str, ...]
    by: tuple[str, ...]
    held: bool = False

    def list_radii_m(self, points_m: Points) -> Points:
        """Return the distances of points from its axis [m]."""
        axis, apart = np.asarray(self.axis), points_m - np.asarray(self.point_m)
        return np.asarray(np.linalg.norm(apart - np.outer(apart @ axis, axis), axis=1))

    def is_headless(self, points_m: Points) -> bool:
        """Return whether it is a screw that is nowhere wider than its shank, give or take 15 %."""
        widest_m = float(self.list_radii_m(points_m).max())
        return self.kind == "screw" and widest_m <= _HEADLESS * self.diameter_m / 2


@dataclass(frozen=True, slots=True)
class Blocking:
    """One part, moved in a direction, meets another.

    Parameters
    ----------
    distance_m
        Distance of the move until they meet.
    width_m
        Diameter of the largest blocked disc.
    point_m
        A point of `by` that is met.
    sensitive
        True if half or double the tolerance gives another answer.
    """

    part: str
    by: str
    direction: int
    distance_m: float
    width_m: float
    point_m: Vector
    sensitive: bool = False


@dataclass(frozen=True, slots=True)
class Sensitive:
    """A blocking answer that depends on the tolerance.

    Parameters
    ----------
    part, by, direction
        As in `Blocking`.
    blocked
        Answer at the tolerance, as in the relation.
    otherwise_at_m
        Half or double tolerance with the opposite answer [m].
    """

    part: str
    by: str
    direction: int
    blocked: bool
    otherwise_at_m: float


@dataclass(frozen=True)
class Relation:
    """Parts, contacts and fasteners of a product, and the blockings along each direction.

    Parameters
    ----------
    tolerance_m
        Smallest radius of a disc that counts as blocked [m].
    directions
        Unit vectors; the first six are +x, -x, +y, -y, +z, -z of the file's frame.
    blocked
        All blockings, sorted by direction, part and blocker.
    groups
        Strongly connected parts, none of which has a straight move.
    stuck
        Parts that no searched motion frees.
    """

    parts: tuple[RelationPart, ...]
    tolerance_m: float
    directions: tuple[Vector, ...]
    blocked: tuple[Blocking, ...]
    contacts: tuple[Contact, ...] = ()
    fasteners: tuple[Fastener, ...] = ()
    sensitive: tuple[Sensitive, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    stuck: tuple[str, ...] = ()
    _numbers: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        numbers = {part.name: number for number, part in enumerate(self.parts)}
        if len(numbers) != len(self.parts):
            raise ValueError("two parts of a relation have one name")
        unknown = {
            name for blocking in self.blocked for name in (blocking.part, blocking.by)
        } - numbers.keys()
        if unknown:
            raise ValueError(
                f"{sorted(unknown, key=str)[0]!r} is blocked or blocks, but is not a part"
            )
        object.__setattr__(self, "_numbers", numbers)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parts, in order."""
        return tuple(part.name for part in self.parts)

    def index(self, name: str) -> int:
        """Return the number of a part; raises KeyError for an unknown name."""
        return self._numbers[name]

    @cached_property
    def matrix(self) -> NDArray[np.bool_]:
        """Blocking matrix [direction, part, by]."""
        blocked = np.zeros((len(self.directions), len(self.parts), len(self.parts)), dtype=np.bool_)
        for blocking in self.blocked:
            blocked[
                blocking.direction, self._numbers[blocking.part], self._numbers[blocking.by]
            ] = True
        return blocked

    @cached_property
    def blocker_sets(self) -> tuple[tuple[tuple[int, int], ...], ...]:
        """For each part, all directions with the blockers there as bits."""
        weights = [1 << number for number in range(len(self.parts))]
        return tuple(
            tuple(
                (direction, sum(weights[by] for by in np.flatnonzero(rows[part]).tolist()))
                for direction, rows in enumerate(self.matrix)
            )
            for part in range(len(self.parts))
        )

    def blockers(self, part: str, direction: int) -> tuple[str, ...]:
        """Return the names of a part's blockers in a direction, in order."""
        row = self.matrix[direction, self._numbers[part]]
        return tuple(self.parts[number].name for number in np.flatnonzero(row))

    def fastener(self, part: str) -> Fastener | None:
        """Return the fastener of a name, or None for other parts."""
        return next((fastener for fastener in self.fasteners if fastener.part == part), None)

    @cached_property
    def driven(self) -> frozenset[str]:
        """Names of the screws and nuts that a screwdriver brings; a hand holds the others."""
        return frozenset(
            fastener.part
            for fastener in self.fasteners
            if fastener.kind in ("screw", "nut") and fastener.joins and not fastener.held
        )
