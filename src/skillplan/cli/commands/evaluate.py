"""``skillplan evaluate``."""

from __future__ import annotations

import math
import os
from typing import Any

import click

from skillplan.cli.options import (
    TaskPath,
    asked,
    back_end_options,
    format_option,
    jobs_option,
    make_setup,
    no_cache_option,
    part_option,
    seed_option,
    set_option,
    settings,
    time_limit_option,
)

# What a task file takes and a folder of runs does not, and the other way round.
_OF_TASK = ("sequence", "policy_file", "start", "part")
_OF_RUN = ("task_file", "changed_task", "episodes", "temperature", "seed", "layouts")


class Temperature(click.ParamType[float]):
    """A finite number above 0."""

    name = "temperature"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the temperature."""
        try:
            temperature = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number.", param, ctx)
        if not (math.isfinite(temperature) and temperature > 0):
            self.fail(f"must be a finite number > 0, not {value}.", param, ctx)
        return temperature


@click.command("evaluate")
@click.argument("task", type=TaskPath(), metavar="TASK|RUN")
@click.option(
    "--sequence",
    metavar="0,1,4,...",
    help="Action numbers or skill names, separated by commas.",
)
@click.option(
    "--policy",
    "policy_file",
    metavar="FILE",
    help="Follow the policy of a policies.json instead, without planning anew.",
)
@click.option(
    "--from",
    "start",
    metavar="PLACE",
    help="Start elsewhere: a place such as C20, or facts separated by commas.",
)
@click.option(
    "--task",
    "task_file",
    type=TaskPath(),
    metavar="FILE",
    help="Of a RUN: the task file, where it is not to be the one that train was given.",
)
@click.option(
    "--changed-task",
    is_flag=True,
    help="Of a RUN: evaluate even where the task is another one than was learned.",
)
@click.option(
    "--episodes",
    type=click.IntRange(1, 1_000_000),
    default=100,
    show_default=True,
    metavar="N",
    help="Of a RUN: roll-outs of every run, each action drawn by its score.",
)
@click.option(
    "--temperature",
    type=Temperature(),
    default=0.05,
    show_default=True,
    metavar="T",
    help="Of a RUN: what scores are divided by; the lower, the greedier.",
)
@seed_option
@click.option(
    "--layouts",
    type=click.IntRange(0, 10_000),
    metavar="N",
    help="Of a RUN: also try N layouts of the task file's family that no run has seen; default: "
    "20 where a family was learned, else none.",
)
@back_end_options
@set_option
@part_option
@time_limit_option(10.0)
@jobs_option
@no_cache_option
@format_option
@click.pass_context
def command(
    ctx: click.Context,
    task: str,
    sequence: str | None,
    policy_file: str | None,
    start: str | None,
    task_file: str | None,
    changed_task: bool,
    episodes: int,
    temperature: float,
    seed: int,
    layouts: int | None,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    time_limit_s: float,
    jobs: int,
    no_cache: bool,
    style: str,
) -> int:
    """Replay a sequence of skills on TASK, follow a stored policy, or try those of a RUN.

    Says whether it is feasible and complete, what it costs, how far that is from the proved
    optimum, or how far it may be at most, and otherwise which condition fails where. The time
    limit is for proving the optimum.

    RUN is a folder that train has written: the policy of every run is followed greedily and by
    drawn actions, beside chance alone. Back ends are those of the training.
    """
    from skillplan.cli.option_fit import refuse_given

    if os.path.isdir(task):
        from skillplan.cli.run_folder_evaluation import Asked, evaluate_run_folder
        from skillplan.records.training.run_folder import RunFolder

        folder = RunFolder(task)
        refuse_given(ctx, _OF_TASK, "is for a task file, not for a folder of runs")
        wanted = Asked(
            task_file,
            changed_task,
            physics,
            collision,
            options,
            settings(changes),
            episodes,
            temperature,
            seed,
            layouts,
            time_limit_s,
            jobs,
            no_cache,
        )
        return evaluate_run_folder(folder, wanted, style)
    refuse_given(ctx, _OF_RUN, "is for a folder of runs, not for a task file")
    from contextlib import closing

    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import showing_checks, stoppable
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_NO_PLAN, EXIT_SOLVED, OptionError
    from skillplan.model.policy_value import roll_out
    from skillplan.model.replay import replay
    from skillplan.pipeline.run import DEFAULT_SOLVER, make_model, solve, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.evaluation import Evaluation
    from skillplan.records.policy_file import read_policy, start_state
    from skillplan.solvers.solution import Plan
    from skillplan.views.tables.evaluation import evaluation_table

    loaded = load_problem(task, asked(physics, collision), settings(changes)).part(part)
    setup = make_setup(physics, collision, options, (DEFAULT_SOLVER,))(loaded)
    if (sequence is None) == (policy_file is None):
        raise OptionError("Give either --sequence or --policy.")
    stored = None if policy_file is None else read_policy(policy_file, loaded)
    if start is not None:
        try:
            initial = start_state(loaded, start)
        except OptionError as error:
            raise OptionError(f"--from {start}: {error}") from None
        loaded = loaded.replace(initial=initial, sha256=loaded.sha256)
    cache = VerdictCache() if no_cache else warm_cache()
    with showing_checks("replaying") as on_check:
        model = make_model(loaded, setup, cache, jobs=jobs, on_check=on_check)
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
                loaded, DEFAULT_SOLVER, setup, stop=stop, cache=cache, jobs=jobs, start=known
            )
    evaluation = Evaluation(loaded, skills, walked, best)
    emit(style, evaluation.document(), [evaluation_table(evaluation)], failed=not walked.complete)
    if best is not None and best.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_SOLVED if walked.complete else EXIT_NO_PLAN
