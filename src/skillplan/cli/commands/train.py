"""``skillplan train``."""

from __future__ import annotations

import shlex
import sys

import click

from skillplan.cli.options import (
    PluginName,
    PositiveSeconds,
    asked,
    back_end_options,
    format_option,
    make_setup,
    no_cache_option,
    part_option,
    seed_option,
    set_option,
    settings,
    task_argument,
)

EPILOG = (
    "Everything is kept in a folder: manifest.json says what was asked, runs/NN/metrics.jsonl what "
    "happened, runs/NN/policy.json and policy.safetensors what was learned, tensorboard/ the same "
    "as curves. Checkpoints are whole or not at all: after Ctrl-C, SIGKILL or a full disk the same "
    "command with --resume goes on from the last one, bit for bit. 'skillplan evaluate' and "
    "'skillplan plot' read the folder."
)


@click.command("train", epilog=EPILOG)
@task_argument
@click.option(
    "--solver",
    type=PluginName("solver"),
    metavar="NAME",
    default="dqn",
    show_default=True,
    help="Which learner is trained.",
)
@click.option(
    "--runs",
    type=click.IntRange(1, 1_000),
    default=10,
    show_default=True,
    metavar="N",
    help="How many runs, with the seeds from --seed on; up to five learn side by side.",
)
@click.option(
    "--steps",
    type=click.IntRange(1, 1_000_000_000),
    metavar="N",
    help="Environment steps of every run; goes before the learner's option steps, which is the "
    "default.",
)
@click.option(
    "--family",
    type=click.IntRange(1, 10_000),
    metavar="N",
    help="Learn on N layouts drawn from the task file's family, another one in every episode, "
    "instead of on its own.",
)
@back_end_options
@set_option
@part_option
@seed_option
@click.option(
    "--jobs",
    type=click.IntRange(1, 64),
    default=1,
    show_default=True,
    metavar="N",
    help="In how many processes groups of five runs learn; nothing that is learned depends on it.",
)
@click.option(
    "--checkpoint",
    "checkpoint_steps",
    type=click.IntRange(1, 1_000_000_000),
    default=1_000,
    show_default=True,
    metavar="N",
    help="Keep a checkpoint every N environment steps, in hundreds.",
)
@click.option(
    "--time-limit",
    "time_limit_s",
    type=PositiveSeconds(),
    metavar="S",
    default=60.0,
    show_default=True,
    help="Give up proving the optimum after S seconds.",
)
@no_cache_option
@click.option(
    "--out",
    metavar="DIR",
    help="The folder of the runs, a new one; default: the first of runs/TASK-SOLVER-1, -2, ... "
    "that is not there.",
)
@click.option("--resume", is_flag=True, help="Go on with the training in the folder of --out.")
@format_option
def command(
    task: str,
    solver: str,
    runs: int,
    steps: int | None,
    family: int | None,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    seed: int,
    jobs: int,
    checkpoint_steps: int,
    time_limit_s: float,
    no_cache: bool,
    out: str | None,
    resume: bool,
    style: str,
) -> int:
    """Train a learner on TASK, several runs from several seeds, and hold them to the optimum.

    Shows for every run the sequence that its policy takes, what it costs and how far that is
    from the proved optimum. Ctrl-C keeps the runs as they stand, prints what there is and says
    how to go on.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.training_display import displaying
    from skillplan.errors import (
        EXIT_BACK_END,
        EXIT_INTERRUPTED,
        EXIT_NO_PLAN,
        EXIT_SOLVED,
        OptionError,
    )
    from skillplan.pipeline.setup import load_problem
    from skillplan.training.trainer import Trainer, next_folder
    from skillplan.training.training_folder import TrainingFolder
    from skillplan.training.training_plan import plan_training
    from skillplan.views.tables.training import training_tables

    if resume and out is None:
        raise OptionError("--resume needs --out DIR, the folder of the training to go on with.")
    changed = settings(changes)
    problem = load_problem(task, asked(physics, collision), changed)
    setup = make_setup(physics, collision, options, (solver,))(problem.part(part))
    plan = plan_training(
        problem,
        solver,
        setup,
        part=part,
        runs=runs,
        steps=steps,
        seed=seed,
        family=family or 0,
        checkpoint_steps=checkpoint_steps,
        warm=not no_cache,
    )
    words = list(sys.argv[1:])
    if out is None:
        out = str(next_folder(plan.task.name, solver))
        words += ["--out", out]
        print(f"writing to {out}", file=sys.stderr)
    with TrainingFolder(
        out, plan, problem, part=part, changes=changed, resume=resume, command=words
    ) as folder:
        trainer = Trainer(plan, folder, jobs=jobs, time_limit_s=time_limit_s)
        with displaying(plan, trainer.interrupt) as display:
            trainer.on_report, trainer.on_optimum = display.report, display.proved
            result = trainer.train()
    code = EXIT_SOLVED
    if trainer.interrupted:
        code = EXIT_INTERRUPTED
    elif len(result.failed) == len(result.outcomes) and trainer.back_end_failed:
        code = EXIT_BACK_END
    elif not result.completed:
        code = EXIT_NO_PLAN
    emit(style, result.document(), training_tables(result), failed=code != EXIT_SOLVED)
    if result.interrupted:
        again = shlex.join(["skillplan", *(word for word in words if word != "--resume")])
        print(f"interrupted; go on with: {again} --resume", file=sys.stderr)
    return code
