"""``skillplan import-cad``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

import typer

from skillplan.cli.options.shared import OUTPUT, CommandLimits, Jobs
from skillplan.cli.options.values import one_of, positive_number

GEOMETRY = "Geometry"
PLANNING = "Planning"

_UPS = ("auto", "x", "y", "z", "-x", "-y", "-z")
_DIRECTIONS = ("axes", "cylinders", "contacts")
_THREADS = ("unscrew", "solid", "ignore")
# Name of the plugin.
_NAME = "cad"


def command(
    product: Annotated[
        str,
        typer.Argument(
            metavar="FILE|FOLDER",
            help="A STEP file (.step, .stp, also .gz), or a folder of STL, OBJ or PLY files in "
            "one frame, one for each part.",
            show_default=False,
        ),
    ],
    out: Annotated[
        str,
        typer.Option(
            "--out",
            metavar="DIR",
            help="New or empty folder for the output.",
            rich_help_panel=OUTPUT,
            show_default=False,
        ),
    ],
    *,
    limits: CommandLimits,
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            metavar="UNIT",
            help="Unit of the meshes in a folder: um, mm, cm, m, inch or foot.",
            rich_help_panel=GEOMETRY,
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            "--tolerance",
            parser=positive_number(),
            metavar="MM",
            help="Lateral tolerance: two parts block each other if a disc of this radius is "
            "blocked.",
            rich_help_panel=GEOMETRY,
        ),
    ] = 0.1,
    chord: Annotated[
        float | None,
        typer.Option(
            "--chord",
            parser=positive_number(),
            metavar="MM",
            help="Maximum distance of triangles from curved faces of STEP. Default: half the "
            "tolerance.",
            rich_help_panel=GEOMETRY,
        ),
    ] = None,
    directions: Annotated[
        Literal["axes", "cylinders", "contacts"],
        typer.Option(
            "--directions",
            parser=one_of(_DIRECTIONS),
            metavar="FROM",
            help="Directions of motion: axes of the file; with axes of cylinders; with normals of "
            "flat contacts.",
            rich_help_panel=GEOMETRY,
        ),
    ] = "cylinders",
    threads: Annotated[
        Literal["unscrew", "solid", "ignore"],
        typer.Option(
            "--threads",
            parser=one_of(_THREADS),
            metavar="HOW",
            help="unscrew: a screw leaves its thread along its axis; solid: it blocks as drawn; "
            "ignore: it and its threaded hole never block each other.",
            rich_help_panel=GEOMETRY,
        ),
    ] = "unscrew",
    split_bodies: Annotated[
        bool,
        typer.Option(
            "--split-bodies",
            help="Treat each body of a part as a part of its own.",
            rich_help_panel=GEOMETRY,
        ),
    ] = False,
    density: Annotated[
        float | None,
        typer.Option(
            "--density",
            parser=positive_number(),
            metavar="KG/M3",
            help="Density of all parts. Default: that of steel, 7850.",
            rich_help_panel=GEOMETRY,
        ),
    ] = None,
    up: Annotated[
        Literal["auto", "x", "y", "z", "-x", "-y", "-z"],
        typer.Option(
            "--up",
            parser=one_of(_UPS),
            metavar="AXIS",
            help="Axis of the file that points up: x, y, z, -x, -y or -z. auto: z, or the axis "
            "with more parts that stand without support.",
            rich_help_panel=PLANNING,
        ),
    ] = "auto",
    base: Annotated[
        str | None,
        typer.Option(
            "--base",
            metavar="PART",
            help="Part that carries the others. Default: chosen automatically, with the reason.",
            rich_help_panel=PLANNING,
        ),
    ] = None,
    robot: Annotated[
        str,
        typer.Option(
            "--robot",
            metavar="ARM",
            help="Arm of the written task: panda or ur5e.",
            rich_help_panel=PLANNING,
        ),
    ] = "panda",
    jobs: Jobs = 1,
    no_cache: Annotated[
        bool,
        typer.Option(
            "--no-cache",
            help="Neither read nor store stages on disk.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    style: Annotated[
        Literal["table", "json", "csv", "md"],
        typer.Option(
            "--format",
            parser=one_of(("table", "json", "csv", "md")),
            metavar="FORMAT",
            help="Output format: table, json, csv or md. json is the document of report.json.",
            rich_help_panel=OUTPUT,
        ),
    ] = "table",
) -> int:
    """Find parts, screws and their blocking relation in the CAD of a product.

    Writes relation.json (which part, moved in which direction, is blocked by which others, and
    where), report.json (parts, masses, assumptions, overlaps, the plan), and, unless a part is
    stuck, product.yaml with its meshes: a task that check accepts. Parts that one arm cannot put in
    place are left out of it, and named with the reason. Stages that ran before with the same input
    are not run again, also if --time-limit ended the command. Needs the plugin skillplan-cad.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.writing import tell
    from skillplan.errors import exit_code
    from skillplan.records.schemas import IMPORT
    from skillplan.views.figures.exploded_figure import render_exploded_png
    from skillplan.views.tables.installation import tabulate_import

    limits.begin(graceful=False)
    imported = _importer()(
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
            "density_kg_m3": density,
            "jobs": jobs,
            "keep": not no_cache,
        },
        lambda line: tell(f"skillplan: {line}"),
        render_exploded_png,
    )
    for warning in imported.warnings:
        tell(f"skillplan: warning: {warning}")
    document = {"schema": IMPORT, **imported.document}
    emit(style, document, [tabulate_import(document, imported.lines)])
    return exit_code(solved=imported.complete)


def _importer() -> Callable[..., Any]:
    """Return the importer of the plugin; raises PluginError if it is missing or broken."""
    from skillplan.errors import PluginError
    from skillplan.plugins.blame import ends_program
    from skillplan.plugins.installed import importers

    entry_points = [importer for importer in importers() if importer.name == _NAME]
    if not entry_points:
        raise PluginError(
            "import-cad is a command of the plugin skillplan-cad, which is not installed: "
            "pip install 'skillplan[cad]', or in a checkout "
            "pip install -c constraints.txt -e plugins/skillplan-cad."
        )
    if len(entry_points) > 1:
        owners = " and ".join(
            sorted(
                {
                    entry_point.dist.name
                    for entry_point in entry_points
                    if entry_point.dist is not None
                }
            )
        )
        raise PluginError(f"import-cad is provided by {owners}. Uninstall one of them.")
    try:
        loaded: Callable[..., Any] = entry_points[0].load()
    except BaseException as error:
        if ends_program(error):
            raise
        words = f"{type(error).__name__}: {error}"
        raise PluginError(
            f"import-cad cannot be imported ({entry_points[0].value}): {words}. "
            "Install skillplan-cad anew."
        ) from error
    return loaded
