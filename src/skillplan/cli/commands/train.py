"""``skillplan train``."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.options.fit import refuse_given
from skillplan.cli.options.limits import LIMITS, CommandLimits
from skillplan.cli.options.panels import OUTPUT
from skillplan.cli.options.shared import BackEnds, Caching, PartReading, Workers
from skillplan.cli.options.single import (
    MaybeTaskFile,
    NoScreening,
    Seed,
    Style,
    solver_option,
)
from skillplan.cli.options.values import count_option, positive_seconds, whole_number
from skillplan.cli.writing import tell

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.cli.deadline import Deadline
    from skillplan.cli.training_runs.family import Ordered
    from skillplan.records.training.result import TrainingResult
    from skillplan.training.trainer import Trainer

TRAINING = "Training"

EPILOG = (
    "Everything is kept in a folder: manifest.json says what was requested, runs/NN/metrics.jsonl "
    "what happened, runs/NN/policy.json and policy.safetensors what was learned, tensorboard/ the "
    "same as curves. Checkpoints are whole or not at all: after Ctrl-C, SIGKILL or a full disk the "
    "same command with --resume goes on from the last one, bit for bit. 'skillplan evaluate' and "
    "'skillplan plot' read the folder."
)

_GENERATED = "generated:"
# What a training on boards at random has no use for.
_OF_TASK = (
    *("part", "changes", "runs", "steps", "checkpoint_steps", "jobs", "executor", "physics"),
    *("collision", "no_cache", "no_screening", "proof_time_limit_s", "resume", "start"),
)


def family_words(value: str) -> str:
    """Return a number of layouts as text, or a family of boards at random.

    Raises
    ------
    typer.BadParameter
        If it is neither.
    """
    if value.startswith(_GENERATED):
        return value
    if not value.lstrip("+-").isdecimal():
        raise typer.BadParameter(
            f"{value!r} is neither a whole number nor a family such as generated:6-12."
        )
    return str(whole_number(1, 10_000)(value))


@dataclass(frozen=True, slots=True)
class Amount:
    """How much is trained.

    Parameters
    ----------
    runs
        How many runs, >= 1.
    steps
        Environment steps of each; None for the learner's option, or else what is derived.
    family
        How many layouts are learned on, or a family of boards at random; None for the task's own.
    checkpoint_steps
        After how many environment steps a checkpoint is kept.
    start
        Folder of a training whose networks the runs begin with; None for drawn ones.
    """

    runs: Annotated[
        int,
        count_option(
            "--runs",
            least=1,
            most=1_000,
            text="How many runs, with the seeds from --seed on; up to five learn side by side, and "
            "two or more as two groups at least.",
            rich_help_panel=TRAINING,
        ),
    ] = 10
    steps: Annotated[
        int | None,
        count_option(
            "--steps",
            least=1,
            most=1_000_000_000,
            text="Environment steps of every run; goes before the learner's option steps. Without "
            "either, the number is derived from the task.",
            rich_help_panel=TRAINING,
        ),
    ] = None
    family: Annotated[
        str | None,
        typer.Option(
            "--family",
            parser=family_words,
            metavar="N|generated:A-B",
            help="Learn on N layouts drawn from the task file's family, 1 to 10,000, another one "
            "in every episode, instead of on its own. Or, without a TASK, on boards at random of "
            "A to B parts, as 'skillplan generate assembly' writes them: one policy for any board, "
            "which --solver relational learns.",
            rich_help_panel=TRAINING,
        ),
    ] = None
    checkpoint_steps: Annotated[
        int,
        count_option(
            "--checkpoint",
            least=1,
            most=1_000_000_000,
            text="Keep a checkpoint every N environment steps, in hundreds.",
            rich_help_panel=TRAINING,
        ),
    ] = 1_000
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="RUN",
            help="Begin with the networks of an earlier training of the same learner, also on "
            "another task: skills and features of the same name are taken over.",
            rich_help_panel=TRAINING,
        ),
    ] = None


def command(
    ctx: typer.Context,
    task: MaybeTaskFile = None,
    *,
    reading: PartReading,
    amount: Amount,
    solver: Annotated[
        str,
        solver_option(
            "Learner to train; dqn and ppo plan their episodes by search in a learned model "
            "(model-based planning), unless -O dqn.planning=false."
        ),
    ] = "dqn",
    seed: Seed = 0,
    workers: Workers,
    back_ends: BackEnds,
    caching: Caching,
    no_screening: NoScreening = False,
    limits: CommandLimits,
    proof_time_limit_s: Annotated[
        float,
        typer.Option(
            "--proof-time-limit",
            parser=positive_seconds,
            metavar="S",
            help="Stop proving the optimum after S seconds.",
            rich_help_panel=LIMITS,
        ),
    ] = 60.0,
    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="The folder of the runs, a new one; default: the first of runs/TASK-SOLVER-1, "
            "-2, ... that is not there.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            help="Go on with the training in the folder of --out; with a larger --steps extend it: "
            "what changed over its steps, such as exploration, stays as it was at their end.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    style: Style = "table",
) -> int:
    """Train a learner on TASK, several runs from several seeds, and hold them to the optimum.

    With --family generated:A-B one policy learns on boards at random instead, is tried on others
    of that family, and 'skillplan evaluate RUN --task FILE' tries it on any.

    Shows for every run the sequence that its policy takes, what it costs and how far that is
    from the proved optimum. Ctrl-C and --time-limit keep the runs as they stand, print what there
    is and say how to go on.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.training_runs.display import derived_words, displaying
    from skillplan.errors import OptionError
    from skillplan.training.trainer import Trainer, next_folder
    from skillplan.training.training_folder import TrainingFolder
    from skillplan.training.training_plan import plan_training
    from skillplan.views.tables.training import training_tables

    deadline = limits.begin(graceful=True)
    if amount.family is not None and amount.family.startswith(_GENERATED):
        from skillplan.cli.training_runs.family import Ordered

        refuse_given(ctx, _OF_TASK, f"does not go with --family {amount.family}")
        ordered = (amount.family, solver, back_ends.options, seed, out, deadline.share_s())
        return _train_on_boards(task, Ordered(*ordered), style)
    if task is None:
        raise OptionError("Missing TASK: a task file, or --family generated:A-B without one.")
    if resume and out is None:
        raise OptionError("--resume needs --out DIR, the folder of the training to go on with.")
    problem, part = reading.problem(task, back_ends), reading.part
    setup = back_ends.setup(
        problem.part(part), (solver,), screening=not no_screening, executor=workers.executor
    )
    plan = plan_training(
        problem,
        solver,
        setup,
        part=part,
        runs=amount.runs,
        steps=amount.steps,
        seed=seed,
        family=int(amount.family or 0),
        checkpoint_steps=amount.checkpoint_steps,
        warm=not caching.no_cache,
        start=amount.start,
    )
    words = list(sys.argv[1:])
    if out is None:
        out = str(next_folder(plan.task.name, solver))
        words += ["--out", out]
        tell(f"writing to {out}")
    with TrainingFolder(
        out, plan, problem, part=part, changes=reading.settings(), resume=resume, command=words
    ) as folder:
        if folder.extended:
            tell(folder.extended)
        if not resume:
            tell(derived_words(plan))
        trainer = Trainer(folder.plan, folder, jobs=workers.jobs, time_limit_s=proof_time_limit_s)
        with (
            displaying(folder.plan, trainer.interrupt) as display,
            deadline.calling(trainer.end_in_time),
        ):
            trainer.on_report, trainer.on_optimum = display.report, display.proved
            result = trainer.train()
    code = _exit_code(trainer, result)
    emit(style, result.document(), training_tables(result), failed=code != 0)
    if result.interrupted:
        _tell_how_to_go_on(words, deadline, trainer.timed_out)
    return code


def _train_on_boards(task: str | None, ordered: Ordered, style: str) -> int:
    from skillplan.cli.training_runs.family import train_on_boards
    from skillplan.errors import OptionError

    if task is not None:
        raise OptionError(f"{task}: no TASK goes with --family {ordered.family}.")
    return train_on_boards(ordered, style)


def _tell_how_to_go_on(words: Sequence[str], deadline: Deadline, timed_out: bool) -> None:
    again = shlex.join(["skillplan", *(word for word in words if word != "--resume")])
    ended = f"ended by --time-limit {deadline.time_limit_s:g}" if timed_out else "interrupted"
    tell(f"{ended}; go on with: {again} --resume")


def _exit_code(trainer: Trainer, result: TrainingResult) -> int:
    """Return the exit code: whether any run completes the task."""
    from skillplan.errors import exit_code

    all_failed = len(result.failed) == len(result.outcomes)
    return exit_code(
        interrupted=trainer.interrupted and not trainer.timed_out,
        back_end_failed=all_failed and trainer.back_end_failed,
        solved=bool(result.completed),
    )
