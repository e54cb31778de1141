"""``skillplan sweep``."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from skillplan.cli.load import load_file, make_setup
from skillplan.cli.options import shared
from skillplan.cli.options.completion import plugin_names
from skillplan.cli.options.values import count_option, one_of, option, split_names

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.pipeline.setup import Setup
    from skillplan.records.sweep.result import SweepResult
    from skillplan.task.task import Task

STUDY = "Study"
_DESIGNS = ("one-at-a-time", "grid")
_AIMS = ("cost", "steps", "seconds")

EPILOG = (
    "Values: -O gamma=0.8:0.999:12 takes 12 evenly spaced values, -O alpha=0.001:1:7:log 7 values "
    "with evenly spaced logarithms, -O epsilon=0.01,0.1,0.5 the listed values. One value, such "
    "as -O gamma=0.99, holds in all runs. Given together with several values of the same option, "
    "it replaces the default as the centre. A start fails if its plan exceeds the task's step "
    "limit; --set step_limit=1000 changes the limit. With --out every finished run is stored at "
    "once, and --resume continues after any interruption and repeats failed runs. The exit code "
    "is 3 if a run failed by a back end or its process, 2 if by its options or the solver.\n\n"
    "--sampler optuna (plugin skillplan-optuna) chooses settings from ranges instead: -O "
    "gamma=0.8:0.999 for any allowed value between, -O alpha=0.001:1:log on a logarithmic scale, "
    "-O policy=a,b for listed values, -O 'gamma=*' for everything that the option allows. The "
    "same command in another process, or on another machine that shares the folder of --out, "
    "joins the study; a later one continues it and repeats failed trials. The settings depend on "
    "the order in which runs end. Therefore such a study cannot be repeated or resumed bit for "
    "bit, but it keeps every finished trial."
)


@dataclass(frozen=True, slots=True)
class Study:
    """Settings, starts and runs of a study."""

    starts: Annotated[
        str | None,
        option(
            "--starts A,B,C",
            STUDY,
            "Starts: places such as C20, or facts joined by +. Default: the start of the "
            "task. A policy is learned once and answers from all starts.",
        ),
    ] = None
    design: Annotated[
        Literal["one-at-a-time", "grid"],
        option(
            "--design DESIGN",
            STUDY,
            "one-at-a-time varies one option while the others stay at the centre; grid takes "
            "all combinations.",
            parser=one_of(_DESIGNS),
        ),
    ] = "one-at-a-time"
    runs: Annotated[
        int,
        count_option(
            "--runs",
            minimum=1,
            maximum=10_000,
            text="Runs per setting, with seeds from --seed on.",
            rich_help_panel=STUDY,
        ),
    ] = 5


@dataclass(frozen=True, slots=True)
class Sampling:
    """The sampler of a study without a design."""

    sampler: Annotated[
        str | None,
        option(
            "--sampler NAME",
            STUDY,
            "Plugin that chooses the settings from earlier trials, such as optuna from "
            "skillplan-optuna. Needs --out; cannot be resumed bit for bit.",
            autocompletion=plugin_names("sampler"),
        ),
    ] = None
    trials: Annotated[
        int,
        count_option(
            "--trials",
            minimum=1,
            maximum=100_000,
            text="With --sampler: total number of trials, over all processes that share the "
            "folder.",
            rich_help_panel=STUDY,
        ),
    ] = 50
    minimise: Annotated[
        Literal["cost", "steps", "seconds"],
        option(
            "--minimise WHAT",
            STUDY,
            "With --sampler: cost, steps or seconds (of learning), as the mean of the runs "
            "that reach the goal. The share of runs that fail always counts first.",
            parser=one_of(_AIMS),
        ),
    ] = "cost"


@dataclass(frozen=True, slots=True)
class Output:
    """Folder and figure of a study."""

    out: Annotated[
        str | None,
        option(
            "--out DIR",
            shared.OUTPUT,
            "Write manifest.json, runs.jsonl, sweep.json and starts.csv to a new folder; with "
            "--sampler trials.jsonl, sweep.json and starts.csv, also to a folder of the same "
            "study.",
        ),
    ] = None
    resume: Annotated[
        bool,
        option(
            "--resume",
            shared.OUTPUT,
            "Continue the study in the folder of --out; always on with --sampler.",
        ),
    ] = False
    plot: Annotated[
        str | None,
        option(
            "--plot FILE",
            shared.OUTPUT,
            "Also draw a figure with a panel per varied option, as .png or .svg.",
        ),
    ] = None


def command(
    task: shared.TaskFile,
    reading: shared.PartReading,
    study: Study,
    sampling: Sampling,
    *,
    solver: Annotated[str, shared.solver_option("Solver to study.")] = "sarsa",
    seed: shared.Seed = 0,
    workers: shared.Workers,
    back_ends: shared.BackEnds,
    warm: Annotated[
        bool, option("--warm", shared.BACK_ENDS, "Let runs use verdicts stored on disk.")
    ] = False,
    output: Output,
    style: shared.Style = "table",
) -> int:
    """Study the options of a solver on TASK: several values, seeds and starts.

    Prints for every setting how often its runs reach the goal and the optimum, in how many steps
    and how fast, each with its 95 % interval. Ctrl-C prints the results of the finished runs.
    """
    from skillplan.errors import OptionError

    if output.resume and output.out is None:
        raise OptionError("--resume needs --out DIR, the folder of the study to go on with.")
    starts = split_names(study.starts or "")
    if study.starts is not None and not starts:
        raise OptionError("--starts names no start.")
    problem, part = load_file(task, reading, back_ends), reading.part
    loaded = problem.part(part)
    values, others = _split_options(back_ends.options, solver)
    common = {
        "starts": starts,
        "runs": study.runs,
        "seed": seed,
        "warm": warm,
        "name": problem.name if part is None else f"{problem.name}, {loaded.name}",
    }
    request = _Request(loaded, solver, values, common, workers.jobs, output)
    sampler = sampling.sampler
    if sampler is None:
        given = replace(back_ends, options=others)
        setup = make_setup(given, loaded, (solver,), executor=workers.executor)
        return _show(_run_design(request, setup, study.design), output, style)
    if study.design == "grid":
        raise OptionError("--design grid chooses the settings itself; leave out --sampler.")
    if output.out is None:
        raise OptionError(
            f"--sampler {sampler} needs --out DIR, a folder that keeps its trials and that other "
            "processes may share."
        )
    own = [entry for entry in others if entry.startswith(f"{sampler}.")]
    given = replace(back_ends, options=[entry for entry in others if entry not in own])
    setup = make_setup(given, loaded, (solver,), executor=workers.executor)
    return _show(_run_sampler(request, setup, sampling, own), output, style)


@dataclass(frozen=True)
class _Request:
    """A study as the command line requests it."""

    task: Task
    solver: str
    values: list[tuple[str, str]]
    common: dict[str, Any]
    jobs: int
    output: Output


def _run_design(request: _Request, setup: Setup, design: str) -> SweepResult:
    """Run a study with the settings of a design."""
    from contextlib import ExitStack

    from skillplan.cli.interruption import counting
    from skillplan.sweep.parameter_study import do_study, plan_study
    from skillplan.sweep.study_folder import StudyFolder

    output = request.output
    plan, job = plan_study(
        request.task, request.solver, request.values, setup, design=design, **request.common
    )
    _check_plot(output)
    with ExitStack() as stack:
        folder = None
        if output.out is not None:
            words = tuple(sys.argv[1:])
            opened = StudyFolder(output.out, plan, resume=output.resume, command=words)
            folder = stack.enter_context(opened)
        total = len(plan.settings) * len(plan.seeds)
        count = stack.enter_context(counting(request.solver, total))
        result = do_study(
            plan,
            job,
            jobs=request.jobs,
            folder=folder,
            stopped=lambda: count.interrupted,
            on_run=lambda record: count.one_more(),
        )
        _store(result, output)
    return result


def _run_sampler(
    request: _Request, setup: Setup, sampling: Sampling, options: list[str]
) -> SweepResult:
    """Run a study whose settings a sampler chooses."""
    from skillplan.cli.interruption import counting
    from skillplan.cli.options.values import parse_options
    from skillplan.sweep.parameter_study import do_sampled, make_sampler, open_trials, plan_sampled

    name, output = sampling.sampler, request.output
    assert name is not None
    assert output.out is not None
    sampler = make_sampler(name, parse_options(options, None).get(name, {}))
    plan, job = plan_sampled(
        request.task,
        request.solver,
        request.values,
        setup,
        sampler=name,
        minimise=sampling.minimise,
        **request.common,
    )
    _check_plot(output)
    trials = open_trials(output.out, plan, sampler, request.common["seed"])
    left = max(0, sampling.trials - trials.done())
    with counting(f"{request.solver}, trials", left) as count:
        result = do_sampled(
            plan,
            job,
            trials,
            sampling.trials,
            jobs=request.jobs,
            stopped=lambda: count.interrupted,
            on_trial=count.one_more,
        )
        _store(result, output)
    return result


def _store(result: SweepResult, output: Output) -> None:
    """Write the document and the table of the starts to the folder, if there is one."""
    if output.out is None:
        return
    from skillplan.cli.output import write_folder
    from skillplan.cli.writing import as_json
    from skillplan.sweep.study_folder import RESULT, STARTS
    from skillplan.views.tables.sweep import tabulate_starts
    from skillplan.views.text.table import render_csv

    starts_csv = render_csv(tabulate_starts(result))
    write_folder(Path(output.out), {STARTS: starts_csv, RESULT: as_json(result.document())})


def _show(result: SweepResult, output: Output, style: str) -> int:
    """Draw and print a study; return the exit code."""
    from skillplan.cli.output import emit
    from skillplan.errors import exit_code
    from skillplan.views.tables.sweep import tabulate_settings, tabulate_starts

    if output.plot is not None and len(result.records) > len(result.failed):
        _draw(result, _check_path(output.plot))
    arrived = any(outcome.arrived for record in result.records for outcome in record.outcomes)
    code = exit_code(
        interrupted=result.interrupted,
        back_end_failed=any(record.back_end_failed for record in result.failed),
        wrong=bool(result.failed),
        solved=arrived,
    )
    tables = [tabulate_settings(result), *([tabulate_starts(result)] if style == "csv" else [])]
    emit(style, result.document(), tables, failed=code != 0)
    return code


def _check_plot(output: Output) -> None:
    """Check before the first run that the figure can be drawn and written."""
    if output.plot is not None:
        _check_path(output.plot)


def _split_options(entries: Iterable[str], solver: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Separate the options of the solver, as name and text, from other entries of -O."""
    values, others = [], []
    for entry in entries:
        key, equals, text = entry.partition("=")
        plugin, _, name = key.rpartition(".")
        if equals and name and plugin in ("", solver):
            values.append((name, text))
        else:
            others.append(entry)
    return values, others


def _draw(result: SweepResult, path: Path) -> None:
    from skillplan.errors import OptionError, SkillplanError
    from skillplan.views.figures.figure_file import save_figure
    from skillplan.views.figures.sweep_figure import draw_sweep

    try:
        save_figure(draw_sweep(result), path)
    except SkillplanError as error:
        raise OptionError(str(error).replace("--out", "--plot", 1)) from None


def _check_path(plot: str) -> Path:
    """Return the path of the figure, having checked that it can be drawn and written."""
    from skillplan.errors import OptionError

    try:
        from skillplan.views.figures.figure_file import check_path
    except ImportError:
        message = "--plot needs matplotlib, which is not installed: pip install matplotlib."
        raise OptionError(message) from None
    try:
        return check_path(plot)
    except OptionError as error:
        raise OptionError(str(error).replace("--out", "--plot", 1)) from None
