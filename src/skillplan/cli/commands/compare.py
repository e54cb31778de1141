"""``skillplan compare``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from skillplan.cli.load import load_file, make_setup
from skillplan.cli.options import shared
from skillplan.cli.options.completion import plugin_lists
from skillplan.cli.options.values import count_option, option, split_names

COMPARED = "Compared"


def command(
    task: shared.TaskFile,
    reading: shared.Reading,
    *,
    solvers: Annotated[
        str | None,
        option(
            "--solvers A,B,C",
            COMPARED,
            "Solvers, separated by commas; for a chain also heads=monte-carlo+base=sarsa.",
            autocompletion=plugin_lists("solver"),
        ),
    ] = None,
    detectors: Annotated[
        str | None,
        option(
            "--detectors A,B,C",
            COMPARED,
            "Instead of solvers: collision detectors, tried on executions known to be "
            "right or wrong.",
            autocompletion=plugin_lists("collision"),
        ),
    ] = None,
    engines: Annotated[
        str | None,
        option(
            "--engines A,B",
            COMPARED,
            "Instead of solvers: physics engines, compared on every skill in every state that "
            "they can reach.",
            autocompletion=plugin_lists("physics"),
        ),
    ] = None,
    pictures: Annotated[
        str | None,
        option(
            "--pictures DIR",
            COMPARED,
            "For --engines: draw every contradiction into DIR, by each engine that draws.",
        ),
    ] = None,
    staged: Annotated[
        int,
        count_option(
            "--staged",
            minimum=0,
            maximum=1000,
            text="For --detectors: largest number of injected collisions, and of near misses.",
            rich_help_panel=COMPARED,
        ),
    ] = 40,
    seed: shared.Seed = 0,
    back_ends: shared.BackEnds,
    no_screening: shared.NoScreening = False,
    workers: shared.Workers,
    audit: shared.Audit = None,
    warm: Annotated[
        bool,
        option(
            "--warm",
            shared.BACK_ENDS,
            "Let solvers use verdicts stored on disk; the title shows this.",
        ),
    ] = False,
    limits: shared.Limits,
    style: shared.Style = "table",
) -> int:
    """Compare several solvers, collision detectors or physics engines on TASK.

    Each solver starts with an empty verdict cache and has its own limits. A solver is marked wrong
    if the plan of another one refutes its bound. Solvers run in turn, or with --jobs up to their
    number in parallel, each in a process. Detectors check executions that are right by the
    hand-made chart, and injected collisions: the table shows false alarms, misses and the decisive
    readings. Engines execute every applicable skill in every state that one of them reaches: the
    table shows how often they agree, and the evidence of both for every contradiction.
    """
    from skillplan.errors import OptionError

    if [solvers, detectors, engines].count(None) != 2:
        raise OptionError("Give one of --solvers, --detectors and --engines.")
    if pictures is not None and engines is None:
        raise OptionError("--pictures is for --engines.")
    if solvers is None:
        if detectors is not None and back_ends.collision is not None:
            raise OptionError("--collision is for --solvers; name detectors in --detectors.")
        if engines is not None and back_ends.physics is not None:
            raise OptionError("--physics is for --solvers; name engines in --engines.")
        given = {
            "--no-screening": no_screening,
            "--warm": warm,
            "--jobs": workers.jobs != 1 and engines is None,
            "--executor": workers.executor != "local" and engines is None,
            "--audit": audit is not None,
            "--stall": limits.stall_s is not None,
            "--memory-limit": limits.memory_limit_bytes is not None,
        }
        for option in (option for option, present in given.items() if present):
            raise OptionError(f"{option} is for --solvers.")
    if engines is not None:
        from skillplan.cli.back_end_comparison import compare_physics

        return compare_physics(
            task,
            engines,
            back_ends,
            reading,
            jobs=workers.jobs,
            executor=workers.executor,
            pictures=pictures,
            time_limit_s=limits.time_limit_s,
            style=style,
        )
    if detectors is not None:
        from skillplan.cli.back_end_comparison import compare_detectors

        return compare_detectors(
            task,
            replace(back_ends, collision=detectors),
            reading,
            staged=staged,
            time_limit_s=limits.time_limit_s,
            style=style,
        )
    names = tuple(split_names(solvers or ""))
    if not names:
        raise OptionError("--solvers names no solver.")
    run = _Run(names, limits, seed, workers, warm, audit, not no_screening)
    return _compare(task, reading, back_ends, run, style)


@dataclass(frozen=True, slots=True)
class _Run:
    """The solvers to compare, and their settings."""

    names: tuple[str, ...]
    limits: shared.Limits
    seed: int
    workers: shared.Workers
    warm: bool
    audit: int | None
    screening: bool


def _compare(
    path: str, reading: shared.Reading, back_ends: shared.BackEnds, run: _Run, style: str
) -> int:
    """Run solvers on a task, print their rows, and return the exit code."""
    from contextlib import ExitStack

    from skillplan.cli.output import emit, exit_code
    from skillplan.pipeline.comparison import compare_solvers
    from skillplan.pipeline.solving import check_solver, list_solvers
    from skillplan.records import schemas
    from skillplan.solvers.stop import Stop
    from skillplan.views.tables.results import tabulate_comparisons

    names = run.names
    problem = load_file(path, reading, back_ends)
    last = problem.tasks[-1]
    every = tuple(dict.fromkeys(each for name in names for each in list_solvers(name)))
    setup = make_setup(
        back_ends, last, every, screening=run.screening, executor=run.workers.executor
    )
    for name in every:
        check_solver(name, setup.options.get(name, {}))
    with ExitStack() as waiting:

        def make_stop(name: str) -> Stop:
            waiting.pop_all().close()
            return waiting.enter_context(run.limits.stoppable(name))

        title = f"{problem.name}: {setup.physics_choice(last).name} physics, collision "
        title += setup.detector_names(last) or "none"
        title += ", warm cache" if run.warm else ", cold cache"
        results = compare_solvers(
            problem,
            names,
            setup,
            seed=run.seed,
            make_stop=make_stop,
            warm=run.warm,
            jobs=run.workers.jobs,
            audit=run.audit,
            limits=run.limits.of_stop,
        )
    tables = tabulate_comparisons(results, title, last.metric.decimals)
    origin = setup.origin(path, None, reading.settings())
    not_run = list(names[len(results) :])
    document = {
        "schema": schemas.COMPARISON,
        "warm": run.warm,
        "not_run": not_run,
        "rows": [replace(result, origin=origin).document() for result in results],
    }
    code = exit_code(results)
    if not_run:
        notes = (*tables[0].notes, f"not run: {', '.join(not_run)}")
        tables[0] = replace(tables[0], notes=notes)
    emit(style, document, tables, failed=code != 0)
    return code
