"""What `skillplan import-cad` runs: read, find joints, test what blocks what, write."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError, name_hint
from skillplan.files.atomic_file import write_as_one
from skillplan.files.json_file import json_text
from skillplan.files.output_path import output_folder, refusing
from skillplan.records.schemas import IMPORT
from skillplan_cad.build_relation import waived_pairs
from skillplan_cad.importing.exploded import Draw
from skillplan_cad.importing.findings import Tell, found_in
from skillplan_cad.importing.planned import planned
from skillplan_cad.importing.report import report_document, warnings
from skillplan_cad.importing.settings import settings_of
from skillplan_cad.product import Product
from skillplan_cad.relation import Relation
from skillplan_cad.relation_file import relation_text


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
    path, folder = Path(source), output_folder("--out", out)
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
        "report.json": json_text(IMPORT, document) + "\n",
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
    with refusing("--out", folder):
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
