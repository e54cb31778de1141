"""``skillplan evaluate`` of a folder of training runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.domains.load import Problem
    from skillplan.pipeline.setup import Setup
    from skillplan.records.training.layouts_result import LayoutsResult
    from skillplan.records.training.run_folder import RunFolder
    from skillplan.task.task import Task
    from skillplan.training.runs_evaluation import RunsEvaluation

# Options may be given for whoever proves the optimum.
_PROVERS = ("auto", "value-iteration")
_LAYOUTS = 20


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line asks of the runs.

    Parameters
    ----------
    task_file
        Another file than the one that was learned; None for the same.
    changed_task
        Whether the task may have changed since.
    physics, collision, options
        Back ends, where not those of the training.
    changes
        Key path to value: what the task file is read as if it held.
    episodes, temperature, seed
        How roll-outs are drawn.
    layouts
        How many unseen layouts of the family are tried; None for as many as suit the runs.
    time_limit_s
        For proving the optimum [s].
    jobs, no_cache
        How back ends are asked.
    """

    task_file: str | None
    changed_task: bool
    physics: str | None
    collision: str | None
    options: tuple[str, ...]
    changes: Mapping[str, str]
    episodes: int
    temperature: float
    seed: int
    layouts: int | None
    time_limit_s: float
    jobs: int
    no_cache: bool


def evaluate_run_folder(folder: RunFolder, asked: Asked, style: str) -> int:
    """Try the policies of a folder of runs and print what they come to; return the exit code.

    Raises
    ------
    OptionError
        If the task is another one now, or no policy can act on it.
    """
    from contextlib import closing
    from dataclasses import replace

    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import showing_checks, stoppable
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_NO_PLAN, EXIT_SOLVED
    from skillplan.pipeline.run import make_model, warm_cache
    from skillplan.records.training.result import Sampling
    from skillplan.training.layouts_evaluation import unseen_layouts
    from skillplan.training.policy_roll_out import prove_optimum
    from skillplan.training.runs_evaluation import RunsEvaluation, check_same_task
    from skillplan.views.tables.training import training_tables

    problem, setup = _loaded(folder, asked)
    if not asked.changed_task:
        check_same_task(folder, problem)
    task = problem.part(folder.manifest.task.part)
    drawn = Sampling(asked.episodes, asked.temperature, asked.seed)
    evaluation = RunsEvaluation(folder, task, drawn, changed_task=asked.changed_task)
    count = _layout_count(folder, asked)
    layouts = unseen_layouts(evaluation, problem, count) if count else ()
    cache = VerdictCache() if asked.no_cache else warm_cache()
    with stoppable(asked.time_limit_s, label="proving the optimum") as stop:
        optimum = prove_optimum(task, setup, cache, stop, jobs=asked.jobs)
    with showing_checks("rolling out") as on_check:
        model = make_model(task, setup, cache, jobs=asked.jobs, on_check=on_check)
        with closing(model.feasibility):
            result = evaluation.evaluate(model, setup, optimum)
    interrupted = stop.interrupted
    if layouts and not interrupted:
        tried, interrupted = _tried_layouts(evaluation, layouts, setup, asked)
        result = replace(result, layouts=tried)
    emit(style, result.document(), training_tables(result), failed=bool(result.failed))
    if interrupted:
        return EXIT_INTERRUPTED
    return EXIT_SOLVED if result.completed else EXIT_NO_PLAN


def _layout_count(folder: RunFolder, asked: Asked) -> int:
    """Return how many unseen layouts are tried: by default some of those that learned a family."""
    if asked.layouts is not None:
        return asked.layouts
    return 0 if folder.manifest.family is None else _LAYOUTS


def _tried_layouts(
    evaluation: RunsEvaluation, layouts: tuple[Task, ...], setup: Setup, asked: Asked
) -> tuple[LayoutsResult, bool]:
    """Return what the policies do on layouts they have not seen, and whether it was interrupted."""
    from skillplan.cli.counting import counting
    from skillplan.records.training.layouts_result import LayoutsResult
    from skillplan.solvers.stop import Stop
    from skillplan.training.layouts_evaluation import layout_outcomes

    rows = []
    with counting("trying layouts", len(layouts)) as count:
        found = layout_outcomes(
            evaluation,
            layouts,
            setup,
            lambda: Stop(time_limit_s=asked.time_limit_s),
            jobs=asked.jobs,
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


def _loaded(folder: RunFolder, asked: Asked) -> tuple[Problem, Setup]:
    """Return the problem, and the back ends: the training's, but for what is asked otherwise."""
    from dataclasses import replace

    from skillplan.cli.options import asked as named
    from skillplan.cli.options import make_setup
    from skillplan.pipeline.setup import load_problem

    manifest = folder.manifest
    physics = manifest.physics if asked.physics is None else asked.physics
    collision = asked.collision
    if collision is None and manifest.collision:
        collision = ",".join(manifest.collision)
    # What --set changed belongs to the file that was learned.
    before = manifest.task.changes if asked.task_file is None else {}
    source = folder.source if asked.task_file is None else asked.task_file
    problem = load_problem(source, named(physics, collision), {**before, **asked.changes})
    task = problem.part(manifest.task.part)
    setup: Setup = make_setup(physics, collision, asked.options, _PROVERS)(task)
    kept = dict(manifest.back_end_options)
    merged = {
        name: {**kept.get(name, {}), **setup.options.get(name, {})}
        for name in {**kept, **setup.options}
    }
    return problem, replace(setup, options=merged)
