"""``skillplan check``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.load import load_file, make_setup, name_back_ends, open_cache
from skillplan.cli.options.completion import task_files
from skillplan.cli.options.shared import OUTPUT, BackEnds, Caching, CommandLimits, Reading, Style
from skillplan.cli.options.values import option
from skillplan.errors import OptionError


def command(
    task: Annotated[
        str,
        typer.Argument(
            metavar="TASK",
            autocompletion=task_files,
            help="A task file: YAML, or TSPLIB's .sop. Or a robot or tool alone: .urdf, .xacro, "
            "YAML of kind tool, or a name.",
            show_default=False,
        ),
    ],
    back_ends: BackEnds,
    reading: Reading,
    caching: Caching,
    limits: CommandLimits,
    style: Style = "table",
    picture: Annotated[
        str | None,
        option(
            "--picture FILE.png",
            OUTPUT,
            "Of a robot or tool alone: draw the arm at home, or the tool.",
        ),
    ] = None,
) -> int:
    """Validate TASK: faults of YAML, keys, references, order and geometry.

    Also warns of problems that would show only in a search: parts too wide for jaws, feeders that
    are blocked at the start, drawings in a doubtful unit, cycles of the precedence relation, and a
    chart that contradicts it. That relation is derived by kinematic and the default detector (swept
    if it is installed, or else aabb), and for hollow parts only if a detector is named. --physics
    and --collision name other back ends, which also report their faults in the parts. Properties
    that the back ends of a search leave unchecked are listed.

    If TASK is a URDF or xacro file, or an arm's name such as ur10e, the arm is described: joints,
    tip at zero, reach, masses, and what is assumed. --set robot.tip=LINK selects the tip of a file;
    robot.packages and robot.xacro_args work as in a task file.

    If it is a tool file (kind: tool) or a tool's name such as robotiq_2f85, the tool is described:
    type, length, limits, size and sources.
    """
    from itertools import chain

    from skillplan.checks.single_check import introduce_back_ends, list_not_checked
    from skillplan.cli.output import emit
    from skillplan.pipeline.obstacles import preview_problem
    from skillplan.records.questions import Checked
    from skillplan.views.tables.questions import tabulate_checked

    limits.begin(graceful=False)
    if task.lower().endswith((".urdf", ".xacro")) or _is_arm(task):
        return _describe_arm(task, reading, style, picture)
    if _is_tool(task):
        return _describe_tool(task, reading, style, picture)
    _refuse_unknown_arm(task)
    if picture is not None:
        raise OptionError("--picture draws a robot or tool alone, of a name or from its file.")
    problem = load_file(task, reading, back_ends, warn=False)
    setups = [make_setup(back_ends, task) for task in problem.tasks]
    back_ends_of = [
        introduce_back_ends(setup.back_ends(task))
        for setup, task in zip(setups, problem.tasks, strict=True)
    ]
    names = [[back_end.name for back_end in used] for used in back_ends_of]
    not_checked = list_not_checked(tuple(chain.from_iterable(back_ends_of)))
    first = setups[0]
    # Verdicts of instant checks are not worth a file.
    cache = open_cache(caching) if name_back_ends(back_ends) else None
    preview = preview_problem(problem, first.physics, first.collision, first.options, cache)
    checked = Checked(problem, names, preview, not_checked)
    emit(style, checked.document(), tabulate_checked(checked))
    return 0


def _is_arm(name: str) -> bool:
    """Return whether a name is that of an arm, and of no file here."""
    import os

    from skillplan.robots.catalogue import ARMS

    return name in ARMS and not os.path.exists(name)


def _is_tool(name: str) -> bool:
    """Return whether a name is that of a tool, or of a YAML file of the kind tool."""
    import os

    from skillplan.domains.assembly.tool_models import TOOLS, is_tool_file

    return is_tool_file(name) if os.path.exists(name) else name in TOOLS


def _refuse_unknown_arm(name: str) -> None:
    """Raise OptionError if a task is no file and resembles the name of an arm."""
    import os

    from skillplan.domains.assembly.tool_models import TOOLS
    from skillplan.errors import nearest
    from skillplan.robots.catalogue import ARMS

    known = [*ARMS, *TOOLS]
    similar = None if "." in name or os.path.exists(name) else nearest(name, known)
    if similar is not None:
        raise OptionError(f"{name}: no such file, arm or tool. Did you mean {similar!r}?")


def _describe_tool(path: str, reading: Reading, style: Style, picture: str | None) -> int:
    """Print the description of a tool alone, and draw it."""
    from skillplan.cli.output import emit
    from skillplan.cli.showing import resolve_drawing_paths
    from skillplan.domains.assembly.tool_summary import summarize_tool
    from skillplan.records import schemas
    from skillplan.views.tables.arm import tabulate_tool
    from skillplan.views.video_file import save_picture

    if reading.settings():
        raise OptionError("--set changes a task or a robot alone, not a tool: edit its file.")
    drawn = resolve_drawing_paths(picture, None)
    summary = summarize_tool(path)
    if drawn:
        from skillplan.views.figures.arm_figure import draw_tool

        for option, file in drawn.items():
            save_picture(draw_tool(summary), file, option)
    files = list(map(str, drawn.values()))
    document = {"schema": schemas.TOOL, **summary.document(), "files": files}
    emit(style, document, tabulate_tool(summary))
    return 0


def _describe_arm(path: str, reading: Reading, style: Style, picture: str | None) -> int:
    """Print the description of an arm alone, and draw it."""
    from skillplan.cli.output import emit
    from skillplan.cli.showing import resolve_drawing_paths
    from skillplan.domains.assembly.arm_summary import summarize_arm
    from skillplan.records import schemas
    from skillplan.views.tables.arm import tabulate_arm
    from skillplan.views.video_file import save_picture

    drawn = resolve_drawing_paths(picture, None)
    summary = summarize_arm(path, reading.settings())
    if drawn:
        from skillplan.views.figures.arm_figure import draw_arm

        for option, file in drawn.items():
            save_picture(draw_arm(summary), file, option)
    document = {
        "schema": schemas.ARM,
        **summary.document(),
        "files": list(map(str, drawn.values())),
    }
    emit(style, document, tabulate_arm(summary))
    return 0
