"""What is found in a product, stage by stage: read, joints, blocking, confirmation."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skillplan.errors import OptionError
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
from skillplan_cad.reading.mesh_folder import MOST_BYTES as MESH_BYTES
from skillplan_cad.reading.mesh_folder import mesh_files
from skillplan_cad.reading.product_reader import read_product
from skillplan_cad.reading.step_file import MOST_BYTES as STEP_BYTES
from skillplan_cad.relation import Relation

# Extent of a product, in tolerances: single precision resolves a sixteenth of one there.
MOST_TOLERANCES = 1_000_000
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
            "name": path.resolve().name,
            "unit": reading.unit,
            "chord_m": reading.chord_m,
            "split": reading.split_bodies,
            "density": reading.density_kg_m3,
        },
        lambda: product_bytes(read_product(path, reading)),
    )
    product = product_of(content)
    _refuse_fine(path, product, tolerance_m)
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


def _refuse_fine(path: Path, product: Product, tolerance_m: float) -> None:
    """Refuse a tolerance that single precision, in which rays are traced, does not resolve."""
    bounds = np.stack([part.bounds_m for part in product.parts])
    # Meshes of STEP are in single precision about the origin of the file as well.
    span = bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)
    extent_m = float(np.abs(bounds).max() if product.chord_m else span.max())
    if extent_m > MOST_TOLERANCES * tolerance_m:
        reaches = (
            f"reaches {extent_m:.4g} m from the origin"
            if product.chord_m
            else (f"is {extent_m:.4g} m long")
        )
        raise OptionError(
            f"{path}: {reaches}, more than {MOST_TOLERANCES:,} times the tolerance of "
            f"{tolerance_m * 1000:g} mm, which is too fine to be resolved there. Correct the unit "
            f"({product.unit}) or the part that lies so far off, or give a larger --tolerance."
        )


def _content_hash(path: Path) -> str:
    """Return a hash of a file, or of the meshes of a folder with their names.

    It is empty for a file that cannot be read; reading it says why.
    """
    folder = is_folder(path)
    files = mesh_files(path) if folder else [path]
    digest = hashlib.sha256()
    for file in files:
        try:
            content = read_bytes(file, MESH_BYTES if folder else STEP_BYTES)
        except OSError:
            return ""
        name = file.name.encode() + b"\0" if folder else b""
        digest.update(name + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _progress(tell: Tell, product: Product) -> Callable[[int, int], None]:
    count = len(product)

    def told(done: int, of: int) -> None:
        tell(f"blocking: {count} parts along {done} of {of} lines")

    return told
