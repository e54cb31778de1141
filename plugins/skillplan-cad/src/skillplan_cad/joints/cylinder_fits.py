"""Find cylinders that fit into holes of other parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skillplan_cad.product import Face, Part, Product

# Largest angle between coincident axes [rad]; largest clearance of a hole, in radii and in metres;
# largest interference, as of a tapped hole's core or a press fit, in radii.
_PARALLEL_RAD, _WIDER, _WIDER_M, _NARROWER = 0.01, 0.2, 1e-3, 0.25


@dataclass(frozen=True, slots=True)
class CylinderFit:
    """A cylinder of one part in a hole of another.

    Parameters
    ----------
    inner, outer
        Numbers of the parts with the cylinder and with the hole.
    shared_m
        Interval of the shaft's axis covered by both, from the shaft's origin.
    """

    inner: int
    outer: int
    shaft: Face
    hole: Face
    shared_m: tuple[float, float]

    @property
    def radius_difference_m(self) -> float:
        """Radius of the hole minus that of the shaft."""
        return self.hole.radius_m - self.shaft.radius_m

    @property
    def length_m(self) -> float:
        """Length of the shared interval."""
        return self.shared_m[1] - self.shared_m[0]


def find_cylinder_fits(product: Product) -> list[CylinderFit]:
    """Return all cylinders in holes of other parts, in the order of the parts."""
    shafts = [_list_cylinders(part, hollow=False) for part in product.parts]
    holes = [_list_cylinders(part, hollow=True) for part in product.parts]
    fits = []
    for inner, own in enumerate(shafts):
        for outer, others in enumerate(holes):
            if inner == outer:
                continue
            for shaft in own:
                for hole in others:
                    shared = _find_shared_m(shaft, hole)
                    if shared is not None:
                        fits.append(CylinderFit(inner, outer, shaft, hole, shared))
    return fits


def _list_cylinders(part: Part, *, hollow: bool) -> list[Face]:
    """Return the cylinders of a part; the halves that CAD splits count once."""
    cylinders: list[Face] = []
    for face in part.faces:
        if face.kind != "cylinder" or face.hollow != hollow or face.radius_m <= 0:
            continue
        if not any(_is_same(face, other) for other in cylinders):
            cylinders.append(face)
    return cylinders


def _is_same(first: Face, second: Face) -> bool:
    return (
        first.radius_m == second.radius_m
        and abs(np.dot(first.axis, second.axis)) > 1 - 1e-9
        and _measure_offset_m(first, second) < 1e-7
        and np.allclose(sorted(_find_interval_m(first, second)), first.extent_m, atol=1e-7)
    )


def _find_shared_m(shaft: Face, hole: Face) -> tuple[float, float] | None:
    """Return the interval of the axis on which a shaft is in a hole, or None."""
    difference = hole.radius_m - shaft.radius_m
    if not -_NARROWER * shaft.radius_m <= difference <= max(_WIDER * shaft.radius_m, _WIDER_M):
        return None
    (a, b, c), (x, y, z) = shaft.axis, hole.axis
    if math.hypot(b * z - c * y, c * x - a * z, a * y - b * x) > _PARALLEL_RAD:
        return None
    if _measure_offset_m(shaft, hole) > max(abs(difference), 0.02 * shaft.radius_m):
        return None
    low, high = sorted(_find_interval_m(shaft, hole))
    low, high = max(low, shaft.extent_m[0]), min(high, shaft.extent_m[1])
    return (low, high) if high - low > 0.05 * shaft.radius_m else None


def _measure_offset_m(first: Face, second: Face) -> float:
    offset = np.subtract(second.origin_m, first.origin_m)
    return float(np.linalg.norm(offset - (offset @ first.axis) * np.asarray(first.axis)))


def _find_interval_m(first: Face, second: Face) -> tuple[float, float]:
    """Return the interval of the second face along the axis of the first."""
    start = float(np.subtract(second.origin_m, first.origin_m) @ np.asarray(first.axis))
    sign = float(np.sign(np.dot(first.axis, second.axis)))
    return start + sign * second.extent_m[0], start + sign * second.extent_m[1]
