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
    from skillplan.report.table import Column, Table
    from skillplan.setup import Setup, load_problem

    problem = load_problem(task)
    tasks = []
    rows = []
    for one in problem.tasks:
        back_ends = Setup().back_ends(one)
        names = [back_end.name for back_end in back_ends]
        tasks.append(
            {
                "name": one.name,
                "skills": len(one.skills),
                "facts": len(one.facts),
                "observation": len(one.observation) or len(one.facts),
                "step_limit": one.step_limit,
                "back_ends": names,
            }
        )
        figures = (len(one.skills), len(one.facts), tasks[-1]["observation"], one.step_limit)
        rows.append((one.name, *(str(figure) for figure in figures), ", ".join(names)))
    document = {
        "schema": "skillplan.check/1",
        "task": {"name": problem.name, "kind": problem.kind, "sha256": problem.sha256},
        "valid": True,
        "tasks": tasks,
    }
    columns = [
        Column("task"),
        Column("actions", right=True),
        Column("facts", right=True),
        Column("observed", right=True),
        Column("step limit", right=True),
        Column("back ends"),
    ]
    notes = [f"kind       {problem.kind}", f"sha256     {problem.sha256}"]
    emit(style, document, [Table(f"{problem.name}: valid", columns, rows, notes)])
    return 0
