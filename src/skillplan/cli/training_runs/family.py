"""``skillplan train --family generated:A-B``, and ``skillplan evaluate`` of what it has learned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.pipeline.setup import Setup
    from skillplan.task.skill import Skill
    from skillplan.task.task import Task


@dataclass(frozen=True, slots=True)
class Ordered:
    """What the command line wants to be learned.

    Parameters
    ----------
    family, solver, options, seed
        As given; options in the form ``KEY=VALUE``.
    out
        The folder; None for the next free one.
    time_limit_s
        Time limit of the training [s], > 0; None for none.
    """

    family: str
    solver: str
    options: Sequence[str]
    seed: int
    out: str | None
    time_limit_s: float | None = None


def train_on_boards(ordered: Ordered, style: str) -> int:
    """Learn one policy on boards at random, print what became of it, and return the exit code.

    Parameters
    ----------
    ordered
        What is learned.
    style
        How to print.

    Raises
    ------
    OptionError
        If something does not fit, or cannot be written.
    PluginError
        If the solver is unknown or broken.
    """
    from skillplan.cli.counting import counting
    from skillplan.cli.interruption import heeding
    from skillplan.cli.options.values import parse_options
    from skillplan.cli.output import emit
    from skillplan.cli.writing import tell
    from skillplan.errors import OptionError, exit_code
    from skillplan.records import schemas
    from skillplan.solvers.stop import Stop
    from skillplan.training.family_training import (
        FamilyFolder,
        FamilyPlan,
        GeneratedFamily,
        train_family,
    )
    from skillplan.training.trainer import next_folder
    from skillplan.views.tables.training import family_table

    family = GeneratedFamily.parse(ordered.family)
    parsed = parse_options(list(ordered.options), ordered.solver)
    for other in set(parsed) - {ordered.solver}:
        raise OptionError(f"-O {other}.…: {other} takes no part in a training on {family}.")
    plan = FamilyPlan(family, ordered.solver, dict(parsed.get(ordered.solver, {})), ordered.seed)
    stop = Stop(time_limit_s=ordered.time_limit_s)
    steps = plan.learner(stop).steps
    out = ordered.out
    if out is None:
        out = str(next_folder(str(family).replace(":", "-"), ordered.solver))
        tell(f"writing to {out}")
    with (
        FamilyFolder(out) as folder,
        counting("learning in rounds", steps) as count,
        heeding(stop.interrupt),
    ):
        learned = train_family(plan, folder, stop, count.one_more)
    interrupted = stop.interrupted
    complete = learned.trial is not None and learned.trial.completed == learned.trial.boards
    document = {
        "schema": schemas.RELATIONAL_POLICY,
        **learned.model_dump(mode="json"),
    }
    emit(style, document, [family_table(learned, out)], failed=not complete)
    return exit_code(interrupted=interrupted, solved=complete)


def carried_skills(folder: str, task: Task, setup: Setup) -> Sequence[Skill]:
    """Return the skills that the policy in a folder takes greedily on a task.

    Raises
    ------
    OptionError
        If the policy cannot be read, or cannot act on the task.
    PluginError
        If the solver that learned the policy is not installed.
    BackEndError
        If a back end fails.
    """
    from pathlib import Path

    from skillplan.training.family_training import followed, read_policy

    skills, _ = followed(read_policy(Path(folder)).policy, task, setup)
    return skills
