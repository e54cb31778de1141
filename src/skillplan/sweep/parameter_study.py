"""The straight line of a parameter study: plan it, do its runs, say what they show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from skillplan.errors import OptionError
from skillplan.pipeline import registry
from skillplan.pipeline.run import make_model, make_solver
from skillplan.pipeline.setup import Setup
from skillplan.records.sweep.plan import ONE_AT_A_TIME, SAMPLED, Axis, Start, SweepPlan
from skillplan.records.sweep.record import SweepRecord
from skillplan.records.sweep.result import SweepResult
from skillplan.records.sweep.sampled import SampledPlan
from skillplan.sweep.option_space import read_space
from skillplan.sweep.parameter_values import read_values
from skillplan.sweep.study_folder import StudyFolder
from skillplan.sweep.study_run import StudyJob, from_starts
from skillplan.sweep.study_workers import Order, do_all
from skillplan.task.task import Task

_MOST_RUNS = 100_000


def plan_study(
    task: Task,
    solver: str,
    values: Sequence[tuple[str, str]] = (),
    setup: Setup = Setup(),
    *,
    starts: Sequence[str] = (),
    design: str = ONE_AT_A_TIME,
    runs: int = 5,
    seed: int = 0,
    warm: bool = False,
    name: str = "",
) -> tuple[SweepPlan, StudyJob]:
    """Return the plan of a study and what its runs have in common.

    Parameters
    ----------
    task
        The task.
    solver
        The solver's name.
    values
        Option and text such as ``("gamma", "0.8:0.999:12")``; see `read_values`.
    setup
        Back ends and their options.
    starts
        Places, or facts joined by ``+``, that the task is done from; empty for its own start.
    design
        ``one-at-a-time`` varies every option around the centre, ``grid`` takes all
        combinations.
    runs
        Runs of every setting, >= 1, with the seeds from `seed` on.
    seed
        The first seed, >= 0.
    warm
        Whether verdicts kept on disk are used.
    name
        Of the study, for people; empty for the task's name.

    Raises
    ------
    OptionError
        If an option, value or start is wrong, the solver refuses the task, or there are more
        than 100,000 runs.
    PluginError
        If a plugin is unknown or broken.
    """
    wanted = read_values(solver, list(values))
    fixed = _with(setup, solver, wanted.fixed)
    _check_size(wanted.axes, design, runs)
    job, common = _common(task, solver, setup, fixed, starts, warm)
    plan = SweepPlan(
        name=name or task.name,
        design=design,
        axes=wanted.axes,
        centre=wanted.centre,
        seeds=tuple(range(seed, seed + runs)),
        **common,
    )
    plugin = registry.load("solver", solver)
    for setting in plan.settings:
        # Options that do not go together are refused before anything has run.
        registry.make_options("solver", solver, plugin, {**fixed.get(solver, {}), **setting})
    return plan, job


def plan_sampled(
    task: Task,
    solver: str,
    values: Sequence[tuple[str, str]],
    setup: Setup = Setup(),
    *,
    sampler: str,
    minimise: str = "cost",
    starts: Sequence[str] = (),
    runs: int = 5,
    seed: int = 0,
    warm: bool = False,
    name: str = "",
) -> tuple[SampledPlan, StudyJob]:
    """Return the plan of a study whose settings a sampler chooses, and what its runs share.

    Parameters
    ----------
    values
        Option and text such as ``("gamma", "0.8:0.999")``; see `read_space`.
    sampler
        Name of the plugin that chooses.
    minimise
        One of `AIMS`.
    task, solver, setup, starts, runs, seed, warm, name
        As for `plan_study`.

    Raises
    ------
    OptionError
        If an option, range or start is wrong, no option varies, or the solver refuses the task.
    PluginError
        If a plugin is unknown or broken.
    """
    wanted = read_space(solver, values)
    job, common = _common(task, solver, setup, _with(setup, solver, wanted.fixed), starts, warm)
    plan = SampledPlan(
        name=name or task.name,
        design=SAMPLED,
        axes=tuple(Axis(one.option, (wanted.centre[one.option],)) for one in wanted.dimensions),
        centre=wanted.centre,
        seeds=tuple(range(seed, seed + runs)),
        space=wanted.dimensions,
        minimise=minimise,
        sampler=sampler,
        **common,
    )
    return plan, job


def _with(setup: Setup, solver: str, fixed: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the options of all plugins, with those of the solver that hold in all runs."""
    options: dict[str, dict[str, Any]] = {key: dict(kv) for key, kv in setup.options.items()}
    if fixed:
        options[solver] = {**options.get(solver, {}), **fixed}
    return options


def _common(
    task: Task,
    solver: str,
    setup: Setup,
    fixed: dict[str, dict[str, Any]],
    starts: Sequence[str],
    warm: bool,
) -> tuple[StudyJob, dict[str, Any]]:
    """Return what the runs of every design have in common, and what its plan says of that.

    Raises
    ------
    OptionError
        If a start is wrong or the solver refuses the task.
    """
    job = StudyJob(from_starts(task, list(starts)), solver, replace(setup, options=fixed), warm)
    first = next(iter(job.tasks.values()))
    refusal = make_solver(solver, fixed.get(solver, {})).refuses(make_model(first, job.setup))
    if refusal is not None:
        raise OptionError(f"The solver {solver!r} cannot serve {task.name!r}: {refusal}")
    return job, {
        "task": task.name,
        "kind": task.kind,
        "sha256": task.sha256,
        "cost_unit": task.metric.unit,
        "step_limit": task.step_limit,
        "solver": solver,
        "physics": setup.physics_choice(task).name,
        "collision": setup.detector_names(task),
        "fixed": fixed,
        "starts": tuple(Start(start, job.optimum(start)) for start in job.tasks),
        "warm": warm,
    }


def _check_size(axes: Sequence[Any], design: str, runs: int) -> None:
    counts = [len(axis.values) for axis in axes] or [1]
    settings = sum(counts)
    if design != ONE_AT_A_TIME:
        settings = 1
        for count in counts:
            settings *= count
    if settings * runs > _MOST_RUNS:
        raise OptionError(
            f"{settings:,} settings of {runs:,} runs are more than {_MOST_RUNS:,} runs. Take "
            "fewer values, or --design one-at-a-time."
        )


def do_study(
    plan: SweepPlan,
    job: StudyJob,
    *,
    jobs: int = 1,
    folder: StudyFolder | None = None,
    stopped: Callable[[], bool] = lambda: False,
    on_run: Callable[[SweepRecord], None] = lambda record: None,
) -> SweepResult:
    """Do the runs of a study that are not done yet, in processes of their own.

    The result depends neither on how many processes there are nor on the order in which runs
    end. Seeds come before settings, so that what is interrupted can be compared.

    Parameters
    ----------
    plan, job
        What `plan_study` returned.
    jobs
        How many processes, >= 1.
    folder
        Where finished runs are kept; what is there already is not done again.
    stopped
        Whether to stop; unfinished runs are given up.
    on_run
        Called with every finished run, those of the folder first.

    Raises
    ------
    OptionError
        If a finished run cannot be kept.
    SkillplanError
        If processes cannot be started.
    """
    records = [] if folder is None else list(folder.records)
    for record in records:
        on_run(record)
    done = {record.key for record in records}
    orders = (
        Order(index, setting, seed)
        for seed in plan.seeds
        for index, setting in enumerate(plan.settings)
        if (index, seed) not in done
    )
    maker = job.setup.make_executor
    for record in do_all(job, orders, jobs, stopped, None if maker is None else maker(jobs)):
        if folder is not None:
            folder.add(record)
        records.append(record)
        on_run(record)
    total = len(plan.settings) * len(plan.seeds)
    return SweepResult(plan, records, interrupted=len(records) < total)
