"""``skillplan compare``."""

from __future__ import annotations

import click

from skillplan.cli.options import (
    PluginName,
    asked,
    back_end_options,
    format_option,
    make_setup,
    seed_option,
    split_names,
    task_argument,
    time_limit_option,
)


@click.command("compare")
@task_argument
@click.option(
    "--solvers",
    type=PluginName("solver", several=True),
    metavar="A,B,C",
    required=True,
    help="Solvers, separated by commas.",
)
@back_end_options
@time_limit_option()
@seed_option
@click.option(
    "--warm", is_flag=True, help="Let solvers use verdicts kept on disk; says so in the title."
)
@format_option
def command(
    task: str,
    solvers: str,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    time_limit_s: float | None,
    seed: int,
    warm: bool,
    style: str,
) -> int:
    """Run several solvers on TASK side by side.

    Each starts with a cold cache of verdicts and its own time limit. A solver whose claimed
    bound is refuted by another's plan is marked wrong.
    """
    from contextlib import ExitStack
    from dataclasses import replace

    from skillplan.cli.output import emit, exit_code
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import OptionError
    from skillplan.report.result_tables import comparison_table
    from skillplan.run import make_solver, solve_all
    from skillplan.setup import load_problem
    from skillplan.solvers.stop import Stop

    names = tuple(split_names(solvers))
    if not names:
        raise OptionError("--solvers names no solver.")
    loaded = load_problem(task, asked(physics, collision)).task
    setup = make_setup(physics, collision, options, names)(loaded)
    for name in names:
        make_solver(name, setup.options.get(name, {}))
    with ExitStack() as waiting:

        def make_stop(name: str) -> Stop:
            waiting.pop_all().close()
            return waiting.enter_context(stoppable(time_limit_s, label=name))

        results = solve_all(loaded, names, setup, seed=seed, make_stop=make_stop, warm=warm)
    title = f"{loaded.name}: {results[0].physics} physics, collision {results[0].collision}, "
    title += "warm cache" if warm else "cold cache"
    not_run = list(names[len(results) :])
    document = {
        "schema": "skillplan.comparison/1",
        "warm": warm,
        "not_run": not_run,
        "rows": [result.document() for result in results],
    }
    code = exit_code(results)
    table = comparison_table(results, title)
    if not_run:
        table = replace(table, notes=(*table.notes, f"not run: {', '.join(not_run)}"))
    emit(style, document, [table], failed=code != 0)
    return code
