"""Volumes that two parts both claim."""

from __future__ import annotations

from typing import Any

import numpy as np

from skillplan_cad.blocking.ray_mesh import Floats
from skillplan_cad.product import Part, Product

# Less than this is rounding [mm3].
_NOISE_MM3 = 1e-3


class Overlaps:
    """Intersections of a product's parts.

    Parameters
    ----------
    product
        The product.
    """

    def __init__(self, product: Product) -> None:
        self._product = product
        self._solids: dict[int, Any] = {}

    def between(self, first: int, second: int) -> tuple[float, float, Floats] | None:
        """Return the volume [mm3], the surface [mm2] and the middle [mm] of an overlap, or None.

        Parameters
        ----------
        first, second
            Numbers of the parts.
        """
        one, two = self._solid(first), self._solid(second)
        if one is None or two is None:
            return None
        shared = one ^ two
        volume = float(shared.volume())
        if volume < _NOISE_MM3:
            return None
        box = np.asarray(shared.bounding_box(), dtype=np.float64)
        return volume, float(shared.surface_area()), (box[:3] + box[3:]) / 2

    def _solid(self, number: int) -> Any:
        if number not in self._solids:
            self._solids[number] = _solid(self._product.parts[number])
        return self._solids[number]


def _solid(part: Part) -> Any:
    """Return a part as manifold3d has it, or None where it takes it for no solid."""
    import manifold3d

    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(part.vertices_m * 1000),
        tri_verts=np.ascontiguousarray(part.triangles, dtype=np.uint64),
    )
    made = manifold3d.Manifold(mesh)
    return None if made.is_empty() else made
