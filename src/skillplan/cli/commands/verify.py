"""``skillplan verify``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.options.completion import task_files
from skillplan.cli.options.shared import (
    BACK_ENDS,
    OUTPUT,
    TASK,
    Style,
    memory_limit_option,
    time_limit_option,
)


def command(
    result: Annotated[
        str,
        typer.Argument(
            metavar="RESULT",
            help="A result.json of search-optimal, or the folder that --out named.",
            show_default=False,
        ),
    ],
    *,
    task_file: Annotated[
        str | None,
        typer.Option(
            "--task",
            metavar="FILE",
            autocompletion=task_files,
            help="The task file; default: the one that the result names, from here or beside the "
            "result.",
            rich_help_panel=TASK,
        ),
    ] = None,
    warm: Annotated[
        bool,
        typer.Option(
            "--warm",
            help="Use verdicts kept on disk instead of asking back ends about everything; the "
            "result is then no better than they are.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = False,
    time_limit_s: Annotated[
        float,
        time_limit_option("Prove nothing a second time that takes longer than S seconds in all."),
    ] = 60.0,
    memory_limit_bytes: Annotated[
        int | None,
        memory_limit_option("Prove nothing a second time that takes more memory in all than this"),
    ] = None,
    referee: Annotated[
        str | None,
        typer.Option(
            "--with",
            metavar="REFEREE",
            help="Have the claims about all plans checked by a planner of others, too: "
            "fast-downward, which sees nothing but PDDL. It comes with the extra planner. If its "
            "proof contradicts the result, the exit code is 3.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = None,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            help="Show every claim with how it was checked, also those that hold, which back "
            "ends were asked with which options, and what could not be checked.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    style: Style = "table",
) -> int:
    """Check the claims of RESULT independently of what made it.

    The plan is replayed, the arithmetic is done again, and what is claimed of all plans is proved
    a second time, by another method, where the case is small enough and the time limit allows.
    Every other figure, and the files beside it, must be what they come to. What does not hold is
    listed, what does is summed up.
    """
    from dataclasses import replace

    from skillplan.cli.output import emit
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import exit_code
    from skillplan.pipeline.certification import certify, check_referee, referee_claims
    from skillplan.pipeline.solving import open_warm_cache
    from skillplan.views.tables.results import certificate_summary, certificate_table, csv_files

    if referee is not None:
        check_referee(referee)
    with stoppable(time_limit_s, label="verifying", memory_limit_bytes=memory_limit_bytes) as stop:
        cache = open_warm_cache() if warm else None
        certificate = certify(result, task_file, stop=stop, cache=cache, saved_tables=csv_files)
        if referee is not None:
            more = referee_claims(result, task_file, time_limit_s, stop)
            certificate = replace(certificate, claims=(*certificate.claims, *more))
    code = exit_code(
        interrupted=stop.interrupted,
        back_end_failed=certificate.contradicted,
        solved=certificate.valid,
    )
    # Only people want it short: Markdown and CSV hold every claim.
    whole = verbose or style != "table"
    table = certificate_table(certificate) if whole else certificate_summary(certificate)
    emit(style, certificate.document(), [table], failed=code != 0)
    return code
