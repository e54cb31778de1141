"""``skillplan advise``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.load import load_file, load_result, make_setup, open_cache
from skillplan.cli.options import shared
from skillplan.cli.options.completion import task_files
from skillplan.cli.options.values import count_option, option, positive_number
from skillplan.cli.writing import tell

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.pipeline.advising import Try

_MOST_SHIFT_M = 2.0
_TRIES = 60


def command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="TASK|RESULT",
            help="A task file, or a result.json of search-optimal or its folder: then with its "
            "file, changes and back ends.",
            autocompletion=task_files,
            show_default=False,
        ),
    ],
    reading: shared.ResultReading,
    *,
    within: Annotated[
        float,
        option(
            "--within M",
            shared.TASK,
            "Greatest shift of a place along x and along y, in metres.",
            parser=positive_number(_MOST_SHIFT_M),
        ),
    ] = 0.2,
    solver: Annotated[
        str | None,
        shared.solver_option("Solver of all tasks. Default: the choice of the kind of task."),
    ] = None,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    tries: Annotated[
        int,
        count_option(
            "--tries",
            minimum=1,
            maximum=10_000,
            text="Number of changed tasks to solve at most",
            rich_help_panel=shared.SOLVER,
        ),
    ] = _TRIES,
    time_limit_s: Annotated[
        float | None, shared.time_limit_option("Stop after S seconds with the advice found so far.")
    ] = None,
    out: Annotated[
        str | None,
        option(
            "--out FILE",
            shared.OUTPUT,
            "Save the advice as FILE.json, which 'skillplan report' shows. FILE must be new.",
        ),
    ] = None,
    style: shared.Style = "table",
) -> int:
    """Try changes of the cell and list the ten that save most.

    Places of holders, feeders, fixtures, starts and home, tools, grips, rules of the chart, and the
    height and speed of travels are changed, one at a time. Each changed task passes the checks of
    its file and is solved as TASK is. Ctrl-C keeps the advice found so far.
    """
    from dataclasses import replace

    from skillplan.cli.output import emit, write_new_file
    from skillplan.cli.waiting import stoppable
    from skillplan.cli.writing import as_json
    from skillplan.errors import exit_code
    from skillplan.files.output_path import check_output_path
    from skillplan.pipeline.advising import advise
    from skillplan.records.stored.result_folder import is_result
    from skillplan.views.tables.results import tabulate_advice

    if out is not None:
        check_output_path("--out", out, (".json",), "advice")
    start = None
    if is_result(source):
        loaded = load_result(source, reading, back_ends, executor=checking.executor)
        problem, setup, origin = loaded.problem, loaded.setup, loaded.origin
        changes, part = dict(origin.changes), origin.part
        if not loaded.stored.is_chain and loaded.stored.cost is not None:
            start = loaded.planned()[1]
    else:
        problem = load_file(source, reading, back_ends)
        setup = make_setup(back_ends, problem.tasks[-1], screening=True, executor=checking.executor)
        changes, part = reading.settings(), reading.part
        origin = setup.origin(source, part, changes)

    def show(done: Try) -> None:
        if sys.stderr.isatty():
            saves = "no plan" if done.saving is None else f"saves {done.saving:.4g}"
            tell(f"{done.number} of {done.most}: {done.words}: {saves}")

    with stoppable(time_limit_s, label="advising") as stop:
        advice = advise(
            problem,
            setup,
            changes=changes,
            solver=solver,
            start=start,
            within_m=within,
            tries=tries,
            stop=stop,
            cache=open_cache(checking),
            jobs=checking.jobs,
            on_try=show,
        )
    advice = replace(advice, origin=origin)
    if out is not None:
        write_new_file(out, as_json(advice.document()), (".json",), "advice")
    code = exit_code(solved=advice.base.cost is not None, interrupted=advice.interrupted)
    emit(style, advice.document(), [tabulate_advice(advice)], failed=code != 0)
    return code
