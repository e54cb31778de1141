"""``skillplan search-optimal``."""

from __future__ import annotations

import click

from skillplan.cli.options import (
    Fraction,
    PluginName,
    asked,
    back_end_options,
    format_option,
    jobs_option,
    make_setup,
    no_cache_option,
    part_option,
    seed_option,
    set_option,
    settings,
    task_argument,
    time_limit_option,
)


@click.command("search-optimal")
@task_argument
@click.option(
    "--solver",
    type=PluginName("solver"),
    metavar="NAME",
    help="Which solver searches; for a chain also one for each stage, as "
    "heads=monte-carlo,base=sarsa; default: exact, for several robots fleet, "
    "under chance value-iteration.",
)
@back_end_options
@set_option
@part_option
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
@jobs_option
@no_cache_option
@click.option(
    "--out",
    metavar="DIR",
    help="Also save result.json, plan.csv and, of a solver that learns one, policies.json in a "
    "new folder.",
)
@format_option
def command(
    task: str,
    solver: str | None,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    time_limit_s: float | None,
    gap: float,
    seed: int,
    jobs: int,
    no_cache: bool,
    out: str | None,
    style: str,
) -> int:
    """Find the best sequence of skills for TASK and prove it.

    Ctrl-C, like the time limit, prints the best plan so far with its lower bound and gap.
    """
    from skillplan.chain import solve_chain, solver_names
    from skillplan.cli.output import as_json, emit, exit_code, prepare_folder, save
    from skillplan.cli.waiting import stoppable
    from skillplan.report.chain_result import ChainResult
    from skillplan.report.chain_tables import appendix_tables, chain_tables
    from skillplan.report.policy_file import policy_document
    from skillplan.report.result import Result
    from skillplan.report.result_tables import plan_table
    from skillplan.report.table import as_csv
    from skillplan.run import solve, warm_cache
    from skillplan.setup import load_problem

    problem = load_problem(task, asked(physics, collision), settings(changes))
    solver = solver or problem.domain.default_solver(problem.config)
    setup = make_setup(physics, collision, options, solver_names(solver))(problem.tasks[-1])
    folder = prepare_folder(out)
    result: Result | ChainResult
    with stoppable(time_limit_s, gap, solver) as stop:
        cache = None if no_cache else warm_cache()
        if problem.is_chain and part is None:
            result = chain = solve_chain(
                problem, solver, setup, seed=seed, stop=stop, cache=cache, jobs=jobs
            )
            tables, appendix = chain_tables(chain), appendix_tables(chain)
            solved = [(part.task, part.result) for part in chain.parts if not part.reused]
        else:
            task_meant = problem.part(part)
            result = solve(task_meant, solver, setup, seed=seed, stop=stop, cache=cache, jobs=jobs)
            tables, appendix = [plan_table(result, task_meant)], {}
            solved = [(task_meant, result)]
    if folder is not None:
        save(folder, "result.json", as_json(result.document()))
        save(folder, "plan.csv", as_csv(tables[-1]))
        for name, table in appendix.items():
            save(folder, name, as_csv(table))
        policies = policy_document(problem.sha256, solver, solved)
        if policies is not None:
            save(folder, "policies.json", as_json(policies))
    code = exit_code([result])
    emit(style, result.document(), tables, failed=code != 0)
    return code
