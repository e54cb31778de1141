"""``skillplan search-optimal``."""

from __future__ import annotations

import click

from skillplan.cli.limit_options import memory_limit_option, stall_option
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
    "heads=monte-carlo,base=sarsa; default: auto, which chooses and says why; for the bench "
    "exact, for several robots on it fleet.",
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
@stall_option
@memory_limit_option
@click.option(
    "--start",
    type=click.Path(),
    metavar="RESULT",
    help="Start from the plan of an earlier result of the same task: a result.json, or the "
    "folder that --out named. What is found is never worse.",
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
    stall_s: float | None,
    memory_limit_bytes: int | None,
    start: str | None,
    seed: int,
    jobs: int,
    no_cache: bool,
    out: str | None,
    style: str,
) -> int:
    """Find the best sequence of skills for TASK and prove it.

    Ctrl-C, like the limits of time and memory, prints the best plan so far with its lower bound
    and gap.
    """
    from dataclasses import replace

    from skillplan.cli.output import as_json, emit, exit_code, prepare_folder, save
    from skillplan.cli.waiting import stoppable
    from skillplan.pipeline.chain import solve_chain, solver_names
    from skillplan.pipeline.run import solve, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.chain_result import ChainResult
    from skillplan.records.policy_file import policy_document
    from skillplan.records.result import Result
    from skillplan.records.result_file import start_plan
    from skillplan.views.tables.chain import appendix_tables, chain_tables
    from skillplan.views.tables.results import plan_table
    from skillplan.views.tables.table import as_csv

    changed = settings(changes)
    problem = load_problem(task, asked(physics, collision), changed)
    solver = solver or problem.domain.default_solver(problem.config)
    setup = make_setup(physics, collision, options, solver_names(solver))(problem.tasks[-1])
    plan = None if start is None else start_plan(start, problem, part)
    origin = setup.origin(task, part, changed)
    folder = prepare_folder(out)
    result: Result | ChainResult
    with stoppable(
        time_limit_s, gap, solver, stall_s=stall_s, memory_limit_bytes=memory_limit_bytes
    ) as stop:
        cache = None if no_cache else warm_cache()
        if problem.is_chain and part is None:
            chain = solve_chain(
                problem, solver, setup, seed=seed, stop=stop, cache=cache, jobs=jobs
            )
            result = chain = replace(chain, origin=origin)
            tables, appendix = chain_tables(chain), appendix_tables(chain)
            solved = [(part.task, part.result) for part in chain.parts if not part.reused]
        else:
            task_meant = problem.part(part)
            found = solve(
                task_meant,
                solver,
                setup,
                seed=seed,
                stop=stop,
                cache=cache,
                jobs=jobs,
                start=plan,
            )
            result = found = replace(found, origin=origin)
            tables, appendix = [plan_table(found, task_meant)], {}
            solved = [(task_meant, found)]
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
