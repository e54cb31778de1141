"""``skillplan train``."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from typing import Annotated

import typer

from skillplan.cli.options.limits import time_limit_option
from skillplan.cli.options.panels import OUTPUT, SOLVER
from skillplan.cli.options.shared import BackEnds, Caching, PartReading
from skillplan.cli.options.single import (
    ExecutorName,
    NoScreening,
    Seed,
    Style,
    TaskFile,
    solver_option,
)
from skillplan.cli.options.values import count_option
from skillplan.cli.writing import tell

TRAINING = "Training"

EPILOG = (
    "Everything is kept in a folder: manifest.json says what was requested, runs/NN/metrics.jsonl "
    "what happened, runs/NN/policy.json and policy.safetensors what was learned, tensorboard/ the "
    "same as curves. Checkpoints are whole or not at all: after Ctrl-C, SIGKILL or a full disk the "
    "same command with --resume goes on from the last one, bit for bit. 'skillplan evaluate' and "
    "'skillplan plot' read the folder."
)


@dataclass(frozen=True, slots=True)
class Amount:
    """How much is trained.

    Parameters
    ----------
    runs
        How many runs, >= 1.
    steps
        Environment steps of each; None for the learner's default.
    family
        How many layouts are learned on; None for the task's own.
    checkpoint_steps
        After how many environment steps a checkpoint is kept.
    """

    runs: Annotated[
        int,
        count_option(
            "--runs",
            least=1,
            most=1_000,
            text="How many runs, with the seeds from --seed on; up to five learn side by side.",
            rich_help_panel=TRAINING,
        ),
    ] = 10
    steps: Annotated[
        int | None,
        count_option(
            "--steps",
            least=1,
            most=1_000_000_000,
            text="Environment steps of every run; goes before the learner's option steps, which "
            "is the default.",
            rich_help_panel=TRAINING,
        ),
    ] = None
    family: Annotated[
        int | None,
        count_option(
            "--family",
            least=1,
            most=10_000,
            text="Learn on N layouts drawn from the task file's family, another one in every "
            "episode, instead of on its own.",
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


def command(
    task: TaskFile,
    reading: PartReading,
    amount: Amount,
    *,
    solver: Annotated[str, solver_option("Which learner is trained.")] = "dqn",
    seed: Seed = 0,
    jobs: Annotated[
        int,
        count_option(
            "--jobs",
            least=1,
            most=64,
            text="In how many processes groups of five runs learn; nothing that is learned "
            "depends on it.",
            rich_help_panel=SOLVER,
        ),
    ] = 1,
    executor: ExecutorName = "local",
    back_ends: BackEnds,
    caching: Caching,
    no_screening: NoScreening = False,
    time_limit_s: Annotated[
        float,
        time_limit_option("Give up proving the optimum after S seconds."),
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
            help="Go on with the training in the folder of --out; with a larger --steps extend it, "
            "where its option schedule_steps is set.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    style: Style = "table",
) -> int:
    """Train a learner on TASK, several runs from several seeds, and hold them to the optimum.

    Shows for every run the sequence that its policy takes, what it costs and how far that is
    from the proved optimum. Ctrl-C keeps the runs as they stand, prints what there is and says
    how to go on.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.training_runs.display import displaying
    from skillplan.errors import OptionError, exit_code
    from skillplan.training.trainer import Trainer, next_folder
    from skillplan.training.training_folder import TrainingFolder
    from skillplan.training.training_plan import plan_training
    from skillplan.views.tables.learning.training import training_tables

    if resume and out is None:
        raise OptionError("--resume needs --out DIR, the folder of the training to go on with.")
    part = reading.part
    problem = reading.problem(task, back_ends)
    setup = back_ends.setup(
        problem.part(part), (solver,), screening=not no_screening, executor=executor
    )
    plan = plan_training(
        problem,
        solver,
        setup,
        part=part,
        runs=amount.runs,
        steps=amount.steps,
        seed=seed,
        family=amount.family or 0,
        checkpoint_steps=amount.checkpoint_steps,
        warm=not caching.no_cache,
    )
    words = list(sys.argv[1:])
    if out is None:
        out = str(next_folder(plan.task.name, solver))
        words += ["--out", out]
        tell(f"writing to {out}")
    with TrainingFolder(
        out, plan, problem, part=part, changes=reading.settings(), resume=resume, command=words
    ) as folder:
        trainer = Trainer(plan, folder, jobs=jobs, time_limit_s=time_limit_s)
        with displaying(plan, trainer.interrupt) as display:
            trainer.on_report, trainer.on_optimum = display.report, display.proved
            result = trainer.train()
    all_failed = len(result.failed) == len(result.outcomes)
    code = exit_code(
        interrupted=trainer.interrupted,
        back_end_failed=all_failed and trainer.back_end_failed,
        solved=bool(result.completed),
    )
    emit(style, result.document(), training_tables(result), failed=code != 0)
    if result.interrupted:
        again = shlex.join(["skillplan", *(word for word in words if word != "--resume")])
        tell(f"interrupted; go on with: {again} --resume")
    return code
