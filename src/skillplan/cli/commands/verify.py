"""``skillplan verify``."""

from __future__ import annotations

import click

from skillplan.cli.options import PositiveSeconds, TaskPath, format_option, no_cache_option


@click.command("verify")
@click.argument("result", type=click.Path())
@click.option(
    "--task",
    "task_file",
    type=TaskPath(),
    metavar="FILE",
    help="The task file; default: the one that the result names, from here or beside the result.",
)
@click.option(
    "--time-limit",
    "time_limit_s",
    type=PositiveSeconds(),
    metavar="S",
    default=60.0,
    show_default=True,
    help="Prove nothing a second time that takes longer than S seconds in all.",
)
@no_cache_option
@format_option
def command(
    result: str, task_file: str | None, time_limit_s: float, no_cache: bool, style: str
) -> int:
    """Check the claims of RESULT independently of what made it.

    RESULT is a result.json of search-optimal, or the folder that --out named. The plan is
    replayed, the arithmetic is done anew, and what is claimed of all plans is proved a second
    time, by another method, where the case is small enough and the time limit allows.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_NO_PLAN, EXIT_SOLVED
    from skillplan.pipeline.certification import certify
    from skillplan.pipeline.run import warm_cache
    from skillplan.views.tables.certificate import certificate_table

    with stoppable(time_limit_s, label="verifying") as stop:
        cache = None if no_cache else warm_cache()
        certificate = certify(result, task_file, stop=stop, cache=cache)
    code = EXIT_SOLVED if certificate.valid else EXIT_NO_PLAN
    if stop.interrupted:
        code = EXIT_INTERRUPTED
    emit(style, certificate.document(), [certificate_table(certificate)], failed=code != 0)
    return code
