"""Bodies of the simulator, made of the shapes of bodies of a task."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from skillplan.task.shape import Box, Cylinder, Mesh, Shape
from skillplan_pybullet.simulator.quiet_output import quiet_output

Colour = tuple[float, float, float, float]

_TYPES = {Box: pybullet.GEOM_BOX, Cylinder: pybullet.GEOM_CYLINDER, Mesh: pybullet.GEOM_MESH}


def make_body(
    client: int,
    solid: Sequence[Shape],
    seen: Sequence[Shape],
    *,
    mass_kg: float,
    centre: NDArray[np.float64],
    colour: Colour,
) -> int:
    """Make a body whose origin is its centre of mass; return its number.

    Parameters
    ----------
    client
        Where to.
    solid
        What collides. Meshes that are not convex do so exactly, but only where the mass is 0.
    seen
        What it looks like.
    mass_kg
        0 for what never moves [kg].
    centre
        Of its mass, in the frame of the shapes [m], shape (3,).
    colour
        Red, green, blue and opacity.
    """
    # The simulator takes meshes in files only.
    has_mesh = any(isinstance(shape, Mesh) for shape in (*solid, *seen))
    with TemporaryDirectory() if has_mesh else nullcontext("") as folder, quiet_output():
        collision = pybullet.createCollisionShapeArray(
            collisionFramePositions=_places(solid, centre),
            flags=[_flags(shape) for shape in solid],
            **_described(solid, Path(folder), client),
        )
        visual = pybullet.createVisualShapeArray(
            visualFramePositions=_places(seen, centre),
            rgbaColors=[colour] * len(seen),
            **_described(seen, Path(folder), client),
        )
        return int(pybullet.createMultiBody(mass_kg, collision, visual, physicsClientId=client))


def _described(shapes: Sequence[Shape], folder: Path, client: int) -> dict[str, Any]:
    """Return what collision and vision of shapes have in common, for the simulator."""
    return {
        "shapeTypes": [_TYPES[type(shape)] for shape in shapes],
        "halfExtents": [[extent / 2 for extent in shape.box.size] for shape in shapes],
        "radii": [getattr(shape, "diameter_m", 1.0) / 2 for shape in shapes],
        "lengths": [shape.box.size[2] for shape in shapes],
        "fileNames": [_written(shape, folder / f"{id(shape)}.obj") for shape in shapes],
        "physicsClientId": client,
    }


def _flags(shape: Shape) -> int:
    """Return how the simulator is to take a shape."""
    is_hollow = isinstance(shape, Mesh) and not shape.convex
    return int(pybullet.GEOM_FORCE_CONCAVE_TRIMESH) if is_hollow else 0


def _places(shapes: Sequence[Shape], centre: NDArray[np.float64]) -> list[list[float]]:
    """Return where the origins of shapes are, from a centre of mass."""
    return [(_origin(shape) - centre).tolist() for shape in shapes]


def _origin(shape: Shape) -> NDArray[np.float64]:
    """Return the origin of a shape's own geometry; corners of a mesh are the body's already."""
    return np.zeros(3) if isinstance(shape, Mesh) else np.array(shape.centre)


def _written(shape: Shape, path: Path) -> str:
    """Write a mesh to a file, unless it is there, and return its name; "" for others."""
    if not isinstance(shape, Mesh):
        return ""
    if not path.exists():
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in shape.corners]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in shape.faces]
        path.write_text("\n".join(lines) + "\n", "utf-8")
    return str(path)
