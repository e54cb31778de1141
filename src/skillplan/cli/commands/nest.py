"""``skillplan nest``."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from skillplan.cli.options.shared import CommandLimits, OutFolder, Style
from skillplan.cli.options.values import one_of, option, positive_number

PART = "Part"
SIZES = "Sizes"

_UPS = ("x", "y", "z", "-x", "-y", "-z")
_KINDS = ("nest", "nut", "jaws")


def _size(flag: str, text: str) -> object:
    """Return an option with a length."""
    return option(f"{flag} MM", SIZES, text, parser=positive_number())


def command(
    product: Annotated[
        str,
        typer.Argument(
            metavar="FILE|FOLDER",
            help="STEP, STL, OBJ, PLY, 3MF or GLB file, or a folder of meshes, with the part in "
            "the orientation in which it is inserted.",
            show_default=False,
        ),
    ],
    out: OutFolder,
    *,
    limits: CommandLimits,
    unit: Annotated[
        str | None,
        option(
            "--unit UNIT",
            PART,
            "Unit of meshes: um, mm, cm, m, inch or foot. STEP and 3MF state theirs.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        option(
            "--only PATTERN",
            PART,
            "Part whose name fits PATTERN; several are one sub-assembly. Repeatable. Default: "
            "all parts.",
        ),
    ] = None,
    up: Annotated[
        Literal["x", "y", "z", "-x", "-y", "-z"],
        option(
            "--up AXIS",
            PART,
            "Axis of the file that points up: x, y, z, -x, -y or -z. The part comes from above.",
            parser=one_of(_UPS),
        ),
    ] = "z",
    kind: Annotated[
        Literal["nest", "nut", "jaws"],
        option(
            "--kind KIND",
            PART,
            "nest: a block with a pocket; nut: one that must keep the part from turning; "
            "jaws: two soft jaws for a parallel gripper.",
            parser=one_of(_KINDS),
        ),
    ] = "nest",
    free: Annotated[
        list[str] | None,
        option(
            "--free X0,Y0,X1,Y1[,Z]",
            PART,
            "Rectangle that stays open for fingers or screws, from height Z upwards or "
            "through the base, in mm of the file turned by --up. Repeatable.",
        ),
    ] = None,
    closing: Annotated[
        Literal["x", "y", "z"] | None,
        option(
            "--closing AXIS",
            PART,
            "Axis of the file along which jaws close. Default: x.",
            parser=one_of(_UPS[:3]),
        ),
    ] = None,
    clearance: Annotated[
        float, _size("--clearance", "Least distance of the walls from the part, 0.02 to 5 mm.")
    ] = 0.2,
    draft: Annotated[
        float,
        option("--draft DEGREES", SIZES, "Angle by which walls lean outwards, 0 to 45 degrees."),
    ] = 1.0,
    depth: Annotated[
        float | None,
        _size(
            "--depth",
            "Height of the walls above the part's lowest point. Default: half of its height, at "
            "most 15 mm.",
        ),
    ] = None,
    wall: Annotated[float, _size("--wall", "Thickness of the outer walls.")] = 4.0,
    base: Annotated[float, _size("--base", "Thickness of the floor.")] = 3.0,
    layer: Annotated[
        float, _size("--layer", "Greatest height of the steps that follow slopes and curves.")
    ] = 0.5,
    pin: Annotated[
        float | None,
        option(
            "--pin MM",
            SIZES,
            "Diameter of the pins beneath overhangs of a part that would tip; 0 for no pins. "
            "Default: 4.",
        ),
    ] = None,
    gap: Annotated[float | None, _size("--gap", "Distance of closed jaws. Default: 2.")] = None,
    style: Style = "table",
) -> int:
    """Cut a nest for a part, and check it by rays.

    The pocket is the room that the part sweeps on its way down, wider by the clearance, so the
    part enters it and its level faces rest on the floor. Rays then test the mesh of the nest
    against that of the part: clearance in 24 directions on the whole way, play, supports, free
    regions, undercuts.

    Writes nest.stl (to print, in mm), nest.obj and nest.pieces.obj (for `meshes` of a fixture in a
    task, in metres), nest.png (drawing with dimensions) and nest.json. A nest that fails its check
    gets a drawing and the reasons, but no meshes, and the exit code is 1. Needs the plugin
    skillplan-cad.
    """
    from skillplan.cli.load import load_cad_command
    from skillplan.cli.output import emit
    from skillplan.cli.writing import tell
    from skillplan.errors import exit_code
    from skillplan.records.schemas import NEST
    from skillplan.views.figures.nest_figure import render_nest_png
    from skillplan.views.tables.installation import tabulate_nests

    limits.begin(graceful=False)
    nests = load_cad_command("nest", "nest")(
        product,
        out,
        {
            "unit": unit,
            "only": only,
            "kind": kind,
            "up": up,
            "closing": closing,
            "free": free,
            "clearance_mm": clearance,
            "draft_deg": draft,
            "depth_mm": depth,
            "wall_mm": wall,
            "base_mm": base,
            "layer_mm": layer,
            "pin_mm": pin,
            "gap_mm": gap,
        },
        lambda line: tell(f"skillplan: {line}"),
        render_nest_png,
    )
    for warning in nests.warnings:
        tell(f"skillplan: note: {warning}")
    emit(style, {"schema": NEST, **nests.document}, tabulate_nests(nests.document, out))
    return exit_code(solved=nests.good)
