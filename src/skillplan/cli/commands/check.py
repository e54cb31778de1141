"""``skillplan check``."""

from __future__ import annotations

import click

from skillplan.cli.options import format_option, set_option, settings, task_argument


@click.command("check")
@task_argument
@set_option
@click.option(
    "--explain-errata",
    is_flag=True,
    help="Also list what the paper behind this kind of task prints wrongly, by its geometry.",
)
@format_option
def command(task: str, changes: tuple[str, ...], explain_errata: bool, style: str) -> int:
    """Validate TASK: faults of YAML, keys, references, order and geometry."""
    from skillplan.cli.output import emit
    from skillplan.errors import OptionError
    from skillplan.pipeline.setup import Setup, load_problem
    from skillplan.records.checked import Checked
    from skillplan.views.tables.checked import checked_tables

    problem = load_problem(task, None, settings(changes))
    names = [[made.name for made in Setup().back_ends(one)] for one in problem.tasks]
    errata = problem.domain.errata(problem.config) if explain_errata else None
    if explain_errata and errata is None:
        raise OptionError(f"No errata are known of the paper behind {problem.kind!r} tasks.")
    checked = Checked(problem, names, errata)
    emit(style, checked.document(), checked_tables(checked))
    return 0
