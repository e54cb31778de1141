"""``skillplan verify``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.options import shared
from skillplan.cli.options.values import option


def command(
    result: Annotated[
        str,
        typer.Argument(
            metavar="RESULT",
            help="A result.json of search-optimal, or its folder.",
            show_default=False,
        ),
    ],
    *,
    task_file: Annotated[
        str | None,
        shared.task_option(
            "Task file. Default: as RESULT names it, in the current folder or the folder of RESULT."
        ),
    ] = None,
    warm: Annotated[
        bool,
        option(
            "--warm",
            shared.BACK_ENDS,
            "Use verdicts kept on disk instead of querying back ends again. The verification "
            "then trusts these verdicts.",
        ),
    ] = False,
    time_limit_s: Annotated[
        float, shared.time_limit_option("Skip proofs that would exceed S seconds in total.")
    ] = 60.0,
    memory_limit_bytes: Annotated[
        int | None, shared.memory_limit_option("Skip proofs that would exceed this memory in total")
    ] = None,
    referee: Annotated[
        str | None,
        option(
            "--with REFEREE",
            shared.BACK_ENDS,
            "Check the claims about all plans with another planner, too: fast-downward, "
            "which gets only PDDL (needs the extra planner). If its proof contradicts the "
            "result, the exit code is 3.",
        ),
    ] = None,
    verbose: Annotated[
        bool,
        option(
            "--verbose",
            shared.OUTPUT,
            "Show all claims with the method of each check, the back ends with their "
            "options, and what could not be checked.",
        ),
    ] = False,
    style: shared.Style = "table",
) -> int:
    """Check the claims of RESULT independently of the solver that made it.

    The plan is replayed and its costs are added up again. Proofs are repeated with another method,
    if the case is small enough and the time limit allows. All other figures, and the files in the
    folder, must agree with the plan. Claims that fail are listed, the others are counted.
    """
    from dataclasses import replace

    from skillplan.cli.output import emit
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import exit_code
    from skillplan.pipeline.certification import certify, check_referee, referee_claims
    from skillplan.pipeline.solving import open_warm_cache
    from skillplan.views.tables.results import (
        render_csv_files,
        summarize_certificate,
        tabulate_certificate,
    )

    if referee is not None:
        check_referee(referee)
    with stoppable(time_limit_s, label="verifying", memory_limit_bytes=memory_limit_bytes) as stop:
        cache = open_warm_cache() if warm else None
        certificate = certify(
            result, task_file, stop=stop, cache=cache, saved_tables=render_csv_files
        )
        if referee is not None:
            more = referee_claims(result, task_file, time_limit_s, stop)
            certificate = replace(certificate, claims=(*certificate.claims, *more))
    code = exit_code(
        interrupted=stop.interrupted,
        back_end_failed=certificate.contradicted,
        solved=certificate.valid,
    )
    # The short form is for people; Markdown and CSV hold every claim.
    whole = verbose or style != "table"
    table = tabulate_certificate(certificate) if whole else summarize_certificate(certificate)
    emit(style, certificate.document(), [table], failed=code != 0)
    return code
