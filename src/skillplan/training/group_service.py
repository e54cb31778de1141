"""What drives one group of runs by orders, and says what became of them: here or in a worker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import (
    BackEndError,
    OptionError,
    PluginError,
    SearchStopped,
    SkillplanError,
)
from skillplan.pipeline.registry import load
from skillplan.plugins.blame import debugging, ends_program, raised_by
from skillplan.records.training.run_folder import CHECKPOINT, group_path
from skillplan.training.group_job import GroupJob, GroupOutcome, GroupReport
from skillplan.training.group_training import GroupTraining
from skillplan.training.sent_group import SentAnswer, SentGroup, serving_sent

Order = Literal["advance", "conclude"]


@dataclass(frozen=True, slots=True)
class GroupFailure:
    """Why the runs of a group cannot go on.

    Parameters
    ----------
    group
        Number of the group.
    reason
        In words.
    fatal
        Whether no other group can go on either: something cannot be written, or is damaged.
    back_end
        Whether a back end has failed.
    stopped
        Whether it was merely stopped, and lost the work in progress.
    """

    group: int
    reason: str
    fatal: bool = False
    back_end: bool = False
    stopped: bool = False


GroupAnswer = GroupReport | GroupOutcome | GroupFailure
Ending = tuple[int, GroupOutcome | GroupFailure]


def serve(
    job: GroupJob,
    cache: VerdictCache | None = None,
    overdue: Callable[[], bool] | None = None,
) -> Callable[[Order], GroupAnswer]:
    """Return what does strides of a group, and in the end hands over what was learned.

    Nothing that goes wrong in the group is raised: it is returned. Files are opened by the first
    order and closed by the last.

    Parameters
    ----------
    job, cache, overdue
        As for `GroupTraining`.
    """
    training: GroupTraining | None = None

    def work(order: Order) -> GroupAnswer:
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
            return _failure(job, error)

    return work


def serve_sent(sent: SentGroup) -> Callable[[Order], SentAnswer[GroupAnswer]]:
    """Return what does strides of a group where the folder of the training is not at hand."""
    return serving_sent(sent, serve)


def over(outcome: GroupAnswer | None, job: GroupJob) -> bool:
    """Return whether a group has done all its steps, or nothing more can come of it."""
    if isinstance(outcome, GroupReport):
        return outcome.steps >= job.plan.steps
    return outcome is not None


def begun(job: GroupJob) -> bool:
    """Return whether a group has something to hand over."""
    return (group_path(job.folder, job.group) / CHECKPOINT).exists()


def _failure(job: GroupJob, error: BaseException) -> GroupFailure:
    if isinstance(error, SearchStopped):
        return GroupFailure(job.group, str(error), stopped=True)
    if isinstance(error, OptionError | PluginError):
        return GroupFailure(job.group, str(error), fatal=True)
    if isinstance(error, SkillplanError):
        return GroupFailure(job.group, str(error), back_end=isinstance(error, BackEndError))
    if debugging():
        raise error
    name = job.plan.solver
    words = f"The solver {name!r} failed: {raised_by(load('solver', name), error)}"
    return GroupFailure(job.group, words)
