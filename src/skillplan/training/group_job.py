"""What passes between a training and the groups of its runs: orders, reports, how far they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from skillplan.files.atomic_file import write_whole
from skillplan.files.folder import make_folder
from skillplan.files.json_file import json_text
from skillplan.records import schemas
from skillplan.records.training.outcome import GreedyRollOut
from skillplan.records.training.run_folder import (
    PROGRESS,
    GroupProgress,
    group_path,
)
from skillplan.training.run_log import writing
from skillplan.training.training_plan import TrainingPlan

NO_PROGRESS = GroupProgress(
    steps=0, failures={}, wall_s=0.0, elapsed_s=0.0, checks=0, hits=0, executions=0, asked={}
)
"""Of a group that has kept nothing yet."""


@dataclass(frozen=True)
class GroupJob:
    """Runs to be driven; can be sent to another process.

    Parameters
    ----------
    plan
        What is trained.
    folder
        Of all runs.
    group
        Number of the group.
    elapsed_s
        How long the training had taken before this program [s].
    """

    plan: TrainingPlan
    folder: Path
    group: int
    elapsed_s: float = 0.0


@dataclass(frozen=True, slots=True)
class GroupReport:
    """How runs that learn side by side stand, for people who wait.

    Parameters
    ----------
    group
        Number of the group.
    steps
        Environment steps done in every run.
    episodes
        How many have ended, in all runs.
    recent
        Successes and number of the last episodes of every run, summed.
    best_cost
        The least that an episode has cost; None where none succeeded.
    executions
        Checks that expensive back ends have made in this group so far.
    """

    group: int
    steps: int
    episodes: int
    recent: tuple[int, int]
    best_cost: float | None
    executions: int


@dataclass(frozen=True, slots=True)
class GroupOutcome:
    """What runs have learned, followed greedily.

    Parameters
    ----------
    policies
        By run the best policy, None where none ever completed the task, and the last.
    """

    policies: dict[int, tuple[GreedyRollOut | None, GreedyRollOut]]


def write_progress(folder: Path, group: int, progress: GroupProgress) -> None:
    """Write how far a group has come.

    Raises
    ------
    OptionError
        If it cannot be written.
    """
    with writing(folder, f"groups/{group}/{PROGRESS}"):
        make_folder(group_path(folder, group), within=folder)
        text = json_text(schemas.RUN_GROUP, progress)
        write_whole(group_path(folder, group) / PROGRESS, text, within=folder)


def failed_progress(
    before: GroupProgress | None, runs: Sequence[int], reason: str
) -> GroupProgress:
    """Return the progress of a group none of whose runs can go on."""
    return (before or NO_PROGRESS).model_copy(update={"failures": dict.fromkeys(runs, reason)})
