"""Grasps that hold nothing: jaws that meet no material, and cups over holes and edges."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skillplan.collision import make_polyhedron
from skillplan.physics.linear_motions import choose_visit_grasp, list_handled
from skillplan.robots.arm_description import Hand
from skillplan.task.motion import Grasp, GraspKind
from skillplan.task.pose import Pose, cross
from skillplan.task.scene import Body, Robot, Scene, Tool, ToolKind
from skillplan.task.shape import Shape
from skillplan.task.skill import Skill
from skillplan_pinocchio.shapes import Array

# Least area of a jaw on a part [m2]: line contact of a small pin, the rim of an M2 washer.
_LEAST_M2 = 4e-7
# Least share of a cup on material, and greatest bend of its lip as a share of its radius.
_LEAST_SEAL, _BEND = 0.999, 0.3


def describe_no_hold(scene: Scene, robot: Robot, skill: Skill) -> str | None:
    """Return a message on a hand of a skill that meets no material of its part, or None."""
    attached = skill.parameters.get("tool")
    tool = next((tool for tool in robot.tools if tool.name == attached), None)
    for visit in list_handled(skill):
        body = scene.body(visit.subject)
        words = _describe(body, choose_visit_grasp(body, visit), tool, robot.hand_of(tool))
        if words is not None:
            return words
    return None


def _describe(body: Body, grasp: Grasp, tool: Tool | None, hand: Hand) -> str | None:
    shapes = body.exact_shapes
    if grasp.kind is GraspKind.JAWS:
        areas_m2 = _measure_jaw_contact(shapes, grasp, hand)
        if min(areas_m2) >= _LEAST_M2:
            return None
        first, second = (f"{area_m2 * 1e6:.1f}" for area_m2 in areas_m2)
        return (
            f"the jaws close on air: they meet {first} and {second} mm2 of {body.name}, where "
            f"{_LEAST_M2 * 1e6:g} mm2 is the least; give it another grasp"
        )
    if tool is None or tool.kind is not ToolKind.SUCTION or tool.envelope is not None:
        # The task does not describe the cup.
        return None
    seal = min(
        _measure_seal(shapes, grasp, cup, tool.cup_m, _BEND * tool.cup_m / 2) for cup in tool.cups
    )
    if seal >= _LEAST_SEAL:
        return None
    return (
        f"{'the' if len(tool.cups) == 1 else 'a'} suction cup covers a hole or an edge of "
        f"{body.name}: {1 - seal:.0%} of its {tool.cup_m * 1e3:g} mm meet nothing; give at_m of a "
        "place on it, or jaws"
    )


NEAR_M = 5e-4
"""Distance from the plane of a jaw or a lip at which a surface still meets it [m]."""
# Cells of a jaw's face along each of its sides, and points on the rim of a cup.
_CELLS, _RIM = 24, 32
# Distance behind the face at which the rows of a jaw's outline still belong to it [m].
_FACE_M = 1e-4
# Radii of rings of points beneath a cup, as shares of its own.
_RINGS = (0.95, 0.8, 0.6, 0.4, 0.2)
# Greatest number of pairs of rays and triangles in one array.
_PAIRS = 500_000
_AT_ORIGIN = Pose((0.0, 0.0, 0.0))


def _measure_jaw_contact(shapes: Sequence[Shape], grasp: Grasp, hand: Hand) -> tuple[float, float]:
    """Return the areas of both jaws that meet the surface of a part when they close [m2].

    Parameters
    ----------
    shapes
        True shapes in the part's frame.
    hand
        Hand with the jaws; their faces end at its underside.
    """
    out = _negate(grasp.approach)
    frame = np.array([cross(grasp.closing, grasp.approach), out, grasp.closing])
    triangles = _view(shapes, frame, np.array(grasp.tip))
    if grasp.is_inner:
        # The outer faces hold, where the jaws are thickest up to their depth.
        rows = [(row[0], row[1]) for row in hand.jaw_m]
        out_sign = -1.0
    else:
        face_m = min(row[2] for row in hand.jaw_m) + _FACE_M
        rows = [(row[0], row[1]) for row in hand.jaw_m if row[2] <= face_m]
        out_sign = 1.0
    heights, halves = np.array(rows).T
    low = triangles[..., :2].min(axis=(0, 1))
    high = triangles[..., :2].max(axis=(0, 1))
    low = np.maximum(low, (-halves.max(), heights[0]))
    high = np.minimum(high, (halves.max(), heights[-1]))
    if not (low < high).all():
        return 0.0, 0.0
    cell = (high - low) / _CELLS
    steps = np.arange(_CELLS) + 0.5
    across, above = np.meshgrid(low[0] + steps * cell[0], low[1] + steps * cell[1])
    rays = np.column_stack([across.ravel(), above.ravel()])
    rays = rays[np.abs(rays[:, 0]) <= np.interp(rays[:, 1], heights, halves)]
    number, height, facing = _trace(rays, triangles)
    areas = []
    for side in (-1.0, 1.0):
        meets = (facing * side * out_sign > 0) & (
            np.abs(height - side * grasp.width_m / 2) <= NEAR_M
        )
        areas.append(len(np.unique(number[meets])) * float(cell.prod()))
    return areas[0], areas[1]


def _measure_seal(
    shapes: Sequence[Shape],
    grasp: Grasp,
    cup: tuple[float, float],
    diameter_m: float,
    most_m: float,
) -> float:
    """Return the share of a suction cup with material beneath it, 0 to 1.

    Parameters
    ----------
    cup
        Its centre from the axis of the tool, along the closing axis and across it [m].
    shapes
        True shapes in the part's frame.
    most_m
        Greatest distance between lip and material [m]: a cup follows a curved surface.
    """
    frame = np.array([cross(grasp.approach, grasp.closing), grasp.closing, _negate(grasp.approach)])
    triangles = _view(shapes, frame, np.array(grasp.tip))
    turns = 2 * math.pi * np.arange(_RIM) / _RIM
    rim = np.column_stack([np.cos(turns), np.sin(turns)])
    # The first axis of the frame is against y of the tool, the second is x.
    centre = np.array([-cup[1], cup[0]])
    rays = centre + np.concatenate([share * diameter_m / 2 * rim for share in _RINGS])
    number, height, _ = _trace(rays, triangles)
    return len(np.unique(number[np.abs(height) <= most_m])) / len(rays)


def _view(shapes: Sequence[Shape], frame: Array, origin: Array) -> Array:
    """Return the triangles of shapes in a frame with an origin [m], shape (triangles, 3, 3)."""
    seen = [make_polyhedron(shape, _AT_ORIGIN).triangles for shape in shapes]
    return np.asarray((np.concatenate(seen) - origin) @ frame.T)


def _trace(rays: Array, triangles: Array) -> tuple[Array, Array, Array]:
    """Return the crossings of rays along z: number of the ray, height [m], sign of the facing."""
    low, high = rays.min(axis=0), rays.max(axis=0)
    flat = triangles[..., :2]
    near = ((flat.min(axis=1) <= high) & (flat.max(axis=1) >= low)).all(axis=1)
    triangles = triangles[near]
    a, b, c = (triangles[:, corner] for corner in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    sound = np.abs(normals[:, 2]) > 1e-9 * np.maximum(lengths, 1e-30)
    a, b, c, normals = a[sound], b[sound], c[sound], normals[sound]
    numbers, heights, facings = [], [], []
    chunk = max(1, _PAIRS // max(1, len(a)))
    for first in range(0, len(rays), chunk):
        points = rays[first : first + chunk, None]
        turn = np.sign(normals[:, 2])
        inside = np.ones((len(points), len(a)), dtype=bool)
        for begin, end in ((a, b), (b, c), (c, a)):
            side, beyond = (end - begin)[:, :2], points - begin[None, :, :2]
            inside &= (side[:, 0] * beyond[..., 1] - side[:, 1] * beyond[..., 0]) * turn >= 0
        which, face = np.nonzero(inside)
        away = points[which, 0] - a[face, :2]
        slopes = np.einsum("ij,ij->i", away, normals[face, :2]) / normals[face, 2]
        numbers.append(which + first)
        heights.append(a[face, 2] - slopes)
        facings.append(np.sign(normals[face, 2]))
    if not numbers:
        return np.empty(0), np.empty(0), np.empty(0)
    return np.concatenate(numbers), np.concatenate(heights), np.concatenate(facings)


def _negate(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    return (-direction[0], -direction[1], -direction[2])
