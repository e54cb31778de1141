"""``skillplan compare``."""

from __future__ import annotations

from collections.abc import Sequence

import click

from skillplan.cli.options import (
    PluginName,
    asked,
    back_end_options,
    format_option,
    make_setup,
    seed_option,
    set_option,
    settings,
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
    help="Solvers, separated by commas; for a chain also heads=monte-carlo+base=sarsa.",
)
@back_end_options
@set_option
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
    changes: tuple[str, ...],
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

    from skillplan.chain import solve_chain_with_all, solver_names
    from skillplan.cli.output import emit, exit_code
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import OptionError
    from skillplan.model.verdict_cache import VerdictCache
    from skillplan.report.chain_result import ChainResult
    from skillplan.report.chain_tables import chain_comparison_tables
    from skillplan.report.result import Result
    from skillplan.report.result_tables import comparison_table
    from skillplan.run import make_solver, solve_all, warm_cache
    from skillplan.setup import load_problem
    from skillplan.solvers.stop import Stop

    names = tuple(split_names(solvers))
    if not names:
        raise OptionError("--solvers names no solver.")
    problem = load_problem(task, asked(physics, collision), settings(changes))
    last = problem.tasks[-1]
    every = tuple(dict.fromkeys(each for name in names for each in solver_names(name)))
    setup = make_setup(physics, collision, options, every)(last)
    for name in every:
        make_solver(name, setup.options.get(name, {}))
    with ExitStack() as waiting:

        def make_stop(name: str) -> Stop:
            waiting.pop_all().close()
            return waiting.enter_context(stoppable(time_limit_s, label=name))

        title = f"{problem.name}: {setup.physics_choice(last).name} physics, collision "
        title += ",".join(choice.name for choice in setup.collision_choices(last)) or "none"
        title += ", warm cache" if warm else ", cold cache"
        results: Sequence[Result | ChainResult]
        if problem.is_chain:
            results = chains = solve_chain_with_all(
                problem,
                names,
                setup,
                seed=seed,
                make_stop=make_stop,
                make_cache=warm_cache if warm else VerdictCache,
            )
            tables = chain_comparison_tables(chains, title)
        else:
            results = single = solve_all(
                last, names, setup, seed=seed, make_stop=make_stop, warm=warm
            )
            tables = [comparison_table(single, title)]
    not_run = list(names[len(results) :])
    document = {
        "schema": "skillplan.comparison/1",
        "warm": warm,
        "not_run": not_run,
        "rows": [result.document() for result in results],
    }
    code = exit_code(results)
    if not_run:
        notes = (*tables[0].notes, f"not run: {', '.join(not_run)}")
        tables[0] = replace(tables[0], notes=notes)
    emit(style, document, tables, failed=code != 0)
    return code
