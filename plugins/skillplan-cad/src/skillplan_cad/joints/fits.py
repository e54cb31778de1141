"""Overlaps that CAD draws on purpose: press fits, threads and seals, up to an allowance.

Sources: ISO 286-1:2010, tables 1 and 4 (standard tolerances and deviations of shafts zc);
ISO 3601-2 (squeeze of O-rings).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillplan_cad.joints.cylinder_fits import CylinderFit, find_cylinder_fits
from skillplan_cad.joints.fastener_names import is_seal_name
from skillplan_cad.product import Face, Part, Points, Product, make_solid
from skillplan_cad.reading.surface_fit import fit_faces
from skillplan_cad.relation import Contact, Fit, FitKind

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
    6,
    8,
    9,
    11,
    11,
    13,
    13,
    16,
    16,
    19,
    19,
    22,
    22,
    *(25,) * 3,
    *(29,) * 3,
    32,
    32,
    36,
    36,
    40,
    40,
)
# Largest squeeze of a seal, as a share of its section.
_SQUEEZE = 0.3
# Overlap that a press fit explains, as a share of its own volume.
_EXPLAINED = 1.25
# Smallest depth that is no rounding error, in metres and in radii.
_NOISE_M, _NOISE = 1e-6, 1e-4


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


def classify_overlaps(
    product: Product, contacts: Sequence[Contact], fits: Sequence[CylinderFit], options: FitOptions
) -> tuple[Contact, ...]:
    """Return contacts whose overlaps are fits marked as such."""
    declared = {frozenset(pair) for pair in options.press_fits}
    classified = []
    for contact in contacts:
        first, second = (product.index(name) for name in contact.parts)
        own = [fit for fit in fits if {fit.inner, fit.outer} == {first, second}]
        pair = (product.parts[first], product.parts[second])
        fit = _find_fit(contact, pair, own, options, frozenset(contact.parts) in declared)
        classified.append(replace(contact, fit=fit))
    return tuple(classified)


def _find_fit(
    contact: Contact,
    parts: tuple[Part, Part],
    fits: Sequence[CylinderFit],
    options: FitOptions,
    is_declared: bool,
) -> Fit | None:
    """Return the fit that a contact's overlap is, or None."""
    tight = [fit for fit in fits if _measure_depth_m(fit) > 0]
    smaller = min(parts, key=lambda part: part.volume_m3)
    section_m = float(np.min(smaller.bounds_m[1] - smaller.bounds_m[0]))
    depth_m, volume_m3, diameter_m = 0.0, contact.overlap_m3, section_m
    kind: FitKind = "overlap"
    if tight:
        deepest = max(tight, key=_measure_depth_m)
        depth_m, diameter_m = _measure_depth_m(deepest), 2 * deepest.hole.radius_m
        volume_m3 = sum(_measure_volume_m3(fit) for fit in tight)
        kind = "press fit"
        explained_m3 = _EXPLAINED * volume_m3 + contact.overlap_allowed_m3
        if contact.overlap_m3 > explained_m3 and contact.kind != "thread":
            # The parts overlap elsewhere, too.
            depth_m = max(depth_m, contact.overlap_depth_m)
    elif contact.overlap_m3 > contact.overlap_allowed_m3:
        depth_m = contact.overlap_depth_m
        diameter_m = min(section_m, contact.overlap_section_m)
    if depth_m <= 0:
        return None
    allowed_m = options.allowance_m
    if allowed_m is None:
        allowed_m = compute_allowance_m(diameter_m)
        if any(is_seal_name(part.name) for part in parts):
            kind, allowed_m = "seal", max(allowed_m, _SQUEEZE * section_m)
    if contact.kind == "thread":
        return Fit("thread", depth_m, depth_m, volume_m3)
    if is_declared:
        return Fit("press fit", depth_m, depth_m, volume_m3)
    return Fit(kind, depth_m, allowed_m, volume_m3) if depth_m <= allowed_m else None


def _measure_depth_m(fit: CylinderFit) -> float:
    """Return the interference of a shaft in a hole, on each side [m]; 0 for rounding errors."""
    depth_m = -fit.radius_difference_m
    return depth_m if depth_m > max(_NOISE_M, _NOISE * fit.shaft.radius_m) else 0.0


def _measure_volume_m3(fit: CylinderFit) -> float:
    ring_m2 = np.pi * (fit.shaft.radius_m**2 - fit.hole.radius_m**2)
    turn = min(fit.shaft.turn_rad, fit.hole.turn_rad) / (2 * np.pi) or 1.0
    return float(ring_m2 * fit.length_m * turn)


def relieve_fits(
    product: Product, contacts: Sequence[Contact], tolerance_m: float, play_m: float = 0.0
) -> Product:
    """Return a product whose fits touch instead of overlapping.

    A shaft gets the size of its hole; of other pairs the smaller part loses the overlap.

    Parameters
    ----------
    tolerance_m
        Overlaps of flat faces below half of it stay as drawn [m].
    play_m
        Play between a shaft and its hole, on each side [m].
    """
    parts = list(product.parts)
    pressed = [contact for contact in contacts if contact.fit and contact.fit.kind != "thread"]
    if not pressed:
        return product
    fits = find_cylinder_fits(product)
    for contact in pressed:
        numbers = {product.index(name) for name in contact.parts}
        tight = [
            fit for fit in fits if {fit.inner, fit.outer} == numbers and _measure_depth_m(fit) > 0
        ]
        for fit in tight:
            parts[fit.inner] = _turn_down(parts[fit.inner], fit, play_m)
        deep = contact.fit is not None and contact.fit.depth_m > tolerance_m / 2
        if not tight and deep:
            first, second = sorted(numbers, key=lambda number: parts[number].volume_m3)
            parts[first] = _cut_away(parts[first], parts[second])
    return replace(product, parts=tuple(parts))


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


def _cut_away(part: Part, other: Part) -> Part:
    """Return a part without its overlap with another; as drawn if nothing whole would be left."""
    solids = [make_solid(item.vertices_m, item.triangles) for item in (part, other)]
    rest = solids[0] - solids[1]
    if rest.is_empty() or rest.volume() < 0.5 * solids[0].volume():
        return part
    mesh = rest.to_mesh64()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3] / 1000
    triangles = np.asarray(mesh.tri_verts, dtype=np.int64)
    return replace(
        part,
        vertices_m=vertices,
        triangles=triangles,
        faces=fit_faces(vertices, triangles),
    )
