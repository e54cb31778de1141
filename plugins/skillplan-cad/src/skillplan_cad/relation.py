"""What blocks what: the relation that planning rests on, and `relation.json`, which holds it.

"Part, moved along direction, is blocked by `by`".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

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


PartKind = Literal["part", "screw", "nut", "washer", "pin"]


@dataclass(frozen=True, slots=True)
class RelationPart:
    """A part as the relation knows it.

    Parameters
    ----------
    name
        As `Part.name`.
    kind
        What it is for: a fastener, or a part.
    identical_to
        Name of the first part of the same shape, or None for that one and for single ones.
    mirror_of
        Name of the first part that it is the mirror image of, or None.
    mass_kg
        Its mass.
    """

    name: str
    kind: PartKind
    identical_to: str | None
    mirror_of: str | None
    mass_kg: float


@dataclass(frozen=True, slots=True)
class Fastener:
    """A screw, nut, washer or pin.

    Parameters
    ----------
    part
        Its name.
    kind
        Which of them.
    axis
        Unit vector in which it is taken out: from the tip to the head of a screw.
    point_m
        A point of the axis: where the driver meets the head.
    diameter_m
        Nominal, of the thread or shank; of the hole for a nut or washer.
    length_m
        Along the axis, without the head.
    joins
        Names of the parts that it holds together, from the head on.
    threaded_in
        Names of the parts that its thread grips. It is unscrewed out of these: they block it in
        no direction along its axis.
    by
        By what it was known: ``name``, ``head``, ``tapped hole`` and so on; at least one.
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


@dataclass(frozen=True, slots=True)
class Blocking:
    """That one part, moved in a direction, meets another.

    Parameters
    ----------
    part, by
        Names.
    direction
        Number of the direction.
    distance_m
        How far it moves until they meet.
    width_m
        Width of what is in the way: the diameter of the largest disc that is blocked.
    point_m
        A point of `by` that is met.
    sensitive
        Whether half or double the tolerance says otherwise.
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
    """An answer that hangs on the tolerance.

    Parameters
    ----------
    part, by, direction
        As of `Blocking`.
    blocked
        What holds at the tolerance, which the relation has.
    otherwise_at_m
        The tolerance, half or double, at which the opposite holds.
    """

    part: str
    by: str
    direction: int
    blocked: bool
    otherwise_at_m: float


@dataclass(frozen=True)
class Relation:
    """Parts, contacts, fasteners, and what blocks what along which direction.

    Parameters
    ----------
    parts
        In the order of the product.
    tolerance_m
        Radius of the disc that has to be blocked before a pair is.
    directions
        Unit vectors; the first six are +x, -x, +y, -y, +z, -z of the file's frame.
    blocked
        All blockings, sorted by direction, part and blocker.
    contacts, fasteners, sensitive
        As found.
    groups
        Parts that no single straight move takes apart: strongly connected ones.
    stuck
        Parts that no motion that was searched frees.
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
        unknown = {name for one in self.blocked for name in (one.part, one.by)} - numbers.keys()
        if unknown:
            raise ValueError(
                f"{sorted(unknown, key=str)[0]!r} is blocked or blocks, and is no part"
            )
        object.__setattr__(self, "_numbers", numbers)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts, in order."""
        return tuple(part.name for part in self.parts)

    def index(self, name: str) -> int:
        """Return the number of a part; raises KeyError where there is none of the name."""
        return self._numbers[name]

    @cached_property
    def matrix(self) -> NDArray[np.bool_]:
        """Whether [direction, part, by] is blocked."""
        found = np.zeros((len(self.directions), len(self.parts), len(self.parts)), dtype=np.bool_)
        for one in self.blocked:
            found[one.direction, self._numbers[one.part], self._numbers[one.by]] = True
        return found

    def blockers(self, part: str, direction: int) -> tuple[str, ...]:
        """Return the names of the parts that block one in a direction, in order."""
        row = self.matrix[direction, self._numbers[part]]
        return tuple(self.parts[number].name for number in np.flatnonzero(row))

    def opposite(self, direction: int) -> int | None:
        """Return the number of the opposite direction, or None where it is not among them."""
        wanted = -np.asarray(self.directions[direction])
        dots = np.asarray(self.directions) @ wanted
        best = int(np.argmax(dots))
        return best if dots[best] > 1 - 1e-9 else None

    def fastener(self, part: str) -> Fastener | None:
        """Return what is known of a fastener, or None for what is no fastener."""
        return next((one for one in self.fasteners if one.part == part), None)

    @cached_property
    def driven(self) -> frozenset[str]:
        """Names of the screws and nuts that a screwdriver brings; all else is held in a hand."""
        return frozenset(
            one.part for one in self.fasteners if one.kind in ("screw", "nut") and one.joins
        )
