"""Check a plan independently, by volumes of exact solids.

The plan rests on rays and shrunk meshes. The replay shrinks nothing: it intersects the solids along
each move, and accepts overlaps up to the thickness of the tolerance. Use it with meshes of another
tessellation than the plan.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.planning.assembly_plan import AssemblyPlan, Step
from skillplan_cad.planning.motion_space import rotate_about
from skillplan_cad.planning.watch import Watch
from skillplan_cad.product import Part, Product, Vector, make_solid
from skillplan_cad.relation import Relation

Array = NDArray[np.float64]
_LEAST_SAMPLES, _MOST_SAMPLES = 24, 2_000
_TURN_RAD = np.pi / 60
_SAMPLE_SHARE = 0.1  # of the smallest extent of the moving parts


@dataclass(frozen=True, slots=True)
class Fault:
    """Two parts that overlap during a move.

    Parameters
    ----------
    step
        Number of the step in order of assembly, from 0.
    offset_m
        Offset of the moving part from its place.
    thickness_m
        Thickness of the overlap: twice its volume divided by its surface.
    """

    step: int
    part: str
    by: str
    offset_m: Vector
    thickness_m: float
    point_m: Vector


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay.

    Parameters
    ----------
    faults
        First fault of each pair in each step.
    not_solid
        Parts whose meshes enclose no volume, which were not tested.
    complete
        False if the time was over before all steps were tested.
    """

    samples: int
    faults: tuple[Fault, ...]
    not_solid: tuple[str, ...]
    complete: bool = True

    @property
    def agrees(self) -> bool:
        """True if the replay confirms the plan."""
        return self.complete and not self.faults and not self.not_solid


def replay(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    tolerance_m: float = 1e-4,
    watch: Watch | None = None,
) -> Replay:
    """Disassemble a plan's product, the last step first, and return the overlaps.

    Parameters
    ----------
    product
        Parts named as in the plan; best of another tessellation.
    relation
        Relation with fasteners; threads may overlap.
    tolerance_m
        Allowed thickness of overlaps, in addition to the chords of round faces [m].
    watch
        Progress reports, and requests to stop.
    """
    watch = watch or Watch()
    solids = {part.name: _build_solid(part) for part in product}
    broken = tuple(name for name, solid in solids.items() if solid is None)
    sound = {name: solid for name, solid in solids.items() if solid is not None}
    together = _list_assembled(plan)
    allowed = tolerance_m + 2 * product.chord_m
    samples = 0
    faults: list[Fault] = []
    bounds = {part.name: part.bounds_m for part in product}
    for number in reversed(range(len(plan.steps))):
        if watch.must_stop():
            return Replay(samples, tuple(faults), broken, False)
        step = plan.steps[number]
        known: set[tuple[str, str]] = set()
        standing = [name for name in together[number] if name in sound]
        boxes_mm = np.array([bounds[name] for name in standing]).reshape(-1, 2, 3) * 1e3
        moving = [bounds[name] for name in step.parts]
        for matrix, offset in _iterate_placements(step, moving, bounds, tolerance_m):
            samples += 1
            for part in step.parts:
                if part not in sound:
                    continue
                moved = sound[part].transform(np.column_stack([matrix, offset]))
                for by in _find_near(moved, standing, boxes_mm):
                    if (part, by) in known or _is_screwed(relation, part, by):
                        continue
                    fault = _find_fault(number, part, by, moved, sound[by], offset, allowed)
                    if fault is not None:
                        known.add((part, by))
                        faults.append(fault)
    return Replay(samples, tuple(faults), broken)


def _build_solid(part: Part) -> manifold3d.Manifold | None:
    solid = make_solid(part.vertices_m, part.triangles)
    return None if solid.is_empty() else solid


def _list_assembled(plan: AssemblyPlan) -> list[tuple[str, ...]]:
    """Return the assembled parts before each step."""
    assembled: list[tuple[str, ...]] = []
    groups: dict[str, list[str]] = {}
    for step in plan.steps:
        group = groups.setdefault(step.onto, [step.onto])
        assembled.append(tuple(group))
        group.extend(step.parts)
    return assembled


def _is_screwed(relation: Relation, part: str, by: str) -> bool:
    """Return whether one part is a fastener whose thread the other grips."""
    first, second = relation.fastener(part), relation.fastener(by)
    return (first is not None and by in first.threaded_in) or (
        second is not None and part in second.threaded_in
    )


def _iterate_placements(
    step: Step, moving: Sequence[Array], bounds: Mapping[str, Array], tolerance_m: float
) -> Iterator[tuple[Array, Array]]:
    """Yield rotations and offsets [mm] of the removal, without the start."""
    low = np.min([box[0] for box in moving], axis=0)
    high = np.max([box[1] for box in moving], axis=0)
    # Overlaps below the tolerance are allowed, so finer steps reveal no more faults.
    pace = max(_SAMPLE_SHARE * float((high - low).min()), tolerance_m)
    if not step.path:
        everything = np.stack(list(bounds.values()))
        away = -np.asarray(step.along)
        span = np.where(
            away > 0, everything[:, 1].max(axis=0) - low, high - everything[:, 0].min(axis=0)
        )
        share = np.abs(away)
        length = float((span[share > 1e-6] / share[share > 1e-6]).min())
        number = min(max(_LEAST_SAMPLES, math.ceil(length / pace)), _MOST_SAMPLES)
        for k in range(1, number + 1):
            yield np.eye(3), away * length * k / number * 1e3
        return
    matrix, offset = np.eye(3), np.zeros(3)
    for move in step.path:
        by = np.asarray(move.offset_m)
        steps = max(float(np.linalg.norm(by)) / pace, abs(move.angle_rad) / _TURN_RAD)
        number = min(max(2, math.ceil(steps)), _MOST_SAMPLES)
        start = matrix, offset
        for k in range(1, number + 1):
            share_done = k / number
            turn, shift = (np.eye(3), np.zeros(3))
            if move.axis is not None:
                turn, shift = rotate_about(move.axis, share_done * move.angle_rad)
            matrix = start[0] @ turn
            offset = start[0] @ shift + start[1] + share_done * by
            yield matrix, offset * 1e3


def _find_near(
    moved: manifold3d.Manifold, standing: Sequence[str], boxes_mm: Array
) -> Iterator[str]:
    """Yield the standing parts whose boxes, shape (parts, 2, 3), overlap that of a solid."""
    box = np.asarray(moved.bounding_box())
    near = (box[:3] < boxes_mm[:, 1]).all(axis=1) & (boxes_mm[:, 0] < box[3:]).all(axis=1)
    return (standing[number] for number in np.flatnonzero(near).tolist())


def _find_fault(
    step: int,
    part: str,
    by: str,
    moved: manifold3d.Manifold,
    other: manifold3d.Manifold,
    offset_mm: Array,
    allowed_m: float,
) -> Fault | None:
    """Return a fault if two solids overlap by more than a film."""
    both = moved ^ other
    if both.is_empty():
        return None
    thickest, place = 0.0, np.zeros(3)
    for piece in both.decompose():
        surface = piece.surface_area()
        thickness = 2 * piece.volume() / surface / 1e3 if surface > 0 else 0.0
        if thickness > thickest:
            box = np.asarray(piece.bounding_box())
            thickest, place = thickness, (box[:3] + box[3:]) / 2e3
    if thickest <= allowed_m:
        return None
    x, y, z = (float(value) / 1e3 for value in offset_mm)
    return Fault(
        step, part, by, (x, y, z), thickest, (float(place[0]), float(place[1]), float(place[2]))
    )
