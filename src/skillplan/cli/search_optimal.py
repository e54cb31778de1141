"""``skillplan search-optimal``."""

from __future__ import annotations

import click

from skillplan.cli.options import (
    Fraction,
    PluginName,
    asked,
    back_end_options,
    format_option,
    make_setup,
    seed_option,
    task_argument,
    time_limit_option,
)


@click.command("search-optimal")
@task_argument
@click.option(
    "--solver",
    type=PluginName("solver"),
    metavar="NAME",
    default="exact",
    show_default=True,
    help="Which solver searches.",
)
@back_end_options
@time_limit_option()
@click.option(
    "--gap",
    type=Fraction(),
    metavar="G",
    default=0.0,
    show_default=True,
    help="Stop once cost and lower bound are this close, as a fraction of the cost.",
)
@seed_option
@click.option("--no-cache", is_flag=True, help="Neither read nor write verdicts kept on disk.")
@click.option("--out", metavar="DIR", help="Also save result.json and plan.csv in a new folder.")
@format_option
def command(
    task: str,
    solver: str,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    time_limit_s: float | None,
    gap: float,
    seed: int,
    no_cache: bool,
    out: str | None,
    style: str,
) -> int:
    """Find the best sequence of skills for TASK and prove it.

    Ctrl-C, like the time limit, prints the best plan so far with its lower bound and gap.
    """
    from skillplan.cli.output import as_json, emit, exit_code, prepare_folder, save
    from skillplan.cli.waiting import stoppable
    from skillplan.report.result_tables import plan_table
    from skillplan.report.table import as_csv
    from skillplan.run import solve, warm_cache
    from skillplan.setup import load_problem

    loaded = load_problem(task, asked(physics, collision)).task
    setup = make_setup(physics, collision, options, (solver,))(loaded)
    folder = prepare_folder(out)
    with stoppable(time_limit_s, gap, solver) as stop:
        cache = None if no_cache else warm_cache()
        result = solve(loaded, solver, setup, seed=seed, stop=stop, cache=cache)
    table = plan_table(result, loaded)
    if folder is not None:
        save(folder, "result.json", as_json(result.document()))
        save(folder, "plan.csv", as_csv(table))
    code = exit_code([result])
    emit(style, result.document(), [table], failed=code != 0)
    return code
