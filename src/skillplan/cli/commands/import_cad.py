"""``skillplan import-cad``."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Literal

import typer

from skillplan.cli.options.shared import OUTPUT, CommandLimits, Jobs, OutFolder, Style
from skillplan.cli.options.values import one_of, option, positive_number

GEOMETRY = "Geometry"
PLANNING = "Planning"

_UPS = ("auto", "x", "y", "z", "-x", "-y", "-z")
_DIRECTIONS = ("axes", "cylinders", "contacts")
_THREADS = ("unscrew", "solid", "ignore")


def command(
    product: Annotated[
        str,
        typer.Argument(
            metavar="FILE|FOLDER",
            help="STEP file (.step or .stp, optionally .gz), 3MF or GLB file of several objects, "
            "or a folder of STL, OBJ or PLY files: one per part, all in the same frame.",
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
            GEOMETRY,
            "Unit of the meshes in FOLDER: um, mm, cm, m, inch or foot. Of STEP, the unit in "
            "place of the stated one. 3MF states its own; GLB is in metres without it.",
        ),
    ] = None,
    tolerance: Annotated[
        float,
        option(
            "--tolerance MM",
            GEOMETRY,
            "Lateral tolerance. Parts block each other if their overlap along the direction "
            "of motion contains a disc of this radius.",
            parser=positive_number(),
        ),
    ] = 0.1,
    chord: Annotated[
        float | None,
        option(
            "--chord MM",
            GEOMETRY,
            "Largest distance of triangles from the curved faces of STEP. Default: half the "
            "tolerance.",
            parser=positive_number(),
        ),
    ] = None,
    directions: Annotated[
        Literal["axes", "cylinders", "contacts"],
        option(
            "--directions FROM",
            GEOMETRY,
            "Directions of motion: axes (of the file), cylinders (also the axes of screws and "
            "round fits), or contacts (also the normals and edges of flat contacts).",
            parser=one_of(_DIRECTIONS),
        ),
    ] = "cylinders",
    threads: Annotated[
        Literal["unscrew", "solid", "ignore"],
        option(
            "--threads HOW",
            GEOMETRY,
            "Treatment of threads. unscrew: a screw leaves its thread along its axis; solid: "
            "threads block as drawn; ignore: a screw and its mate never block each other.",
            parser=one_of(_THREADS),
        ),
    ] = "unscrew",
    split_bodies: Annotated[
        bool,
        option(
            "--split-bodies", GEOMETRY, "Import each body of a multi-body part as a separate part."
        ),
    ] = False,
    leave_out: Annotated[
        list[str] | None,
        option(
            "--leave-out PATTERN",
            GEOMETRY,
            "Leave out the parts whose name, or the last word of it, fits PATTERN, such as "
            "'label*'. Repeatable.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        option(
            "--only PATTERN", GEOMETRY, "Import only the parts whose name fits PATTERN. Repeatable."
        ),
    ] = None,
    as_one: Annotated[
        list[str] | None,
        option(
            "--as-one PATTERN",
            GEOMETRY,
            "Import all parts whose name fits PATTERN as one part, such as a bought-in "
            "cylinder with its rod. Repeatable.",
        ),
    ] = None,
    no_units: Annotated[
        bool,
        option(
            "--no-units",
            GEOMETRY,
            "Keep the parts of bought-in units apart, such as the rings of a bearing, and the "
            "bodies of a part that closes others in together.",
        ),
    ] = False,
    fit_allowance: Annotated[
        float | None,
        option(
            "--fit-allowance MM",
            GEOMETRY,
            "Greatest depth of an overlap that is a fit instead of interference, on each "
            "side. Default: the greatest interference of ISO 286 (zc6) by diameter; for a shaft in "
            "a hole the depth of a thread; for fasteners 25 % of the radius; for seals 30 % of the "
            "section; for parts drawn sunk in their seat 1 mm.",
            parser=positive_number(),
        ),
    ] = None,
    press_fit: Annotated[
        list[str] | None,
        option(
            "--press-fit A,B",
            GEOMETRY,
            "Take the overlap of parts A and B, names or patterns, as a fit, however deep. "
            "Repeatable.",
        ),
    ] = None,
    fastener: Annotated[
        list[str] | None,
        option(
            "--fastener PATTERN",
            GEOMETRY,
            "Take the parts whose name fits PATTERN as fasteners: nuts and washers if they "
            "have a bore, otherwise screws, unless their name says what they are. Repeatable.",
        ),
    ] = None,
    not_fastener: Annotated[
        list[str] | None,
        option(
            "--not-fastener PATTERN",
            GEOMETRY,
            "Take the parts whose name fits PATTERN as ordinary parts. Repeatable.",
        ),
    ] = None,
    no_holders: Annotated[
        bool,
        option(
            "--no-holders",
            GEOMETRY,
            "Leave out parts that do not stay where they are put, instead of holding them by "
            "supports of their own. The product is not turned then either.",
        ),
    ] = False,
    no_turns: Annotated[
        bool,
        option(
            "--no-turns",
            GEOMETRY,
            "Leave out parts and screws that do not come from above in one orientation, "
            "instead of turning the product on a workholder.",
        ),
    ] = False,
    thickness: Annotated[
        float | None,
        option(
            "--thickness MM",
            GEOMETRY,
            "Thickness of parts that are open surfaces. Without it they have the mass of "
            "their bounding boxes and are no parts of the task.",
            parser=positive_number(),
        ),
    ] = None,
    density: Annotated[
        float | None,
        option(
            "--density KG/M3",
            GEOMETRY,
            "Density of the parts without a material. Default: 7850 (steel).",
            parser=positive_number(),
        ),
    ] = None,
    material: Annotated[
        list[str] | None,
        option(
            "--material PATTERN=MATERIAL",
            GEOMETRY,
            "Material of the parts whose name fits PATTERN, such as 'lid*=abs': steel, "
            "stainless, cast-iron, aluminium, brass, copper, titanium, abs, pla, pa, pom, pc, "
            "wood and others, or a density in kg/m3. Repeatable; the last that fits counts.",
        ),
    ] = None,
    up: Annotated[
        Literal["auto", "x", "y", "z", "-x", "-y", "-z"],
        option(
            "--up AXIS",
            PLANNING,
            "Axis of the file that points up: x, y, z, -x, -y, -z, or auto: z, unless more "
            "parts stand by themselves and come straight down with another axis.",
            parser=one_of(_UPS),
        ),
    ] = "auto",
    base: Annotated[
        str | None,
        option(
            "--base PART",
            PLANNING,
            "Part to assemble the others onto. Default: chosen automatically; the output "
            "gives the reason.",
        ),
    ] = None,
    robot: Annotated[
        str,
        option(
            "--robot ARM",
            PLANNING,
            "Arm of the written task: panda, ur5e, or another of `skillplan check`; or auto: "
            "panda, or the weakest arm that carries and reaches more parts.",
        ),
    ] = "auto",
    nests: Annotated[
        bool,
        option(
            "--nests",
            PLANNING,
            "Cut a nest to print for each orientation of the plan, checked by rays, with "
            "drawings; see `skillplan nest`.",
        ),
    ] = False,
    no_nests: Annotated[
        bool,
        option(
            "--no-nests",
            PLANNING,
            "Leave the base on the table of the task. Without the option it stands in a nest "
            "if other parts would push it aside, or if an arm cannot drive its level screws there.",
        ),
    ] = False,
    jobs: Jobs = 1,
    no_cache: Annotated[
        bool, option("--no-cache", OUTPUT, "Ignore cached stages, and cache none.")
    ] = False,
    style: Style = "table",
) -> int:
    """Turn the CAD of a product into an assembly task.

    Finds parts, contacts and screws, tests which part blocks which in each direction, and plans
    the assembly. Writes relation.json (blockings), report.json (parts, masses, overlaps,
    assumptions, plan), exploded.png (drawing), import.html (a page with all of it and a playback),
    and product.yaml (a task that `skillplan check`
    accepts) with its meshes. Parts that one arm cannot place are left out of the task; the report
    gives the reasons. The exit code is 1 if no part is left for a task.

    Each stage is cached, so an interrupted import continues where it stopped. From the
    confirmation on, Ctrl-C and --time-limit keep the result so far: parts that were not examined or
    not tried are left out. Needs the plugin skillplan-cad.
    """
    from skillplan.cli.interruption import handle_signals
    from skillplan.cli.load import load_cad_command
    from skillplan.cli.output import emit
    from skillplan.cli.writing import tell
    from skillplan.errors import exit_code
    from skillplan.records.schemas import IMPORT
    from skillplan.views.report.import_page import draw_import
    from skillplan.views.tables import tabulate_import

    deadline = limits.begin(graceful=True)
    interrupted = threading.Event()

    @contextmanager
    def stopping() -> Iterator[Callable[[float], bool]]:
        with handle_signals(interrupted.set):
            yield lambda share: interrupted.is_set() or deadline.is_over(share)

    imported = load_cad_command("cad", "import-cad")(
        product,
        out,
        {
            "unit": unit,
            "tolerance_mm": tolerance,
            "chord_mm": chord,
            "up": up,
            "base": base,
            "robot": robot,
            "directions": directions,
            "threads": threads,
            "split_bodies": split_bodies,
            "thickness_mm": thickness,
            "fit_allowance_mm": fit_allowance,
            "press_fit": press_fit,
            "fastener": fastener,
            "not_fastener": not_fastener,
            "leave_out": leave_out,
            "only": only,
            "as_one": as_one,
            "uniting": not no_units,
            "density_kg_m3": density,
            "material": material,
            "nests": nests,
            "nesting": not no_nests,
            "jobs": jobs,
            "holding": not no_holders,
            "turning": not no_turns,
            "keep": not no_cache,
        },
        lambda line: tell(f"skillplan: {line}"),
        draw_import,
        stopping,
        deadline.attempt,
        deadline.measure_share,
    )
    for warning in imported.warnings:
        tell(f"skillplan: warning: {warning}")
    document = {"schema": IMPORT, **imported.document}
    tables = tabulate_import(document, imported.lines, imported.advice, whole=style != "table")
    # CSV prints the last table.
    emit(style, document, tables[:1] if style == "csv" else tables)
    return exit_code(solved=imported.complete, interrupted=interrupted.is_set())
