"""The straight line of a parameter study: plan it, do its runs, say what they show."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import Any

from skillplan.errors import OptionError
from skillplan.pipeline import registry
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import make_model, make_solver
from skillplan.records.sweep.plan import (
    ONE_AT_A_TIME,
    SAMPLED,
    Axis,
    SampledPlan,
    Start,
    SweepPlan,
    Trial,
    TriedSetting,
)
from skillplan.records.sweep.result import SweepRecord, SweepResult, record_of
from skillplan.sweep.option_values import read_space, read_values
from skillplan.sweep.sampler import Question, Sampler, SharedTrials
from skillplan.sweep.study_folder import StudyFolder, difference, identity
from skillplan.sweep.study_runs import Order, StudyJob, do_all, from_starts
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
    space = read_space(solver, values)
    job, common = _common(task, solver, setup, _with(setup, solver, space.fixed), starts, warm)
    plan = SampledPlan(
        name=name or task.name,
        design=SAMPLED,
        axes=tuple(
            Axis(dimension.option, (space.centre[dimension.option],))
            for dimension in space.dimensions
        ),
        centre=space.centre,
        seeds=tuple(range(seed, seed + runs)),
        space=space.dimensions,
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


# A setting is worse than any of which more runs arrive: its share of failures counts so much.
_FAILED = 1e9


def make_sampler(name: str, options: Mapping[str, Any]) -> Sampler:
    """Return a sampler by name.

    Raises
    ------
    OptionError
        If an option is wrong.
    PluginError
        If it is unknown, broken or not installed.
    """
    plugin = registry.load("sampler", name)
    sampler: Sampler = plugin(registry.make_options("sampler", name, plugin, options))
    return sampler


def shared_trials(out: str, plan: SampledPlan, sampler: Sampler, seed: int) -> SharedTrials:
    """Return the trials of a folder: a new study, or the same one that others have begun.

    Raises
    ------
    OptionError
        If the folder cannot be used, holds something else, or holds another study: what differs
        is named.
    """
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = {one.name for one in folder.iterdir()}
    except OSError as error:
        raise OptionError(f"--out {out}: cannot be used: {error.strerror}.") from None
    if there and sampler.keeps not in there:
        raise OptionError(
            f"--out {out}: is not empty, and holds no trials of {sampler.name} "
            f"({sampler.keeps}). Name a new folder, or one of such a study to join it."
        )
    about = identity(plan)
    # What is tried changes, and so does where it is done.
    about.pop("axes")
    about["sampler_options"] = sampler.options.model_dump(mode="json")
    first = {
        one.option: plan.centre[one.option]
        for one in plan.space
        if one.holds(plan.centre[one.option])
    }
    trials = sampler.join(folder, Question(plan.space, about, first, seed))
    differs = difference(trials.about, about)
    if differs is not None:
        raise OptionError(
            f"--out {out}: the study there is another one, {differs}. Give the same values to join "
            "it, or name a new folder."
        )
    return trials


@dataclass
class _Running:
    """A trial whose runs are being done."""

    trial: Trial
    records: list[SweepRecord] = field(default_factory=list)


def do_sampled(
    plan: SampledPlan,
    job: StudyJob,
    trials: SharedTrials,
    most: int,
    *,
    jobs: int = 1,
    stopped: Callable[[], bool] = lambda: False,
    on_trial: Callable[[], None] = lambda: None,
) -> SweepResult:
    """Try settings until so many trials are finished, those of other processes included.

    Which settings are tried depends on the order in which runs end. Trials that are under way when
    it is stopped are forgotten.

    Parameters
    ----------
    plan, job
        What `plan_sampled` returned.
    trials
        Of the study's folder.
    most
        Once so many are finished, or under way here, no further one is begun, >= 1.
    jobs
        How many processes, >= 1.
    stopped
        Whether to stop.
    on_trial
        Called with every trial that was finished here.

    Raises
    ------
    OptionError
        If trials cannot be kept or read.
    SkillplanError
        If processes cannot be started.
    """
    running: dict[int, _Running] = {}

    def orders() -> Iterator[Order]:
        while not stopped() and trials.done() + len(running) < most:
            trial = trials.ask()
            running[trial.number] = _Running(trial)
            for seed in plan.seeds:
                yield Order(trial.number, trial.values, seed)

    maker = job.setup.make_executor
    executor = None if maker is None else maker(jobs)
    try:
        for record in do_all(job, orders(), jobs, stopped, executor):
            one = running[record.setting]
            one.records.append(record)
            if len(one.records) == len(plan.seeds):
                del running[record.setting]
                lines = [run.line() for run in one.records]
                trials.tell(one.trial, value_of(one.records, plan.minimise), lines)
                on_trial()
    finally:
        for one in running.values():
            # What ended this may be that nothing can be kept.
            with suppress(OptionError):
                trials.give_up(one.trial)
    return sampled_result(plan, trials, interrupted=trials.done() < most)


def value_of(records: Sequence[SweepRecord], minimise: str) -> float | None:
    """Return what a setting is worth, the less the better; None where every run failed.

    First counts which share of the runs does not arrive from every start, then the mean of what is
    minimised, over the runs that do.

    Parameters
    ----------
    records
        The runs of the setting, at least one.
    minimise
        One of `AIMS`.
    """
    arrived = [
        record
        for record in records
        if record.error is None and all(outcome.arrived for outcome in record.outcomes)
    ]
    if all(record.error is not None for record in records):
        return None
    failed = 1.0 - len(arrived) / len(records)
    paid = [_paid(record, minimise) for record in arrived]
    return _FAILED * failed + (fmean(paid) if paid else 0.0)


def _paid(record: SweepRecord, minimise: str) -> float:
    if minimise == "seconds":
        times_s = [outcome.learning_s for outcome in record.outcomes]
        return max(times_s) if record.shared else sum(times_s)
    if minimise == "steps":
        return float(sum(one.steps or 0 for one in record.outcomes))
    return sum(one.cost or 0.0 for one in record.outcomes)


def sampled_result(plan: SampledPlan, trials: SharedTrials, *, interrupted: bool) -> SweepResult:
    """Return what all trials of a study show, whoever did them.

    Raises
    ------
    OptionError
        If what is kept is damaged.
    """
    options = {one.option for one in plan.space}
    kept = {}
    for one in trials.finished():
        number = one.trial.number
        try:
            records = [record_of(line) for line in one.lines]
            if set(one.trial.values) != options:
                raise ValueError("it has other options")
            if sorted(record.seed for record in records) != sorted(plan.seeds):
                raise ValueError("it has other runs")
        except ValueError as error:
            raise OptionError(
                f"Trial {number} of the study is damaged: {error}. Begin in a new folder."
            ) from None
        kept[number] = (TriedSetting(one.trial, one.value), records)
    plan = plan.with_tried([tried for tried, _ in kept.values()])
    found = [
        replace(record, setting=index)
        for index, tried in enumerate(plan.tried)
        for record in kept[tried.trial.number][1]
    ]
    try:
        return SweepResult(plan, found, interrupted)
    except ValueError as error:
        raise OptionError(f"The study is damaged: {error} Begin in a new folder.") from None
