"""``skillplan sweep``."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from skillplan.cli.options.completion import plugin_names
from skillplan.cli.options.panels import BACK_ENDS, OUTPUT
from skillplan.cli.options.shared import BackEnds, PartReading, Workers
from skillplan.cli.options.single import Seed, Style, TaskFile, solver_option
from skillplan.cli.options.values import count_option, one_of, split_names

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.pipeline.setup import Setup
    from skillplan.records.sweep.result import SweepResult
    from skillplan.task.task import Task

STUDY = "Study"
_DESIGNS = ("one-at-a-time", "grid")
_AIMS = ("cost", "steps", "seconds")

EPILOG = (
    "Values: -O gamma=0.8:0.999:12 takes 12 evenly spaced values, -O alpha=0.001:1:7:log evenly "
    "spaced logarithms, -O epsilon=0.01,0.1,0.5 those listed. One value, as -O gamma=0.99, holds "
    "in all runs; given beside several values of the same option it is the centre instead of the "
    "default. A start counts as failed beyond the task's step limit; --set step_limit=1000 sets "
    "it. With --out every finished run is on disk, and --resume goes on after whatever ended the "
    "program.\n\n"
    "--sampler optuna (plugin skillplan-optuna) chooses settings instead: -O gamma=0.8:0.999 takes "
    "any value between, -O alpha=0.001:1:log with evenly drawn logarithms, -O policy=a,b those "
    "listed, -O 'gamma=*' all that the option allows. The same command in other processes, or on "
    "other machines that see the folder of --out, joins in; so does a later one, which goes on. "
    "Which settings are tried depends on the order in which runs end, so that such a study cannot "
    "be repeated or resumed bit for bit; every trial that is finished is kept."
)


@dataclass(frozen=True, slots=True)
class Study:
    """What a study varies.

    Parameters
    ----------
    starts
        Where the task is done from, with commas; None for the task's own start.
    design
        ``one-at-a-time`` or ``grid``.
    runs
        How many of every setting, >= 1.
    """

    starts: Annotated[
        str | None,
        typer.Option(
            "--starts",
            metavar="A,B,C",
            help="Where the task is done from: places such as C20, or facts joined by +; default: "
            "the task's own start. A policy is learned once and answers from all of them.",
            rich_help_panel=STUDY,
        ),
    ] = None
    design: Annotated[
        Literal["one-at-a-time", "grid"],
        typer.Option(
            "--design",
            parser=one_of(_DESIGNS),
            metavar="DESIGN",
            help="one-at-a-time varies every option alone while the others stay at the centre; "
            "grid takes all combinations.",
            rich_help_panel=STUDY,
        ),
    ] = "one-at-a-time"
    runs: Annotated[
        int,
        count_option(
            "--runs",
            least=1,
            most=10_000,
            text="Runs of every setting, with the seeds from --seed on.",
            rich_help_panel=STUDY,
        ),
    ] = 5


@dataclass(frozen=True, slots=True)
class Sampling:
    """Who chooses the settings, where that is not the design.

    Parameters
    ----------
    sampler
        Name of a plugin; None for the design.
    trials
        How many settings are tried, >= 1.
    minimise
        ``cost``, ``steps`` or ``seconds``.
    """

    sampler: Annotated[
        str | None,
        typer.Option(
            "--sampler",
            metavar="NAME",
            autocompletion=plugin_names("sampler"),
            help="Have a plugin choose the settings, each by what has come of those before: "
            "optuna, if skillplan-optuna is installed. Needs --out; not resumed bit for bit.",
            rich_help_panel=STUDY,
        ),
    ] = None
    trials: Annotated[
        int,
        count_option(
            "--trials",
            least=1,
            most=100_000,
            text="With --sampler: try settings until so many are finished, by all processes that "
            "share the folder together.",
            rich_help_panel=STUDY,
        ),
    ] = 50
    minimise: Annotated[
        Literal["cost", "steps", "seconds"],
        typer.Option(
            "--minimise",
            parser=one_of(_AIMS),
            metavar="WHAT",
            help="With --sampler: cost, steps or seconds (of learning), as the mean of the runs "
            "that arrive. The share of runs that do not arrive always counts first.",
            rich_help_panel=STUDY,
        ),
    ] = "cost"


@dataclass(frozen=True, slots=True)
class Kept:
    """Where a study is kept.

    Parameters
    ----------
    out
        The folder; None for none.
    resume
        Whether the folder holds a study to go on with.
    plot
        The file of a figure; None for none.
    """

    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Keep manifest.json, runs.jsonl, sweep.json and starts.csv in a new folder; with "
            "--sampler trials.jsonl, sweep.json and starts.csv, also in one of the same study.",
            rich_help_panel=OUTPUT,
        ),
    ] = None
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Go on with the study in the folder of --out; with --sampler that is always so.",
            rich_help_panel=OUTPUT,
        ),
    ] = False
    plot: Annotated[
        str | None,
        typer.Option(
            "--plot",
            metavar="FILE",
            help="Also draw a panel for every option that varies, as .png or .svg.",
            rich_help_panel=OUTPUT,
        ),
    ] = None


def command(
    task: TaskFile,
    reading: PartReading,
    study: Study,
    sampling: Sampling,
    *,
    solver: Annotated[str, solver_option("Which solver is studied.")] = "sarsa",
    seed: Seed = 0,
    workers: Workers,
    back_ends: BackEnds,
    warm: Annotated[
        bool,
        typer.Option(
            "--warm", help="Let runs use verdicts kept on disk.", rich_help_panel=BACK_ENDS
        ),
    ] = False,
    kept: Kept,
    style: Style = "table",
) -> int:
    """Study how a solver's options act on TASK: several values, several seeds, several starts.

    Says how often each setting arrives and at the optimum, in how many steps and how fast,
    each with its 95 % interval. Ctrl-C prints what the finished runs show.
    """
    from skillplan.errors import OptionError

    if kept.resume and kept.out is None:
        raise OptionError("--resume needs --out DIR, the folder of the study to go on with.")
    starts = split_names(study.starts or "")
    if study.starts is not None and not starts:
        raise OptionError("--starts names no start.")
    problem = reading.problem(task, back_ends)
    loaded = problem.part(reading.part)
    values, others = _split(back_ends.options, solver)
    part = reading.part
    common = {
        "starts": starts,
        "runs": study.runs,
        "seed": seed,
        "warm": warm,
        "name": problem.name if part is None else f"{problem.name}, {loaded.name}",
    }
    asked = _Asked(loaded, solver, values, common, workers.jobs, kept)
    given, chosen = replace(back_ends, options=others), sampling.sampler
    if chosen is None:
        setup = given.setup(loaded, (solver,), executor=workers.executor)
        return _shown(_designed(asked, setup, study.design), kept, style)
    if study.design == "grid":
        raise OptionError("--design grid says which settings are tried; leave out --sampler.")
    if kept.out is None:
        raise OptionError(
            f"--sampler {chosen} needs --out DIR, a folder that keeps its trials and that other "
            "processes may share."
        )
    mine = [one for one in others if one.startswith(f"{chosen}.")]
    rest = [one for one in others if one not in mine]
    setup = replace(back_ends, options=rest).setup(loaded, (solver,), executor=workers.executor)
    return _shown(_sampled(asked, setup, sampling, mine), kept, style)


@dataclass(frozen=True)
class _Asked:
    """What is asked for, whoever chooses the settings."""

    task: Task
    solver: str
    values: list[tuple[str, str]]
    common: dict[str, Any]
    jobs: int
    kept: Kept


def _designed(asked: _Asked, setup: Setup, design: str) -> SweepResult:
    """Do a study whose settings its design says."""
    from contextlib import ExitStack

    from skillplan.cli.counting import counting
    from skillplan.sweep.parameter_study import do_study, plan_study
    from skillplan.sweep.study_folder import StudyFolder

    kept = asked.kept
    plan, job = plan_study(
        asked.task, asked.solver, asked.values, setup, design=design, **asked.common
    )
    _check_picture(kept)
    with ExitStack() as stack:
        folder = None
        if kept.out is not None:
            words = tuple(sys.argv[1:])
            opened = StudyFolder(kept.out, plan, resume=kept.resume, command=words)
            folder = stack.enter_context(opened)
        total = len(plan.settings) * len(plan.seeds)
        count = stack.enter_context(counting(asked.solver, total))
        result = do_study(
            plan,
            job,
            jobs=asked.jobs,
            folder=folder,
            stopped=lambda: count.interrupted,
            on_run=lambda record: count.one_more(),
        )
        _keep(result, kept)
    return result


def _sampled(asked: _Asked, setup: Setup, sampling: Sampling, options: list[str]) -> SweepResult:
    """Do a study whose settings a sampler chooses."""
    from skillplan.cli.counting import counting
    from skillplan.cli.options.values import parse_options
    from skillplan.sweep.parameter_study import (
        do_sampled,
        make_sampler,
        plan_sampled,
        shared_trials,
    )

    name, kept = sampling.sampler, asked.kept
    assert name is not None
    assert kept.out is not None
    sampler = make_sampler(name, parse_options(options, None).get(name, {}))
    plan, job = plan_sampled(
        asked.task,
        asked.solver,
        asked.values,
        setup,
        sampler=name,
        minimise=sampling.minimise,
        **asked.common,
    )
    _check_picture(kept)
    trials = shared_trials(kept.out, plan, sampler, asked.common["seed"])
    left = max(0, sampling.trials - trials.done())
    with counting(f"{asked.solver}, trials", left) as count:
        result = do_sampled(
            plan,
            job,
            trials,
            sampling.trials,
            jobs=asked.jobs,
            stopped=lambda: count.interrupted,
            on_trial=count.one_more,
        )
        _keep(result, kept)
    return result


def _keep(result: SweepResult, kept: Kept) -> None:
    """Write the document and the table of the starts, where there is a folder."""
    if kept.out is None:
        return
    from skillplan.cli.result_output import write_folder
    from skillplan.cli.writing import as_json
    from skillplan.sweep.study_folder import RESULT, STARTS
    from skillplan.views.tables.sweep import start_table
    from skillplan.views.text.table import as_csv

    starts_csv = as_csv(start_table(result))
    write_folder(Path(kept.out), {STARTS: starts_csv, RESULT: as_json(result.document())})


def _shown(result: SweepResult, kept: Kept, style: str) -> int:
    """Draw and print a study; return the exit code."""
    from skillplan.cli.output import emit
    from skillplan.views.tables.sweep import setting_table, start_table

    if kept.plot is not None and len(result.records) > len(result.failed):
        _draw(result, _picture(kept.plot))
    code = _exit_code(result)
    tables = [setting_table(result), *([start_table(result)] if style == "csv" else [])]
    emit(style, result.document(), tables, failed=code != 0 or bool(result.failed))
    return code


def _check_picture(kept: Kept) -> None:
    """See before anything is done that the figure can be drawn and go where it is to go."""
    if kept.plot is not None:
        _picture(kept.plot)


def _split(entries: Iterable[str], solver: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Return option and text for the solver's entries of -O, and the other entries."""
    values, others = [], []
    for entry in entries:
        key, equals, text = entry.partition("=")
        plugin, _, name = key.rpartition(".")
        if equals and name and plugin in ("", solver):
            values.append((name, text))
        else:
            others.append(entry)
    return values, others


def _exit_code(result: SweepResult) -> int:
    """Return the exit code: whether any run arrived anywhere."""
    from skillplan.errors import exit_code

    arrived = any(outcome.arrived for record in result.records for outcome in record.outcomes)
    return exit_code(interrupted=result.interrupted, solved=arrived)


def _draw(result: SweepResult, path: Path) -> None:
    """Draw what a study shows."""
    from skillplan.errors import OptionError, SkillplanError
    from skillplan.views.figures.figure_file import save_figure
    from skillplan.views.figures.sweep_figure import sweep_figure

    try:
        save_figure(sweep_figure(result), path)
    except SkillplanError as error:
        raise OptionError(str(error).replace("--out", "--plot", 1)) from None


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
