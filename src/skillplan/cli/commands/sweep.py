"""``skillplan sweep``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from skillplan.cli.options import (
    PluginName,
    asked,
    back_end_options,
    format_option,
    make_setup,
    part_option,
    seed_option,
    set_option,
    settings,
    split_names,
    task_argument,
)

EPILOG = (
    "Values: -O gamma=0.8:0.999:12 takes 12 evenly spaced values, -O alpha=0.001:1:7:log evenly "
    "spaced logarithms, -O epsilon=0.01,0.1,0.5 those listed. One value, as -O gamma=0.99, holds "
    "in all runs; given beside several values of the same option it is the centre instead of the "
    "default. A start counts as failed beyond the task's step limit; --set step_limit=1000 sets "
    "it. With --out every finished run is on disk, and --resume goes on after whatever ended the "
    "program."
)


@click.command("sweep", epilog=EPILOG)
@task_argument
@click.option(
    "--solver",
    type=PluginName("solver"),
    metavar="NAME",
    default="sarsa",
    show_default=True,
    help="Which solver is studied.",
)
@back_end_options
@set_option
@part_option
@click.option(
    "--starts",
    metavar="A,B,C",
    help="Where the task is done from: places such as C20, or facts joined by +; default: the "
    "task's own start. A policy is learned once and answers from all of them.",
)
@click.option(
    "--design",
    type=click.Choice(["one-at-a-time", "grid"]),
    default="one-at-a-time",
    show_default=True,
    help="Vary every option alone while the others stay at the centre, or take all combinations.",
)
@click.option(
    "--runs",
    type=click.IntRange(1, 10_000),
    default=5,
    show_default=True,
    metavar="N",
    help="Runs of every setting, with the seeds from --seed on.",
)
@seed_option
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    default=1,
    show_default=True,
    metavar="N",
    help="How many processes; results do not depend on it, but learning times do.",
)
@click.option("--warm", is_flag=True, help="Let runs use verdicts kept on disk.")
@click.option(
    "--out",
    metavar="DIR",
    help="Keep manifest.json, runs.jsonl, sweep.json and starts.csv in a new folder.",
)
@click.option("--resume", is_flag=True, help="Go on with the study in the folder of --out.")
@click.option(
    "--plot",
    metavar="FILE",
    help="Also draw a panel for every option that varies, as .png or .svg.",
)
@format_option
def command(
    task: str,
    solver: str,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    starts: str | None,
    design: str,
    runs: int,
    seed: int,
    jobs: int,
    warm: bool,
    out: str | None,
    resume: bool,
    plot: str | None,
    style: str,
) -> int:
    """Study how a solver's options act on TASK: several values, several seeds, several starts.

    Says how often each setting arrives and at the optimum, in how many steps and how fast,
    each with its 95 % interval. Ctrl-C prints what the finished runs show.
    """
    from contextlib import ExitStack

    from skillplan.cli.counting import counting
    from skillplan.cli.output import as_json, emit, save
    from skillplan.errors import (
        EXIT_INTERRUPTED,
        EXIT_NO_PLAN,
        EXIT_SOLVED,
        OptionError,
        SkillplanError,
    )
    from skillplan.pipeline.setup import load_problem
    from skillplan.sweep.parameter_study import do_study, plan_study
    from skillplan.sweep.study_folder import StudyFolder
    from skillplan.views.tables.sweep import setting_table, start_table
    from skillplan.views.tables.table import as_csv

    if resume and out is None:
        raise OptionError("--resume needs --out DIR, the folder of the study to go on with.")
    if starts is not None and not split_names(starts):
        raise OptionError("--starts names no start.")
    problem = load_problem(task, asked(physics, collision), settings(changes))
    loaded = problem.part(part)
    values, others = _split(options, solver)
    setup = make_setup(physics, collision, others, (solver,))(loaded)
    plan, job = plan_study(
        loaded,
        solver,
        values,
        setup,
        starts=split_names(starts or ""),
        design=design,
        runs=runs,
        seed=seed,
        warm=warm,
        name=problem.name if part is None else f"{problem.name}, {loaded.name}",
    )
    picture = None if plot is None else _picture(plot)
    with ExitStack() as stack:
        folder = None
        if out is not None:
            words = tuple(sys.argv[1:])
            folder = stack.enter_context(StudyFolder(out, plan, resume=resume, command=words))
        count = stack.enter_context(counting(solver, len(plan.settings) * len(plan.seeds)))
        result = do_study(
            plan,
            job,
            jobs=jobs,
            folder=folder,
            stopped=lambda: count.interrupted,
            on_run=lambda record: count.one_more(),
        )
        if folder is not None:
            save(folder.path, "sweep.json", as_json(result.document()))
            save(folder.path, "starts.csv", as_csv(start_table(result)))
    if picture is not None and len(result.records) > len(result.failed):
        from skillplan.views.figures.figure_file import save_figure
        from skillplan.views.figures.sweep_figure import sweep_figure

        try:
            save_figure(sweep_figure(result), picture)
        except SkillplanError as error:
            raise OptionError(str(error).replace("--out", "--plot", 1)) from None
    code = EXIT_SOLVED
    if result.interrupted:
        code = EXIT_INTERRUPTED
    elif not any(outcome.arrived for record in result.records for outcome in record.outcomes):
        code = EXIT_NO_PLAN
    tables = [setting_table(result), *([start_table(result)] if style == "csv" else [])]
    emit(style, result.document(), tables, failed=code != 0 or bool(result.failed))
    return code


def _split(entries: tuple[str, ...], solver: str) -> tuple[list[tuple[str, str]], tuple[str, ...]]:
    """Return option and text for the solver's entries of -O, and the other entries."""
    values, others = [], []
    for entry in entries:
        key, equals, text = entry.partition("=")
        plugin, _, name = key.rpartition(".")
        if equals and name and plugin in ("", solver):
            values.append((name, text))
        else:
            others.append(entry)
    return values, tuple(others)


def _picture(plot: str) -> Path:
    """Return where the figure goes, having seen that it can be drawn and go there."""
    from skillplan.errors import OptionError

    try:
        from skillplan.views.figures.figure_file import checked_path
    except ImportError:
        message = "--plot needs matplotlib, which is not installed: pip install matplotlib."
        raise OptionError(message) from None
    try:
        return checked_path(plot)
    except OptionError as error:
        raise OptionError(str(error).replace("--out", "--plot", 1)) from None
