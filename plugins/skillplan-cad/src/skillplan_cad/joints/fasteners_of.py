"""Recognise screws, nuts, washers and pins, by name or by features.

A name counts only if the shape agrees: a screw is small and has an axis, a nut has a bore. Without
a name, a cylinder in a hole is not sufficient: shafts, plugs and sleeves match it, too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.blocking.all_pairs import BlockingTest
from skillplan_cad.blocking.ray_mesh import RayMesh
from skillplan_cad.joints.fastener_names import is_rod_name, recognise_kind
from skillplan_cad.joints.turned_shape import (
    TurnedShape,
    describe_turned_shape,
    measure_holes_mm,
    trace_outside_mm,
)
from skillplan_cad.product import Part, Points, Product, Vector, make_solid
from skillplan_cad.relation import Contact, Fastener, PartKind

Floats = NDArray[np.float64]

# Head width by shank width, lowest and highest; shortest shank, in diameters.
_HEAD, _WIDEST_HEAD, _LEAST_SHANK = 1.25, 3.5, 0.8
# Smallest excess of a shank over its tapped hole, in radii; the widest hole that guides a shank.
_TAPPED, _GUIDED = 0.02, 1.5
# Largest difference between the radii of a shank around its axis; a square has 0.41.
_ROUND = 0.3
# Turns of a thread that count as one; smallest depth of a thread, in radii; samples.
_TURNS, _DEPTH, _SAMPLES = 3, 0.02, 160
# Evenness of a fastener about its axis, by features and by name; distance of its centre of mass
# from the axis, in radii; widest drive, as a share of the head.
_EVEN, _NAMED_EVEN, _CENTRED, _DRIVE = 0.9, 0.6, 0.15, 0.85
# Largest volume of a fastener, as a share of the largest part that it joins, by features and by
# name; largest length, as a share of that part's longest side.
_SMALL, _NAMED_SMALL, _SHORT = 0.25, 1.0, 0.75
# Largest height of a washer, in radii of its bore; widest ring, in bores; longest nut, in bores.
_THIN_WASHER, _WIDEST_RING, _LONGEST_NUT = 1.0, 4.5, 8.0
# Shortest pin, in diameters.
_SHORTEST_PIN = 0.6
_STATIONS = 24
# Angles by which a fastener is turned in its pocket [rad]; smallest overlap that stops it, as a
# share of its volume.
_TURNED_RAD, _STOPS = (0.0, 0.26, 0.52), 0.005
_FLAT = 0.999


@dataclass(frozen=True, slots=True)
class FastenerOptions:
    """Parts that the user declares.

    Parameters
    ----------
    fasteners, others
        Names of parts that are fasteners, and of parts that are none.
    """

    fasteners: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Fasteners:
    """The fasteners of a product.

    Parameters
    ----------
    notes
        Parts that are named like fasteners and are none, one sentence each.
    """

    fasteners: tuple[Fastener, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Passage:
    """A part around a shank.

    Parameters
    ----------
    low_m, high_m
        Interval of the axis within the part, from the shape's origin.
    radius_m
        Radius of its hole; 0 in solid material.
    """

    name: str
    low_m: float
    high_m: float
    radius_m: float

    @property
    def place_m(self) -> float:
        return (self.low_m + self.high_m) / 2


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    number: int
    part: Part
    shape: TurnedShape
    named: PartKind | None
    is_declared: bool
    passages: tuple[_Passage, ...] = ()

    @property
    def gripping(self) -> tuple[_Passage, ...]:
        """Parts whose hole is as narrow as the shank."""
        widest = (1 + _TAPPED) * self.shape.shank_m
        return tuple(passage for passage in self.passages if passage.radius_m <= widest)


def find_fasteners(
    product: Product,
    test: BlockingTest,
    contacts: Sequence[Contact],
    tolerance_m: float,
    options: FastenerOptions | None = None,
) -> Fasteners:
    """Return the fasteners of a product, in the order of its parts.

    Parameters
    ----------
    tolerance_m
        Largest clearance of a hole that still grips [m].
    """
    options = options or FastenerOptions()
    search = _Search(product, test, contacts, tolerance_m)
    candidates = list(search.list_candidates(options))
    fasteners: dict[int, Fastener] = {}
    for candidate in candidates:
        by = search.find_screw_features(candidate)
        if by:
            fasteners[candidate.number] = search.build_screw(candidate, by)
    screws = dict(fasteners)
    for candidate in candidates:
        if candidate.number not in fasteners:
            ring = search.build_ring(candidate, screws)
            if ring is not None:
                fasteners[candidate.number] = ring
    for number, fastener in fasteners.items():
        fasteners[number] = _attach_nuts(fastener, fasteners)
    for number, fastener in fasteners.items():
        fasteners[number] = _attach_joined_parts(fastener, fasteners)
    for number in search.find_held(fasteners):
        fasteners[number] = replace(fasteners[number], held=True)
    notes = [
        f"{candidate.part.name} is named like a {candidate.named}, but {why}: it is taken as a part"
        for candidate in candidates
        if candidate.number not in fasteners and (why := search.explain_refusal(candidate))
    ]
    return Fasteners(tuple(fasteners[number] for number in sorted(fasteners)), tuple(notes))


class _Search:
    """The parts of a product about their axes, and what surrounds them."""

    def __init__(
        self, product: Product, test: BlockingTest, contacts: Sequence[Contact], tolerance_m: float
    ) -> None:
        self._product, self._test = product, test
        self._contacts, self._tolerance_m = contacts, tolerance_m
        self._bounds_m = [part.bounds_m for part in product]
        self._shapes: dict[int, TurnedShape | None] = {}

    def list_candidates(self, options: FastenerOptions) -> list[_Candidate]:
        """Return all parts with an axis that may be fasteners."""
        candidates = []
        for number, part in enumerate(self._product):
            if part.name in options.others:
                continue
            shape = self._get_shape(number)
            if shape is None:
                continue
            is_declared = part.name in options.fasteners
            kind = recognise_kind(part.name, part.design)
            if kind is None and is_declared:
                is_flat = shape.length_m <= _THIN_WASHER * shape.bore_m and shape.outer_planes == 0
                kind = "screw" if not shape.bore_m else "washer" if is_flat else "nut"
            candidate = _Candidate(number, part, shape, kind, is_declared)
            passages = () if kind in ("nut", "washer") else self._find_passages(candidate)
            candidates.append(replace(candidate, passages=passages))
        return candidates

    def find_screw_features(self, candidate: _Candidate) -> tuple[str, ...]:
        """Return the features that make a candidate a screw or pin; empty if it is neither."""
        shape = candidate.shape
        if candidate.named in ("screw", "pin"):
            if candidate.is_declared:
                return ("option",)
            return () if self.explain_refusal(candidate) else ("name",)
        if (
            candidate.named is not None
            or is_rod_name(candidate.part.name, candidate.part.design)
            or shape.bore_m
            or shape.shank_length_m < _LEAST_SHANK * 2 * shape.shank_m
            or shape.evenness < _EVEN
            or shape.offset_m > _CENTRED * shape.shank_m
            or not self._enters(candidate)
            or not self._is_small(candidate, _SMALL)
            or not self._is_round(candidate)
        ):
            return ()
        head = _HEAD <= shape.wide_share <= _WIDEST_HEAD
        drive = (shape.inner_planes in (2, 4, 6) and shape.drive_m < _DRIVE * shape.head_m) or (
            head and shape.outer_planes == 6
        )
        tapped = any(
            0.6 * shape.shank_m <= passage.radius_m < (1 - _TAPPED) * shape.shank_m
            for passage in candidate.passages
        )
        threaded = self._is_threaded(candidate)
        features = {"head": head, "drive": drive, "thread": threaded, "tapped hole": tapped}
        enough = (head and (drive or threaded or tapped)) or (drive and (threaded or tapped))
        return tuple(word for word, holds in features.items() if holds) if enough else ()

    def explain_refusal(self, candidate: _Candidate) -> str:
        """Return why a part is not what its name implies; empty if it may be."""
        shape, kind = candidate.shape, candidate.named
        if kind in ("nut", "washer"):
            if not shape.bore_m:
                return "has no hole through it"
            if shape.head_m > _WIDEST_RING * shape.bore_m:
                return "is much wider than its hole"
            is_long = shape.length_m > _LONGEST_NUT * shape.bore_m
            return "is longer than wide" if is_long else ""
        if kind is None:
            return ""
        is_even = shape.evenness >= _NAMED_EVEN and shape.offset_m <= shape.shank_m
        if not is_even or not self._is_round(candidate):
            return "is not round about an axis"
        if shape.length_m < _SHORTEST_PIN * shape.shank_m:
            return "is flat"
        if not self._is_small(candidate, _NAMED_SMALL):
            return "is large against the parts that it touches"
        return ""

    def build_screw(self, candidate: _Candidate, by: tuple[str, ...]) -> Fastener:
        """Return the screw or pin that a candidate is."""
        shape, name = candidate.shape, candidate.part.name
        places = {passage.name: passage.place_m for passage in candidate.passages}
        for other, place in self._find_pressed_places(name, shape).items():
            places.setdefault(other, place)
        kind: PartKind = "pin" if candidate.named == "pin" else "screw"
        mates = candidate.gripping or candidate.passages
        # If CAD draws all holes as wide as the shank, the last one has the thread.
        last = min(mates, key=lambda mate: (mate.low_m, mate.place_m, mate.name), default=None)
        return Fastener(
            part=name,
            kind=kind,
            axis=_vector(shape.axis),
            point_m=_vector(shape.origin_m + shape.high_m * shape.axis),
            diameter_m=2 * shape.shank_m,
            length_m=shape.shank_length_m,
            joins=tuple(sorted(places, key=lambda other: (-places[other], other))),
            threaded_in=() if kind == "pin" or last is None else (last.name,),
            by=by,
        )

    def build_ring(self, candidate: _Candidate, screws: dict[int, Fastener]) -> Fastener | None:
        """Return a nut or washer, by name or as a ring on the axis of a screw, or None."""
        shape, part = candidate.shape, candidate.part
        if not shape.bore_m or candidate.named not in (None, "nut", "washer"):
            return None
        on = [
            (number, screw)
            for number, screw in screws.items()
            if self._is_on(candidate, screw, number)
        ]
        kind, by = self._recognise_ring(candidate, bool(on))
        if kind is None:
            return None
        rod = self._find_rod(candidate) if kind == "nut" and not on else None
        pressed = self._find_lain_on(part.name, shape.axis)
        axis = np.asarray(on[0][1].axis) if on else shape.axis
        if kind == "nut":
            # A nut comes off the end of the screw, and away from what it lies on.
            axis = -axis if on else axis * (1 if pressed[0] or not pressed[1] else -1)
        below = self._find_lain_on(part.name, axis)[0] if kind == "nut" and (on or rod) else ()
        end = float(np.max((part.vertices_m - shape.origin_m) @ axis))
        own = tuple(screw.part for _, screw in on)
        if rod is not None and below:
            own = (rod,)
        return Fastener(
            part=part.name,
            kind=kind,
            axis=_vector(axis),
            point_m=_vector(shape.origin_m + end * axis),
            diameter_m=2 * shape.bore_m,
            length_m=shape.length_m,
            joins=(*own, *(name for name in below if name not in own)),
            threaded_in=own if kind == "nut" else (),
            by=by,
        )

    def find_held(self, fasteners: Mapping[int, Fastener]) -> list[int]:
        """Return the nuts, and screws with nuts, that a pocket or rib keeps from turning.

        If both of a pair are kept, the screw is driven.
        """
        nuts = {mate for other in fasteners.values() if other.kind == "nut" for mate in other.joins}
        held = [
            number
            for number, fastener in fasteners.items()
            if (fastener.kind == "nut" or (fastener.kind == "screw" and fastener.part in nuts))
            and self._is_kept_from_turning(number, fastener, fasteners)
        ]
        mates = {
            mate
            for number in held
            if fasteners[number].kind == "nut"
            for mate in fasteners[number].threaded_in
        }
        return [number for number in held if fasteners[number].part not in mates]

    def _is_kept_from_turning(
        self, number: int, fastener: Fastener, fasteners: Collection[int]
    ) -> bool:
        """Return whether a fastener, turned about its axis, enters a part that is no fastener."""
        part, axis = self._product.parts[number], np.asarray(fastener.axis)
        turned = [
            make_solid(self._turn(part, axis, fastener.point_m, angle), part.triangles)
            for angle in _TURNED_RAD
        ]
        reach_m = float(np.max(np.ptp(part.vertices_m, axis=0)))
        others = set(self._list_near(number, part.vertices_m, 0.1 * reach_m)) - set(fasteners)
        least_mm3 = _STOPS * float(turned[0].volume())
        for other in others:
            body = self._product.parts[other]
            solid = make_solid(body.vertices_m, body.triangles)
            shared = [float((solid ^ own).volume()) for own in turned]
            if max(shared) - shared[0] > least_mm3:
                return True
        return False

    def _turn(self, part: Part, axis: Floats, point_m: Vector, angle_rad: float) -> Points:
        """Return the vertices of a part that is turned about a line (Rodrigues' formula)."""
        apart = part.vertices_m - point_m
        along = np.outer(apart @ axis, axis)
        across = apart - along
        turned = np.cos(angle_rad) * across + np.sin(angle_rad) * np.cross(axis, across)
        return np.asarray(along + turned + point_m)

    def _recognise_ring(
        self, candidate: _Candidate, is_on_screw: bool
    ) -> tuple[PartKind | None, tuple[str, ...]]:
        shape = candidate.shape
        if candidate.named is not None:
            if candidate.is_declared:
                return candidate.named, ("option",)
            refused = self.explain_refusal(candidate)
            return (None, ()) if refused else (candidate.named, ("name",))
        wide = shape.head_m / shape.bore_m
        if not is_on_screw or not 1.3 <= wide <= 4 or shape.evenness < _EVEN:
            return None, ()
        if shape.outer_planes == 6 and shape.length_m <= 3 * shape.bore_m:
            return "nut", ("hexagon", "on a screw")
        plain = sum(face.kind != "plane" for face in candidate.part.faces) <= 4
        is_flat = shape.length_m <= _THIN_WASHER * shape.bore_m and shape.outer_planes == 0
        if is_flat and plain and len(candidate.part.faces) <= 8:
            return "washer", ("flat ring", "on a screw")
        return None, ()

    def _get_shape(self, number: int) -> TurnedShape | None:
        if number not in self._shapes:
            self._shapes[number] = describe_turned_shape(self._product.parts[number])
        return self._shapes[number]

    def _find_passages(self, candidate: _Candidate) -> tuple[_Passage, ...]:
        """Return the parts around the shank of a candidate."""
        shape = candidate.shape
        step = shape.shank_length_m / _STATIONS
        along = shape.low_m + (np.arange(_STATIONS) + 0.5) * step
        points_m = shape.origin_m + along[:, None] * shape.axis
        limit_m = max(_GUIDED * shape.shank_m, shape.shank_m + self._tolerance_m)
        passages = []
        for number in self._list_near(candidate.number, points_m, limit_m):
            radii_m = self._measure_holes_m(number, points_m, shape.axis, limit_m)
            around = np.flatnonzero(~np.isnan(radii_m))
            if len(around):
                low, high = along[around[0]] - step / 2, along[around[-1]] + step / 2
                radius = float(np.median(radii_m[around]))
                slack = self._tolerance_m if radius - shape.shank_m <= self._tolerance_m else 0.0
                name = self._product.parts[number].name
                passages.append(_Passage(name, float(low), float(high), max(0.0, radius - slack)))
        return tuple(passages)

    def _list_near(self, own: int, points_m: Floats, reach_m: float) -> list[int]:
        """Return the other parts whose bounding boxes meet the surroundings of points."""
        low, high = points_m.min(axis=0) - reach_m, points_m.max(axis=0) + reach_m
        return [
            number
            for number, bounds in enumerate(self._bounds_m)
            if number != own and (bounds[0] <= high).all() and (bounds[1] >= low).all()
        ]

    def _measure_holes_m(
        self, number: int, points_m: Floats, axis: Floats, limit_m: float
    ) -> NDArray[np.float64]:
        points_mm = (points_m - self._test.middle_m) * 1000
        return measure_holes_mm(self._test.meshes[number], points_mm, axis, limit_m * 1000) / 1000

    def _enters(self, candidate: _Candidate) -> bool:
        """Return whether a shank is in another part, for half a diameter or half its length."""
        deep_m = min(candidate.shape.shank_m, candidate.shape.shank_length_m / 2)
        return any(passage.high_m - passage.low_m >= deep_m for passage in candidate.passages)

    def _is_small(self, candidate: _Candidate, share: float) -> bool:
        """Return whether a part is small against the largest part that it touches or enters."""
        names = {passage.name for passage in candidate.passages}
        for contact in self._contacts:
            if candidate.part.name in contact.parts:
                names |= set(contact.parts) - {candidate.part.name}
        if not names:
            return True
        others = [self._product.part(name) for name in names]
        largest = max(others, key=lambda part: part.volume_m3)
        longest_m = max(float(np.max(part.bounds_m[1] - part.bounds_m[0])) for part in others)
        width_m = 2 * candidate.shape.head_m
        if candidate.part.volume_m3 <= share * largest.volume_m3:
            return True
        is_short = max(width_m, _SHORT * candidate.shape.length_m) <= longest_m
        is_light = candidate.part.volume_m3 < 4 * largest.volume_m3
        return bool(share >= _NAMED_SMALL and is_short and is_light)

    def _is_round(self, candidate: _Candidate) -> bool:
        """Return whether the outline of a shank is round, or hexagonal."""
        radii = self._trace_shank_m(candidate)
        radii = radii[np.isfinite(radii).all(axis=1)]
        if not len(radii):
            return bool(candidate.shape.bore_m)
        # A thread has its crest on each side.
        crest = np.percentile(radii, 80, axis=0)
        return float(crest.max() / crest.min()) <= 1 + _ROUND

    def _is_threaded(self, candidate: _Candidate) -> bool:
        """Return whether the radius of a shank goes up and down along it, as of a thread."""
        turning = []
        for column in self._trace_shank_m(candidate).T:
            kept = column[np.isfinite(column)]
            if len(kept) < _SAMPLES / 2:
                return False
            low, high = np.percentile(kept, [10, 90])
            above = kept > (low + high) / 2
            is_deep = high - low >= _DEPTH * candidate.shape.shank_m
            turning.append(is_deep and np.sum(above[1:] != above[:-1]) >= 2 * _TURNS)
        return float(np.mean(turning)) > 0.5

    def _trace_shank_m(self, candidate: _Candidate) -> Floats:
        """Return the radius of a shank at places along and angles around its axis."""
        shape = candidate.shape
        along = shape.low_m + (np.arange(_SAMPLES) + 0.5) / _SAMPLES * shape.shank_length_m
        mesh = RayMesh(candidate.part, shape.origin_m)
        return trace_outside_mm(mesh, along[:, None] * shape.axis * 1000, shape.axis) / 1000

    def _find_pressed_places(self, name: str, shape: TurnedShape) -> dict[str, float]:
        """Return the parts that a fastener lies flat on, with their places along its axis.

        Parts that lie on its head come after it.
        """
        places: dict[str, float] = {}
        for contact in self._contacts:
            if name in contact.parts and contact.points_m:
                sign = 1 if contact.parts[0] == name else -1
                dots = sign * (np.asarray(contact.normals).reshape(-1, 3) @ shape.axis)
                if (dots < -_FLAT).any():
                    along = (np.asarray(contact.points_m) - shape.origin_m) @ shape.axis
                    other = contact.parts[1 - contact.parts.index(name)]
                    places[other] = float(np.median(along))
        return places

    def _is_on(self, candidate: _Candidate, screw: Fastener, number: int) -> bool:
        """Return whether a screw passes through, or ends below, a ring on its axis."""
        shape = candidate.shape
        if not shape.is_on_axis(np.asarray(screw.axis), np.asarray(screw.point_m)):
            return False
        along = (self._product.parts[number].vertices_m - shape.origin_m) @ shape.axis
        return bool(along.min() <= shape.high_m + 1e-4 and along.max() >= shape.low_m - 1e-4)

    def _find_rod(self, candidate: _Candidate) -> str | None:
        """Return the round part in the bore of a nut that is on no screw, or None."""
        shape = candidate.shape
        along = shape.low_m + (np.arange(3) + 0.5) / 3 * shape.length_m
        points_m = shape.origin_m + along[:, None] * shape.axis
        for number in self._list_near(candidate.number, points_m, shape.bore_m):
            radii_m = self._measure_holes_m(number, points_m, shape.axis, shape.bore_m)
            rod = self._get_shape(number) if (radii_m == 0).any() else None
            if rod is None or not rod.is_on_axis(shape.axis, shape.origin_m):
                continue
            if 0.7 <= rod.shank_m / shape.bore_m <= 1.3:
                return self._product.parts[number].name
        return None

    def _find_lain_on(self, name: str, axis: Floats) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the parts on the flat side of a nut against an axis, and along it."""
        sides: tuple[set[str], set[str]] = (set(), set())
        for contact in self._contacts:
            if contact.kind in ("plane", "free") and name in contact.parts:
                sign = 1 if contact.parts[0] == name else -1
                other = contact.parts[1 - contact.parts.index(name)]
                for normal in contact.normals:
                    along = sign * float(np.dot(normal, axis))
                    if abs(along) > _FLAT:
                        sides[along > 0].add(other)
        return tuple(sorted(sides[0])), tuple(sorted(sides[1]))


def _attach_nuts(fastener: Fastener, fasteners: dict[int, Fastener]) -> Fastener:
    """Return a screw as threaded in its nuts instead of the parts that only guide it."""
    nuts = tuple(other.part for other in fasteners.values() if fastener.part in other.threaded_in)
    if fastener.kind != "screw" or not nuts:
        return fastener
    joins = (*(name for name in fastener.joins if name not in nuts), *nuts)
    return replace(fastener, threaded_in=nuts, joins=joins)


def _attach_joined_parts(fastener: Fastener, fasteners: dict[int, Fastener]) -> Fastener:
    """Return a nut that lies on nothing as holding the last part of its screw."""
    if fastener.kind != "nut" or len(fastener.joins) != 1:
        return fastener
    known = {other.part: other for other in fasteners.values()}
    screw = known.get(fastener.joins[0])
    parts: Collection[str] = [name for name in screw.joins if name not in known] if screw else []
    return replace(fastener, joins=(*fastener.joins, *list(parts)[-1:]))


def _vector(numbers: Floats) -> Vector:
    x, y, z = (float(number) + 0.0 for number in numbers)
    return x, y, z
