"""Groups of runs that learn together: driven in short strides, here or in worker processes.

A group writes its records to disk before the checkpoint that counts on them. A training that is
killed at any moment therefore resumes from the last checkpoint, bit for bit. The results do not
depend on where a group runs. A worker that dies is started once more from the checkpoint of its
group; if it dies again, only the runs of this group fail.

An executor that does not share our files receives the files of a group, works in a scratch folder
and returns the changes with every answer.
"""

from __future__ import annotations

import shutil
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.errors import BackEndError, OptionError, PluginError, SearchStopped, SkillplanError
from skillplan.files.folder import FolderLock, make_folder
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.registry import load
from skillplan.pipeline.solving import make_model, open_warm_cache
from skillplan.plugins.blame import describe_exception, ends_program, is_debugging
from skillplan.records.training.result import GreedyRollOut
from skillplan.records.training.run_folder import (
    CHECKPOINT,
    GroupProgress,
    RunFolder,
    get_group_path,
)
from skillplan.solvers.learning.learner import STRIDE_STEPS, Training
from skillplan.training.policies import store_policies
from skillplan.training.run_files import (
    NO_PROGRESS,
    Checkpoint,
    FileChange,
    FolderWatcher,
    RunLog,
    apply_changes,
    read_checkpoint,
    read_files,
    write_checkpoint,
    write_progress,
    writing,
)
from skillplan.training.training_plan import TrainingPlan
from skillplan.workers.executor import Answer, Ended, Executor, Worker, pack_content, shares_files
from skillplan.workers.local_processes import LocalProcesses

# Processes of a killed program end within this time [s].
_PATIENCE_S = 10.0
_PURPOSE = "the training"
_STARTS = 2
# Time that a group has to answer after a stop [s]; afterwards its last checkpoint counts.
GRACE_S = 1.5

Order = Literal["advance", "conclude"]


@dataclass(frozen=True)
class GroupJob:
    """A group of runs to drive. It can be sent to another process.

    Parameters
    ----------
    elapsed_s
        Duration of the training before this program started [s].
    """

    plan: TrainingPlan
    folder: Path
    group: int
    elapsed_s: float = 0.0

    @property
    def has_checkpoint(self) -> bool:
        """True if the group has a checkpoint to conclude from."""
        return (get_group_path(self.folder, self.group) / CHECKPOINT).exists()

    @property
    def in_worker(self) -> GroupJob:
        """The same group without worker processes of its own."""
        return replace(self, plan=replace(self.plan, setup=self.plan.setup.in_worker))


@dataclass(frozen=True, slots=True)
class GroupReport:
    """State of a group between two strides, for the progress display.

    Parameters
    ----------
    episodes
        Finished episodes of all runs.
    recent
        Successes and number of the latest episodes, summed over the runs.
    best_cost
        Lowest cost of a successful episode, if any.
    executions
        Checks by expensive back ends so far.
    """

    group: int
    steps: int
    episodes: int
    recent: tuple[int, int]
    best_cost: float | None
    executions: int


@dataclass(frozen=True, slots=True)
class GroupOutcome:
    """Greedy roll-outs of the policies of a group.

    Parameters
    ----------
    policies
        By run: the best policy, None if none completed the task, and the last one.
    """

    policies: dict[int, tuple[GreedyRollOut | None, GreedyRollOut]]


@dataclass(frozen=True, slots=True)
class GroupFailure:
    """Why the runs of a group cannot continue.

    Parameters
    ----------
    fatal
        True if all other groups must end, too: a file is damaged or cannot be written.
    back_end
        True if a back end has failed.
    stopped
        True if the group was only stopped, and lost the work since its last checkpoint.
    """

    group: int
    reason: str
    fatal: bool = False
    back_end: bool = False
    stopped: bool = False


GroupAnswer = GroupReport | GroupOutcome | GroupFailure
Ending = tuple[int, GroupOutcome | GroupFailure]


def make_group_cache(job: GroupJob) -> VerdictCache:
    """Return an empty verdict cache for a group, backed by the disk if the plan allows it.

    A worker that does not share the files of the command keeps verdicts in memory only.
    """
    return open_warm_cache() if job.plan.warm and shares_files() else VerdictCache()


class GroupTraining:
    """Drives the training of one group and stores its results.

    Parameters
    ----------
    job
        The group. It continues from its checkpoint, if it has one.
    cache
        Verdict cache. Default: a new one of `make_group_cache`.
    overdue
        Returns True if the training should have stopped long ago.

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
        self._path = get_group_path(job.folder, job.group)
        with writing(job.folder, f"groups/{job.group}"):
            make_folder(self._path, within=job.folder)
        self._lock = FolderLock(self._path, "training", _PATIENCE_S)
        try:
            checkpoint = read_checkpoint(self._path / CHECKPOINT, within=job.folder)
            progress = RunFolder(job.folder).progress(job.group)
            if cache is None:
                cache = make_group_cache(job)
            self._models = [
                make_model(layout, plan.setup, cache, overdue) for layout in plan.layouts
            ]
            self._judge = self._models[0]
            if plan.task is not plan.layouts[0]:
                self._judge = make_model(plan.task, plan.setup, cache, overdue)
            back_ends = self._judge.feasibility.back_ends
            self._expensive = any(back_end.expensive for back_end in back_ends)
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
        """True if all steps are done."""
        return self._training.steps >= self._job.plan.steps

    @property
    def report(self) -> GroupReport:
        """State of the runs."""
        logs = self._logs
        recent = (sum(sum(log.recent) for log in logs), sum(len(log.recent) for log in logs))
        return GroupReport(
            self._job.group,
            self._training.steps,
            sum(log.episodes for log in logs),
            recent,
            min((log.best_cost for log in logs if log.best_cost is not None), default=None),
            self._progress().executions if self._expensive else 0,
        )

    def advance(self) -> None:
        """Train for one stride, record it, and write a checkpoint if one is due.

        Raises
        ------
        OptionError
            If something cannot be written; the previous checkpoint stays.
        SkillplanError
            If the learner does a wrong number of steps, or a back end fails.
        """
        plan, training = self._job.plan, self._training
        before = training.steps
        until = min(plan.steps, (before // STRIDE_STEPS + 1) * STRIDE_STEPS)
        episodes = training.advance(until - before)
        figures = training.figures()
        if training.steps != until or len(figures) != len(self._runs):
            raise SkillplanError(
                f"The solver {plan.solver!r} should continue to step {until} with "
                f"{len(self._runs)} runs, but is at step {training.steps} with {len(figures)}."
            )
        for index, log in enumerate(self._logs):
            own = [episode for episode in episodes if episode.run == index]
            log.note(until, own, figures[index])
        every = plan.checkpoint_steps
        if until // every > before // every or self.finished:
            self._keep()

    def conclude(self) -> GroupOutcome:
        """Write a checkpoint and the policies, and roll the policies out.

        Raises
        ------
        OptionError, BackEndError
            If a file cannot be written, or a back end fails.
        """
        if self._kept_steps != self._training.steps:
            self._keep()
        now = self._progress()
        if (now.steps, now.failures) != (self._reported.steps, self._reported.failures):
            # The program ended before it wrote the progress, or a failed run works again.
            self._write_progress()
        training, policies = self._training, {}
        for index, run in enumerate(self._runs):
            try:
                learned = training.learned(index)
            except ValueError:
                if index in training.failed:
                    continue  # its last network is unusable
                raise
            policies[run] = store_policies(
                self._job.plan, self._job.folder, run, learned, training.steps, self._judge
            )
        return GroupOutcome(policies)

    def close(self) -> None:
        """Release all files and processes."""
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
                f"{self._path / CHECKPOINT}: the solver {plan.solver!r} cannot continue from "
                f"it: {error} Delete it, and --resume begins its runs again."
            ) from None
        if training.steps != checkpoint.steps:
            raise SkillplanError(
                f"The solver {plan.solver!r} continues from step {training.steps}, not from step "
                f"{checkpoint.steps} of its checkpoint."
            )
        return training

    def _keep(self) -> None:
        """Flush the records to disk, then replace the checkpoint, then the progress."""
        lengths = {name: size for log in self._logs for name, size in log.sync().items()}
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
        names = dict.fromkeys(
            [*before.asked, *(name for checker in checkers for name in checker.queried)]
        )
        return GroupProgress(
            steps=max(self._kept_steps, 0),
            failures={self._runs[at]: why for at, why in sorted(self._training.failed.items())},
            wall_s=before.wall_s + here_s,
            elapsed_s=self._job.elapsed_s + here_s,
            checks=before.checks + sum(checker.checks for checker in checkers),
            hits=before.hits + sum(checker.hits for checker in checkers),
            executions=before.executions + sum(checker.executions for checker in checkers),
            asked={
                name: before.asked.get(name, 0) + sum(checker.queried[name] for checker in checkers)
                for name in names
            },
        )

    def _write_progress(self) -> None:
        self._reported = self._progress()
        write_progress(self._job.folder, self._job.group, self._reported)


def serve(
    job: GroupJob, cache: VerdictCache | None = None, overdue: Callable[[], bool] | None = None
) -> Callable[[Order], GroupAnswer]:
    """Return a function that carries out orders for a group.

    It returns errors of the group instead of raising them. The first order opens the files, the
    last one closes them. Parameters as for `GroupTraining`.
    """
    training: GroupTraining | None = None

    def carry_out(order: Order) -> GroupAnswer:
        nonlocal training
        try:
            if training is None:
                training = GroupTraining(job, cache, overdue)
            if order == "advance":
                if not training.finished:
                    training.advance()
                return training.report
            outcome = training.conclude()
            training.close()
            return outcome
        except BaseException as error:
            if training is not None:
                training.close()
            if ends_program(error) and not isinstance(error, SearchStopped):
                raise
            return _describe_failure(job, error)

    return carry_out


def _describe_failure(job: GroupJob, error: BaseException) -> GroupFailure:
    if isinstance(error, SearchStopped):
        return GroupFailure(job.group, str(error), stopped=True)
    if isinstance(error, OptionError | PluginError):
        return GroupFailure(job.group, str(error), fatal=True)
    if isinstance(error, SkillplanError):
        return GroupFailure(job.group, str(error), back_end=isinstance(error, BackEndError))
    if is_debugging():
        raise error
    name = job.plan.solver
    reason = f"The solver {name!r} failed: {describe_exception(load('solver', name), error)}"
    return GroupFailure(job.group, reason)


def _is_over(answer: GroupAnswer | None, job: GroupJob) -> bool:
    """Return True if a group has done all its steps, or cannot continue."""
    if isinstance(answer, GroupReport):
        return answer.steps >= job.plan.steps
    return answer is not None


def drive_groups(
    jobs: Sequence[GroupJob],
    processes: int,
    stopped: Callable[[], bool],
    on_report: Callable[[GroupReport], None],
    cache: VerdictCache | None = None,
    executor: Executor | None = None,
) -> Iterator[Ending]:
    """Train all groups, and yield the outcome of each as it ends.

    After a stop every group that has a checkpoint concludes with its current policies; a group
    without one is skipped.

    Parameters
    ----------
    processes
        Number of processes, >= 1; with 1 the groups run in this process.
    stopped
        Called after every stride; returns True to stop.
    on_report
        Called after every stride.
    cache
        Receives the verdicts of groups that run in this process. Every group still has a cache of
        its own, because its counts must not depend on where it runs.
    executor
        Runs the groups instead, with its own number of processes.

    Raises
    ------
    OptionError, SkillplanError
        If a file is damaged or cannot be written, or processes cannot be started.
    """
    if executor is None and processes > 1:
        executor = LocalProcesses(processes)
    endings = (
        _drive_here(jobs, stopped, on_report, cache)
        if executor is None
        else _WorkerPool(jobs, executor, stopped, on_report).endings()
    )
    for group, ending in endings:
        if isinstance(ending, GroupFailure) and ending.fatal:
            raise OptionError(ending.reason)
        yield group, ending


def _drive_here(
    jobs: Sequence[GroupJob],
    stopped: Callable[[], bool],
    on_report: Callable[[GroupReport], None],
    cache: VerdictCache | None,
) -> Iterator[Ending]:
    overdue = _Overdue(stopped)
    for job in jobs:
        if stopped() and not job.has_checkpoint:
            continue
        own = make_group_cache(job)
        carry_out = serve(job, own, overdue)
        answer: GroupAnswer | None = None
        while not stopped() and not _is_over(answer, job):
            answer = carry_out("advance")
            if isinstance(answer, GroupReport):
                on_report(answer)
        if not isinstance(answer, GroupFailure):
            answer = overdue.conclude(carry_out)
        elif answer.stopped and job.has_checkpoint:
            answer = overdue.conclude(serve(job, own))
        elif answer.stopped:
            continue
        assert not isinstance(answer, GroupReport)
        if cache is not None:
            cache.take_over(own)
        yield job.group, answer


class _Overdue:
    """True if a stop was requested more than `GRACE_S` ago; never while a group concludes."""

    def __init__(self, stopped: Callable[[], bool]) -> None:
        self._stopped = stopped
        self._requested_s: float | None = None
        self._concluding = False

    def __call__(self) -> bool:
        if self._concluding or not self._stopped():
            return False
        now_s = time.monotonic()
        if self._requested_s is None:
            self._requested_s = now_s
        return now_s > self._requested_s + GRACE_S

    def conclude(self, carry_out: Callable[[Order], GroupAnswer]) -> GroupAnswer:
        """Let a group conclude, even long after the stop."""
        self._concluding = True
        try:
            return carry_out("conclude")
        finally:
            self._concluding = False


@dataclass
class _Assignment:
    """The group of a worker, its current order, and how often the worker was started."""

    job: GroupJob
    order: Order
    starts: int = 1


class _WorkerPool:
    """Drives groups in the workers of an executor, one group per worker."""

    def __init__(
        self,
        jobs: Sequence[GroupJob],
        executor: Executor,
        stopped: Callable[[], bool],
        on_report: Callable[[GroupReport], None],
    ) -> None:
        self._waiting = list(jobs)
        self._executor = executor
        self._stopped = stopped
        self._on_report = on_report
        self._busy: dict[Worker, _Assignment] = {}
        # Groups with a checkpoint that no worker can conclude after a stop.
        self._left: list[GroupJob] = []
        self._stop_s: float | None = None

    def endings(self) -> Iterator[Ending]:
        """Yield the outcome of every group as it ends.

        A stop ends all workers within `GRACE_S`. Groups that have a checkpoint then conclude in
        this process.
        """
        try:
            while self._busy or self._waiting:
                if self._stop_s is None and self._stopped():
                    self._stop_s = time.monotonic()
                    self._leave(self._waiting)
                    self._waiting = []
                while self._waiting and len(self._busy) < self._executor.slots:
                    self._start(self._waiting.pop(0), "advance")
                for worker in self._executor.first_ready(self._busy):
                    ending = self._attend(worker)
                    if ending is not None:
                        yield ending
                if self._stop_s is not None and time.monotonic() > self._stop_s + GRACE_S:
                    self._give_up()
        finally:
            self._executor.close()
        for job in self._left:
            answer = serve(job.in_worker)("conclude")
            assert not isinstance(answer, GroupReport)
            yield job.group, answer

    def _start(self, job: GroupJob, order: Order, starts: int = 1) -> None:
        if self._executor.shares_files:
            worker = self._executor.start(serve, pack_content(job.in_worker, _PURPOSE), _PURPOSE)
        else:
            content = pack_content(SentGroup.of(job.in_worker), _PURPOSE)
            worker = self._executor.start(serve_sent, content, _PURPOSE)
        self._busy[worker] = _Assignment(job, order, starts)
        worker.take(order)

    def _attend(self, worker: Worker) -> Ending | None:
        """Read the answer of a worker and send its next order; return how its group ended."""
        answer = worker.answer()
        if answer is None:
            return None
        assigned = self._busy[worker]
        content = answer.content if isinstance(answer, Answer) else None
        if isinstance(content, SentAnswer):
            apply_changes(assigned.job.folder, content.changes)
            content = content.answer
        if isinstance(content, GroupReport):
            self._on_report(content)
            # Asked again: the stop may have come with this report.
            done = self._stopped() or _is_over(content, assigned.job)
            assigned.order = "conclude" if done else "advance"
            worker.take(assigned.order)
            return None
        del self._busy[worker]
        worker.end()
        group = assigned.job.group
        if isinstance(answer, Ended):
            if not answer.started and not answer.killed:
                raise worker.not_started()
            if self._stop_s is not None and assigned.job.has_checkpoint:
                self._leave([assigned.job])
                return None
            if assigned.starts < _STARTS:
                self._start(assigned.job, assigned.order, assigned.starts + 1)
                return None
            content = GroupFailure(group, f"its process was ended twice, by {answer.how}")
        assert isinstance(content, GroupOutcome | GroupFailure)
        return group, content

    def _give_up(self) -> None:
        """End workers that are still busy after a stop; their last checkpoints count."""
        for worker in self._busy:
            worker.end(gently=False)
        self._leave([assigned.job for assigned in self._busy.values()])
        self._busy.clear()

    def _leave(self, jobs: Sequence[GroupJob]) -> None:
        self._left += [job for job in jobs if job.has_checkpoint]


@dataclass(frozen=True, slots=True)
class SentGroup:
    """A group together with the files it continues from."""

    job: GroupJob
    files: tuple[FileChange, ...]

    @classmethod
    def of(cls, job: GroupJob) -> SentGroup:
        """Read the files of a group.

        Raises
        ------
        OSError
            If a file cannot be read.
        """
        return cls(job, tuple(read_files(job.folder, job.group, job.plan.groups[job.group])))


@dataclass(frozen=True, slots=True)
class SentAnswer:
    """An answer, and the file changes it caused in the order of writing."""

    answer: GroupAnswer
    changes: tuple[FileChange, ...]


def serve_sent(sent: SentGroup) -> Callable[[Order], SentAnswer]:
    """Return a function that carries out orders for a group in a scratch folder."""
    folder = Path(tempfile.mkdtemp(prefix="skillplan-training-")).resolve()
    apply_changes(folder, sent.files)
    job = replace(sent.job, folder=folder)
    serve_here = serve(job)
    watcher = FolderWatcher(folder, job.group, job.plan.groups[job.group], sent.files)

    def carry_out(order: Order) -> SentAnswer:
        answer = serve_here(order)
        return SentAnswer(answer, tuple(watcher.changes()))

    weakref.finalize(carry_out, shutil.rmtree, folder, ignore_errors=True)
    return carry_out
