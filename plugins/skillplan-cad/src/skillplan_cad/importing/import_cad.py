"""Run `skillplan import-cad`: read, find joints, test blocking, plan, write."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError, name_hint
from skillplan.files.atomic_file import write_as_one
from skillplan.files.json_file import format_document
from skillplan.files.output_path import check_output_folder, report_write_errors
from skillplan.records.schemas import IMPORT
from skillplan_cad.build_relation import list_waived_pairs
from skillplan_cad.importing.exploded import Draw
from skillplan_cad.importing.findings import Findings, Tell, analyse_product, analyse_units
from skillplan_cad.importing.planned import plan_product
from skillplan_cad.importing.settings import ImportSettings, parse_settings
from skillplan_cad.importing.summary import (
    Gap,
    build_gaps_document,
    build_summary,
    list_advice,
    list_interferences,
    list_untouched,
    list_warnings,
    measure_gaps,
)
from skillplan_cad.planning.watch import Attempt, Watch, call_at_once
from skillplan_cad.product import Product, Vector
from skillplan_cad.reading.names import decode_file_name
from skillplan_cad.relation import Relation
from skillplan_cad.relation_file import build_relation_document, format_relation

# Largest number of fits printed one by one.
_NAMED = 4
# Shares of the time limit after which stages stop; the rest is for the pictures.
_CONFIRMING_SHARE, _PLANNING_SHARE, _WRITING_SHARE = 0.15, 0.4, 0.9


def build_report(
    findings: Findings,
    waived: Sequence[tuple[str, str, int]],
    settings: ImportSettings,
    source: str,
    gaps: Sequence[Gap] = (),
) -> dict[str, Any]:
    """Return the report without its schema and summary; lengths in millimetres."""
    product, relation = findings.product, findings.relation
    return {
        "product": product.name,
        "source": source,
        "unit": product.unit,
        "chord_mm": _mm(product.chord_m),
        "tolerance_mm": settings.tolerance_mm,
        "directions": settings.directions,
        "threads": settings.threads,
        "notes": [*product.notes, *findings.joints.notes],
        "warnings": list(product.warnings),
        "parts": _describe_parts(findings),
        **_describe_overlaps(relation),
        "untouched": list_untouched(relation),
        "gaps": build_gaps_document(gaps),
        "doubts": [
            {
                "part": doubt.part,
                "by": doubt.by,
                "direction": list(relation.directions[doubt.direction]),
                "rays_say_blocked": doubt.rays_say_blocked,
            }
            for doubt in findings.doubts
        ],
        "waived_threads": [
            {"part": part, "by": by, "direction": list(relation.directions[number])}
            for part, by, number in waived
        ],
    }


def _describe_parts(findings: Findings) -> list[dict[str, Any]]:
    product, relation = findings.product, findings.relation
    return [
        {
            "name": part.name,
            "design": part.design,
            "kind": known.kind,
            "mass_kg": known.mass_kg,
            "density_kg_m3": part.density_kg_m3,
            "material": findings.materials.get(part.name),
            "volume_mm3": round(part.volume_m3 * 1e9, 3),
            "centre_mm": _mm3(part.centre_m),
            "size_mm": [_mm(float(extent)) for extent in part.bounds_m[1] - part.bounds_m[0]],
            "triangles": len(part.triangles),
            "bodies": part.bodies,
            "closure": part.closure,
            "gap_mm": _mm(part.gap_m),
            "free": [
                list(relation.directions[number])
                for number in range(len(relation.directions))
                if not relation.blockers(part.name, number)
            ],
        }
        for part, known in zip(product.parts, relation.parts, strict=True)
    ]


def _describe_overlaps(relation: Relation) -> dict[str, Any]:
    """Return interferences and fits, as keys of the report."""
    return {
        "interference": [
            {
                "parts": list(interference.parts),
                "overlap_mm3": round(interference.overlap_m3 * 1e9, 3),
                "allowed_mm3": round(interference.overlap_allowed_m3 * 1e9, 3),
                "depth_mm": _mm(interference.overlap_depth_m),
                "point_mm": _mm3(interference.overlap_point_m or (0.0, 0.0, 0.0)),
            }
            for interference in list_interferences(relation)
        ],
        "fits": [
            {
                "parts": list(contact.parts),
                "kind": contact.fit.kind,
                "depth_mm": _mm(contact.fit.depth_m),
                "allowed_mm": _mm(contact.fit.allowed_m),
                "volume_mm3": round(contact.fit.volume_m3 * 1e9, 3),
            }
            for contact in relation.contacts
            if contact.fit is not None
        ],
    }


def _mm(value_m: float) -> float:
    return round(value_m * 1000, 4) + 0.0


def _mm3(point_m: Vector) -> list[float]:
    return [_mm(value) for value in point_m]


@dataclass(frozen=True, slots=True)
class Imported:
    """The output of the command.

    Parameters
    ----------
    document
        Fields of `report.json`, without its schema.
    lines
        Findings and the order of assembly.
    advice
        Overlaps that are left, and where to read on.
    complete
        True if a task is written.
    """

    document: dict[str, Any]
    lines: tuple[str, ...]
    warnings: tuple[str, ...]
    advice: tuple[str, ...] = ()
    complete: bool = True


@contextmanager
def _never_stop() -> Iterator[Callable[[float], bool]]:
    yield lambda share: False


def import_cad(
    source: str,
    out: str,
    given: dict[str, Any],
    tell: Tell,
    draw: Draw | None = None,
    stopping: Callable[[], AbstractContextManager[Callable[[float], bool]]] = _never_stop,
    attempt: Attempt = call_at_once,
    measure_share: Callable[[], float] = lambda: 0.0,
) -> Imported:
    """Import a product.

    Parameters
    ----------
    source
        STEP file, or folder of meshes.
    given
        Options by name; None for the default.
    draw
        Draws the pictures and the page; None for none.
    stopping
        Returns a context for confirming, planning and writing, with a function that returns True
        once a share of the time limit is over, or after Ctrl-C.
    attempt
        Calls a function and interrupts it at a share of the time limit; then it returns None.
    measure_share
        Returns the share of the time limit that is over.

    Raises
    ------
    OptionError
        If an input is invalid; no file is written then.
    """
    settings = parse_settings(given)
    path, folder = Path(source), check_output_folder("--out", out)

    @contextmanager
    def confirming() -> Iterator[Callable[[], bool]]:
        with stopping() as must_stop:
            yield partial(must_stop, _CONFIRMING_SHARE)

    findings, settings = analyse_units(
        lambda settings: analyse_product(path, settings, tell, confirming), settings
    )
    product, relation = findings.product, findings.relation
    if settings.base is not None and settings.base not in relation.names:
        raise OptionError(_describe_missing_base(settings.base, relation))
    with stopping() as must_stop:
        planning, writing = (
            Watch(tell, must_stop, attempt, measure_share, share)
            for share in (_PLANNING_SHARE, _WRITING_SHARE)
        )
        plan = plan_product(path, findings, settings, planning, writing)
    relation = plan.relation
    waived = list_waived_pairs(findings.joints, findings.blocked, settings.threads)
    gaps = measure_gaps(product, relation)
    document = build_report(findings, waived, settings, decode_file_name(path), gaps)
    document |= plan.document
    document["summary"] = build_summary(document)
    files: dict[str, str | bytes] = {
        "relation.json": format_relation(relation),
        "report.json": format_document(IMPORT, document) + "\n",
        **plan.files,
    }
    if draw is not None:
        files |= draw(document, build_relation_document(relation), plan.added)
    write(folder, files)
    lines = (*_list_findings(product, relation), *findings.joints.notes, *plan.lines)
    messages = (*list_warnings(findings, gaps), *plan.warnings)
    advice = tuple(list_advice(document, relation, out))
    return Imported(document, lines, messages, advice, plan.has_task)


def write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write all files into a new or empty folder, or none.

    Raises
    ------
    OptionError
        If writing fails.
    """
    with report_write_errors("--out", folder):
        within = {(folder / name).parent for name in files}
        new_folders = [
            new_folder for new_folder in sorted({folder, *within}) if not new_folder.exists()
        ]
        for new_folder in new_folders:
            new_folder.mkdir()
        try:
            write_as_one(folder, files, within=folder)
        except BaseException:
            for new_folder in reversed(new_folders):
                new_folder.rmdir()
            raise


def _describe_missing_base(base: str, relation: Relation) -> str:
    return f"--base {base}: there is no such part. {name_hint(base, relation.names)}"


def _list_findings(product: Product, relation: Relation) -> tuple[str, ...]:
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
        *_list_fits(relation),
        *product.notes,
    )


def _list_fits(relation: Relation) -> list[str]:
    """Return the number of fits of each kind, and the deepest of each kind, one line each."""
    fits = [
        (contact.fit, contact.parts) for contact in relation.contacts if contact.fit is not None
    ]
    fits.sort(key=lambda item: (-item[0].depth_m, item[1]))
    kinds = [fit.kind for fit, _ in fits]
    shown = fits if len(fits) <= _NAMED else [fits[kinds.index(kind)] for kind in sorted({*kinds})]
    lines = [
        f"{fit.kind}: {first} and {second} overlap by {fit.depth_m * 1e3:.3g} mm on each side, "
        f"{fit.volume_m3 * 1e9:.5g} mm3"
        + (f"; up to {fit.allowed_m * 1e3:.3g} mm is a fit" if fit.allowed_m > fit.depth_m else "")
        for fit, (first, second) in shown
    ]
    if len(fits) > _NAMED:
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in sorted({*kinds}))
        lines.insert(
            0,
            f"{len(fits)} overlaps count as fits that CAD draws on purpose: {counts}; report.json "
            "lists them, and the deepest of each kind follow",
        )
    return lines
