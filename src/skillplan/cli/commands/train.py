"""``skillplan train``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from skillplan.cli.load import load_file, make_setup
from skillplan.cli.options import shared
from skillplan.cli.options.values import (
    Mode,
    check_options,
    count_option,
    option,
    positive_seconds,
    whole_number,
)

TRAINING = "Training"

EPILOG = (
    "The folder keeps everything: manifest.json has the settings, runs/NN/metrics.jsonl the "
    "episodes, runs/NN/policy.json and policy.safetensors the learned policy, and tensorboard/ the "
    "learning curves. Checkpoints are always complete: after Ctrl-C, SIGKILL or a full disk, the "
    "same command with --resume continues from the last one, bit for bit. 'skillplan evaluate' and "
    "'skillplan plot' read the folder."
)

_GENERATED = "generated:"


def parse_family(value: str) -> str:
    """Check the form of ``--family``: a number of layouts, or a family of random boards.

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
    """Length and start of a training."""

    runs: Annotated[
        int,
        count_option(
            "--runs",
            minimum=1,
            maximum=1_000,
            text="Number of runs, with seeds from --seed on. Groups of up to five runs share a "
            "process.",
            rich_help_panel=TRAINING,
        ),
    ] = 10
    steps: Annotated[
        int | None,
        count_option(
            "--steps",
            minimum=1,
            maximum=1_000_000_000,
            text="Environment steps per run, by default derived from the task. Overrides the "
            "learner's option steps.",
            rich_help_panel=TRAINING,
        ),
    ] = None
    checkpoint_steps: Annotated[
        int,
        count_option(
            "--checkpoint",
            minimum=1,
            maximum=1_000_000_000,
            text="Write a checkpoint every N environment steps, at the next multiple of 100.",
            rich_help_panel=TRAINING,
        ),
    ] = 1_000
    start: Annotated[
        str | None,
        option(
            "--from RUN",
            TRAINING,
            "Start from the networks of an earlier training of the same learner, on this or "
            "another task. Skills and features with the same name keep their weights.",
        ),
    ] = None


def command(
    ctx: typer.Context,
    task: shared.MaybeTaskFile = None,
    *,
    reading: shared.PartReading,
    amount: Amount,
    family: Annotated[
        str | None,
        option(
            "--family N|generated:A-B",
            TRAINING,
            "Train on N layouts drawn from the family of the task file, 1 to 10,000, with a "
            "new layout in every episode. Or, without TASK, train on random boards of A to B "
            "parts, such as 'skillplan generate assembly' writes: --solver relational then learns "
            "one policy for all boards.",
            parser=parse_family,
        ),
    ] = None,
    solver: Annotated[
        str,
        shared.solver_option(
            "Learner to train: dqn or ppo (skillplan-torch), or learned-model, which needs no "
            "network."
        ),
    ] = "dqn",
    preset: Annotated[
        str | None,
        option(
            "--preset NAME",
            TRAINING,
            "Set the learner's options by a preset; -O and --steps override it. dqn: "
            "moller-strict, the DQN of Moller et al. with skrl's defaults, or moller, a variant "
            "nearer to their results. 'skillplan plugins solver NAME' lists presets.",
        ),
    ] = None,
    seed: shared.Seed = 0,
    workers: shared.Workers,
    back_ends: shared.BackEnds,
    caching: shared.Caching,
    no_screening: shared.NoScreening = False,
    limits: shared.CommandLimits,
    proof_time_limit_s: Annotated[
        float,
        option(
            "--proof-time-limit S",
            shared.LIMITS,
            "Stop proving the optimum after S seconds.",
            parser=positive_seconds,
        ),
    ] = 60.0,
    out: Annotated[
        str | None,
        option(
            "--out DIR",
            shared.OUTPUT,
            "Folder of the runs; must be new or empty. Default: the first of "
            "runs/TASK-SOLVER-1, -2, ... that does not exist.",
        ),
    ] = None,
    resume: Annotated[
        bool,
        option(
            "--resume",
            shared.OUTPUT,
            "Continue the training in the folder of --out. A larger --steps extends it; "
            "schedules, such as that of exploration, stay at their final values.",
        ),
    ] = False,
    style: shared.Style = "table",
) -> int:
    """Train a learner on TASK with several seeds and compare the runs with the proved optimum.

    Prints the sequence of every run's policy, its cost and its deviation from the optimum.
    Ctrl-C and --time-limit keep the runs, print the results so far and show the command that
    resumes the training.

    --family generated:A-B trains one policy on random boards instead and tests it on other boards
    of the family; 'skillplan evaluate RUN --task FILE' tests it on any board.
    """
    from skillplan.errors import OptionError

    if family is not None and family.startswith(_GENERATED):
        inputs: dict[Mode, str] = {command: "a task file", train_on_boards: f"--family {family}"}
        check_options(ctx, train_on_boards, inputs)
        if task is not None:
            raise OptionError(f"{task}: no TASK goes with --family {family}.")
        return train_on_boards(family, solver, back_ends.options, seed, limits, out, style)
    deadline = limits.begin(graceful=True)
    if task is None:
        raise OptionError("Missing TASK: a task file, or --family generated:A-B without one.")
    if resume and out is None:
        raise OptionError("--resume needs --out DIR, the folder of the training to go on with.")
    from skillplan.cli.training_runs.training import TrainingSession
    from skillplan.training.training_plan import plan_training

    problem, part = load_file(task, reading, back_ends), reading.part
    setup = make_setup(
        back_ends,
        problem.part(part),
        (solver,),
        screening=not no_screening,
        executor=workers.executor,
    )
    plan = plan_training(
        problem,
        solver,
        setup,
        part=part,
        runs=amount.runs,
        steps=amount.steps,
        seed=seed,
        family=int(family or 0),
        checkpoint_steps=amount.checkpoint_steps,
        warm=not caching.no_cache,
        start=amount.start,
        preset=preset,
    )
    session = TrainingSession(
        problem, plan, part, reading.settings(), workers.jobs, proof_time_limit_s, deadline, style
    )
    return session.resume(out) if resume and out is not None else session.begin(out)


def train_on_boards(
    family: str,
    solver: str,
    options: list[str],
    seed: int,
    limits: shared.CommandLimits,
    out: str | None,
    style: shared.Style,
) -> int:
    """Train one policy on random boards."""
    from skillplan.cli.options.values import parse_options
    from skillplan.cli.training_runs.training import train_family_policy
    from skillplan.errors import OptionError
    from skillplan.training.family_training import FamilyPlan, GeneratedFamily

    deadline = limits.begin(graceful=True)
    boards = GeneratedFamily.parse(family)
    parsed = parse_options(options, solver)
    for plugin in set(parsed) - {solver}:
        raise OptionError(f"-O {plugin}.…: {plugin} takes no part in a training on {boards}.")
    plan = FamilyPlan(boards, solver, dict(parsed.get(solver, {})), seed)
    return train_family_policy(plan, out, deadline.share_s(), style)
