"""Cylinders that stand in cylinders of other parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillplan_cad.product import Face, Part, Product

# Axes of one line differ by less than this [rad]; a hole is wider by this share of its radius or
# by this length, and narrower, as a tapped hole's core or a press fit, by that share.
_PARALLEL_RAD, _WIDER, _WIDER_M, _NARROWER = 0.01, 0.2, 1e-3, 0.25


@dataclass(frozen=True, slots=True)
class CylinderFit:
    """A cylinder of one part in a hole of another.

    Parameters
    ----------
    inner, outer
        Numbers of the part with the cylinder and of the one with the hole.
    shaft, hole
        The faces.
    shared_m
        Stretch of the shaft's axis that both have, from the shaft's origin on.
    """

    inner: int
    outer: int
    shaft: Face
    hole: Face
    shared_m: tuple[float, float]

    @property
    def radius_difference_m(self) -> float:
        """The hole's radius minus the shaft's."""
        return self.hole.radius_m - self.shaft.radius_m

    @property
    def length_m(self) -> float:
        """How long the stretch is."""
        return self.shared_m[1] - self.shared_m[0]


def cylinder_fits(product: Product) -> list[CylinderFit]:
    """Return all cylinders in holes of other parts, in the order of the parts."""
    shafts = [_cylinders(part, hollow=False) for part in product.parts]
    holes = [_cylinders(part, hollow=True) for part in product.parts]
    found = []
    for inner, own in enumerate(shafts):
        for outer, others in enumerate(holes):
            if inner == outer:
                continue
            for shaft in own:
                for hole in others:
                    shared = _shared_m(shaft, hole)
                    if shared is not None:
                        found.append(CylinderFit(inner, outer, shaft, hole, shared))
    return found


def _cylinders(part: Part, *, hollow: bool) -> list[Face]:
    """Return the cylinders of a part; halves of one, as CAD splits them, are one."""
    found: list[Face] = []
    for face in part.faces:
        if face.kind != "cylinder" or face.hollow != hollow or face.radius_m <= 0:
            continue
        if not any(_same(face, other) for other in found):
            found.append(face)
    return found


def _same(first: Face, second: Face) -> bool:
    return (
        first.radius_m == second.radius_m
        and abs(np.dot(first.axis, second.axis)) > 1 - 1e-9
        and _offset_m(first, second) < 1e-7
        and np.allclose(sorted(_stretch_m(first, second)), first.extent_m, atol=1e-7)
    )


def _shared_m(shaft: Face, hole: Face) -> tuple[float, float] | None:
    """Return the stretch of the axis on which a shaft stands in a hole, or None."""
    if np.linalg.norm(np.cross(shaft.axis, hole.axis)) > _PARALLEL_RAD:
        return None
    difference = hole.radius_m - shaft.radius_m
    if not -_NARROWER * shaft.radius_m <= difference <= max(_WIDER * shaft.radius_m, _WIDER_M):
        return None
    if _offset_m(shaft, hole) > max(abs(difference), 0.02 * shaft.radius_m):
        return None
    low, high = sorted(_stretch_m(shaft, hole))
    low, high = max(low, shaft.extent_m[0]), min(high, shaft.extent_m[1])
    return (low, high) if high - low > 0.05 * shaft.radius_m else None


def _offset_m(first: Face, second: Face) -> float:
    apart = np.subtract(second.origin_m, first.origin_m)
    return float(np.linalg.norm(apart - (apart @ first.axis) * np.asarray(first.axis)))


def _stretch_m(first: Face, second: Face) -> tuple[float, float]:
    """Return where the second face begins and ends along the axis of the first."""
    start = float(np.subtract(second.origin_m, first.origin_m) @ np.asarray(first.axis))
    way = float(np.sign(np.dot(first.axis, second.axis)))
    return start + way * second.extent_m[0], start + way * second.extent_m[1]
