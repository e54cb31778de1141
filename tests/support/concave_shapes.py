"""Meshes that are not convex, made here: a channel, and the boxes that it is the union of."""

from skillplan.task import Box, Mesh

WIDTH_M, DEPTH_M, HEIGHT_M, WALL_M = 0.10, 0.08, 0.05, 0.004
_PROFILE = [(0, 1, 4), (1, 2, 3), (1, 3, 4), (0, 4, 5), (0, 5, 6), (0, 6, 7)]


def channel(width_m=WIDTH_M, depth_m=DEPTH_M, height_m=HEIGHT_M, wall_m=WALL_M):
    """Return a channel along y, open at the top, as one mesh about the centre of its bottom."""
    half, inner = width_m / 2, width_m / 2 - wall_m
    outline = [
        (-half, 0.0),
        (half, 0.0),
        (half, height_m),
        (inner, height_m),
        (inner, wall_m),
        (-inner, wall_m),
        (-inner, height_m),
        (-half, height_m),
    ]
    corners = [(x, y, z) for y in (-depth_m / 2, depth_m / 2) for x, z in outline]
    faces = [*_PROFILE, *((a + 8, c + 8, b + 8) for a, b, c in _PROFILE)]
    for i in range(8):
        j = (i + 1) % 8
        faces += [(i, i + 8, j + 8), (i, j + 8, j)]
    return Mesh(tuple(corners), tuple(faces), convex=False)


def channel_boxes(width_m=WIDTH_M, depth_m=DEPTH_M, height_m=HEIGHT_M, wall_m=WALL_M):
    """Return the boxes that the channel is made of."""
    beside = (width_m - wall_m) / 2
    return (
        Box((width_m, depth_m, wall_m), (0.0, 0.0, wall_m / 2)),
        Box((wall_m, depth_m, height_m), (beside, 0.0, height_m / 2)),
        Box((wall_m, depth_m, height_m), (-beside, 0.0, height_m / 2)),
    )


def as_obj(mesh):
    """Return the text of an OBJ file."""
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.corners]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces]
    return "\n".join(lines)
