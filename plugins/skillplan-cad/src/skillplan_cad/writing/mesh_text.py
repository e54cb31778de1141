"""The mesh of a part as an OBJ file: metres, the same bytes for the same part."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from skillplan_cad.product import Points, Triangles

_DECIMALS = 7


def obj_text(vertices_m: Points, triangles: Triangles) -> str:
    """Return an OBJ file of a closed mesh.

    Parameters
    ----------
    vertices_m
        Corners, merged; rounded to a tenth of a micrometre.
    triangles
        Indices of corners, anticlockwise from outside.
    """
    corners = np.round(vertices_m, _DECIMALS) + 0.0
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in corners.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles.tolist()]
    return "\n".join(lines) + "\n"


def pieces_text(pieces: Iterable[tuple[Points, Triangles]]) -> str:
    """Return an OBJ file of several bodies, each an object with corners of its own.

    Parameters
    ----------
    pieces
        Corners, to a tenth of a micrometre already, and triangles of each.
    """
    lines, before = [], 1
    for number, (vertices_m, triangles) in enumerate(pieces, 1):
        lines.append(f"o piece_{number}")
        lines += [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in (vertices_m + 0.0).tolist()]
        lines += [f"f {a + before} {b + before} {c + before}" for a, b, c in triangles.tolist()]
        before += len(vertices_m)
    return "\n".join(lines) + "\n"
