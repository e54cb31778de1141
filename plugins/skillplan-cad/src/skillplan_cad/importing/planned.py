"""Plan a product, replay the plan, and write its task."""

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
    """Return a plan as JSON; lengths in millimetres, vectors in the file's frame."""
    return {
        "base": plan.base,
        "why_base": plan.why_base,
        "complete": plan.complete,
        "cheapest": plan.cheapest,
        "cost": plan.cost,
        "steps": [_step(step) for step in plan.steps],
        "subassemblies": [list(subassembly) for subassembly in plan.subassemblies],
        "stuck": [_stuck(stuck, relation) for stuck in plan.stuck],
        "locks": [
            {
                "parts": [relation.names[part] for part in members(lock.parts)],
                "rounds": [[relation.names[part] for part in walk] for walk in lock.rounds],
            }
            for lock in plan.locks
        ],
        "precedence": {
            name: [
                {
                    "directions": [
                        list(relation.directions[direction])
                        for direction in alternative.directions
                        if direction < len(relation.directions)
                    ],
                    "absent": [relation.names[part] for part in members(alternative.blockers)],
                }
                for alternative in plan.precedence.minimal(number)
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
    """Return the pose of the product in the world of the task as JSON."""
    return {
        "turn": [[round(float(value), 9) + 0.0 for value in row] for row in upright.matrix],
        "offset_mm": [round(float(value) * 1000, 6) + 0.0 for value in upright.offset_m],
    }


def pieces_document(proved: ProvedPieces, relation: Relation) -> dict[str, Any]:
    """Return the number of convex pieces and the pairs that they block wrongly as JSON."""
    return {
        "counts": {name: sum(map(len, pieces)) for name, pieces in proved.pieces.items()},
        "cut_back": list(proved.cut_back),
        "differences": [
            {
                "part": difference.part,
                "by": difference.by,
                "direction": list(relation.directions[difference.direction]),
            }
            for difference in proved.differences
        ],
    }


def _mm3(point_m: Vector) -> list[float]:
    return [_mm(value) for value in point_m]


def _mm(value_m: float) -> float:
    return round(value_m * 1000, 4) + 0.0


AUTO = "auto"


def attitude(product: Product, relation: Relation, up: str) -> Bearing:
    """Return the supports with an axis of the file up, or with the best of them for `auto`."""
    if up == AUTO:
        return best_bearing(product, relation)
    return bearing_of(product, relation, ATTITUDES[up])


def attitude_document(bearing: Bearing) -> dict[str, Any]:
    """Return the up axis and the supports of each part as JSON."""
    return {
        "up": axis_of(bearing),
        "stands": [{"part": name, "on": list(bearing.on[name])} for name in bearing.order],
    }


def attitude_warnings(
    product: Product, relation: Relation, bearing: Bearing, requested: str
) -> list[str]:
    """Return warnings about the side that is up, one sentence each."""
    count = len(bearing.order) + len(bearing.why_not)
    up, stand = axis_of(bearing), len(bearing.order)
    warnings = []
    if requested == AUTO and up != next(iter(ATTITUDES)):
        warnings.append(
            f"{up} points up, as then {stand} of {count} parts stand by themselves, more than with "
            "any other axis; --up sets another."
        )
    best = bearing if requested == AUTO else best_bearing(product, relation)
    if len(best.order) > stand:
        warnings.append(
            f"with {up} up {stand} of {count} parts stand by themselves; with --up "
            f"{axis_of(best)} it would be {len(best.order)}."
        )
    if not stand:
        warnings.append(
            f"with {up} up no part stands on a level face. All are in product.yaml, and no order "
            "of them is feasible until a nest holds the first."
        )
    return warnings


def axis_of(bearing: Bearing) -> str:
    """Return the up axis as ``--up`` names it."""
    return next(name for name, up in ATTITUDES.items() if up == bearing.up)


_PLAN, _REPLAY = TypeAdapter(AssemblyPlan), TypeAdapter(Replay)


def plan_bytes(plan: AssemblyPlan) -> bytes:
    """Serialize a plan."""
    return _PLAN.dump_json(plan)


def plan_from(content: bytes) -> AssemblyPlan:
    """Restore a plan from `plan_bytes`."""
    return _PLAN.validate_json(content)


def replay_bytes(again: Replay) -> bytes:
    """Serialize a replay."""
    return _REPLAY.dump_json(again)


def replay_from(content: bytes) -> Replay:
    """Restore a replay from `replay_bytes`."""
    return _REPLAY.validate_json(content)


# Factor on the plan's chord and tolerance for the replay.
_FINER = 0.4
_SHOWN = 6


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A plan with its documents, files and messages.

    Parameters
    ----------
    relation
        Relation with sub-assemblies and stuck parts.
    complete
        True if all parts are assembled.
    document
        Fields of `report.json` about the plan.
    files
        Contents of `product.yaml` and the meshes; empty if parts are stuck.
    lines, warnings
        Messages for people.
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
    """Plan a product and write its task.

    Parameters
    ----------
    path
        Source of the product; read again for the replay.
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
    warnings = []
    if plan.complete:
        document["attitude"] = attitude_document(bearing)
        warnings += attitude_warnings(product, relation, bearing, settings.up)
        task = task_of(product, relation, plan, settings.robot, bearing)
        document["left_out"] = dict(bearing.why_not if task is None else task.left_out)
        warnings += [
            f"{name} is left out: it {words}." for name, words in document["left_out"].items()
        ]
        if task is None:
            warnings.append("No part is left that one arm could place: no product.yaml is written.")
        else:
            files |= task.files
            document["task_names"] = dict(task.names)
            document["placement"] = placement_document(task.upright)
            document["pieces"] = pieces_document(task.pieces, relation)
            document["limits"] = {name: list(lines) for name, lines in task.limits.items()}
            warnings += [f"check refuses product.yaml: {words}" for words in task.faults]
    limits = document.get("limits", {})
    return Planned(
        with_groups(relation, plan),
        plan.complete,
        document,
        files,
        tuple(_lines(plan, again)),
        (
            *_warnings(plan, again),
            *warnings,
            *_limit_lines(limits),
            *_piece_lines(document.get("pieces", {})),
        ),
    )


def _plan_and_replay(
    path: Path, findings: Findings, settings: ImportSettings, bearing: Bearing
) -> tuple[AssemblyPlan, Replay]:
    """Return a plan and its replay with other meshes, from the cache if possible."""
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
    """Return the product with a finer tessellation, or the same product for meshes."""
    if path.suffix.lower() in MESHES or not is_step(path):
        return product
    reading = settings.reading
    return read_product(path, replace(reading, chord_m=_FINER * reading.chord_m))


def _lines(plan: AssemblyPlan, again: Replay) -> list[str]:
    order = [" with ".join(step.parts) for step in plan.steps]
    turns = sum(step.turn for step in plan.steps)
    lines = [f"base {plan.base}: {plan.why_base}"]
    if order:
        lines.append(f"order: {plan.base}, {', '.join(order)}")
        lines.append(
            f"{turns} turn{'' if turns == 1 else 's'} of the product; "
            + ("no order costs less" if plan.cheapest else "the best order of those searched")
            + (
                f"; a replay of exact solids in {again.samples} placements agrees"
                if again.agrees
                else ""
            )
        )
    return lines


def _warnings(plan: AssemblyPlan, again: Replay) -> list[str]:
    warnings = []
    for stuck in plan.stuck:
        where = "; ".join(
            f"{met.part} at [{', '.join(f'{value * 1000:.4g}' for value in met.point_m)}] mm"
            for met in stuck.search.in_the_way[:_SHOWN]
        )
        words = {
            "closed": "no straight move, path or turn that was searched leads out",
            "budget spent": f"no way out was found in {stuck.search.iterations} iterations",
        }[stuck.search.outcome]
        warnings.append(
            f"{stuck.part} is stuck among {', '.join(stuck.among[:_SHOWN])}: {words}. In its way: "
            f"{where or 'no other part'}."
        )
    for fault in again.faults[:_SHOWN]:
        warnings.append(
            f"the replay disagrees: {fault.part} and {fault.by} share "
            f"{fault.thickness_m * 1000:.3g} mm round [{_words(fault.point_m)}] mm in step "
            f"{fault.step}."
        )
    for subassembly in plan.subassemblies:
        warnings.append(
            f"{' and '.join(subassembly)} are assembled separately, as no other order is possible."
        )
    return warnings


def _piece_lines(pieces: Mapping[str, Any]) -> list[str]:
    pairs = {
        " and ".join(sorted((pair["part"], pair["by"]))) for pair in pieces.get("differences", ())
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
