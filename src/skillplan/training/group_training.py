"""Runs that learn side by side: driven in short strides, noted, and kept at checkpoints.

What is noted is on disk before the checkpoint that counts on it, so that whatever ends the
program, at whatever instant, the runs go on from the last checkpoint as if nothing had happened.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.errors import OptionError, SkillplanError
from skillplan.files.folder import make_folder
from skillplan.files.folder_lock import FolderLock
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.run import make_model, warm_cache
from skillplan.records.training.run_folder import CHECKPOINT, GroupProgress, RunFolder, group_path
from skillplan.solvers.learning.learner import STRIDE_STEPS, Training
from skillplan.training.checkpoint_file import Checkpoint, read_checkpoint, write_checkpoint
from skillplan.training.group_job import (
    NO_PROGRESS,
    GroupJob,
    GroupOutcome,
    GroupReport,
    write_progress,
)
from skillplan.training.learned_policies import store_policies
from skillplan.training.run_log import RunLog, writing
from skillplan.workers.inside import shares_files

# Processes of a program that was killed end within this time.
_PATIENCE_S = 10.0


def kept_verdicts(job: GroupJob) -> VerdictCache:
    """Return where a group keeps verdicts: nothing is in memory yet.

    As the plan has it, but in memory alone where files are not those of whoever gave the job.
    """
    return warm_cache() if job.plan.warm and shares_files() else VerdictCache()


class GroupTraining:
    """Drives one training and keeps what it hands over.

    Parameters
    ----------
    job
        What to drive; goes on from its checkpoint where there is one.
    cache
        Where verdicts are kept; by default `kept_verdicts`.
    overdue
        Returns True once the training should have stopped long ago.

    Raises
    ------
    OptionError
        If a file is damaged or cannot be written, or another program is writing there.
    SkillplanError
        If the learner does not accept its own snapshot.
    """

    def __init__(
        self,
        job: GroupJob,
        cache: VerdictCache | None = None,
        overdue: Callable[[], bool] | None = None,
    ) -> None:
        self._job, plan = job, job.plan
        self._runs = plan.groups[job.group]
        self._begun_s = time.monotonic()
        self._logs: list[RunLog] = []
        self._path = group_path(job.folder, job.group)
        with writing(job.folder, f"groups/{job.group}"):
            make_folder(self._path, within=job.folder)
        self._lock = FolderLock(self._path, "training", _PATIENCE_S)
        try:
            checkpoint = read_checkpoint(self._path / CHECKPOINT, within=job.folder)
            progress = RunFolder(job.folder).progress(job.group)
            if cache is None:
                cache = kept_verdicts(job)
            self._models = [make_model(one, plan.setup, cache, overdue) for one in plan.layouts]
            self._judge = self._models[0]
            if plan.task is not plan.layouts[0]:
                self._judge = make_model(plan.task, plan.setup, cache, overdue)
            self._expensive = any(one.expensive for one in self._judge.feasibility.back_ends)
            self._before = self._reported = progress or NO_PROGRESS
            lengths = {} if checkpoint is None else checkpoint.lengths
            for run in self._runs:
                self._logs.append(RunLog(job.folder, run, lengths))
            self._training = self._begin(checkpoint)
            self._kept_steps = -1 if checkpoint is None else checkpoint.steps
        except BaseException:
            self.close()
            raise

    @property
    def finished(self) -> bool:
        """Whether all steps are done."""
        return self._training.steps >= self._job.plan.steps

    @property
    def report(self) -> GroupReport:
        """How the runs stand."""
        costs = [log.best_cost for log in self._logs if log.best_cost is not None]
        return GroupReport(
            self._job.group,
            self._training.steps,
            sum(log.episodes for log in self._logs),
            (
                sum(sum(log.recent) for log in self._logs),
                sum(len(log.recent) for log in self._logs),
            ),
            min(costs, default=None),
            self._progress().executions if self._expensive else 0,
        )

    def advance(self) -> None:
        """Do a stride, note it, and keep a checkpoint where one is due.

        Raises
        ------
        OptionError
            If something cannot be written; the checkpoint before stays.
        SkillplanError
            If the learner does not do the steps it should, or a back end fails.
        """
        plan, training = self._job.plan, self._training
        before = training.steps
        until = min(plan.steps, (before // STRIDE_STEPS + 1) * STRIDE_STEPS)
        episodes = training.advance(until - before)
        figures = training.figures()
        if training.steps != until or len(figures) != len(self._runs):
            raise SkillplanError(
                f"The solver {plan.solver!r} was to go on to step {until} with "
                f"{len(self._runs)} runs, but is at step {training.steps} with {len(figures)}."
            )
        for index, log in enumerate(self._logs):
            mine = [episode for episode in episodes if episode.run == index]
            log.note(until, mine, figures[index])
        every = plan.checkpoint_steps
        if until // every > before // every or self.finished:
            self._keep()

    def conclude(self) -> GroupOutcome:
        """Keep all as it is, write the policies, and say what they do.

        Raises
        ------
        OptionError
            If something cannot be written.
        BackEndError
            If a back end fails.
        """
        if self._kept_steps != self._training.steps:
            self._keep()
        now = self._progress()
        if (now.steps, now.failures) != (self._reported.steps, self._reported.failures):
            # A program was ended before it wrote this, or what had failed once goes on now.
            self._write_progress()
        training, found = self._training, {}
        for index, run in enumerate(self._runs):
            try:
                learned = training.learned(index)
            except ValueError:
                if index in training.failed:
                    continue  # what it learned last is no network
                raise
            found[run] = store_policies(
                self._job.plan, self._job.folder, run, learned, training.steps, self._judge
            )
        return GroupOutcome(found)

    def close(self) -> None:
        """Let go of all files and processes."""
        for log in self._logs:
            log.close()
        for model in getattr(self, "_models", []):
            model.feasibility.close()
        self._lock.release()

    def _begin(self, checkpoint: Checkpoint | None) -> Training:
        plan = self._job.plan
        learner = plan.learner()
        options = learner.options
        env = SkillVectorEnv(
            self._models,
            len(self._runs),
            observation=options.observation,
            mask=options.mask,
            objective=options.objective,
        )
        seeds = [plan.seeds[run] for run in self._runs]
        if checkpoint is None:
            training = learner.begin(env, seeds, plan.steps)
            if plan.start is not None:
                training.start_from([plan.start.networks[run] for run in self._runs])
            return training
        try:
            training = learner.resume(env, seeds, plan.steps, checkpoint.snapshot)
        except ValueError as error:
            raise OptionError(
                f"{self._path / CHECKPOINT}: is none that the solver {plan.solver!r} can go on "
                f"from: {error} Delete it, and --resume begins its runs again."
            ) from None
        if training.steps != checkpoint.steps:
            raise SkillplanError(
                f"The solver {plan.solver!r} goes on from step {training.steps}, not from step "
                f"{checkpoint.steps}, at which it was kept."
            )
        return training

    def _keep(self) -> None:
        """Force what was noted to disk, then replace the checkpoint, then the progress."""
        lengths = {name: n for log in self._logs for name, n in log.sync().items()}
        checkpoint = Checkpoint(self._training.steps, lengths, self._training.snapshot())
        with writing(self._job.folder, f"groups/{self._job.group}/{CHECKPOINT}"):
            write_checkpoint(self._path / CHECKPOINT, checkpoint, within=self._job.folder)
        self._kept_steps = self._training.steps
        self._write_progress()

    def _progress(self) -> GroupProgress:
        models: list[SkillModel] = list(self._models)
        if self._judge not in models:
            models.append(self._judge)
        checkers = [model.feasibility for model in models]
        before, here_s = self._before, time.monotonic() - self._begun_s
        names = dict.fromkeys([*before.asked, *(name for one in checkers for name in one.queried)])
        return GroupProgress(
            steps=max(self._kept_steps, 0),
            failures={self._runs[at]: why for at, why in sorted(self._training.failed.items())},
            wall_s=before.wall_s + here_s,
            elapsed_s=self._job.elapsed_s + here_s,
            checks=before.checks + sum(one.checks for one in checkers),
            hits=before.hits + sum(one.hits for one in checkers),
            executions=before.executions + sum(one.executions for one in checkers),
            asked={
                name: before.asked.get(name, 0) + sum(one.queried[name] for one in checkers)
                for name in names
            },
        )

    def _write_progress(self) -> None:
        self._reported = self._progress()
        write_progress(self._job.folder, self._job.group, self._reported)
