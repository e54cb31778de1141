"""Place the parts of a plan for an exploded drawing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from skillplan.task.pose import DOWN, Pose
from skillplan.task.pose import Point as Point3
from skillplan.task.scene import Body
from skillplan.task.shape import Mesh
from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.writing.upright import Upright, place_upright

AddedBody = tuple[Body, Pose, Point3]
"""A body, its goal pose, and the unit vector of its final move."""

Draw = Callable[
    [Mapping[str, Any], Mapping[str, Any], Sequence[AddedBody]], Mapping[str, str | bytes]
]
"""Returns files with pictures of a product, from its report, its relation and its bodies."""


def place_bodies(product: Product, plan: AssemblyPlan, up: Vector) -> list[AddedBody]:
    """Return the parts in order of the plan; stuck parts are one body with the base.

    Parameters
    ----------
    up
        Vector that points up, in the product's frame.
    """
    upright = place_upright(product, up, (0.0, 0.0))
    stuck = [entry.part for entry in plan.stuck if entry.part != plan.base]
    # With unbroken spaces, since pictures cut names at spaces.
    about = f" with {len(stuck)} stuck part{'s' if stuck[1:] else ''}".replace(" ", "\u00a0")
    name = f"{plan.base}{about}" if stuck else plan.base
    bodies = [(*_place_parts(product, upright, name, (plan.base, *stuck)), DOWN)]
    taken = {plan.base, *stuck}
    for step in plan.steps:
        for part in step.parts:
            if part not in taken:
                taken.add(part)
                placed = _place_parts(product, upright, part, (part,))
                bodies.append((*placed, upright.vector(step.along)))
    return bodies


def _place_parts(
    product: Product, upright: Upright, title: str, names: Sequence[str]
) -> tuple[Body, Pose]:
    """Return some parts as one body, and its pose."""
    parts = [product.part(name) for name in names]
    bottom = upright.bottom(parts[0])
    meshes = [_build_mesh(part, upright, bottom) for part in parts]
    body = Body(title, tuple(mesh.box for mesh in meshes), (), 1.0, surfaces=tuple(meshes))
    return body, Pose(bottom)


def _build_mesh(part: Part, upright: Upright, bottom: Point3) -> Mesh:
    local = upright.vertices(part) - bottom
    corners = tuple((float(x), float(y), float(z)) for x, y, z in local)
    faces = tuple((int(a), int(b), int(c)) for a, b, c in part.triangles)
    return Mesh(corners, faces, convex=False)
