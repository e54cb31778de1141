"""``skillplan evaluate`` of a folder of training runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.options.completion import task_files
from skillplan.cli.options.values import count_option, positive_number

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.cli.options.shared import BackEnds, Checking, Reading
    from skillplan.domains.load import Problem
    from skillplan.pipeline.setup import Setup
    from skillplan.records.training.result import LayoutsResult, TrainingResult
    from skillplan.records.training.run_folder import RunFolder
    from skillplan.task.task import Task
    from skillplan.training.evaluation import RunsEvaluation

OF_RUN = "Of a result or a run"
# Options may be given for whoever proves the optimum.
_PROVERS = ("auto", "value-iteration")
_LAYOUTS = 20


@dataclass(frozen=True, slots=True)
class RollOuts:
    """How the policies of training runs are tried.

    Parameters
    ----------
    task_file
        Another file than the one that was learned; None for the same.
    changed_task
        Whether the task may have changed since.
    episodes
        How many roll-outs are drawn of every run, >= 1.
    temperature
        What scores are divided by, > 0.
    layouts
        How many unseen layouts of the family are tried; None for as many as suit the runs.
    """

    task_file: Annotated[
        str | None,
        typer.Option(
            "--task",
            metavar="FILE",
            autocompletion=task_files,
            help="The task file, where it is not to be the one that was solved or learned.",
            rich_help_panel=OF_RUN,
        ),
    ] = None
    changed_task: Annotated[
        bool,
        typer.Option(
            "--changed-task",
            help="Evaluate even where the task is another one than was solved or learned.",
            rich_help_panel=OF_RUN,
        ),
    ] = False
    episodes: Annotated[
        int,
        count_option(
            "--episodes",
            least=1,
            most=1_000_000,
            text="Roll-outs of every run, each action drawn by its score.",
            rich_help_panel=OF_RUN,
        ),
    ] = 100
    temperature: Annotated[
        float,
        typer.Option(
            "--temperature",
            parser=positive_number(),
            metavar="T",
            help="What scores are divided by; the lower, the greedier.",
            rich_help_panel=OF_RUN,
        ),
    ] = 0.05
    layouts: Annotated[
        int | None,
        count_option(
            "--layouts",
            least=0,
            most=10_000,
            text="Also try N layouts of the task file's family that no run has seen; default: 20 "
            "where a family was learned, else none.",
            rich_help_panel=OF_RUN,
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the command line wants of the runs.

    Parameters
    ----------
    roll_outs
        How their policies are tried.
    reading, back_ends
        The task and who checks it, where not as in the training.
    checking
        How back ends are queried.
    seed
        Governs all draws.
    time_limit_s
        For proving the optimum [s]; None for as long as it takes.
    """

    roll_outs: RollOuts
    reading: Reading
    back_ends: BackEnds
    checking: Checking
    seed: int
    time_limit_s: float | None


def evaluate_run_folders(paths: Sequence[str], wanted: Wanted, style: str) -> int:
    """Try the policies of folders of runs and print what they come to; return the exit code.

    Parameters
    ----------
    paths
        Of the folders, at least one; several are shown side by side.
    wanted
        How the policies are tried.
    style
        How to print.

    Raises
    ------
    OptionError
        If the task is another one now, or no policy can act on it.
    """
    from skillplan.cli.output import emit
    from skillplan.errors import exit_code
    from skillplan.records.training.result import trainings_document
    from skillplan.records.training.run_folder import RunFolder
    from skillplan.views.tables.training import training_tables, trainings_table

    results, interrupted = [], False
    for folder in [RunFolder(path) for path in paths]:
        result, interrupted = _evaluated(folder, wanted)
        results.append(result)
        if interrupted:
            break
    failed = any(result.failed for result in results)
    if len(paths) == 1:
        emit(style, results[0].document(), training_tables(results[0]), failed=failed)
    else:
        emit(style, trainings_document(results), [trainings_table(results)], failed=failed)
    solved = all(result.completed for result in results)
    return exit_code(interrupted=interrupted, solved=solved)


def _evaluated(folder: RunFolder, wanted: Wanted) -> tuple[TrainingResult, bool]:
    """Return what the policies of a folder come to, and whether the user interrupted it."""
    from contextlib import closing
    from dataclasses import replace

    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.cli.waiting import showing_checks, stoppable
    from skillplan.pipeline.solving import make_model
    from skillplan.records.training.result import Sampling
    from skillplan.training.evaluation import RunsEvaluation, unseen_layouts
    from skillplan.training.policies import prove_optimum

    problem, setup = _loaded(folder, wanted)
    task = problem.part(folder.manifest.task.part)
    drawn = Sampling(wanted.roll_outs.episodes, wanted.roll_outs.temperature, wanted.seed)
    evaluation = RunsEvaluation(folder, task, drawn, changed_task=wanted.roll_outs.changed_task)
    count = _layout_count(folder, wanted)
    layouts = unseen_layouts(evaluation, problem, count) if count else ()
    cache = wanted.checking.cache() or VerdictCache()
    with stoppable(wanted.time_limit_s, label="proving the optimum") as stop:
        optimum = prove_optimum(task, setup, cache, stop, jobs=wanted.checking.jobs)
    with showing_checks("rolling out") as on_check:
        model = make_model(task, setup, cache, jobs=wanted.checking.jobs, on_check=on_check)
        with closing(model.feasibility):
            result = evaluation.evaluate(model, setup, optimum)
    interrupted = stop.interrupted
    if layouts and not interrupted:
        tried, interrupted = _tried_layouts(evaluation, layouts, setup, wanted)
        result = replace(result, layouts=tried)
    return result, interrupted


def _layout_count(folder: RunFolder, wanted: Wanted) -> int:
    """Return how many unseen layouts are tried: by default some of those that learned a family."""
    if wanted.roll_outs.layouts is not None:
        return wanted.roll_outs.layouts
    return 0 if folder.manifest.family is None else _LAYOUTS


def _tried_layouts(
    evaluation: RunsEvaluation, layouts: tuple[Task, ...], setup: Setup, wanted: Wanted
) -> tuple[LayoutsResult, bool]:
    """Return what the policies do on layouts they have not seen, and whether it was interrupted."""
    from skillplan.cli.counting import counting
    from skillplan.records.training.result import LayoutsResult
    from skillplan.solvers.stop import Stop
    from skillplan.training.evaluation import layout_outcomes

    rows = []
    with counting("trying layouts", len(layouts)) as count:
        found = layout_outcomes(
            evaluation,
            layouts,
            setup,
            lambda: Stop(time_limit_s=wanted.time_limit_s),
            jobs=wanted.checking.jobs,
        )
        for row in found:
            rows.append(row)
            count.one_more()
            if count.interrupted:
                break
    family = evaluation.folder.manifest.family
    training_s = (evaluation.folder.result() or {}).get("wall_s")
    learned_on = 0 if family is None else family.count
    return LayoutsResult(tuple(rows), learned_on, training_s), count.interrupted


def _loaded(folder: RunFolder, wanted: Wanted) -> tuple[Problem, Setup]:
    """Return the problem, and the back ends: the training's, except for what the options choose."""
    from contextlib import nullcontext
    from dataclasses import replace

    from skillplan.cli.options.shared import Reading, warn_of
    from skillplan.pipeline.received_task import is_near, unquoted
    from skillplan.pipeline.setup import CHART
    from skillplan.training.evaluation import check_same_task

    manifest = folder.manifest
    given = wanted.back_ends
    physics = manifest.physics if given.physics is None else given.physics
    collision = given.collision
    if collision is None and manifest.collision:
        collision = ",".join(manifest.collision)
    back_ends = replace(given, physics=physics, collision=collision)
    # What --set changed belongs to the file that was learned.
    source, kept_changes = wanted.roll_outs.task_file, []
    if source is None:
        source = folder.source
        kept_changes = [f"{key}={value}" for key, value in manifest.task.changes.items()]
    reading = Reading([*kept_changes, *wanted.reading.changes])
    # The copy is as much the folder's as the manifest is; any other file is the reader's own.
    own = wanted.roll_outs.task_file is not None or source == str(folder.task_copy)
    with nullcontext() if own else unquoted(str(folder.path), source):
        problem = reading.problem(source, back_ends, warn=False)
    told = own or is_near(source, folder.path)
    if not wanted.roll_outs.changed_task or not told:
        check_same_task(folder, problem, quoted=told)
    warn_of(problem)
    part = problem.part(manifest.task.part)
    executor = wanted.checking.executor
    # The run has learned under the detectors that it names, and under no others.
    with_chart = given.collision is not None or CHART in manifest.collision
    setup = back_ends.setup(
        part,
        _PROVERS,
        screening=manifest.screening,
        executor=executor,
        with_chart=with_chart,
    )
    kept = dict(manifest.back_end_options)
    merged = {
        name: {**kept.get(name, {}), **setup.options.get(name, {})}
        for name in {**kept, **setup.options}
    }
    return problem, replace(setup, options=merged)
