"""The contacts of a product: what touches, as what, and by how much it overlaps."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from skillplan_cad.blocking.all_pairs import BlockingTest
from skillplan_cad.blocking.ray_mesh import Floats
from skillplan_cad.contacts import Contact, ContactKind
from skillplan_cad.joints.cylinder_fits import CylinderFit
from skillplan_cad.joints.overlaps import Overlaps
from skillplan_cad.joints.touching import Touch, TouchTest
from skillplan_cad.product import Product, Vector

# A contact is flat where this share of its area is.
_FLAT_SHARE = 0.5


def contacts_of(
    product: Product, test: BlockingTest, fits: Sequence[CylinderFit], tolerance_m: float
) -> tuple[Contact, ...]:
    """Return the contacts of a product.

    Parameters
    ----------
    product
        The product.
    test
        Its parts as rays see them.
    fits
        Cylinders in holes.
    tolerance_m
        How far apart surfaces may be that touch.
    """
    touching = TouchTest(product, test.meshes, test.middle_m, max(tolerance_m, 2 * product.chord_m))
    overlaps = Overlaps(product)
    by_pair: dict[tuple[int, int], list[CylinderFit]] = defaultdict(list)
    for fit in fits:
        by_pair[min(fit.inner, fit.outer), max(fit.inner, fit.outer)].append(fit)
    found = []
    for first, second in touching.near():
        touch = touching.touch(first, second)
        shared = overlaps.between(first, second)
        inside = [
            fit
            for fit in by_pair.get((first, second), ())
            if fit.radius_difference_m <= max(tolerance_m, 0.05 * fit.shaft.radius_m)
        ]
        if touch is None and shared is None and not inside:
            continue
        found.append(_contact(product, (first, second), touch, shared, inside, test.middle_m))
    return tuple(found)


def _contact(
    product: Product,
    pair: tuple[int, int],
    touch: Touch | None,
    shared: tuple[float, float, Floats] | None,
    fits: Sequence[CylinderFit],
    middle_m: Floats,
) -> Contact:
    kind: ContactKind = "free"
    fit = max(fits, key=lambda one: one.length_m * one.shaft.radius_m, default=None)
    if fit is not None:
        kind = "cylinder"
    elif touch is not None and touch.flat_share >= _FLAT_SHARE:
        kind = "plane"
    volume, surface, place = shared if shared is not None else (0.0, 0.0, None)
    return Contact(
        parts=(product.parts[pair[0]].name, product.parts[pair[1]].name),
        kind=kind,
        area_m2=touch.area_mm2 / 1e6 if touch is not None else 0.0,
        normals=tuple(_vector(one) for one in touch.normals) if touch is not None else (),
        axis=fit.shaft.axis if fit is not None else None,
        axis_point_m=_middle_of(fit) if fit is not None else None,
        radius_m=fit.shaft.radius_m if fit is not None else None,
        radius_difference_m=fit.radius_difference_m if fit is not None else None,
        points_m=()
        if touch is None
        else tuple(_vector(one) for one in touch.points_mm / 1000 + middle_m),
        overlap_m3=volume / 1e9,
        overlap_surface_m2=surface / 1e6,
        # Both sides of the overlap may each be off by a chord.
        overlap_allowed_m3=surface / 2 / 1e6 * 2 * product.chord_m,
        overlap_point_m=None if place is None else _vector(place / 1000),
    )


def _middle_of(fit: CylinderFit) -> Vector:
    along = sum(fit.shared_m) / 2
    return _vector(np.asarray(fit.shaft.origin_m) + along * np.asarray(fit.shaft.axis))


def _vector(numbers: Floats) -> Vector:
    x, y, z = (float(one) for one in numbers)
    return x, y, z
