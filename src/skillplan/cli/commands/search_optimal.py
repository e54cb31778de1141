"""``skillplan search-optimal``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from skillplan.cli.load import load_file, make_setup, open_cache
from skillplan.cli.options import shared
from skillplan.cli.options.values import fraction, option, split_names
from skillplan.errors import OptionError

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.cli.output import ResultFolder


def command(
    task: shared.TaskFile,
    reading: shared.PartReading,
    *,
    solver: Annotated[
        str | None,
        shared.solver_option(
            "Solver; for a chain also one for each stage, as heads=monte-carlo,base=sarsa. "
            "Default: the choice of the kind of task, mostly auto, which reports its choice."
        ),
    ] = None,
    seed: shared.Seed = 0,
    start: Annotated[
        str | None,
        option(
            "--start RESULT|0,1,...",
            shared.SOLVER,
            "Start from a known plan: a result.json or its folder, a sequence, or @FILE. It "
            "is replayed on TASK, which may have changed; if it holds, the result costs no "
            "more.",
        ),
    ] = None,
    back_ends: shared.BackEnds,
    no_screening: shared.NoScreening = False,
    checking: shared.Checking,
    audit: shared.Audit = None,
    limits: shared.Limits,
    gap: Annotated[
        float,
        option(
            "--gap G",
            shared.LIMITS,
            "Relative gap between cost and lower bound at which the search stops, from 0 to 1.",
            parser=fraction,
        ),
    ] = 0.0,
    pareto: Annotated[
        str | None,
        option(
            "--pareto A,B",
            shared.SOLVER,
            "Prove the Pareto front of two costs: distance, time, or the file's own cost, "
            "wear, energy. --out saves its points and a picture. Takes no --solver, --start, "
            "--gap.",
        ),
    ] = None,
    out: Annotated[
        str | None,
        option(
            "--out DIR",
            shared.OUTPUT,
            "Save plan.csv, policies.json (learners only) and result.json to DIR. DIR must "
            "be new or left over from an interrupted search.",
        ),
    ] = None,
    style: shared.Style = "table",
) -> int:
    """Find the best sequence of skills for TASK and prove it.

    Ctrl-C and the limits of time and memory end the search with the best plan so far, its lower
    bound and its gap.
    """
    if pareto is not None:
        given = {"--solver": solver, "--start": start, "--gap": gap or None, "--audit": audit}
        for name, value in given.items():
            if value is not None:
                raise OptionError(f"{name} is for one cost; leave it out with --pareto.")
        return _search_front(task, reading, pareto, back_ends, checking, limits, out, style)
    from contextlib import nullcontext
    from dataclasses import replace

    from skillplan.cli.output import emit, exit_code
    from skillplan.cli.writing import as_json
    from skillplan.pipeline.solving import list_solvers, solve_problem
    from skillplan.views.tables.results import tabulate_result

    part = reading.part
    problem = load_file(task, reading, back_ends)
    solver = solver or problem.domain.default_solver(problem.config)
    last = problem.tasks[-1] if part is None else problem.part(part)
    setup = make_setup(
        back_ends,
        problem.tasks[-1],
        list_solvers(solver),
        screening=not no_screening,
        executor=checking.executor,
    )
    plan = None
    if start is not None:
        from skillplan.pipeline.exchange import read_start

        plan = read_start(start, problem, part)
    with nullcontext() if out is None else _held(out) as folder:
        with limits.stoppable(solver, gap) as stop:
            result = solve_problem(
                problem,
                part,
                solver,
                setup,
                seed=seed,
                stop=stop,
                cache=open_cache(checking),
                jobs=checking.jobs,
                start=plan,
                audit=audit,
            )
        result = replace(result, origin=setup.origin(task, part, reading.settings()))
        tables = tabulate_result(result, last)
        if folder is not None:
            from skillplan.records.stored.policy_file import list_solved_tasks, make_policy_document
            from skillplan.records.stored.result_folder import POLICIES
            from skillplan.views.tables.results import render_csv_files

            beside = render_csv_files(result, last)
            policies = make_policy_document(problem.sha256, solver, list_solved_tasks(result, last))
            if policies is not None:
                beside[POLICIES] = as_json(policies)
            folder.finish(beside, as_json(result.document()))
    code = exit_code([result])
    emit(style, result.document(), tables, failed=code != 0)
    return code


def _search_front(
    path: str,
    reading: shared.PartReading,
    pareto: str,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    limits: shared.Limits,
    out: str | None,
    style: str,
) -> int:
    """Print and save the Pareto front of two costs."""
    from contextlib import nullcontext
    from dataclasses import replace

    from skillplan.cli.output import emit
    from skillplan.cli.writing import as_json
    from skillplan.errors import exit_code
    from skillplan.pipeline.pareto import check_costs, solve_front
    from skillplan.records.result import Status
    from skillplan.views.tables.results import tabulate_front

    problem = load_file(path, reading, back_ends)
    task = problem.part(reading.part)
    names = check_costs(problem, split_names(pareto))
    setup = make_setup(back_ends, task, executor=checking.executor)
    with nullcontext() if out is None else _held(out) as folder:
        with limits.stoppable(pareto) as stop:
            front = solve_front(
                problem, names, setup, stop=stop, cache=open_cache(checking), jobs=checking.jobs
            )
        front = replace(front, origin=setup.origin(path, reading.part, reading.settings()))
        table = tabulate_front(front)
        if folder is not None:
            from skillplan.records.stored.result_folder import FRONT_PICTURE, FRONT_POINTS
            from skillplan.views.figures.figure_file import render_figure
            from skillplan.views.figures.front_figure import draw_front_of
            from skillplan.views.text.table import render_csv

            picture = render_figure(draw_front_of(front), ".svg").decode("utf-8")
            beside = {FRONT_POINTS: render_csv(table), FRONT_PICTURE: picture}
            folder.finish(beside, as_json(front.document()))
    code = exit_code(
        solved=bool(front.points),
        wrong=front.status in (Status.WRONG, Status.REFUSED),
        interrupted=front.interrupted,
    )
    emit(style, front.document(), [table], failed=code != 0)
    return code


def _held(out: str) -> ResultFolder:
    """Return the folder of the result, locked against other searches."""
    from skillplan.cli.output import ResultFolder

    return ResultFolder(out)
