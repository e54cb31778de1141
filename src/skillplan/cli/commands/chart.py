"""``skillplan chart``."""

from __future__ import annotations

import click

from skillplan.cli.options import (
    asked,
    back_end_options,
    format_option,
    jobs_option,
    make_setup,
    no_cache_option,
    part_option,
    set_option,
    settings,
    task_argument,
)


@click.command("chart")
@task_argument
@back_end_options
@set_option
@part_option
@jobs_option
@no_cache_option
@format_option
def command(
    task: str,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    jobs: int,
    no_cache: bool,
    style: str,
) -> int:
    """Derive the precedence relation of TASK by asking back ends, by default aabb.

    Shows it beside the hand-made chart, if the task has one: hand-made relations that do not
    follow from the derived ones are missing, derived ones that do not follow from the
    hand-made are extra.
    """
    from contextlib import closing

    from skillplan.chart.precedence_chart import derive_chart
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import showing_checks
    from skillplan.pipeline.run import make_feasibility, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.chart import chart_document
    from skillplan.views.tables.chart import chart_table

    loaded = load_problem(task, asked(physics, collision or "aabb"), settings(changes)).part(part)
    # A chart derived from the chart would say nothing.
    setup = make_setup(physics, collision or "aabb", options)(loaded)
    cache = None if no_cache else warm_cache()
    with showing_checks("deriving") as on_check:
        feasibility = make_feasibility(loaded, setup, cache, jobs=jobs, on_check=on_check)
        with closing(feasibility):
            chart = derive_chart(feasibility)
    names = [back_end.name for back_end in feasibility.back_ends]
    emit(style, chart_document(chart, loaded, names), [chart_table(chart, loaded, names)])
    return 0
