"""What `report.json` says of a plan and of the task that is written; lengths are millimetres."""

from __future__ import annotations

from typing import Any

from skillplan_cad.planning.assembly_plan import AssemblyPlan, Step, Stuck
from skillplan_cad.planning.precedence import members
from skillplan_cad.planning.replay import Replay
from skillplan_cad.product import Vector
from skillplan_cad.relation import Relation
from skillplan_cad.writing.pieces_proof import ProvedPieces
from skillplan_cad.writing.upright import Upright


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
