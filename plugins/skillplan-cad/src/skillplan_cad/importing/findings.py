"""Analyse a product in stages: reading, joints, blocking, confirmation."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load, save

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.folder import get_cache_folder
from skillplan.files.regular_file import is_folder, read_bytes
from skillplan_cad import __version__
from skillplan_cad.build_relation import (
    Blocked,
    Joints,
    assemble_relation,
    find_blocked,
    find_joints,
)
from skillplan_cad.importing.materials import assign_materials
from skillplan_cad.importing.settings import ImportSettings
from skillplan_cad.joints.fastener_names import recognise_kind
from skillplan_cad.planning.assembly_plan import find_groups
from skillplan_cad.planning.precedence import derive_precedence, list_members
from skillplan_cad.planning.shrunk_meshes import MeshTree, shrink_mesh
from skillplan_cad.product import Face, Part, Product, Vector, make_solid
from skillplan_cad.reading.mesh_folder import MOST_BYTES as MESH_BYTES
from skillplan_cad.reading.mesh_folder import UNITS_M, list_mesh_files
from skillplan_cad.reading.product_reader import ReadOptions, fits_pattern, read_product
from skillplan_cad.reading.step_file import hash_step, is_step
from skillplan_cad.relation import Blocking, Contact, Fastener, Fit, Relation, Sensitive

# Distances beyond the first contact at which blocked pairs are tested, in insets; number of places
_BEYOND = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0, 400.0)
_PLACES = 8
# Width across the flats of a nut of M100 [m].
_WIDEST_FASTENER_M = 0.145


@dataclass(frozen=True, slots=True)
class Doubt:
    """A pair for which rays and shrunk meshes disagree.

    Parameters
    ----------
    part, by, direction
        As in `Blocking`.
    rays_say_blocked
        Answer of the rays, as in the relation; meshes give the opposite.
    """

    part: str
    by: str
    direction: int
    rays_say_blocked: bool


class Confirmation:
    """Tests blockings with shrunk meshes.

    Parameters
    ----------
    tolerance_m
        Radius of a blocked disc; each mesh is shrunk by half of it [m].
    must_stop
        Returns True once the time is over; the pairs that are left are not tested.

    Attributes
    ----------
    left
        Number of pairs that were not tested in the time.
    """

    def __init__(
        self, product: Product, tolerance_m: float, must_stop: Callable[[], bool] = lambda: False
    ) -> None:
        self._product, self._must_stop = product, must_stop
        self.left = 0
        self._inset_m = tolerance_m / 2
        self._trees: dict[str, MeshTree] = {}

    def find_doubts(
        self,
        entries: Iterable[Blocking],
        touching: Iterable[tuple[str, str]],
        directions: Sequence[Vector],
    ) -> tuple[Doubt, ...]:
        """Return the pairs for which meshes contradict rays, in order of the tests.

        Parameters
        ----------
        entries
            Blocked pairs; of the two entries for one block only the first is tested.
        touching
            Pairs in contact; if they do not block each other, narrow edges still may.
        directions
            Directions that entries refer to, each next to its opposite.
        """
        # Shrinking turns thin sheets inside out.
        sheets = {part.name for part in self._product if part.closure == "surface"}
        doubts: list[Doubt] = []
        blocked: set[tuple[str, str, int]] = set()
        for entry in entries:
            is_tested = not sheets & {entry.part, entry.by}
            is_tested = is_tested and (entry.by, entry.part, entry.direction ^ 1) not in blocked
            if is_tested and self._must_stop():
                self.left += 1
            elif is_tested:
                direction_vector = np.asarray(directions[entry.direction])
                places = (entry.distance_m + share * self._inset_m for share in _BEYOND)
                if not any(
                    self._collide(entry.part, entry.by, place * direction_vector)
                    for place in places
                ):
                    doubts.append(Doubt(entry.part, entry.by, entry.direction, True))
            blocked.add((entry.part, entry.by, entry.direction))
        for part, by in touching:
            if sheets & {part, by}:
                continue
            if self._must_stop():
                self.left += 1
                continue
            for number, direction in enumerate(directions):
                if (part, by, number) not in blocked and self._collides_on_way(part, by, direction):
                    doubts.append(Doubt(part, by, number, False))
        return tuple(doubts)

    def _collides_on_way(self, part: str, by: str, direction: Vector) -> bool:
        """Return whether a part collides with another at some places of its move past it."""
        along = np.asarray(direction)
        moving, standing = (self._get_tree(name).vertices_m @ along for name in (part, by))
        end = max(float(standing.max() - moving.min()), 0.0)
        # Most obstacles are near.
        places = end * np.linspace(0.0, 1.0, _PLACES + 1)[1:] ** 2
        return any(self._collide(part, by, place * along) for place in places)

    def _collide(self, part: str, by: str, offset_m: NDArray[np.float64]) -> bool:
        mover, other = self._get_tree(part), self._get_tree(by)
        if (mover.low_m + offset_m > other.high_m).any() or (
            mover.high_m + offset_m < other.low_m
        ).any():
            return False
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        moved, still = coal.Transform3s(), coal.Transform3s()
        moved.setTranslation(offset_m)
        coal.collide(mover.tree, moved, other.tree, still, request, result)
        return bool(result.isCollision())

    def _get_tree(self, name: str) -> MeshTree:
        if name not in self._trees:
            part = self._product.part(name)
            points = shrink_mesh(part.vertices_m, part.triangles, self._inset_m)
            self._trees[name] = MeshTree(name, points, part.triangles)
        return self._trees[name]


def serialize_joints(joints: Joints) -> bytes:
    """Serialize joints."""
    return json.dumps(asdict(joints)).encode()


def restore_joints(content: bytes) -> Joints:
    """Restore joints from `serialize_joints`."""
    document = json.loads(content)
    contacts = []
    for fields in document["contacts"]:
        fit = fields.pop("fit")
        own = None if fit is None else Fit(**fit)
        contacts.append(Contact(**_convert_to_tuples(fields), fit=own))
    return Joints(
        tuple(contacts),
        tuple(Fastener(**_convert_to_tuples(fastener)) for fastener in document["fasteners"]),
        tuple(_convert_to_tuple(direction) for direction in document["directions"]),
        tuple(document["notes"]),
    )


def serialize_blocked(blocked: Blocked) -> bytes:
    """Serialize blockings."""
    return json.dumps(asdict(blocked)).encode()


def restore_blocked(content: bytes) -> Blocked:
    """Restore blockings from `serialize_blocked`."""
    document = json.loads(content)
    return Blocked(
        tuple(Blocking(**_convert_to_tuples(entry)) for entry in document["entries"]),
        tuple(Sensitive(**_convert_to_tuples(entry)) for entry in document["sensitive"]),
    )


def serialize_doubts(doubts: Sequence[Doubt], left: int) -> bytes:
    """Serialize doubts and the number of pairs that were not tested."""
    return json.dumps({"doubts": [asdict(doubt) for doubt in doubts], "left": left}).encode()


def restore_doubts(content: bytes) -> tuple[tuple[Doubt, ...], int]:
    """Restore doubts and a number of pairs from `serialize_doubts`."""
    document = json.loads(content)
    return tuple(Doubt(**doubt) for doubt in document["doubts"]), int(document["left"])


def _convert_to_tuples(values: dict[str, Any]) -> dict[str, Any]:
    return {name: _convert_to_tuple(value) for name, value in values.items()}


def _convert_to_tuple(value: Any) -> Any:
    return tuple(_convert_to_tuple(item) for item in value) if isinstance(value, list) else value


def serialize_product(product: Product) -> bytes:
    """Serialize a product as arrays and one JSON document, without pickled objects."""
    tensors: dict[str, NDArray[Any]] = {}
    parts = []
    for number, part in enumerate(product.parts):
        tensors[f"{number}.vertices"] = np.ascontiguousarray(part.vertices_m)
        tensors[f"{number}.triangles"] = np.ascontiguousarray(part.triangles)
        of_face = [face.triangles for face in part.faces]
        joined = np.concatenate(of_face) if of_face else np.zeros(0, dtype=np.int64)
        tensors[f"{number}.faces"] = np.ascontiguousarray(joined, dtype=np.int64)
        faces = []
        for face in part.faces:
            about = {name: value for name, value in asdict(face).items() if name != "triangles"}
            faces.append({**about, "count": len(face.triangles)})
        parts.append(
            {
                "name": part.name,
                "path": part.path,
                "volume_m3": part.volume_m3,
                "density_kg_m3": part.density_kg_m3,
                "centre_m": part.centre_m,
                "shape": part.shape,
                "mirrors": part.mirrors,
                "bodies": part.bodies,
                "design": part.design,
                "closure": part.closure,
                "gap_m": part.gap_m,
                "faces": faces,
            }
        )
    about = {
        "name": product.name,
        "unit": product.unit,
        "chord_m": product.chord_m,
        "notes": product.notes,
        "warnings": product.warnings,
        "parts": parts,
    }
    tensors["about"] = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
    return bytes(save(tensors))


def restore_product(content: bytes) -> Product:
    """Restore a product from `serialize_product`.

    Raises
    ------
    ValueError
        If the content is invalid.
    """
    tensors = load(content)
    about = json.loads(tensors["about"].tobytes())
    parts = []
    for number, fields in enumerate(about["parts"]):
        joined, start, faces = tensors[f"{number}.faces"], 0, []
        for face in fields.pop("faces"):
            count = face.pop("count")
            for name in ("origin_m", "axis", "extent_m"):
                face[name] = tuple(face[name])
            faces.append(Face(triangles=joined[start : start + count], **face))
            start += count
        fields["path"], fields["centre_m"] = tuple(fields["path"]), tuple(fields["centre_m"])
        parts.append(
            Part(
                vertices_m=tensors[f"{number}.vertices"],
                triangles=tensors[f"{number}.triangles"],
                faces=tuple(faces),
                **fields,
            )
        )
    return Product(
        about["name"],
        tuple(parts),
        about["unit"],
        about["chord_m"],
        tuple(about["notes"]),
        tuple(about["warnings"]),
    )


_MOST_BYTES = 1 << 30
# Raised whenever the same file is read as other parts.
_FORMAT = 9
_HASH_BYTES = 32
_DOUBTS_FORMAT = 1


class KeptStages:
    """Runs the stages of an import, and caches their results on disk.

    Parameters
    ----------
    keep
        True to read and write the cache.
    """

    def __init__(self, keep: bool, tell: Callable[[str], None]) -> None:
        self._folder: Path | None = get_cache_folder() / "import-cad" if keep else None
        self._tell = tell

    def run(
        self,
        name: str,
        made_from: Mapping[str, Any],
        make: Callable[[], bytes],
        is_partial: Callable[[], bool] = lambda: False,
    ) -> tuple[bytes, str]:
        """Return the result of a stage and its hash.

        Parameters
        ----------
        made_from
            All inputs of the stage, such as hashes of earlier stages.
        make
            Computes the result if it is not cached.
        is_partial
            Returns True if the result was cut short, and is not to be cached.
        """
        key = hashlib.sha256(
            json.dumps([name, __version__, dict(made_from)], sort_keys=True).encode()
        ).hexdigest()
        path = None if self._folder is None else self._folder / f"{name}-{key}"
        content = None if path is None else _read_cached(path)
        if content is None:
            self._tell(f"{name} ...")
            content = make()
            if path is not None and not is_partial():
                # A result that cannot be cached is computed again next time.
                with suppress(OSError):
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_whole(path, hashlib.sha256(content).digest() + content)
        else:
            self._tell(f"{name}: kept from an earlier run")
        return content, hashlib.sha256(content).hexdigest()


def _read_cached(path: Path) -> bytes | None:
    """Return a cached result, or None if it is missing or damaged."""
    try:
        content = read_bytes(path, _MOST_BYTES)
    except OSError:
        return None
    whole = content[_HASH_BYTES:]
    return whole if hashlib.sha256(whole).digest() == content[:_HASH_BYTES] else None


# Largest extent of a product, in tolerances; single precision resolves 1/16 tolerance there.
MOST_TOLERANCES = 1_000_000
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """Results of all stages before planning.

    Parameters
    ----------
    product
        Parts as drawn.
    materials
        Names of stated materials by part.
    unconfirmed
        Number of blockings that shrunk meshes did not test in the time.
    relieved
        Parts whose fits touch instead of overlapping.
    """

    product: Product
    relieved: Product
    joints: Joints
    blocked: Blocked
    doubts: tuple[Doubt, ...]
    relation: Relation
    stages: KeptStages
    read_hash: str
    materials: Mapping[str, str]
    unconfirmed: int = 0


def analyse_product(
    path: Path,
    settings: ImportSettings,
    tell: Tell,
    confirming: Callable[[], AbstractContextManager[Callable[[], bool]]],
) -> Findings:
    """Analyse a file or folder; stages with unchanged input come from the cache.

    Parameters
    ----------
    confirming
        Returns a context for the confirmation, with a function that returns True once it must stop.
    """
    stages = KeptStages(settings.keep, tell)
    reading, tolerance_m = settings.reading, settings.tolerance_mm / 1000
    whole, read_hash = _read(path, reading, stages, tell)
    doubt = "" if reading.unit is not None else describe_unit_doubt(whole)
    if doubt:
        whole, read_hash = _read(path, replace(reading, unit="mm"), stages, tell)
        whole = replace(whole, warnings=(doubt, *whole.warnings))
    product, materials = assign_materials(whole, settings.material, settings.density_kg_m3)
    _refuse_fine(path, product, tolerance_m)
    names = [part.name for part in product]
    options, declared = settings.resolve_fits(names), settings.resolve_fasteners(names)
    about: dict[str, Any] = {"product": read_hash, "tolerance_m": tolerance_m}
    content, _ = stages.run(
        "joints",
        {
            **about,
            "source": settings.directions,
            "threads": settings.threads,
            "fits": asdict(options),
            "fasteners": asdict(declared),
            "format": _FORMAT,
        },
        lambda: serialize_joints(
            find_joints(
                product, tolerance_m, settings.directions, settings.threads, options, declared
            )
        ),
    )
    joints = restore_joints(content)
    relieved = joints.relieve(product, tolerance_m)
    if relieved is not product:
        about["joints"] = hashlib.sha256(content).hexdigest()
    content, blocked_hash = stages.run(
        "blocking",
        {**about, "directions": joints.directions},
        lambda: serialize_blocked(
            find_blocked(
                relieved,
                joints.directions,
                tolerance_m,
                _report_progress(tell, product),
                settings.jobs,
            )
        ),
    )
    blocked = restore_blocked(content)
    touching = [contact.parts for contact in joints.contacts if contact.kind != "thread"]
    with confirming() as must_stop:
        confirmation = Confirmation(relieved, tolerance_m, must_stop)

        def confirm() -> bytes:
            doubts = confirmation.find_doubts(blocked.entries, touching, joints.directions)
            return serialize_doubts(doubts, confirmation.left)

        content, _ = stages.run(
            "confirming",
            {**about, "blocked": blocked_hash, "touching": touching, "format": _DOUBTS_FORMAT},
            confirm,
            lambda: confirmation.left > 0,
        )
    relation = assemble_relation(product, joints, blocked, tolerance_m, settings.threads)
    doubts, left = restore_doubts(content)
    return Findings(
        product, relieved, joints, blocked, doubts, relation, stages, read_hash, materials, left
    )


def _read(path: Path, reading: ReadOptions, stages: KeptStages, tell: Tell) -> tuple[Product, str]:
    """Return a product and its hash, from the cache if possible."""
    content, read_hash = stages.run(
        "reading",
        {
            "content": _hash_content(path),
            "name": path.resolve().name,
            "format": _FORMAT,
            **asdict(reading),
        },
        lambda: serialize_product(
            read_product(path, reading, lambda text: tell(f"reading: {text}"))
        ),
    )
    return restore_product(content), read_hash


def describe_unit_doubt(product: Product) -> str:
    """Return why lengths of STEP are millimetres rather than the stated unit; empty if they may be.

    No screw, nut or washer is wider than the nuts of M100. If all that are named so are, and none
    is as millimetres, the file has the wrong unit.
    """
    scale = 1e-3 / UNITS_M.get(product.unit, 1e-3)
    named = [part for part in product if recognise_kind(part.name, part.design) is not None]
    if scale == 1 or not product.chord_m or not named:
        return ""
    wide_m = [float(np.sort(np.ptp(part.vertices_m, axis=0))[1]) for part in named]
    small = int(np.argmin(wide_m))
    if min(wide_m) <= _WIDEST_FASTENER_M or max(wide_m) * scale > _WIDEST_FASTENER_M:
        return ""
    return (
        f"the file states {product.unit}, with which {named[small].name} is "
        f"{wide_m[small] * 1e3:.0f} mm wide; read as mm, with which it is "
        f"{wide_m[small] * scale * 1e3:.3g} mm wide. --unit {product.unit} keeps the stated unit."
    )


def _refuse_fine(path: Path, product: Product, tolerance_m: float) -> None:
    """Refuse a tolerance below the single precision of the rays."""
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


def _hash_content(path: Path) -> str:
    """Return a hash of a file and its references, or of the meshes of a folder with their names.

    Of an unreadable file the reason is hashed; reading it later reports that.
    """
    if is_step(path) and not is_folder(path):
        return hash_step(path)
    digest = hashlib.sha256()
    for file in list_mesh_files(path) if is_folder(path) else [path]:
        try:
            content = read_bytes(file, MESH_BYTES)
        except OSError as error:
            content = str(error.strerror).encode()
        digest.update(os.fsencode(file.name) + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _report_progress(tell: Tell, product: Product) -> Callable[[int, int], None]:
    count = len(product)

    def report(done: int, of: int) -> None:
        tell(f"blocking: {count} parts along {done} of {of} lines")

    return report


# CAD of a bought-in unit often shows a ring that others close in, or pins that are drawn inside
# their plastic; both halves of a housing may be one part in the file.
# Number of times that parts are joined or split. Largest number of bodies that are separate parts:
# more are the balls of a bearing.
_ROUNDS, _MOST_BODIES = 8, 8
# Largest share of the product's parts, and of its volume, in the assembly of a unit.
_MOST_SHARE = 0.5
# Size of a part that no gripper of a cell holds, nor a cup [m].
_TINY_M = 1e-3
# Least share of each body in the volume of a housing; rods in a frame have less, and stay in it.
_LEAST_BODY = 0.05


def analyse_units(
    analyse: Callable[[ImportSettings], Findings], settings: ImportSettings
) -> tuple[Findings, ImportSettings]:
    """Analyse a product until no unit is left to join and no part to split.

    A split stays only if it frees parts.

    Returns
    -------
    tuple
        Findings, and the settings that name the units and the parts that are split.
    """
    findings = analyse(settings)
    for _ in range(_ROUNDS if settings.uniting else 0):
        product, relation = findings.product, findings.relation
        locked = list_locked(relation)
        bought = {name for unit in settings.units for name in unit} & {*relation.names}
        units = [
            unit
            for unit in list_units(product, relation, locked, bought)
            if not _is_named(unit, settings)
        ]
        if units:
            settings = replace(settings, units=(*settings.units, *units))
            findings = analyse(settings)
            continue
        closing = find_closing(product, locked)
        pressed = [side for sides in settings.press_fit_sides for side in sides]
        if closing is None or any(fits_pattern(closing, side) for side in pressed):
            break
        split = replace(settings, split_parts=(*settings.split_parts, closing))
        apart = analyse(split)
        kept = {*relation.names} - {closing}
        if _count_locked(apart.relation, kept) >= _count_locked(relation, kept):
            break
        findings, settings = apart, split
    return findings, settings


def _is_named(unit: Sequence[str], settings: ImportSettings) -> bool:
    """Return whether an option names a part of a unit, or a fit within it; no unit is made then."""
    materials = [entry.rpartition("=")[0] for entry in settings.material]
    patterns = [*settings.fastener, *settings.not_fastener, *materials]

    def has(pattern: str) -> bool:
        return any(fits_pattern(name, pattern) for name in unit)

    is_within = any(all(map(has, sides)) for sides in settings.press_fit_sides)
    return settings.base in unit or is_within or any(map(has, patterns))


def list_locked(relation: Relation) -> list[tuple[str, ...]]:
    """Return the sets of parts that no straight move takes apart."""
    locks = find_groups(relation, derive_precedence(relation)).locks
    return [tuple(relation.names[number] for number in list_members(lock.parts)) for lock in locks]


def _count_locked(relation: Relation, kept: set[str]) -> int:
    return len({name for lock in list_locked(relation) for name in lock if name in kept})


def list_units(
    product: Product,
    relation: Relation,
    locked: Iterable[Sequence[str]],
    bought: Collection[str] = (),
) -> list[tuple[str, ...]]:
    """Return the parts of each bought-in unit.

    They belong to one assembly below the root, and are locked: because all of their set belong to
    it, or because they overlap. Parts that are drawn inside a bought unit, and screws without a
    head in it, belong to it as well. Tiny parts come soldered to a board.
    """
    overlaps = [contact.parts for contact in relation.contacts if contact.interferes]
    units: list[tuple[str, ...]] = []
    for lock in locked:
        for names in _split_by_assembly(product, lock):
            pairs = [pair for pair in overlaps if {*pair} <= {*names}]
            units += [tuple(names)] if len(names) == len(lock) else _link(names, pairs)
    if units:
        return units
    inside = [pair for pair in overlaps if {*pair} & {*bought}]
    tiny = {part.name for part in product if np.ptp(part.bounds_m, axis=0).max() < _TINY_M}
    inside += [c.parts for c in relation.contacts if len({*c.parts} & tiny) == 1]
    for fastener in relation.fasteners:
        if fastener.is_headless(product.part(fastener.part).vertices_m):
            inside += [(fastener.part, mate) for mate in fastener.threaded_in if mate in bought]
    for names in _split_by_assembly(product, relation.names):
        units += _link(names, [pair for pair in inside if {*pair} <= {*names}])
    return units


def _split_by_assembly(product: Product, names: Iterable[str]) -> Iterator[list[str]]:
    """Yield the parts of each assembly below the root, two or more.

    An assembly with most of the parts and of the volume is the product itself.
    """
    assemblies: dict[str, list[str]] = {}
    for name in names:
        assemblies.setdefault(name.rpartition("/")[0], []).append(name)
    volume_m3 = sum(part.volume_m3 for part in product)
    for assembly, members in assemblies.items():
        inside = [part for part in product if part.name.startswith(f"{assembly}/")]
        own_m3 = sum(part.volume_m3 for part in inside)
        is_most = len(inside) > _MOST_SHARE * len(product) and own_m3 > _MOST_SHARE * volume_m3
        if assembly and len(members) > 1 and not is_most:
            yield members


def _link(names: Sequence[str], pairs: Sequence[tuple[str, str]]) -> list[tuple[str, ...]]:
    """Return the sets of two or more names that pairs connect, in order."""
    sets = [{name} for name in names]
    for first, second in pairs:
        joined = [group for group in sets if first in group or second in group]
        sets = [group for group in sets if group not in joined] + [set().union(*joined)]
    return [tuple(name for name in names if name in group) for group in sets if len(group) > 1]


def _is_of_shells(part: Part) -> bool:
    """Return whether each body of a part has a share in its volume as shells of a housing have."""
    bodies = make_solid(part.vertices_m, part.triangles).decompose()
    volumes = [volume for body in bodies if (volume := float(body.volume())) > 0]
    return min(volumes, default=0.0) >= _LEAST_BODY * sum(volumes) > 0


def find_closing(product: Product, locked: Iterable[Sequence[str]]) -> str | None:
    """Return the largest part of a few shells that holds most of the parts of its locked set."""
    sizes_m3: dict[str, float] = {}
    for lock in locked:
        parts = [product.part(name) for name in lock]
        for part in parts:
            low, high = part.bounds_m
            others = np.array([other.centre_m for other in parts if other is not part])
            inside = ((others >= low) & (others <= high)).all(axis=1)
            few = 1 < part.bodies <= _MOST_BODIES and 2 * inside.sum() >= len(others)
            if few and _is_of_shells(part):
                sizes_m3[part.name] = float(np.prod(high - low))
    return max(sizes_m3, key=sizes_m3.__getitem__, default=None)
