"""Nests for a plan: one for each orientation in which parts come onto the product."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from skillplan.errors import OptionError
from skillplan_cad.nests.nest import Floats, KeepFree, Nest, NestSettings, build_nest
from skillplan_cad.nests.nest_check import MOST_SAMPLES, NestCheck, check_nest, drop_bad_coarse
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

    A nest holds the parts that are together before the first step in the orientation, and leaves
    room for the parts that come in it. A request to stop leaves the rest out.
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
    ways = (
        Way([parts[name] for name in step.parts], (step.along,), bool(step.path))
        for step in phase.steps
    )
    room, free = divide_room(ways, up, settings.clearance_m)
    room = [get_body(part) for part in seated] + room
    nest, check = build_checked_nest(seated, room, settings, up, free)
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


def get_body(part: Part) -> Body:
    """Return the mesh of a part."""
    return part.vertices_m, part.triangles


def goes_down(along: Vector, up: Vector) -> bool:
    """Return whether a direction is straight down."""
    return float(np.dot(along, up)) < -_DOWN


@dataclass(frozen=True, slots=True)
class Way:
    """Parts that come together, and the directions in which they may come.

    Parameters
    ----------
    winds
        True if they come by several moves, so the nest is open through its base.
    """

    parts: Sequence[Part]
    along: Sequence[Vector]
    winds: bool = False


def divide_room(
    ways: Iterable[Way], up: Vector, clearance_m: float, heading: int = 0
) -> tuple[list[Body], list[KeepFree]]:
    """Return the bodies that come straight down, and the regions that the others cross."""
    room, free = list[Body](), list[KeepFree]()
    turn = compute_rotation_to_z(up, heading)
    for way in ways:
        bodies = [get_body(part) for part in way.parts]
        aside = [along for along in way.along if way.winds or not goes_down(along, up)]
        free += [_keep_free(bodies, along, turn, clearance_m, way.winds) for along in aside]
        if not aside:
            room += bodies
    return room, free


def build_checked_nest(
    seated: Sequence[Part],
    room: Sequence[Body],
    settings: NestSettings,
    up: Vector,
    free: Sequence[KeepFree],
    most: int = MOST_SAMPLES,
    heading: int = 0,
) -> tuple[Nest, NestCheck]:
    """Return a nest and its check: with the seated parts, then with all parts."""
    nest = build_nest(room, settings, up, free, heading)
    check = check_nest([get_body(part) for part in seated], nest, free, most=most)
    if len(room) > len(seated):
        later = check_nest(room, nest, free, stands=False, most=most)
        words = (f"{fault}, with the parts that come later" for fault in later.faults)
        check = replace(check, faults=(*check.faults, *words))
    return nest, check


def _keep_free(
    bodies: Sequence[Body], along: Vector, turn: Floats, clearance_m: float, winds: bool
) -> KeepFree:
    """Return the region that bodies cross on a way that is not straight down."""
    points = np.concatenate([vertices for vertices, _ in bodies]) @ turn.T
    way = turn @ np.asarray(along)
    # From outside of the nest, which is not wider than the product with its walls.
    back = points[:, :2] - (1.0 if abs(way[2]) < _DOWN else 0.0) * way[:2]
    hull = shapely.MultiPoint(np.concatenate([points[:, :2], back])).convex_hull
    outline = shapely.get_coordinates(hull.buffer(clearance_m, quad_segs=4))[:-1]
    from_below = way[2] > 1e-6 or winds
    floor_m = -math.inf if from_below else float(points[:, 2].min()) - clearance_m
    return KeepFree(outline, floor_m)
