"""Arguments and options that several commands have, each by itself."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import typer

from skillplan.cli.options.completion import plugin_names, task_files
from skillplan.cli.options.panels import BACK_ENDS, OUTPUT, SOLVER
from skillplan.cli.options.values import count_option, one_of, whole_number

FORMATS = ("table", "json", "csv", "md")
_MOST_SEED = 2**63 - 1

TaskFile = Annotated[
    str,
    typer.Argument(
        metavar="TASK",
        autocompletion=task_files,
        help="A task file: YAML, or TSPLIB's .sop.",
        show_default=False,
    ),
]
MaybeTaskFile = Annotated[
    str | None,
    typer.Argument(metavar="TASK", autocompletion=task_files, help="A task file."),
]
Style = Annotated[
    Literal["table", "json", "csv", "md"],
    typer.Option(
        "--format",
        parser=one_of(FORMATS),
        metavar="FORMAT",
        help="How to print: table, json, csv or md; json holds everything in one document.",
        rich_help_panel=OUTPUT,
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed",
        parser=whole_number(0, _MOST_SEED),
        metavar="N",
        help="Governs all randomness.",
        rich_help_panel=SOLVER,
    ),
]
Jobs = Annotated[
    int,
    count_option(
        "--jobs",
        least=1,
        most=256,
        text="How many processes may be used at once: for checks of expensive back ends, by "
        "solvers that can, for runs, and for solvers side by side. Nothing that comes out depends "
        "on it, but times do.",
        rich_help_panel=BACK_ENDS,
    ),
]
ExecutorName = Annotated[
    str,
    typer.Option(
        "--executor",
        metavar="NAME[:ADDRESS]",
        autocompletion=plugin_names("executor"),
        help="Where those processes are: local for this machine, ray for a cluster that has been "
        "started, if skillplan-ray is installed. Nothing that comes out depends on that either.",
        rich_help_panel=BACK_ENDS,
    ),
]
Audit = Annotated[
    int | None,
    count_option(
        "--audit",
        least=0,
        most=100_000,
        text="How many verdicts that the search has reused are asked again after it, where they "
        "were reused; by default 4, and none of expensive back ends",
        rich_help_panel=BACK_ENDS,
        show_default=False,
    ),
]
NoScreening = Annotated[
    bool,
    typer.Option(
        "--no-screening",
        help="Leave all to a physics engine. Otherwise geometry is asked first (swept, if it is "
        "installed), and what it refuses is executed only for a sample.",
        rich_help_panel=BACK_ENDS,
    ),
]


def solver_option(text: str, **details: Any) -> Any:
    """Return the option that names one solver; `text` is its help."""
    return typer.Option(
        "--solver",
        metavar="NAME",
        autocompletion=plugin_names("solver"),
        help=text,
        rich_help_panel=SOLVER,
        **details,
    )
