"""One training from its plan to its result: train all groups, prove the optimum, summarise."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import SkillplanError
from skillplan.pipeline.solving import open_warm_cache
from skillplan.records.evaluation import Optimum
from skillplan.records.training.result import (
    RunOutcome,
    RunStatus,
    TrainingResult,
    summarise_training,
)
from skillplan.records.training.run_folder import GroupProgress, RunFolder
from skillplan.records.training.shortfall import analyse_shortfall
from skillplan.solvers.learning.learner import Episode
from skillplan.solvers.stop import Stop
from skillplan.training.groups import (
    GroupFailure,
    GroupJob,
    GroupOutcome,
    GroupReport,
    drive_groups,
)
from skillplan.training.policies import prove_optimum
from skillplan.training.run_files import NO_PROGRESS, write_progress
from skillplan.training.training_folder import TrainingFolder
from skillplan.training.training_plan import TrainingPlan


class Trainer:
    """Trains all runs of a plan in a folder, and proves the optimum to compare with.

    Parameters
    ----------
    jobs
        Number of processes, >= 1. Results do not depend on it.
    time_limit_s
        Time limit for proving the optimum [s], > 0.

    Attributes
    ----------
    on_report
        Called with the state of a group after every stride.
    on_optimum
        Called with the optimum as soon as it is proved.
    back_end_failed
        True if a back end has failed in some group.
    interrupted
        True if `interrupt` or `end_in_time` was called.
    timed_out
        True if `end_in_time` was called, before any interruption.
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
        self._cache = open_warm_cache() if plan.warm else VerdictCache()

    def interrupt(self) -> None:
        """Stop soon: the runs are kept, and nothing more is proved."""
        self.interrupted = True
        if self._proof is not None:
            self._proof.interrupt()

    def end_in_time(self) -> None:
        """Stop like `interrupt`, because the time limit is over."""
        self.timed_out = not self.interrupted
        self.interrupt()

    def train(self) -> TrainingResult:
        """Train until all steps are done, store the result and return it.

        The optimum is proved first, so that the progress display can show the gap. With expensive
        back ends it is proved last, so that the runs count the checks that they need themselves.

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
        elapsed_s = max((group.elapsed_s for group in before if group is not None), default=0.0)
        expensive = any(back_end.expensive for back_end in plan.setup.back_ends(plan.task))
        # An own cache: the proof must not save the runs checks that they count.
        optimum = None if expensive else self._prove(VerdictCache())
        jobs = [GroupJob(plan, path, group, elapsed_s) for group in range(len(plan.groups))]
        endings: dict[int, GroupOutcome | GroupFailure] = {}
        maker = plan.setup.make_executor
        executor = None if maker is None else maker(self._jobs)
        for group, ending in drive_groups(
            jobs, self._jobs, lambda: self.interrupted, self._report, self._cache, executor
        ):
            endings[group] = ending
            if isinstance(ending, GroupFailure):
                self._store_failure(ending, stored)
        if self._strides:
            elapsed_s += time.monotonic() - begun_s
        optimum = optimum or self._prove(self._cache)
        result = self._make_result(stored, endings, optimum, elapsed_s)
        self._folder.finish(result.document())
        return result

    def _prove(self, cache: VerdictCache) -> Optimum:
        plan, self._proof = self._plan, Stop(time_limit_s=self._time_limit_s)
        if self.interrupted:
            return Optimum(reason="interrupted before it was proved")
        try:
            optimum = prove_optimum(plan.task, plan.setup, cache, self._proof)
        except SkillplanError as error:
            # The training counts without a proof.
            return Optimum(reason=str(error))
        self.on_optimum(optimum)
        return optimum

    def _report(self, report: GroupReport) -> None:
        self._strides += 1
        self.on_report(report)

    def _store_failure(self, failure: GroupFailure, stored: RunFolder) -> None:
        """Store why the runs of a group have failed."""
        reason = failure.reason
        if failure.back_end:
            self.back_end_failed = True
        before = stored.progress(failure.group) or NO_PROGRESS
        failures = dict.fromkeys(self._plan.groups[failure.group], reason)
        progress = before.model_copy(update={"failures": failures})
        write_progress(self._folder.path, failure.group, progress)

    def _make_result(
        self,
        stored: RunFolder,
        endings: dict[int, GroupOutcome | GroupFailure],
        optimum: Optimum,
        wall_s: float,
    ) -> TrainingResult:
        plan = self._plan
        outcomes: list[RunOutcome] = []
        incomplete: dict[int, Sequence[Episode]] = {}
        progress: list[GroupProgress] = []
        for group, runs in enumerate(plan.groups):
            ending = endings.get(group)
            policies = ending.policies if isinstance(ending, GroupOutcome) else {}
            done = stored.progress(group)
            progress += [] if done is None else [done]
            for index in runs:
                run = stored.run(index)
                best, last = policies.get(index, (None, None))
                record = summarise_training(run.episodes, run.steps, run.wall_s, run.latest_figures)
                outcome = RunOutcome(index, run.seed, run.failure, best, last, training=record)
                outcomes.append(outcome)
                if outcome.status is RunStatus.INCOMPLETE and run.episodes:
                    incomplete[index] = run.episodes
        steps = sum(outcome.training.steps for outcome in outcomes if outcome.training is not None)
        undone = any(
            outcome.training is None or outcome.training.steps < plan.steps
            for outcome in outcomes
            if not outcome.failure
        )
        return TrainingResult(
            task=plan.task,
            run_dir=str(self._folder.path),
            solver=plan.solver,
            steps=plan.steps,
            outcomes=tuple(outcomes),
            optimum=optimum,
            options=plan.options,
            derived_options=self._folder.manifest.derived_options,
            physics=self._folder.manifest.physics,
            collision=plan.setup.detector_names(plan.task),
            checks=sum(group.checks for group in progress),
            executions=sum(group.executions for group in progress),
            wall_s=wall_s,
            steps_per_s=steps / wall_s if steps and wall_s > 0 else None,
            interrupted=undone,
            shortfall=None
            if plan.family is not None
            else analyse_shortfall(plan.task, plan.solver, plan.options, plan.steps, incomplete),
            family=self._folder.manifest.family is not None,
            warm_start=self._folder.manifest.warm_start,
        )


def find_next_folder(task: str, solver: str) -> Path:
    """Return the first folder ``runs/TASK-SOLVER-N`` that does not exist."""
    stem = f"{task}-{solver}".replace("/", "-")
    number = 1
    while (path := Path("runs") / f"{stem}-{number}").exists():
        number += 1
    return path
