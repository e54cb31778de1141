"""What `skillplan import-cad` makes of a relation: a plan, its replay, and a task."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from skillplan_cad.importing.attitude import attitude, attitude_document, attitude_warnings
from skillplan_cad.importing.exploded import Draw, added_bodies
from skillplan_cad.importing.findings import Findings
from skillplan_cad.importing.kept_plan import plan_bytes, plan_from, replay_bytes, replay_from
from skillplan_cad.importing.plan_document import (
    pieces_document,
    placement_document,
    plan_document,
)
from skillplan_cad.importing.settings import ImportSettings
from skillplan_cad.planning.assembly_plan import AssemblyPlan, Planner, with_groups
from skillplan_cad.planning.bearing import Bearing
from skillplan_cad.planning.replay import Replay, replay
from skillplan_cad.product import Product, Vector
from skillplan_cad.reading.mesh_folder import SUFFIXES as MESHES
from skillplan_cad.reading.product_reader import read_product
from skillplan_cad.reading.step_file import is_step
from skillplan_cad.relation import Relation
from skillplan_cad.relation_file import relation_text
from skillplan_cad.writing.task_document import task_of

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
