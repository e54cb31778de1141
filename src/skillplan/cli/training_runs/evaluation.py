"""``skillplan evaluate`` of folders of training runs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.cli.interruption import counting
from skillplan.cli.load import load_file, make_setup, open_cache, print_warnings
from skillplan.cli.options.shared import BackEnds, Checking, Reading
from skillplan.cli.output import emit
from skillplan.cli.waiting import show_checks, stoppable
from skillplan.domains.load import Problem
from skillplan.errors import exit_code
from skillplan.pipeline.restoration import is_near, unquoted
from skillplan.pipeline.setup import CHART, Setup
from skillplan.pipeline.solving import make_model
from skillplan.records.training.method_comparison import compare_methods, make_trainings_document
from skillplan.records.training.result import LayoutsResult, Sampling, TrainingResult
from skillplan.records.training.run_folder import RunFolder
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task
from skillplan.training.evaluation import (
    RunsEvaluation,
    check_same_task,
    draw_unseen_layouts,
    evaluate_layouts,
)
from skillplan.training.policies import prove_optimum
from skillplan.views.tables.training import tabulate_methods, tabulate_training, tabulate_trainings

if TYPE_CHECKING:
    from skillplan.cli.commands.evaluate import RollOuts

# Solvers that prove the optimum; -O may give options for them.
_PROVERS = ("auto", "value-iteration")
# Unseen layouts that are tried after a training on a family.
_LAYOUTS = 20


@dataclass(frozen=True, slots=True)
class RunsRequest:
    """An evaluation of training runs as the command line requests it.

    Parameters
    ----------
    task_file
        Task file to use instead of the stored one.
    changed_task
        True if the task may have changed since.
    reading, back_ends
        Changes of the task file, and back ends. They override the training's own.
    time_limit_s
        Time limit for proving the optimum [s].
    """

    task_file: str | None
    changed_task: bool
    roll_outs: RollOuts
    reading: Reading
    back_ends: BackEnds
    checking: Checking
    seed: int
    time_limit_s: float | None


def evaluate_run_folders(paths: Sequence[str], request: RunsRequest, style: str) -> int:
    """Try the policies of one or several folders, print the results and return the exit code.

    Raises
    ------
    OptionError
        If the task has changed, or no policy can act on it.
    """
    results, interrupted = [], False
    for folder in [RunFolder(path) for path in paths]:
        result, interrupted = _evaluate_folder(folder, request)
        results.append(result)
        if interrupted:
            break
    failed = any(result.failed for result in results)
    if len(paths) == 1:
        emit(style, results[0].document(), tabulate_training(results[0]), failed=failed)
    else:
        comparison = compare_methods([result.document() for result in results])
        # CSV contains the last table.
        tables = [] if comparison is None else [tabulate_methods(comparison)]
        tables.append(tabulate_trainings(results))
        emit(style, make_trainings_document(results), tables, failed=failed)
    solved = all(result.completed for result in results)
    return exit_code(interrupted=interrupted, solved=solved)


def _evaluate_folder(folder: RunFolder, request: RunsRequest) -> tuple[TrainingResult, bool]:
    """Return the result of a folder, and whether the user interrupted its evaluation."""
    problem, setup = _load_task(folder, request)
    task = problem.part(folder.manifest.task.part)
    drawn = Sampling(request.roll_outs.episodes, request.roll_outs.temperature, request.seed)
    evaluation = RunsEvaluation(folder, task, drawn, changed_task=request.changed_task)
    count = request.roll_outs.layouts
    if count is None:
        count = 0 if folder.manifest.family is None else _LAYOUTS
    layouts = draw_unseen_layouts(evaluation, problem, count) if count else ()
    cache = open_cache(request.checking) or VerdictCache()
    jobs = request.checking.jobs
    with stoppable(request.time_limit_s, label="proving the optimum") as stop:
        optimum = prove_optimum(task, setup, cache, stop, jobs=jobs)
    with show_checks("rolling out") as on_check:
        model = make_model(task, setup, cache, jobs=jobs, on_check=on_check)
        with closing(model.feasibility):
            result = evaluation.evaluate(model, setup, optimum)
    interrupted = stop.interrupted
    if layouts and not interrupted:
        outcomes, interrupted = _try_layouts(evaluation, layouts, setup, request)
        result = replace(result, layouts=outcomes)
    return result, interrupted


def _try_layouts(
    evaluation: RunsEvaluation, layouts: tuple[Task, ...], setup: Setup, request: RunsRequest
) -> tuple[LayoutsResult, bool]:
    """Return the results on unseen layouts, and whether the user interrupted."""
    rows = []
    with counting("trying layouts", len(layouts)) as count:
        for outcome in evaluate_layouts(
            evaluation,
            layouts,
            setup,
            lambda: Stop(time_limit_s=request.time_limit_s),
            jobs=request.checking.jobs,
        ):
            rows.append(outcome)
            count.one_more()
            if count.interrupted:
                break
    family = evaluation.folder.manifest.family
    training_s = (evaluation.folder.result() or {}).get("wall_s")
    learned_on = 0 if family is None else family.count
    return LayoutsResult(tuple(rows), learned_on, training_s), count.interrupted


def _load_task(folder: RunFolder, request: RunsRequest) -> tuple[Problem, Setup]:
    """Return the problem, and the back ends of the training unless options override them."""
    manifest = folder.manifest
    chosen = request.back_ends
    physics = manifest.physics if chosen.physics is None else chosen.physics
    collision = chosen.collision
    if collision is None and manifest.collision:
        collision = ",".join(manifest.collision)
    back_ends = replace(chosen, physics=physics, collision=collision)
    # The changes of the training belong to the file that was learned.
    source, kept_changes = request.task_file, []
    if source is None:
        source = folder.source
        kept_changes = [f"{key}={value}" for key, value in manifest.task.changes.items()]
    reading = Reading([*kept_changes, *request.reading.changes])
    # The folder may come from another person: messages must not quote other files that it names.
    own = request.task_file is not None or source == str(folder.task_copy)
    with nullcontext() if own else unquoted(str(folder.path), source):
        problem = load_file(source, reading, back_ends, warn=False)
    quoted = own or is_near(source, folder.path)
    if not request.changed_task or not quoted:
        check_same_task(folder, problem, quoted=quoted)
    print_warnings(problem)
    setup = make_setup(
        back_ends,
        problem.part(manifest.task.part),
        _PROVERS,
        screening=manifest.screening,
        executor=request.checking.executor,
        # The training used the detectors in its manifest and no others.
        with_chart=chosen.collision is not None or CHART in manifest.collision,
    )
    kept = dict(manifest.back_end_options)
    merged = {
        name: {**kept.get(name, {}), **setup.options.get(name, {})}
        for name in {**kept, **setup.options}
    }
    return problem, replace(setup, options=merged)
