"""``skillplan evaluate``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Annotated

import typer

from skillplan.cli.completion import task_files
from skillplan.cli.option_fit import refuse_given
from skillplan.cli.option_values import count_option, positive_number
from skillplan.cli.options import (
    BackEnds,
    Checking,
    PartReading,
    Seed,
    Style,
    TimeLimit,
)

OF_TASK, OF_RUN = "Of a task: what is replayed", "Of a run"
# What a task file takes and a folder of runs does not, and the other way round.
_TASK_ONLY = ("sequence", "policy_file", "start", "part")
_RUN_ONLY = ("task_file", "changed_task", "episodes", "temperature", "seed", "layouts")


@dataclass(frozen=True, slots=True)
class Replayed:
    """What is replayed on a task, and from where.

    Parameters
    ----------
    sequence
        Action numbers or skill names, with commas.
    policy_file
        A policies.json to follow instead.
    start
        Where to start, if not where the task does.
    """

    sequence: Annotated[
        str | None,
        typer.Option(
            "--sequence",
            metavar="0,1,4,...",
            help="Action numbers or skill names, separated by commas.",
            rich_help_panel=OF_TASK,
        ),
    ] = None
    policy_file: Annotated[
        str | None,
        typer.Option(
            "--policy",
            metavar="FILE",
            help="Follow the policy of a policies.json instead, without planning anew.",
            rich_help_panel=OF_TASK,
        ),
    ] = None
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="PLACE",
            help="Start elsewhere: a place such as C20, or facts separated by commas.",
            rich_help_panel=OF_TASK,
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class RollOuts:
    """How the policies of training runs are tried.

    Parameters
    ----------
    task_file
        Another file than the one that was learned; None for the same.
    changed_task
        Whether the task may have changed since.
    episodes
        How many roll-outs are drawn of every run, >= 1.
    temperature
        What scores are divided by, > 0.
    layouts
        How many unseen layouts of the family are tried; None for as many as suit the runs.
    """

    task_file: Annotated[
        str | None,
        typer.Option(
            "--task",
            metavar="FILE",
            autocompletion=task_files,
            help="The task file, where it is not to be the one that train was given.",
            rich_help_panel=OF_RUN,
        ),
    ] = None
    changed_task: Annotated[
        bool,
        typer.Option(
            "--changed-task",
            help="Evaluate even where the task is another one than was learned.",
            rich_help_panel=OF_RUN,
        ),
    ] = False
    episodes: Annotated[
        int,
        count_option(
            "--episodes",
            least=1,
            most=1_000_000,
            text="Roll-outs of every run, each action drawn by its score.",
            rich_help_panel=OF_RUN,
        ),
    ] = 100
    temperature: Annotated[
        float,
        typer.Option(
            "--temperature",
            parser=positive_number(),
            metavar="T",
            help="What scores are divided by; the lower, the greedier.",
            rich_help_panel=OF_RUN,
        ),
    ] = 0.05
    layouts: Annotated[
        int | None,
        count_option(
            "--layouts",
            least=0,
            most=10_000,
            text="Also try N layouts of the task file's family that no run has seen; default: 20 "
            "where a family was learned, else none.",
            rich_help_panel=OF_RUN,
        ),
    ] = None


def command(
    ctx: typer.Context,
    task: Annotated[
        str,
        typer.Argument(
            metavar="TASK|RUN",
            autocompletion=task_files,
            help="A task file, or a folder that train has written.",
            show_default=False,
        ),
    ],
    replayed: Replayed,
    roll_outs: RollOuts,
    reading: PartReading,
    *,
    seed: Seed = 0,
    back_ends: BackEnds,
    checking: Checking,
    time_limit_s: TimeLimit = 10.0,
    style: Style = "table",
) -> int:
    """Replay a sequence of skills on TASK, follow a stored policy, or try those of a RUN.

    Says whether it is feasible and complete, what it costs, how far that is from the proved
    optimum, or how far it may be at most, and otherwise which condition fails where. The time
    limit is for proving the optimum.

    RUN is a folder that train has written: the policy of every run is followed greedily and by
    drawn actions, beside chance alone. Back ends are those of the training.
    """
    if os.path.isdir(task):
        from skillplan.cli.run_folder_evaluation import Wanted, evaluate_run_folder
        from skillplan.records.training.run_folder import RunFolder

        folder = RunFolder(task)
        refuse_given(ctx, _TASK_ONLY, "is for a task file, not for a folder of runs")
        wanted = Wanted(roll_outs, reading, back_ends, checking, seed, time_limit_s)
        return evaluate_run_folder(folder, wanted, style)
    refuse_given(ctx, _RUN_ONLY, "is for a folder of runs, not for a task file")
    from contextlib import closing

    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import showing_checks, stoppable
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_NO_PLAN, EXIT_SOLVED, OptionError
    from skillplan.model.policy_value import roll_out
    from skillplan.model.replay import replay
    from skillplan.pipeline.run import DEFAULT_SOLVER, make_model, solve
    from skillplan.records.evaluation import Evaluation
    from skillplan.records.policy_file import read_policy, start_state
    from skillplan.solvers.solution import Plan

    loaded = reading.task(task, back_ends)
    setup = back_ends.setup(loaded, (DEFAULT_SOLVER,))
    sequence, policy_file, start = replayed.sequence, replayed.policy_file, replayed.start
    if (sequence is None) == (policy_file is None):
        raise OptionError("Give either --sequence or --policy.")
    stored = None if policy_file is None else read_policy(policy_file, loaded)
    if start is not None:
        try:
            initial = start_state(loaded, start)
        except OptionError as error:
            raise OptionError(f"--from {start}: {error}") from None
        loaded = loaded.replace(initial=initial, sha256=loaded.sha256)
    cache = checking.cache() or VerdictCache()
    with showing_checks("replaying") as on_check:
        model = make_model(loaded, setup, cache, jobs=checking.jobs, on_check=on_check)
        with closing(model.feasibility):
            if stored is not None:
                skills = tuple(roll_out(model, stored.policy.get))
            else:
                skills = loaded.parse_sequence(sequence or "")
            walked = replay(model, skills)
    best = None
    if walked.complete and loaded.deterministic:
        with stoppable(time_limit_s, label="proving the optimum") as stop:
            known = Plan(tuple(skill.name for skill in skills), walked.cost)
            best = solve(
                loaded,
                DEFAULT_SOLVER,
                setup,
                stop=stop,
                cache=cache,
                jobs=checking.jobs,
                start=known,
            )
    evaluation = Evaluation(loaded, skills, walked, best)
    emit(style, evaluation.document(), [evaluation.table()], failed=not walked.complete)
    if best is not None and best.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_SOLVED if walked.complete else EXIT_NO_PLAN
