"""The straight line of a study whose settings a sampler chooses, in as many processes as join."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import Any

from skillplan.errors import OptionError
from skillplan.pipeline import registry
from skillplan.records.sweep.record import SweepRecord, record_of
from skillplan.records.sweep.result import SweepResult
from skillplan.records.sweep.sampled import SampledPlan, Trial, TriedSetting
from skillplan.sweep.sampler import Question, Sampler, SharedTrials
from skillplan.sweep.study_identity import difference, identity
from skillplan.sweep.study_run import StudyJob
from skillplan.sweep.study_workers import Order, do_all

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
        if record.error is None and all(one.arrived for one in record.outcomes)
    ]
    if all(record.error is not None for record in records):
        return None
    failed = 1.0 - len(arrived) / len(records)
    paid = [_paid(record, minimise) for record in arrived]
    return _FAILED * failed + (fmean(paid) if paid else 0.0)


def _paid(record: SweepRecord, minimise: str) -> float:
    if minimise == "seconds":
        times_s = [one.learning_s for one in record.outcomes]
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
