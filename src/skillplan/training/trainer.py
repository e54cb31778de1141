"""The straight line of a training: drive its groups, prove the optimum, say what came of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import SkillplanError
from skillplan.pipeline.solving import warm_cache
from skillplan.records.optimum import Optimum
from skillplan.records.training.result import RunOutcome, RunStatus, TrainingResult, training_record
from skillplan.records.training.run_folder import GroupProgress, RunFolder
from skillplan.records.training.shortfall import shortfall_of
from skillplan.solvers.learning.learner import Episode
from skillplan.solvers.stop import Stop
from skillplan.training.groups import (
    NO_PROGRESS,
    Ending,
    GroupFailure,
    GroupJob,
    GroupReport,
    drive_groups,
    write_progress,
)
from skillplan.training.policies import prove_optimum
from skillplan.training.training_folder import TrainingFolder
from skillplan.training.training_plan import TrainingPlan


class Trainer:
    """Trains all runs of a plan in a folder, and proves what they could have reached.

    Parameters
    ----------
    plan
        What is trained.
    folder
        Where everything is kept; what is there already is not done again.
    jobs
        In how many processes groups of runs learn; nothing that is learned depends on it.
    time_limit_s
        How long proving the optimum may take [s], > 0; None for no limit.

    Attributes
    ----------
    on_report
        Called with how a group stands, now and then.
    on_optimum
        Called with the optimum as soon as it is known.
    back_end_failed
        Whether a back end has failed in some group.
    interrupted
        Whether `interrupt` or `end_in_time` was called.
    timed_out
        Whether `end_in_time` was called, before any interruption.
    """

    def __init__(
        self,
        plan: TrainingPlan,
        folder: TrainingFolder,
        *,
        jobs: int = 1,
        time_limit_s: float | None = None,
    ) -> None:
        self.back_end_failed = False
        self._plan, self._folder, self._jobs = plan, folder, jobs
        self.interrupted = self.timed_out = False
        self._time_limit_s = time_limit_s
        self._proof: Stop | None = None
        self._strides = 0
        self.on_report: Callable[[GroupReport], None] = lambda report: None
        self.on_optimum: Callable[[Optimum], None] = lambda optimum: None
        self._cache = warm_cache() if plan.warm else VerdictCache()

    def interrupt(self) -> None:
        """Stop with what there is: runs are kept where they stand, and nothing more is proved."""
        self.interrupted = True
        if self._proof is not None:
            self._proof.interrupt()

    def end_in_time(self) -> None:
        """Stop as `interrupt` does, because the time is over."""
        self.timed_out = not self.interrupted
        self.interrupt()

    def train(self) -> TrainingResult:
        """Do what is left to do, keep the result in the folder, and return it.

        The optimum is proved first, so that people who wait see the gap; where back ends are
        expensive it is proved last, so that the runs count the checks they need themselves.

        Raises
        ------
        OptionError
            If something cannot be written, or a file of the folder is damaged.
        SkillplanError
            If processes cannot be started.
        """
        begun_s = time.monotonic()
        plan, path = self._plan, self._folder.path
        stored = RunFolder(path)
        before = [stored.progress(group) for group in range(len(plan.groups))]
        elapsed_s = max((one.elapsed_s for one in before if one is not None), default=0.0)
        expensive = any(back_end.expensive for back_end in plan.setup.back_ends(plan.task))
        # Proved first, it must not spare the runs the checks they have to make themselves.
        optimum = None if expensive else self._prove(VerdictCache())
        jobs = [GroupJob(plan, path, group, elapsed_s) for group in range(len(plan.groups))]
        endings: dict[int, Ending] = {}
        maker = plan.setup.make_executor
        executor = None if maker is None else maker(self._jobs)
        for ending in drive_groups(
            jobs, self._jobs, lambda: self.interrupted, self._report, self._cache, executor
        ):
            endings[ending[0]] = ending
            if isinstance(ending[1], GroupFailure):
                self._fail(ending[1], stored)
        if self._strides:
            elapsed_s += time.monotonic() - begun_s
        optimum = optimum or self._prove(self._cache)
        result = self._result(stored, endings, optimum, elapsed_s)
        self._folder.finish(result.document())
        return result

    def _prove(self, cache: VerdictCache) -> Optimum:
        plan, self._proof = self._plan, Stop(time_limit_s=self._time_limit_s)
        if self.interrupted:
            return Optimum(reason="interrupted before it was proved")
        try:
            optimum = prove_optimum(plan.task, plan.setup, cache, self._proof)
        except SkillplanError as error:
            # What was learned counts without it.
            return Optimum(reason=str(error))
        self.on_optimum(optimum)
        return optimum

    def _report(self, report: GroupReport) -> None:
        self._strides += 1
        self.on_report(report)

    def _fail(self, failure: GroupFailure, stored: RunFolder) -> None:
        """Keep why the runs of a group have failed."""
        reason = failure.reason
        if failure.back_end:
            self.back_end_failed = True
        before = stored.progress(failure.group) or NO_PROGRESS
        failures = dict.fromkeys(self._plan.groups[failure.group], reason)
        progress = before.model_copy(update={"failures": failures})
        write_progress(self._folder.path, failure.group, progress)

    def _result(
        self,
        stored: RunFolder,
        endings: dict[int, Ending],
        optimum: Optimum,
        wall_s: float,
    ) -> TrainingResult:
        plan = self._plan
        outcomes = []
        short: dict[int, Sequence[Episode]] = {}
        progress: list[GroupProgress] = []
        for group, runs in enumerate(plan.groups):
            ending = endings[group][1] if group in endings else None
            policies = {} if ending is None or isinstance(ending, GroupFailure) else ending.policies
            found = stored.progress(group)
            progress += [] if found is None else [found]
            for run in runs:
                one = stored.run(run)
                best, last = policies.get(run, (None, None))
                outcomes.append(
                    RunOutcome(
                        run,
                        one.seed,
                        one.failure,
                        best,
                        last,
                        training=training_record(one.episodes, one.steps, one.wall_s),
                    )
                )
                if outcomes[-1].status is RunStatus.INCOMPLETE and one.episodes:
                    short[run] = one.episodes
        steps = sum(one.training.steps for one in outcomes if one.training is not None)
        undone = any(
            one.training is None or one.training.steps < plan.steps
            for one in outcomes
            if not one.failure
        )
        return TrainingResult(
            task=plan.task,
            run_dir=str(self._folder.path),
            solver=plan.solver,
            steps=plan.steps,
            outcomes=tuple(outcomes),
            optimum=optimum,
            options=plan.options,
            physics=self._folder.manifest.physics,
            collision=plan.setup.detector_names(plan.task),
            checks=sum(one.checks for one in progress),
            executions=sum(one.executions for one in progress),
            wall_s=wall_s,
            steps_per_s=steps / wall_s if steps and wall_s > 0 else None,
            interrupted=undone,
            shortfall=None
            if plan.family is not None
            else shortfall_of(plan.task, plan.solver, plan.options, plan.steps, short),
            family=self._folder.manifest.family is not None,
            warm_start=self._folder.manifest.warm_start,
        )


def next_folder(task: str, solver: str) -> Path:
    """Return a folder for a training that names none: the first under ``runs`` that is free."""
    stem = f"{task}-{solver}".replace("/", "-")
    number = 1
    while (path := Path("runs") / f"{stem}-{number}").exists():
        number += 1
    return path
