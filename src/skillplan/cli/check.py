"""``skillplan check``."""

from __future__ import annotations

import click

from skillplan.cli.options import format_option, task_argument


@click.command("check")
@task_argument
@format_option
def command(task: str, style: str) -> int:
    """Validate TASK: faults of YAML, keys, references, order and geometry."""
    from skillplan.cli.output import emit
    from skillplan.report.checked import Checked
    from skillplan.setup import Setup, load_problem

    problem = load_problem(task)
    names = [[made.name for made in Setup().back_ends(one)] for one in problem.tasks]
    checked = Checked(problem, names)
    emit(style, checked.document(), [checked.table()])
    return 0
