"""The collision shapes of a link of a URDF."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

from skillplan.robots.arm_description import Triple
from skillplan.robots.link_shapes import Capsule, Hull, LinkShape, Rod
from skillplan.robots.rigid import Rigid
from skillplan.robots.urdf_elements import (
    MOST_LENGTH_M,
    UrdfError,
    number,
    numbers,
    pose_of,
)
from skillplan.xml_tree import Element

_ONE: Triple = (1.0, 1.0, 1.0)


def shapes_of(
    link: Element, frame: Rigid, read_mesh: Callable[[str, Triple], tuple[Triple, ...]]
) -> list[LinkShape]:
    """Return the collision shapes of a link.

    Parameters
    ----------
    link
        The element.
    frame
        Where the link is, in the frame of the joint that moves it.
    read_mesh
        Returns the corners of the convex hull of a mesh, by name and scale.

    Raises
    ------
    UrdfError
        If a shape is not understood.
    """
    found = []
    for collision in link.all("collision"):
        geometry = collision.first("geometry")
        shape = geometry.children[0] if geometry is not None and geometry.children else None
        if shape is None:
            name = link.attributes["name"]
            raise UrdfError(f"a <collision> of link {name!r} has no shape", line=collision.line)
        try:
            found.append(_shape(shape, frame.then(pose_of(collision)), read_mesh))
        except ValueError as error:
            raise UrdfError(str(error).rstrip("."), line=shape.line) from None
    return found


def _shape(
    shape: Element, frame: Rigid, read_mesh: Callable[[str, Triple], tuple[Triple, ...]]
) -> LinkShape:
    if shape.tag == "box":
        sides = numbers(shape, "size", (0.0, 0.0, 0.0), MOST_LENGTH_M)
        if min(sides) <= 0:
            raise ValueError(f"a box has the size {sides}")
        corners = [
            frame.apply((a * sides[0] / 2, b * sides[1] / 2, c * sides[2] / 2))
            for a, b, c in product((-1, 1), repeat=3)
        ]
        return Hull(tuple(corners))
    if shape.tag == "sphere":
        return Capsule(frame.origin, frame.origin, number(shape, "radius", most=MOST_LENGTH_M))
    if shape.tag == "cylinder":
        half_m = number(shape, "length", most=MOST_LENGTH_M) / 2
        ends = frame.apply((0.0, 0.0, -half_m)), frame.apply((0.0, 0.0, half_m))
        return Rod(*ends, number(shape, "radius", most=MOST_LENGTH_M))
    if shape.tag == "mesh":
        name = shape.attributes.get("filename", "")
        corners = [frame.apply(one) for one in read_mesh(name, numbers(shape, "scale", _ONE))]
        return Hull(tuple(corners))
    raise ValueError(f"<{shape.tag}> is no shape of a link; give box, cylinder, sphere or mesh")
