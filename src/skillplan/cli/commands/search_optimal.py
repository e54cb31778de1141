"""``skillplan search-optimal``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.option_values import fraction
from skillplan.cli.options import (
    LIMITS,
    OUTPUT,
    SOLVER,
    BackEnds,
    Checking,
    Limits,
    PartReading,
    Seed,
    Style,
    TaskFile,
    solver_option,
)


def command(
    task: TaskFile,
    reading: PartReading,
    *,
    solver: Annotated[
        str | None,
        solver_option(
            "Which solver searches; for a chain also one for each stage, as "
            "heads=monte-carlo,base=sarsa; default: auto, which chooses and says why; for the "
            "bench exact, for several robots on it fleet."
        ),
    ] = None,
    seed: Seed = 0,
    start: Annotated[
        str | None,
        typer.Option(
            "--start",
            metavar="RESULT",
            help="Start from the plan of an earlier result of the same task: a result.json, or "
            "the folder that --out named. What is found is never worse.",
            rich_help_panel=SOLVER,
        ),
    ] = None,
    back_ends: BackEnds,
    checking: Checking,
    limits: Limits,
    gap: Annotated[
        float,
        typer.Option(
            "--gap",
            parser=fraction,
            metavar="G",
            help="Stop once cost and lower bound are this close, as a fraction of the cost.",
            rich_help_panel=LIMITS,
        ),
    ] = 0.0,
    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Also save result.json, plan.csv and, of a solver that learns one, policies.json "
            "in a new folder.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    style: Style = "table",
) -> int:
    """Find the best sequence of skills for TASK and prove it.

    Ctrl-C, like the limits of time and memory, prints the best plan so far with its lower bound
    and gap.
    """
    from dataclasses import replace

    from skillplan.cli.output import as_json, emit, exit_code, prepare_folder, save
    from skillplan.pipeline.chain import solve_chain, solver_names
    from skillplan.pipeline.run import solve
    from skillplan.records.chain_result import ChainResult
    from skillplan.records.policy_file import policy_document
    from skillplan.records.result import Result
    from skillplan.records.result_file import start_plan
    from skillplan.views.tables.chain import appendix_tables, chain_tables
    from skillplan.views.tables.results import plan_table
    from skillplan.views.tables.table import as_csv

    part = reading.part
    problem = reading.problem(task, back_ends)
    solver = solver or problem.domain.default_solver(problem.config)
    setup = back_ends.setup(problem.tasks[-1], solver_names(solver))
    plan = None if start is None else start_plan(start, problem, part)
    origin = setup.origin(task, part, reading.settings())
    folder = prepare_folder(out)
    result: Result | ChainResult
    with limits.stoppable(solver, gap) as stop:
        cache = checking.cache()
        if problem.is_chain and part is None:
            chain = solve_chain(
                problem, solver, setup, seed=seed, stop=stop, cache=cache, jobs=checking.jobs
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
                jobs=checking.jobs,
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
