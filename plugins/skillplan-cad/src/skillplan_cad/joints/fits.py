"""Overlaps that CAD draws on purpose: press fits, threads, seals, teeth and sunk seats.

Sources: ISO 286-1:2010, tables 1 and 4 (standard tolerances and deviations of shafts zc);
ISO 261:1998 and ISO 68-1:1998 (coarse pitch and depth of metric threads);
ISO 3601-2 (squeeze of O-rings).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import NDArray

from skillplan.collision.contact_forces import find_axes_across
from skillplan_cad.joints.cylinder_fits import CylinderFit, find_cylinder_fits
from skillplan_cad.joints.fastener_names import is_gear_name, is_seal_name
from skillplan_cad.joints.turned_shape import describe_turned_shape
from skillplan_cad.product import Face, Part, Points, Product, Vector, make_solid, read_solid
from skillplan_cad.reading.surface_fit import fit_faces
from skillplan_cad.relation import Contact, Fastener, Fit, FitKind
from skillplan_cad.swept_space import list_corners, sweep_faces, unite

# Largest diameter of each step [mm]; fundamental deviation zc and tolerance IT6 of shafts [um].
_STEPS_MM = (
    *(3, 6, 10, 14, 18, 24, 30, 40, 50, 65, 80, 100, 120, 140, 160, 180, 200, 225, 250),
    *(280, 315, 355, 400, 450, 500),
)
_ZC_UM = (
    *(60, 80, 97, 130, 150, 188, 218, 274, 325, 405, 480, 585, 690, 800, 900, 1000, 1150, 1250),
    *(1350, 1550, 1700, 1900, 2100, 2400, 2600),
)
_IT6_UM = (
    *(6, 8, 9, 11, 11, 13, 13, 16, 16, 19, 19, 22, 22),
    *(25, 25, 25, 29, 29, 29, 32, 32, 36, 36, 40, 40),
)
# Largest diameter and coarse pitch of metric threads [mm]; depth of a thread, in pitches.
_THREADS_MM = (1, 1.2, 1.6, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 30, 36, 42, 48, 56, 64)
_PITCHES_MM = (
    *(0.25, 0.25, 0.35, 0.4, 0.45, 0.5, 0.7, 0.8, 1, 1.25, 1.5),
    *(1.75, 2, 2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6),
)
_THREAD_DEPTH = 0.6134
# Greatest depth of an overlap of a fastener with what it joins, in radii; of a hole that is not
# drawn, at least.
_SHARE, _NO_HOLE = 0.25, 0.8
# Largest squeeze of a seal, as a share of its section.
_SQUEEZE = 0.3
# Greatest overlap of a gear with its mate, as a share of the volume of the smaller one: teeth are
# turned at random in CAD.
_TEETH = 0.1
# Overlap that a press fit explains, as a share of its own volume.
_EXPLAINED = 1.25
# Greatest depth of a part that is drawn sunk in its seat: in metres, and as shares of its extent
# and of the overlap's width; greatest share of its volume. Halvings that measure the depth.
_SUNK_M, _SUNK, _SUNK_WIDTH, _SUNK_VOLUME = 1e-3, 0.1, 1 / 3, 0.1
_HALVINGS = 6
# Greatest overlap of a part that is squeezed into its place: in metres, and as shares of its least
# extent and of its volume. Least share of the overlap's surface that either part bounds with faces
# along the other's, and cosine of such faces.
_TIGHT_M, _TIGHT, _TIGHT_VOLUME = 1.5e-3, 1 / 8, 0.05
_TIGHT_SIDE, _ALONG = 0.3, 0.97
# Thickest pin whose hole is not drawn: in metres, and as a share of the part's middle extent. Least
# roundness of its section (1 for a circle, 0.5 for a rectangle of 4 to 1), share of its prism that
# is solid, and share of its sides that the part itself has. Greatest overlap, as a share of either
# part's volume, and share of the overlap that may be left once the holes are there.
_PIN_M, _PIN, _ROUND, _PRISM, _OWN_SIDES = 3e-3, 1 / 4, 0.5, 0.7, 0.9
_PIN_VOLUME, _PIN_REST = 1 / 4, 0.02
# Heights at which a pin is cut, and places on its way out at which it is compared, as shares;
# greatest cosine between a side and the pin.
_SLICES, _WAY, _SIDE = (0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99), (0, 0.05, 0.1, 0.25, 0.5, 0.75), 0.1
# Corners of a drilled hole.
_CORNERS = 48
# Smallest depth that is no rounding error, in metres and in radii.
_NOISE_M, _NOISE = 1e-6, 1e-4
# Places on the way of a part at which overlaps are compared.
_SHARES = (0.1, 0.25, 0.5)
# Volume below which a body is a film that a cut leaves [mm3].
_FILM_MM3 = 1e-6


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of fits.

    Parameters
    ----------
    allowance_m
        Greatest depth of an overlap that is a fit, on each side [m]; None for ISO 286.
    press_fits
        Pairs of names that are fits of any depth.
    """

    allowance_m: float | None = None
    press_fits: tuple[tuple[str, str], ...] = ()


def compute_allowance_m(diameter_m: float) -> float:
    """Return the greatest interference of ISO 286, a shaft zc6 in a hole H, on each side [m]."""
    step = min(bisect_left(_STEPS_MM, diameter_m * 1000 - 1e-6), len(_STEPS_MM) - 1)
    return (_ZC_UM[step] + _IT6_UM[step]) * 1e-6 / 2


def compute_thread_depth_m(diameter_m: float) -> float:
    """Return the depth of a coarse metric thread in a core hole [m]; 0 above 64 mm."""
    step = bisect_left(_THREADS_MM, diameter_m * 1000 - 1e-6)
    return _THREAD_DEPTH * _PITCHES_MM[step] * 1e-3 if step < len(_PITCHES_MM) else 0.0


def classify_overlaps(
    product: Product,
    contacts: Sequence[Contact],
    fits: Sequence[CylinderFit],
    fasteners: Sequence[Fastener],
    options: FitOptions,
    directions: Sequence[Vector] = (),
) -> tuple[Contact, ...]:
    """Return contacts whose overlaps are fits marked as such.

    Parameters
    ----------
    directions
        Unit vectors along which a part may be drawn sunk in its seat.
    """
    declared = {frozenset(pair) for pair in options.press_fits}
    joined = {
        frozenset((fastener.part, other)): fastener
        for fastener in fasteners
        for other in fastener.joins
    }
    classified = []
    for contact in contacts:
        first, second = (product.index(name) for name in contact.parts)
        own = [fit for fit in fits if {fit.inner, fit.outer} == {first, second}]
        overlap = _Overlap(
            contact,
            (product.parts[first], product.parts[second]),
            [fit for fit in own if _measure_depth_m(fit) > 0],
            joined.get(frozenset(contact.parts)),
            frozenset(contact.parts) in declared,
            directions,
        )
        classified.append(replace(contact, fit=overlap.classify(options)))
    return tuple(classified)


@dataclass(frozen=True, slots=True)
class _Overlap:
    """An overlap of two parts.

    Parameters
    ----------
    tight
        Shafts of one part in narrower holes of the other.
    fastener
        The fastener that one part is, if it joins the other.
    is_declared
        True if the user declares a fit.
    directions
        As for `classify_overlaps`.
    """

    contact: Contact
    parts: tuple[Part, Part]
    tight: Sequence[CylinderFit]
    fastener: Fastener | None
    is_declared: bool
    directions: Sequence[Vector]

    def classify(self, options: FitOptions) -> Fit | None:
        """Return the fit that the overlap is, or None."""
        depth_m, volume_m3, diameter_m, is_elsewhere = self._measure()
        if depth_m <= 0:
            return None
        radius_m = 0.0 if self.fastener is None else self.fastener.diameter_m / 2
        # A part inside another is as deep as the overlap is long.
        has_hole = bool(self.tight) or depth_m < _NO_HOLE * radius_m
        if self.contact.kind == "thread":
            kind: FitKind = "thread" if has_hole else "thread in solid"
            return Fit(kind, depth_m, depth_m, volume_m3)
        if self.is_declared:
            return Fit("press fit", depth_m, depth_m, volume_m3)
        if self.fastener is not None and not has_hole and self.fastener.kind in ("screw", "pin"):
            return Fit("no hole", depth_m, depth_m, volume_m3)
        if self._are_teeth():
            return Fit("teeth", depth_m, depth_m, volume_m3)
        if options.allowance_m is not None:
            limits: list[tuple[FitKind, float]] = [("overlap", options.allowance_m)]
        else:
            # Only the overlap of a shaft with its hole may be a thread.
            limits = self._list_limits(diameter_m)[: 1 if is_elsewhere else None]
        kinds = [(kind, limit_m) for kind, limit_m in limits if depth_m <= limit_m]
        if not kinds:
            if options.allowance_m is not None:
                return None
            return self._find_seat() or self._find_squeeze() or self._find_pins()
        kind, allowed_m = kinds[0]
        return Fit(
            "press fit" if kind == "overlap" and self.tight else kind, depth_m, allowed_m, volume_m3
        )

    def _find_seat(self) -> Fit | None:
        """Return the fit of a part that is drawn a little sunk in its seat, or None.

        The smaller part then leaves the larger one by a short straight move.
        """
        smaller, larger = sorted(self.parts, key=lambda part: part.volume_m3)
        volume_m3 = self.contact.overlap_m3
        if self.tight or volume_m3 > _SUNK_VOLUME * smaller.volume_m3:
            return None
        solid, seat = (make_solid(part.vertices_m, part.triangles) for part in (smaller, larger))
        allowed_mm3 = self.contact.overlap_allowed_m3 * 1e9

        def is_free(vector: Points, distance_m: float) -> bool:
            moved = solid.translate([float(value) * distance_m * 1e3 for value in vector])
            return float((moved ^ seat).volume()) <= allowed_mm3

        normals = [sign * np.asarray(normal) for normal in self.contact.normals for sign in (1, -1)]
        depths = []
        for vector in (*map(np.asarray, self.directions), *normals):
            extent_m = float(np.ptp(smaller.vertices_m @ vector))
            shares = (_SUNK * extent_m, _SUNK_WIDTH * self.contact.overlap_section_m)
            limit_m = min(_SUNK_M, *shares)
            if not is_free(vector, limit_m):
                continue
            low_m, high_m = 0.0, limit_m
            for _ in range(_HALVINGS):
                middle_m = (low_m + high_m) / 2
                free = is_free(vector, middle_m)
                low_m, high_m = (low_m, middle_m) if free else (middle_m, high_m)
            depths.append((high_m, limit_m))
        return Fit("sunk", *min(depths), volume_m3) if depths else None

    def _find_squeeze(self) -> Fit | None:
        """Return the fit of a part that is drawn a little too large for its place, or None.

        The overlap is then thin, with a face of either part on each side.
        """
        smaller, larger = sorted(self.parts, key=lambda part: part.volume_m3)
        depth_m = self.contact.overlap_thickness_m
        extent_m = float(np.ptp(smaller.vertices_m, axis=0).min())
        limit_m = min(_TIGHT_M, _TIGHT * extent_m, _SUNK_WIDTH * self.contact.overlap_section_m)
        is_large = self.contact.overlap_m3 > _TIGHT_VOLUME * smaller.volume_m3
        if self.tight or is_large or depth_m > limit_m:
            return None
        solids = [
            make_solid(part.vertices_m, part.triangles).as_original() for part in (smaller, larger)
        ]
        normals, areas_mm2, owners = _list_faces(solids[0] ^ solids[1])
        faces = [
            (normals[owners == solid.original_id()], areas_mm2[owners == solid.original_id()])
            for solid in solids
        ]
        along_mm2 = [_measure_along(*own, *other) for own, other in (faces, faces[::-1])]
        if min(along_mm2) < _TIGHT_SIDE * float(areas_mm2.sum()):
            return None
        return Fit("squeezed", depth_m, limit_m, self.contact.overlap_m3)

    def _find_pins(self) -> Fit | None:
        """Return the fit of thin pins of one part whose holes are not drawn, or None."""
        if self.tight or drill_pins(self.parts, self.contact, self.directions) is None:
            return None
        depth_m = self.contact.overlap_depth_m
        return Fit("pins in solid", depth_m, depth_m, self.contact.overlap_m3)

    def _are_teeth(self) -> bool:
        """Return whether a gear overlaps its mate by no more than its teeth can."""
        smaller_m3 = min(part.volume_m3 for part in self.parts)
        has_gear = any(is_gear_name(part.name, part.design) for part in self.parts)
        return has_gear and not self.tight and self.contact.overlap_m3 <= _TEETH * smaller_m3

    def _measure(self) -> tuple[float, float, float, bool]:
        """Return depth, volume and diameter, and whether parts overlap outside of their hole."""
        contact = self.contact
        section_m = self._measure_section_m()
        is_deep = contact.overlap_m3 > contact.overlap_allowed_m3
        if not self.tight:
            depth_m = contact.overlap_depth_m if is_deep else 0.0
            return depth_m, contact.overlap_m3, min(section_m, contact.overlap_section_m), False
        deepest = max(self.tight, key=_measure_depth_m)
        depth_m = _measure_depth_m(deepest)
        volume_m3 = sum(_measure_volume_m3(fit) for fit in self.tight)
        explained_m3 = _EXPLAINED * volume_m3 + contact.overlap_allowed_m3
        is_elsewhere = contact.overlap_m3 > explained_m3 and contact.kind != "thread"
        if is_elsewhere:
            depth_m = max(depth_m, contact.overlap_depth_m)
        return depth_m, volume_m3, 2 * deepest.hole.radius_m, is_elsewhere

    def _measure_section_m(self) -> float:
        smaller = min(self.parts, key=lambda part: part.volume_m3)
        return float(np.min(smaller.bounds_m[1] - smaller.bounds_m[0]))

    def _list_limits(self, diameter_m: float) -> list[tuple[FitKind, float]]:
        """Return the kinds of fits in question with their greatest depths [m]."""
        allowed_m = compute_allowance_m(diameter_m)
        limits: list[tuple[FitKind, float]] = [("overlap", allowed_m)]
        if any(is_seal_name(part.name) for part in self.parts):
            limits = [("seal", max(allowed_m, _SQUEEZE * self._measure_section_m()))]
        if self.fastener is not None:
            limits.append(("overlap", _SHARE * self.fastener.diameter_m / 2))
        if self.tight:
            limits.append(("thread", compute_thread_depth_m(diameter_m)))
        return limits


def drill_pins(
    parts: tuple[Part, Part], contact: Contact, directions: Sequence[Vector]
) -> Part | None:
    """Return one of two parts with holes for the pins that the other has drawn into it, or None.

    All of the overlap is thin pins along one direction, along which the other part comes straight
    off once the holes are there. That part may be a little sunk, too.
    """
    if contact.overlap_m3 > _PIN_VOLUME * min(part.volume_m3 for part in parts):
        return None
    solids = [make_solid(part.vertices_m, part.triangles).as_original() for part in parts]
    shared = solids[0] ^ solids[1]
    normals, areas_mm2, owners = _list_faces(shared)
    allowed_mm3 = contact.overlap_allowed_m3 * 1e9 + _PIN_REST * float(shared.volume())
    for pinned in (0, 1):
        is_own = owners == solids[pinned].original_id()
        middle_m = float(np.median(np.ptp(parts[pinned].vertices_m, axis=0)))
        limit_mm = 1e3 * min(_PIN_M, _PIN * middle_m)
        for direction in directions:
            frame = _build_frame(np.asarray(direction))
            is_side = np.abs(normals @ frame[2]) < _SIDE * areas_mm2
            own_mm2, all_mm2 = (
                float(areas_mm2[mask].sum()) for mask in (is_side & is_own, is_side)
            )
            if own_mm2 == 0 or own_mm2 < _OWN_SIDES * all_mm2:
                continue
            upright = np.column_stack([frame, np.zeros(3)])
            outlines = _find_pins(shared.transform(upright), limit_mm)
            if outlines is None:
                continue
            mover, drilled = (solids[number].transform(upright) for number in (pinned, 1 - pinned))
            top_mm = drilled.bounding_box()[5] + 1
            for outline, low_mm in outlines:
                drilled -= outline.extrude(top_mm - low_mm).translate((0, 0, low_mm))
            way_mm = top_mm - mover.bounding_box()[2]
            moved = (mover.translate((0, 0, share * way_mm)) for share in _WAY)
            if all(float((there ^ drilled).volume()) <= allowed_mm3 for there in moved):
                return _replace_solid(parts[1 - pinned], drilled, frame, np.zeros(3))
    return None


def _find_pins(shared: Any, limit_mm: float) -> list[tuple[Any, float]] | None:
    """Return the outlines and lower ends of thin pins and shallow seats, or None for others.

    Parameters
    ----------
    shared
        The overlap, with the pins upright.
    limit_mm
        Greatest thickness of a pin.
    """
    *_, low_mm, _, _, high_mm = shared.bounding_box()
    heights_mm = low_mm + (high_mm - low_mm) * np.asarray(_SLICES)
    # Faces that coincide join the pins by films, in none of the slices.
    slices = [shared.slice(height_mm) for height_mm in heights_mm.tolist()]
    whole = manifold3d.CrossSection.batch_boolean(slices, manifold3d.OpType.Add)
    outlines, has_pin = [], False
    for outline in whole.decompose():
        column = outline.extrude(high_mm - low_mm).translate((0, 0, low_mm))
        body = shared ^ column
        *_, start_mm, _, _, end_mm = body.bounding_box()
        outlines.append((outline, start_mm))
        area_mm2, width_mm = _measure_section(outline)
        height_mm = end_mm - start_mm
        is_prism = float(body.volume()) >= _PRISM * area_mm2 * height_mm
        if is_prism and width_mm <= min(limit_mm, height_mm):
            has_pin = True
        elif height_mm > _SUNK_M * 1e3:
            return None
    return outlines if has_pin else None


def _measure_section(section: Any) -> tuple[float, float]:
    """Return the area [mm2] of a section and how thick it is [mm]; infinite for a fin."""
    rings = [np.asarray(ring) for ring in section.to_polygons()]
    ring_mm = sum(
        float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum()) for ring in rings
    )
    area_mm2 = float(section.area())
    is_fin = 4 * np.pi * area_mm2 <= _ROUND * ring_mm**2
    return area_mm2, np.inf if is_fin else 4 * area_mm2 / ring_mm


def _list_faces(shared: Any) -> tuple[Points, Points, NDArray[np.int64]]:
    """Return normals and areas of an overlap's triangles, and the ids of the solids they are from.

    Normals are as long as the areas [mm2].
    """
    mesh = shared.to_mesh64()
    points, triangles = read_solid(shared)
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    owners = np.repeat(mesh.run_original_id, np.diff(mesh.run_index) // 3).astype(np.int64)
    return normals, np.linalg.norm(normals, axis=1), owners


def _measure_along(normals: Points, areas_mm2: Points, others: Points, others_mm2: Points) -> float:
    """Return the area of the faces of one part that face a face of another [mm2].

    Parameters
    ----------
    normals, others
        Normals of the triangles of either part, as long as their areas.
    """
    if not len(areas_mm2) or not len(others_mm2):
        return 0.0
    lines = others[others_mm2 > 0] / others_mm2[others_mm2 > 0, None]
    lines = np.unique(np.round(lines, 2), axis=0)
    facing = (normals @ lines.T).min(axis=1) < -_ALONG * areas_mm2
    return float(areas_mm2[facing].sum())


def _measure_depth_m(fit: CylinderFit) -> float:
    """Return the interference of a shaft in a hole, on each side [m]; 0 for rounding errors."""
    depth_m = -fit.radius_difference_m
    return depth_m if depth_m > max(_NOISE_M, _NOISE * fit.shaft.radius_m) else 0.0


def _measure_volume_m3(fit: CylinderFit) -> float:
    ring_m2 = np.pi * (fit.shaft.radius_m**2 - fit.hole.radius_m**2)
    turn = min(fit.shaft.turn_rad, fit.hole.turn_rad) / (2 * np.pi) or 1.0
    return float(ring_m2 * fit.length_m * turn)


def relieve_fits(
    product: Product,
    contacts: Sequence[Contact],
    fasteners: Sequence[Fastener],
    tolerance_m: float,
    play_m: float = 0.0,
    directions: Sequence[Vector] = (),
) -> Product:
    """Return a product whose fits touch instead of overlapping.

    A shaft gets the size of its hole; a hole that is not drawn is drilled; of other pairs the
    smaller part loses the overlap, and if it is pressed, whatever would not pass on its way.

    Parameters
    ----------
    tolerance_m
        Overlaps of flat faces below half of it stay as drawn [m].
    play_m
        Play between a shaft and its hole, on each side [m].
    directions
        Unit vectors along which a pressed part may leave.
    """
    parts = list(product.parts)
    pressed = [contact for contact in contacts if contact.fit and contact.kind != "thread"]
    if not pressed:
        return product
    fits = find_cylinder_fits(product)
    for contact in pressed:
        numbers = [product.index(name) for name in contact.parts]
        tight = [
            fit
            for fit in fits
            if {fit.inner, fit.outer} == set(numbers) and _measure_depth_m(fit) > 0
        ]
        for fit in tight:
            parts[fit.inner] = _turn_down(parts[fit.inner], fit, play_m)
        deep = contact.fit is not None and contact.fit.depth_m > tolerance_m / 2
        kind = contact.fit.kind if contact.fit is not None else None
        if kind == "pins in solid":
            first, second = (parts[number] for number in numbers)
            block = drill_pins((first, second), contact, directions)
            if block is not None:
                parts[product.index(block.name)] = block
        elif not tight and deep:
            smaller, larger = sorted(numbers, key=lambda number: parts[number].volume_m3)
            line = _find_line(contact, parts[smaller], fasteners)
            if line is None:
                ways = directions if kind in ("press fit", "squeezed") else ()
                thinned = _cut_away(parts[smaller], parts[larger], ways)
                if kind == "squeezed" and not _gives_way(parts[smaller], thinned, contact):
                    thinned = _cut_away(parts[smaller], parts[larger], ())
                parts[smaller] = thinned
            else:
                own = product.index(line.part)
                other = smaller if own == larger else larger
                parts[other] = _drill(parts[other], parts[own], line, play_m)
    return replace(product, parts=tuple(parts))


def _find_line(contact: Contact, smaller: Part, fasteners: Sequence[Fastener]) -> Fastener | None:
    """Return the fastener whose hole is missing, or None if the overlap is of another kind.

    Of a declared fit, the smaller part counts as a pin if it is round.
    """
    assert contact.fit is not None
    if contact.fit.kind == "no hole":
        return next(
            fastener
            for fastener in fasteners
            if fastener.part in contact.parts and set(contact.parts) & set(fastener.joins)
        )
    shape = describe_turned_shape(smaller) if contact.fit.kind == "press fit" else None
    if shape is None or contact.fit.depth_m < _NO_HOLE * shape.shank_m:
        return None
    return Fastener(
        smaller.name,
        "pin",
        _vector(shape.axis),
        _vector(shape.origin_m),
        2 * shape.shank_m,
        shape.length_m,
        (),
        (),
        ("option",),
    )


def _vector(numbers: Points) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return x, y, z


def _drill(part: Part, fastener: Part, line: Fastener, play_m: float) -> Part:
    """Return a part with the hole that a fastener in it needs, open towards the nearer side.

    A screw's hole opens towards its head.
    """
    frame = _build_frame(np.asarray(line.axis))
    origin = np.asarray(line.point_m)
    solids = [
        make_solid((item.vertices_m - origin) @ frame.T, item.triangles)
        for item in (part, fastener)
    ]
    shared = solids[0] ^ solids[1]
    if shared.is_empty():
        return part
    points = np.asarray(shared.to_mesh64().vert_properties, dtype=np.float64)[:, :3]
    wide_mm = float(np.linalg.norm(points[:, :2], axis=1).max()) + play_m * 1000
    # Corners of the polygon are outside of the circle.
    wide_mm /= np.cos(np.pi / _CORNERS)
    box = solids[0].bounding_box()
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    holes = [
        manifold3d.Manifold.cylinder(end - start, wide_mm, wide_mm, _CORNERS).translate(
            (0, 0, start)
        )
        for start, end in ((low, box[5] + 1), (box[2] - 1, high))
    ]
    if line.kind == "pin":
        holes.sort(key=lambda hole: float((solids[0] ^ hole).volume()))
    return _replace_solid(part, solids[0] - holes[0], frame, origin)


def _build_frame(axis: Points) -> Points:
    """Return two directions across an axis and the axis, one per row."""
    x, y, z = axis.tolist()
    return np.vstack([find_axes_across((x, y, z)), axis])


def _replace_solid(part: Part, solid: Any, frame: Points, origin_m: Points) -> Part:
    """Return a part with the shape of a solid in millimetres, without films that a cut leaves."""
    bodies = solid.decompose()
    whole = [body for body in bodies if abs(body.volume()) >= _FILM_MM3]
    kept = whole if len(whole) < len(bodies) else [solid]
    points, corners = zip(*map(read_solid, kept), strict=True)
    starts = np.cumsum([0, *(len(own) for own in points[:-1])])
    vertices = np.concatenate(points) / 1000 @ frame + origin_m
    triangles = np.concatenate([own + start for own, start in zip(corners, starts, strict=True)])
    faces = fit_faces(vertices, triangles)
    return replace(part, vertices_m=vertices, triangles=triangles, faces=faces)


def _turn_down(part: Part, fit: CylinderFit, play_m: float) -> Part:
    """Return a part whose shaft has the radius of its hole, less the play."""
    axis, origin = np.asarray(fit.shaft.axis), np.asarray(fit.shaft.origin_m)
    radius_m = fit.hole.radius_m - play_m
    vertices = part.vertices_m.copy()
    faces: list[Face] = []
    for face in part.faces:
        is_shaft = (
            face.kind == "cylinder"
            and not face.hollow
            and abs(face.radius_m - fit.shaft.radius_m) <= _NOISE_M
            and _is_on_axis(np.asarray([face.origin_m]), origin, axis)
        )
        if is_shaft:
            own = np.unique(part.triangles[face.triangles])
            offsets = vertices[own] - origin
            across = offsets - (offsets @ axis)[:, None] * axis
            length = np.linalg.norm(across, axis=1)
            share = np.minimum(1.0, radius_m / np.where(length > 0, length, 1.0))
            vertices[own] -= across * (1 - share)[:, None]
            face = replace(face, radius_m=min(face.radius_m, radius_m))
        faces.append(face)
    return replace(part, vertices_m=vertices, faces=tuple(faces))


def _is_on_axis(points: Points, origin: Points, axis: Points) -> bool:
    offsets = points - origin
    across = offsets - (offsets @ axis)[:, None] * axis
    return bool(np.abs(across).max() < 1e-6)


def _gives_way(part: Part, thinned: Part, contact: Contact) -> bool:
    """Return whether a cut takes at most twice the overlap, as where a snap bends."""
    whole, left = (make_solid(p.vertices_m, p.triangles).volume() for p in (part, thinned))
    return bool(whole - left <= 2 * contact.overlap_m3 * 1e9)


def _cut_away(part: Part, other: Part, directions: Sequence[Vector]) -> Part:
    """Return a part without its overlap with another; as drawn if nothing whole would be left.

    Parameters
    ----------
    directions
        Unit vectors: the part also passes the other on its way along one of them, the one along
        which they overlap least.
    """
    solid, mate = (make_solid(item.vertices_m, item.triangles) for item in (part, other))
    room = np.reshape(solid.bounding_box(), (1, 2, 3))
    sizes_mm = np.ptp(room[0], axis=0)
    ways = [float(sizes_mm @ np.abs(vector)) * np.asarray(vector) for vector in directions]
    met_mm3 = [
        sum(float((solid.translate((share * way).tolist()) ^ mate).volume()) for share in _SHARES)
        for way in ways
    ]
    if ways:
        along = np.asarray(directions[int(np.argmin(np.round(met_mm3, 6)))])
        mate += unite(sweep_faces(list_corners(mate), along, 0.0, room, is_convex=False))
    rest = solid - mate
    if rest.is_empty() or rest.volume() < 0.5 * solid.volume():
        return part
    return _replace_solid(part, rest, np.eye(3), np.zeros(3))
