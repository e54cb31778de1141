"""Parameter studies from plan to result: with the settings of a design, or of a sampler."""

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
from skillplan.records.sweep.result import SweepRecord, SweepResult, parse_record
from skillplan.sweep.option_values import read_space, read_values
from skillplan.sweep.sampler import Question, Sampler, SharedTrials
from skillplan.sweep.study_folder import StudyFolder, describe_difference, get_identity
from skillplan.sweep.study_runs import Order, StudyJob, do_runs, set_starts
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
    """Plan a study; return the plan, and the job that all its runs share.

    Parameters
    ----------
    values
        Option and text such as ``("gamma", "0.8:0.999:12")``; see `read_values`.
    starts
        Places, or facts joined by ``+``. Default: the start of the task.
    design
        ``one-at-a-time`` varies one option while the others stay at the centre, ``grid`` takes all
        combinations.
    runs
        Runs per setting, >= 1, with seeds from `seed` on.
    name
        Title of the study. Default: the task's name.

    Raises
    ------
    OptionError
        If an option, value or start is wrong, the solver refuses the task, or there are more than
        100,000 runs.
    PluginError
        If a plugin is unknown or broken.
    """
    options = read_values(solver, list(values))
    fixed = _add_options(setup, solver, options.fixed)
    _check_size(options.axes, design, runs)
    job, common = _plan_common(task, solver, setup, fixed, starts, warm)
    plan = SweepPlan(
        name=name or task.name,
        design=design,
        axes=options.axes,
        centre=options.centre,
        seeds=tuple(range(seed, seed + runs)),
        **common,
    )
    plugin = registry.load("solver", solver)
    for setting in plan.settings:
        # Options that contradict each other are refused before the first run.
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
    """Plan a study whose settings a sampler chooses; return the plan, and the job of its runs.

    Parameters
    ----------
    values
        Option and text such as ``("gamma", "0.8:0.999")``; see `read_space`.
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
    job, common = _plan_common(
        task, solver, setup, _add_options(setup, solver, space.fixed), starts, warm
    )
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


def _add_options(setup: Setup, solver: str, fixed: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Add options of the solver to the options of all plugins."""
    options: dict[str, dict[str, Any]] = {key: dict(kv) for key, kv in setup.options.items()}
    if fixed:
        options[solver] = {**options.get(solver, {}), **fixed}
    return options


def _plan_common(
    task: Task,
    solver: str,
    setup: Setup,
    fixed: dict[str, dict[str, Any]],
    starts: Sequence[str],
    warm: bool,
) -> tuple[StudyJob, dict[str, Any]]:
    """Return the job of the runs, and the fields that all plans share."""
    job = StudyJob(set_starts(task, list(starts)), solver, replace(setup, options=fixed), warm)
    first = next(iter(job.tasks.values()))
    refusal = make_solver(solver, fixed.get(solver, {})).find_refusal(make_model(first, job.setup))
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
        "seeded": registry.load("solver", solver).seeded,
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
    """Do the missing runs of a study in worker processes.

    The result depends neither on the number of processes nor on the order in which runs end. All
    settings run with the first seed before the second, so that an interrupted study can be
    compared.

    Parameters
    ----------
    folder
        Stores finished runs; runs that are already there are not repeated.
    stopped
        Returns True to stop; unfinished runs are discarded.
    on_run
        Called with every finished run, starting with the stored ones.

    Raises
    ------
    OptionError
        If a finished run cannot be stored.
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
    for record in do_runs(job, orders, jobs, stopped, None if maker is None else maker(jobs)):
        if folder is not None:
            folder.add(record)
        records.append(record)
        on_run(record)
    total = len(plan.settings) * len(plan.seeds)
    return SweepResult(plan, records, interrupted=len(records) < total)


# Weight of the share of failures, larger than any mean.
_FAILED = 1e9


def make_sampler(name: str, options: Mapping[str, Any]) -> Sampler:
    """Make a sampler by name.

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


def open_trials(out: str, plan: SampledPlan, sampler: Sampler, seed: int) -> SharedTrials:
    """Open the trials of a folder: a new study, or the same study of other processes.

    Finished trials with a failed run are tried again.

    Raises
    ------
    OptionError
        If the folder cannot be used, or holds something else or another study; the message names
        the difference.
    """
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = {path.name for path in folder.iterdir()}
    except OSError as error:
        raise OptionError(f"--out {out}: cannot be used: {error.strerror}.") from None
    if there and sampler.keeps not in there:
        raise OptionError(
            f"--out {out}: is not empty, and holds no trials of {sampler.name} "
            f"({sampler.keeps}). Name a new folder, or one of such a study to join it."
        )
    about = get_identity(plan)
    # The tried values change during the study.
    about.pop("axes")
    about["sampler_options"] = sampler.options.model_dump(mode="json")
    first = {
        dimension.option: plan.centre[dimension.option]
        for dimension in plan.space
        if dimension.holds(plan.centre[dimension.option])
    }
    trials = sampler.join(folder, Question(plan.space, about, first, seed))
    differs = describe_difference(trials.about, about)
    if differs is not None:
        raise OptionError(
            f"--out {out}: the study there differs {differs}. Give the same values to join "
            "it, or name a new folder."
        )
    failed = [
        trial.trial.number
        for trial in trials.finished()
        if any(_parse(trial.trial.number, line).error is not None for line in trial.lines)
    ]
    if failed:
        trials.retry(failed)
    return trials


def _parse(number: int, line: str) -> SweepRecord:
    try:
        return parse_record(line)
    except ValueError as error:
        raise OptionError(
            f"Trial {number} of the study is damaged: {error}. Begin in a new folder."
        ) from None


@dataclass
class _Running:
    """A trial and its finished runs."""

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
    """Try settings until enough trials are finished, including other processes'.

    The settings depend on the order in which runs end. A stop discards unfinished trials.

    Parameters
    ----------
    most
        Number of trials, finished or running here, after which no other begins, >= 1.
    stopped
        Returns True to stop.
    on_trial
        Called after every trial that was finished here.

    Raises
    ------
    OptionError
        If trials cannot be stored or read.
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
        for record in do_runs(job, orders(), jobs, stopped, executor):
            running_trial = running[record.setting]
            running_trial.records.append(record)
            if len(running_trial.records) == len(plan.seeds):
                del running[record.setting]
                lines = [run.line() for run in running_trial.records]
                value = rate_setting(running_trial.records, plan.minimise)
                trials.tell(running_trial.trial, value, lines)
                on_trial()
    finally:
        for running_trial in running.values():
            # The folder itself may have failed.
            with suppress(OptionError):
                trials.give_up(running_trial.trial)
    return _collect_trials(plan, trials, interrupted=trials.done() < most)


def rate_setting(records: Sequence[SweepRecord], minimise: str) -> float | None:
    """Return the value of a setting, lower is better; None if every run failed.

    The share of runs that miss the goal from some start counts first, then the mean over the other
    runs of the quantity to minimise.
    """
    arrived = [
        record
        for record in records
        if record.error is None and all(outcome.arrived for outcome in record.outcomes)
    ]
    if all(record.error is not None for record in records):
        return None
    failed = 1.0 - len(arrived) / len(records)
    paid = [_measure(record, minimise) for record in arrived]
    return _FAILED * failed + (fmean(paid) if paid else 0.0)


def _measure(record: SweepRecord, minimise: str) -> float:
    if minimise == "seconds":
        times_s = [outcome.learning_s for outcome in record.outcomes]
        return max(times_s) if record.shared else sum(times_s)
    if minimise == "steps":
        return float(sum(outcome.steps or 0 for outcome in record.outcomes))
    return sum(outcome.cost or 0.0 for outcome in record.outcomes)


def _collect_trials(plan: SampledPlan, trials: SharedTrials, *, interrupted: bool) -> SweepResult:
    """Return the result of all trials of a study, including other processes'."""
    options = {dimension.option for dimension in plan.space}
    kept = {}
    for finished in trials.finished():
        number = finished.trial.number
        records = [_parse(number, line) for line in finished.lines]
        try:
            if set(finished.trial.values) != options:
                raise ValueError("it has other options")
            if sorted(record.seed for record in records) != sorted(plan.seeds):
                raise ValueError("it has other runs")
        except ValueError as error:
            raise OptionError(
                f"Trial {number} of the study is damaged: {error}. Begin in a new folder."
            ) from None
        kept[number] = (TriedSetting(finished.trial, finished.value), records)
    plan = plan.with_tried([setting for setting, _ in kept.values()])
    all_records = [
        replace(record, setting=index)
        for index, setting in enumerate(plan.tried)
        for record in kept[setting.trial.number][1]
    ]
    try:
        return SweepResult(plan, all_records, interrupted)
    except ValueError as error:
        raise OptionError(f"The study is damaged: {error} Begin in a new folder.") from None
