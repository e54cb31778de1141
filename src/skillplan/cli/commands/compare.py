"""``skillplan compare``."""

from __future__ import annotations

from collections.abc import Sequence

import click

from skillplan.cli.limit_options import memory_limit_option, stall_option
from skillplan.cli.options import (
    PluginName,
    asked,
    back_end_options,
    format_option,
    jobs_option,
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
    help="Solvers, separated by commas; for a chain also heads=monte-carlo+base=sarsa.",
)
@click.option(
    "--detectors",
    type=PluginName("collision", several=True),
    metavar="A,B,C",
    help="Instead of solvers: collision detectors, tried on executions known to be right or wrong.",
)
@click.option(
    "--staged",
    type=click.IntRange(0, 1000),
    default=40,
    show_default=True,
    metavar="N",
    help="For --detectors: how many collisions are staged at most, and how many near misses.",
)
@back_end_options
@set_option
@time_limit_option()
@stall_option
@memory_limit_option
@seed_option
@jobs_option
@click.option(
    "--warm", is_flag=True, help="Let solvers use verdicts kept on disk; says so in the title."
)
@format_option
def command(
    task: str,
    solvers: str | None,
    detectors: str | None,
    staged: int,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    time_limit_s: float | None,
    stall_s: float | None,
    memory_limit_bytes: int | None,
    seed: int,
    jobs: int,
    warm: bool,
    style: str,
) -> int:
    """Run several solvers, or collision detectors, on TASK side by side.

    Each solver starts with a cold cache of verdicts and its own time limit; one whose claimed
    bound is refuted by another's plan is marked wrong. Detectors rule on executions that are
    right by the hand-made chart and on collisions staged from the task: false alarms, misses
    and the figures that decide.
    """
    from contextlib import ExitStack
    from dataclasses import replace

    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.cli.output import emit, exit_code
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import OptionError
    from skillplan.pipeline.chain import solver_names
    from skillplan.pipeline.comparison import solve_all, solve_chain_with_all
    from skillplan.pipeline.run import check_solver, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records import schemas
    from skillplan.records.chain_result import ChainResult
    from skillplan.records.result import Result
    from skillplan.solvers.stop import Stop
    from skillplan.views.tables.chain import chain_comparison_tables
    from skillplan.views.tables.results import comparison_table

    if (solvers is None) == (detectors is None):
        raise OptionError("Give either --solvers or --detectors.")
    if detectors is not None:
        from skillplan.cli.detector_comparison import compare_detectors

        if collision is not None:
            raise OptionError("--collision is for --solvers; name detectors in --detectors.")
        given = {"--warm": warm, "--jobs": jobs != 1, "--stall": stall_s is not None}
        given["--memory-limit"] = memory_limit_bytes is not None
        for option in (option for option, present in given.items() if present):
            raise OptionError(f"{option} is for --solvers.")
        return compare_detectors(
            task,
            detectors,
            dict(asked(physics, None)),
            settings(changes),
            lambda chosen: make_setup(physics, chosen, options),
            staged=staged,
            time_limit_s=time_limit_s,
            style=style,
        )
    names = tuple(split_names(solvers or ""))
    if not names:
        raise OptionError("--solvers names no solver.")
    changed = settings(changes)
    problem = load_problem(task, asked(physics, collision), changed)
    last = problem.tasks[-1]
    every = tuple(dict.fromkeys(each for name in names for each in solver_names(name)))
    setup = make_setup(physics, collision, options, every)(last)
    for name in every:
        check_solver(name, setup.options.get(name, {}))
    with ExitStack() as waiting:

        def make_stop(name: str) -> Stop:
            waiting.pop_all().close()
            return waiting.enter_context(
                stoppable(
                    time_limit_s,
                    label=name,
                    stall_s=stall_s,
                    memory_limit_bytes=memory_limit_bytes,
                )
            )

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
                jobs=jobs,
            )
            tables = chain_comparison_tables(chains, title)
        else:
            results = single = solve_all(
                last, names, setup, seed=seed, make_stop=make_stop, warm=warm, jobs=jobs
            )
            tables = [comparison_table(single, title, last.metric.decimals)]
    origin = setup.origin(task, None, changed)
    not_run = list(names[len(results) :])
    document = {
        "schema": schemas.COMPARISON,
        "warm": warm,
        "not_run": not_run,
        "rows": [replace(result, origin=origin).document() for result in results],
    }
    code = exit_code(results)
    if not_run:
        notes = (*tables[0].notes, f"not run: {', '.join(not_run)}")
        tables[0] = replace(tables[0], notes=notes)
    emit(style, document, tables, failed=code != 0)
    return code
