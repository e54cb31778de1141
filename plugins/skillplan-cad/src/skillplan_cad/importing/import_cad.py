"""What `skillplan import-cad` runs: read, find joints, test what blocks what, write."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_as_one
from skillplan.files.json_file import json_text
from skillplan.files.output_path import output_folder, refusing
from skillplan.files.regular_file import is_folder, read_bytes
from skillplan.records.schemas import IMPORT
from skillplan_cad.build_relation import (
    Blocked,
    Joints,
    blocked_of,
    joints_of,
    relation_of,
    waived_pairs,
)
from skillplan_cad.importing.kept_findings import (
    blocked_bytes,
    blocked_from,
    joints_bytes,
    joints_from,
)
from skillplan_cad.importing.kept_product import product_bytes, product_of
from skillplan_cad.importing.kept_stages import KeptStages
from skillplan_cad.importing.planned import planned
from skillplan_cad.importing.report import report_document, warnings
from skillplan_cad.importing.settings import ImportSettings, settings_of
from skillplan_cad.product import Product
from skillplan_cad.reading.mesh_folder import SUFFIXES as MESHES
from skillplan_cad.reading.product_reader import read_product
from skillplan_cad.relation import Relation
from skillplan_cad.relation_file import relation_text

_MOST_BYTES = 1 << 30
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What is known of a product before it is planned.

    Parameters
    ----------
    product, joints, blocked, relation
        As the stages made them.
    """

    product: Product
    joints: Joints
    blocked: Blocked
    relation: Relation


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


def import_cad(source: str, out: str, given: dict[str, Any], tell: Tell) -> Imported:
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
    made = planned(path, product, relation, settings, tell)
    relation = made.relation
    waived = waived_pairs(findings.joints, findings.blocked, settings.threads)
    document = report_document(product, relation, waived, settings, path.name)
    document |= made.document
    files = {
        "relation.json": relation_text(relation),
        "report.json": json_text(IMPORT, document) + "\n",
        **made.files,
    }
    write(folder, files)
    lines = (*_lines(product, relation), *made.lines)
    told = (*warnings(relation, product), *made.warnings)
    return Imported(document, lines, told, made.complete)


def found_in(path: Path, settings: ImportSettings, tell: Tell) -> Findings:
    """Return what is found in a file or folder; stages that ran before are not run again."""
    stages = KeptStages(settings.keep, tell)
    reading, tolerance_m = settings.reading, settings.tolerance_mm / 1000
    content, read_hash = stages.run(
        "reading",
        {
            "content": _content_hash(path),
            "unit": reading.unit,
            "chord_m": reading.chord_m,
            "split": reading.split_bodies,
            "density": reading.density_kg_m3,
        },
        lambda: product_bytes(read_product(path, reading)),
    )
    product = product_of(content)
    about = {"product": read_hash, "tolerance_m": tolerance_m}
    content, _ = stages.run(
        "joints",
        {**about, "source": settings.directions, "threads": settings.threads},
        lambda: joints_bytes(
            joints_of(product, tolerance_m, settings.directions, settings.threads)
        ),
    )
    joints = joints_from(content)
    content, _ = stages.run(
        "blocking",
        {**about, "directions": joints.directions},
        lambda: blocked_bytes(
            blocked_of(product, joints.directions, tolerance_m, _progress(tell, product))
        ),
    )
    blocked = blocked_from(content)
    relation = relation_of(product, joints, blocked, tolerance_m, settings.threads)
    return Findings(product, joints, blocked, relation)


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


def _content_hash(path: Path) -> str:
    """Return a hash of a file, or of the meshes of a folder with their names."""
    if not is_folder(path):
        try:
            return hashlib.sha256(read_bytes(path, _MOST_BYTES)).hexdigest()
        except OSError:
            # Reading says what is wrong with it.
            return ""
    digest = hashlib.sha256()
    for one in sorted(path.iterdir()):
        if one.suffix.lower() in MESHES:
            try:
                content = read_bytes(one, _MOST_BYTES)
            except OSError:
                return ""
            digest.update(one.name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _progress(tell: Tell, product: Product) -> Callable[[int, int], None]:
    count = len(product)

    def told(done: int, of: int) -> None:
        tell(f"blocking: {count} parts along {done} of {of} lines")

    return told


def _no_base(base: str, relation: Relation) -> str:
    from skillplan.errors import name_hint

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
