"""``skillplan check``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.options import OUTPUT, Reading, Style, TaskFile


def command(
    task: TaskFile,
    reading: Reading,
    explain_errata: Annotated[
        bool,
        typer.Option(
            "--explain-errata",
            help="Also list what the paper behind this kind of task prints wrongly, by its "
            "geometry.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    style: Style = "table",
) -> int:
    """Validate TASK: faults of YAML, keys, references, order and geometry."""
    from skillplan.cli.output import emit
    from skillplan.errors import OptionError
    from skillplan.pipeline.setup import Setup
    from skillplan.records.checked import Checked
    from skillplan.views.tables.checked import checked_tables

    problem = reading.problem(task)
    names = [[made.name for made in Setup().back_ends(one)] for one in problem.tasks]
    errata = problem.domain.errata(problem.config) if explain_errata else None
    if explain_errata and errata is None:
        raise OptionError(f"No errata are known of the paper behind {problem.kind!r} tasks.")
    checked = Checked(problem, names, errata)
    emit(style, checked.document(), checked_tables(checked))
    return 0
