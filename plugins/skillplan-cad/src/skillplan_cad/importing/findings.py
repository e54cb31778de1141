"""What is found in a product, stage by stage: read, joints, blocking, confirmation."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from skillplan.files.regular_file import is_folder, read_bytes
from skillplan_cad.blocking.confirmation import Confirmation, Doubt
from skillplan_cad.build_relation import Blocked, Joints, blocked_of, joints_of, relation_of
from skillplan_cad.importing.kept_findings import (
    blocked_bytes,
    blocked_from,
    doubts_bytes,
    doubts_from,
    joints_bytes,
    joints_from,
)
from skillplan_cad.importing.kept_product import product_bytes, product_of
from skillplan_cad.importing.kept_stages import KeptStages
from skillplan_cad.importing.settings import ImportSettings
from skillplan_cad.product import Product
from skillplan_cad.reading.mesh_folder import SUFFIXES as MESHES
from skillplan_cad.reading.product_reader import read_product
from skillplan_cad.relation import Relation

_MOST_BYTES = 1 << 30
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What is known of a product before it is planned.

    Parameters
    ----------
    product, joints, blocked, doubts, relation
        As the stages made them.
    stages
        Where they are kept.
    read_hash
        Of the product.
    """

    product: Product
    joints: Joints
    blocked: Blocked
    doubts: tuple[Doubt, ...]
    relation: Relation
    stages: KeptStages
    read_hash: str


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
    content, blocked_hash = stages.run(
        "blocking",
        {**about, "directions": joints.directions},
        lambda: blocked_bytes(
            blocked_of(
                product, joints.directions, tolerance_m, _progress(tell, product), settings.jobs
            )
        ),
    )
    blocked = blocked_from(content)
    touching = [one.parts for one in joints.contacts if one.kind != "thread"]
    content, _ = stages.run(
        "confirming",
        {**about, "blocked": blocked_hash, "touching": touching},
        lambda: doubts_bytes(
            Confirmation(product, tolerance_m).doubts(blocked.entries, touching, joints.directions)
        ),
    )
    relation = relation_of(product, joints, blocked, tolerance_m, settings.threads)
    doubts = doubts_from(content)
    return Findings(product, joints, blocked, doubts, relation, stages, read_hash)


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
