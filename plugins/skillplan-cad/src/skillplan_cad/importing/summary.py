"""Sum up an import: parts by reason, overlaps, parts that touch nothing, and the warnings."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import coal

from skillplan_cad.importing.findings import Doubt, Findings
from skillplan_cad.planning.shrunk_meshes import MeshTree
from skillplan_cad.product import Product
from skillplan_cad.relation import Contact, Relation, Sensitive

# Largest number of warnings of one kind that are printed.
_SHOWN = 3
# Largest gap that may be a clearance [m].
_CLEARANCE_M = 1e-3

NO_TASK = "no task"

WHY: Mapping[str, str] = {
    "stuck": "no searched motion frees it",
    "not examined": "not examined within the limits",
    "surface": "open surface without thickness",
    "sub-assembly": "comes together with others",
    "several moves": "comes by several moves",
    "hangs lower": "hangs lower than what stands",
    "not level": "no level face beneath: its fit holds it",
    "tips": "would tip over",
    "floats": "touches no other part",
    "from below": "is driven from below",
    "turns": "is tightened against nothing that holds",
    "follows": "needs a part that is left out",
    "too heavy": "too heavy for the arm",
    "no grasp": "no tool grasps it",
    "no head": "screw without a head",
    "no place": "no place within reach",
    "refused": "refused by check",
    "no order": "no order of all parts brings it",
    NO_TASK: "no task is written",
}
"""Kinds of reasons in words."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The distance of a part that touches nothing to the nearest other part."""

    part: str
    nearest: str
    gap_m: float


def measure_gaps(product: Product, relation: Relation) -> list[Gap]:
    """Return the gap of each part without contact."""
    touched = {name for contact in relation.contacts for name in contact.parts}
    loose = [part for part in product if part.name not in touched]
    if not loose or len(product) < 2:
        return []
    trees = {part.name: MeshTree(part.name, part.vertices_m, part.triangles) for part in product}
    return [_measure_gap(trees.pop(part.name), trees) for part in loose]


def _measure_gap(tree: MeshTree, others: dict[str, MeshTree]) -> Gap:
    """Return the smallest distance of a mesh to others, and put it among them."""
    boxes = {
        name: float(sum(max(0.0, *lows) ** 2 for lows in _list_box_gaps(tree, other)) ** 0.5)
        for name, other in others.items()
    }
    best = Gap(tree.name, "", float("inf"))
    for name in sorted(boxes, key=boxes.__getitem__):
        if boxes[name] >= best.gap_m:
            break
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        still = coal.Transform3s()
        gap_m = coal.distance(tree.tree, still, others[name].tree, still, request, result)
        if gap_m < best.gap_m:
            best = Gap(tree.name, name, max(0.0, float(gap_m)))
    others[tree.name] = tree
    return best


def _list_box_gaps(tree: MeshTree, other: MeshTree) -> list[tuple[float, float]]:
    """Return the gaps of two bounding boxes along x, y, z, from either side."""
    behind, ahead = other.low_m - tree.high_m, tree.low_m - other.high_m
    return [(float(a), float(b)) for a, b in zip(behind, ahead, strict=True)]


def build_gaps_document(gaps: Iterable[Gap]) -> list[dict[str, Any]]:
    """Return gaps as JSON."""
    return [
        {"part": gap.part, "nearest": gap.nearest, "gap_mm": round(gap.gap_m * 1000, 4)}
        for gap in gaps
    ]


def build_summary(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the number of parts, those of the task, and the others by reason, the most first.

    Parameters
    ----------
    document
        Fields of `report.json`.
    """
    names = [part["name"] for part in document["parts"]]
    in_task = [name for name in names if name in document.get("task_names", {})]
    nearest = {gap["part"]: gap["nearest"] for gap in document["gaps"]}
    why: dict[tuple[str, str], list[str]] = {}
    by: dict[tuple[str, str], Counter[str]] = {}
    for name in names:
        if name in document.get("task_names", {}):
            continue
        reason = document.get("left_out_why", {}).get(name, {"kind": NO_TASK, "by": []})
        kind = reason["kind"]
        # Refusals that differ in names and numbers alone are of one kind.
        words = document["left_out"][name] if kind == "refused" else ""
        key = kind, _NAMES_AND_NUMBERS.sub("", words)
        why.setdefault(key, []).append(name)
        causes = [nearest[name]] if kind == "floats" and name in nearest else reason["by"]
        by.setdefault(key, Counter()).update(causes)
    return {
        "parts": len(names),
        "in_task": in_task,
        "left_out": [
            {
                "kind": key[0],
                "why": _describe_kind(key[0], parts[0], document),
                "parts": parts,
                "by": [{"part": part, "count": n} for part, n in by[key].most_common()],
            }
            for key, parts in sorted(why.items(), key=lambda entry: -len(entry[1]))
        ],
    }


_NAMES_AND_NUMBERS = re.compile(r"'[^']*'|\d+(\.\d+)?")


def _describe_kind(kind: str, first: str, document: Mapping[str, Any]) -> str:
    """Return a kind of reason in words; for refusals with those of `check` on the first part."""
    if kind != "refused":
        return WHY.get(kind, kind)
    return f"{first} {document['left_out'][first]}"


def list_advice(document: Mapping[str, Any], relation: Relation, folder: str) -> list[str]:
    """Return the lines below the table of reasons: overlaps, and what to do next.

    Parameters
    ----------
    document
        Fields of `report.json` with the summary.
    folder
        Folder of the output files.
    """
    lines = []
    too_heavy = {
        name
        for name, reason in document.get("left_out_why", {}).items()
        if reason["kind"] == "too heavy"
    }
    overlaps = list_interferences(relation)
    if overlaps:
        lines.append(f"overlaps  {_describe_interferences(overlaps)}")
    stuck = next(
        (entry for entry in document["summary"]["left_out"] if entry["kind"] == "stuck"), None
    )
    name = stuck["parts"][0] if stuck else next(iter(relation.stuck), None)
    if name is not None:
        words = f"free({name})"
        file = shlex.quote(f"{folder}/relation.json")
        lines.append(f"explain   skillplan explain {file} {shlex.quote(words)}")
    heavy = [
        part["name"]
        for part in document["parts"]
        if part["material"] is None and part["name"] in too_heavy
    ]
    if heavy:
        more = f" and {len(heavy) - _SHOWN} more" if len(heavy) > _SHOWN else ""
        option = shlex.quote(f"{heavy[0]}=aluminium")
        lines.append(
            f"material  assumed for what is too heavy, {', '.join(heavy[:_SHOWN])}{more}: state it "
            f"by --material {option}, or abs, wood and others"
        )
    lines.append(f"details   {folder}/report.json, and to look at: {folder}/import.html")
    return lines


def list_interferences(relation: Relation) -> list[Contact]:
    """Return the contacts with more overlap than allowed, the largest first."""
    overlapping = [contact for contact in relation.contacts if contact.interferes]
    return sorted(overlapping, key=lambda contact: (-contact.overlap_m3, contact.parts))


def _describe_interferences(overlaps: Sequence[Contact]) -> str:
    count, largest = len(overlaps), overlaps[0]
    pairs = "1 pair overlaps" if count == 1 else f"{count} pairs overlap"
    return (
        f"{pairs} in the CAD, {'' if count == 1 else 'the largest '}{' and '.join(largest.parts)} "
        f"by {largest.overlap_m3 * 1e9:.4g} mm3, {largest.overlap_depth_m * 1e3:.2g} mm deep"
    )


def list_untouched(relation: Relation) -> list[str]:
    """Return the parts without contact."""
    touched = {name for contact in relation.contacts for name in contact.parts}
    return [name for name in relation.names if name not in touched]


def shorten_list(messages: Sequence[str], key: str) -> list[str]:
    """Return the first messages of one kind, and a line on the others.

    Parameters
    ----------
    key
        Key of `report.json` with all of them.
    """
    more = len(messages) - _SHOWN
    if more <= 0:
        return list(messages)
    are = "is" if more == 1 else "are"
    return [*messages[:_SHOWN], f"{more} more of this kind {are} in report.json under {key}."]


def list_warnings(findings: Findings, gaps: Sequence[Gap]) -> list[str]:
    """Return the warnings about a product, one sentence each, at most four of a kind."""
    product, relation = findings.product, findings.relation
    overlaps = [_warn_of_overlap(contact) for contact in list_interferences(relation)]
    messages = [
        *shorten_list(product.warnings, "warnings"),
        *shorten_list(overlaps, "interference"),
        *shorten_list([_warn_of_gap(gap) for gap in gaps], "gaps"),
    ]
    if relation.sensitive:
        messages.append(_warn_of_tolerance(relation.sensitive))
    if findings.unconfirmed:
        messages.append(
            f"{findings.unconfirmed} blockings were not confirmed by shrunk meshes in the time: "
            "they rest on rays alone."
        )
    doubts = [_warn_of_doubt(doubt, relation) for doubt in findings.doubts]
    return [*messages, *shorten_list(doubts, "doubts")]


def _warn_of_overlap(contact: Contact) -> str:
    at = ", ".join(f"{value * 1000:.4g}" for value in contact.overlap_point_m or ())
    why = f"of which chords explain {contact.overlap_allowed_m3 * 1e9:.3g}"
    return (
        f"{' and '.join(contact.parts)} overlap by {contact.overlap_m3 * 1e9:.4g} mm3 round "
        f"[{at}] mm, {contact.overlap_depth_m * 1e3:.2g} mm deep, {why}. Correct it in CAD, or "
        f"declare a fit: --press-fit {shlex.quote(','.join(contact.parts))}."
    )


def _warn_of_gap(gap: Gap) -> str:
    words = (
        f"{gap.part}: touches no other part; the nearest is {gap.nearest}, "
        f"{gap.gap_m * 1000:.3g} mm away"
    )
    if gap.gap_m > _CLEARANCE_M:
        return f"{words}, and nothing holds what floats."
    return f"{words}. If that is a clearance, a --tolerance above it makes it a contact."


def _warn_of_tolerance(answers: Sequence[Sensitive]) -> str:
    pairs = sorted({f"{answer.part} by {answer.by}" for answer in answers})
    more = f"; and {len(pairs) - _SHOWN} more" if len(pairs) > _SHOWN else ""
    return (
        f"half or double the tolerance changes {len(answers)} blockings: "
        f"{'; '.join(pairs[:_SHOWN])}{more}"
    )


def _warn_of_doubt(doubt: Doubt, relation: Relation) -> str:
    way = ", ".join(f"{value:.4g}" for value in relation.directions[doubt.direction])
    rays, meshes = ("blocks", "lets pass") if doubt.rays_say_blocked else ("lets pass", "blocks")
    return (
        f"{doubt.by} {rays} {doubt.part} along [{way}] by rays, which decide, and {meshes} it "
        "by shrunk meshes; try another --tolerance."
    )
