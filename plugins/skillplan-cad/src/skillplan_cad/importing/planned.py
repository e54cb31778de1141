"""Plan a product, replay the plan, and write its task."""

from __future__ import annotations

import hashlib
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from skillplan.robots.catalogue import DEFAULT_ARM
from skillplan_cad.build_relation import Joints
from skillplan_cad.importing.exploded import AddedBody, place_bodies
from skillplan_cad.importing.findings import Findings
from skillplan_cad.importing.settings import ImportSettings
from skillplan_cad.importing.summary import shorten_list
from skillplan_cad.nests.planned_nests import plan_nests
from skillplan_cad.planning.assembly_plan import AssemblyPlan, Planner, Step, Stuck, add_groups
from skillplan_cad.planning.bearing import ATTITUDES, Bearing, find_bearing, find_best_bearing
from skillplan_cad.planning.precedence import list_members
from skillplan_cad.planning.replay import Replay, replay
from skillplan_cad.planning.watch import Watch
from skillplan_cad.product import Product, Vector
from skillplan_cad.reading.product_reader import fits_pattern, read_finer
from skillplan_cad.relation import Contact, LeftOut, Relation
from skillplan_cad.relation_file import format_relation
from skillplan_cad.writing.arm_choice import (
    AUTO_ARM,
    choose_arm,
    find_longer_arm,
    list_screws_towards_arm,
)
from skillplan_cad.writing.build_task import build_task
from skillplan_cad.writing.grouped_task import build_grouped_task
from skillplan_cad.writing.held_part import GRIPPERS, KnownHolds, PartHolds
from skillplan_cad.writing.lanes import PLAY_M
from skillplan_cad.writing.pieces_proof import Cuts, ProvedPieces
from skillplan_cad.writing.task_document import TaskNest, WrittenTask
from skillplan_cad.writing.upright import Upright


def build_plan_document(plan: AssemblyPlan, again: Replay, relation: Relation) -> dict[str, Any]:
    """Return a plan as JSON; lengths in millimetres, vectors in the file's frame."""
    return {
        "base": plan.base,
        "why_base": plan.why_base,
        "complete": plan.complete,
        "cheapest": plan.cheapest,
        "cost": plan.cost,
        "steps": [_build_step(step) for step in plan.steps],
        "subassemblies": [list(subassembly) for subassembly in plan.subassemblies],
        "stuck": [_build_stuck(stuck, relation) for stuck in plan.stuck],
        "locks": [
            {
                "parts": [relation.names[part] for part in list_members(lock.parts)],
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
                    "absent": [relation.names[part] for part in list_members(alternative.blockers)],
                }
                for alternative in plan.precedence.list_minimal(number)
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


def _build_step(step: Step) -> dict[str, Any]:
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


def _build_stuck(stuck: Stuck, relation: Relation) -> dict[str, Any]:
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


def build_left_out_document(left_out: Mapping[str, LeftOut]) -> dict[str, Any]:
    """Return the parts outside the task as JSON, with the reasons."""
    return {
        "left_out": {name: reason.text for name, reason in left_out.items()},
        "left_out_why": {
            name: {"kind": reason.kind, "by": list(reason.by)} for name, reason in left_out.items()
        },
    }


def build_placement_document(upright: Upright) -> dict[str, Any]:
    """Return the pose of the product in the world of the task as JSON."""
    return {
        "turn": [[round(float(value), 9) + 0.0 for value in row] for row in upright.matrix],
        "offset_mm": [round(float(value) * 1000, 6) + 0.0 for value in upright.offset_m],
    }


def build_pieces_document(proved: ProvedPieces, relation: Relation) -> dict[str, Any]:
    """Return the number of convex pieces and the pairs that they block wrongly as JSON."""
    return {
        "counts": {name: sum(map(len, pieces)) for name, pieces in proved.pieces.items()},
        "cut_back": list(proved.cut_back),
        "fits": [
            {
                "part": fit.part,
                "into": fit.into,
                "drawn_mm": _mm(fit.drawn_m),
                "play_mm": _mm(fit.play_m),
                "outside_mm": _mm(fit.outside_m),
            }
            for fits in proved.fits.values()
            for fit in fits
        ],
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


def choose_attitude(
    product: Product, relation: Relation, up: str, *, holding: bool = False
) -> Bearing:
    """Return the supports with an axis of the file up, or with the best of them for `auto`."""
    if up == AUTO:
        return find_best_bearing(product, relation, holding=holding)
    return find_bearing(product, relation, ATTITUDES[up], holding=holding)


def build_attitude_document(bearing: Bearing) -> dict[str, Any]:
    """Return the up axis and the supports of each part as JSON."""
    return {
        "up": name_up_axis(bearing),
        "stands": [{"part": name, "on": list(bearing.on[name])} for name in bearing.order],
        "held": list(bearing.held),
        "turned": [
            {
                "up": _name_axis(up),
                "parts": [name for name, own in bearing.turned.items() if own == up],
            }
            for up in bearing.ups[1:]
        ],
    }


def list_attitude_warnings(
    product: Product, relation: Relation, bearing: Bearing, requested: str
) -> list[str]:
    """Return warnings about the side that is up, one sentence each."""
    count = len(bearing.order) + len(bearing.why_not)
    up, stand = name_up_axis(bearing), len(bearing.order)
    warnings = []
    stay = "stand by themselves"
    if bearing.held:
        stay = f"are placed, {len(bearing.held)} of them held,"
    if requested == AUTO and up != next(iter(ATTITUDES)):
        warnings.append(
            f"{up} points up, as then {stand} of {count} parts {stay} and the arm brings most; "
            "--up sets another."
        )
    holding = bool(bearing.held)
    best = bearing
    if requested != AUTO:
        best = find_best_bearing(product, relation, holding=holding)
    if len(best.order) > stand:
        warnings.append(
            f"with {up} up {stand} of {count} parts {stay.rstrip(',')}; with --up "
            f"{name_up_axis(best)} it would be {len(best.order)}."
        )
    if not stand:
        warnings.append(f"with {up} up no part stands by itself: all need a nest or a fixture.")
    return warnings


def name_up_axis(bearing: Bearing) -> str:
    """Return the up axis at the start as ``--up`` names it."""
    return _name_axis(bearing.up)


def _name_axis(vector: Vector) -> str:
    return next(name for name, up in ATTITUDES.items() if up == vector)


def list_turn_lines(task: WrittenTask, why: Mapping[str, LeftOut]) -> list[str]:
    """Return a line for each turn, with the parts that need it and the reason.

    Parameters
    ----------
    why
        Reasons why parts are left out without turns.
    """
    lines = []
    for up in task.bearing.ups[1:]:
        names = [n for n, own in task.bearing.turned.items() if own == up and n in task.names]
        needing: dict[str, list[str]] = {}
        for name in names:
            if name in why:
                needing.setdefault(why[name].text.partition(":")[0], []).append(name)
        reasons = [f"{_name_each(some)} {words}" for words, some in needing.items()]
        because = f"; without it {', and '.join(reasons)}" if reasons else ""
        lines.append(
            f"the product turns until {_name_axis(up)} points up, for {_name_first(names)}{because}"
        )
    if lines:
        turns = f"{len(lines)} turn{'s' * (len(lines) > 1)}"
        lines.append(f"the task has {turns}, the least of those tried")
    return lines


_PLAN, _REPLAY = TypeAdapter(AssemblyPlan), TypeAdapter(Replay)


def serialize_plan(plan: AssemblyPlan) -> bytes:
    """Serialize a plan."""
    return _PLAN.dump_json(plan)


def restore_plan(content: bytes) -> AssemblyPlan:
    """Restore a plan from `serialize_plan`."""
    return _PLAN.validate_json(content)


def serialize_replay(again: Replay) -> bytes:
    """Serialize a replay."""
    return _REPLAY.dump_json(again)


def restore_replay(content: bytes) -> Replay:
    """Restore a replay from `serialize_replay`."""
    return _REPLAY.validate_json(content)


# How the shape of a part differs from the drawing, by the kind of its fit.
_LOOSE = (
    f"is written with {PLAY_M * 1000:g} mm of play in its press fits, as no back end presses parts "
    "together"
)
_CHANGES = {
    "sunk": "is drawn sunk in a part that it sits on, and is written without this overlap",
    "pins in solid": "is drawn without holes for the pins of other parts, and is written with them",
}
# Reasons why no way out of a part was searched, by the outcome.
_NOT_EXAMINED = {
    "not searched": "was not examined in time",
    "no effort left": "was not examined, as other parts took the whole limit of work",
}
# Factor on the plan's chord and tolerance for the replay.
_FINER = 0.4
_SHOWN = 6
# Largest number of steps that are printed.
_MOST_STEPS = 12
_LEAST_PATTERN = 3
# Raised whenever the same relation gives another plan.
_PLAN_FORMAT = 4


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A plan with its documents, files and messages.

    Parameters
    ----------
    has_task
        True if `product.yaml` is among the files.
    document
        Fields of `report.json` about the plan.
    added
        Bodies in order of assembly, for pictures.
    files
        Contents of `product.yaml` and the meshes, if a part is left for the task, and of nests.
    """

    relation: Relation
    has_task: bool
    document: Mapping[str, Any]
    files: Mapping[str, str | bytes]
    lines: tuple[str, ...]
    warnings: tuple[str, ...]
    added: tuple[AddedBody, ...]


def plan_product(
    path: Path,
    findings: Findings,
    settings: ImportSettings,
    watch: Watch | None = None,
    writing: Watch | None = None,
) -> Planned:
    """Plan a product and write its task.

    Parameters
    ----------
    path
        Source of the product; read again for the replay.
    watch
        Progress reports, and requests to stop: parts that are not examined then are left out.
    writing
        The same for writing the task; default: `watch`.
    """
    watch = watch or Watch()
    writing = writing or watch
    product, relation = findings.relieved, findings.relation
    bearing = choose_attitude(product, relation, settings.up, holding=settings.holding)
    plan, again = _plan_and_replay(path, findings, settings, bearing, watch)
    document: dict[str, Any] = {"plan": build_plan_document(plan, again, relation)}
    files: dict[str, str | bytes] = {}
    warnings = _list_warnings(plan, again)
    lines = _list_lines(plan, again)
    without = _find_left_out(product, relation, plan, settings, warnings)
    if without:
        bearing = find_bearing(product, relation, bearing.up, without, holding=settings.holding)
    task = _write_task(findings, settings, plan, bearing, without, writing, lines)
    document["attitude"] = build_attitude_document(task.bearing)
    lines += list_turn_lines(task, {**bearing.why_not, **bearing.undriven})
    warnings += list_attitude_warnings(product, relation, task.bearing, settings.up)
    document |= build_left_out_document(task.left_out)
    if task.document:
        files |= task.files
        document |= _build_task_document(task, relation)
        lines += _describe_grippers(task)
        lines += _describe_order(task)
        nests = [*([task.nest] if task.nest is not None else []), *task.station_nests]
        if nests:
            document["nests"] = [dict(nest.entry) for nest in nests]
        for nest in nests:
            files |= nest.files
            lines.append(_describe_nest(nest))
        warnings += _list_task_warnings(task, document["pieces"])
    else:
        warnings.append("No part is left that one arm could place: no product.yaml is written.")
    if settings.nests:
        cut = plan_nests(findings.product, plan, writing)
        document["nests"] = [*document.get("nests", ()), *cut.entries]
        files |= cut.files
        lines += cut.lines
        warnings += cut.warnings
    return Planned(
        add_groups(relation, plan),
        bool(task.document),
        document,
        files,
        tuple(lines),
        tuple(warnings),
        tuple(place_bodies(product, plan, bearing.up)),
    )


def _find_left_out(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    settings: ImportSettings,
    warnings: list[str],
) -> dict[str, LeftOut]:
    """Return the parts that the task leaves out before any is tried; stuck ones also warn."""
    words = "is an open surface; --thickness MM makes it a sheet"
    without = {
        part.name: LeftOut(part.name, "surface", words)
        for part in product
        if part.closure == "surface" and settings.thickness_mm is None
    }
    stuck = list_stuck(plan, relation)
    warnings += shorten_list(
        [f"{name} is left out of the task: it {reason.text}." for name, reason in stuck.items()],
        "left_out",
    )
    return without | stuck


def _write_task(
    findings: Findings,
    settings: ImportSettings,
    plan: AssemblyPlan,
    bearing: Bearing,
    without: Mapping[str, LeftOut],
    writing: Watch,
    lines: list[str],
) -> WrittenTask:
    """Return the task of a plan for the arm that suits it; another arm than usual adds a line."""
    writing.tell("writing ...")
    product, relation, joints = findings.relieved, findings.relation, findings.joints
    tolerance_m = settings.tolerance_mm / 1000
    loose = joints.relieve(findings.product, tolerance_m, PLAY_M)
    remarks = list_thinned(findings.product, joints, tolerance_m, loose)
    arm, longer, known, cuts = settings.robot, None, KnownHolds(), Cuts()
    if arm == AUTO_ARM:
        placed = [part for part in loose if part.name in bearing.order]
        holds = PartHolds(loose, relation, plan.base, bearing.up, None, known)
        holds.choose(bearing)
        loads = holds.list_loads()
        arm = choose_arm(placed, bearing.up, loads) if placed else DEFAULT_ARM
        longer = find_longer_arm(arm, loads.values())
        if longer is not None and list_screws_towards_arm(relation, bearing):
            arm, longer = longer, arm
    ups = ATTITUDES.values() if settings.up == AUTO else ()
    task = build_task(
        loose,
        relation,
        plan,
        arm,
        bearing,
        without,
        remarks,
        (find_bearing(product, relation, up, without, holding=settings.holding) for up in ups),
        writing,
        longer,
        holding=settings.holding,
        turning=settings.turning,
        heading=True,
        known=known,
        cuts=cuts,
        nesting=settings.nesting,
    )
    first, arm = arm, task.document["robot"]["model"] if task.document else arm
    if arm != first:
        lines.append(f"arm {arm}: it brings parts that are out of reach of {first}")
    elif arm != settings.robot and arm != DEFAULT_ARM:
        lines.append(f"arm {arm}: it carries or reaches more of the parts than {DEFAULT_ARM}")
    grouped = build_grouped_task(
        loose,
        relation,
        plan,
        task,
        arm,
        without,
        remarks,
        writing,
        cuts,
        holding=settings.holding,
        nesting=settings.nesting,
    )
    if grouped is not task:
        wholes = [key for key, part in grouped.document["parts"].items() if "made_of" in part]
        lines.append(f"built at stations of their own, then placed as one: {', '.join(wholes)}")
    return grouped


def list_thinned(
    product: Product, joints: Joints, tolerance_m: float, loose: Product
) -> dict[str, tuple[str, ...]]:
    """Return clauses on the parts that have less material than drawn, by name.

    Parameters
    ----------
    loose
        The product with all of these thinned.
    """
    contacts_of: dict[str, list[Contact]] = {}
    for contact in joints.contacts:
        if contact.fit is not None and contact.kind != "thread":
            words = _CHANGES.get(contact.fit.kind, _LOOSE)
            contacts_of.setdefault(words, []).append(contact)
    remarks: dict[str, tuple[str, ...]] = {}
    for words, contacts in contacts_of.items():
        thinned = loose
        if len(contacts_of) > 1:
            some = replace(joints, contacts=tuple(contacts))
            thinned = some.relieve(product, tolerance_m, PLAY_M)
        for drawn, thinner in zip(product, thinned, strict=True):
            if drawn is not thinner:
                remarks[drawn.name] = (*remarks.get(drawn.name, ()), words)
    return remarks


def _describe_nest(nest: TaskNest) -> str:
    size = " x ".join(f"{value:.0f}" for value in nest.entry["size_mm"])
    return (
        f"{nest.seated[0]} {nest.reason}: it stands in a nest of {size} mm, to be printed from "
        f"{nest.entry['files']['stl']}; --no-nests leaves it on the table"
    )


def list_stuck(plan: AssemblyPlan, relation: Relation) -> dict[str, LeftOut]:
    """Return the stuck parts that the plan does without, with options that may help."""
    reasons: dict[str, LeftOut] = {}
    stuck_of = {stuck.part: stuck for stuck in plan.stuck}
    overlapping = {frozenset(contact.parts) for contact in relation.contacts if contact.interferes}
    for name in plan.withdrawn:
        stuck = stuck_of[name]
        by = tuple(met.part for met in stuck.search.in_the_way) or stuck.among[:_SHOWN]
        shown = " and ".join(by[:_SHOWN])
        if stuck.search.outcome in _NOT_EXAMINED:
            words = f"{_NOT_EXAMINED[stuck.search.outcome]}: straight moves are blocked by {shown}"
            reasons[name] = LeftOut(name, "not examined", words, by)
            continue
        overlapped = [other for other in by if frozenset((name, other)) in overlapping]
        words = f"is stuck in {' and '.join(overlapped[:_SHOWN]) or shown}"
        advice = [f"--leave-out {shlex.quote(name)}"]
        for other in overlapped[:1] or by[:1]:
            pattern = find_common_pattern((name, other), relation.names)
            if pattern is not None:
                advice.insert(0, f"--as-one {shlex.quote(pattern)} if they are bought as one part")
        if overlapped:
            advice.append(
                f"--press-fit {shlex.quote(f'{name},{overlapped[0]}')} if it is pressed in"
            )
        reasons[name] = LeftOut(name, "stuck", f"{words}; try {', or '.join(advice)}", by)
    return reasons


def find_common_pattern(pair: tuple[str, str], names: Sequence[str]) -> str | None:
    """Return a pattern for `--as-one` that fits two names and no other, or None."""
    words = [name.rpartition("/")[2] for name in pair]
    starts = _find_common_start(*words)
    ends = _find_common_start(*(word[::-1] for word in words))[::-1]
    above = [name.rpartition("/")[0] for name in pair]
    patterns = [f"{escape_pattern(starts)}*", f"*{escape_pattern(ends)}"]
    if above[0] == above[1] and above[0]:
        patterns.append(f"{escape_pattern(above[0])}/*")
    for pattern in patterns:
        if len(pattern) > _LEAST_PATTERN and {
            name for name in names if fits_pattern(name, pattern)
        } == set(pair):
            return pattern
    return None


def _find_common_start(first: str, second: str) -> str:
    pairs = takewhile(lambda pair: pair[0] == pair[1], zip(first, second, strict=False))
    return "".join(letter for letter, _ in pairs)


def escape_pattern(text: str) -> str:
    """Return a text as a pattern that fits nothing else."""
    return re.sub(r"([*?[])", r"[\1]", text)


def _build_task_document(task: WrittenTask, relation: Relation) -> dict[str, Any]:
    return {
        "task_names": dict(task.names),
        "in_place": list(task.in_place),
        "placement": build_placement_document(task.upright),
        "pieces": build_pieces_document(task.pieces, relation),
        "limits": {name: list(lines) for name, lines in task.limits.items()},
        "task_order": {"skills": list(task.skills), "doubt": task.doubt},
    }


def _describe_grippers(task: WrittenTask) -> list[str]:
    """Return a line on each gripper of the catalogue, with the parts that it holds."""
    lines = []
    for gripper in GRIPPERS:
        holds = {own for own, part in task.document["parts"].items() if part.get("tool") == gripper}
        names = [name for name, own in task.names.items() if own in holds]
        if names:
            lines.append(f"gripper {gripper}: lighter tools do not hold {_name_first(names)}")
    return lines


def _describe_order(task: WrittenTask) -> list[str]:
    """Return a line on the order of the task, unless no back end could check it."""
    if task.skills:
        return [f"swept accepts an order of the whole task, {len(task.skills)} skills"]
    if task.doubt:
        return [f"an order of the whole task is not known: {task.doubt}"]
    return []


def _plan_and_replay(
    path: Path, findings: Findings, settings: ImportSettings, bearing: Bearing, watch: Watch
) -> tuple[AssemblyPlan, Replay]:
    """Return a plan and its replay with other meshes, from the cache if possible."""
    product, relation = findings.relieved, findings.relation
    tolerance_m = settings.tolerance_mm / 1000
    grounded = [name for name in bearing.order if not bearing.on[name]]
    content, plan_hash = findings.stages.run(
        "planning",
        {
            "product": findings.read_hash,
            "relation": hashlib.sha256(format_relation(relation).encode()).hexdigest(),
            "tolerance_m": tolerance_m,
            "base": settings.base,
            "up": bearing.up,
            "grounded": grounded,
            "format": _PLAN_FORMAT,
        },
        lambda: serialize_plan(
            Planner(product, relation, tolerance_m, watch=watch).plan(
                settings.base, bearing.up, grounded
            )
        ),
        watch.must_stop,
    )
    plan = restore_plan(content)

    def replayed() -> bytes:
        if watch.must_stop():
            return serialize_replay(Replay(0, (), (), False))
        finer = read_finer(path, findings.product, settings.reading, _FINER)
        same = any(part in findings.product.parts for part in finer)
        share = 1.0 if same else _FINER
        finer = findings.joints.relieve(finer, tolerance_m)
        return serialize_replay(replay(finer, relation, plan, share * tolerance_m, watch))

    content, _ = findings.stages.run(
        "replaying the plan with other meshes",
        {"product": findings.read_hash, "plan": plan_hash, "tolerance_m": tolerance_m},
        replayed,
        watch.must_stop,
    )
    return plan, restore_replay(content)


def _list_lines(plan: AssemblyPlan, again: Replay) -> list[str]:
    order = [
        f"{first} with {_name_first(others)}" if others else first
        for first, *others in (step.parts for step in plan.steps)
    ]
    turns = sum(step.turn for step in plan.steps)
    lines = [f"base {plan.base}: {plan.why_base}"]
    if order:
        more = len(order) - _MOST_STEPS
        end = f" and {more} more (report.json: plan)" if more > 0 else ""
        lines.append(f"order: {', '.join([plan.base, *order[:_MOST_STEPS]])}{end}")
        lines.append(
            f"plan of the product in CAD: {turns} turn{'' if turns == 1 else 's'}; "
            + ("no order costs less" if plan.cheapest else "the best order of those searched")
            + (
                f"; a replay of exact solids in {again.samples} placements agrees"
                if again.agrees
                else ""
            )
        )
    return lines


def _list_warnings(plan: AssemblyPlan, again: Replay) -> list[str]:
    """Return the warnings about a plan, at most four of a kind."""
    faults = [
        f"the replay disagrees: {fault.part} and {fault.by} share "
        f"{fault.thickness_m * 1000:.3g} mm round [{_format_point(fault.point_m)}] mm in step "
        f"{fault.step}."
        for fault in again.faults
    ]
    separate = [
        f"{_name_first(subassembly)} are assembled separately, as no other order is possible."
        for subassembly in plan.subassemblies
    ]
    return [
        *shorten_list([_warn_of_stuck(stuck) for stuck in plan.stuck], "plan.stuck"),
        *shorten_list(faults, "plan.replay"),
        *shorten_list(separate, "plan.subassemblies"),
    ]


def _warn_of_stuck(stuck: Stuck) -> str:
    where = "; ".join(
        f"{met.part} at [{', '.join(f'{value * 1000:.4g}' for value in met.point_m)}] mm"
        for met in stuck.search.in_the_way[:_SHOWN]
    )
    words = {
        "closed": "no straight move, path or turn that was searched leads out",
        "budget spent": f"no way out was found (iterations: {stuck.search.iterations})",
        "not searched": "only straight moves were examined",
        "no effort left": "only straight moves were examined",
    }[stuck.search.outcome]
    return (
        f"{stuck.part} is stuck among {_name_first(stuck.among)}: {words}. In its way: "
        f"{where or 'no other part'}."
    )


def _name_first(names: Sequence[str]) -> str:
    """Return the first of some names in words, and the number of the others."""
    few = _SHOWN // 2
    shown = names if len(names) <= few else (*names[:few], f"{len(names) - few} more")
    return f"{', '.join(shown[:-1])} and {shown[-1]}" if shown[1:] else "".join(shown)


def _name_each(names: Sequence[str]) -> str:
    """Return the subject of a clause about each of some names."""
    return f"each of {_name_first(names)}" if len(names) > 1 else names[0]


def _list_piece_warnings(pieces: Mapping[str, Any]) -> list[str]:
    pairs = {" and ".join(sorted((pair["part"], pair["by"]))) for pair in pieces["differences"]}
    if not pairs:
        return []
    shown = "; ".join(sorted(pairs)[:_SHOWN])
    more = f"; and {len(pairs) - _SHOWN} more" if len(pairs) > _SHOWN else ""
    return [
        f"convex pieces block each other where the true meshes do not: {shown}{more}. "
        "report.json lists the directions."
    ]


def _list_task_warnings(task: WrittenTask, pieces: Mapping[str, Any]) -> list[str]:
    names_of: dict[str, list[str]] = {}
    for name, lines in task.limits.items():
        for words in lines:
            names_of.setdefault(words, []).append(name)
    limits = [f"{_name_each(names)} {words}." for words, names in names_of.items()]
    return [
        *(f"check refuses product.yaml: {words}" for words in task.faults),
        *([f"the base has no nest: {task.why_no_nest}."] if task.why_no_nest else []),
        *shorten_list(limits, "limits"),
        *_list_piece_warnings(pieces),
    ]


def _format_point(point_m: Vector) -> str:
    return ", ".join(f"{value * 1000:.4g}" for value in point_m)
