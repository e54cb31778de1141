"""Nests for a plan: one for each orientation in which parts come onto the product."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from skillplan.errors import OptionError
from skillplan_cad.nests.nest import KeepFree, Nest, NestSettings, build_nest
from skillplan_cad.nests.nest_check import check_nest, drop_bad_coarse
from skillplan_cad.nests.nest_document import build_nest_document, format_nest_files
from skillplan_cad.nests.stepped_mesh import Body
from skillplan_cad.planning.assembly_plan import AssemblyPlan, Step
from skillplan_cad.planning.watch import Watch
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.writing.upright import compute_rotation_to_z

NEST_FOLDER = "nests"
"""Folder of the nests in the output."""

# Cosine above which a move is straight down.
_DOWN = 1 - 1e-6
_NAMED = 4


@dataclass(frozen=True, slots=True)
class PlannedNests:
    """Nests of a plan.

    Parameters
    ----------
    entries
        Entries of `skillplan.nest/1`.
    files
        Meshes of the good ones by path.
    lines, warnings
        The good ones, and the others with their faults, one each.
    """

    entries: tuple[dict[str, Any], ...]
    files: dict[str, str | bytes]
    lines: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Phase:
    """Steps in one orientation onto parts that are together before."""

    seated: tuple[str, ...]
    steps: tuple[Step, ...]


def plan_nests(product: Product, plan: AssemblyPlan, watch: Watch) -> PlannedNests:
    """Return a nest for each orientation of the plan and of its sub-assemblies.

    A nest holds what is together before the first step in the orientation, and leaves room for the
    parts that come in it. A request to stop leaves the rest out.
    """
    entries, files = [], dict[str, str | bytes]()
    lines, warnings = [], []
    parts = {part.name: part for part in product}
    planned = {plan.base, *(name for step in plan.steps for name in (step.onto, *step.parts))}
    left_out = [part for part in product if part.name not in planned]
    stuck = {part.part for part in plan.stuck} | {*plan.withdrawn}
    for number, phase in enumerate(_list_phases(plan), 1):
        if watch.must_stop():
            warnings.append("the nests of later orientations are left out, as time is over.")
            break
        label = f"nest_{number}"
        watch.report(f"nests: {label}, for {phase.seated[0]}")
        names = ", ".join(phase.seated[:_NAMED]) + (" and others" if phase.seated[_NAMED:] else "")
        try:
            entry, own = _make(label, phase, parts, left_out)
        except OptionError as error:
            warnings.append(f"{label} for {names} is not possible: {error}")
            continue
        entries.append(entry)
        files |= own
        check = entry["check"]
        if check["good"]:
            gap = f"{check['least_gap_mm']:.3f} mm" if check["gap_at_mm"] else "5 mm or more"
            line = f"{label} for {names}: good, least gap {gap} by {check['rays']:,} rays"
            if "obj" not in entry["files"]:
                line += "; no OBJ for a task, which accepts fewer corners and pieces"
            lines.append(line + _describe_without(entry["without"], stuck))
        else:
            warnings.append(f"{label} for {names} is not good: {'; '.join(check['faults'])}.")
    return PlannedNests(tuple(entries), files, tuple(lines), tuple(warnings))


def _list_phases(plan: AssemblyPlan) -> Iterator[_Phase]:
    """Yield the orientations of each base in the order of the plan."""
    for base in dict.fromkeys(step.onto for step in plan.steps):
        present, steps = [base], list[Step]()
        seated = tuple(present)
        for step in plan.steps:
            if step.onto != base:
                continue
            if steps and not np.allclose(step.up, steps[-1].up, atol=1e-6):
                yield _Phase(seated, tuple(steps))
                steps, seated = [], tuple(present)
            steps.append(step)
            present += step.parts
        yield _Phase(seated, tuple(steps))


def _make(
    label: str, phase: _Phase, parts: dict[str, Part], left_out: Sequence[Part]
) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """Return the entry and the files of a nest; no files if it is not good."""
    settings, up = NestSettings(), phase.steps[0].up
    seated = [parts[name] for name in phase.seated]
    room, free = [_get_body(part) for part in seated], list[KeepFree]()
    for step in phase.steps:
        coming = [_get_body(parts[name]) for name in step.parts]
        if float(np.dot(step.along, up)) < -_DOWN and not step.path:
            room += coming
        else:
            winds = bool(step.path)
            free.append(keep_way_free(coming, step.along, up, settings.clearance_m, winds=winds))
    nest = build_nest(room, settings, up, free)
    check = check_nest([_get_body(part) for part in seated], nest, free)
    if len(room) > len(seated):
        later = check_nest(room, nest, free, stands=False)
        words = (f"{fault}, with the parts that come later" for fault in later.faults)
        check = replace(check, faults=(*check.faults, *words))
    entry = build_nest_document(label, nest, check, seated)
    entry["without"] = [part.name for part in left_out if _is_near(part, nest)]
    if not check.is_good:
        return entry, {}
    files = {
        f"{NEST_FOLDER}/{name}": content
        for name, content in format_nest_files(label, drop_bad_coarse(room, nest, free)).items()
    }
    entry["files"] = {
        name.removeprefix(f"{NEST_FOLDER}/{label}.").replace(".", "_"): name for name in files
    }
    return entry, files


def _describe_without(names: Sequence[str], stuck: Collection[str]) -> str:
    """Return words for parts that the nest leaves no room for."""
    words = (
        f"{name}, which is {'stuck' if name in stuck else 'left out of the plan'}" for name in names
    )
    return f"; without {'; '.join(words)}" if names else ""


def _is_near(part: Part, nest: Nest) -> bool:
    """Return whether the boxes about a part and a nest overlap."""
    own, other = part.vertices_m, nest.vertices_m
    return bool(
        (own.min(axis=0) < other.max(axis=0)).all() & (own.max(axis=0) > other.min(axis=0)).all()
    )


def _get_body(part: Part) -> Body:
    return part.vertices_m, part.triangles


def keep_way_free(
    bodies: Sequence[Body], along: Vector, up: Vector, clearance_m: float, *, winds: bool = False
) -> KeepFree:
    """Return the region that parts cross on a way that is not straight down.

    Parameters
    ----------
    along
        Direction in which they come.
    winds
        True if they come by several moves, so the nest is open through its base.
    """
    turn = compute_rotation_to_z(up)
    points = np.concatenate([vertices for vertices, _ in bodies]) @ turn.T
    way = turn @ np.asarray(along)
    # From outside of the nest, which is not wider than the product with its walls.
    back = points[:, :2] - (1.0 if abs(way[2]) < _DOWN else 0.0) * way[:2]
    hull = shapely.MultiPoint(np.concatenate([points[:, :2], back])).convex_hull
    outline = shapely.get_coordinates(hull.buffer(clearance_m, quad_segs=4))[:-1]
    from_below = way[2] > 1e-6 or winds
    floor_m = -math.inf if from_below else float(points[:, 2].min()) - clearance_m
    return KeepFree(outline, floor_m)
