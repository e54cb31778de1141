"""What `skillplan import-cad` makes of a relation: a plan, its replay, and a task."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from skillplan_cad.importing.exploded import Draw, added_bodies
from skillplan_cad.importing.findings import Findings
from skillplan_cad.importing.settings import ImportSettings
from skillplan_cad.planning.assembly_plan import AssemblyPlan, Planner, Step, Stuck, with_groups
from skillplan_cad.planning.bearing import ATTITUDES, Bearing, bearing_of, best_bearing
from skillplan_cad.planning.precedence import members
from skillplan_cad.planning.replay import Replay, replay
from skillplan_cad.product import Product, Vector
from skillplan_cad.reading.mesh_folder import SUFFIXES as MESHES
from skillplan_cad.reading.product_reader import read_product
from skillplan_cad.reading.step_file import is_step
from skillplan_cad.relation import Relation
from skillplan_cad.relation_file import relation_text
from skillplan_cad.writing.pieces_proof import ProvedPieces
from skillplan_cad.writing.task_document import task_of
from skillplan_cad.writing.top_grasp import Upright


def plan_document(plan: AssemblyPlan, again: Replay, relation: Relation) -> dict[str, Any]:
    """Return a plan as JSON; lengths are millimetres, vectors in the file's frame."""
    return {
        "base": plan.base,
        "why_base": plan.why_base,
        "complete": plan.complete,
        "cheapest": plan.cheapest,
        "cost": plan.cost,
        "steps": [_step(step) for step in plan.steps],
        "subassemblies": [list(one) for one in plan.subassemblies],
        "stuck": [_stuck(one, relation) for one in plan.stuck],
        "locks": [
            {
                "parts": [relation.names[part] for part in members(lock.parts)],
                "rounds": [[relation.names[part] for part in one] for one in lock.rounds],
            }
            for lock in plan.locks
        ],
        "precedence": {
            name: [
                {
                    "directions": [
                        list(relation.directions[direction])
                        for direction in one.directions
                        if direction < len(relation.directions)
                    ],
                    "absent": [relation.names[part] for part in members(one.blockers)],
                }
                for one in plan.precedence.minimal(number)
            ]
            for number, name in enumerate(relation.names)
        },
        "replay": {
            "agrees": again.agrees,
            "samples": again.samples,
            "not_solid": list(again.not_solid),
            "faults": [
                {
                    "step": fault.step,
                    "part": fault.part,
                    "by": fault.by,
                    "offset_mm": _mm3(fault.offset_m),
                    "thickness_mm": _mm(fault.thickness_m),
                    "point_mm": _mm3(fault.point_m),
                }
                for fault in again.faults
            ],
        },
    }


def _step(step: Step) -> dict[str, Any]:
    return {
        "parts": list(step.parts),
        "onto": step.onto,
        "along": list(step.along),
        "up": list(step.up),
        "tool": step.tool,
        "turn": step.turn,
        "held": list(step.held),
        "tips": step.tips,
        "connected": step.connected,
        "path": [
            {
                "offset_mm": _mm3(move.offset_m),
                "angle_rad": round(move.angle_rad, 9),
                "axis": None if move.axis is None else list(move.axis.direction),
                "axis_point_mm": None if move.axis is None else _mm3(move.axis.point_m),
            }
            for move in step.path
        ],
    }


def _stuck(stuck: Stuck, relation: Relation) -> dict[str, Any]:
    among = set(stuck.among)
    return {
        "part": stuck.part,
        "among": list(stuck.among),
        "outcome": stuck.search.outcome,
        "iterations": stuck.search.iterations,
        "turned": stuck.search.turned,
        "in_the_way": [
            {"part": met.part, "point_mm": _mm3(met.point_m)} for met in stuck.search.in_the_way
        ],
        "blocked": [
            {
                "direction": list(relation.directions[number]),
                "by": [name for name in relation.blockers(stuck.part, number) if name in among],
            }
            for number in range(len(relation.directions))
        ],
    }


def placement_document(upright: Upright) -> dict[str, Any]:
    """Return as JSON how the product of the file stands in the world of the task."""
    return {
        "turn": [[round(float(one), 9) + 0.0 for one in row] for row in upright.matrix],
        "offset_mm": [round(float(one) * 1000, 6) + 0.0 for one in upright.offset_m],
    }


def pieces_document(proved: ProvedPieces, relation: Relation) -> dict[str, Any]:
    """Return as JSON of how many convex pieces parts are, and which pairs these block wrongly."""
    return {
        "counts": {name: sum(map(len, made)) for name, made in proved.pieces.items()},
        "cut_back": list(proved.cut_back),
        "differences": [
            {
                "part": one.part,
                "by": one.by,
                "direction": list(relation.directions[one.direction]),
            }
            for one in proved.differences
        ],
    }


def _mm3(point_m: Vector) -> list[float]:
    return [_mm(one) for one in point_m]


def _mm(value_m: float) -> float:
    return round(value_m * 1000, 4) + 0.0


AUTO = "auto"


def attitude(product: Product, relation: Relation, up: str) -> Bearing:
    """Return what bears the parts with an axis of the file up, or with that which bears most."""
    if up == AUTO:
        return best_bearing(product, relation)
    return bearing_of(product, relation, ATTITUDES[up])


def attitude_document(bearing: Bearing) -> dict[str, Any]:
    """Return as JSON what is up and what stands on what."""
    return {
        "up": axis_of(bearing),
        "stands": [{"part": name, "on": list(bearing.on[name])} for name in bearing.order],
    }


def attitude_warnings(
    product: Product, relation: Relation, bearing: Bearing, asked: str
) -> list[str]:
    """Return what a user should know of the side that is up, a sentence each."""
    count = len(bearing.order) + len(bearing.why_not)
    up, stand = axis_of(bearing), len(bearing.order)
    found = []
    if asked == AUTO and up != next(iter(ATTITUDES)):
        found.append(
            f"{up} points up, as then {stand} of {count} parts stand by themselves, more than with "
            "any other axis; --up asks for another."
        )
    best = bearing if asked == AUTO else best_bearing(product, relation)
    if len(best.order) > stand:
        found.append(
            f"with {up} up {stand} of {count} parts stand by themselves; with --up "
            f"{axis_of(best)} it would be {len(best.order)}."
        )
    if not stand:
        found.append(
            f"with {up} up no part stands on a level face. All are in product.yaml, and no order "
            "of them is feasible until a nest holds the first."
        )
    return found


def axis_of(bearing: Bearing) -> str:
    """Return the axis of the file that points up, as ``--up`` names it."""
    return next(name for name, up in ATTITUDES.items() if up == bearing.up)


_PLAN, _REPLAY = TypeAdapter(AssemblyPlan), TypeAdapter(Replay)


def plan_bytes(plan: AssemblyPlan) -> bytes:
    """Return a plan as a document."""
    return _PLAN.dump_json(plan)


def plan_from(content: bytes) -> AssemblyPlan:
    """Return the plan that `plan_bytes` wrote."""
    return _PLAN.validate_json(content)


def replay_bytes(again: Replay) -> bytes:
    """Return a replay as a document."""
    return _REPLAY.dump_json(again)


def replay_from(content: bytes) -> Replay:
    """Return the replay that `replay_bytes` wrote."""
    return _REPLAY.validate_json(content)


# Of the chord and the tolerance of the plan, what its replay takes.
_FINER = 0.4
_SHOWN = 6


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A plan with all that is told and written about it.

    Parameters
    ----------
    relation
        With sub-assemblies and stuck parts.
    complete
        Whether all parts come together.
    document
        What `report.json` says about it.
    files
        Contents of `product.yaml` and the meshes; none where parts are stuck.
    lines, warnings
        For people.
    """

    relation: Relation
    complete: bool
    document: Mapping[str, Any]
    files: Mapping[str, str | bytes]
    lines: tuple[str, ...]
    warnings: tuple[str, ...]


def planned(
    path: Path, findings: Findings, settings: ImportSettings, draw: Draw | None = None
) -> Planned:
    """Return the plan of a product.

    Parameters
    ----------
    path
        What it was read from, to be read again for the replay.
    findings
        What was found.
    settings
        What was asked for.
    draw
        Draws `exploded.png`; None for no picture.
    """
    product, relation = findings.product, findings.relation
    bearing = attitude(product, relation, settings.up)
    plan, again = _plan_and_replay(path, findings, settings, bearing)
    document: dict[str, Any] = {"plan": plan_document(plan, again, relation)}
    files: dict[str, str | bytes] = {}
    if draw is not None:
        files["exploded.png"] = draw(product.name, added_bodies(product, plan))
    told = []
    if plan.complete:
        document["attitude"] = attitude_document(bearing)
        told += attitude_warnings(product, relation, bearing, settings.up)
        task = task_of(product, relation, plan, settings.robot, bearing)
        document["left_out"] = dict(bearing.why_not if task is None else task.left_out)
        told += [f"{name} is left out: it {words}." for name, words in document["left_out"].items()]
        if task is None:
            told.append("No part is left that one arm could place: no product.yaml is written.")
        else:
            files |= task.files
            document["task_names"] = dict(task.names)
            document["placement"] = placement_document(task.upright)
            document["pieces"] = pieces_document(task.pieces, relation)
            document["limits"] = {name: list(lines) for name, lines in task.limits.items()}
            told += [f"check refuses product.yaml: {words}" for words in task.faults]
    limits = document.get("limits", {})
    return Planned(
        with_groups(relation, plan),
        plan.complete,
        document,
        files,
        tuple(_lines(plan, again)),
        (
            *_warnings(plan, again),
            *told,
            *_limit_lines(limits),
            *_piece_lines(document.get("pieces", {})),
        ),
    )


def _plan_and_replay(
    path: Path, findings: Findings, settings: ImportSettings, bearing: Bearing
) -> tuple[AssemblyPlan, Replay]:
    """Return a plan, and what other meshes say of it; neither is made again from the same."""
    product, relation = findings.product, findings.relation
    tolerance_m = settings.tolerance_mm / 1000
    grounded = [name for name in bearing.order if not bearing.on[name]]
    content, plan_hash = findings.stages.run(
        "planning",
        {
            "product": findings.read_hash,
            "relation": hashlib.sha256(relation_text(relation).encode()).hexdigest(),
            "tolerance_m": tolerance_m,
            "base": settings.base,
            "up": bearing.up,
            "grounded": grounded,
        },
        lambda: plan_bytes(
            Planner(product, relation, tolerance_m).plan(settings.base, bearing.up, grounded)
        ),
    )
    plan = plan_from(content)

    def replayed() -> bytes:
        finer = _finer(path, product, settings)
        share = 1.0 if finer is product else _FINER
        return replay_bytes(replay(finer, relation, plan, share * tolerance_m))

    content, _ = findings.stages.run(
        "replaying the plan with other meshes",
        {"product": findings.read_hash, "plan": plan_hash, "tolerance_m": tolerance_m},
        replayed,
    )
    return plan, replay_from(content)


def _finer(path: Path, product: Product, settings: ImportSettings) -> Product:
    """Return the product of another tessellation, where it can have one."""
    if path.suffix.lower() in MESHES or not is_step(path):
        return product
    reading = settings.reading
    return read_product(path, replace(reading, chord_m=_FINER * reading.chord_m))


def _lines(plan: AssemblyPlan, again: Replay) -> list[str]:
    order = [" with ".join(step.parts) for step in plan.steps]
    turns = sum(step.turn for step in plan.steps)
    found = [f"base {plan.base}: {plan.why_base}"]
    if order:
        found.append(f"order: {plan.base}, {', '.join(order)}")
        found.append(
            f"{turns} turn{'' if turns == 1 else 's'} of the product; "
            + ("no order costs less" if plan.cheapest else "the best of those looked at")
            + (
                f"; solids that were taken apart again in {again.samples} placements agree"
                if again.agrees
                else ""
            )
        )
    return found


def _warnings(plan: AssemblyPlan, again: Replay) -> list[str]:
    found = []
    for stuck in plan.stuck:
        where = "; ".join(
            f"{met.part} at [{', '.join(f'{value * 1000:.4g}' for value in met.point_m)}] mm"
            for met in stuck.search.in_the_way[:_SHOWN]
        )
        words = {
            "closed": "no straight move, path or turn that was searched leads out",
            "budget spent": f"no way out was found in {stuck.search.iterations} iterations",
        }[stuck.search.outcome]
        found.append(
            f"{stuck.part} is stuck among {', '.join(stuck.among[:_SHOWN])}: {words}. In its way: "
            f"{where or 'nothing but where it stands'}."
        )
    for fault in again.faults[:_SHOWN]:
        found.append(
            f"the replay disagrees: {fault.part} and {fault.by} share "
            f"{fault.thickness_m * 1000:.3g} mm round [{_words(fault.point_m)}] mm in step "
            f"{fault.step}."
        )
    for one in plan.subassemblies:
        found.append(f"{' and '.join(one)} are put together apart, as nothing else is possible.")
    return found


def _piece_lines(pieces: Mapping[str, Any]) -> list[str]:
    pairs = {
        " and ".join(sorted((one["part"], one["by"]))) for one in pieces.get("differences", ())
    }
    if not pairs:
        return []
    shown = "; ".join(sorted(pairs)[:_SHOWN])
    more = f"; and {len(pairs) - _SHOWN} more" if len(pairs) > _SHOWN else ""
    return [
        f"convex pieces block each other where the true meshes do not: {shown}{more}. "
        "report.json lists the directions."
    ]


def _limit_lines(limits: Mapping[str, list[str]]) -> list[str]:
    return [f"{name} {words}." for name, lines in limits.items() for words in lines]


def _words(point_m: Vector) -> str:
    return ", ".join(f"{value * 1000:.4g}" for value in point_m)
