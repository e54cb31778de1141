"""Keeping what C libraries print out of stdout and stderr, which belong to the command."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pybullet
from numpy.typing import NDArray

from skillplan.task.shape import Box, Cylinder, Mesh, Shape


@contextmanager
def quiet_output() -> Iterator[None]:
    """Send what is written to file descriptors 1 and 2, also by C code, nowhere."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = {}
    for descriptor in (1, 2):
        try:
            kept[descriptor] = os.dup(descriptor)
        except OSError:
            # It is closed: there is nothing to be kept clean.
            continue
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in kept:
            os.dup2(nowhere, descriptor)
        yield
    finally:
        for descriptor, copy in kept.items():
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(nowhere)


_TYPES = {Box: pybullet.GEOM_BOX, Cylinder: pybullet.GEOM_CYLINDER, Mesh: pybullet.GEOM_MESH}
# What a body of the simulator takes; more write past its end, and it crashes.
_MOST_SHAPES = 16
_SIDES = 64


def make_body(
    client: int,
    solid: Sequence[Shape],
    *,
    mass_kg: float,
    centre: NDArray[np.float64],
) -> int:
    """Make a body whose origin is its centre of mass; return its number.

    Parameters
    ----------
    client
        Where to.
    solid
        What collides. Meshes that are not convex do so exactly, but only where the mass is 0.
    mass_kg
        0 for what never moves [kg].
    centre
        Of its mass, in the frame of the shapes [m], shape (3,).
    """
    # The simulator takes meshes in files only.
    has_mesh = any(isinstance(shape, Mesh) for shape in solid)
    bundles = _bundles(solid)
    with (
        TemporaryDirectory()
        if has_mesh or len(solid) > _MOST_SHAPES
        else nullcontext("") as folder,
        quiet_output(),
    ):
        firsts = [bundle[0] for bundle in bundles]
        collision = pybullet.createCollisionShapeArray(
            shapeTypes=[_TYPES[type(shape)] for shape in firsts],
            halfExtents=[[extent / 2 for extent in shape.box.size] for shape in firsts],
            radii=[getattr(shape, "diameter_m", 1.0) / 2 for shape in firsts],
            lengths=[shape.box.size[2] for shape in firsts],
            fileNames=[_written(bundle, Path(folder)) for bundle in bundles],
            collisionFramePositions=[(_origin(shape) - centre).tolist() for shape in firsts],
            flags=[_flags(shape) for shape in firsts],
            physicsClientId=client,
        )
        return int(pybullet.createMultiBody(mass_kg, collision, physicsClientId=client))


def _bundles(shapes: Sequence[Shape]) -> list[Sequence[Shape]]:
    """Return shapes one by one, or of more than the simulator takes meshes that share a file.

    Of a file each object becomes a hull of its own, or all of them one surface, if they are not
    convex. Where there are too many boxes and cylinders, they become meshes, too.
    """
    if len(shapes) <= _MOST_SHAPES:
        return [(shape,) for shape in shapes]
    simple = [shape for shape in shapes if not isinstance(shape, Mesh)]
    if len(simple) > _MOST_SHAPES - 2:
        shapes = [_as_mesh(shape) for shape in shapes]
        simple = []
    meshes = [shape for shape in shapes if isinstance(shape, Mesh)]
    kinds = [[mesh for mesh in meshes if mesh.convex is convex] for convex in (True, False)]
    return [*((shape,) for shape in simple), *(kind for kind in kinds if kind)]


def _as_mesh(shape: Shape) -> Mesh:
    """Return a shape as a mesh: a box exactly, a cylinder as a prism about as wide."""
    if isinstance(shape, Mesh):
        return shape
    if isinstance(shape, Box):
        turns, radii = np.pi / 4 + np.arange(4) * np.pi / 2, np.array(shape.size[:2]) / np.sqrt(2)
    else:
        turns, radii = np.arange(_SIDES) * 2 * np.pi / _SIDES, np.full(2, shape.diameter_m / 2)
    outline = np.stack([radii[0] * np.cos(turns), radii[1] * np.sin(turns)], axis=1)
    half, count = shape.box.size[2] / 2, len(turns)
    rings = [np.column_stack([outline, np.full(count, z)]) for z in (-half, half)]
    corners = np.concatenate(rings) + np.array(shape.centre)
    after = [(one + 1) % count for one in range(count)]
    faces = [(a, b, count + b) for a, b in enumerate(after)]
    faces += [(a, count + b, count + a) for a, b in enumerate(after)]
    faces += [(0, b + 1, b) for b in range(1, count - 1)]
    faces += [(count, count + b, count + b + 1) for b in range(1, count - 1)]
    return Mesh(tuple((float(x), float(y), float(z)) for x, y, z in corners), tuple(faces))


def _flags(shape: Shape) -> int:
    """Return how the simulator is to take a shape."""
    is_hollow = isinstance(shape, Mesh) and not shape.convex
    return int(pybullet.GEOM_FORCE_CONCAVE_TRIMESH) if is_hollow else 0


def _origin(shape: Shape) -> NDArray[np.float64]:
    """Return the origin of a shape's own geometry; corners of a mesh are the body's already."""
    return np.zeros(3) if isinstance(shape, Mesh) else np.array(shape.centre)


def _written(bundle: Sequence[Shape], folder: Path) -> str:
    """Write meshes to a file, unless it is there, and return its name; "" for others."""
    meshes = [shape for shape in bundle if isinstance(shape, Mesh)]
    if not meshes:
        return ""
    path = folder / f"{hash(tuple(id(mesh) for mesh in meshes)):x}.obj"
    if not path.exists():
        lines, before = [], 1
        for number, mesh in enumerate(meshes):
            lines += [f"o {number}"] if len(meshes) > 1 else []
            lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.corners]
            lines += [f"f {a + before} {b + before} {c + before}" for a, b, c in mesh.faces]
            before += len(mesh.corners)
        path.write_text("\n".join(lines) + "\n", "utf-8")
    return str(path)
