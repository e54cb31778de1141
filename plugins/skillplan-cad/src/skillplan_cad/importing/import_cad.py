"""What `skillplan import-cad` runs: read, find joints, test what blocks what, write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError, name_hint
from skillplan.files.atomic_file import write_as_one
from skillplan.files.json_file import format_document
from skillplan.files.output_path import check_output_folder, report_write_errors
from skillplan.records.schemas import IMPORT
from skillplan_cad.build_relation import waived_pairs
from skillplan_cad.importing.exploded import Draw
from skillplan_cad.importing.findings import Findings, Tell, found_in
from skillplan_cad.importing.planned import planned
from skillplan_cad.importing.settings import ImportSettings, settings_of
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import Contact, Relation
from skillplan_cad.relation_file import relation_text

# Doubts that are told one by one.
_NAMED = 4


def report_document(
    findings: Findings,
    waived: Sequence[tuple[str, str, int]],
    settings: ImportSettings,
    source: str,
) -> dict[str, Any]:
    """Return the report without the name of its schema; lengths are millimetres."""
    product, relation = findings.product, findings.relation
    return {
        "product": product.name,
        "source": source,
        "unit": product.unit,
        "chord_mm": _mm(product.chord_m),
        "tolerance_mm": settings.tolerance_mm,
        "directions": settings.directions,
        "threads": settings.threads,
        "notes": list(product.notes),
        "parts": [
            {
                "name": part.name,
                "design": part.design,
                "kind": known.kind,
                "mass_kg": known.mass_kg,
                "volume_mm3": round(part.volume_m3 * 1e9, 3),
                "centre_mm": _mm3(part.centre_m),
                "size_mm": [_mm(float(one)) for one in part.bounds_m[1] - part.bounds_m[0]],
                "triangles": len(part.triangles),
                "bodies": part.bodies,
                "free": [
                    list(relation.directions[number])
                    for number in range(len(relation.directions))
                    if not relation.blockers(part.name, number)
                ],
            }
            for part, known in zip(product.parts, relation.parts, strict=True)
        ],
        "interference": [
            {
                "parts": list(one.parts),
                "overlap_mm3": round(one.overlap_m3 * 1e9, 3),
                "allowed_mm3": round(one.overlap_allowed_m3 * 1e9, 3),
                "point_mm": _mm3(one.overlap_point_m or (0.0, 0.0, 0.0)),
            }
            for one in interferences(relation)
        ],
        "untouched": untouched(relation),
        "doubts": [
            {
                "part": one.part,
                "by": one.by,
                "direction": list(relation.directions[one.direction]),
                "rays_say_blocked": one.rays_say_blocked,
            }
            for one in findings.doubts
        ],
        "waived_threads": [
            {"part": part, "by": by, "direction": list(relation.directions[number])}
            for part, by, number in waived
        ],
    }


def interferences(relation: Relation) -> list[Contact]:
    """Return the contacts that overlap by more than is allowed, the largest first."""
    found = [one for one in relation.contacts if one.interferes]
    return sorted(found, key=lambda one: (-one.overlap_m3, one.parts))


def untouched(relation: Relation) -> list[str]:
    """Return the parts that touch no other."""
    touched = {name for one in relation.contacts for name in one.parts}
    return [name for name in relation.names if name not in touched]


def warnings(findings: Findings) -> list[str]:
    """Return what a user should know of a product, a sentence each."""
    product, relation = findings.product, findings.relation
    found = []
    for one in interferences(relation):
        at = ", ".join(f"{value * 1000:.4g}" for value in one.overlap_point_m or ())
        why = (
            f"of which chords explain {one.overlap_allowed_m3 * 1e9:.3g}"
            if product.chord_m
            else "and meshes state no chord that would explain it"
        )
        found.append(
            f"{one.parts[0]} and {one.parts[1]} overlap by {one.overlap_m3 * 1e9:.4g} mm3 round "
            f"[{at}] mm, {why}. If it is no press fit, mend it in CAD."
        )
    loose = untouched(relation)
    if loose:
        found.append(
            f"{', '.join(loose)}: touch{'es' if len(loose) == 1 else ''} no other part; nothing "
            "holds what floats."
        )
    if relation.sensitive:
        pairs = sorted({f"{one.part} by {one.by}" for one in relation.sensitive})
        shown = "; ".join(pairs[:6]) + (f"; and {len(pairs) - 6} more" if len(pairs) > 6 else "")
        found.append(
            f"half or double the tolerance says otherwise of {len(relation.sensitive)} blockings: "
            f"{shown}"
        )
    for doubt in findings.doubts[:_NAMED]:
        way = ", ".join(f"{value:.4g}" for value in relation.directions[doubt.direction])
        rays, meshes = (
            ("blocks", "lets pass") if doubt.rays_say_blocked else ("lets pass", "blocks")
        )
        found.append(
            f"{doubt.by} {rays} {doubt.part} along [{way}] by rays, which decide, and {meshes} it "
            "by shrunk meshes; try another --tolerance."
        )
    if len(findings.doubts) > _NAMED:
        found.append(f"{len(findings.doubts) - _NAMED} more such doubts stand in report.json")
    return found


def _mm(value_m: float) -> float:
    return round(value_m * 1000, 4) + 0.0


def _mm3(point_m: Vector) -> list[float]:
    return [_mm(one) for one in point_m]


@dataclass(frozen=True, slots=True)
class Imported:
    """What a command prints.

    Parameters
    ----------
    document
        Of `report.json`, without the name of its schema.
    lines
        What was found, in words.
    warnings
        What a user should know.
    complete
        Whether all parts come together by the moves that were searched.
    """

    document: dict[str, Any]
    lines: tuple[str, ...]
    warnings: tuple[str, ...]
    complete: bool = True


def import_cad(
    source: str, out: str, given: dict[str, Any], tell: Tell, draw: Draw | None = None
) -> Imported:
    """Import a product.

    Parameters
    ----------
    source
        A STEP file, or a folder of meshes.
    out
        A new folder, or an empty one.
    given
        Options by name; None for the default.
    tell
        Told of progress, a line each.
    draw
        Draws `exploded.png`; None for no picture.

    Raises
    ------
    OptionError
        If anything given is wrong; nothing is written.
    """
    settings = settings_of(given)
    path, folder = Path(source), check_output_folder("--out", out)
    findings = found_in(path, settings, tell)
    product, relation = findings.product, findings.relation
    if settings.base is not None and settings.base not in relation.names:
        raise OptionError(_no_base(settings.base, relation))
    made = planned(path, findings, settings, draw)
    relation = made.relation
    waived = waived_pairs(findings.joints, findings.blocked, settings.threads)
    document = report_document(findings, waived, settings, path.name)
    document |= made.document
    files = {
        "relation.json": relation_text(relation),
        "report.json": format_document(IMPORT, document) + "\n",
        **made.files,
    }
    write(folder, files)
    lines = (*_lines(product, relation), *made.lines)
    told = (*warnings(findings), *made.warnings)
    return Imported(document, lines, told, made.complete)


def write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write files into a folder that is new or empty: all of them, or none.

    Raises
    ------
    OptionError
        If they cannot be written.
    """
    with report_write_errors("--out", folder):
        within = {(folder / name).parent for name in files}
        made = [one for one in sorted({folder, *within}) if not one.exists()]
        for one in made:
            one.mkdir()
        try:
            write_as_one(folder, files, within=folder)
        except BaseException:
            for one in reversed(made):
                one.rmdir()
            raise


def _no_base(base: str, relation: Relation) -> str:
    return f"--base {base}: there is no such part. {name_hint(base, relation.names)}"


def _lines(product: Product, relation: Relation) -> tuple[str, ...]:
    kinds = [part.kind for part in relation.parts]
    counted = [
        f"{kinds.count(kind)} {kind}{'s' if kinds.count(kind) > 1 else ''}"
        for kind in ("screw", "nut", "washer", "pin")
        if kind in kinds
    ]
    shapes = len({part.shape for part in product.parts})
    free = sum(
        any(not relation.blockers(name, number) for number in range(len(relation.directions)))
        for name in relation.names
    )
    return (
        f"{product.name}: {len(product)} parts of {shapes} shapes"
        + (f", among them {', '.join(counted)}" if counted else ", none a fastener"),
        f"{len(relation.contacts)} contacts; {len(relation.blocked)} blockings along "
        f"{len(relation.directions)} directions; {free} parts are free at once",
        *product.notes,
    )
