"""Run `skillplan nest`: read parts, build a nest or jaws, check by rays, write what passes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from skillplan.errors import OptionError
from skillplan.files.json_file import format_document
from skillplan.files.output_path import check_output_folder
from skillplan.records.schemas import NEST
from skillplan_cad.importing.import_cad import write
from skillplan_cad.nests.nest import KeepFree, Nest, NestSettings, build_jaws, build_nest
from skillplan_cad.nests.nest_check import check_nest, drop_bad_coarse, measure_blocked_mm3
from skillplan_cad.nests.nest_document import build_nest_document, format_nest_files
from skillplan_cad.nests.stepped_mesh import Body
from skillplan_cad.planning.bearing import ATTITUDES
from skillplan_cad.reading.mesh_folder import resolve_unit_m
from skillplan_cad.reading.names import decode_file_name
from skillplan_cad.reading.product_reader import ReadOptions, read_product

Kind = Literal["nest", "nut", "jaws"]
Draw = Callable[[Mapping[str, Any]], bytes]
"""Returns a drawing as PNG of an entry of `skillplan.nest/1`."""

_TO_MM = 1e3
_CHORD_M = 2e-5


@dataclass(frozen=True, slots=True)
class NestOptions:
    """Options of the command; lengths in millimetres.

    Parameters
    ----------
    only
        Patterns of the names of parts; none for all.
    kind
        ``nest``; ``nut`` for a pocket that must keep the part from turning; ``jaws`` for two soft
        jaws.
    up
        Axis of the file against which the part is inserted.
    closing
        Axis of the file along which jaws close.
    free
        Rectangles that stay open, as ``X0,Y0,X1,Y1`` or with the height of their floor.
    """

    unit: str | None = None
    only: tuple[str, ...] = ()
    kind: Kind = "nest"
    up: str = "z"
    closing: str = "x"
    gap_mm: float = 2.0
    clearance_mm: float = 0.2
    draft_deg: float = 1.0
    wall_mm: float = 4.0
    base_mm: float = 3.0
    depth_mm: float | None = None
    layer_mm: float = 0.5
    pin_mm: float = 4.0
    free: tuple[str, ...] = ()

    @property
    def settings(self) -> NestSettings:
        """Sizes of the nest."""
        return NestSettings(
            self.clearance_mm / _TO_MM,
            self.draft_deg,
            self.wall_mm / _TO_MM,
            self.base_mm / _TO_MM,
            None if self.depth_mm is None else self.depth_mm / _TO_MM,
            self.layer_mm / _TO_MM,
            self.pin_mm / _TO_MM,
        )


@dataclass(frozen=True, slots=True)
class MadeNests:
    """The output of the command.

    Parameters
    ----------
    document
        Fields of `nest.json`, without its schema.
    good
        True if all nests passed their check and are written.
    """

    document: dict[str, Any]
    warnings: tuple[str, ...]
    good: bool


def make_nest(
    source: str, out: str, given: Mapping[str, Any], tell: Callable[[str], None], draw: Draw
) -> MadeNests:
    """Build, check and write the nests of parts.

    Parameters
    ----------
    source
        STEP file, mesh, or folder of meshes.
    given
        Options by name; None for the default.

    Raises
    ------
    OptionError
        If an input is invalid; no file is written then.
    """
    chosen: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in given.items()
        if value is not None
    }
    options = NestOptions(**chosen)
    if options.unit is not None:
        resolve_unit_m(options.unit)
    settings, free = options.settings, [parse_free(text) for text in options.free]
    path, folder = Path(source), check_output_folder("--out", out)
    reading = ReadOptions(options.unit, _CHORD_M, only=options.only, fewest=1)
    product = read_product(path, reading, tell)
    open_parts = [part.name for part in product if part.closure == "surface"]
    if open_parts:
        raise OptionError(f"{path}: {', '.join(open_parts)} is not closed, so it has no nest.")
    bodies = [(part.vertices_m, part.triangles) for part in product]
    names = [part.name for part in product]
    tell(f"building for {', '.join(names[:4])}{' and others' if names[4:] else ''}")
    _refuse_without_effect(options.kind, chosen)
    nests = _build(bodies, options, settings, free)
    tell("checking by rays")
    entries, files = [], dict[str, str | bytes]()
    for label, nest in nests.items():
        regions = free if options.kind != "jaws" else []
        check = check_nest(
            bodies, nest, regions, stands=options.kind != "jaws", may_turn=options.kind != "nut"
        )
        entry = build_nest_document(label, nest, check, product.parts)
        entries.append(entry)
        if check.is_good:
            own = format_nest_files(
                label, drop_bad_coarse(bodies, nest, regions, stands=options.kind != "jaws")
            )
            entry["files"] = {
                name.removeprefix(f"{label}.").replace(".", "_"): name for name in own
            }
            files |= own
        files[f"{label}.png"] = draw(entry)
    good = all(entry["check"]["good"] for entry in entries)
    document = {
        "product": product.name,
        "source": decode_file_name(path),
        "kind": options.kind,
        "good": good,
        "nests": entries,
    }
    files["nest.json"] = format_document(NEST, document) + "\n"
    write(folder, files)
    return MadeNests(document, (*product.notes, *product.warnings), good)


def _build(
    bodies: Sequence[Body], options: NestOptions, settings: NestSettings, free: Sequence[KeepFree]
) -> dict[str, Nest]:
    """Return nests by their name."""
    up = ATTITUDES[options.up]
    if options.kind != "jaws":
        _refuse_outside(build_nest(bodies, settings, up) if free else None, options, free)
        return {options.kind: build_nest(bodies, settings, up, free)}
    jaws = build_jaws(bodies, ATTITUDES[options.closing], settings, up, options.gap_mm / _TO_MM)
    return {f"jaw_{number}": jaw for number, jaw in enumerate(jaws, 1)}


def _refuse_without_effect(kind: Kind, chosen: Mapping[str, Any]) -> None:
    """Refuse options that the kind does not use."""
    reasons = {
        "free": "--free is for nests; jaws end 0.5 mm above the plane of the part.",
        "depth_mm": "--depth is for nests; the depth of jaws follows from --gap.",
        "pin_mm": "--pin is for nests; jaws have no pins.",
    }
    if kind != "jaws":
        reasons = {
            "gap_mm": f"--gap is for --kind jaws; leave it out for --kind {kind}.",
            "closing": f"--closing is for --kind jaws; leave it out for --kind {kind}.",
        }
    for name, reason in reasons.items():
        if chosen.get(name) not in (None, ()):
            raise OptionError(reason)


def _refuse_outside(nest: Nest | None, options: NestOptions, free: Sequence[KeepFree]) -> None:
    """Refuse regions that cut nothing of a nest without any."""
    if nest is None:
        return
    low, high = nest.upright_m.min(axis=0) * _TO_MM, nest.upright_m.max(axis=0) * _TO_MM
    for text, cut_mm3 in zip(options.free, measure_blocked_mm3(nest, free), strict=True):
        if cut_mm3 <= 0:
            ranges = (
                f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True)
            )
            raise OptionError(
                f"--free {text}: this region cuts nothing. In mm of the file turned by --up "
                f"{options.up}, the nest reaches from {', '.join(ranges)}."
            )


def parse_free(text: str) -> KeepFree:
    """Return a region from ``X0,Y0,X1,Y1[,FLOOR]`` in millimetres.

    Raises
    ------
    OptionError
        If it is not four or five numbers, or empty.
    """
    try:
        x0, y0, x1, y1, *floor = (float(word) for word in text.split(","))
    except ValueError:
        floor = [0.0, 0.0]
    if len(floor) > 1 or not np.isfinite([x0, y0, x1, y1, *floor]).all() or x0 == x1 or y0 == y1:
        raise OptionError(
            f"--free {text}: give a rectangle in mm, X0,Y0,X1,Y1, and the height of its floor if "
            "it does not cut through the base."
        )
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) / _TO_MM
    return KeepFree(corners, floor[0] / _TO_MM) if floor else KeepFree(corners)
